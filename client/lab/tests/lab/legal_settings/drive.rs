//! One run of the law with one combination of settings.

use foretrace_config::Config;
use foretrace_control::follower::{Budget, Follower, JointReading, NoClock, Request, StepInput};
use foretrace_control::guard::CommandChecker;
use foretrace_control::pen::PenReading;
use foretrace_control::stop::StopReason;
use foretrace_control::units::Stamp;
use foretrace_sim::arm::JOINTS;
use rand::RngExt;
use rand_pcg::Pcg64;

use super::pens;
use super::tip::Tip;

/// How long the pen moves and rests \[s\].
#[derive(Clone, Copy)]
pub(crate) struct Length {
    moves: f64,
    rests: f64,
}

impl Length {
    pub(crate) const SHORT: Self = Self { moves: 0.9, rests: 0.9 };
    pub(crate) const LONG: Self = Self { moves: 2.0, rests: LONGEST_REST_S };
}

const LONGEST_REST_S: f64 = 3.0;

/// The outcome.
#[derive(Debug)]
pub(crate) struct Seen {
    pub(crate) pen: String,
    pub(crate) legal: bool,
    pub(crate) moved: bool,
    pub(crate) latched: Option<StopReason>,
    /// Farthest that commands had the tip beyond the workspace, and beyond where it began \[m\].
    pub(crate) outside: f64,
    /// The same after a stop has latched: the stopping distance.
    pub(crate) outside_stopping: f64,
    pub(crate) height: [f64; 2],
    pub(crate) tilt: f64,
    pub(crate) tilt_begin: f64,
    pub(crate) speed: f64,
    /// The axis along which the tip oscillates while the pen rests, and its range \[m\].
    pub(crate) swing: Option<(char, f64)>,
}

pub(crate) fn live(config: &Config, random: &mut Pcg64, length: Length) -> Seen {
    match config.settings().mpc.horizon {
        10 => live_with::<10>(config, random, length),
        20 => live_with::<20>(config, random, length),
        _ => live_with::<30>(config, random, length),
    }
}

fn live_with<const N: usize>(config: &Config, random: &mut Pcg64, mut length: Length) -> Seen {
    let settings = config.follower_settings();
    let (period_ns, workspace, plane) =
        (settings.period_ns, config.settings().plane.workspace_m, settings.plane);
    let period_s = period_ns as f64 * 1e-9;
    let tip = Tip::new(config);
    let (name, pen) = pens::pen(random, [workspace[0], workspace[1]], length.moves);
    let every = random.random_range(1..6);
    let mut judge = CommandChecker::new(settings.limits);
    let mut follower = Follower::<N, JOINTS>::new(settings).expect("a config was judged by the law");
    let begin = Stamp(10_000_000_000);
    let home = config.robot().home;
    let mut joints = JointReading { stamp: begin, q: home, qd: [0.0; JOINTS], motion_allowed: true };
    let beyond = |at: [f64; 3]| {
        at.iter().zip(&workspace).map(|(at, [low, high])| (at - high).max(low - at)).fold(0.0, f64::max)
    };
    let mut allowed = beyond(tip.at(&home).0);
    let mut seen = Seen {
        pen: name,
        legal: true,
        moved: false,
        latched: None,
        outside: 0.0,
        outside_stopping: 0.0,
        height: [f64::INFINITY, f64::NEG_INFINITY],
        tilt: 0.0,
        tilt_begin: tip.at(&home).1,
        speed: 0.0,
        swing: None,
    };
    let moves = length.moves;
    let ticks = |rests: f64| ((moves + rests) / period_s) as u64;
    let mut end = ticks(length.rests);
    let mut trail = Vec::with_capacity(end as usize);
    let mut before = tip.at(&home).0;
    for tick in 0.. {
        if tick == end {
            seen.swing = swing(&trail, (length.rests / period_s) as usize);
            // A sustained oscillation is still there later; a motion to a far place is not.
            if seen.swing.is_none() || length.rests == LONGEST_REST_S {
                break;
            }
            (length.rests, end) = (LONGEST_REST_S, ticks(LONGEST_REST_S));
        }
        let now = begin + tick * period_ns;
        let t = now.seconds_since(begin);
        joints.stamp = now;
        let sample = pen(t).filter(|_| tick.is_multiple_of(every)).map(|(at, contact)| {
            let [x, y] = at;
            let [ox, oy] = plane.pen_origin;
            PenReading::new(now, [x / plane.pen_scale + ox, y / plane.pen_scale + oy], contact)
        });
        let request = (tick == 1).then_some(Request::Arm);
        let input =
            StepInput { pen: sample.as_slice(), joints: Some(&joints), request, ..StepInput::nothing(now) };
        let output = follower.step(&input, Budget::default(), &mut NoClock);
        if output.stop_reason != StopReason::None {
            seen.latched = Some(output.stop_reason);
        }
        let Some(command) = output.command else { continue };
        if output.begins {
            judge.restart();
        }
        seen.legal &= judge.observe(command.stamp, command.valid_until, &command.q, &command.qd);
        (joints.q, joints.qd) = (command.q, command.qd);
        let (at, tilt) = tip.at(&command.q);
        let out = beyond(at);
        let stopping = seen.latched.is_some();
        let most = if stopping { &mut seen.outside_stopping } else { &mut seen.outside };
        *most = most.max(out - allowed);
        allowed = allowed.min(out);
        seen.height = [seen.height[0].min(at[2]), seen.height[1].max(at[2])];
        if !stopping {
            seen.tilt = seen.tilt.max(tilt);
        }
        let moved = at.iter().zip(before).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt();
        seen.moved |= moved > 1e-6;
        if !stopping {
            seen.speed = seen.speed.max(moved / period_s);
        }
        before = at;
        trail.push(at);
    }
    seen
}

/// The axis along which the last third of the rest is no smaller than the third before, with two turns at
/// least, and by more than 1 mm.
fn swing(trail: &[[f64; 3]], rests: usize) -> Option<(char, f64)> {
    let third = rests / 3;
    let last = trail.get(trail.len().checked_sub(third)?..)?;
    let before = trail.get(trail.len().checked_sub(2 * third)?..trail.len() - third)?;
    let width = |part: &[[f64; 3]], axis: usize| {
        let (low, high) = part.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), at| {
            (low.min(at[axis]), high.max(at[axis]))
        });
        high - low
    };
    ['x', 'y', 'z'].into_iter().enumerate().find_map(|(axis, name)| {
        let (now, then) = (width(last, axis), width(before, axis));
        let mut turns = 0;
        let mut direction = 0.0_f64;
        for pair in last.windows(2) {
            let step = pair[1][axis] - pair[0][axis];
            if step.abs() > 1e-7 && step.signum() != direction {
                turns += 1;
                direction = step.signum();
            }
        }
        (now > 1e-3 && now > 0.7 * then && turns >= 3).then_some((name, now))
    })
}
