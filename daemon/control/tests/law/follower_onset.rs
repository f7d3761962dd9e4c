//! Onset of the pen's motion, tested through the whole step: how a strong and a weak arm set off.

use crate::support::writing::write;
use crate::support::{Bench, PERIOD_NS, settings};
use foretrace_control::follower::FollowerSettings;
use foretrace_control::predict::PredictorKind;
use foretrace_control::trust::TrustRequest;
use foretrace_control::units::Trust;

/// Dead time of the arm \[s\].
const DEAD_S: f64 = 0.03;
/// Interval between strokes \[s\].
const EVERY_S: f64 = 0.4;

/// Every fourth is a serif, which turns back.
const SERIF: f64 = 3.0;

/// After a rest 40 mm in 0.2 s, to and fro; every fourth time 12 mm across and back within 60 ms instead.
fn strokes_and_serifs(t: f64) -> [f64; 2] {
    let number = (t / EVERY_S).floor();
    let since = t - EVERY_S * number;
    let part = (since / 0.2).min(1.0);
    let to = 0.04 * part * part * (3.0 - 2.0 * part);
    let serif = 0.012 * (std::f64::consts::PI * (since / 0.06).min(1.0)).sin().powi(2);
    match (number % 8.0) as u32 {
        0 | 2 | 5 => [to - 0.02, 0.0],
        1 | 4 | 6 => [0.02 - to, 0.0],
        3 => [0.02, serif],
        _ => [-0.02, -serif],
    }
}

/// RMS distance \[m\] from the pen one dead time later, after the first 4 s of 12.
fn rms(serif: bool, acceleration_mps2: f64, trust_request: TrustRequest) -> f64 {
    let mut wanted = FollowerSettings {
        trust_request,
        dead_time_ns: (DEAD_S * 1e9) as u64,
        ..settings(PredictorKind::CONSTANT_VELOCITY)
    };
    for axis in &mut wanted.mpc.axes {
        axis.acceleration_mps2 = acceleration_mps2;
    }
    let mut bench = Bench::armed(wanted);
    let start = bench.now;
    let (mut sum, mut count) = (0.0, 0.0);
    write(&mut bench, start, 12_000_000_000 / PERIOD_NS, strokes_and_serifs, |_, output| {
        let t = output.command.unwrap().stamp.seconds_since(start);
        if t > 4.0 && serif == ((t / EVERY_S).floor() % 4.0 == SERIF) {
            let [x, y] = strokes_and_serifs(t + DEAD_S);
            sum += (output.tool[0] - x).powi(2) + (output.tool[1] - y).powi(2);
            count += 1.0;
        }
    });
    f64::sqrt(sum / count)
}

#[test]
fn an_arm_that_is_never_at_its_limits_sets_off_at_once_and_one_that_is_waits() {
    let beside_hold = |serif, acceleration_mps2| {
        let held = rms(serif, acceleration_mps2, TrustRequest::Manual(Trust::NONE));
        rms(serif, acceleration_mps2, TrustRequest::Auto) / held
    };
    let [strong, weak] = [1000.0, 12.0].map(|acceleration_mps2| beside_hold(false, acceleration_mps2));
    println!("strokes: {strong:.3} of what feedback leaves, behind an arm at its limits {weak:.3}");
    assert!(strong < 0.47, "{strong}: waited, though nothing was to be gained");
    assert!(weak > 1.1 * strong && weak < 0.6, "{weak}, {strong}: did not wait, or too long");
    let serifs = beside_hold(true, 12.0);
    assert!(
        serifs < 0.9,
        "{serifs}: strokes that turn back leave an arm at its limits no worse than feedback"
    );
}
