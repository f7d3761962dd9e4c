//! The shipped plan at the edges of its workspace: 50 ms of foresight must be enough to brake in.

use foretrace_config::Config;
use foretrace_control::follower::{Budget, Follower, JointReading, NoClock, Request, StepInput};
use foretrace_control::guard::CommandChecker;
use foretrace_control::pen::PenReading;
use foretrace_control::units::Stamp;
use foretrace_lab::arm::JOINTS;

/// How far the commanded tool of `preset` got beyond its workspace while the pen went along `path` for `seconds` \[m\], and the
/// largest number of steps that a plan took.
fn beyond(preset: &str, seconds: f64, path: impl Fn(f64) -> [f64; 2]) -> ([f64; 3], u32) {
    let config = Config::preset(preset).unwrap();
    let settings = config.follower_settings();
    let (workspace, period_ns) = (config.settings().plane.workspace_m, settings.period_ns);
    let mut judge = CommandChecker::new(settings.limits);
    let mut follower = Follower::<20, JOINTS>::new(settings).unwrap();
    let mut joints = JointReading {
        stamp: Stamp(10_000_000_000),
        q: config.robot().home,
        qd: [0.0; JOINTS],
        motion_allowed: true,
    };
    let (mut most, mut steps) = ([f64::NEG_INFINITY; 3], 0);
    let begin = joints.stamp;
    for tick in 0..(seconds * 1e9) as u64 / period_ns {
        let now = begin + tick * period_ns;
        joints.stamp = now;
        let pen = [PenReading::new(now, path(now.seconds_since(begin)), tick / 300 % 2 == 0)];
        let request = (tick == 1).then_some(Request::Arm);
        let input = StepInput { pen: &pen, joints: Some(&joints), request, ..StepInput::nothing(now) };
        let output = follower.step(&input, Budget::default(), &mut NoClock);
        let Some(command) = output.command else { continue };
        if output.begins {
            judge.restart();
        }
        assert!(judge.observe(command.stamp, command.valid_until, &command.q, &command.qd), "tick {tick}");
        (joints.q, joints.qd) = (command.q, command.qd);
        for ((most, at), [low, high]) in most.iter_mut().zip(output.tool).zip(workspace) {
            *most = most.max(at - high).max(low - at);
        }
        steps = output.axes.iter().map(|axis| axis.iterations).max().unwrap_or(0).max(steps);
    }
    (most, steps)
}

#[test]
fn the_tool_brakes_before_the_edge_of_the_workspace() {
    for preset in ["ur5", "ur5e"] {
        let corners = |t: f64| [[0.3, 0.3], [-0.3, 0.3], [-0.3, -0.3], [0.3, -0.3]][(t / 0.5) as usize % 4];
        let circles = |t: f64| [0.2 * (14.0 * t).cos(), 0.2 * (14.0 * t).sin()];
        let sweeps = |t: f64| [0.25 * (9.0 * t).sin(), 0.09 * (2.0 * t).sin()];
        let (corners, circles, sweeps) =
            (beyond(preset, 6.0, corners), beyond(preset, 6.0, circles), beyond(preset, 6.0, sweeps));
        for (name, ([x, y, z], steps)) in [("corners", corners), ("circles", circles), ("sweeps", sweeps)] {
            println!(
                "{preset}, {name}: x, y, z beyond by {x:.5} {y:.5} {z:.5} m; at most {steps} steps a plan"
            );
            // The box is soft: a plan must never be infeasible.
            assert!(x.max(y) < 2e-3 && z < 1e-3, "{preset}, {name}: {x} {y} {z}");
        }
    }
}
