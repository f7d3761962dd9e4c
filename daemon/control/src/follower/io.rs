//! What one tick sees and what it answers: plain data, no references kept.

pub use super::request::{Refusal, Request};
use crate::arm::lag::LagEstimate;
use crate::contact::EffortReading;
use crate::ik::IkReport;
use crate::mpc::AxisReport;
use crate::pen::{PenCounters, PenOrigin, PenReading, PenRefusal};
use crate::predict::{ExternalPreview, ExternalReport, LearnStep, OnlineWeights, PredictorKind};
use crate::state::{choices, state};
use crate::stop::{StopDetail, StopReason};
use crate::trust::TrustReport;
use crate::units::{AxisState, Stamp};

/// Most grid steps that one tick may close; the rest stay queued for the next tick.
pub const MAX_STEPS_PER_TICK: usize = 8;

/// Measured state of the arm, already validated by the receiver.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JointReading<const J: usize> {
    /// When it was measured, on the host's monotonic clock.
    pub stamp: Stamp,
    /// Joint positions \[rad\].
    pub q: [f64; J],
    /// Joint velocities \[rad/s\].
    pub qd: [f64; J],
    /// The arm's own safety system allows motion (normal or reduced mode, drives on).
    pub motion_allowed: bool,
}

state! { whole [const J: usize] JointReading<J> { stamp, q, qd, motion_allowed } }

/// One message of the dead-man switch.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct EnableReading {
    /// When the operator's program sent it.
    pub stamp: Stamp,
    /// The operator let go.
    pub stop: bool,
}

state! { whole [] EnableReading { stamp, stop } }

/// What the control law does at present.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Mode {
    /// Not in charge of the arm; no command leaves.
    #[default]
    Idle,
    /// In charge, standing still, waiting for the pen.
    Armed,
    /// Following the pen, as it is trusted.
    Following,
    /// The pen is silent: at rest at its last position.
    Holding,
    /// Stopped (or stopping) and latched until armed again.
    Stopped,
    /// Like `Stopped`, because the arm reported a safety stop.
    Fault,
    /// Moving the arm home, or about to.
    Homing,
}

choices! { Mode { Idle, Armed, Following, Holding, Stopped, Fault, Homing } }

/// Which fallback made the command.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Rung {
    /// Solved in this tick.
    #[default]
    FreshPlan,
    /// An earlier plan, evaluated at the true elapsed time.
    PreviousPlan,
    /// Jerk-limited stop in joint space.
    Stop,
    /// Standing still: the same joints again.
    Hold,
}

/// What degraded in a tick; one bit each.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Health(pub u32);

impl Health {
    /// The newest pen sample is older than allowed.
    pub const PEN_STALE: u32 = 1;
    /// A pen sample was rejected.
    pub const PEN_REJECTED: u32 = 1 << 1;
    /// The pen jumped: history begins again.
    pub const PEN_JUMP: u32 = 1 << 2;
    /// The predictor's output was not finite or had to be bounded.
    pub const PREDICTOR_INVALID: u32 = 1 << 3;
    /// Weights of the learner were refused.
    pub const WEIGHTS_REFUSED: u32 = 1 << 4;
    /// The MPC had no certified solution.
    pub const MPC_FAILED: u32 = 1 << 5;
    /// The IK had no certified solution.
    pub const IK_FAILED: u32 = 1 << 6;
    /// The IK could not reach the tool velocity that was asked for.
    pub const IK_LIMITED: u32 = 1 << 7;
    /// The guard changed the command.
    pub const GUARD_ALTERED: u32 = 1 << 8;
    /// The commanded state was re-synchronised.
    pub const RESYNCHRONISED: u32 = 1 << 9;
    /// The shell asked to shed the solve.
    pub const SHED: u32 = 1 << 10;
    /// Joint states are older than allowed.
    pub const JOINTS_STALE: u32 = 1 << 11;
    /// The dead-man switch is missing.
    pub const ENABLE_MISSING: u32 = 1 << 12;
    /// Periods were lost before this tick.
    pub const TIME_LOST: u32 = 1 << 13;
    /// A joint state was refused: non-finite, older than the last, or stamped in the future.
    pub const JOINTS_REJECTED: u32 = 1 << 15;
    /// Clearance rows or the tool's envelope held the arm back.
    pub const CLEARANCE: u32 = 1 << 16;
    /// A stop left its path, joint by joint: there was no time to solve, or no certified solution.
    pub const PATH_LOST: u32 = 1 << 17;
    /// Used something below the fresh plan on the ladder.
    pub const FALLBACK: u32 = 1 << 14;

    pub(crate) fn set(&mut self, bit: u32) {
        self.0 |= bit;
    }

    /// `bit` is set.
    #[must_use]
    pub const fn has(self, bit: u32) -> bool {
        self.0 & bit != 0
    }
}

/// What a step may spend, decided by the shell from its own clock before the call.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Budget {
    /// Iteration cap for each QP.
    pub max_iterations: u32,
    /// Skip the solve and use the fallback.
    pub shed: bool,
}

impl Default for Budget {
    fn default() -> Self {
        Self { max_iterations: 100, shed: false }
    }
}

/// The parts of a step whose cost is reported separately.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stage {
    /// Requests, joint states, pen samples onto the grid.
    Pen,
    /// Prediction, estimate and trust.
    Predict,
    /// Reference and plan of this tick.
    Mpc,
    /// Inverse kinematics, with all its rows.
    Ik,
    /// Guard and record keeping.
    Guard,
}

/// Receives the end of every stage, so that the shell can time stages although the law has no clock.
pub trait StageClock {
    /// `stage` has just ended.
    fn lap(&mut self, stage: Stage);
}

/// A stage clock that ignores all stages.
#[derive(Debug, Clone, Copy, Default)]
pub struct NoClock;

impl StageClock for NoClock {
    fn lap(&mut self, _stage: Stage) {}
}

/// Everything one tick sees.
#[derive(Debug, Clone, Copy)]
pub struct StepInput<'a, const J: usize> {
    /// Nominal release time of the tick.
    pub now: Stamp,
    /// Pen samples received since the last tick, oldest first.
    pub pen: &'a [PenReading],
    /// Newest joint state, if one arrived since the last tick.
    pub joints: Option<&'a JointReading<J>>,
    /// Efforts of that joint state, where the arm reports any.
    pub effort: Option<&'a EffortReading<J>>,
    /// Newest dead-man message, if one arrived since the last tick.
    pub enable: Option<EnableReading>,
    /// At most one request a tick.
    pub request: Option<Request>,
    /// A stop that the shell demands, latched first of all: [`StopReason::Requested`] by a path that needs no
    /// request, [`StopReason::Overruns`] with its evidence.
    pub halt: Option<(StopReason, StopDetail)>,
    /// Weights promoted by the learner since the last tick.
    pub weights: Option<&'a OnlineWeights>,
    /// The newest preview of another process that arrived since the last tick.
    pub preview: Option<&'a ExternalPreview>,
    /// The command of the last step was not sent, or too late to be valid: consumers have the one before.
    pub unsent: bool,
}

impl<const J: usize> StepInput<'_, J> {
    /// A tick in which nothing arrived.
    #[must_use]
    pub const fn nothing(now: Stamp) -> Self {
        Self {
            now,
            pen: &[],
            joints: None,
            effort: None,
            enable: None,
            request: None,
            halt: None,
            weights: None,
            preview: None,
            unsent: false,
        }
    }
}

/// A command that may leave: finite, inside every limit, continuous with the last one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JointCommand<const J: usize> {
    /// The instant for which `q` holds (the end of this tick's period).
    pub stamp: Stamp,
    /// Consumers follow q + q̇·(t − stamp) until here, then brake by themselves.
    pub valid_until: Stamp,
    /// Joint positions \[rad\].
    pub q: [f64; J],
    /// Mean joint velocities over the period that ends at `stamp` \[rad/s\].
    pub qd: [f64; J],
    /// The arm may move with this command (false once a latched stop has come to rest).
    pub enabled: bool,
}

/// How far the way home is.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct HomeProgress {
    /// The way was found clear, and the motion has begun.
    pub moving: bool,
    /// Fraction of the way done, 0 to 1.
    pub share: f64,
    /// How long the rest takes with nothing near \[s\].
    pub left_s: f64,
}

/// Everything one tick decided.
#[derive(Debug, Clone, Copy)]
pub struct StepOutput<const J: usize> {
    /// The command; `None` only while the loop is not in charge of the arm (Idle).
    pub command: Option<JointCommand<J>>,
    /// The command is the first since arming: it begins where the arm stands, not where the last stream of
    /// commands ended.
    pub begins: bool,
    /// Mode after the step.
    pub mode: Mode,
    /// Why it is stopped, if it is.
    pub stop_reason: StopReason,
    /// The evidence behind the newest latched stop.
    pub stop_detail: StopDetail,
    /// Fraction of the requested speed at which the arm moves, in (0, 1]; `None`: unknown.
    pub arm_speed_share: Option<f64>,
    /// Answer to the request, if there was one.
    pub answer: Option<Result<(), Refusal>>,
    /// While the arm is moved home, how far it is.
    pub home: Option<HomeProgress>,
    /// Result of checking the way home: clear, or why not. Comes ticks after the request was accepted.
    pub way: Option<Result<(), Refusal>>,
    /// Which fallback made the command.
    pub rung: Rung,
    /// What degraded in this tick, as bits.
    pub health: Health,
    /// Trust used, where it is heading, and why.
    pub trust: TrustReport,
    /// Predictor that made the preview.
    pub predictor: PredictorKind,
    /// What became of another process's previews, if they are asked for.
    pub external: Option<ExternalReport>,
    /// Steps after the newest closed one that the plan looks at: a preview has to have as many.
    pub preview_steps: usize,
    /// Version of the weights in use (0: those it started with).
    pub weights_version: u64,
    /// κ, the share of the way to the preview that the arm is asked to go \[1\]; below 1 it is saturated in
    /// vain.
    pub governor: f64,
    /// Stamp of the newest accepted pen sample.
    pub pen_stamp: Option<Stamp>,
    /// Where that sample comes from; with its stamp, its identity.
    pub pen_origin: PenOrigin,
    /// Newest accepted pen position in the plane frame \[m\].
    pub pen_position: [f64; 2],
    /// The newest accepted pen sample touches the paper.
    pub pen_contact: bool,
    /// Counts of pen samples so far.
    pub pen_counters: PenCounters,
    /// The newest pen sample refused, with the evidence.
    pub pen_refused: Option<PenRefusal>,
    /// Error of the one-step prediction of the newest closed grid step \[m\]; `None` when no step closed.
    pub predictor_error: Option<f64>,
    /// Radius about the plan's first reference, before any velocity lead, in which the pen is expected in
    /// nine of ten cases \[m\]; `None` while too little has been observed, or too far ahead.
    pub predictor_band: Option<f64>,
    /// Dead time τ that the references looked ahead by \[ns\].
    pub dead_time_ns: u64,
    /// Measured lag of the arm; `None` while unknown.
    pub lag: Option<LagEstimate>,
    /// First reference of the plan in the plane frame \[m\].
    pub reference: [f64; 3],
    /// The previewed path that the plan followed.
    pub path: PreviewPath,
    /// Setpoint of this tick in the plane frame.
    pub setpoint: [AxisState; 3],
    /// Where the published joints put the tool, plane frame \[m\].
    pub tool: [f64; 3],
    /// How each axis was solved.
    pub axes: [AxisReport; 3],
    /// How the joints were solved.
    pub ik: IkReport,
    /// Bits of what the guard changed; 0: nothing.
    pub guard_altered: u32,
    /// Grid steps closed in this tick, for the learner; only the first `learn_count` count.
    pub learn: [LearnStep; MAX_STEPS_PER_TICK],
    /// See `learn`.
    pub learn_count: usize,
}

/// Points of a [`PreviewPath`] at most.
pub const PATH_POINTS: usize = 10;

/// The path of the pen that a plan was to follow as far as it trusted it, from soon to late, in the plane
/// frame \[m\]: its references in even strides, with the last one. No points: there was no preview, or no
/// plan.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct PreviewPath {
    points: [[f32; 2]; PATH_POINTS],
    count: usize,
}

impl PreviewPath {
    /// That of the references `xs` and `ys`.
    pub(crate) fn of<const N: usize>(xs: &[AxisState; N], ys: &[AxisState; N]) -> Self {
        let count = N.min(PATH_POINTS);
        let mut path = Self { count, ..Self::default() };
        for (number, point) in path.points.iter_mut().enumerate().take(count) {
            let index = ((number + 1) * N / count).saturating_sub(1);
            if let (Some(x), Some(y)) = (xs.get(index), ys.get(index)) {
                *point = [x.position as f32, y.position as f32];
            }
        }
        path
    }

    /// Its points, from soon to late.
    #[must_use]
    pub fn points(&self) -> &[[f32; 2]] {
        self.points.get(..self.count).unwrap_or_default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_word_of_health_is_a_bit_of_its_own() {
        let bits = [
            Health::PEN_STALE,
            Health::PEN_REJECTED,
            Health::PEN_JUMP,
            Health::PREDICTOR_INVALID,
            Health::WEIGHTS_REFUSED,
            Health::MPC_FAILED,
            Health::IK_FAILED,
            Health::IK_LIMITED,
            Health::GUARD_ALTERED,
            Health::RESYNCHRONISED,
            Health::SHED,
            Health::JOINTS_STALE,
            Health::ENABLE_MISSING,
            Health::TIME_LOST,
            Health::JOINTS_REJECTED,
            Health::CLEARANCE,
            Health::FALLBACK,
            Health::PATH_LOST,
        ];
        assert_eq!(bits.iter().fold(0, |all, bit| all | bit), (1 << bits.len()) - 1);
        assert!(bits.iter().all(|bit| bit.count_ones() == 1));
    }

    #[test]
    fn a_path_has_the_last_reference_and_even_strides_whatever_the_horizon() {
        fn path<const N: usize>() -> Vec<f32> {
            let at = |side: f64| std::array::from_fn(|i| AxisState::at_rest(side * (i + 1) as f64));
            let (xs, ys): ([AxisState; N], [AxisState; N]) = (at(1.0), at(-1.0));
            let path = PreviewPath::of(&xs, &ys);
            assert!(path.points().iter().all(|[x, y]| *y == -x));
            path.points().iter().map(|[x, _]| *x).collect()
        }
        let strides = |stride: u8| (1..=10).map(|i| f32::from(i * stride)).collect::<Vec<f32>>();
        assert_eq!([path::<10>(), path::<20>(), path::<30>()], [strides(1), strides(2), strides(3)]);
        assert_eq!((path::<3>(), path::<0>()), (vec![1.0, 2.0, 3.0], Vec::new()));
        assert!(PreviewPath::default().points().is_empty());
    }
}
