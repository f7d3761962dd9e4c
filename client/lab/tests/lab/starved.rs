//! A loop that the machine starves: periods without a tick, alone and in rows, while it writes. Until the
//! next command the arm goes on by itself, along the last command while that is valid, then braking joint by
//! joint, which is not straight for the tool. Wherever that leads, commands stay in the tool's envelope.

use foretrace_config::Config;
use foretrace_control::follower::Request;
use foretrace_sim::arm::ArmSettings;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

use crate::desk::{Desk, Pen};

/// How a machine takes periods away: the chance of a gap before a tick, the longest gap in periods, and the
/// rate that is left of 500 Hz.
#[derive(Debug, Clone, Copy)]
struct Load {
    chance: f64,
    longest: u64,
    left_hz: f64,
}

const LOADS: [Load; 5] = [
    Load { chance: 0.3, longest: 2, left_hz: 345.0 },
    Load { chance: 0.2, longest: 6, left_hz: 294.0 },
    Load { chance: 0.4, longest: 5, left_hz: 227.0 },
    // Longer than commands are valid: the arm brakes by itself.
    Load { chance: 0.05, longest: 20, left_hz: 328.0 },
    Load { chance: 0.005, longest: 20, left_hz: 475.0 },
];

/// Texts for each load and preset. Blind to gaps, most are stopped, and silence leads 20 mm into the paper.
const TEXTS: usize = 8;
/// So far beyond the margin silence may lead \[m\].
const BY_SILENCE_M: f64 = 2e-3;

#[test]
fn a_starved_loop_writes_on_inside_its_envelope() {
    for (preset, cycle_s) in [("ur5", 0.008), ("ur5e", 0.002)] {
        for load in LOADS {
            let (mut beyond, mut silence, mut ticks, mut periods) = (0.0_f64, 0.0_f64, 0_u64, 0_u64);
            for (seed, text) in (0..).zip(["hello", "Wxyz", "egg", "Ajk4"].into_iter().cycle().take(TEXTS)) {
                let settings = Config::preset(preset).unwrap().follower_settings();
                let margin = settings.safety.envelope.margin_m;
                let mut desk = Desk::with(ArmSettings::ur5(cycle_s, 0.030), settings);
                desk.ask(Request::Arm).unwrap();
                let counted = std::rc::Rc::new(std::cell::Cell::new([0_u64; 2]));
                let (mut random, count) = (Pcg64::seed_from_u64(seed), counted.clone());
                desk.lose(move || {
                    let [ticks, periods] = count.get();
                    let gap = if random.random_bool(load.chance) {
                        random.random_range(1..=load.longest)
                    } else {
                        // Rows for silence are there once the loop knows that it loses periods.
                        u64::from(ticks == 0)
                    };
                    count.set([ticks + 1, periods + 1 + gap]);
                    gap
                });
                let stop = desk.write_text(text, seed);
                assert_eq!(stop, None, "{preset}, {load:?}, {text} {seed}");
                beyond = beyond.max(desk.seen.outside_m - margin);
                silence = silence.max(desk.seen.silence_m - margin);
                let [of, all] = counted.get();
                (ticks, periods) = (ticks + of, periods + all);
            }
            let rate_hz = 500.0 * ticks as f64 / periods as f64;
            println!(
                "{preset} at {rate_hz:.0} Hz: {:.2} mm beyond the margin, {:.2} mm by silence",
                beyond * 1e3,
                silence * 1e3
            );
            assert!((rate_hz - load.left_hz).abs() < 15.0, "{load:?}: {rate_hz} Hz");
            assert!(beyond <= 0.0, "{preset}, {load:?}: {beyond} m beyond the margin");
            assert!(
                silence <= BY_SILENCE_M,
                "{preset}, {load:?}: silence leads {silence} m beyond the margin"
            );
        }
    }
}

/// Longer than the arm's lag: its joints answer what it did by itself before the next tick is made.
#[test]
fn stalls_are_not_taken_for_an_arm_that_is_elsewhere() {
    for (preset, cycle_s) in [("ur5", 0.008), ("ur5e", 0.002)] {
        for seed in 0..6 {
            let settings = Config::preset(preset).unwrap().follower_settings();
            let mut desk = Desk::with(ArmSettings::ur5(cycle_s, 0.030), settings);
            desk.ask(Request::Arm).unwrap();
            let mut random = Pcg64::seed_from_u64(seed);
            desk.lose(move || if random.random_bool(0.2) { random.random_range(30..=60) } else { 0 });
            let stop = desk.write(Pen { radius_m: 0.06, speed_mps: 0.8 }, 6.0);
            assert_eq!(stop, None, "{preset}, {seed}");
        }
    }
}
