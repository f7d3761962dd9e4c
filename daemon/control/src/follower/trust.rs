//! The trust: who decides it, and on what evidence of this tick and of past ones.

use super::io::Rung;
use super::plans::PlanRecord;
use super::predict::PredictionReport;
use super::settings::{FollowerError, FollowerSettings};
use crate::estimate::record::Record;
use crate::state::state;
use crate::trust::{TrustControl, TrustInputs, TrustReport, TrustRequest};
use crate::units::Trust;

/// The trust control, and what it remembers of past ticks.
#[derive(Debug)]
pub(super) struct TrustStage {
    control: TrustControl,
    request: TrustRequest,
    plans: PlanRecord,
    /// How long the learner is not trusted after one of its sets was refused \[ns\]; by then the record
    /// judges the set in force.
    learner_doubt_ns: u64,
    longest_doubt_ns: u64,
    period_ns: u64,
    per_step: bool,
}

state! {
    [] TrustStage { control, request, plans, learner_doubt_ns }
    fixed { longest_doubt_ns, period_ns, per_step }
}

/// What one tick knows about the preview.
#[derive(Clone, Copy)]
pub(super) struct Evidence {
    /// The arm is to move with the pen.
    pub(super) follows: bool,
    /// Age of the newest pen sample \[ns\]; `None` before the first.
    pub(super) pen_age_ns: Option<u64>,
    pub(super) predicted: PredictionReport,
    pub(super) record: Record,
}

impl TrustStage {
    pub(super) fn new<const J: usize>(settings: &FollowerSettings<J>) -> Result<Self, FollowerError> {
        let (period_ns, law) = (settings.period_ns, &settings.law);
        Ok(Self {
            control: TrustControl::new(settings.trust, law)?,
            request: settings.trust_request,
            plans: PlanRecord::new(period_ns, law),
            learner_doubt_ns: 0,
            longest_doubt_ns: (law.memory * settings.pen.step_ns as f64) as u64,
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
    pub(super) fn update(&mut self, evidence: &Evidence) -> TrustReport {
        let Evidence { follows, pen_age_ns, predicted, record } = *evidence;
        if predicted.switched || predicted.weights_refused.is_some() {
            let refused = !predicted.switched && predicted.weights_refused == Some(true);
            self.learner_doubt_ns = if refused { self.longest_doubt_ns } else { 0 };
        }
        let inputs = TrustInputs {
            request: self.request,
            armed: follows,
            history: predicted.history,
            pen_age_ns,
            preview_finite: predicted.finite,
            switching: predicted.switching || predicted.switched,
            unplanned: self.plans.stopped,
            weights_refused: self.learner_doubt_ns > 0,
            record,
        };
        let report = self.control.update(&inputs, self.period_ns);
        self.learner_doubt_ns = self.learner_doubt_ns.saturating_sub(self.period_ns);
        report
    }

    /// The evidence decides, not an operator.
    pub(super) const fn is_automatic(&self) -> bool {
        matches!(self.request, TrustRequest::Auto)
    }

    /// Counts a tick that was to follow the pen and ended on `rung`.
    pub(super) fn record(&mut self, rung: Rung) {
        self.plans.add(rung);
    }
}
