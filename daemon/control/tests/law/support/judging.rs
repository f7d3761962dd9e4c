//! `Judge`: the skill and its refiner, driven event by event as a follower drives them tick by tick.

use foretrace_control::estimate::refine::{RefineParameters, Refinement, Refiner};
use foretrace_control::estimate::skill::{NewPreview, Record, SKILL_LEADS, Skill};
use foretrace_control::pen::Motion;
use foretrace_control::predict::LearnStep;
use foretrace_control::units::Stamp;

/// Skill and refiner.
#[derive(Clone)]
pub(crate) struct Judge {
    skill: Skill,
    refiner: Refiner,
    /// The newest refinement, for corrected positions.
    newest: Refinement,
    per_step: bool,
}

impl Judge {
    pub(crate) fn new(step_s: f64, per_step: bool) -> Self {
        Self {
            skill: Skill::new(step_s, per_step),
            refiner: Refiner::new(step_s),
            newest: Refinement::at([0.0; 2]),
            per_step,
        }
    }

    /// With given parameters of refinement.
    pub(crate) fn refining(step_s: f64, parameters: RefineParameters) -> Self {
        Self { refiner: Refiner::tuned(step_s, parameters), ..Self::new(step_s, true) }
    }

    pub(crate) fn forget(&mut self) {
        self.skill.forget();
        self.refiner.forget();
    }

    pub(crate) fn record_motion(&mut self, at_limit: Option<bool>, driven_ns: u64) {
        if let Some(at_limit) = at_limit {
            self.skill.record_motion(at_limit, driven_ns);
        }
    }

    pub(crate) fn realise(&mut self, position: [f64; 2], scale_m: f64) {
        let closed = LearnStep { motion: Motion::Continues, position, scale_m, ..LearnStep::default() };
        self.skill.judge(&mut self.refiner, &[closed]);
    }

    pub(crate) fn interrupt(&mut self) {
        self.skill.judge(&mut self.refiner, &[LearnStep::default()]);
    }

    pub(crate) fn preview(&mut self, base: [f64; 2], velocity: [f64; 2], path: &[[f64; 2]]) {
        self.skill.record_preview(&NewPreview { base, velocity, path, claim: None });
    }

    pub(crate) fn sample(&mut self, stamp: Stamp, position: [f64; 2], phase: f64, expected: [f64; 2]) {
        self.refiner.observe(stamp, position);
        self.newest = self.refiner.refinement(position, phase, expected);
        self.skill.record_refinement(&self.refiner, &self.newest);
    }

    /// The corrected position at `lead` of the preview that `predicted`, after the newest sample.
    pub(crate) fn believed(&self, lead: usize, predicted: [f64; 2]) -> [f64; 2] {
        if !self.per_step {
            return predicted;
        }
        let share = self.skill.report(1, 1).believed()[lead.clamp(1, SKILL_LEADS) - 1];
        self.refiner.refined(&self.newest, lead, predicted, share)
    }

    pub(crate) fn share(&self, lead: usize) -> f64 {
        self.skill.report(1, 1).shares[lead.clamp(1, SKILL_LEADS) - 1]
    }

    pub(crate) fn record(&self, first: usize, last: usize) -> Record {
        self.skill.report(first, last).record
    }
}
