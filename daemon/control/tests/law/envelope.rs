//! The tool's envelope through the whole step: inside it whatever the pen does, from outside only inward, and
//! a latched stop with its reason where it cannot be kept.

use crate::support::{Bench, HOME, PERIOD_NS, settings};
use foretrace_control::arm::{JointLimits, JointMotion};
use foretrace_control::envelope::{Envelope, EnvelopeFigures, EnvelopeSettings};
use foretrace_control::extent::{Extent, ExtentBounds};
use foretrace_control::follower::{Budget, FollowerSettings, JointCommand, Mode, Refusal, Request};
use foretrace_control::guard::{Commanded, consumer_state};
use foretrace_control::ik::{ToolTarget, solve_pose};
use foretrace_control::mpc::AxisLimits;
use foretrace_control::predict::PredictorKind;
use foretrace_control::stop::{StopCause, StopReason};
use nalgebra::{Rotation3, Vector3};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

const MARGIN_M: f64 = 0.001;

fn within(envelope: EnvelopeSettings) -> FollowerSettings<6> {
    let mut settings = settings(PredictorKind::CONSTANT_VELOCITY);
    settings.safety.envelope = envelope;
    settings
}

fn usual() -> EnvelopeSettings {
    EnvelopeSettings { margin_m: MARGIN_M, max_tilt_rad: 0.35, max_speed_mps: None }
}

/// Four corners beyond the workspace, a quarter of a second each.
fn corner(tick: u64) -> [f64; 2] {
    [[0.2, 0.2], [-0.2, 0.2], [-0.2, -0.2], [0.2, -0.2]][(tick / 125 % 4) as usize]
}

fn tilt(settings: &FollowerSettings<6>, q: &[f64; 6]) -> f64 {
    let tool = settings.chain.forward(q).rotation.column(2).into_owned();
    tool.dot(&settings.plane.tool_axis()).clamp(-1.0, 1.0).acos()
}

/// Largest distance outside the workspace, speed and tilt over jumps from corner to corner; nothing may
/// latch.
fn worst(settings: &FollowerSettings<6>) -> [f64; 3] {
    let mut bench = Bench::armed(settings.clone());
    let [mut outside, mut speed, mut tilted] = [0.0_f64; 3];
    let mut before = None;
    for tick in 0..3000 {
        let mut pen = bench.pen(corner(tick));
        pen.contact = tick / 60 % 2 == 0;
        let output = bench.tick(&[pen]);
        assert!(matches!(output.mode, Mode::Following), "{tick}: {:?}", output.stop_detail);
        for (at, axis) in output.tool.iter().zip(&settings.mpc.axes) {
            let [low, high] = axis.position_m;
            outside = outside.max(at - high).max(low - at);
        }
        let tool = Vector3::from(output.tool);
        if let Some(before) = before.replace(tool) {
            speed = speed.max((tool - before).norm() / (PERIOD_NS as f64 * 1e-9));
        }
        tilted = tilted.max(tilt(settings, &output.command.unwrap().q));
    }
    println!("{:.3} mm outside, {speed:.3} m/s, {tilted:.3} rad", outside * 1e3);
    [outside, speed, tilted]
}

#[test]
fn leaps_stay_inside_with_joints_far_weaker_than_the_plan() {
    for acceleration in [30.0, 5.0, 0.5] {
        let mut settings = within(usual());
        let limits = settings.limits;
        settings.limits = JointLimits::new(*limits.position(), *limits.velocity(), [acceleration; 6])
            .unwrap()
            .with_stale_braking(limits.hold_s(), [0.5 * acceleration; 6])
            .unwrap();
        let [outside, ..] = worst(&settings);
        assert!(outside <= MARGIN_M, "{acceleration} rad/s²: {outside} m");
    }
}

#[test]
fn tilt_and_speed_are_kept() {
    let [_, speed, tilted] =
        worst(&within(EnvelopeSettings { max_tilt_rad: 0.05, max_speed_mps: Some(0.2), ..usual() }));
    assert!(speed < 0.2 * 1.1, "{speed} m/s");
    assert!(tilted < 0.05 + 0.03, "{tilted} rad");
}

#[test]
fn ticks_far_from_every_bound_keep_their_bits() {
    let wide = EnvelopeSettings { margin_m: 0.1, max_tilt_rad: 1.6, max_speed_mps: Some(50.0) };
    let [mut a, mut b] = [usual(), wide].map(|envelope| Bench::armed(within(envelope)));
    for tick in 0..2000 {
        let t = f64::from(tick) * 2e-3;
        let at = [0.02 * (11.0 * t).sin(), 0.015 * (17.0 * t).cos()];
        let (a, b) = (a.tick(&[a.pen(at)]), b.tick(&[b.pen(at)]));
        assert_eq!(a.command, b.command, "{tick}");
        assert_eq!(a.ik.envelope, [0; 2], "{tick}");
    }
}

/// Armed outside, in the plane or above, or tilted: never farther out, and finally inside, without a stop.
#[test]
fn from_outside_the_way_leads_only_inward() {
    let tilts = |by: f64| Rotation3::from_euler_angles(by, 0.0, 0.0);
    for (place, turned) in [
        ([0.14, 0.0, 0.01], 0.0),
        ([-0.13, -0.15, 0.02], 0.0),
        ([0.0, 0.0, 0.08], 0.0),
        ([0.0, 0.0, -0.09], 0.0),
        ([0.0, 0.0, 0.01], 0.3),
    ] {
        let envelope = EnvelopeSettings { max_tilt_rad: 0.1, ..usual() };
        let mut settings = within(envelope);
        // The plan's own bounds lead the tool back.
        settings.safety.arm_workspace_margin = 0.06;
        let plane = settings.plane;
        let axis = plane.rotation * (tilts(turned) * -Vector3::z());
        let target = ToolTarget::at_rest(plane.point_to_base(&Vector3::from(place)), axis, None);
        let q = solve_pose(&settings.chain, &HOME, &target).unwrap();
        let mut bench = Bench::new(settings.clone());
        bench.joints.q = q;
        let far = |tool: [f64; 3]| {
            let axes = tool.into_iter().zip(&settings.mpc.axes);
            axes.map(|(at, axis)| (at - axis.position_m[1]).max(axis.position_m[0] - at)).fold(0.0, f64::max)
        };
        let (mut outside, mut tilted) = (f64::INFINITY, f64::INFINITY);
        for tick in 0..2500 {
            let request = (tick == 0).then_some(Request::Arm);
            let pen = bench.pen([0.01, 0.01]);
            let output = bench.tick_with(&[pen], request, Budget::default());
            assert!(output.answer.is_none_or(|answer: Result<(), Refusal>| answer.is_ok()), "{output:?}");
            assert_eq!(output.stop_reason, StopReason::None, "{place:?}, {tick}: {:?}", output.stop_detail);
            let now = far(output.tool);
            assert!(now <= outside.max(MARGIN_M) + 1e-6, "{place:?}, {tick}: {now} after {outside}");
            outside = outside.min(now);
            let now = tilt(&settings, &output.command.unwrap().q);
            assert!(now <= tilted.max(0.13) + 1e-6, "{place:?}, {tick}: {now} after {tilted}");
            tilted = tilted.min(now);
        }
        assert!(outside < 1e-6 && tilted < 0.1, "{place:?}: {outside} m, {tilted} rad");
    }
}

/// A consumer without commands for a while moved by itself: no row could prevent that.
#[test]
fn what_no_row_can_keep_latches_a_stop_that_says_what_was_seen() {
    let mut bench = Bench::armed(within(usual()));
    let mut latched = None;
    for tick in 0..6000 {
        let t = f64::from(tick) * 2e-3;
        let output = bench.tick(&[bench.pen([0.2 * (9.0 * t).sin(), 0.0])]);
        if output.stop_reason == StopReason::Envelope {
            latched = Some(output);
            break;
        }
        let velocity = output.setpoint[0].velocity;
        let room = 0.12 - output.tool[0].abs();
        // Lost on the way out, so near that silence leads farther than the margin.
        let outward = velocity * output.tool[0] > 0.0;
        if outward && room < velocity.abs() * 0.012 && velocity.abs() > 0.12 {
            bench.now = bench.now + 40 * PERIOD_NS;
        }
    }
    let output = latched.expect("the tool left the workspace");
    let detail = output.stop_detail;
    assert_eq!(detail.cause, StopCause::Workspace);
    assert!(
        (detail.limit.abs() - 0.121).abs() < 1e-9 && detail.amount.abs() > detail.limit.abs(),
        "{detail:?}"
    );
    assert_eq!(output.mode, Mode::Stopped);
    for _ in 0..500 {
        let output = bench.tick(&[]);
        assert_eq!(output.mode, Mode::Stopped);
    }
}

/// How far outside the workspace a consumer gets on its way to rest that receives nothing after `command`
/// \[m\].
fn silence_leads(settings: &FollowerSettings<6>, command: &JointCommand<6>) -> f64 {
    let JointCommand { stamp, valid_until, q, qd, .. } = *command;
    let last = Commanded::new(stamp, JointMotion { q, qd, qdd: [0.0; 6] }).unwrap();
    let outside = |millis: u64| {
        let at = stamp + millis * 1_000_000;
        let state = consumer_state(&last, valid_until, settings.limits.deceleration(), at);
        let tool = settings.plane.point_from_base(&settings.chain.forward(&state.q).position);
        let axes = tool.iter().zip(&settings.mpc.axes);
        axes.map(|(at, axis)| (at - axis.position_m[1]).max(axis.position_m[0] - at)).fold(0.0, f64::max)
    };
    (0..=200).map(outside).fold(0.0, f64::max)
}

/// Each joint brakes by itself then, which is not straight for the tool. A loop that never lost a tick does
/// not look at it; one that did looks at it for ten seconds.
#[test]
fn after_a_gap_silence_leads_hardly_beyond_the_margin_from_any_command() {
    let settings = within(usual());
    let mut bench = Bench::armed(settings.clone());
    let [mut before, mut after, mut later] = [0.0_f64; 3];
    for tick in 0..9000 {
        if tick == 2000 {
            bench.now = bench.now + PERIOD_NS;
        }
        let output = bench.tick(&[bench.pen(corner(tick))]);
        assert!(matches!(output.mode, Mode::Following), "{tick}: {:?}", output.stop_detail);
        let outside = silence_leads(&settings, &output.command.unwrap());
        // Twenty ticks to slow down in.
        match tick {
            0..2000 => before = before.max(outside),
            2020..7000 => after = after.max(outside),
            7000.. => later = later.max(outside),
            _ => {}
        }
    }
    println!("{:.2} mm outside, {:.2} after a gap, {:.2} later", before * 1e3, after * 1e3, later * 1e3);
    assert!(before > 5.0 * MARGIN_M && later > 5.0 * MARGIN_M, "{before} and {later} m: nothing to look at");
    assert!(after <= 2.0 * MARGIN_M, "{after} m");
}

/// Touching down on the paper again and again while the machine takes every tenth tick's time away, up to
/// 30 ms at once. Joints come to rest one after the other: the tool may be lowest on the way to its rest.
#[test]
fn touching_down_on_a_machine_that_loses_periods_keeps_half_of_the_margin() {
    let mut settings = within(usual());
    let limits = settings.limits;
    settings.limits = JointLimits::new(*limits.position(), *limits.velocity(), [40.0; 6])
        .unwrap()
        .with_stale_braking(limits.hold_s(), [20.0; 6])
        .unwrap();
    let low_m = -0.0005;
    settings.mpc.axes[2] = AxisLimits {
        jerk_mps3: 16_000.0,
        acceleration_mps2: 36.0,
        velocity_mps: 0.8,
        position_m: [low_m, 0.05],
    };
    for seed in 0..10 {
        let mut rng = Pcg64::seed_from_u64(seed);
        let mut bench = Bench::armed(settings.clone());
        let mut lowest = f64::INFINITY;
        for tick in 0..10_000_u64 {
            let t = bench.now.0 as f64 * 1e-9;
            let mut pen = bench.pen([0.02 * (9.0 * t).sin(), 0.015 * (14.0 * t).cos()]);
            pen.contact = tick / 60 % 2 == 0;
            let output = bench.tick(&[pen]);
            assert_eq!(output.stop_reason, StopReason::None, "{seed}, {tick}: {:?}", output.stop_detail);
            lowest = lowest.min(output.tool[2]);
            if rng.random_bool(0.1) {
                let late = rng.random_range(1e-9_f64..1.0).powf(-0.415).min(15.0);
                bench.now = bench.now + late.floor() as u64 * PERIOD_NS;
            }
        }
        assert!(lowest > low_m - 0.5 * MARGIN_M, "{seed}: {:.2} mm", lowest * 1e3);
    }
}

#[test]
fn every_bound_names_itself() {
    let settings = within(usual());
    let workspace = settings.mpc.axes.map(|axis| axis.position_m);
    let build = |envelope: &EnvelopeSettings| {
        Envelope::<6>::new(envelope, &settings.chain, settings.plane, workspace, 1.0, &settings.limits)
    };
    let inside = EnvelopeFigures { tool: [0.0, 0.0, 0.01], tilt: 0.1, speed: 0.5 };
    assert_eq!(build(&usual()).unwrap().judge(&inside), None);
    for (figures, cause, limit) in [
        (EnvelopeFigures { tool: [0.0, 0.0, -0.052], ..inside }, StopCause::Height, -0.051),
        (EnvelopeFigures { tool: [0.0, 0.0, 0.052], ..inside }, StopCause::Height, 0.051),
        (EnvelopeFigures { tool: [0.0, -0.122, 0.0], ..inside }, StopCause::Workspace, -0.121),
        (EnvelopeFigures { tilt: 0.4, ..inside }, StopCause::Tilt, 0.38),
        (EnvelopeFigures { speed: 1.2, ..inside }, StopCause::ToolSpeed, 1.1),
        (EnvelopeFigures { speed: f64::NAN, ..inside }, StopCause::ToolSpeed, 1.1),
    ] {
        let detail = build(&usual()).unwrap().judge(&figures).unwrap();
        assert_eq!(detail.cause, cause);
        assert!((detail.limit - limit).abs() < 1e-12, "{detail:?}");
    }
    for (margin_m, max_tilt_rad, max_speed_mps) in
        [(0.0, 0.3, None), (f64::NAN, 0.3, None), (0.001, 2.0, None), (0.001, 0.3, Some(0.0))]
    {
        let wrong = EnvelopeSettings { margin_m, max_tilt_rad, max_speed_mps };
        assert!(build(&wrong).is_err());
    }
}

/// A servo does not overshoot: a measured tool may be at most a millimetre and 0.05 rad beyond the bounds of
/// commands.
#[test]
fn a_judge_of_the_measured_tool_allows_a_little_more_than_the_envelope() {
    let bounds = ExtentBounds::of(&within(usual()));
    let good = Extent { height_m: [-0.01, 0.01], outside_m: 0.0, tilt_rad: 0.0 };
    for (beyond, kept) in [(0.9, true), (1.1, false)] {
        let far_m = MARGIN_M + beyond * 1e-3;
        for extent in [
            Extent { height_m: [-0.05 - far_m, 0.01], ..good },
            Extent { height_m: [-0.01, 0.05 + far_m], ..good },
            Extent { outside_m: far_m, ..good },
            Extent { tilt_rad: 0.35 + beyond * 0.05, ..good },
        ] {
            assert_eq!(bounds.broken_by(&extent).is_none(), kept, "{extent:?}");
        }
    }
}
