//! Skill: what past previews of the active predictor were worth, per lead, and how far the newest is believed because of it.
//!
//! Contract: fixed size, no allocation, total. Once per closed grid step every waiting preview is compared with where the
//! pen really is. From that follow, per lead j (steps after the newest grid point of the preview):
//!
//! - *share* w in [0, 1]: trust per step. The regression of the pen's real way since its newest sample on the predicted way:
//!   a predictor that overshoots at lead 12 is believed there only as far as it pays, and fully at lead 2. The scalar α of
//!   the paper stays above it.
//! - *mean squared errors* of the preview as it would be used, of Hold, and of constant velocity: the evidence for α.
//!
//! Lengths are divided by the running scale (RMS 10 per axis in ordinary motion), so one bad stretch counts as much as it lasted,
//! whatever the size of the writing.

mod feedback;
mod lead;
mod onset;
mod parameters;
mod shot;

pub use lead::Record;
pub use parameters::{OnsetParameters, SkillParameters};

use feedback::Feedback;
use lead::Lead;
use onset::Onset;
use shot::{Look, Shot};

use crate::predict::refine::{PHASES, REFINED_LEADS, RefineParameters, Refiner, Terms, bucket, from};
use crate::units::Stamp;

/// Leads with evidence of their own [steps]; farther ahead the last one counts.
pub const SKILL_LEADS: usize = REFINED_LEADS;
/// See the module's description.
#[derive(Debug, Clone)]
pub struct Skill {
    parameters: SkillParameters,
    /// A ring; `last` is where the newest is, `waiting` how many there are.
    shots: [Shot; SKILL_LEADS],
    last: usize,
    waiting: usize,
    /// Latest part of the step from which the newest shot wants its earlier sample: they take turns.
    turn: usize,
    leads: [Lead; SKILL_LEADS],
    refiner: Refiner,
    /// Metres per normalised unit, the newest that was told; 0 before.
    unit_m: f64,
    step_s: f64,
    feedback: Feedback,
    onset: Onset,
    /// Share of recent claims that were wrong.
    surprise: f64,
    /// Corrections and shares are used; if not, previews are judged as they are.
    per_step: bool,
}

impl Skill {
    /// Nothing seen yet; grid step `step_s` [s]. `per_step`: previews are used, and therefore judged, with corrections and
    /// shares.
    #[must_use]
    pub fn new(step_s: f64, per_step: bool) -> Self {
        Self::tuned(step_s, per_step, SkillParameters::SHIPPED, RefineParameters::SHIPPED)
    }

    /// The same with other parameters than the presets'.
    #[must_use]
    pub fn tuned(step_s: f64, per_step: bool, parameters: SkillParameters, refine: RefineParameters) -> Self {
        Self {
            parameters,
            shots: [Shot::EMPTY; SKILL_LEADS],
            last: 0,
            waiting: 0,
            turn: 0,
            leads: untried_leads(&parameters),
            refiner: Refiner::new(step_s, refine),
            unit_m: 0.0,
            step_s,
            feedback: Feedback::new(0.0),
            onset: Onset::new(parameters.onset),
            surprise: 0.0,
            per_step,
        }
    }

    /// Hold, in the record, is what standing back from the prediction really means: feedback that lags `lag_s` [s] behind the
    /// samples. Without, it is at the sample at once, as no arm is.
    #[must_use]
    pub fn beside_feedback(mut self, lag_s: f64) -> Self {
        self.feedback = Feedback::new(lag_s / self.step_s);
        self
    }

    /// Another predictor answers from here on: what was learned about the last one goes.
    pub fn forget(&mut self) {
        self.waiting = 0;
        self.leads = untried_leads(&self.parameters);
        self.refiner.forget();
        self.onset.forget();
        self.surprise = 0.0;
    }

    /// The pen was elsewhere at once: previews that wait foresaw nothing of it.
    pub fn interrupt(&mut self) {
        self.waiting = 0;
        self.refiner.interrupt();
        self.feedback.forget();
    }

    /// A grid step closed at `position` [m] after ordinary motion: judges every preview that waits. `unit_m`: metres per
    /// normalised unit.
    pub fn realise(&mut self, position: [f64; 2], unit_m: f64) {
        if !(unit_m > 0.0) {
            return;
        }
        self.unit_m = unit_m;
        self.feedback.close(position);
        self.onset.close(position, unit_m);
        for index in 0..self.waiting {
            let at = (self.last + SKILL_LEADS - index) % SKILL_LEADS;
            let Some(shot) = self.shots.get_mut(at) else { break };
            let age = shot.age;
            shot.age += 1;
            let shot = *shot;
            let Some(predicted) = shot.path.get(age) else { continue };
            if let Some(earlier) = shot.earlier {
                self.judge(&shot, age, &earlier, *predicted, position);
            }
            if let Some(judged) = self.judge(&shot, age, &shot.look, *predicted, position)
                && let Some(lead) = self.leads.get_mut(age)
            {
                lead.add(&judged, self.parameters.forgetting);
                if let Some((_, radius)) = shot.claim.filter(|(index, _)| *index == age) {
                    // As it would be used: corrections may know what the predictor does not.
                    let wrong = f64::from(u8::from(!(judged.preview.sqrt() * unit_m <= radius)));
                    self.surprise += (wrong - self.surprise) / self.parameters.surprise_cases;
                }
            }
        }
    }

    /// Learns from what the preview of `shot` had `predicted` [m] for the point `position` [m], corrected by `look`. `None`:
    /// a leap, or rest.
    fn judge(
        &mut self,
        shot: &Shot,
        age: usize,
        look: &Look,
        predicted: [f64; 2],
        position: [f64; 2],
    ) -> Option<Lead> {
        let normalised = |way: [f64; 2]| way.map(|v| v / self.unit_m);
        let ahead = (age + 1) as f64 - look.phase;
        let news = look.news.filter(|news| self.refiner.is_ordinary(news, self.unit_m));
        if look.news.is_some() && news.is_none() {
            return None;
        }
        let terms = news.map(|news| news.terms(from(predicted, look.newest), ahead).map(normalised));
        let [cx, cy] = self.correction_at(look.phase, age, terms.as_ref());
        let [rx, ry] = normalised(from(position, predicted));
        let [yx, yy] = normalised(from(position, look.newest));
        let (dx, dy) = (yx - (rx - cx), yy - (ry - cy));
        // What is not a number is not ordinary either.
        let most = self.parameters.leap * (ahead + 0.5);
        let ordinary =
            [rx, ry, yx, yy, dx, dy].iter().chain(terms.iter().flatten().flatten()).all(|v| v.abs() <= most);
        if !ordinary || [yx, yy, dx, dy].into_iter().all(|v| v.abs() < self.parameters.rest) {
            return None;
        }
        let share = self.share(age + 1);
        self.onset.judged(look.moved, [share * dx, share * dy], [yx, yy], ahead);
        let [hx, hy] = normalised(from(position, look.held));
        let [vx, vy] = normalised(shot.velocity).map(|v| v * ahead);
        if let Some(terms) = &terms {
            self.refiner.learn(look.phase, age, terms, [rx, ry], ahead);
        }
        Some(Lead {
            preview: square(yx - share * dx, yy - share * dy),
            // Nobody bounded the velocity, nor what came before; a minimum with a number is a number.
            hold: square(hx, hy).min(2.0 * most * most),
            steady: square(yx - vx, yy - vy).min(2.0 * most * most),
            real: square(yx, yy),
            along: yx * dx + yy * dy,
            way: square(dx, dy),
            cases: 1.0,
        })
    }

    /// The predictor says of the newest preview that `lead` ≥ 1 steps after its base the pen will be within `radius` [m] of it in nine of
    /// ten cases.
    pub fn claim(&mut self, lead: usize, radius: f64) {
        if let Some(shot) = self.shots.get_mut(self.last).filter(|_| self.waiting > 0) {
            shot.claim = lead.checked_sub(1).map(|index| (index, radius));
        }
    }

    /// A new preview: `path` [m] after the grid point at `base` [m], which was reached by `velocity` [m per step].
    pub fn shoot(&mut self, base: [f64; 2], velocity: [f64; 2], path: &[[f64; 2]]) {
        self.last = (self.last + 1) % SKILL_LEADS;
        self.turn = (self.turn + 1) % PHASES;
        let held = self.feedback.tool(base, 0.0);
        let Some(shot) = self.shots.get_mut(self.last) else { return };
        *shot = Shot {
            look: Look { newest: base, held, moved: self.onset.moved(), ..Shot::EMPTY.look },
            velocity,
            ..Shot::EMPTY
        };
        let mut last = base;
        let mut given = path.iter();
        for slot in &mut shot.path {
            last = given.next().copied().unwrap_or(last);
            *slot = last;
        }
        self.waiting = (self.waiting + 1).min(SKILL_LEADS);
    }

    /// A sample at `stamp` and `position` [m]: the pen's velocity and acceleration are known from the first preview on only if
    /// every sample is told. The same sample may be told again.
    pub fn observe(&mut self, stamp: Stamp, position: [f64; 2]) {
        if self.refiner.observe(stamp, position) {
            self.waiting = 0;
        }
    }

    /// A sample at `stamp` and `position` [m], `phase` of a step after the newest grid point, where the preview had `expected`.
    /// The same sample may be told again.
    pub fn sample(&mut self, stamp: Stamp, position: [f64; 2], phase: f64, expected: [f64; 2]) {
        self.observe(stamp, position);
        let news = self.refiner.hear(position, expected);
        // Previews that are taken as they are know of nothing newer than their base, and neither may their yardsticks.
        let held = self.feedback.tool(position, phase);
        let usable = self.waiting > 0 && phase.is_finite() && self.per_step;
        let Some(shot) = self.shots.get_mut(self.last).filter(|_| usable) else { return };
        let last = bucket(shot.look.phase);
        let wanted = shot.earlier.is_none() || last <= self.turn;
        if shot.look.news.is_some() && last < bucket(phase) && wanted {
            shot.earlier = Some(shot.look);
        }
        let moved = self.onset.moved();
        shot.look = Look { newest: position, held, moved, phase: phase.clamp(0.0, 1.0), news: Some(news) };
    }

    /// Where the preview that had `predicted` [m] at `lead` ≥ 1 steps is believed to be, after the newest sample at `phase`:
    /// where that sample is, if it leapt.
    #[must_use]
    pub fn believed(&self, phase: f64, lead: usize, predicted: [f64; 2]) -> [f64; 2] {
        let (newest, news) = (self.refiner.newest(), self.refiner.news());
        let left = from(predicted, newest);
        if self.per_step
            && self.unit_m > 0.0
            && news.is_some_and(|news| !self.refiner.is_ordinary(&news, self.unit_m))
        {
            return newest;
        }
        let ahead = lead as f64 - phase;
        let terms = news.map(|news| news.terms(left, ahead));
        let index = lead.saturating_sub(1).min(SKILL_LEADS - 1);
        let [cx, cy] = self.correction_at(phase, index, terms.as_ref());
        let ([lx, ly], [x, y], share) = (left, newest, self.share(lead) * self.begun());
        [x + share * (lx + cx), y + share * (ly + cy)]
    }

    /// w at `lead` ≥ 1 steps.
    #[must_use]
    pub fn share(&self, lead: usize) -> f64 {
        if !self.per_step {
            return 1.0;
        }
        let index = lead.saturating_sub(1).min(SKILL_LEADS - 1);
        self.leads.get(index).map_or(0.0, |lead| lead.share((index + 1) as f64, self.parameters.doubt))
    }

    /// The arm followed a fresh plan in motion for `dt_ns`, at its limits (joints, acceleration or speed) or not; `None`: it did not.
    pub fn drove(&mut self, at_limit: Option<bool>, dt_ns: u64) {
        if let Some(at_limit) = at_limit {
            self.onset.drove(at_limit, dt_ns);
        }
    }

    /// Part of it that is left now, because the pen has hardly begun to move. Previews are judged without: what is kept back at first
    /// says nothing about them.
    fn begun(&self) -> f64 {
        if self.per_step { self.onset.belief() } else { 1.0 }
    }

    /// Sums over the leads `first` to `last` [steps].
    #[must_use]
    pub fn record(&self, first: usize, last: usize) -> Record {
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

    fn correction_at(&self, phase: f64, index: usize, terms: Option<&Terms>) -> [f64; 2] {
        match terms {
            Some(terms) if self.per_step => self.refiner.correction(phase, index, terms),
            _ => [0.0; 2],
        }
    }
}

fn untried_leads(parameters: &SkillParameters) -> [Lead; SKILL_LEADS] {
    std::array::from_fn(|index| Lead::untried((index + 1) as f64, parameters))
}

fn square(x: f64, y: f64) -> f64 {
    x * x + y * y
}
