//! Tunes the ways of today (`foretrace_lab::today`) in their own favour on the training writers of a set.
//!
//! `cargo run --release -p foretrace-lab --example tune_today -- FOLDER [WAY [EVERY [limited]]]`
//!
//! FOLDER: a set such as `../shared/data/unipen-tos`; hover is kept, the median glyph is 0.1 m high. WAY: one of the
//! ways, or `all`. EVERY: search on every n-th letter (default 5); what is found is then scored on all of them.
//! `limited`: glyphs 0.03 m high and the shipped limits of a tool before a UR5, for the way that obeys limits.
//! Search for the least mean squared error: the servoj ways over the whole grid; the others from their settings one knob
//! after another over its grid, again until nothing improves. Then, of all settings tried whose RMS error is within 2 % of
//! the best, the one with the least jerk.

use std::path::Path;

use foretrace_lab::data::{DataSet, Split};
use foretrace_lab::experiments::{Labels, letters};
use foretrace_lab::path::{PathSample, Placement};
use foretrace_lab::today::{Feed, Limits, OpenLoop, Origin, OtgKnobs, WayKind, WaySettings, open_loop};

const PERIOD_S: f64 = 0.002;
/// Limits of the shipped settings for a tool before a UR5.
const UR5: Limits = Limits { velocity_mps: 1.0, acceleration_mps2: 15.0, jerk_mps3: 2000.0 };
/// RMS error that may be given for less jerk.
const SLACK: f64 = 1.02;

/// One knob: its name and the settings that each of its values leads to.
type Knob = (&'static str, fn(&WaySettings) -> Vec<WaySettings>);

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let folder = arguments.first().ok_or("usage: tune_today FOLDER [WAY|all [EVERY]]")?;
    let kinds = match arguments.get(1).map(String::as_str) {
        None | Some("all") => WayKind::ALL.to_vec(),
        Some(name) => vec![name.parse()?],
    };
    let every: usize = arguments.get(2).map_or(Ok(5), |text| text.parse())?;
    let limited = arguments.get(3).is_some_and(|word| word == "limited");
    let (height_m, limits) = if limited { (0.03, UR5) } else { (0.1, Limits::OFF) };
    let set = DataSet::load(Path::new(folder), &Split::train(), true)?;
    let placement = Placement { size_m: [1.0, 0.6], glyph_height_m: height_m, ..Placement::default() };
    let (letters, skipped) = letters(&set, &Labels::All, &placement)?;
    let all: Vec<&[PathSample]> = letters.iter().map(|letter| &letter.path.samples[..]).collect();
    let some: Vec<&[PathSample]> = all.iter().step_by(every.max(1)).copied().collect();
    println!("{}: {} letters ({skipped} do not fit), search on {}", set.name, all.len(), some.len());
    for kind in kinds {
        let dead_times = if kind.smooths_in_the_servo() { &[0.0, 0.03][..] } else { &[0.0, 0.03, 0.1] };
        for &dead_time_s in dead_times {
            let start = WaySettings::new(kind, PERIOD_S, dead_time_s, limits).for_height(height_m);
            tune(kind, &start, &some, &all)?;
        }
    }
    Ok(())
}

fn tune(
    kind: WayKind,
    start: &WaySettings,
    some: &[&[PathSample]],
    all: &[&[PathSample]],
) -> Result<(), Box<dyn std::error::Error>> {
    let mut tried = vec![(*start, open_loop(kind, start, some)?)];
    if kind.smooths_in_the_servo() {
        let mut grid = vec![*start];
        for (_, values) in knobs(kind) {
            grid = grid.iter().flat_map(values).collect();
        }
        for point in grid {
            tried.push((point, open_loop(kind, &point, some)?));
        }
    } else {
        let mut quick = *start;
        quick.otg = OtgKnobs { acceleration_share: 0.0, intercept: true, window_s: 0.016, ..start.otg };
        quick.otg.limits.jerk_mps3 = 1e6;
        quick.kalman.acceleration_share = 0.0;
        for start in [*start, quick] {
            descend(kind, &start, some, &mut tried)?;
        }
    }
    let best = least(&tried)?;
    let near = |score: &OpenLoop| score.mse_m2 <= SLACK * SLACK * best.1.mse_m2;
    let smooth = tried
        .iter()
        .filter(|(_, score)| near(score))
        .min_by(|a, b| a.1.rms_jerk_mps3.total_cmp(&b.1.rms_jerk_mps3))
        .unwrap_or(&best);
    println!("\n{kind}, dead time {} ms, {} settings tried", start.dead_time_s * 1e3, tried.len());
    for (name, point) in [("as set", start), ("least error", &best.0), ("chosen", &smooth.0)] {
        let score = open_loop(kind, point, all)?;
        println!(
            "  {name:<12} RMS {:.3} mm, pen down {:.3} mm, RMS jerk {:.0} m/s3, {} failures\n    {}",
            score.mse_m2.sqrt() * 1e3,
            score.pen_down_mse_m2.sqrt() * 1e3,
            score.rms_jerk_mps3,
            score.failures,
            describe(kind, point)
        );
    }
    Ok(())
}

/// One knob after another over its grid, again until nothing improves.
fn descend(
    kind: WayKind,
    start: &WaySettings,
    some: &[&[PathSample]],
    tried: &mut Vec<(WaySettings, OpenLoop)>,
) -> Result<(), Box<dyn std::error::Error>> {
    let mut best = (*start, open_loop(kind, start, some)?);
    loop {
        let before = best.1.mse_m2;
        for (_, values) in knobs(kind) {
            for point in values(&best.0) {
                let known = tried.iter().find(|(known, _)| *known == point).map(|(_, score)| *score);
                let score = known.map_or_else(|| open_loop(kind, &point, some), Ok)?;
                tried.push((point, score));
                if score.mse_m2 < best.1.mse_m2 {
                    best = (point, score);
                }
            }
        }
        if best.1.mse_m2 >= before {
            return Ok(());
        }
    }
}

fn least(tried: &[(WaySettings, OpenLoop)]) -> Result<(WaySettings, OpenLoop), Box<dyn std::error::Error>> {
    let least = tried.iter().copied().min_by(|a, b| a.1.mse_m2.total_cmp(&b.1.mse_m2));
    least.ok_or_else(|| "nothing was tried".into())
}

fn describe(kind: WayKind, settings: &WaySettings) -> String {
    match kind {
        WayKind::ServojGello | WayKind::ServojRos => format!("{:?} {:?}", settings.feed, settings.one_euro),
        WayKind::Otg => format!("{:?}", settings.otg),
        WayKind::Kalman => format!("{:?}", settings.kalman),
    }
}

/// `settings` once for every value, each set by `set`.
fn each<T: Copy>(
    settings: &WaySettings,
    values: &[T],
    set: impl Fn(&mut WaySettings, T),
) -> Vec<WaySettings> {
    values
        .iter()
        .map(|value| {
            let mut point = *settings;
            set(&mut point, *value);
            point
        })
        .collect()
}

fn knobs(kind: WayKind) -> &'static [Knob] {
    const SERVOJ: &[Knob] = &[
        ("feed", |s| each(s, &[Feed::Samples, Feed::Periods], |p, feed| p.feed = feed)),
        ("beta", |s| {
            let values = [0.0, 1.0, 3.0, 10.0, 30.0, 100.0, 300.0, 1000.0];
            each(s, &values, |p, beta| p.one_euro.beta_hz_per_mps = beta)
        }),
        ("cut-off of speed", |s| {
            each(s, &[0.5, 1.0, 3.0, 10.0, 30.0], |p, hz| p.one_euro.speed_cutoff_hz = hz)
        }),
        ("cut-off at rest", |s| {
            each(s, &[0.5, 1.0, 2.0, 5.0, 10.0, 20.0], |p, hz| p.one_euro.min_cutoff_hz = hz)
        }),
    ];
    const OTG: &[Knob] = &[
        ("window", |s| {
            let values = [0.006, 0.011, 0.016, 0.021, 0.026, 0.031, 0.036, 0.041, 0.051, 0.061, 0.081];
            each(s, &values, |p, window_s| p.otg.window_s = window_s)
        }),
        ("acceleration believed", |s| {
            each(s, &[0.0, 0.25, 0.5, 0.75, 1.0], |p, share| p.otg.acceleration_share = share)
        }),
        ("interception", |s| each(s, &[false, true], |p, intercept| p.otg.intercept = intercept)),
        ("longest prediction", |s| {
            each(s, &[0.025, 0.05, 0.075, f64::INFINITY], |p, most| p.otg.horizon_max_s = most)
        }),
        ("target acceleration", |s| each(s, &[false, true], |p, on| p.otg.target_acceleration = on)),
        ("jerk limit", |s| {
            each(s, &[3e2, 1e3, 3e3, 1e4, 3e4, 1e5, 3e5, 1e6, 1e7], |p, jerk| p.otg.limits.jerk_mps3 = jerk)
        }),
        ("acceleration limit", |s| {
            each(s, &[15.0, 50.0, 100.0, 500.0, 3000.0], |p, limit| p.otg.limits.acceleration_mps2 = limit)
        }),
    ];
    const KALMAN: &[Knob] = &[
        ("process noise", |s| {
            let values = [1e-3, 3e-3, 0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0, 300.0];
            each(s, &values, |p, noise| p.kalman.process_mps2 = noise)
        }),
        ("acceleration believed", |s| {
            each(s, &[0.0, 0.25, 0.5, 0.75, 1.0], |p, share| p.kalman.acceleration_share = share)
        }),
        ("origin", |s| each(s, &[Origin::Measured, Origin::Filtered], |p, origin| p.kalman.origin = origin)),
        ("longest prediction", |s| {
            let values = [0.025, 0.035, 0.05, 0.075, f64::INFINITY];
            each(s, &values, |p, most| p.kalman.horizon_max_s = most)
        }),
        ("turn rule", |s| each(s, &[false, true], |p, on| p.kalman.turn_rule = on)),
        ("reversal rule", |s| each(s, &[false, true], |p, on| p.kalman.reversal_rule = on)),
    ];
    match kind {
        WayKind::ServojGello | WayKind::ServojRos => SERVOJ,
        WayKind::Otg => OTG,
        WayKind::Kalman => KALMAN,
    }
}
