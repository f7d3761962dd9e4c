//! Where an arm may be armed, and how old its joint state may be.

use crate::support::{Bench, HOME, PERIOD_NS, settings};
use foretrace_control::follower::{Budget, FollowerSettings, Refusal, Request, StepInput};
use foretrace_control::ik::{ToolTarget, solve_pose};
use foretrace_control::predict::PredictorKind;
use nalgebra::{Rotation3, Vector3};

const MARGIN_M: f64 = 0.02;

fn narrow() -> FollowerSettings<6> {
    let mut settings = settings(PredictorKind::CONSTANT_VELOCITY);
    settings.safety.arm_workspace_margin = MARGIN_M;
    settings
}

/// The joints that hold the tool at `tool` \[m\], plane frame, tilted by `tilt` \[rad\].
fn posed(settings: &FollowerSettings<6>, tool: Vector3<f64>, tilt: f64) -> [f64; 6] {
    let plane = settings.plane;
    let axis = plane.rotation * (Rotation3::from_axis_angle(&Vector3::x_axis(), tilt) * -Vector3::z());
    let target = ToolTarget::at_rest(plane.point_to_base(&tool), axis, None);
    solve_pose(&settings.chain, &HOME, &target).unwrap()
}

#[test]
fn an_arm_may_be_armed_as_far_from_its_workspace_as_the_margin_says() {
    let settings = narrow();
    for (axis, limits) in settings.mpc.axes.iter().enumerate() {
        let [low, high] = limits.position_m;
        for (beyond, fine) in [(-0.02, true), (-1e-3, true), (1e-3, false), (0.02, false)] {
            for at in [low - MARGIN_M - beyond, high + MARGIN_M + beyond] {
                let mut tool = Vector3::zeros();
                tool[axis] = at;
                let expected = if fine { Ok(()) } else { Err(Refusal::ToolOutsideWorkspace) };
                assert_eq!(
                    settings.may_arm_at(&posed(&settings, tool, 0.0)),
                    expected,
                    "axis {axis}: {at} m"
                );
            }
        }
    }
}

#[test]
fn an_arm_may_be_armed_as_tilted_as_its_settings_say() {
    let settings = narrow();
    let most = settings.safety.arm_max_tilt;
    for sign in [-1.0, 1.0] {
        let tilted = |by: f64| settings.may_arm_at(&posed(&settings, Vector3::zeros(), sign * by));
        assert_eq!(tilted(0.0), Ok(()));
        assert_eq!(tilted(most - 0.01), Ok(()));
        assert_eq!(tilted(most + 0.01), Err(Refusal::ToolNotAligned));
    }
}

/// The answer to arming this many ticks after the last of joint states that came every `every` ticks.
fn armed_after(every: u64, ticks: u64) -> Result<(), Refusal> {
    let mut bench = Bench::new(narrow());
    for tick in 0..=20 * every + ticks {
        bench.joints.stamp = bench.now;
        let joints = bench.joints;
        let told = tick % every == 0 && tick <= 20 * every;
        let request = (tick == 20 * every + ticks).then_some(Request::Arm);
        let joints = told.then_some(&joints);
        let input = StepInput { joints, request, ..StepInput::nothing(bench.now) };
        if let Some(answer) = bench.step(&input, Budget::default()).answer {
            return answer;
        }
    }
    panic!("no answer")
}

#[test]
fn who_has_not_been_heard_of_for_three_of_its_own_intervals_is_not_armed() {
    let ticks = |ms: u64| ms * 1_000_000 / PERIOD_NS;
    // Every 2 ms, where 20 ms are the least; every 10 ms; every 16 ms.
    for (every_ms, oldest_ms) in [(2, 20), (10, 30), (16, 48)] {
        let after = |ms: u64| armed_after(ticks(every_ms), ticks(ms));
        assert_eq!(after(0), Ok(()), "every {every_ms} ms");
        assert_eq!(after(oldest_ms), Ok(()), "every {every_ms} ms");
        assert_eq!(after(oldest_ms + 2), Err(Refusal::JointStateStale), "every {every_ms} ms");
        assert_eq!(after(oldest_ms + 40), Err(Refusal::JointStateStale), "every {every_ms} ms");
    }
}

#[test]
fn commands_are_valid_for_as_many_periods_as_the_settings_say() {
    for valid_periods in [2, 5, 9] {
        let mut settings = narrow();
        settings.safety.valid_periods = valid_periods;
        assert_eq!(settings.valid_ns(), u64::from(valid_periods) * PERIOD_NS);
        let mut bench = Bench::armed(settings);
        let command = bench.tick(&[]).command.unwrap();
        assert_eq!(command.valid_until, command.stamp + u64::from(valid_periods) * PERIOD_NS);
    }
}
