//! Random combinations of legal settings with hostile and regular pens, in simulated time: whatever `config`
//! accepts keeps the tip inside its envelope, sends legal commands, and stands still where the pen rests.
//!
//! Where the tip is, is computed here from the commanded joints, by Denavit-Hartenberg parameters of its own.
//! By default there are as many combinations as extremes of keys. FORETRACE_SETTINGS_CASES=20000 asks for
//! more, FORETRACE_SETTINGS_SEED for others, FORETRACE_SETTINGS_LONG=1 for pens that move and rest for
//! longer.

mod draw;
mod drive;
mod pens;
mod refusals;
mod tip;

use std::sync::Mutex;

use foretrace_config::{Config, Draft};
use rand::SeedableRng;
use rand_pcg::Pcg64;

use draw::Accepted;
use drive::{Length, Seen};

fn number(variable: &str, default: u64) -> u64 {
    std::env::var(variable).map_or(default, |text| text.parse().expect("a whole number"))
}

/// The faults of a run, in words; empty: none.
fn wrong(config: &Config, seen: &Seen) -> Vec<String> {
    let mut wrong = Vec::new();
    if !seen.legal {
        wrong.push("a command was not legal".to_owned());
    }
    let margin = config.settings().safety.envelope.margin_m;
    if seen.outside > margin + 1e-4 {
        wrong.push(format!("outside by {:.2} mm", seen.outside * 1e3));
    }
    let envelope = &config.settings().safety.envelope;
    if seen.tilt > envelope.max_tilt_rad.max(seen.tilt_begin) + 0.035 {
        wrong.push(format!("tilted by {:.3} rad", seen.tilt));
    }
    if let Some(limit) = envelope.max_speed_mps
        && seen.speed > limit * 1.1 + 1e-3
    {
        wrong.push(format!("{:.3} m/s", seen.speed));
    }
    if let Some((axis, swing)) = seen.swing {
        wrong.push(format!("swings by {:.2} mm along {axis}", swing * 1e3));
    }
    wrong
}

fn run(cases: u64, seed: u64, length: Length) -> Vec<String> {
    // FORETRACE_SETTINGS_ONLY=17,104 runs these alone.
    let only: Option<Vec<u64>> = std::env::var("FORETRACE_SETTINGS_ONLY")
        .ok()
        .map(|text| text.split(',').map(|case| case.parse().expect("whole numbers")).collect());
    let all: Vec<u64> = only.clone().unwrap_or_else(|| (0..cases).collect());
    let next = Mutex::new(all.into_iter());
    let found = Mutex::new(Vec::new());
    let left_out = Mutex::new(Vec::new());
    let counts = Mutex::new(([0_u64; 4], 0.0_f64));
    std::thread::scope(|scope| {
        for _ in 0..2 {
            scope.spawn(|| {
                loop {
                    let Some(case) = next.lock().unwrap().next() else { return };
                    let mut random = Pcg64::seed_from_u64(seed ^ (case << 20));
                    let Accepted { config, changed, refused, left_out: extreme } =
                        draw::accepted(&mut random, case);
                    left_out.lock().unwrap().extend(extreme);
                    let seen = drive::live(&config, &mut random, length);
                    let wrong = wrong(&config, &seen);
                    let mut locked = counts.lock().unwrap();
                    let (counts, farthest) = &mut *locked;
                    *farthest = farthest.max(seen.outside_stopping);
                    counts[0] += refused;
                    counts[1] += u64::from(seen.moved);
                    counts[2] += u64::from(seen.latched.is_some());
                    counts[3] += 1;
                    if !wrong.is_empty() {
                        found.lock().unwrap().push(format!(
                            "case {case} ({}, {:?}): {}: {changed}",
                            seen.pen,
                            seen.latched,
                            wrong.join(", ")
                        ));
                    }
                }
            });
        }
    });
    let ([refused, moved, latched, all], farthest) = counts.into_inner().unwrap();
    println!(
        "{all} combinations, {refused} refused on the way; {moved} moved, {latched} latched a stop, and went \
         {:.1} mm farther than they may at most while they stopped",
        farthest * 1e3
    );
    let mut left_out = left_out.into_inner().unwrap();
    left_out.sort();
    left_out.dedup();
    println!("extremes refused with whatever was tried: {}: {}", left_out.len(), left_out.join(", "));
    assert!(only.is_some() || latched * 20 < all, "a stop is the last resort: {latched} of {all}");
    assert!(
        only.is_some() || moved > all / 2,
        "where hardly any arm moves nothing is proved: {moved} of {all}"
    );
    found.into_inner().unwrap()
}

#[test]
fn whatever_is_accepted_stays_in_its_envelope_and_comes_to_rest() {
    let cases = number("FORETRACE_SETTINGS_CASES", draw::extremes());
    let length = if number("FORETRACE_SETTINGS_LONG", 0) > 0 { Length::LONG } else { Length::SHORT };
    let found = run(cases, number("FORETRACE_SETTINGS_SEED", 26), length);
    for line in &found {
        println!("{line}");
    }
    assert!(found.is_empty(), "{} of {cases} combinations", found.len());
}

/// Settings that once drove the tool into the table; bounds are the envelope's, above and below.
#[test]
fn limits_of_careful_people_keep_the_tip_on_the_paper() {
    for set in [
        ["mpc.limits.z.jerk_mps3", "300.0"],
        ["mpc.limits.z.jerk_mps3", "200.0"],
        ["mpc.limits.z.jerk_mps3", "100.0"],
        ["mpc.limits.x.jerk_mps3", "400.0"],
        ["mpc.limits.y.jerk_mps3", "400.0"],
        ["mpc.horizon", "10"],
    ] {
        let [key, value] = set;
        let config = Draft::preset("ur5").set(key, value).finish().unwrap();
        let mut random = Pcg64::seed_from_u64(3);
        for _ in 0..6 {
            let seen = drive::live(&config, &mut random, Length::SHORT);
            let [lowest, highest] = seen.height.map(|height| height * 1e3);
            println!("{key} = {value}, {}: {lowest:.2} to {highest:.2} mm over the paper", seen.pen);
            assert_eq!(wrong(&config, &seen), Vec::<String>::new(), "{key} = {value}, {}", seen.pen);
            assert_eq!(seen.latched, None, "{key} = {value}, {}", seen.pen);
        }
    }
}
