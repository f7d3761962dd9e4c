//! Keep-outs through the whole step: with hostile pens, spent budgets, stops and lost time the commanded arm
//! never comes nearer than stated, and an arm that begins inside moves out. `support::Bench` checks every
//! command's legality and continuity.

use crate::support::{Bench, HOME, PERIOD_NS, settings};
use foretrace_control::arm::{Chain, JointMotion};
use foretrace_control::clearance::{Clearance, ClearanceSettings, Obstacle};
use foretrace_control::follower::{
    Budget, FollowerSettings, Health, Mode, Refusal, Request, Rung, StepOutput,
};
use foretrace_control::guard::{Commanded, consumer_state};
use foretrace_control::pen::PenReading;
use foretrace_control::predict::PredictorKind;
use nalgebra::Vector3;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

const MARGIN_M: f64 = 0.01;
/// Share of the margin that commands may use in any case \[m\].
const STATED_M: f64 = 1e-3;
/// Share of it that a consumer without commands may use while it brakes every joint independently \[m\].
const CONSUMER_M: f64 = 5e-3;
const SEEDS: u64 = 2;

fn keeping(itself: bool, obstacles: Vec<Obstacle>) -> ClearanceSettings {
    ClearanceSettings { margin_m: MARGIN_M, itself, obstacles }
}

fn judge(settings: &FollowerSettings<6>, keep: &ClearanceSettings) -> Clearance<6> {
    let period_s = PERIOD_NS as f64 * 1e-9;
    Clearance::new(&settings.chain, &settings.limits, period_s, keep).unwrap()
}

/// A plane with `normal` whose distance from the arm at home is `distance` \[m\].
fn plane_at(settings: &FollowerSettings<6>, normal: [f64; 3], distance: f64) -> Obstacle {
    let far = (Vector3::from(normal) * -5.0).into();
    let judge = judge(settings, &keeping(false, vec![Obstacle::plane(far, normal).unwrap()]));
    let here = judge.nearest(&settings.chain.forward(&HOME)).unwrap().distance_m;
    Obstacle::plane((Vector3::from(far) + Vector3::from(normal) * (here - distance)).into(), normal).unwrap()
}

/// A box of `size` beyond the tool at home in `direction`, whose distance from the arm is `distance` \[m\].
fn box_at(settings: &FollowerSettings<6>, direction: [f64; 3], size: [f64; 3], distance: f64) -> Obstacle {
    let home = settings.chain.forward(&HOME);
    let put = |far: f64| {
        let centre = home.position + Vector3::from(direction).normalize() * far;
        Obstacle::cuboid(centre.into(), size, [0.0; 3]).unwrap()
    };
    let away = |far: f64| judge(settings, &keeping(false, vec![put(far)])).nearest(&home).unwrap().distance_m;
    let (mut near, mut far) = (0.0, 1.0);
    assert!(away(near) < distance && away(far) > distance);
    for _ in 0..60 {
        let middle = 0.5 * (near + far);
        if away(middle) < distance { near = middle } else { far = middle }
    }
    put(far)
}

/// Table, two walls and a box in reach of the pen, and the arm itself.
fn crowded() -> (FollowerSettings<6>, ClearanceSettings) {
    let mut settings = settings(PredictorKind::CONSTANT_VELOCITY);
    let [x, y] = [Vector3::x(), -Vector3::y()].map(|axis| settings.plane.rotation * axis);
    let keep = keeping(
        true,
        vec![
            box_at(&settings, [0.0, 0.0, -1.0], [0.3, 0.3, 0.1], 0.03),
            plane_at(&settings, x.into(), 0.05),
            plane_at(&settings, y.into(), 0.06),
            box_at(&settings, (x * 0.3 + y).into(), [0.1, 0.1, 0.2], 0.1),
        ],
    );
    settings.clearance = Some(keep.clone());
    settings.plane.lift_height = 0.04;
    (settings, keep)
}

fn distance(judge: &Clearance<6>, chain: &Chain<6>, q: &[f64; 6]) -> f64 {
    judge.nearest(&chain.forward(q)).unwrap().distance_m
}

/// The smallest distance along the motion of a consumer that receives nothing after `output`'s command.
fn on_its_own(judge: &Clearance<6>, settings: &FollowerSettings<6>, output: &StepOutput<6>) -> f64 {
    let Some(command) = output.command else { return f64::INFINITY };
    let motion = JointMotion { q: command.q, qd: command.qd, qdd: [0.0; 6] };
    let last = Commanded::new(command.stamp, motion).unwrap();
    let decel = settings.limits.deceleration();
    let states =
        (0..40u64).map(|i| consumer_state(&last, command.valid_until, decel, command.stamp + i * 5_000_000));
    states.map(|motion| distance(judge, &settings.chain, &motion.q)).fold(f64::INFINITY, f64::min)
}

/// Results of a run among obstacles.
#[derive(Debug)]
struct Life {
    /// Smallest distance of a command \[m\], except on the way out of where a consumer got to in lost time.
    smallest: f64,
    /// Smallest distance of a consumer, real or assumed without commands after each command \[m\].
    alone: f64,
    /// Farthest outside the workspace \[m\].
    outside: f64,
    /// Ticks by rung.
    rungs: [u32; 4],
    /// Ticks held back, of which stops.
    held: u32,
    stops_bent: u32,
    /// Ticks after lost time.
    lost: u32,
    /// The guard's reasons to alter commands, all together.
    altered: u32,
    /// Armings refused because the tool was outside or tilted.
    led_home: u32,
}

/// Strokes and jumps all over the workspace and beyond it, spent and shed budgets, stops, releases, and time
/// lost.
fn hostile_life(seed: u64, ticks: u32) -> Life {
    let (settings, keep) = crowded();
    let judge = judge(&settings, &keep);
    assert!(distance(&judge, &settings.chain, &HOME) > MARGIN_M);
    let mut bench = Bench::armed(settings.clone());
    let mut rng = Pcg64::seed_from_u64(seed);
    let mut life = Life {
        smallest: f64::INFINITY,
        alone: f64::INFINITY,
        outside: 0.0,
        rungs: [0; 4],
        held: 0,
        stops_bent: 0,
        lost: 0,
        altered: 0,
        led_home: 0,
    };
    let (mut centre, mut size, mut speed) = ([0.0; 2], 0.02, 11.0);
    let (mut trouble, mut mode, mut left_alone) = (0u32, Mode::Armed, false);
    for tick in 0..ticks {
        if tick % 200 == 0 {
            centre = [0, 1].map(|_| rng.random_range(-0.14..0.14));
            (size, speed) = ([0.0, 0.02, 0.1][rng.random_range(0..3)], rng.random_range(3.0..25.0));
        }
        if rng.random_bool(0.002) {
            trouble = rng.random_range(1..60);
        }
        trouble = trouble.saturating_sub(1);
        let t = f64::from(tick) * 2e-3;
        let [x, y] = centre;
        let mut pen = bench.pen([x + size * (speed * t).sin(), y + size * (1.3 * speed * t).cos()]);
        pen.contact = rng.random_bool(0.95);
        if rng.random_bool(0.003) {
            pen.position = [0, 1].map(|_| rng.random_range(-0.5..0.5));
        }
        let samples: Vec<PenReading> = rng.random_bool(0.6).then_some(pen).into_iter().collect();
        let request = match mode {
            Mode::Idle => Some(Request::Arm),
            Mode::Stopped | Mode::Fault if rng.random_bool(0.1) => Some(Request::Arm),
            _ => rng
                .random_bool(0.001)
                .then(|| if rng.random_bool(0.5) { Request::Stop } else { Request::Disarm }),
        };
        let budget = Budget {
            max_iterations: if trouble % 3 == 1 { 0 } else { 100 },
            shed: trouble % 3 == 2 || trouble > 30,
        };
        let output = bench.tick_with(&samples, request, budget);
        mode = output.mode;
        if let Some(Err(Refusal::ToolNotAligned | Refusal::ToolOutsideWorkspace)) = output.answer {
            // An operator moves the arm back by hand.
            bench.joints.q = HOME;
            life.led_home += 1;
        }
        let held = output.health.has(Health::CLEARANCE);
        life.rungs[output.rung as usize] += 1;
        life.altered |= output.guard_altered;
        life.held += u32::from(held);
        life.stops_bent += u32::from(held && output.rung == Rung::Stop);
        life.lost += u32::from(output.health.has(Health::TIME_LOST));
        let now = distance(&judge, &settings.chain, &bench.joints.q);
        left_alone = (left_alone || output.health.has(Health::TIME_LOST)) && now < MARGIN_M;
        if left_alone {
            life.alone = life.alone.min(now);
        } else {
            life.smallest = life.smallest.min(now);
        }
        if output.command.is_some() {
            let tool = output.tool.iter().zip(settings.mpc.axes.map(|axis| axis.position_m));
            life.outside = tool.fold(life.outside, |most, (x, [low, high])| most.max(x - high).max(low - x));
        }
        if tick % 16 == 0 || output.rung == Rung::Stop {
            life.alone = life.alone.min(on_its_own(&judge, &settings, &output));
        }
        if rng.random_bool(0.0005) {
            bench.now = bench.now + rng.random_range(1..60) * PERIOD_NS;
        }
    }
    life
}

#[test]
fn no_hostile_life_brings_commands_nearer_than_stated() {
    for seed in 1..=SEEDS {
        let life = hostile_life(seed, 120_000);
        println!("{seed}: {life:?}");
        assert!(life.smallest > MARGIN_M - STATED_M, "{seed}: {life:?}");
        assert!(life.alone > MARGIN_M - CONSUMER_M, "{seed}: {life:?}");
        assert_eq!(life.altered, 0, "the guard found nothing to alter");
        // Sliding along an obstacle neither ends the motion nor leads far outside, unlike joints that stop
        // independently.
        assert!(life.outside < 0.12, "{seed}: {life:?}");
        let [fresh, .., resting] = life.rungs;
        assert!(fresh > 60_000 && resting < 20_000, "{seed}: {life:?}");
        assert!(life.held > 10_000 && life.stops_bent > 10 && life.lost > 20, "{seed}: {life:?}");
    }
}

/// Armed inside a table, a wall or a box, and commanded deeper: it moves out, never deeper, and reports why
/// it moves.
#[test]
fn an_arm_that_begins_inside_comes_out() {
    for depth in [0.0, 0.004, 0.03] {
        let directions = [[0.0, 0.0, -1.0], [1.0, 0.2, 0.0], [-0.3, 1.0, 0.3], [0.0, -1.0, -0.5]];
        for (case, direction) in directions.into_iter().enumerate() {
            let mut settings = settings(PredictorKind::CONSTANT_VELOCITY);
            let keep = keeping(true, vec![box_at(&settings, direction, [0.2; 3], -depth)]);
            settings.clearance = Some(keep.clone());
            let judge = judge(&settings, &keep);
            let mut bench = Bench::armed(settings.clone());
            let into = settings.plane.rotation.inverse() * Vector3::from(direction);
            let (mut deepest, mut out) = (-depth, None);
            for tick in 0..2_500 {
                let pen = bench.pen([0.03 * into.x, 0.03 * into.y]);
                let output = bench.tick(&[pen]);
                let now = distance(&judge, &settings.chain, &bench.joints.q);
                assert!(now > deepest.min(MARGIN_M) - 1e-6, "{case}, {tick}: {now} after {deepest}");
                let outward = now > deepest;
                deepest = deepest.max(now);
                let inside = now < MARGIN_M - 1e-4;
                assert!(!inside || outward || output.health.has(Health::CLEARANCE), "{case}, {tick}");
                if out.is_none() && !inside {
                    out = Some(tick);
                }
            }
            let out = out.unwrap_or_else(|| panic!("{case}: still {deepest} m after 5 s"));
            // RETREAT_MPS, and the time to get there.
            assert!(f64::from(out) * 2e-3 < (depth + MARGIN_M) / 0.05 + 1.0, "{case}: {out} ticks");
        }
    }
}

/// An arm that stops inside stays where it is: rows of a stop demand no retreat.
#[test]
fn an_arm_that_is_to_stand_inside_stands() {
    let mut settings = settings(PredictorKind::CONSTANT_VELOCITY);
    settings.clearance = Some(keeping(true, vec![box_at(&settings, [0.0, 0.0, -1.0], [0.2; 3], -0.01)]));
    let mut bench = Bench::armed(settings);
    for _ in 0..500 {
        let output = bench.tick(&[]);
        assert_eq!(output.command.unwrap().q, HOME);
    }
}

/// Keep-outs that the arm does not approach change no bit of any command.
#[test]
fn keep_outs_out_of_reach_change_no_bit() {
    let plain = settings(PredictorKind::CONSTANT_VELOCITY);
    let mut keeping_clear = plain.clone();
    keeping_clear.clearance = Some(keeping(
        true,
        vec![
            plane_at(&plain, [0.0, 0.0, 1.0], 0.25),
            plane_at(&plain, [1.0, 0.0, 0.0], 0.4),
            Obstacle::cuboid([0.0, 0.9, 0.3], [0.2; 3], [0.3, 0.2, 0.1]).unwrap(),
        ],
    ));
    let (mut without, mut with) = (Bench::armed(plain), Bench::armed(keeping_clear));
    let mut rng = Pcg64::seed_from_u64(3);
    let (mut position, mut request) = ([0.0; 2], None);
    for tick in 0..30_000 {
        if rng.random_bool(0.004) {
            position = [0, 1].map(|_| rng.random_range(-0.08..0.08));
        }
        let t = f64::from(tick) * 2e-3;
        let drawn = [position[0] + 0.02 * (11.0 * t).sin(), position[1] + 0.02 * (17.0 * t).cos()];
        let budget = Budget { shed: rng.random_bool(0.02), ..Budget::default() };
        let [a, b] = [&mut without, &mut with].map(|bench| {
            let pen = bench.pen(drawn);
            bench.tick_with(&[pen], request, budget)
        });
        assert_eq!(a.command, b.command, "{tick}");
        assert_eq!((a.health, a.setpoint, a.reference), (b.health, b.setpoint, b.reference), "{tick}");
        request = match a.mode {
            Mode::Stopped => Some(Request::Arm),
            _ => rng.random_bool(0.001).then_some(Request::Stop),
        };
        if rng.random_bool(0.0005) {
            let lost = rng.random_range(1..20) * PERIOD_NS;
            (without.now, with.now) = (without.now + lost, with.now + lost);
        }
    }
}
