//! The shipped law with pens that leave the paper, race and jump: it always has a plan, and lifts when it
//! should.

use foretrace_config::Config;
use foretrace_control::arm::lag::Following;
use foretrace_control::follower::{
    Budget, Follower, FollowerSettings, JointReading, NoClock, Request, Rung, StepInput,
};
use foretrace_control::guard::CommandChecker;
use foretrace_control::pen::PenReading;
use foretrace_control::trust::TrustRequest;
use foretrace_control::units::{Stamp, Trust};
use foretrace_sim::arm::JOINTS;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

/// What a preset's arm did while the pen went along a path.
struct Seen {
    /// How far the commanded tool got beyond its workspace, x, y, z \[m\].
    beyond_m: [f64; 3],
    /// How far it got below the paper, and how far above it stayed from a second after the beginning on, with
    /// the pen down \[m\].
    deepest_m: f64,
    lifted_m: f64,
    /// Largest angle between the tool and the plane's normal \[rad\].
    tilt_rad: f64,
    /// Most steps of the active set in a tick, per axis.
    steps: u32,
    /// Share of the ticks with a plan of their own, and most ticks in a row without.
    fresh: f64,
    without: u32,
}

/// Leads the arm of `settings` along `path` for `seconds`; the pen goes down and up every `strokes` ticks.
fn follow(
    config: &Config,
    settings: FollowerSettings<JOINTS>,
    (seconds, strokes): (f64, u64),
    path: impl Fn(f64) -> [f64; 2],
) -> Seen {
    let (workspace, period_ns) = (config.settings().plane.workspace_m, settings.period_ns);
    let (down, chain) = (settings.plane.tool_axis(), settings.chain.clone());
    let mut judge = CommandChecker::new(settings.limits);
    let mut follower = Follower::<20, JOINTS>::new(settings).unwrap();
    let mut joints = JointReading {
        stamp: Stamp(10_000_000_000),
        q: config.robot().home,
        qd: [0.0; JOINTS],
        motion_allowed: true,
    };
    let mut seen = Seen {
        beyond_m: [f64::NEG_INFINITY; 3],
        deepest_m: f64::NEG_INFINITY,
        lifted_m: f64::NEG_INFINITY,
        tilt_rad: 0.0,
        steps: 0,
        fresh: 0.0,
        without: 0,
    };
    let (mut ticks, mut fresh, mut without) = (0, 0, 0);
    let begin = joints.stamp;
    for tick in 0..(seconds * 1e9) as u64 / period_ns {
        let now = begin + tick * period_ns;
        joints.stamp = now;
        let contact = (tick / strokes).is_multiple_of(2);
        let pen = [PenReading::new(now, path(now.seconds_since(begin)), contact)];
        let request = (tick == 1).then_some(Request::Arm);
        let input = StepInput { pen: &pen, joints: Some(&joints), request, ..StepInput::nothing(now) };
        let output = follower.step(&input, Budget::default(), &mut NoClock);
        let Some(command) = output.command else { continue };
        if output.begins {
            judge.restart();
        }
        assert!(judge.observe(command.stamp, command.valid_until, &command.q, &command.qd), "tick {tick}");
        (joints.q, joints.qd) = (command.q, command.qd);
        for ((most, at), [low, high]) in seen.beyond_m.iter_mut().zip(output.tool).zip(workspace) {
            *most = most.max(at - high).max(low - at);
        }
        let [_, _, height] = output.tool;
        seen.deepest_m = seen.deepest_m.max(-height);
        if contact && now.seconds_since(begin) > 1.0 {
            seen.lifted_m = seen.lifted_m.max(height);
        }
        let cosine = chain.forward(&command.q).rotation.column(2).dot(&down);
        seen.tilt_rad = seen.tilt_rad.max(cosine.clamp(-1.0, 1.0).acos());
        seen.steps = output.axes.iter().map(|axis| axis.iterations).max().unwrap_or(0).max(seen.steps);
        let planned = output.rung == Rung::FreshPlan;
        (ticks, fresh) = (ticks + 1, fresh + u32::from(planned));
        without = if planned { 0 } else { without + 1 };
        seen.without = seen.without.max(without);
    }
    seen.fresh = f64::from(fresh) / f64::from(ticks);
    seen
}

/// A pen that jumps to anywhere within `half` \[m\] of the middle at random times, up to `longest` \[s\]
/// apart.
fn leaps(half: f64, longest: f64, seed: u64) -> impl Fn(f64) -> [f64; 2] {
    let mut random = Pcg64::seed_from_u64(seed);
    let mut until = 0.0;
    let stays: Vec<(f64, [f64; 2])> = (0..1000)
        .map(|_| {
            until += random.random_range(0.01..longest);
            (until, [(); 2].map(|()| random.random_range(-half..half)))
        })
        .collect();
    move |t| stays.iter().find(|(until, _)| t < *until).map_or([0.0; 2], |(_, at)| *at)
}

/// Half a second at each of four places far beyond the corners of the paper.
fn corners(t: f64) -> [f64; 2] {
    [[0.3, 0.3], [-0.3, 0.3], [-0.3, -0.3], [0.3, -0.3]][(t / 0.5) as usize % 4]
}

#[test]
fn pens_that_race_and_leap_never_leave_a_tick_without_a_plan() {
    let circles = |t: f64| [0.2 * (14.0 * t).cos(), 0.2 * (14.0 * t).sin()];
    let sweeps = |t: f64| [0.25 * (9.0 * t).sin(), 0.09 * (2.0 * t).sin()];
    for preset in ["ur5", "ur5e"] {
        let config = Config::preset(preset).unwrap();
        let safety = &config.settings().safety;
        let led =
            |times, path: &dyn Fn(f64) -> [f64; 2]| follow(&config, config.follower_settings(), times, path);
        for (name, beyond, seen) in [
            ("corners", 2e-3, led((6.0, 300), &corners)),
            ("circles", 1e-3, led((6.0, 300), &circles)),
            ("sweeps", 1e-3, led((6.0, 300), &sweeps)),
            // The box is soft.
            ("leaps", 2e-3, led((40.0, 300), &leaps(0.35, 0.5, 2))),
            ("short leaps", 1e-3, led((40.0, 40), &leaps(0.025, 0.2, 1))),
        ] {
            let Seen { beyond_m: [x, y, z], deepest_m, tilt_rad, steps, fresh, .. } = seen;
            println!(
                "{preset}, {name}: x, y, z beyond by {:.2} {:.2} {:.2} mm, {:.2} mm into the paper, tilted \
                 by {tilt_rad:.3} rad; at most \
                 {steps} steps in a tick, {fresh:.5} of the ticks with a plan of their own",
                x * 1e3,
                y * 1e3,
                z * 1e3,
                deepest_m * 1e3
            );
            assert_eq!(fresh, 1.0, "{preset}, {name}");
            assert!(steps <= config.settings().mpc.max_iterations * 3 / 2, "{preset}, {name}: {steps}");
            assert!(x.max(y) < beyond && z < 1e-3, "{preset}, {name}: {x} {y} {z}");
            assert!(deepest_m < 1e-3, "{preset}, {name}: {deepest_m}");
            assert!(tilt_rad < safety.arm_max_tilt_rad, "{preset}, {name}: {tilt_rad} rad");
        }
    }
}

/// The demand is reduced until there is a plan. Otherwise an arm at rest would get the same infeasible demand
/// for ever.
#[test]
fn too_few_steps_make_the_arm_slow_but_never_stand_for_good() {
    let config = Config::preset("ur5").unwrap();
    let circles = |t: f64| [0.12 * (9.0 * t).cos(), 0.09 * (9.0 * t).sin()];
    let (auto, full) = (TrustRequest::Auto, TrustRequest::Manual(Trust::FULL));
    for (steps, effort) in [(3, 10.0), (12, 10.0), (25, 10.0), (100, 1.0), (100, 0.1)] {
        let mut settings = config.follower_settings();
        settings.mpc.max_iterations = steps;
        settings.mpc.effort = effort;
        let most = settings.safety.previous_plan_max_ns / settings.period_ns;
        for (name, trust, most, path) in [
            ("corners", auto, most, &corners as &dyn Fn(f64) -> [f64; 2]),
            ("leaps", auto, most, &leaps(0.35, 0.5, 2)),
            ("circles", auto, most, &circles),
            ("corners, believed", full, most, &corners),
            // Three steps do not brake from full speed: the last plan expires, the arm stops, and starts
            // again.
            ("leaps, believed", full, 2 * most, &leaps(0.35, 0.5, 2)),
            ("circles, believed", full, most, &circles),
        ] {
            settings.trust_request = trust;
            let seen = follow(&config, settings.clone(), (20.0, 300), path);
            println!(
                "{steps} steps, effort {effort}, {name}: {:.4} with a plan, {} in a row without",
                seen.fresh, seen.without
            );
            assert!(u64::from(seen.without) < most, "{steps} steps, {name}: {} in a row", seen.without);
            assert!(seen.fresh > 0.8, "{steps} steps, {name}: {}", seen.fresh);
        }
    }
}

/// Far ahead of the pen is not far from it.
#[test]
fn a_tool_that_leads_the_pen_stays_on_the_paper() {
    let letters = |t: f64| [0.015 * (14.0 * t).sin(), 0.012 * (22.0 * t + 0.4).sin()];
    let wide = |t: f64| [0.13 * (5.5 * t).sin(), 0.02 * (3.0 * t).sin()];
    let config = Config::preset("ur5").unwrap();
    for lead_ms in [30, 120] {
        for (name, path) in [("letters", &letters as &dyn Fn(f64) -> [f64; 2]), ("wide strokes", &wide)] {
            let mut settings = config.follower_settings();
            settings.dead_time_ns = lead_ms * 1_000_000;
            settings.following = Following::Fixed;
            let seen = follow(&config, settings, (12.0, u64::MAX), path);
            println!("{lead_ms} ms ahead, {name}: {:.3} mm above the paper", seen.lifted_m * 1e3);
            assert!(seen.lifted_m < 3e-4, "{lead_ms} ms, {name}: {}", seen.lifted_m);
        }
    }
}
