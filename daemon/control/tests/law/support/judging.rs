//! `Judge`: the record of previews and its refiner, driven event by event as a follower drives them tick by
//! tick.

use foretrace_control::estimate::record::{NewPreview, PreviewRecord, Record};
use foretrace_control::estimate::refine::{RefinePrior, Refinement, Refiner};
use foretrace_control::estimate::{LEADS, LawParameters};
use foretrace_control::pen::Motion;
use foretrace_control::predict::LearnStep;
use foretrace_control::units::Stamp;

/// The record and its refiner.
#[derive(Clone)]
pub(crate) struct Judge {
    record: PreviewRecord,
    refiner: Refiner,
    /// The newest refinement, for corrected positions.
    newest: Refinement,
    per_step: bool,
    saturated: f64,
}

impl Judge {
    pub(crate) fn new(step_s: f64, per_step: bool) -> Self {
        Self {
            record: PreviewRecord::new(step_s, per_step),
            refiner: Refiner::new(step_s),
            newest: Refinement::at([0.0; 2]),
            per_step,
            saturated: 1.0,
        }
    }

    /// With given parameters, and weights of corrections for a new hand.
    pub(crate) fn tuned(step_s: f64, law: &LawParameters, prior: &RefinePrior) -> Self {
        let record = PreviewRecord::tuned(step_s, true, law);
        Self { record, refiner: Refiner::tuned(step_s, law, prior), ..Self::new(step_s, true) }
    }

    pub(crate) fn forget(&mut self) {
        self.record.forget();
        self.refiner.forget();
    }

    /// The arm is saturated in this share of its motion, at first in all of it.
    pub(crate) fn saturate(&mut self, share: f64) {
        self.saturated = share;
    }

    pub(crate) fn realise(&mut self, position: [f64; 2], scale_m: f64) {
        let closed = LearnStep { motion: Motion::Continues, position, scale_m, ..LearnStep::default() };
        self.record.judge(&mut self.refiner, &[closed]);
    }

    pub(crate) fn interrupt(&mut self) {
        self.record.judge(&mut self.refiner, &[LearnStep::default()]);
    }

    pub(crate) fn preview(&mut self, base: [f64; 2], path: &[[f64; 2]]) {
        self.record.record_preview(&NewPreview { base, path });
    }

    pub(crate) fn sample(&mut self, stamp: Stamp, position: [f64; 2], phase: f64, expected: [f64; 2]) {
        self.refiner.observe(stamp, position);
        self.newest = self.refiner.refinement(position, phase, expected);
        self.record.record_refinement(&self.refiner, &self.newest);
    }

    /// The corrected position at `lead` of the preview that `predicted`, after the newest sample.
    pub(crate) fn believed(&self, lead: usize, predicted: [f64; 2]) -> [f64; 2] {
        if !self.per_step {
            return predicted;
        }
        let share = self.record.report(1, 1, self.saturated).believed()[lead.clamp(1, LEADS) - 1];
        self.refiner.refined(&self.newest, lead, predicted, share)
    }

    pub(crate) fn share(&self, lead: usize) -> f64 {
        self.record.report(1, 1, self.saturated).shares[lead.clamp(1, LEADS) - 1]
    }

    pub(crate) fn record(&self, first: usize, last: usize) -> Record {
        self.record.report(first, last, self.saturated).record
    }
}
