//! The edges of every legal range of the plan's settings: they are accepted, and the next number beyond is
//! refused.

use crate::support;

use foretrace_control::mpc::MpcSettings;
use foretrace_control::predict::PredictorKind;

fn settings() -> MpcSettings {
    support::settings(PredictorKind::CONSTANT_VELOCITY).mpc
}

fn legal(change: impl Fn(&mut MpcSettings)) -> bool {
    let mut changed = settings();
    change(&mut changed);
    changed.validate().is_ok()
}

#[test]
fn ranges_hold_their_ends_and_nothing_beyond() {
    type Set = fn(&mut MpcSettings, f64);
    let ranges: [(&str, Set, f64, f64); 12] = [
        ("step", |s, x| s.step_s = x, 1e-3, 0.1),
        ("servo delay", |s, x| s.servo_s = x, 1e-3, 1.0),
        ("effort", |s, x| s.effort = x, 1e-9, 1e9),
        ("feedback position", |s, x| s.gains_feedback[0].position = x, 0.0, 1e3),
        ("feedforward velocity", |s, x| s.gains_feedforward[1].velocity = x, 0.0, 1e3),
        ("feedback acceleration", |s, x| s.gains_feedback[2].acceleration = x, 0.0, 1e3),
        ("decay", |s, x| s.gains_feedforward[2].decay = x, 0.01, 1.0),
        ("jerk", |s, x| s.axes[0].jerk_mps3 = x, 1.0, 1e5),
        ("acceleration", |s, x| s.axes[1].acceleration_mps2 = x, 0.01, 1e3),
        ("velocity", |s, x| s.axes[2].velocity_mps = x, 1e-3, 20.0),
        ("penalty on acceleration", |s, x| s.soft_penalty.acceleration = x, 1.0, 1e9),
        ("penalty on position", |s, x| s.soft_penalty.position = x, 1.0, 1e9),
    ];
    for (name, set, lowest, highest) in ranges {
        let legal = |value: f64| legal(|s| set(s, value));
        assert!(legal(lowest) && legal(highest) && legal(0.5 * (lowest + highest)), "{name}");
        assert!(!legal(lowest.next_down()) && !legal(highest.next_up()) && !legal(f64::NAN), "{name}");
    }
    assert!(legal(|s| s.servo_s = 0.0), "no servo");
    for (cap, fine) in [(0, false), (1, true), (10_000, true), (10_001, false), (u32::MAX, false)] {
        assert_eq!(legal(|s| s.max_iterations = cap), fine, "{cap} iterations");
    }
}

#[test]
fn a_workspace_is_near_and_wide_enough_to_work_in() {
    let far = 10f64.next_up();
    for (ends, fine) in [
        ([-10.0, 10.0], true),
        ([-far, 1.0], false),
        ([-1.0, far], false),
        ([0.0, 1e-3], true),
        ([0.0, 1e-3_f64.next_down()], false),
        ([0.1, -0.1], false),
        ([-11.0, -10.5], false),
        ([f64::NAN, 0.1], false),
        ([-0.1, f64::NAN], false),
    ] {
        for axis in 0..3 {
            assert_eq!(legal(|s| s.axes[axis].position_m = ends), fine, "{ends:?}");
        }
    }
}
