//! Off-line estimate of an arm's lag, from the commands sent and the joint states received while it moved.
//!
//! Contract: pure. The lag is the time by which the measured motion trails the instant that a command is
//! stamped for. Two models are fitted to all joints that move, by least squares:
//!
//! 1. a pure delay: q(t) = c(t − d) + o, the shift of the commanded path c with the smallest residual;
//! 2. a delay and a servo: a critically damped second order of group delay L (servoj's look-ahead) behind the
//!    delay d, and a first-order joint loop τ if the motion identifies it. The lag at low frequency is
//!    d + L + τ.
//!
//! A filter delays fast motion less than slow motion, so the shift of model 1 is at most the lag of model 2.
//! Absent: clock drift between command and state stamps (one clock is assumed), limits, friction, gains other
//! than 1.

mod response;
mod fit;

use crate::arm::JOINTS;
use fit::{LagProblem, SHIFTS_S, ServoFit};
use response::CommandGrid;

/// Joints that were commanded or measured at an instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample {
    /// The command's stamp (the instant it is for), or when the state was measured \[s\], one clock.
    pub t_s: f64,
    /// \[rad\]
    pub q: [f64; JOINTS],
}

/// A delay and its residual.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Shift {
    /// \[s\]
    pub delay_s: f64,
    /// RMS over all moving joints \[rad\].
    pub rms_rad: f64,
}

/// A delay with a servo behind it, and the residual.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Servo {
    /// Pure delay d \[s\].
    pub delay_s: f64,
    /// Group delay L of the critically damped second order \[s\].
    pub filter_s: f64,
    /// Time constant τ of the first order \[s\]; 0 if the motion does not identify it.
    pub joint_loop_s: f64,
    /// RMS over all moving joints \[rad\].
    pub rms_rad: f64,
}

impl Servo {
    /// From a command's instant to its motion at low frequency \[s\]: d + L + τ.
    #[must_use]
    pub fn lag_s(&self) -> f64 {
        self.delay_s + self.filter_s + self.joint_loop_s
    }
}

/// How a figure varies over blocks of the motion \[s\].
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Spread {
    /// One figure per block, in order of time.
    pub blocks_s: Vec<f64>,
    pub median_s: f64,
    /// Upper minus lower quartile.
    pub interquartile_s: f64,
}

/// The model that the figures support.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum LagModel {
    /// The arm repeats its commands later; a filter explains hardly more.
    PureDelay,
    /// The arm filters its commands.
    Servo,
}

#[derive(Debug, Clone, PartialEq)]
pub struct Identified {
    /// Model 1.
    pub shift: Shift,
    /// Model 2.
    pub servo: Servo,
    pub verdict: LagModel,
    /// Model 1, block by block.
    pub shift_spread: Spread,
    /// The lag of model 2 (its filter fixed, its delay refitted), block by block.
    pub lag_spread: Spread,
    /// Joints that moved enough to count, the one that moved most first.
    pub joints: Vec<usize>,
    /// How far each joint was commanded, peak to peak \[rad\].
    pub moved_rad: [f64; JOINTS],
    /// (shift \[s\], RMS of its residual \[rad\]).
    pub curve: Vec<(f64, f64)>,
    /// From the first to the last instant that counted \[s\], on the samples' clock.
    pub window_s: (f64, f64),
}

/// Why there is no figure.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum LagError {
    /// Too little came.
    #[error(
        "{commands} commands and {states} joint states during the motion are too few, {MIN_SAMPLES} of each \
         are needed; see that the arm reports its joints and that the loop is armed"
    )]
    TooFew { commands: usize, states: usize },
    /// The loop stood still.
    #[error(
        "the commands moved no joint by more than {:.2} mrad, {} mrad are needed; see that the loop follows \
         the pen (armed, no stop latched), or make the motion larger",
        largest_rad * 1e3,
        MIN_MOTION_RAD * 1e3
    )]
    NotCommanded {
        /// Largest travel of a joint.
        largest_rad: f64,
    },
    /// The arm stood still.
    #[error(
        "the arm moved by {:.2} mrad where it was commanded by {:.2} mrad; see that it takes commands \
         (brakes released, not stopped, speed slider up, the right arm)",
        measured_rad * 1e3,
        commanded_rad * 1e3
    )]
    NotMoved {
        /// Travel of the joint that was to move most.
        commanded_rad: f64,
        measured_rad: f64,
    },
    /// No lag explains the motion.
    #[error(
        "the arm moves, but not as commanded: at the best shift ({:.1} ms) {:.0} % of the motion remain \
         unexplained; see that its speed is not scaled down and that it is the arm that the settings \
         describe",
        shift_s * 1e3,
        remaining * 1e2
    )]
    NotFollowed {
        shift_s: f64,
        /// RMS that remains over RMS of the motion.
        remaining: f64,
    },
    /// A hole in the record.
    #[error("{what} are missing for {:.0} ms in the middle of the motion; the machine is too busy: try \
             again", gap_s * 1e3)]
    Gap {
        /// Commands or joint states.
        what: &'static str,
        gap_s: f64,
    },
}

/// Samples that are needed at least, of each kind.
const MIN_SAMPLES: usize = 50;
/// Travel of a joint that counts as motion \[rad\].
const MIN_MOTION_RAD: f64 = 1e-3;
/// Joints that travel less than this share of the largest travel are left out.
const MIN_SHARE: f64 = 0.1;
/// Longest hole that is bridged by a straight line \[s\].
const MAX_GAP_S: f64 = 0.06;
/// Share of the motion that may remain unexplained.
const MAX_REMAINING: f64 = 0.35;
/// Blocks for the spread.
const BLOCKS: usize = 10;
/// A filter counts only where it is longer than this \[s\].
const MIN_FILTER_S: f64 = 0.003;
/// A filter counts only where it reduces a shift's residual by this factor.
const MIN_BETTER: f64 = 1.02;
/// A filter counts only where that residual was more than this share of the motion: interpolation between
/// slow cycles is a filter too, but a negligible one.
const MIN_MATTER: f64 = 0.005;
/// Factor by which a joint loop must reduce the residual to be included.
const MIN_LOOP_BETTER: f64 = 1.25;

/// Finds the lag. Samples whose times do not rise are left out.
///
/// # Errors
///
/// [`LagError`], each with what to do.
pub fn identify(commands: &[Sample], states: &[Sample]) -> Result<Identified, LagError> {
    let (commands, states) = (rising(commands), rising(states));
    let too_few = || LagError::TooFew { commands: commands.len(), states: states.len() };
    if commands.len() < MIN_SAMPLES || states.len() < MIN_SAMPLES {
        return Err(too_few());
    }
    let moved_rad = travel(&commands);
    let joints = moving(&moved_rad)?;
    let (from_s, to_s) = moving_time(&commands, &joints);
    let window_s = (from_s, (to_s + SHIFTS_S.1).min(commands.last().map_or(to_s, |last| last.t_s)));
    let within = |sample: &&Sample| (window_s.0..=window_s.1).contains(&sample.t_s);
    let inside: Vec<Sample> = states.iter().filter(within).copied().collect();
    if inside.len() < MIN_SAMPLES {
        return Err(LagError::TooFew { commands: commands.len(), states: inside.len() });
    }
    no_gap("commands", commands.iter().filter(within))?;
    no_gap("joint states", inside.iter())?;
    let most = joints[0];
    let measured_rad = travel(&inside)[most];
    if measured_rad < (0.1 * moved_rad[most]).max(0.5 * MIN_MOTION_RAD) {
        return Err(LagError::NotMoved { commanded_rad: moved_rad[most], measured_rad });
    }

    let problem =
        LagProblem { path: CommandGrid::commanded(&commands, &joints), states: &inside, joints: &joints };
    let curve = problem.curve();
    let shift = problem.shift(&curve);
    let motion_rad = motion_rms(&inside, &joints);
    let servo = problem.filter(shift.p[0]);
    let with_loop = problem.joint_loop(servo);
    let servo = if with_loop.rms * MIN_LOOP_BETTER < servo.rms { with_loop } else { servo };
    let remaining = servo.rms.min(shift.rms) / motion_rad;
    if !(remaining <= MAX_REMAINING) {
        return Err(LagError::NotFollowed { shift_s: shift.p[0], remaining });
    }
    let [delay_s, filter_s, joint_loop_s] = servo.p;
    let matter = (shift.rms.powi(2) - servo.rms.powi(2)).max(0.0).sqrt() / motion_rad;
    let is_servo = filter_s + joint_loop_s >= MIN_FILTER_S
        && servo.rms * MIN_BETTER <= shift.rms
        && matter >= MIN_MATTER;
    Ok(Identified {
        shift: Shift { delay_s: shift.p[0], rms_rad: shift.rms },
        servo: Servo { delay_s, filter_s, joint_loop_s, rms_rad: servo.rms },
        verdict: if is_servo { LagModel::Servo } else { LagModel::PureDelay },
        shift_spread: spread(&problem, shift, window_s),
        lag_spread: spread(&problem, servo, window_s),
        joints: joints.clone(),
        moved_rad,
        curve,
        window_s,
    })
}

/// The motion that a model expects of `joint` at `t_s`, for pictures; `delay_s` alone is a pure delay.
#[must_use]
pub fn modelled(commands: &[Sample], joint: usize, servo: &Servo, times_s: &[f64]) -> Vec<f64> {
    let path =
        CommandGrid::commanded(&rising(commands), &[joint]).filtered(servo.filter_s, servo.joint_loop_s);
    times_s.iter().map(|t_s| path.at(joint, t_s - servo.delay_s)).collect()
}

/// Refits the delay in each of [`BLOCKS`] blocks of equal length; blocks without motion are left out.
fn spread(problem: &LagProblem<'_>, fit: ServoFit, window_s: (f64, f64)) -> Spread {
    let [_, filter_s, loop_s] = fit.p;
    let length_s = (window_s.1 - window_s.0) / BLOCKS as f64;
    let path = problem.path.filtered(filter_s, loop_s);
    let whole_rad = motion_rms(problem.states, problem.joints);
    let mut blocks_s = Vec::new();
    for block in 0..BLOCKS {
        let begin_s = window_s.0 + block as f64 * length_s;
        let first = problem.states.partition_point(|state| state.t_s < begin_s);
        let last = problem.states.partition_point(|state| state.t_s < begin_s + length_s);
        let states = &problem.states[first..last];
        // A block at rest gives no lag.
        if states.len() < 5 || motion_rms(states, problem.joints) < 0.2 * whole_rad {
            continue;
        }
        let part = LagProblem { path: path.clone(), states, joints: problem.joints };
        blocks_s.push(part.refined([fit.p[0], 0.0, 0.0], &[0]).p[0] + filter_s + loop_s);
    }
    let mut sorted = blocks_s.clone();
    sorted.sort_by(f64::total_cmp);
    let quartile = |part: f64| quantile(&sorted, part);
    Spread { median_s: quartile(0.5), interquartile_s: quartile(0.75) - quartile(0.25), blocks_s }
}

/// Linear between the order statistics; 0 for none.
fn quantile(sorted: &[f64], part: f64) -> f64 {
    let rank = part * sorted.len().saturating_sub(1) as f64;
    let at = |index: usize| sorted.get(index).or(sorted.last()).copied().unwrap_or_default();
    let (low, high) = (at(rank.floor() as usize), at(rank.ceil() as usize));
    low + rank.fract() * (high - low)
}

fn rising(samples: &[Sample]) -> Vec<Sample> {
    let mut newest = f64::NEG_INFINITY;
    let mut kept = samples.to_vec();
    kept.retain(|sample| {
        let keeps = sample.t_s > newest && sample.t_s.is_finite() && sample.q.iter().all(|q| q.is_finite());
        newest = if keeps { sample.t_s } else { newest };
        keeps
    });
    kept
}

fn travel(samples: &[Sample]) -> [f64; JOINTS] {
    std::array::from_fn(|joint| {
        let q = || samples.iter().map(|sample| sample.q[joint]);
        q().fold(f64::NEG_INFINITY, f64::max) - q().fold(f64::INFINITY, f64::min)
    })
}

/// Joints that count, the one that moves most first; never empty.
fn moving(moved_rad: &[f64; JOINTS]) -> Result<Vec<usize>, LagError> {
    let largest_rad = moved_rad.iter().copied().fold(0.0, f64::max);
    if !(largest_rad >= MIN_MOTION_RAD) {
        return Err(LagError::NotCommanded { largest_rad });
    }
    let mut joints: Vec<usize> =
        (0..JOINTS).filter(|joint| moved_rad[*joint] >= MIN_SHARE * largest_rad).collect();
    joints.sort_by(|a, b| moved_rad[*b].total_cmp(&moved_rad[*a]));
    Ok(joints)
}

/// First and last instant at which a joint was commanded to move at a twentieth of the top speed or more
/// \[s\].
fn moving_time(commands: &[Sample], joints: &[usize]) -> (f64, f64) {
    let speed = |pair: &[Sample]| {
        let dt = pair[1].t_s - pair[0].t_s;
        joints.iter().map(|joint| ((pair[1].q[*joint] - pair[0].q[*joint]) / dt).abs()).fold(0.0, f64::max)
    };
    let top = commands.windows(2).map(speed).fold(0.0, f64::max);
    let mut moving = commands.windows(2).filter(|pair| speed(pair) >= 0.05 * top).map(|pair| pair[1].t_s);
    let first = moving.next().unwrap_or_default();
    (first, moving.next_back().unwrap_or(first))
}

fn no_gap<'a>(what: &'static str, samples: impl Iterator<Item = &'a Sample>) -> Result<(), LagError> {
    let mut before: Option<f64> = None;
    let mut gap_s = 0.0_f64;
    for sample in samples {
        gap_s = gap_s.max(before.map_or(0.0, |before| sample.t_s - before));
        before = Some(sample.t_s);
    }
    if gap_s > MAX_GAP_S { Err(LagError::Gap { what, gap_s }) } else { Ok(()) }
}

/// RMS of the joints about their means \[rad\].
fn motion_rms(states: &[Sample], joints: &[usize]) -> f64 {
    let count = states.len().max(1) as f64;
    let variance = |joint: &usize| {
        let mean = states.iter().map(|state| state.q[*joint]).sum::<f64>() / count;
        states.iter().map(|state| (state.q[*joint] - mean).powi(2)).sum::<f64>() / count
    };
    (joints.iter().map(variance).sum::<f64>() / joints.len().max(1) as f64).sqrt()
}

#[cfg(test)]
mod tests;
