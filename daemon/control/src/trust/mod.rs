//! Trust: how much of the preview the follower may use, α in \[0, 1\].
//!
//! Contract: α moves by at most dt/(ramp_steps·Δ) per update, whatever is requested, so no record, request or
//! fault can make it jump (the paper ramps over 10 steps). The target is 0 whenever the preview has no value,
//! and the reason is always given. In automatic mode past previews must have been better than Hold, over the
//! leads that the plan uses, by a margin that is wider on the way up than on the way down
//! ([`crate::estimate::skill::Skill`] keeps the record). The result is reduced if the arm lacks the headroom
//! to follow it (`headroom`).

mod headroom;
mod outcome;
mod parameters;

use crate::state::{Reader, State, StateError, Writer, state};
pub use outcome::Outcome;
pub use parameters::{Hysteresis, TrustParameters};

use thiserror::Error;

use crate::estimate::skill::Record;
use crate::units::Trust;
use headroom::TrustHeadroom;

/// How trust may move.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrustSettings {
    /// Grid step Δ \[ns\].
    pub step_ns: u64,
    /// Grid steps a full change takes, at least 1.
    pub ramp_steps: f64,
    /// Steps of motion a predictor must have seen before its preview counts.
    pub warmup_steps: u32,
    /// Pen samples older than this are stale \[ns\].
    pub stale_after_ns: u64,
    /// α given to a healthy preview in automatic mode.
    pub auto_ceiling: Trust,
    /// Judged cases of motion per lead before a preview is trusted in automatic mode.
    pub proof_cases: u32,
    /// Automatic mode trusts each step of the preview by its record, and corrects it by samples newer than
    /// the grid ([`crate::estimate::skill::Skill`]). Off: the paper's scalar α over the unmodified preview.
    pub per_step: bool,
    /// Parameters of α, with their reasons.
    pub parameters: TrustParameters,
}

impl Default for TrustSettings {
    fn default() -> Self {
        Self {
            step_ns: 10_000_000,
            ramp_steps: 10.0,
            warmup_steps: 5,
            stale_after_ns: 60_000_000,
            auto_ceiling: Trust::FULL,
            proof_cases: 1,
            per_step: true,
            parameters: TrustParameters::SHIPPED,
        }
    }
}

/// A setting that cannot work.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum TrustError {
    /// Δ is zero.
    #[error("trust needs a grid step above 0 ns, e.g. 10_000_000")]
    Step,
    /// The ramp is shorter than a step, infinite or NaN.
    #[error("trust ramp is {got} steps, legal are 1 to 1000: the paper uses 10")]
    Ramp {
        /// The refused value, as it was given.
        got: f64,
    },
    /// A limit below one grid step would never trust anything.
    #[error(
        "pen samples are stale after {got_ns} ns, legal are {step_ns} (one grid step) to 10_000_000_000 ns"
    )]
    Stale {
        /// As given \[ns\].
        got_ns: u64,
        /// Δ \[ns\].
        step_ns: u64,
    },
}

/// Who decides about the trust.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum TrustRequest {
    /// The evidence decides, as automatic mode does.
    #[default]
    Auto,
    /// An operator; health still overrules.
    Manual(Trust),
    /// Frozen at its value when an operator requested that; health still overrules.
    Frozen(Trust),
}

impl State for TrustRequest {
    fn save(&self, to: &mut Writer<'_>) {
        let (mark, trust) = match *self {
            Self::Auto => (0, Trust::NONE),
            Self::Manual(trust) => (1, trust),
            Self::Frozen(trust) => (2, trust),
        };
        to.put(&[mark]);
        trust.save(to);
    }

    fn load(&mut self, from: &mut Reader<'_>) -> Result<(), StateError> {
        let mark = from.mark(2)?;
        let mut trust = Trust::NONE;
        trust.load(from)?;
        *self = match mark {
            0 => Self::Auto,
            1 => Self::Manual(trust),
            _ => Self::Frozen(trust),
        };
        Ok(())
    }
}

/// What one tick knows about the preview.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrustInputs {
    /// Who decides about the trust.
    pub request: TrustRequest,
    /// The follower moves the arm; if not, trust rests at 0.
    pub armed: bool,
    /// Steps of motion since the predictor's memory was emptied.
    pub history: u32,
    /// Age of the newest pen sample \[ns\]; `None` before the first.
    pub pen_age_ns: Option<u64>,
    /// A jump was among the steps since the last update.
    pub jumped: bool,
    /// The last preview was finite.
    pub preview_finite: bool,
    /// Another predictor waits for α = 0 to take over.
    pub switching: bool,
    /// Share of recent ticks that wanted to follow a plan and had to stop instead, [0, 1]: no plan, or no
    /// joints for it.
    pub unplanned: f64,
    /// Share of recent ticks whose plan failed, [0, 1]: the solver ran out of steps or found no solution.
    pub failed: f64,
    /// Parameters of the learner were refused recently, and none accepted since.
    pub weights_refused: bool,
    /// The last tick was saturated (joints, acceleration or speed), and following is hardly better than
    /// feedback alone ([`Outcome`]); `None` if nothing moved by a plan.
    pub overtaxed: Option<bool>,
    /// Delay from a change of trust to its effect on following: dead time plus the lag of feedback \[ns\].
    pub reaction_ns: u64,
    /// The record of past previews.
    pub record: Record,
}

/// Why the target is what it is; the first that applies, in this order.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum TrustReason {
    /// The arm does not follow.
    #[default]
    Disarmed,
    /// No pen sample, or the newest is too old.
    Stale,
    /// The predictor's output is not usable.
    PredictorInvalid,
    /// Another predictor takes over at α = 0.
    SwitchingPredictor,
    /// The pen jumped: history starts again (lasts until warmed up).
    Jump,
    /// There is too little history yet.
    Warmup,
    /// A value that an operator set.
    Manual,
    /// The value frozen by an operator.
    Frozen,
    /// Too many recent ticks had no plan or no joints for it; trust resumes gradually.
    SolverUnhealthy,
    /// The learner handed over invalid parameters: the predictor's memory may hold the same bad steps.
    LearnerUnhealthy,
    /// Too few previews were judged.
    Unproven,
    /// The pen left the bands of recent previews far more often than they promise.
    Surprised,
    /// Past previews were worse than Hold.
    WorseThanHold,
    /// Past previews were much worse than constant velocity.
    WorseThanSteady,
    /// Past previews are better than Hold, but not yet by enough to be trusted again.
    Hysteresis,
    /// The record supports the preview, but the arm is saturated too often, and then hardly better than under
    /// feedback alone.
    ArmLimited,
    /// The record supports the preview.
    Auto,
}

/// Trust after an update.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrustReport {
    /// α to use now.
    pub alpha: Trust,
    /// Where α is heading now.
    pub target: Trust,
    /// Why it was decided so.
    pub reason: TrustReason,
}

/// The ramp and its memory.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrustControl {
    settings: TrustSettings,
    alpha: f64,
    /// The present warm-up follows a jump.
    after_jump: bool,
    /// The record has not gone against the predictor, or has recovered since; a shipped predictor was proven
    /// on other hands.
    believed: bool,
    surprised: bool,
    unplanned: bool,
    headroom: TrustHeadroom,
}

state! {
    [] TrustControl { alpha, after_jump, believed, surprised, unplanned, headroom }
    fixed { settings }
}

impl TrustControl {
    /// Starts at α = 0.
    ///
    /// # Errors
    ///
    /// The first setting that is outside its bounds.
    pub fn new(settings: TrustSettings) -> Result<Self, TrustError> {
        if settings.step_ns == 0 {
            return Err(TrustError::Step);
        }
        if !(1.0..=1000.0).contains(&settings.ramp_steps) {
            return Err(TrustError::Ramp { got: settings.ramp_steps });
        }
        if !(settings.step_ns..=10_000_000_000).contains(&settings.stale_after_ns) {
            return Err(TrustError::Stale { got_ns: settings.stale_after_ns, step_ns: settings.step_ns });
        }
        Ok(Self {
            settings,
            alpha: 0.0,
            after_jump: false,
            believed: true,
            surprised: false,
            unplanned: false,
            headroom: TrustHeadroom::new(),
        })
    }

    /// Moves α towards what `inputs` justify; `dt_ns` since the last update \[ns\].
    pub fn update(&mut self, inputs: &TrustInputs, dt_ns: u64) -> TrustReport {
        self.after_jump = inputs.jumped || (self.after_jump && inputs.history < self.settings.warmup_steps);
        let parameters = self.settings.parameters;
        let verdict = self.weigh(&inputs.record);
        if !inputs.armed || inputs.switching {
            self.headroom = TrustHeadroom::new();
        } else if inputs.request == TrustRequest::Auto {
            let right = inputs.record.preview <= parameters.right * inputs.record.hold
                && inputs.failed <= parameters.failed;
            let overtaxed = inputs.overtaxed.map(|is| is && !right);
            self.headroom.see(overtaxed, inputs.reaction_ns, dt_ns, &parameters);
        }
        // Written so that NaN counts against the preview.
        self.unplanned = !(inputs.unplanned <= parameters.unplanned.bound(!self.unplanned));
        let (reason, target) = self.judge(inputs, verdict);
        let reach = dt_ns as f64 / (self.settings.ramp_steps * self.settings.step_ns as f64);
        self.alpha = target.alpha().clamp(self.alpha - reach, self.alpha + reach);
        TrustReport { alpha: Trust::new(self.alpha), target, reason }
    }

    /// α after the last update.
    #[must_use]
    pub fn alpha(&self) -> Trust {
        Trust::new(self.alpha)
    }

    /// Judges the record, with hysteresis.
    fn weigh(&mut self, record: &Record) -> TrustReason {
        if !(record.cases >= f64::from(self.settings.proof_cases)) {
            return TrustReason::Unproven;
        }
        let parameters = &self.settings.parameters;
        self.surprised = !(record.surprise <= parameters.surprise.bound(!self.surprised));
        let (hold, steady) = (parameters.hold.bound(self.believed), parameters.steady.bound(self.believed));
        // Written so that a NaN record counts against the preview.
        let better = record.preview <= hold * record.hold;
        let no_worse =
            record.preview <= steady * record.steady || record.preview <= parameters.clearly * record.hold;
        let before = self.believed;
        self.believed = better && no_worse;
        match (better, no_worse) {
            _ if self.surprised => TrustReason::Surprised,
            (true, true) => TrustReason::Auto,
            (true, false) => TrustReason::WorseThanSteady,
            _ if !before && record.preview <= parameters.hold.ends * record.hold => TrustReason::Hysteresis,
            _ => TrustReason::WorseThanHold,
        }
    }

    fn judge(&self, inputs: &TrustInputs, verdict: TrustReason) -> (TrustReason, Trust) {
        let fresh = inputs.pen_age_ns.is_some_and(|age| age <= self.settings.stale_after_ns);
        let reason = match inputs.request {
            _ if !inputs.armed => TrustReason::Disarmed,
            _ if !fresh => TrustReason::Stale,
            _ if !inputs.preview_finite => TrustReason::PredictorInvalid,
            _ if inputs.switching => TrustReason::SwitchingPredictor,
            _ if self.after_jump => TrustReason::Jump,
            _ if inputs.history < self.settings.warmup_steps => TrustReason::Warmup,
            TrustRequest::Manual(_) => TrustReason::Manual,
            TrustRequest::Frozen(_) => TrustReason::Frozen,
            TrustRequest::Auto if self.unplanned => TrustReason::SolverUnhealthy,
            TrustRequest::Auto if inputs.weights_refused => TrustReason::LearnerUnhealthy,
            TrustRequest::Auto if verdict == TrustReason::Auto && self.headroom.share() < 1.0 => {
                TrustReason::ArmLimited
            }
            TrustRequest::Auto => verdict,
        };
        let target = match (reason, inputs.request) {
            (TrustReason::Manual, TrustRequest::Manual(value))
            | (TrustReason::Frozen, TrustRequest::Frozen(value)) => value,
            (TrustReason::Auto, _) => self.settings.auto_ceiling,
            (TrustReason::ArmLimited, _) => {
                Trust::new(self.settings.auto_ceiling.alpha() * self.headroom.share())
            }
            _ => Trust::NONE,
        };
        (reason, target)
    }
}
