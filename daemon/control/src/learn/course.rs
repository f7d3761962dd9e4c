//! `Course`: the candidate and live weights of one online model; the only place where weights are promoted or
//! rolled back.
//!
//! Contract: the candidate learns, the live weights are frozen, the previous ones are kept for a rollback.
//! Whatever the model, what becomes live is finite, was not worse than the live weights on recent motion, and
//! carries a version never used before. A candidate that leaves its bounds restarts from the live weights.

use std::fmt::Debug;
use std::iter::Sum;

use super::shadow::{Contender, Leads, Shadow, Versus};
use super::{Promotion, PromotionCause};
use crate::predict::{
    LearnStep, ListedPredictor, ModelParameters, Models, OnlineModel, OnlineWeights, Pace, ParametersOf,
    PredictorKind, WeightsError, kind_of,
};

/// When live weights may change.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rule {
    /// Moving steps over which the comparison forgets.
    pub memory_steps: f64,
    /// Moving steps compared since the last change before anything is promoted or rolled back.
    pub min_evidence: u32,
    /// A candidate is promoted when its error is below this fraction of the live error, at most 1.
    pub promote_ratio: f64,
    /// The live weights are rolled back when their error is above this multiple of their predecessor's, at
    /// least 1; for weights that follow their candidate at least 1.5.
    pub rollback_ratio: f64,
    /// Moving steps between two hand-overs of a candidate that the live weights follow.
    pub follow_steps: u32,
}

/// A following candidate may be worse by this factor: chance differences are as large.
const FOLLOW_RATIO: f64 = 1.02;
/// Live weights that follow are rolled back only when worse than their anchor by this factor: they adapt to
/// the current writing, and a little worse on the last letter is no fault.
const ASTRAY_RATIO: f64 = 1.5;
/// A candidate whose error exceeds the live error by this factor restarts from the live weights.
const ABANDON_RATIO: f64 = 2.0;
/// Evidence, as a multiple of the least, after which an anchor is renewed.
const ANCHOR_AGE: u32 = 3;

/// What happened to one model's weights.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct CourseCounters {
    /// How many candidates were promoted.
    pub promotions: u64,
    /// How many promotions were rolled back.
    pub rollbacks: u64,
    /// Candidates discarded because a parameter left its bounds or was non-finite.
    pub poisoned: u64,
    /// Candidates discarded because they were much worse than the live weights.
    pub abandoned: u64,
}

impl Sum for CourseCounters {
    fn sum<I: Iterator<Item = Self>>(all: I) -> Self {
        all.fold(Self::default(), |sum, one| Self {
            promotions: sum.promotions + one.promotions,
            rollbacks: sum.rollbacks + one.rollbacks,
            poisoned: sum.poisoned + one.poisoned,
            abandoned: sum.abandoned + one.abandoned,
        })
    }
}

/// Recent errors of a model's weights.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct CourseErrors {
    /// The candidate against the live weights.
    pub candidate: Versus,
    /// The live weights against those of a rollback.
    pub live: Versus,
}

/// The course of a model of any type.
pub(super) trait AnyCourse: Debug + Send + Sync {
    /// Which predictor it is about.
    fn kind(&self) -> PredictorKind;

    /// The stroke was interrupted: memory is cleared.
    fn interrupt(&mut self);

    /// One step of ordinary motion, used for learning if `learnable`; changes its part of `live` when the
    /// evidence demands it, with version `version`.
    fn learn(
        &mut self,
        step: &LearnStep,
        learnable: bool,
        live: &mut OnlineWeights,
        version: u64,
    ) -> Option<Promotion>;

    /// Checks `weights` as `propose` does.
    ///
    /// # Errors
    ///
    /// Weights that are invalid or do not fit.
    fn judge(&self, weights: &OnlineWeights) -> Result<(), WeightsError>;

    /// Replaces the candidate by external weights; they must still earn their promotion.
    ///
    /// # Errors
    ///
    /// As `judge`; nothing changes then.
    fn propose(&mut self, weights: &OnlineWeights) -> Result<(), WeightsError>;

    /// Writes the candidate into its part of `weights`.
    fn tell_candidate(&self, weights: &mut OnlineWeights);

    /// Recent errors of candidate and live weights.
    fn errors(&self) -> CourseErrors;

    /// What happened so far.
    fn counters(&self) -> CourseCounters;

    /// A copy of the course.
    fn copied(&self) -> Box<dyn AnyCourse>;
}

impl Clone for Box<dyn AnyCourse> {
    fn clone(&self) -> Self {
        self.as_ref().copied()
    }
}

/// One model: candidate, previous weights and their comparison. The live weights are in the set that is
/// handed over.
#[derive(Debug, Clone)]
pub(super) struct Course<P: ListedPredictor> {
    rule: Rule,
    candidate: P::Learner,
    previous: Option<ParametersOf<P>>,
    shadow: Shadow,
    /// Moving steps since the last hand-over.
    since: u32,
    counters: CourseCounters,
}

impl<P: ListedPredictor> AnyCourse for Course<P> {
    fn kind(&self) -> PredictorKind {
        kind_of::<P>()
    }

    fn interrupt(&mut self) {
        self.candidate.reset_state();
        self.shadow.interrupt();
    }

    fn learn(
        &mut self,
        step: &LearnStep,
        learnable: bool,
        live: &mut OnlineWeights,
        version: u64,
    ) -> Option<Promotion> {
        let live = P::part_mut(live);
        let moving = self.shadow.resolve(step.pen.x);
        self.since = self.since.saturating_add(u32::from(moving));
        if learnable {
            self.candidate.learn_pen(&step.pen);
        } else {
            self.candidate.observe_pen(&step.pen);
        }
        if self.candidate.parameters().validate().is_err() {
            self.counters.poisoned += 1;
            self.restart_from(live);
        }
        let Self { candidate, previous, shadow, .. } = self;
        shadow.preview(|contender, path| {
            let parameters = match contender {
                Contender::Candidate => Some(candidate.parameters()),
                Contender::Live => Some(&*live),
                Contender::Previous => previous.as_ref(),
            };
            if let Some(parameters) = parameters {
                candidate.preview_from(parameters, candidate.memory(), step.limit, path);
            }
            parameters.is_some()
        });
        let (cause, leaving, coming) = self.decide(live)?;
        *live = live.with_version(version);
        let (model, version, index) = (self.kind(), live.version(), step.index);
        Some(Promotion { model, version, cause, index, error_leaving: leaving, error_coming: coming })
    }

    fn judge(&self, weights: &OnlineWeights) -> Result<(), WeightsError> {
        let weights = P::part(weights);
        weights.validate()?;
        self.candidate.parameters().accepts(weights)
    }

    fn propose(&mut self, weights: &OnlineWeights) -> Result<(), WeightsError> {
        self.candidate.restart_from(P::part(weights))?;
        self.shadow.restart();
        Ok(())
    }

    fn tell_candidate(&self, weights: &mut OnlineWeights) {
        *P::part_mut(weights) = *self.candidate.parameters();
    }

    fn errors(&self) -> CourseErrors {
        CourseErrors { candidate: self.shadow.candidate(), live: self.shadow.live() }
    }

    fn counters(&self) -> CourseCounters {
        self.counters
    }

    fn copied(&self) -> Box<dyn AnyCourse> {
        Box::new(self.clone())
    }
}

impl<P: ListedPredictor> Course<P> {
    /// The candidate starts with the weights of `live`.
    ///
    /// # Errors
    ///
    /// Settings outside their bounds, or weights that do not fit.
    pub(super) fn new(
        models: &Models,
        live: &OnlineWeights,
        rule: Rule,
        leads: Leads,
    ) -> Result<Self, WeightsError> {
        let candidate = P::learner(models, P::part(live))?;
        let previous = (P::PACE == Pace::Following).then_some(*candidate.parameters());
        let shadow = Shadow::new(leads, rule.memory_steps);
        let counters = CourseCounters::default();
        Ok(Self { rule, candidate, previous, shadow, since: 0, counters })
    }

    /// Exchanges the live weights if the evidence demands it; returns why, and the errors of the old and the
    /// new weights.
    fn decide(&mut self, live: &mut ParametersOf<P>) -> Option<(PromotionCause, f64, f64)> {
        let Versus { compared, challenger, other: live_error } = self.shadow.candidate();
        let Rule { min_evidence, promote_ratio, rollback_ratio, follow_steps, .. } = self.rule;
        let old = self.shadow.live();
        let tolerated = match P::PACE {
            Pace::Settled => rollback_ratio,
            Pace::Following => rollback_ratio.max(ASTRAY_RATIO),
        };
        if let Some(before) = self.previous
            && old.compared >= min_evidence
            && old.challenger > tolerated * old.other
        {
            self.counters.rollbacks += 1;
            *live = before;
            match P::PACE {
                Pace::Settled => {
                    self.previous = None;
                    self.continue_from(live);
                }
                Pace::Following => self.restart_from(live),
            }
            return Some((PromotionCause::RolledBack, old.challenger, old.other));
        }
        match P::PACE {
            Pace::Settled => {
                if compared >= min_evidence && challenger < promote_ratio * live_error {
                    self.counters.promotions += 1;
                    self.previous = Some(*live);
                    *live = *self.candidate.parameters();
                    self.shadow.restart();
                    return Some((PromotionCause::Improved, live_error, challenger));
                }
            }
            Pace::Following => {
                if old.compared >= ANCHOR_AGE.saturating_mul(min_evidence) && old.challenger <= old.other {
                    self.previous = Some(*live);
                    self.shadow.restart_previous();
                }
                let due = self.since >= follow_steps && compared >= follow_steps;
                if due && challenger <= FOLLOW_RATIO * live_error {
                    self.counters.promotions += 1;
                    self.since = 0;
                    *live = *self.candidate.parameters();
                    return Some((PromotionCause::Followed, live_error, challenger));
                }
            }
        }
        if compared >= min_evidence && challenger > ABANDON_RATIO * live_error {
            self.counters.abandoned += 1;
            self.continue_from(live);
        }
        None
    }

    // The live weights were checked before they became live: they cannot be refused.

    fn continue_from(&mut self, live: &ParametersOf<P>) {
        let _ = self.candidate.continue_from(live);
        self.shadow.restart();
    }

    fn restart_from(&mut self, live: &ParametersOf<P>) {
        let _ = self.candidate.restart_from(live);
        self.shadow.restart();
    }
}
