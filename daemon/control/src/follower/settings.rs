//! What the control law must know before it starts, and checks that the parts fit together.

use std::fmt;

use thiserror::Error;

use crate::arm::lag::Following;
use crate::arm::limits::LONGEST_EASE_S;
use crate::arm::{Chain, JointLimits, Payload};
use crate::clearance::{ClearanceError, ClearanceSettings};
use crate::contact::ContactSettings;
use crate::envelope::{EnvelopeError, EnvelopeSettings};
use crate::estimate::LawParameters;
use crate::estimate::refine::{PriorError, RefinePrior};
use crate::ik::{BackendError, IkSettings};
use crate::monitor::{LONGEST_LAG_NS, TrackingSettings};
use crate::mpc::{AxisLimits, MpcError, MpcSettings};
use crate::pen::{PenError, PenSettings};
use crate::plane::Plane;
use crate::predict::bands::BAND_LEADS;
use crate::predict::{MAX_PREVIEW, Models, OnlineWeights, PreviewError, PreviewSettings};
use crate::qp::backend::Backend;
use crate::trust::{TrustError, TrustRequest, TrustSettings};

/// Safety bounds of the loop.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SafetySettings {
    /// Periods for which a consumer may follow a command after its stamp.
    pub valid_periods: u32,
    /// A process that stood still for longer than this latches a stop \[ns\].
    pub latch_after_ns: u64,
    /// Joint states older than this stop the arm \[ns\].
    pub joint_state_timeout_ns: u64,
    /// A dead-man switch silent for longer than this stops the arm \[ns\].
    pub enable_timeout_ns: u64,
    /// Arming needs the dead-man switch. Once it was seen while armed, it is honoured in any case.
    pub enable_required: bool,
    /// A pen silent for longer than this turns Following into Holding \[ns\].
    pub hold_after_ns: u64,
    /// Fastest joint with which arming is allowed \[rad/s\].
    pub arm_max_speed: f64,
    /// Farthest the tool may stand outside the workspace when arming \[m\].
    pub arm_workspace_margin: f64,
    /// Largest angle between tool axis and plane normal when arming \[rad\].
    pub arm_max_tilt: f64,
    /// Longest use of an earlier plan before the stop begins \[ns\].
    pub previous_plan_max_ns: u64,
    /// The tool stays lifted after arming until it is this close to the pen \[m\]; five times as far away,
    /// and 50 mm, it lifts again.
    pub approach_distance: f64,
    /// How far the arm may be from where it was commanded to be.
    pub tracking: TrackingSettings,
    /// When efforts that the arm reports mean that it touches something.
    pub contact: ContactSettings,
    /// How far the tool may move whatever the plan is. Not used for a plan without limits.
    pub envelope: EnvelopeSettings,
}

/// Everything the follower is built from.
#[derive(Debug, Clone)]
pub struct FollowerSettings<const J: usize> {
    /// What the arm carries beyond the links of its description, for the torques that it needs.
    pub payload: Payload,
    /// Control period dt \[ns\].
    pub period_ns: u64,
    /// Pen samples to grid. Its step Δ is the grid of prediction and plan; a multiple of `period_ns`.
    pub pen: PenSettings,
    /// Predictor at start, bound of its rollout, normaliser.
    pub preview: PreviewSettings,
    /// What the predictors are made of.
    pub models: Models,
    /// Weights at start of those that learn online.
    pub weights: OnlineWeights,
    /// Corrections of the preview for a new hand.
    pub prior: RefinePrior,
    /// The numbers of the law between prediction and plan.
    pub law: LawParameters,
    /// When to trust the preview.
    pub trust: TrustSettings,
    /// Who decides the trust at start.
    pub trust_request: TrustRequest,
    /// Gains, limits and solver of the plan.
    pub mpc: MpcSettings,
    /// Where the paper is.
    pub plane: Plane,
    /// Links and joints of the arm.
    pub chain: Chain<J>,
    /// Limits that every command obeys.
    pub limits: JointLimits<J>,
    /// Weights of the inverse kinematics.
    pub ik: IkSettings<J>,
    /// Solver of the inverse kinematics.
    pub ik_backend: Backend,
    /// What the arm keeps away from; `None`: nothing, not even itself.
    pub clearance: Option<ClearanceSettings>,
    /// Time from command to arm motion, τ, at start \[ns\]. The plan models the part of it that is the arm's
    /// servo (`mpc.servo_s`); the rest is pure delay.
    pub dead_time_ns: u64,
    /// Whether τ follows the measured lag of the arm afterwards.
    pub following: Following,
    /// Bounds of time and motion.
    pub safety: SafetySettings,
    /// How much farther ahead than the dead time references lie \[ns\]: the plan's own response time.
    pub response_ns: u64,
    /// The references are advanced by this much of the predicted velocity \[ns\]: removes the lag that hands
    /// which are hard to predict would leave.
    pub velocity_lead_ns: u64,
}

/// How far the loop looks ahead in a tick.
#[derive(Debug, Clone, Copy)]
pub(super) struct Lookahead {
    /// Dead time τ of the arm \[ns\].
    pub(super) dead_time_ns: u64,
    /// From now to the plan's first reference, without its velocity lead \[ns\].
    pub(super) ahead_ns: u64,
    /// The nearest lead that a plan uses, as far as there are error bands \[steps\].
    pub(super) nearest_lead: usize,
    /// The last one, while the pen's newest sample is younger than a step.
    pub(super) last_lead: usize,
    /// Steps to roll out.
    pub(super) steps: usize,
}

/// Why a follower could not be built.
#[derive(Debug, Error, PartialEq)]
pub enum FollowerError {
    /// Δ is not a multiple of dt.
    #[error(
        "grid step {step_ns} ns is not a multiple of the control period {period_ns} ns; choose a rate whose \
         period divides the step"
    )]
    StepNotMultiple {
        /// Δ \[ns\]
        step_ns: u64,
        /// dt \[ns\]
        period_ns: u64,
    },
    /// dt out of range.
    #[error("control period {period_ns} ns is outside 500000 to 20000000 ns (2000 to 50 Hz)")]
    Period {
        /// dt \[ns\]
        period_ns: u64,
    },
    /// Dead time plus pen age need a longer preview than there is room for.
    #[error(
        "dead time {dead_time_ns} ns needs a preview of {needed} steps, but at most {available} are kept; \
         shorten dead time or horizon"
    )]
    PreviewTooLong {
        /// τ \[ns\]
        dead_time_ns: u64,
        /// Grid steps that the preview needs.
        needed: usize,
        /// Grid steps that a preview has at most.
        available: usize,
    },
    /// A number of the plane or of the safety bounds is outside its range.
    #[error("{name} = {value} {unit} is outside {low} to {high} {unit}")]
    Number {
        /// Name of the number, as in the message.
        name: &'static str,
        /// The refused value, as it was given.
        value: f64,
        /// Smallest value that is legal, itself included.
        low: f64,
        /// Largest value that is legal, itself included.
        high: f64,
        /// Unit of all three.
        unit: &'static str,
    },
    /// Parts of the loop were given different grid steps.
    #[error("{part} has a grid step of {got_ns} ns, the pen grid {grid_ns} ns; they must be the same")]
    StepMismatch {
        /// Name of the part, as in the message.
        part: &'static str,
        /// Its step \[ns\]
        got_ns: u64,
        /// Step of the grid \[ns\]
        grid_ns: u64,
    },
    /// The tool oscillates about its target without end.
    #[error(
        "with saturated limits the tool does not come to rest: along axis {axis} it oscillates by \
         {swing_m:.4} m about a pen that rests; {would}"
    )]
    NoRest {
        /// Axis 0 = x, 1 = y, 2 = z.
        axis: usize,
        /// Amplitude \[m\].
        swing_m: f64,
        /// A setting that would come to rest.
        would: RestRemedy,
    },
    /// With so little jerk a joint that brakes hard reverses before it rests.
    #[error(
        "joint {joint}: with a jerk limit of {jerk} rad/s³ it takes longer than 50 ms to go from full \
         speeding up to full braking, so a stop would make the joint reverse twice; {needed} rad/s³ would \
         do, or less acceleration"
    )]
    JointJerk {
        /// Joint index from 0, base first.
        joint: usize,
        /// As given \[rad/s³\].
        jerk: f64,
        /// The least that is enough \[rad/s³\].
        needed: f64,
    },
    /// With so little jerk a plan does not foresee its stops.
    #[error(
        "{whose} leave the plan a jerk of {jerk_mps3:.3} m/s³ along axis {axis}: with it stops take longer \
         than the plan looks ahead, so the tool would oscillate about the pen; {needed_mps3:.0} m/s³ would \
         do, or a longer horizon"
    )]
    LittleJerk {
        /// `the plan's limits` or `the joints' jerk limits`.
        whose: &'static str,
        /// Axis 0 = x, 1 = y, 2 = z.
        axis: usize,
        /// As given \[m/s³\].
        jerk_mps3: f64,
        /// The least that is enough \[m/s³\].
        needed_mps3: f64,
    },
    /// The pen grid.
    #[error(transparent)]
    Pen(#[from] PenError),
    /// The plan.
    #[error(transparent)]
    Mpc(#[from] MpcError),
    /// The inverse kinematics.
    #[error(transparent)]
    Ik(#[from] BackendError),
    /// What to keep away from.
    #[error(transparent)]
    Clearance(#[from] ClearanceError),
    /// The tool's envelope.
    #[error(transparent)]
    Envelope(#[from] EnvelopeError),
    /// Where refinement starts.
    #[error(transparent)]
    Prior(#[from] PriorError),
    /// The predictor.
    #[error(transparent)]
    Preview(#[from] PreviewError),
    /// Trust.
    #[error(transparent)]
    Trust(#[from] TrustError),
}

/// A change of one setting with which the arm comes to rest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum RestRemedy {
    /// The plan's velocity limit along the axis \[m/s\].
    Velocity(f64),
    /// The plan's acceleration limit along the axis \[m/s²\].
    Acceleration(f64),
    /// The gain on position, of feedback; feedforward in proportion.
    PositionGain(f64),
    /// The cap of the solver's steps.
    Steps(u32),
    /// None of those tried.
    Nothing,
}

impl fmt::Display for RestRemedy {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Velocity(mps) => write!(f, "a velocity limit of {mps} m/s there would do"),
            Self::Acceleration(mps2) => write!(f, "an acceleration limit of {mps2} m/s² there would do"),
            Self::PositionGain(gain) => write!(f, "a feedback gain on position of {gain} would do"),
            Self::Steps(steps) => write!(f, "{steps} steps of the solver would do"),
            Self::Nothing => f.write_str("raise the gains on velocity, or look farther ahead"),
        }
    }
}

impl<const J: usize> FollowerSettings<J> {
    /// Validity of a command past its stamp \[ns\].
    #[must_use]
    pub fn valid_ns(&self) -> u64 {
        u64::from(self.safety.valid_periods).saturating_mul(self.period_ns)
    }

    /// The limits with which plans of `N` steps are made, x, y and z: as set, or lower where the joints do
    /// not give them or stops from them exceed the horizon.
    #[must_use]
    pub fn plan_limits<const N: usize>(&self) -> [AxisLimits; 3] {
        super::motion::paced::<N, J>(self).limits()
    }

    /// The longest lag of the arm that is not an error \[ns\].
    #[must_use]
    pub fn longest_lag_ns(&self) -> u64 {
        match self.following {
            Following::Fixed => self.dead_time_ns.max(LONGEST_LAG_NS),
            Following::Measured { max_ns, .. } => self.dead_time_ns.max(max_ns),
        }
    }

    /// Group delay of the arm's servo, where it is known to be a filter \[ns\].
    #[must_use]
    pub fn servo_ns(&self) -> u64 {
        (self.mpc.servo_s.max(0.0) * 1e9).round() as u64
    }

    /// Steps to roll out for a horizon of `horizon`: N + ⌈(τ + age_max)/Δ⌉ + 1 (control law, section 1).
    ///
    /// τ is the longest that it may become; age_max is the age at which the pen counts as stale, plus one
    /// open step.
    ///
    /// # Errors
    ///
    /// Settings that do not fit together.
    pub fn preview_steps(&self, horizon: usize) -> Result<usize, FollowerError> {
        self.check()?;
        let dead_time_ns = self.following.longest_ns(self.dead_time_ns);
        let needed = self.steps_for(horizon, dead_time_ns);
        if needed > MAX_PREVIEW {
            return Err(FollowerError::PreviewTooLong { dead_time_ns, needed, available: MAX_PREVIEW });
        }
        Ok(needed)
    }

    /// How far the loop looks ahead with a dead time of `dead_time_ns`.
    pub(super) fn lookahead(&self, horizon: usize, dead_time_ns: u64) -> Lookahead {
        // The plan models the servo's part of the dead time, and has a response of its own.
        let ahead_ns = dead_time_ns.saturating_sub(self.servo_ns()).saturating_add(self.response_ns);
        Lookahead {
            dead_time_ns,
            ahead_ns,
            nearest_lead: ((ahead_ns / self.pen.step_ns) as usize + 1).min(BAND_LEADS),
            last_lead: self.steps_in(ahead_ns.saturating_add(self.plan_ns(horizon))).saturating_add(1),
            steps: self.steps_for(horizon, dead_time_ns),
        }
    }

    /// The same for the current dead time, so that a short one costs no more than it must.
    fn steps_for(&self, horizon: usize, dead_time_ns: u64) -> usize {
        let ahead_ns = dead_time_ns
            .saturating_add(self.response_ns)
            .saturating_add(self.trust.stale_after_ns)
            .saturating_add(self.pen.step_ns)
            .saturating_add(self.plan_ns(horizon));
        self.steps_in(ahead_ns).saturating_add(1)
    }

    fn plan_ns(&self, horizon: usize) -> u64 {
        (self.mpc.step_s * 1e9 * horizon as f64) as u64
    }

    /// Grid steps that cover `ns`.
    fn steps_in(&self, ns: u64) -> usize {
        usize::try_from(ns.div_ceil(self.pen.step_ns)).unwrap_or(usize::MAX)
    }

    fn check(&self) -> Result<(), FollowerError> {
        let Self { period_ns, .. } = *self;
        let step_ns = self.pen.step_ns;
        if !(500_000..=20_000_000).contains(&period_ns) {
            return Err(FollowerError::Period { period_ns });
        }
        if step_ns == 0 || !step_ns.is_multiple_of(period_ns) {
            return Err(FollowerError::StepNotMultiple { step_ns, period_ns });
        }
        self.prior.validate()?;
        let parts = [("preview", self.preview.step_ns), ("trust", self.trust.step_ns)];
        if let Some((part, got_ns)) = parts.into_iter().find(|(_, ns)| *ns != step_ns) {
            return Err(FollowerError::StepMismatch { part, got_ns, grid_ns: step_ns });
        }
        let SafetySettings {
            valid_periods,
            arm_max_speed,
            arm_workspace_margin,
            arm_max_tilt,
            approach_distance,
            ..
        } = self.safety;
        let [pen_x, pen_y] = self.plane.pen_origin;
        let [x, y, z] = self.plane.origin.into();
        let numbers = [
            ("command validity", f64::from(valid_periods), 1.0, 50.0, "periods"),
            ("arming speed", arm_max_speed, 0.0, 1.0, "rad/s"),
            ("arming workspace margin", arm_workspace_margin, 0.0, 1.0, "m"),
            ("arming tilt", arm_max_tilt, 0.0, 1.6, "rad"),
            ("approach distance", approach_distance, 1e-4, 1.0, "m"),
            ("pen scale", self.plane.pen_scale, 1e-3, 1e3, "m/m"),
            ("pen origin x", pen_x, -1e3, 1e3, "m"),
            ("pen origin y", pen_y, -1e3, 1e3, "m"),
            ("lift height", self.plane.lift_height, 0.0, 1.0, "m"),
            ("pressing depth", self.plane.press_depth, 0.0, 0.05, "m"),
            ("plane origin x", x, -10.0, 10.0, "m"),
            ("plane origin y", y, -10.0, 10.0, "m"),
            ("plane origin z", z, -10.0, 10.0, "m"),
        ];
        let mut numbers =
            numbers.into_iter().chain(self.safety.tracking.numbers()).chain(self.safety.contact.numbers());
        match numbers.find(|(_, value, low, high, _)| !(low..=high).contains(&value)) {
            Some((name, value, low, high, unit)) => {
                Err(FollowerError::Number { name, value, low, high, unit })
            }
            None => self.joints_ease(),
        }
    }

    /// Whether every joint's acceleration can fade out before the joint reverses: while acceleration a fades
    /// with jerk j, velocity changes by a²/(2j).
    fn joints_ease(&self) -> Result<(), FollowerError> {
        let Some(jerk) = self.limits.jerk() else { return Ok(()) };
        let most = self.limits.acceleration().iter().zip(self.limits.deceleration());
        for (joint, (&jerk, (acceleration, deceleration))) in jerk.iter().zip(most).enumerate() {
            let needed = (acceleration + deceleration) / LONGEST_EASE_S;
            if jerk < needed {
                return Err(FollowerError::JointJerk { joint, jerk, needed });
            }
        }
        Ok(())
    }
}
