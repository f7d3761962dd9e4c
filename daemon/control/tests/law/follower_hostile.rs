//! Hostile inputs through the whole step: whatever the input, every command is legal and continuous. The
//! judge is `CommandChecker` (inside `support::Bench`), which shares no code with the guard.

use crate::support::{Bench, PERIOD_NS, settings};
use foretrace_control::contact::{EffortReading, EffortUnit};
use foretrace_control::follower::{Budget, EnableReading, JointReading, Mode, Request, StepInput};
use foretrace_control::pen::PenReading;
use foretrace_control::predict::bands::BAND_LEADS;
use foretrace_control::predict::{ExternalPreview, OnlineWeights, PredictorKind};
use foretrace_control::units::Stamp;
use rand::{Rng, RngExt, SeedableRng};
use rand_pcg::Pcg64;

const POISON: [f64; 9] =
    [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e300, -1e300, 1e-310, 0.0, f64::MAX, f64::MIN_POSITIVE];

/// Mostly plausible handwriting; sometimes non-finite numbers, jumps, repeats, backward or far stamps.
fn pen(rng: &mut Pcg64, now: Stamp, t: f64, spite: f64) -> PenReading {
    let mut reading = PenReading {
        stamp: Stamp(now.0 - rng.random_range(0..4_000_000)),
        position: [0.015 * (11.0 * t).sin(), 0.012 * (17.0 * t).cos()],
        contact: rng.random_bool(0.9),
        ..PenReading::default()
    };
    if rng.random_bool(spite) {
        match rng.random_range(0..7) {
            0 => reading.position[0] = POISON[rng.random_range(0..POISON.len())],
            1 => reading.position[1] = POISON[rng.random_range(0..POISON.len())],
            2 => reading.position = [rng.random_range(-0.5..0.5), rng.random_range(-0.5..0.5)],
            3 => reading.stamp = Stamp(now.0.saturating_sub(rng.random_range(0..10_000_000_000))),
            4 => reading.stamp = Stamp(now.0 + rng.random_range(0..10_000_000_000)),
            5 => reading.stamp = Stamp(rng.next_u64()),
            _ => reading.position = [rng.random_range(-1e6..1e6); 2],
        }
    }
    reading
}

fn poisoned_joints(rng: &mut Pcg64, good: JointReading<6>) -> JointReading<6> {
    let mut bad = good;
    match rng.random_range(0..5) {
        0 => bad.q[rng.random_range(0..6)] = POISON[rng.random_range(0..POISON.len())],
        1 => bad.qd[rng.random_range(0..6)] = POISON[rng.random_range(0..POISON.len())],
        2 => bad.stamp = Stamp(rng.next_u64()),
        _ => bad.motion_allowed = false,
    }
    bad
}

/// Breaks one model's parameters, or the bands, under a new version.
fn sabotaged(rng: &mut Pcg64, weights: &mut OnlineWeights, value: f64) {
    weights.version += 1;
    match rng.random_range(0..5) {
        0 => {
            weights.dybm.version = weights.version;
            weights.dybm.parameters.fifo[0][rng.random_range(0..2)][rng.random_range(0..2)] = value;
        }
        1 => {
            weights.dybm_esn.dybm.version = weights.version;
            weights.dybm_esn.readout[rng.random_range(0..50)][rng.random_range(0..2)] = value;
        }
        2 => {
            weights.ar_rls.version = weights.version;
            weights.ar_rls.coefficients[rng.random_range(0..8)][rng.random_range(0..2)]
                [rng.random_range(0..2)] = value;
        }
        3 => {
            weights.mixture.version = weights.version;
            weights.mixture.ar.coefficients[rng.random_range(0..8)][rng.random_range(0..2)][1] = value;
        }
        _ => {
            weights.bands.factors[rng.random_range(0..PredictorKind::ALL.len())]
                [rng.random_range(0..BAND_LEADS)] = value as f32
        }
    }
}

fn request(rng: &mut Pcg64) -> Request {
    match rng.random_range(0..9) {
        0 => Request::Stop,
        5 => Request::FreezeTrust,
        1 => Request::Disarm,
        2 => Request::SetTrust(if rng.random_bool(0.5) { rng.random() } else { f64::NAN }),
        3 => Request::TrustAuto,
        4 => Request::SwitchPredictor(PredictorKind::ALL[rng.random_range(0..PredictorKind::ALL.len())]),
        _ => Request::Arm,
    }
}

/// Efforts of no arm: from a seed of their own, so that the rest of a run keeps its dice.
fn poisoned_effort(seed: u64, tick: u32, now: Stamp) -> EffortReading<6> {
    let mut rng = Pcg64::seed_from_u64(seed ^ u64::from(tick).wrapping_mul(0x9e37_79b9_7f4a_7c15));
    let units = [EffortUnit::NewtonMetres, EffortUnit::Amperes, EffortUnit::Share];
    let mut effort = [0.0; 6].map(|_: f64| rng.random_range(-20.0..20.0));
    if rng.random_bool(0.02) {
        effort[rng.random_range(0..6)] = POISON[rng.random_range(0..POISON.len())];
    }
    let unit = units[if rng.random_bool(0.001) { rng.random_range(0..3) } else { seed as usize % 3 }];
    EffortReading { stamp: now, effort, unit }
}

/// What another process may send after the pen stood `at` at grid step `newest`; from a seed of its own too.
fn poisoned_preview(seed: u64, tick: u32, newest: u64, at: [f64; 2]) -> Option<ExternalPreview> {
    let mut rng = Pcg64::seed_from_u64(!seed ^ u64::from(tick).wrapping_mul(0x9e37_79b9_7f4a_7c15));
    let mut preview = ExternalPreview {
        base_index: newest.wrapping_sub(rng.random_range(0..4)),
        count: 64,
        radii_count: if rng.random_bool(0.5) { 64 } else { 0 },
        ..ExternalPreview::EMPTY
    };
    let way = [1e-4, 1e-3, 0.02][rng.random_range(0..3)];
    let mut walk = at;
    for (position, radius) in preview.positions.iter_mut().zip(&mut preview.radii) {
        walk = walk.map(|x| x + rng.random_range(-way..way));
        (*position, *radius) = (walk, rng.random_range(0.0..0.01));
    }
    if rng.random_bool(0.2) {
        let poison = POISON[rng.random_range(0..POISON.len())];
        match rng.random_range(0..6) {
            0 => preview.positions[rng.random_range(0..64)][1] = poison,
            1 => preview.radii[rng.random_range(0..64)] = poison,
            2 => preview.count = rng.random_range(0..70),
            3 => preview.radii_count = rng.random_range(0..70),
            4 => (preview.count, preview.radii_count) = (usize::MAX, usize::MAX),
            _ => preview.base_index = rng.next_u64(),
        }
    }
    rng.random_bool(0.3).then_some(preview)
}

/// One run of a follower, in front of a servo that its plan models unless `servo_ns` is 0; returns how many
/// commands moved, and how many previews of another process were taken.
fn live(seed: u64, ticks: u32, spite: f64, servo_ns: u64) -> (u32, u32) {
    let mut rng = Pcg64::seed_from_u64(seed);
    let kind = PredictorKind::LIVE[seed as usize % PredictorKind::LIVE.len()];
    let mut settings = settings(kind);
    settings.dead_time_ns = rng.random_range(0..80_000_000);
    settings.mpc.servo_s = servo_ns as f64 * 1e-9;
    settings.velocity_lead_ns = [0, 100_000_000][seed as usize % 2];
    settings.safety.enable_required = rng.random_bool(0.1);
    let mut bench = Bench::new(settings);
    let start = bench.now;
    let (mut moving, mut newest, mut taken) = (0, (0, [0.0; 2]), 0_u32);
    for tick in 0..ticks {
        let t = bench.now.seconds_since(start);
        let flood = if rng.random_bool(0.01 * spite) { 64 } else { usize::from(rng.random_bool(0.4)) };
        let samples: Vec<_> = (0..flood).map(|_| pen(&mut rng, bench.now, t, spite)).collect();
        bench.joints.stamp = bench.now;
        let good = bench.joints;
        let joints = if rng.random_bool(0.02 * spite) { poisoned_joints(&mut rng, good) } else { good };
        let mut weights = bench.follower.weights();
        let sabotage = rng.random_bool(0.02 * spite);
        if sabotage {
            let value = if rng.random_bool(0.5) {
                POISON[rng.random_range(0..POISON.len())]
            } else {
                rng.random_range(-99.0..99.0)
            };
            sabotaged(&mut rng, &mut weights, value);
        }
        let effort = poisoned_effort(seed, tick, bench.now);
        let preview = poisoned_preview(seed, tick, newest.0, newest.1);
        let restless = bench.last.is_none() || rng.random_bool(0.02 * spite);
        let input = StepInput {
            pen: &samples,
            joints: (!rng.random_bool(0.05 * spite)).then_some(&joints),
            effort: Some(&effort),
            enable: rng
                .random_bool(0.5)
                .then(|| EnableReading { stamp: bench.now, stop: rng.random_bool(0.001) }),
            request: if tick == 0 {
                Some(Request::Arm)
            } else {
                (restless && rng.random_bool(0.2)).then(|| request(&mut rng))
            },
            weights: sabotage.then_some(&weights),
            preview: preview.as_ref(),
            ..StepInput::nothing(bench.now)
        };
        let budget = Budget {
            max_iterations: if rng.random_bool(0.1 * spite) { rng.random_range(0..3) } else { 100 },
            shed: rng.random_bool(0.05 * spite),
        };
        // Dice of its own, so that the rest of a run keeps its.
        let dice = seed.wrapping_mul(0x9e37_79b9).wrapping_add(u64::from(tick) * 0x2545_f491);
        let withheld = dice.is_multiple_of(97);
        let output = if withheld { bench.withhold(&input, budget) } else { bench.step(&input, budget) };
        moving += u32::from(output.command.is_some_and(|command| command.qd.iter().any(|qd| *qd != 0.0)));
        newest = output
            .learn
            .iter()
            .take(output.learn_count)
            .map(|step| (step.index, step.position))
            .fold(newest, |_, step| step);
        if let Some(external) = output.external {
            taken += u32::from(external.verdict == Some(Ok(())));
            assert!((0.0..=1.0).contains(&external.weight) && external.evidence.is_finite(), "{external:?}");
        }
        let named = output.tool.iter().chain(&output.reference).all(|x| x.is_finite());
        assert!(output.predictor_band.is_none_or(|band| band >= 0.0 && band.is_finite()));
        assert!(named && output.trust.alpha.alpha().is_finite(), "seed {seed}, tick {tick}: {output:?}");
        assert!(
            output.command.is_some() || output.mode == Mode::Idle,
            "seed {seed}, tick {tick}: no command in charge"
        );
        if rng.random_bool(0.01 * spite) {
            // Time lost, time standing still, or time running backwards.
            bench.now = match rng.random_range(0..4) {
                0 => Stamp(bench.now.0 - 2 * PERIOD_NS),
                1 => Stamp(bench.now.0 - PERIOD_NS),
                2 => bench.now + rng.random_range(1..50_000_000),
                _ => bench.now + rng.random_range(1..400_000_000),
            };
        }
    }
    (moving, taken)
}

fn lives(seeds: std::ops::Range<u64>, servo_ns: u64) {
    let (mut ticks, mut moving, mut taken) = (0, 0, 0);
    for seed in seeds {
        let spite = [0.05, 0.3, 1.0][(seed % 3) as usize];
        let (moved, took) = live(seed, 600, spite, servo_ns);
        (moving, taken, ticks) = (moving + moved, taken + took, ticks + 600);
    }
    println!("{moving} of {ticks} commands moved, {taken} previews of another process were taken");
    assert!(taken > 100, "{taken} previews were taken");
    assert!(moving > ticks / 4, "a test in which the arm stands still proves nothing: {moving} of {ticks}");
}

#[test]
fn every_command_is_legal_whatever_comes_in() {
    lives(0..400, 0);
}

#[test]
fn every_command_is_legal_where_a_servo_is_made_up_for() {
    lives(400..600, 30_000_000);
}

#[test]
fn a_scribble_of_pure_noise_is_survived() {
    for seed in 0..60 {
        let mut rng = Pcg64::seed_from_u64(1000 + seed);
        let kind = PredictorKind::LIVE[seed as usize % PredictorKind::LIVE.len()];
        let mut bench = Bench::armed(settings(kind));
        for _ in 0..800 {
            let noise = [rng.random_range(-0.2..0.2), rng.random_range(-0.2..0.2)];
            let pen = [PenReading::new(bench.now, noise, rng.random_bool(0.5))];
            bench.tick(&pen);
        }
    }
}

#[test]
fn a_step_of_the_pen_across_the_workspace_stays_inside_the_workspace() {
    let mut bench = Bench::armed(settings(PredictorKind::CONSTANT_VELOCITY));
    let corners = [[0.1, 0.1], [-0.1, 0.1], [-0.1, -0.1], [0.1, -0.1]];
    let mut beyond = 0.0f64;
    for tick in 0..3000u64 {
        let pen = [bench.pen(corners[(tick / 250 % 4) as usize])];
        let output = bench.tick_with(&pen, None, Budget::default());
        beyond = beyond.max(output.tool[0].abs() - 0.12).max(output.tool[1].abs() - 0.12);
    }
    println!("farthest beyond the workspace: {beyond} m");
    // The box is soft (the plan must never be infeasible) and the horizon shorter than a stop from full
    // speed.
    assert!(beyond < 2e-3, "left the workspace by {beyond} m");
}
