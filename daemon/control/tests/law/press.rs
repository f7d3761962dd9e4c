//! A pen that presses: the depth while it touches, and what stays as it was.

use crate::support::{Bench, STEP_NS, settings};
use foretrace_control::extent::{ExtentBounds, ExtentWatch};
use foretrace_control::follower::FollowerSettings;
use foretrace_control::pen::PenReading;
use foretrace_control::predict::PredictorKind;
use foretrace_control::stop::StopReason;

const PRESS_M: f64 = 0.001;

fn pressing(press_m: f64) -> FollowerSettings<6> {
    let mut settings = settings(PredictorKind::HOLD);
    settings.plane.press_depth = press_m;
    // As deep as it may press, and no deeper.
    settings.mpc.axes[2].position_m = [-PRESS_M, 0.05];
    settings.safety.envelope.margin_m = 0.001;
    settings
}

/// Heights of the commanded tip \[m\] at the end of a hover, of writing, of a hover again; and the lowest.
fn heights(press_m: f64) -> [f64; 4] {
    let settings = pressing(press_m);
    let (bounds, mut watch) = (ExtentBounds::of(&settings), ExtentWatch::new(&settings));
    let mut bench = Bench::armed(settings);
    let mut seen = [0.0; 4];
    for (phase, contact) in [false, true, false].into_iter().enumerate() {
        for tick in 0..600_u64 {
            let due = (tick * 2_000_000).is_multiple_of(STEP_NS / 2);
            let at = 0.02 * (6.0 * tick as f64 * 0.002).sin();
            let sample = [PenReading::new(bench.now, [at, 0.3 * at], contact)];
            let output = bench.tick(if due { &sample } else { &[] });
            assert_eq!(output.stop_reason, StopReason::None);
            watch.see(&output.command.unwrap().q);
            seen[phase] = output.tool[2];
            seen[3] = seen[3].min(output.tool[2]);
        }
    }
    assert!(bounds.broken_by(&watch.extent().unwrap()).is_none(), "wanted pressing is no breach");
    seen
}

#[test]
fn a_pen_that_touches_is_pressed_and_a_lifted_one_hovers_as_before() {
    let ([up, down, again, _], [up_pressing, down_pressing, again_pressing, lowest]) =
        (heights(0.0), heights(PRESS_M));
    let near = |at: f64, wanted: f64| (at - wanted).abs() < 5e-5;
    assert!(near(up, 0.01) && near(up_pressing, 0.01), "{up} {up_pressing}");
    assert!(near(again, 0.01) && near(again_pressing, 0.01), "{again} {again_pressing}");
    assert!(near(down, 0.0) && near(down_pressing, -PRESS_M), "{down} {down_pressing}");
    assert!(lowest > -PRESS_M - 1e-4, "{lowest}");
}
