//! The prediction: predictors observe the steps that closed, and the one in charge makes the preview.

use super::io::{Health, MAX_STEPS_PER_TICK, Refusal};
use crate::estimate::{PreviewSource, RefinedPreview};
use crate::pen::{GridStep, Motion};
use crate::predict::{
    ExternalPreview, ExternalReport, LearnStep, OnlineWeights, Oracle, PlanLeads, PredictorKind, Previewer,
};
use crate::state::state;
use crate::units::Trust;

/// All predictors, and the one that is to take over.
#[derive(Debug)]
pub(super) struct Prediction {
    previewer: Previewer,
    pending: Option<PredictorKind>,
}

state! { [] Prediction { previewer, pending } }

/// The grid steps that closed in one tick.
pub(super) struct ClosedSteps {
    pub(super) learn: [LearnStep; MAX_STEPS_PER_TICK],
    pub(super) count: usize,
    /// Error of the one-step prediction of the first of them \[m\].
    pub(super) error: Option<f64>,
}

impl ClosedSteps {
    pub(super) fn steps(&self) -> &[LearnStep] {
        self.learn.get(..self.count).unwrap_or_default()
    }
}

/// What the prediction stands on in one tick.
#[derive(Clone, Copy)]
pub(super) struct PredictionReport {
    /// Another predictor made the preview than in the tick before.
    pub(super) switched: bool,
    /// Another predictor waits for α = 0.
    pub(super) switching: bool,
    /// Whether weights that came in this tick were refused; `None`: none came.
    pub(super) weights_refused: Option<bool>,
    /// Steps of motion since the memories were emptied.
    pub(super) history: u32,
    pub(super) finite: bool,
    /// A preview of another process took the place of the one made when the newest step closed.
    replaced: bool,
    /// The preview was made again in this tick.
    pub(super) renewed: bool,
    /// What became of another process's previews, if they are asked for.
    pub(super) external: Option<ExternalReport>,
}

impl PredictionReport {
    /// Who made the preview in force.
    pub(super) const fn source(&self) -> PreviewSource {
        match (self.switched, self.replaced) {
            (true, _) => PreviewSource::AnotherPredictor,
            (false, true) => PreviewSource::LaterThisStep,
            (false, false) => PreviewSource::Same,
        }
    }
}

/// What may change the preview in one tick.
pub(super) struct PredictionInput<'a> {
    /// At least one step closed.
    pub(super) closed: bool,
    /// The learner promoted them.
    pub(super) weights: Option<&'a OnlineWeights>,
    /// What another process predicted.
    pub(super) external: Option<&'a ExternalPreview>,
    /// Trust in the preview; another predictor takes over at 0.
    pub(super) trust: Trust,
    /// What the plan looks at.
    pub(super) leads: PlanLeads,
}

impl Prediction {
    pub(super) const fn new(previewer: Previewer) -> Self {
        Self { previewer, pending: None }
    }

    pub(super) fn use_oracle(&mut self, oracle: Oracle) {
        self.previewer.load_recording(oracle);
        // The recording was just loaded, the only thing `choose` can miss.
        let _ = self.previewer.choose(PredictorKind::ORACLE);
    }

    pub(super) const fn previewer(&self) -> &Previewer {
        &self.previewer
    }

    /// Changes the predictor as soon as no part of a preview is in use.
    pub(super) fn request(&mut self, kind: PredictorKind) -> Result<(), Refusal> {
        if !self.previewer.offers(kind) {
            return Err(Refusal::PredictorUnavailable);
        }
        self.pending = Some(kind);
        Ok(())
    }

    /// Takes in the `steps` that closed; the first was predicted by `preview`.
    pub(super) fn observe(
        &mut self,
        steps: &[GridStep],
        preview: &RefinedPreview,
        health: &mut Health,
    ) -> ClosedSteps {
        let learn = [LearnStep::default(); MAX_STEPS_PER_TICK];
        let mut closed = ClosedSteps { learn, count: steps.len(), error: None };
        let mut jumped = false;
        // Only the first step of a tick was predicted from the step just before it.
        let mut expected = preview.next_displacement();
        for (slot, step) in closed.learn.iter_mut().zip(steps) {
            *slot = self.previewer.observe(step);
            let expected = expected.take().filter(|_| slot.motion == Motion::Continues);
            if let Some([x, y]) = expected {
                let [dx, dy] = step.displacement;
                closed.error = Some((dx - x).hypot(dy - y));
            }
            jumped |= slot.motion == Motion::Jump;
        }
        if jumped {
            health.set(Health::PEN_JUMP);
        }
        closed
    }

    /// Makes the preview again where something changes it: a closed step, other weights, a preview of another
    /// process, another predictor.
    pub(super) fn update(
        &mut self,
        preview: &mut RefinedPreview,
        input: &PredictionInput<'_>,
        health: &mut Health,
    ) -> PredictionReport {
        let PredictionInput { closed, weights, external, trust, leads } = *input;
        let weights_refused = weights.map(|weights| self.previewer.set_weights(weights).is_err());
        if weights_refused == Some(true) {
            health.set(Health::WEIGHTS_REFUSED);
        }
        let pending = if trust.alpha() > 0.0 { None } else { self.pending.take() };
        let switched = pending.is_some_and(|kind| self.previewer.choose(kind).is_ok());
        let verdict = external.and_then(|external| self.previewer.take(external, leads));
        let taken = verdict == Some(Ok(()));
        let renewed = closed || weights.is_some() || switched || taken;
        if renewed {
            self.previewer.prepare(leads, weights.is_some());
            preview.refresh(&self.previewer, leads.farthest);
        }
        if !preview.finite {
            health.set(Health::PREDICTOR_INVALID);
        }
        PredictionReport {
            switched,
            switching: self.pending.is_some(),
            weights_refused,
            history: self.previewer.history(),
            finite: preview.finite,
            replaced: taken && !closed,
            renewed,
            external: self.previewer.external(verdict),
        }
    }
}
