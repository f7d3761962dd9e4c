//! Skill: how good past previews of the active predictor were, per lead, and how far the newest is trusted
//! because of it.
//!
//! Contract: fixed size, no allocation, total. A preview and its refinements are recorded when they are made
//! ([`Skill::record_preview`], [`Skill::record_refinement`]); once per closed grid step every pending preview
//! is compared with the pen's real position ([`Skill::judge`]). This gives, per lead j (steps after the
//! newest grid point of the preview):
//!
//! - *share* w in [0, 1]: trust per step. The regression of the pen's real displacement since its newest
//!   sample on the predicted displacement: a predictor that overshoots at lead 12 is shortened there and used
//!   fully at lead 2. The scalar α of the paper is applied on top.
//! - *mean squared errors* of the preview as it would be used, of Hold, and of constant velocity: the
//!   evidence for α.
//!
//! Lengths are divided by the running scale (RMS 10 per axis in ordinary motion), so a bad stretch counts by
//! its duration, whatever the size of the writing.

mod feedback;
mod lead;
mod onset;
mod parameters;
mod pending;

use crate::state::state;
pub use lead::Record;
pub use parameters::{OnsetParameters, SkillParameters};

use feedback::Feedback;
use lead::LeadRecord;
use onset::Onset;
use pending::{PendingPreview, PendingRefinement};

use crate::estimate::refine::{BlendTerms, PHASES, REFINED_LEADS, Refinement, Refiner, bucket, from};
use crate::pen::{Motion, rests};
use crate::predict::LearnStep;

/// Leads with a record of their own \[steps\]; farther leads use the last one.
pub const SKILL_LEADS: usize = REFINED_LEADS;

/// A preview as it was made.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NewPreview<'a> {
    /// The newest grid point \[m\].
    pub base: [f64; 2],
    /// The displacement that led to it \[m per step\], which constant velocity repeats.
    pub velocity: [f64; 2],
    /// Predicted positions \[m\], the first one step after the base.
    pub path: &'a [[f64; 2]],
    /// Lead ≥ 1 and radius \[m\] of the band that the predictor claims: within it in nine of ten cases.
    pub claim: Option<(usize, f64)>,
}

/// How far previews are trusted, and the record behind it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SkillReport {
    /// w per lead from 1 \[1\]; 1 where previews are used as they are.
    pub shares: [f64; SKILL_LEADS],
    /// Factor on it while the pen begins to move \[1\].
    pub begun: f64,
    /// Sums over the leads asked for.
    pub record: Record,
}

impl SkillReport {
    /// Trust in each step of the preview now \[1\].
    #[must_use]
    pub fn believed(&self) -> [f64; SKILL_LEADS] {
        self.shares.map(|share| share * self.begun)
    }
}

/// The record of all leads and the pending previews.
#[derive(Debug, Clone)]
pub struct Skill {
    parameters: SkillParameters,
    /// A ring; `last` is where the newest is, `waiting` how many there are.
    pending: [PendingPreview; SKILL_LEADS],
    last: usize,
    waiting: usize,
    /// Latest phase at which the newest preview takes its earlier sample: phases take turns.
    turn: usize,
    leads: [LeadRecord; SKILL_LEADS],
    /// Records of the leads.
    shares: [f64; SKILL_LEADS],
    /// Clarity of the filter by which pending previews were refined.
    clarity: f64,
    step_s: f64,
    feedback: Feedback,
    onset: Onset,
    /// Share of recent claims that were wrong.
    surprise: f64,
    /// Whether corrections and shares are used; if not, previews are judged as they are.
    per_step: bool,
}

state! {
    [] Skill { pending, last, waiting, turn, leads, shares, clarity, feedback, onset, surprise }
    fixed { parameters, step_s, per_step }
}

impl Skill {
    /// Without evidence; grid step `step_s` \[s\]. `per_step`: previews are used, and therefore judged, with
    /// corrections and shares.
    #[must_use]
    pub fn new(step_s: f64, per_step: bool) -> Self {
        Self::tuned(step_s, per_step, SkillParameters::SHIPPED)
    }

    /// The same with given parameters.
    #[must_use]
    pub fn tuned(step_s: f64, per_step: bool, parameters: SkillParameters) -> Self {
        let mut skill = Self {
            parameters,
            pending: [PendingPreview::EMPTY; SKILL_LEADS],
            last: 0,
            waiting: 0,
            turn: 0,
            leads: untried_leads(&parameters),
            shares: [1.0; SKILL_LEADS],
            clarity: 0.0,
            step_s,
            feedback: Feedback::new(0.0),
            onset: Onset::new(parameters.onset),
            surprise: 0.0,
            per_step,
        };
        skill.share_out();
        skill
    }

    /// The record's Hold is feedback that lags `lag_s` \[s\] behind the samples. Without this call it has no
    /// lag, which no arm achieves.
    #[must_use]
    pub fn beside_feedback(mut self, lag_s: f64) -> Self {
        self.feedback = Feedback::new(lag_s / self.step_s);
        self
    }

    /// Another predictor is active from now on: forgets what was learned about the last one.
    pub fn forget(&mut self) {
        self.waiting = 0;
        self.leads = untried_leads(&self.parameters);
        self.onset.forget();
        self.surprise = 0.0;
        self.share_out();
    }

    /// Judges pending previews by the grid steps that `closed`; `refiner` learns how good its corrections
    /// were.
    pub fn judge(&mut self, refiner: &mut Refiner, closed: &[LearnStep]) {
        self.follow_filter(refiner);
        for step in closed {
            match step.motion {
                Motion::Continues => self.judge_pending(refiner, step.position, step.scale_m),
                Motion::Start | Motion::Jump => {
                    self.waiting = 0;
                    refiner.interrupt();
                    self.feedback.forget();
                }
            }
        }
    }

    /// Drops pending previews when another filter is selected: they carry velocities of the last one.
    fn follow_filter(&mut self, refiner: &Refiner) {
        if refiner.clarity() != self.clarity {
            self.clarity = refiner.clarity();
            self.waiting = 0;
        }
    }

    /// The arm followed a fresh plan in motion for `driven_ns` \[ns\], saturated (joints, acceleration or
    /// speed) or not.
    pub fn record_motion(&mut self, at_limit: bool, driven_ns: u64) {
        self.onset.record_motion(at_limit, driven_ns);
    }

    /// How far previews are trusted, with the record of the leads `first` to `last` \[steps\].
    #[must_use]
    pub fn report(&self, first: usize, last: usize) -> SkillReport {
        // Previews are judged without `begun`: the initial reduction says nothing about them.
        let begun = if self.per_step { self.onset.belief() } else { 1.0 };
        SkillReport { shares: self.shares, begun, record: self.record(first, last) }
    }

    /// A grid step closed at `position` \[m\] after ordinary motion: judges every pending preview.
    fn judge_pending(&mut self, refiner: &mut Refiner, position: [f64; 2], unit_m: f64) {
        if !(unit_m > 0.0) {
            return;
        }
        refiner.measure(unit_m);
        self.feedback.close(position);
        self.onset.close(position, unit_m);
        for index in 0..self.waiting {
            let at = (self.last + SKILL_LEADS - index) % SKILL_LEADS;
            let Some(preview) = self.pending.get_mut(at) else { break };
            let age = preview.age;
            preview.age += 1;
            let preview = *preview;
            let Some(predicted) = preview.path.get(age) else { continue };
            if let Some(earlier) = preview.earlier {
                self.judge_refined(refiner, &preview, age, &earlier, *predicted, position);
            }
            if let Some(judged) =
                self.judge_refined(refiner, &preview, age, &preview.last, *predicted, position)
                && let Some(lead) = self.leads.get_mut(age)
            {
                lead.add(&judged, self.parameters.forgetting);
                if let Some((_, radius)) = preview.claim.filter(|(index, _)| *index == age) {
                    // As it would be used: corrections may know what the predictor does not.
                    let wrong = f64::from(u8::from(!(judged.preview.sqrt() * unit_m <= radius)));
                    self.surprise += (wrong - self.surprise) / self.parameters.surprise_cases;
                }
            }
        }
        self.share_out();
    }

    /// Learns from the difference between the point that `preview` `predicted` \[m\], as it was refined, and
    /// the real `position` \[m\]. `None`: a jump, or rest.
    fn judge_refined(
        &mut self,
        refiner: &mut Refiner,
        preview: &PendingPreview,
        age: usize,
        refined: &PendingRefinement,
        predicted: [f64; 2],
        position: [f64; 2],
    ) -> Option<LeadRecord> {
        let unit_m = refiner.unit_m();
        let normalised = |way: [f64; 2]| way.map(|v| v / unit_m);
        let Refinement { newest, phase, motion } = refined.refinement;
        let ahead = (age + 1) as f64 - phase;
        let usable = motion.filter(|motion| refiner.is_ordinary(motion));
        if motion.is_some() && usable.is_none() {
            return None;
        }
        let terms = usable.map(|motion| motion.terms(from(predicted, newest), ahead).map(normalised));
        let [cx, cy] = self.correction_at(refiner, phase, age, terms.as_ref());
        let [rx, ry] = normalised(from(position, predicted));
        let [yx, yy] = normalised(from(position, newest));
        let (dx, dy) = (yx - (rx - cx), yy - (ry - cy));
        // NaN is not ordinary motion either.
        let most = self.parameters.leap * (ahead + 0.5);
        let ordinary =
            [rx, ry, yx, yy, dx, dy].iter().chain(terms.iter().flatten().flatten()).all(|v| v.abs() <= most);
        if !ordinary || (rests([yx, yy]) && rests([dx, dy])) {
            return None;
        }
        let share = self.shares.get(age).copied().unwrap_or(0.0);
        self.onset.judged(refined.moved, [share * dx, share * dy], [yx, yy], ahead);
        let [hx, hy] = normalised(from(position, refined.held));
        let [vx, vy] = normalised(preview.velocity).map(|v| v * ahead);
        if let Some(terms) = &terms {
            refiner.learn(phase, age, terms, [rx, ry], ahead);
        }
        Some(LeadRecord {
            preview: square(yx - share * dx, yy - share * dy),
            // The velocity may be non-finite; `min` with a number gives a number.
            hold: square(hx, hy).min(2.0 * most * most),
            steady: square(yx - vx, yy - vy).min(2.0 * most * most),
            real: square(yx, yy),
            along: yx * dx + yy * dy,
            way: square(dx, dy),
            cases: 1.0,
        })
    }

    /// A preview was made; it is judged when grid steps close.
    pub fn record_preview(&mut self, made: &NewPreview<'_>) {
        self.last = (self.last + 1) % SKILL_LEADS;
        self.turn = (self.turn + 1) % PHASES;
        let held = self.feedback.tool(made.base, 0.0);
        let Some(preview) = self.pending.get_mut(self.last) else { return };
        let refinement = Refinement::at(made.base);
        *preview = PendingPreview {
            last: PendingRefinement { refinement, held, moved: self.onset.moved() },
            velocity: made.velocity,
            claim: made.claim.and_then(|(lead, radius)| Some((lead.checked_sub(1)?, radius))),
            ..PendingPreview::EMPTY
        };
        let mut last = made.base;
        let mut given = made.path.iter();
        for slot in &mut preview.path {
            last = given.next().copied().unwrap_or(last);
            *slot = last;
        }
        self.waiting = (self.waiting + 1).min(SKILL_LEADS);
    }

    /// A newer sample refined the newest preview.
    pub fn record_refinement(&mut self, refiner: &Refiner, refinement: &Refinement) {
        self.follow_filter(refiner);
        // Unrefined previews know nothing newer than their base, and their baselines must not either.
        let held = self.feedback.tool(refinement.newest, refinement.phase);
        let usable = self.waiting > 0 && refinement.phase.is_finite() && self.per_step;
        let Some(preview) = self.pending.get_mut(self.last).filter(|_| usable) else { return };
        let last = bucket(preview.last.refinement.phase);
        let wanted = preview.earlier.is_none() || last <= self.turn;
        let refined = preview.last.refinement.motion.is_some();
        if refined && last < bucket(refinement.phase) && wanted {
            preview.earlier = Some(preview.last);
        }
        let refinement = Refinement { phase: refinement.phase.clamp(0.0, 1.0), ..*refinement };
        preview.last = PendingRefinement { refinement, held, moved: self.onset.moved() };
    }

    fn record(&self, first: usize, last: usize) -> Record {
        let first = first.clamp(1, SKILL_LEADS);
        let count = last.clamp(first, SKILL_LEADS) + 1 - first;
        let mut record = Record { surprise: self.surprise, ..Record::default() };
        for lead in self.leads.iter().skip(first - 1).take(count) {
            record.preview += lead.preview;
            record.hold += lead.hold;
            record.steady += lead.steady;
            record.cases = record.cases.max(lead.cases);
        }
        record
    }

    fn share_out(&mut self) {
        if self.per_step {
            let doubt = self.parameters.doubt;
            for (index, (share, lead)) in self.shares.iter_mut().zip(&self.leads).enumerate() {
                *share = lead.share((index + 1) as f64, doubt);
            }
        }
    }

    fn correction_at(
        &self,
        refiner: &Refiner,
        phase: f64,
        index: usize,
        terms: Option<&BlendTerms>,
    ) -> [f64; 2] {
        if self.per_step { refiner.correction(phase, index, terms) } else { [0.0; 2] }
    }
}

fn untried_leads(parameters: &SkillParameters) -> [LeadRecord; SKILL_LEADS] {
    std::array::from_fn(|index| LeadRecord::untried((index + 1) as f64, parameters))
}

fn square(x: f64, y: f64) -> f64 {
    x * x + y * y
}
