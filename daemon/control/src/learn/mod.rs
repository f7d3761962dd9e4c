//! Online learning: a candidate learns from the pen, the live weights are frozen, evidence decides.
//!
//! Contract: one call per grid step, no clock and no allocation, so that the learner thread, the lab and replay make the
//! same weights. What reaches the loop is whole, finite and was better than the live weights on recent motion; what then
//! turns out worse than its predecessor is rolled back. Parameters carry over from stroke to stroke, memory does not.

mod shadow;

pub use shadow::{MAX_LEAD, ShadowErrors};

use thiserror::Error;

use crate::pen::Motion;
use crate::predict::dybm::{DybmShape, TraceInput};
use crate::predict::{
    DybmLearner, DybmSettings, DybmWeights, ModelParameters, OnlineModel, Optimiser, WeightsError,
};
use shadow::{Contenders, Shadow};

/// What the learner needs of one grid step; made by [`crate::predict::Previewer::observe`].
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct LearnStep {
    /// Grid index k.
    pub index: u64,
    /// Normalised displacement, zero unless the motion continues.
    pub x: [f64; 2],
    /// Only `Continues` is learned from; the others empty the memory.
    pub motion: Motion,
    /// The pen touches the paper.
    pub contact: bool,
    /// Metres per normalised unit.
    pub scale_m: f64,
}

/// Weights before anything was learned.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum InitialWeights {
    /// All zero, as in the paper: predicts like Hold at first.
    Zero,
    /// W_1 = this·I: predicts the last displacement, fading by this factor per step.
    Persistent(f64),
}

/// How the learner learns and when it dares.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LearnerSettings {
    /// Δ [ns].
    pub step_ns: u64,
    /// Shape and learning rule of the DyBM.
    pub dybm: DybmSettings,
    /// Start.
    pub initial: InitialWeights,
    /// Weights are compared by their roll-out over this many steps, 1 … [`MAX_LEAD`].
    pub lead_steps: usize,
    /// Moving steps over which the comparison forgets.
    pub memory_steps: f64,
    /// Moving steps compared since the last change before anything is promoted or rolled back.
    pub min_evidence: u32,
    /// The candidate is promoted when its error is below this part of the live error, at most 1.
    pub promote_ratio: f64,
    /// The live weights are rolled back when their error is above this many times their predecessor's, at least 1.
    pub rollback_ratio: f64,
    /// Displacements longer than this (normalised, typical is 14) are remembered but not learned from.
    pub max_learned: f64,
}

impl LearnerSettings {
    /// The learner of the preset loop.
    ///
    /// Chosen on UNIPEN train writers (20 of TOS with hover path, 18 of CED with lift-and-travel) and on made-up smooth
    /// strokes, all at 10 ms, one fresh learner per writer: delays 2-16, one to three decay rates, AdaGrad 1e-3 to 1,
    /// RMSProp, Adam. Delay 9 and AdaGrad 0.01 win; the paper's 0.1 learns fast and then wanders. Evidence, memory and
    /// ratios hardly matter within a factor of two.
    /// Note: learning *change* on top of `Persistent` is an addition to the paper; `Zero` is its own start.
    #[must_use]
    pub fn preset(step_ns: u64) -> Self {
        Self {
            step_ns,
            dybm: DybmSettings {
                shape: DybmShape::new(9, &[0.5], TraceInput::Delayed),
                optimiser: Optimiser::ada_grad(0.01),
                l1: 0.0,
                l2: 0.0,
            },
            initial: InitialWeights::Persistent(0.95),
            lead_steps: 10,
            memory_steps: 300.0,
            min_evidence: 100,
            promote_ratio: 0.95,
            rollback_ratio: 1.1,
            max_learned: 60.0,
        }
    }

    /// The weights before anything was learned.
    #[must_use]
    pub fn initial_weights(&self) -> DybmWeights {
        match self.initial {
            InitialWeights::Zero => DybmWeights::zero(self.step_ns, self.dybm.shape),
            InitialWeights::Persistent(factor) => {
                DybmWeights::persistent(self.step_ns, self.dybm.shape, factor)
            }
        }
    }
}

/// A setting that cannot work.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum LearnError {
    /// The DyBM's settings or initial weights.
    #[error(transparent)]
    Weights(#[from] WeightsError),
    /// The comparison's roll-out is too long or empty.
    #[error("learner lead is {got} steps, legal are 1 to {MAX_LEAD}")]
    Lead {
        /// As given.
        got: usize,
    },
    /// A number of the promotion rule.
    #[error("learner setting {name} is {got}, legal are {min} to {max}")]
    Rule {
        /// Which.
        name: &'static str,
        /// As given.
        got: f64,
        /// Smallest legal value.
        min: f64,
        /// Largest legal value.
        max: f64,
    },
}

/// Why the live weights change.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PromotionCause {
    /// The candidate did better.
    Improved,
    /// The live weights did worse than those before them, which come back.
    RolledBack,
}

/// New live weights, to be sent to the loop whole.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Promotion {
    /// The new live weights, with a version never used before.
    pub weights: DybmWeights,
    /// Why.
    pub cause: PromotionCause,
    /// Grid index of the step that decided.
    pub index: u64,
    /// Recent roll-out error of the weights that leave (mean squared, normalised).
    pub error_leaving: f64,
    /// Recent roll-out error of the weights that come.
    pub error_coming: f64,
}

/// What happened so far: `received` = `updates` + `unlearned` + `interruptions` + `refused`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct LearnCounters {
    /// Steps given to `learn`.
    pub received: u64,
    /// Gradient steps of the candidate.
    pub updates: u64,
    /// Remembered but too long to learn from.
    pub unlearned: u64,
    /// Starts, jumps and lost steps: the memory was emptied.
    pub interruptions: u64,
    /// Not finite.
    pub refused: u64,
    /// Candidates promoted.
    pub promotions: u64,
    /// Promotions taken back.
    pub rollbacks: u64,
    /// Candidates thrown away because a parameter left its bounds or was not finite.
    pub poisoned: u64,
    /// Candidates thrown away because they did much worse than the live weights.
    pub abandoned: u64,
}

/// Candidate error above this many times the live error: start the candidate again from the live weights.
const ABANDON_RATIO: f64 = 2.0;

/// The candidate, the live weights it competes with, and the weights before those.
#[derive(Debug, Clone, Copy)]
pub struct Learner {
    settings: LearnerSettings,
    candidate: DybmLearner,
    live: DybmWeights,
    previous: Option<DybmWeights>,
    newest_version: u64,
    newest_index: Option<u64>,
    shadow: Shadow,
    counters: LearnCounters,
}

impl Learner {
    /// Starts with the initial weights of the settings as candidate and live.
    ///
    /// *Errors*: the first setting outside its bounds.
    pub fn new(settings: LearnerSettings) -> Result<Self, LearnError> {
        Self::from_weights(settings, settings.initial_weights())
    }

    /// As `new`, from stored weights.
    ///
    /// *Errors*: the first setting outside its bounds, or weights that are invalid or made for another loop.
    pub fn from_weights(settings: LearnerSettings, live: DybmWeights) -> Result<Self, LearnError> {
        let LearnerSettings { lead_steps, memory_steps, promote_ratio, rollback_ratio, max_learned, .. } =
            settings;
        if !(1..=MAX_LEAD).contains(&lead_steps) {
            return Err(LearnError::Lead { got: lead_steps });
        }
        for (name, got, min, max) in [
            ("memory_steps", memory_steps, 10.0, 1e6),
            ("min_evidence", f64::from(settings.min_evidence), 10.0, 1e6),
            ("promote_ratio", promote_ratio, 0.1, 1.0),
            ("rollback_ratio", rollback_ratio, 1.0, 10.0),
            ("max_learned", max_learned, 10.0, 1e6),
        ] {
            if !(min..=max).contains(&got) {
                return Err(LearnError::Rule { name, got, min, max });
            }
        }
        live.fits(settings.step_ns)?;
        Ok(Self {
            settings,
            candidate: DybmLearner::new(settings.dybm, live)?,
            live,
            previous: None,
            newest_version: live.version,
            newest_index: None,
            shadow: Shadow::new(lead_steps, memory_steps),
            counters: LearnCounters::default(),
        })
    }

    /// Learns from one grid step; returns new live weights when the evidence asks for a change.
    pub fn learn(&mut self, step: &LearnStep) -> Option<Promotion> {
        self.counters.received += 1;
        let follows = self.newest_index.is_some_and(|newest| newest.checked_add(1) == Some(step.index));
        self.newest_index = Some(step.index);
        let finite = step.x.iter().all(|x| x.is_finite());
        if !finite || step.motion != Motion::Continues || !follows {
            *(if finite { &mut self.counters.interruptions } else { &mut self.counters.refused }) += 1;
            self.candidate.reset_state();
            self.shadow.interrupt();
            return None;
        }
        self.shadow.settle(step.x);
        self.update(step.x);
        let contenders = Contenders {
            candidate: self.candidate.weights(),
            live: &self.live,
            previous: self.previous.as_ref(),
        };
        self.shadow.preview(&contenders, self.candidate.state());
        self.decide(step.index)
    }

    /// Replaces the candidate by weights from elsewhere; they must still earn their promotion.
    ///
    /// *Errors*: invalid weights or weights that do not fit; the candidate stays.
    pub fn propose(&mut self, weights: &DybmWeights) -> Result<(), WeightsError> {
        self.candidate.restart_from(weights)?;
        self.shadow.restart();
        Ok(())
    }

    /// The weights the loop should be using.
    #[must_use]
    pub fn live(&self) -> &DybmWeights {
        &self.live
    }

    /// The weights that learn.
    #[must_use]
    pub fn candidate(&self) -> &DybmWeights {
        self.candidate.weights()
    }

    /// Recent roll-out errors of candidate, live and previous weights.
    #[must_use]
    pub fn errors(&self) -> ShadowErrors {
        let errors = self.shadow.errors();
        ShadowErrors { previous: self.previous.map_or(0.0, |_| errors.previous), ..errors }
    }

    /// What happened so far.
    #[must_use]
    pub fn counters(&self) -> LearnCounters {
        self.counters
    }

    /// The settings in force.
    #[must_use]
    pub fn settings(&self) -> &LearnerSettings {
        &self.settings
    }

    fn update(&mut self, x: [f64; 2]) {
        let [dx, dy] = x;
        if dx.hypot(dy) <= self.settings.max_learned {
            self.candidate.learn(x);
            self.counters.updates += 1;
        } else {
            self.candidate.observe(x);
            self.counters.unlearned += 1;
        }
        if self.candidate.weights().validate().is_err() {
            self.counters.poisoned += 1;
            // Cannot fail: live weights were valid and of this shape when they became live.
            let _ = self.candidate.restart_from(&self.live);
            self.shadow.restart();
        }
    }

    fn decide(&mut self, index: u64) -> Option<Promotion> {
        let ShadowErrors { compared, candidate, live, previous } = self.shadow.errors();
        if compared < self.settings.min_evidence {
            return None;
        }
        if let Some(before) = self.previous
            && live > self.settings.rollback_ratio * previous
        {
            self.counters.rollbacks += 1;
            self.install(before, None);
            self.continue_from_live();
            return Some(self.promotion(PromotionCause::RolledBack, index, live, previous));
        }
        if candidate < self.settings.promote_ratio * live {
            self.counters.promotions += 1;
            self.install(*self.candidate.weights(), Some(self.live));
            self.shadow.restart();
            return Some(self.promotion(PromotionCause::Improved, index, live, candidate));
        }
        if candidate > ABANDON_RATIO * live {
            self.counters.abandoned += 1;
            self.continue_from_live();
        }
        None
    }

    fn install(&mut self, weights: DybmWeights, previous: Option<DybmWeights>) {
        self.newest_version += 1;
        self.live = DybmWeights { version: self.newest_version, ..weights };
        self.previous = previous;
    }

    fn promotion(&self, cause: PromotionCause, index: u64, leaving: f64, coming: f64) -> Promotion {
        Promotion { weights: self.live, cause, index, error_leaving: leaving, error_coming: coming }
    }

    fn continue_from_live(&mut self) {
        // Cannot fail: live weights were valid and of this shape when they became live.
        let _ = self.candidate.continue_from(&self.live);
        self.shadow.restart();
    }
}
