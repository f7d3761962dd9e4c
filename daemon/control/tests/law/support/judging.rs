//! `Judge`: the skill and its refiner, driven event by event as a follower drives them tick by tick.

use foretrace_control::pen::Motion;
use foretrace_control::predict::refine::{Look, RefineParameters, Refiner};
use foretrace_control::skill::{Closed, Foreseen, Happened, Record, SKILL_LEADS, Skill};
use foretrace_control::units::Stamp;

/// Base, velocity and path.
type Made = ([f64; 2], [f64; 2], Vec<[f64; 2]>);

/// Skill, refiner and the pending event, which is learned at the next one.
#[derive(Clone)]
pub(crate) struct Judge {
    skill: Skill,
    refiner: Refiner,
    made: Option<Made>,
    look: Option<Look>,
    /// The newest look, for corrected positions.
    newest: Look,
    per_step: bool,
}

impl Judge {
    pub(crate) fn new(step_s: f64, per_step: bool) -> Self {
        Self {
            skill: Skill::new(step_s, per_step),
            refiner: Refiner::new(step_s),
            made: None,
            look: None,
            newest: Look::at([0.0; 2]),
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

    pub(crate) fn drove(&mut self, at_limit: Option<bool>, driven_ns: u64) {
        self.learn(&[], at_limit, driven_ns);
    }

    pub(crate) fn realise(&mut self, position: [f64; 2], unit_m: f64) {
        self.learn(&[Closed { motion: Motion::Continues, position, unit_m }], None, 0);
    }

    pub(crate) fn interrupt(&mut self) {
        self.learn(&[Closed::default()], None, 0);
    }

    pub(crate) fn shoot(&mut self, base: [f64; 2], velocity: [f64; 2], path: &[[f64; 2]]) {
        self.learn(&[], None, 0);
        self.made = Some((base, velocity, path.to_vec()));
    }

    pub(crate) fn sample(&mut self, stamp: Stamp, position: [f64; 2], phase: f64, expected: [f64; 2]) {
        if self.look.is_some() {
            self.learn(&[], None, 0);
        }
        self.refiner.observe(stamp, position);
        self.newest = self.refiner.hear(position, phase, expected);
        self.look = Some(self.newest);
    }

    /// The corrected position at `lead` of the preview that `predicted`, after the newest sample.
    pub(crate) fn believed(&self, lead: usize, predicted: [f64; 2]) -> [f64; 2] {
        if !self.per_step {
            return predicted;
        }
        let share = self.told().skill.report(1, 1).believed()[lead.clamp(1, SKILL_LEADS) - 1];
        self.refiner.refined(&self.newest, lead, predicted, share)
    }

    pub(crate) fn share(&self, lead: usize) -> f64 {
        self.told().skill.report(1, 1).shares[lead.clamp(1, SKILL_LEADS) - 1]
    }

    pub(crate) fn record(&self, first: usize, last: usize) -> Record {
        self.told().skill.report(first, last).record
    }

    /// With all events learned.
    fn told(&self) -> Self {
        let mut told = self.clone();
        told.learn(&[], None, 0);
        told
    }

    fn learn(&mut self, closed: &[Closed], at_limit: Option<bool>, driven_ns: u64) {
        let (made, look) = (self.made.take(), self.look.take());
        let preview = made.as_ref().map(|(base, velocity, path)| Foreseen {
            base: *base,
            velocity: *velocity,
            path,
            claim: None,
        });
        let happened = Happened { preview, look, at_limit, driven_ns, closed };
        self.skill.learn(&mut self.refiner, &happened);
    }
}
