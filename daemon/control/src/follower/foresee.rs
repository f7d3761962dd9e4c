//! The stages that look ahead: trust in what was predicted before, the preview, and what newer samples make of it.

use super::Follower;
use super::io::Health;
use super::see::PenNews;
use crate::predict::OnlineWeights;
use crate::trust::{TrustInputs, TrustReport, TrustRequest};

/// Leads whose record decides, from the first that the plan looks at: what comes later weighs little in a plan that is made
/// anew in every tick.
const LEADS_JUDGED: usize = 2;

/// How long a refused set of weights counts against the learner, unless a sound one follows: the memory of the record.
const LEARNER_DOUBT_NS: u64 = 5_000_000_000;

/// Trust after one tick, and whether another predictor took over.
pub(super) struct Believed {
    pub(super) report: TrustReport,
    pub(super) switched: bool,
}

impl<const N: usize, const J: usize> Follower<N, J> {
    /// Takes over weights that the learner promoted.
    pub(super) fn adopt(&mut self, weights: Option<&OnlineWeights>, health: &mut Health) {
        let Some(weights) = weights else { return };
        self.learner_doubt_ns = 0;
        if self.previewer.set_weights(weights).is_err() {
            health.set(Health::WEIGHTS_REFUSED);
            self.learner_doubt_ns = LEARNER_DOUBT_NS;
        }
    }

    /// Trust after the previews that were judged so far. At α = 0 another predictor takes over, if one waits.
    pub(super) fn believe(&mut self, pen: &PenNews) -> Believed {
        let nearest = self.nearest_lead();
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
                record: self.skill.record(nearest, nearest + LEADS_JUDGED - 1),
            },
            self.settings.period_ns,
        );
        self.learner_doubt_ns = self.learner_doubt_ns.saturating_sub(self.settings.period_ns);
        let mut switched = false;
        if report.alpha.alpha() <= 0.0
            && let Some(kind) = self.pending_predictor.take()
        {
            switched = self.previewer.choose(kind).is_ok();
            self.learner_doubt_ns = 0;
        }
        Believed { report, switched }
    }

    /// Rolls the predictor out anew; a preview from a new grid point will be judged.
    pub(super) fn predict(&mut self, pen: &PenNews, switched: bool) {
        let steps = self.settings.steps_for(N, self.dead_time.ns());
        self.preview.refresh(&self.previewer, steps);
        if switched {
            self.skill.forget();
        }
        if pen.count > 0 {
            let velocity = self.previewer.newest().map_or([0.0; 2], |step| step.displacement);
            self.skill.shoot(self.preview.base_position(), velocity, self.preview.predicted());
            let nearest = self.nearest_lead();
            if let Some(radius) = self.preview.claimed(nearest) {
                self.skill.claim(nearest, radius);
            }
        }
    }

    /// Moves the preview by what the newest sample says, and shortens it to the shares that past previews justify.
    pub(super) fn refine(&mut self, health: &mut Health) {
        if let Some(newest) = self.pen.newest() {
            let per_step =
                self.settings.trust.per_step && !matches!(self.trust_request, TrustRequest::Manual(_));
            self.skill.observe(newest.stamp, newest.position);
            self.preview.correct(&newest, &mut self.skill, per_step);
        }
        if !self.preview.is_finite() {
            health.set(Health::PREDICTOR_INVALID);
        }
    }
}
