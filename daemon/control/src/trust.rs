//! Trust: how much of the preview the follower may use, α in [0, 1].
//!
//! Contract: α moves by at most dt/(ramp_steps·Δ) per update, whatever is asked for, so no evidence, request or fault
//! can make it jump (the paper ramps over 10 steps). The target is 0 whenever the preview is not worth anything, and the
//! reason is always given. Absent: evidence from realised errors (a healthy preview is trusted up to `auto_ceiling`).

use thiserror::Error;

use crate::units::Trust;

/// How trust may move.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrustSettings {
    /// Grid step Δ [ns].
    pub step_ns: u64,
    /// Grid steps a full change takes, at least 1.
    pub ramp_steps: f64,
    /// Steps of motion a predictor must have seen before its preview counts.
    pub warmup_steps: u32,
    /// Pen samples older than this are stale [ns].
    pub stale_after_ns: u64,
    /// α that a healthy preview is given in automatic mode.
    pub auto_ceiling: Trust,
}

impl Default for TrustSettings {
    fn default() -> Self {
        Self {
            step_ns: 10_000_000,
            ramp_steps: 10.0,
            warmup_steps: 5,
            stale_after_ns: 60_000_000,
            auto_ceiling: Trust::FULL,
        }
    }
}

/// A setting that cannot work.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum TrustError {
    /// Δ is zero.
    #[error("trust needs a grid step above 0 ns, e.g. 10_000_000")]
    Step,
    /// The ramp is shorter than a step, endless or not a number.
    #[error("trust ramp is {got} steps, legal are 1 to 1000: the paper uses 10")]
    Ramp {
        /// As given.
        got: f64,
    },
    /// Staleness below one grid step would never trust anything.
    #[error(
        "pen samples are stale after {got_ns} ns, legal are {step_ns} (one grid step) to 10_000_000_000 ns"
    )]
    Stale {
        /// As given [ns].
        got_ns: u64,
        /// Δ [ns].
        step_ns: u64,
    },
}

/// Who decides.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum TrustRequest {
    /// The evidence.
    #[default]
    Auto,
    /// An operator; health still overrules.
    Manual(Trust),
}

/// What one tick knows about the preview.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrustInputs {
    /// Who decides.
    pub request: TrustRequest,
    /// The follower moves the arm; if not, trust rests at 0.
    pub armed: bool,
    /// Steps of motion since the predictor's memory was emptied.
    pub history: u32,
    /// Age of the newest pen sample [ns]; `None` before the first.
    pub pen_age_ns: Option<u64>,
    /// A jump was among the steps since the last update.
    pub jumped: bool,
    /// The last preview was finite.
    pub preview_finite: bool,
    /// Another predictor waits for α = 0 to take over.
    pub switching: bool,
}

/// Why the target is what it is; the first that applies, in this order.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum TrustReason {
    /// The arm does not follow.
    #[default]
    Disarmed,
    /// No pen sample, or the newest is too old.
    Stale,
    /// The predictor's numbers are not usable.
    PredictorInvalid,
    /// Another predictor takes over at α = 0.
    SwitchingPredictor,
    /// The pen jumped: history starts anew (lasts until warmed up).
    Jump,
    /// Too little history.
    Warmup,
    /// The operator's value.
    Manual,
    /// The evidence's value.
    Auto,
}

impl TrustReason {
    /// Every reason, in the order of their numbers on the wire.
    pub const ALL: [Self; 8] = [
        Self::Disarmed,
        Self::Stale,
        Self::PredictorInvalid,
        Self::SwitchingPredictor,
        Self::Jump,
        Self::Warmup,
        Self::Manual,
        Self::Auto,
    ];

    /// Name in reports.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Disarmed => "disarmed",
            Self::Stale => "stale",
            Self::PredictorInvalid => "predictor-invalid",
            Self::SwitchingPredictor => "switching-predictor",
            Self::Jump => "jump",
            Self::Warmup => "warmup",
            Self::Manual => "manual",
            Self::Auto => "auto",
        }
    }
}

/// Trust after an update.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrustReport {
    /// α to use now.
    pub alpha: Trust,
    /// Where it is going.
    pub target: Trust,
    /// Why.
    pub reason: TrustReason,
}

/// The ramp and what it remembers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrustControl {
    settings: TrustSettings,
    alpha: f64,
    /// The present warm-up follows a jump.
    after_jump: bool,
}

impl TrustControl {
    /// Starts at α = 0.
    ///
    /// *Errors*: the first setting that is outside its bounds.
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
        Ok(Self { settings, alpha: 0.0, after_jump: false })
    }

    /// Moves α towards what `inputs` justify; `dt_ns` since the last update [ns].
    pub fn update(&mut self, inputs: &TrustInputs, dt_ns: u64) -> TrustReport {
        self.after_jump = inputs.jumped || (self.after_jump && inputs.history < self.settings.warmup_steps);
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
            _ if self.after_jump => TrustReason::Jump,
            _ if inputs.history < self.settings.warmup_steps => TrustReason::Warmup,
            TrustRequest::Manual(_) => TrustReason::Manual,
            TrustRequest::Auto => TrustReason::Auto,
        };
        let target = match (reason, inputs.request) {
            (TrustReason::Manual, TrustRequest::Manual(value)) => value,
            (TrustReason::Auto, _) => self.settings.auto_ceiling,
            _ => Trust::NONE,
        };
        (reason, target)
    }
}
