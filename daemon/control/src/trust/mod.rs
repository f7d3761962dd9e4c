//! Trust: how much of the preview the follower may use, α in \[0, 1\].
//!
//! Contract: α moves by at most dt/(ramp_steps·Δ) per update, whatever is requested, so no record, request or
//! fault can make it jump (the paper ramps over 10 steps). The target is 0 whenever the preview has no value,
//! and the reason is always given. In automatic mode it is the ceiling until past previews have been worse
//! than Hold, over the leads that the plan uses, beyond doubt ([`Record::evidence`]), and again once the
//! evidence is even. How far an arm can follow is no matter of trust, but of the governor.

use thiserror::Error;

use crate::estimate::LawParameters;
use crate::estimate::record::Record;
use crate::state::{Reader, State, StateError, Writer, state};
use crate::units::Trust;

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
    /// Automatic mode trusts each step of the preview by its record, and corrects it by samples newer than
    /// the grid ([`crate::estimate`]). Off: the paper's scalar α over the unmodified preview.
    pub per_step: bool,
}

impl Default for TrustSettings {
    fn default() -> Self {
        Self {
            step_ns: 10_000_000,
            ramp_steps: 10.0,
            warmup_steps: 5,
            stale_after_ns: 60_000_000,
            auto_ceiling: Trust::FULL,
            per_step: true,
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
    /// The last preview was finite.
    pub preview_finite: bool,
    /// Another predictor waits for α = 0 to take over, or just has.
    pub switching: bool,
    /// Share of recent ticks that wanted to follow a plan and had to stop instead, [0, 1]: no plan, or no
    /// joints for it.
    pub unplanned: f64,
    /// Parameters of the learner were refused recently, and none accepted since.
    pub weights_refused: bool,
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
    /// There is too little history yet.
    Warmup,
    /// A value that an operator set.
    Manual,
    /// The value frozen by an operator.
    Frozen,
    /// Too many recent ticks had no plan or no joints for it; trust resumes gradually.
    SolverUnhealthy,
    /// Past previews were worse than Hold.
    WorseThanHold,
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

/// The trust control: α and what judges it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrustControl {
    settings: TrustSettings,
    law: LawParameters,
    alpha: f64,
    /// The evidence speaks for the preview, with hysteresis.
    believed: bool,
    /// Too many recent ticks had no plan, with hysteresis.
    unplanned: bool,
}

state! { [] TrustControl { alpha, believed, unplanned } fixed { settings, law } }

impl TrustControl {
    /// α = 0, and a preview that is believed.
    ///
    /// # Errors
    ///
    /// A setting outside its range.
    pub fn new(settings: TrustSettings, law: &LawParameters) -> Result<Self, TrustError> {
        if settings.step_ns == 0 {
            return Err(TrustError::Step);
        }
        if !(1.0..=1000.0).contains(&settings.ramp_steps) {
            return Err(TrustError::Ramp { got: settings.ramp_steps });
        }
        if !(settings.step_ns..=10_000_000_000).contains(&settings.stale_after_ns) {
            return Err(TrustError::Stale { got_ns: settings.stale_after_ns, step_ns: settings.step_ns });
        }
        Ok(Self { settings, law: *law, alpha: 0.0, believed: true, unplanned: false })
    }

    /// Moves α towards what `inputs` justify, `dt_ns` after the last update.
    pub fn update(&mut self, inputs: &TrustInputs, dt_ns: u64) -> TrustReport {
        let LawParameters { evidence_most, unplanned_ends, .. } = self.law;
        let least = if self.believed { -0.5 * evidence_most } else { 0.0 };
        let most = if self.unplanned { 0.2 * unplanned_ends } else { unplanned_ends };
        // Both written so that NaN counts against the preview.
        self.believed = inputs.record.evidence >= least;
        self.unplanned = !(inputs.unplanned <= most);
        let (reason, target) = self.judge(inputs);
        let reach = dt_ns as f64 / (self.settings.ramp_steps * self.settings.step_ns as f64);
        self.alpha = target.alpha().clamp(self.alpha - reach, self.alpha + reach);
        TrustReport { alpha: Trust::new(self.alpha), target, reason }
    }

    /// α after the last update.
    #[must_use]
    pub fn alpha(&self) -> Trust {
        Trust::new(self.alpha)
    }

    fn judge(&self, inputs: &TrustInputs) -> (TrustReason, Trust) {
        let fresh = inputs.pen_age_ns.is_some_and(|age| age <= self.settings.stale_after_ns);
        let reason = match inputs.request {
            _ if !inputs.armed => TrustReason::Disarmed,
            _ if !fresh => TrustReason::Stale,
            _ if !inputs.preview_finite => TrustReason::PredictorInvalid,
            _ if inputs.switching => TrustReason::SwitchingPredictor,
            _ if inputs.history < self.settings.warmup_steps => TrustReason::Warmup,
            TrustRequest::Manual(_) => TrustReason::Manual,
            TrustRequest::Frozen(_) => TrustReason::Frozen,
            TrustRequest::Auto if self.unplanned => TrustReason::SolverUnhealthy,
            TrustRequest::Auto if inputs.weights_refused => TrustReason::PredictorInvalid,
            TrustRequest::Auto if !self.believed => TrustReason::WorseThanHold,
            TrustRequest::Auto => TrustReason::Auto,
        };
        let target = match (reason, inputs.request) {
            (TrustReason::Manual, TrustRequest::Manual(value))
            | (TrustReason::Frozen, TrustRequest::Frozen(value)) => value,
            (TrustReason::Auto, _) => self.settings.auto_ceiling,
            _ => Trust::NONE,
        };
        (reason, target)
    }
}
