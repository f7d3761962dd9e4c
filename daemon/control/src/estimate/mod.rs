//! What a preview is worth: how good past ones were (`skill`), and what samples newer than the grid change
//! (`refine`).
//!
//! Contract: fixed size, no allocation after construction, total. In a tick `Estimate::update` comes after
//! the prediction, `Estimate::refine` after that.

pub mod refine;
pub mod skill;

use crate::pen::PenReading;
use crate::predict::LearnStep;
use crate::state::state;
use refine::{RefineParameters, RefinedPreview, Refiner};
use skill::{NewPreview, SKILL_LEADS, Skill, SkillParameters, SkillReport};

/// The record of past previews and the corrections of the newest.
#[derive(Debug)]
pub(crate) struct Estimate {
    skill: Box<Skill>,
    refiner: Box<Refiner>,
    leads_judged: usize,
}

state! { [] Estimate { skill, refiner } fixed { leads_judged } }

impl Estimate {
    /// Without evidence, on a grid of `step_ns` \[ns\]; Hold lags `feedback_lag_s` \[s\] behind the samples.
    /// Previews are judged `per_step` if they are used so ([`Skill::new`]), over the first `leads_judged`
    /// leads that the plan uses.
    pub(crate) fn new(
        step_ns: u64,
        per_step: bool,
        leads_judged: usize,
        feedback_lag_s: f64,
        skill: SkillParameters,
        refine: RefineParameters,
    ) -> Self {
        let step_s = step_ns as f64 * 1e-9;
        let skill = Skill::tuned(step_s, per_step, skill).beside_feedback(feedback_lag_s);
        let leads_judged = leads_judged.clamp(1, SKILL_LEADS);
        Self { skill: Box::new(skill), refiner: Box::new(Refiner::tuned(step_s, refine)), leads_judged }
    }

    /// Judges past previews by the grid steps that `closed`, and records the `preview` that was made from
    /// them. `switched`: by another predictor than the past ones. Returns what previews are worth, from the
    /// `nearest` lead that the plan uses on.
    pub(crate) fn update(
        &mut self,
        closed: &[LearnStep],
        switched: bool,
        preview: &RefinedPreview,
        nearest: usize,
    ) -> SkillReport {
        self.skill.judge(&mut self.refiner, closed);
        if switched {
            self.skill.forget();
            self.refiner.forget();
        }
        if !closed.is_empty() {
            self.skill.record_preview(&NewPreview {
                base: preview.base_position(),
                velocity: preview.velocity,
                path: preview.predicted(),
                claim: preview.band(nearest as f64).map(|radius| (nearest, radius)),
            });
        }
        self.skill.report(nearest, nearest + self.leads_judged - 1)
    }

    /// Corrects `preview` by the `newest` sample and shrinks it to the `shares` that past previews justify;
    /// without shares it is used as it is.
    pub(crate) fn refine(
        &mut self,
        preview: &mut RefinedPreview,
        newest: Option<&PenReading>,
        shares: Option<&[f64; SKILL_LEADS]>,
    ) {
        let Some(newest) = newest else { return };
        self.refiner.observe(newest.stamp, newest.position);
        if let Some(refinement) = preview.refine(newest, &self.refiner, shares) {
            self.skill.record_refinement(&self.refiner, &refinement);
        }
    }

    /// See [`Skill::record_motion`]; `None`: the arm did not follow a fresh plan in motion.
    pub(crate) fn record_motion(&mut self, at_limit: Option<bool>, driven_ns: u64) {
        if let Some(at_limit) = at_limit {
            self.skill.record_motion(at_limit, driven_ns);
        }
    }
}
