//! The stages that look ahead: what past previews were worth, the preview, what newer samples make of it, and
//! trust in it.

use super::Follower;
use super::intake::PenNews;
use super::io::Health;
use crate::predict::OnlineWeights;
use crate::predict::refine::Look;
use crate::skill::{Foreseen, Happened, Record, SKILL_LEADS, SkillReport};
use crate::state::state;
use crate::trust::{TrustInputs, TrustReport, TrustRequest};

/// What a tick leaves for the next one to judge.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Left {
    /// A preview was made.
    made: bool,
    /// Lead and error band that the predictor claimed for that preview.
    claim: Option<(usize, f64)>,
    look: Option<Look>,
    pub(super) at_limit: Option<bool>,
}

state! { [] Left { made, claim, look, at_limit } }

impl<const N: usize, const J: usize> Follower<N, J> {
    /// Judges past previews, before a new one replaces the last.
    pub(super) fn judge_past_previews(&mut self, pen: &PenNews) {
        let Left { made, claim, look, at_limit } = std::mem::take(&mut self.left);
        let preview = made.then(|| Foreseen {
            base: self.preview.base_position(),
            velocity: self.preview.velocity(),
            path: self.preview.predicted(),
            claim,
        });
        let closed = pen.closed.get(..pen.count).unwrap_or_default();
        let happened = Happened { preview, look, at_limit, driven_ns: self.settings.period_ns, closed };
        self.skill.learn(&mut self.refiner, &happened);
    }

    /// Takes over weights that the learner promoted.
    pub(super) fn adopt(&mut self, weights: Option<&OnlineWeights>, health: &mut Health) {
        let Some(weights) = weights else { return };
        self.learner_doubt_ns = 0;
        if self.previewer.set_weights(weights).is_err() {
            health.set(Health::WEIGHTS_REFUSED);
            self.learner_doubt_ns = (self.settings.trust.parameters.learner_doubt_s * 1e9) as u64;
        }
    }

    /// Changes the predictor, if a change is pending and no part of the old preview is in use (α = 0).
    pub(super) fn switch(&mut self) -> bool {
        if self.trust.alpha().alpha() > 0.0 {
            return false;
        }
        let Some(kind) = self.pending_predictor.take() else { return false };
        self.learner_doubt_ns = 0;
        let switched = self.previewer.choose(kind).is_ok();
        if switched {
            self.skill.forget();
            self.refiner.forget();
        }
        switched
    }

    /// Computes the preview anew; one from a new grid point will be judged.
    pub(super) fn predict(&mut self, pen: &PenNews) {
        let steps = self.settings.steps_for(N, self.dead_time.ns());
        self.preview.refresh(&self.previewer, steps);
        if pen.count > 0 {
            self.left.made = true;
            let nearest = self.nearest_lead();
            self.left.claim = self.preview.band(nearest as f64).map(|radius| (nearest, radius));
        }
    }

    /// What previews of this predictor are worth, with the record of the leads that the plan looks at first.
    pub(super) fn skill(&self) -> SkillReport {
        let nearest = self.nearest_lead();
        let judged = self.settings.trust.parameters.leads_judged.clamp(1, SKILL_LEADS);
        self.skill.report(nearest, nearest + judged - 1)
    }

    /// Corrects the preview by the newest sample, and shrinks it to the shares that past previews justify.
    pub(super) fn refine(&mut self, skill: &SkillReport, health: &mut Health) {
        if let Some(newest) = self.pen.newest() {
            let per_step =
                self.settings.trust.per_step && !matches!(self.trust_request, TrustRequest::Manual(_));
            self.refiner.observe(newest.stamp, newest.position);
            let shares = per_step.then(|| skill.believed());
            self.left.look = self.preview.refine(&newest, &mut self.refiner, shares.as_ref());
        }
        if !self.preview.is_finite() {
            health.set(Health::PREDICTOR_INVALID);
        }
    }

    /// Updates the trust in the preview from the record of past ones.
    pub(super) fn believe(&mut self, pen: &PenNews, record: Record) -> TrustReport {
        let report = self.trust.update(
            &TrustInputs {
                request: self.trust_request,
                armed: self.watch.follows(),
                history: self.previewer.history(),
                pen_age_ns: pen.age_ns,
                jumped: pen.jumped,
                preview_finite: self.preview.is_finite(),
                switching: self.pending_predictor.is_some(),
                unplanned: self.plans.stopped,
                failed: self.plans.failed,
                overtaxed: self.overtaxed,
                reaction_ns: self.outcome.reaction_ns(self.dead_time.ns()),
                weights_refused: self.learner_doubt_ns > 0,
                record,
            },
            self.settings.period_ns,
        );
        self.learner_doubt_ns = self.learner_doubt_ns.saturating_sub(self.settings.period_ns);
        report
    }
}
