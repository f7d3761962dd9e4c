//! The trust: who decides it, and on what evidence of this tick and of past ones.

use super::io::Health;
use super::motion::{Gap, MotionReport};
use super::plans::PlanRecord;
use super::predict::PredictionReport;
use super::settings::{FollowerError, FollowerSettings, Lookahead};
use crate::estimate::skill::Record;
use crate::state::state;
use crate::trust::{Outcome, TrustControl, TrustInputs, TrustReport, TrustRequest};
use crate::units::{Stamp, Trust};

/// The trust control, and what it remembers of past ticks.
#[derive(Debug)]
pub(super) struct TrustStage {
    control: TrustControl,
    request: TrustRequest,
    plans: PlanRecord,
    /// See [`TrustInputs::overtaxed`].
    overtaxed: Option<bool>,
    outcome: Box<Outcome>,
    /// How long the learner is not trusted after one of its sets was refused \[ns\]; by then the record
    /// judges the set in force.
    learner_doubt_ns: u64,
    longest_doubt_ns: u64,
    period_ns: u64,
    per_step: bool,
}

state! {
    [] TrustStage { control, request, plans, overtaxed, outcome, learner_doubt_ns }
    fixed { longest_doubt_ns, period_ns, per_step }
}

/// What one tick knows about the preview.
#[derive(Clone, Copy)]
pub(super) struct Evidence {
    /// The arm is to move with the pen.
    pub(super) follows: bool,
    /// Age of the newest pen sample \[ns\]; `None` before the first.
    pub(super) pen_age_ns: Option<u64>,
    /// A jump was among the steps that closed.
    pub(super) jumped: bool,
    pub(super) predicted: PredictionReport,
    pub(super) record: Record,
}

impl TrustStage {
    /// Feedback alone lags `feedback_lag_s` \[s\] behind the samples.
    pub(super) fn new<const J: usize>(
        settings: &FollowerSettings<J>,
        feedback_lag_s: f64,
    ) -> Result<Self, FollowerError> {
        let (period_ns, parameters) = (settings.period_ns, &settings.trust.parameters);
        // The tool is the command's; a plan that models the servo puts that ahead of the arm.
        let outcome = Outcome::new(period_ns, feedback_lag_s - settings.mpc.servo_s, parameters);
        Ok(Self {
            control: TrustControl::new(settings.trust)?,
            request: settings.trust_request,
            plans: PlanRecord::new(period_ns, parameters),
            overtaxed: None,
            outcome: Box::new(outcome),
            learner_doubt_ns: 0,
            longest_doubt_ns: (parameters.learner_doubt_s * 1e9) as u64,
            period_ns,
            per_step: settings.trust.per_step,
        })
    }

    /// α after the last update.
    pub(super) fn alpha(&self) -> Trust {
        self.control.alpha()
    }

    /// Previews are corrected and trusted step by step, not as a whole.
    pub(super) fn per_step(&self) -> bool {
        self.per_step && !matches!(self.request, TrustRequest::Manual(_))
    }

    /// An operator changes who decides.
    pub(super) fn request(&mut self, request: TrustRequest) {
        self.request = request;
    }

    /// The loop takes charge of an arm: refused weights of before do not count.
    pub(super) fn begin(&mut self) {
        self.learner_doubt_ns = 0;
    }

    /// Moves the trust towards what the evidence justifies.
    pub(super) fn update(&mut self, evidence: &Evidence, ahead: &Lookahead) -> TrustReport {
        let Evidence { follows, pen_age_ns, jumped, predicted, record } = *evidence;
        if predicted.switched || predicted.weights_refused.is_some() {
            let refused = !predicted.switched && predicted.weights_refused == Some(true);
            self.learner_doubt_ns = if refused { self.longest_doubt_ns } else { 0 };
        }
        let inputs = TrustInputs {
            request: self.request,
            armed: follows,
            history: predicted.history,
            pen_age_ns,
            jumped,
            preview_finite: predicted.finite,
            switching: predicted.switching,
            unplanned: self.plans.stopped,
            failed: self.plans.failed,
            overtaxed: self.overtaxed,
            reaction_ns: self.outcome.reaction_ns(ahead.dead_time_ns),
            weights_refused: self.learner_doubt_ns > 0,
            record,
        };
        let report = self.control.update(&inputs, self.period_ns);
        self.learner_doubt_ns = self.learner_doubt_ns.saturating_sub(self.period_ns);
        report
    }

    /// Records what following came to: `moved`, with the newest sample at `pen` \[m\], in the workspace.
    /// `follows`: the pen was to be followed.
    pub(super) fn record<const J: usize>(
        &mut self,
        gap: &Gap<J>,
        follows: bool,
        moved: &MotionReport<J>,
        pen: Option<(Stamp, [f64; 2])>,
        ahead: &Lookahead,
        health: Health,
    ) {
        if follows {
            self.plans.add(moved.rung, health);
        }
        if gap.lost_ns > 0 {
            self.outcome.break_off();
        }
        let Some(sample) = pen.filter(|_| moved.follows) else {
            self.outcome.forget();
            self.overtaxed = None;
            return;
        };
        let [x, y, _] = moved.tool;
        self.outcome.see(gap.now, [x, y], sample, ahead.dead_time_ns);
        self.overtaxed = moved.at_limit.map(|at_limit| at_limit && self.outcome.is_poor());
    }
}
