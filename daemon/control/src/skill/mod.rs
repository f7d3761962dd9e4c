//! Skill: how good past previews of the active predictor were, per lead, and how far the newest is trusted
//! because of it.
//!
//! Contract: fixed size, no allocation, total. One call per tick learns ([`Skill::learn`]), one reports
//! ([`Skill::report`]). Once per closed grid step every pending preview is compared with the pen's real
//! position. This gives, per lead j (steps after the newest grid point of the preview):
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
mod shot;

use crate::state::state;
pub use lead::Record;
pub use parameters::{OnsetParameters, SkillParameters};

use feedback::Feedback;
use lead::Lead;
use onset::Onset;
use shot::{Shot, Sight};

use crate::pen::{Motion, rests};
use crate::predict::refine::{Look, PHASES, REFINED_LEADS, Refiner, Terms, bucket, from};

/// Leads with a record of their own \[steps\]; farther leads use the last one.
pub const SKILL_LEADS: usize = REFINED_LEADS;

/// A preview as it was made.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Foreseen<'a> {
    /// The newest grid point \[m\].
    pub base: [f64; 2],
    /// The displacement that led to it \[m per step\], which constant velocity repeats.
    pub velocity: [f64; 2],
    /// Predicted positions \[m\], the first one step after the base.
    pub path: &'a [[f64; 2]],
    /// Lead ≥ 1 and radius \[m\] of the band that the predictor claims: within it in nine of ten cases.
    pub claim: Option<(usize, f64)>,
}

/// A grid step that closed.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Closed {
    /// Continues; after a start or a jump pending previews are not judged.
    pub motion: Motion,
    /// Position of the pen \[m\].
    pub position: [f64; 2],
    /// Metres per normalised unit.
    pub unit_m: f64,
}

/// What has happened since the last call, in this order.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Happened<'a> {
    /// The preview that was made then, if one was.
    pub preview: Option<Foreseen<'a>>,
    /// The newest sample's correction of the preview in force.
    pub look: Option<Look>,
    /// The arm followed a fresh plan in motion, saturated (joints, acceleration or speed) or not; `None`: it
    /// did not.
    pub at_limit: Option<bool>,
    /// Duration of that \[ns\].
    pub driven_ns: u64,
    /// Grid steps that closed.
    pub closed: &'a [Closed],
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
    shots: [Shot; SKILL_LEADS],
    last: usize,
    waiting: usize,
    /// Latest phase at which the newest shot takes its earlier sample: phases take turns.
    turn: usize,
    leads: [Lead; SKILL_LEADS],
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
    [] Skill { shots, last, waiting, turn, leads, shares, clarity, feedback, onset, surprise }
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
            shots: [Shot::EMPTY; SKILL_LEADS],
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

    /// Learns from what happened, and teaches `refiner` how good its corrections were.
    pub fn learn(&mut self, refiner: &mut Refiner, happened: &Happened<'_>) {
        if let Some(foreseen) = &happened.preview {
            self.shoot(foreseen);
        }
        // Pending previews carry velocities of another filter.
        if refiner.clarity() != self.clarity {
            self.clarity = refiner.clarity();
            self.waiting = 0;
        }
        if let Some(look) = &happened.look {
            self.sight(look);
        }
        if let Some(at_limit) = happened.at_limit {
            self.onset.drove(at_limit, happened.driven_ns);
        }
        for closed in happened.closed {
            match closed.motion {
                Motion::Continues => self.realise(refiner, closed),
                Motion::Start | Motion::Jump => {
                    self.waiting = 0;
                    refiner.interrupt();
                    self.feedback.forget();
                }
            }
        }
    }

    /// How far previews are trusted, with the record of the leads `first` to `last` \[steps\].
    #[must_use]
    pub fn report(&self, first: usize, last: usize) -> SkillReport {
        // Previews are judged without `begun`: the initial reduction says nothing about them.
        let begun = if self.per_step { self.onset.belief() } else { 1.0 };
        SkillReport { shares: self.shares, begun, record: self.record(first, last) }
    }

    /// A grid step closed after ordinary motion: judges every pending preview.
    fn realise(&mut self, refiner: &mut Refiner, closed: &Closed) {
        let Closed { position, unit_m, .. } = *closed;
        if !(unit_m > 0.0) {
            return;
        }
        refiner.measure(unit_m);
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
                self.judge(refiner, &shot, age, &earlier, *predicted, position);
            }
            if let Some(judged) = self.judge(refiner, &shot, age, &shot.sight, *predicted, position)
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
        self.share_out();
    }

    /// Learns from the difference between the point that the preview of `shot` `predicted` \[m\], refined at
    /// `sight`, and the real `position` \[m\]. `None`: a jump, or rest.
    fn judge(
        &mut self,
        refiner: &mut Refiner,
        shot: &Shot,
        age: usize,
        sight: &Sight,
        predicted: [f64; 2],
        position: [f64; 2],
    ) -> Option<Lead> {
        let unit_m = refiner.unit_m();
        let normalised = |way: [f64; 2]| way.map(|v| v / unit_m);
        let Look { newest, phase, news: said } = sight.look;
        let ahead = (age + 1) as f64 - phase;
        let news = said.filter(|news| refiner.is_ordinary(news));
        if said.is_some() && news.is_none() {
            return None;
        }
        let terms = news.map(|news| news.terms(from(predicted, newest), ahead).map(normalised));
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
        self.onset.judged(sight.moved, [share * dx, share * dy], [yx, yy], ahead);
        let [hx, hy] = normalised(from(position, sight.held));
        let [vx, vy] = normalised(shot.velocity).map(|v| v * ahead);
        if let Some(terms) = &terms {
            refiner.learn(phase, age, terms, [rx, ry], ahead);
        }
        Some(Lead {
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

    /// A new preview.
    fn shoot(&mut self, foreseen: &Foreseen<'_>) {
        self.last = (self.last + 1) % SKILL_LEADS;
        self.turn = (self.turn + 1) % PHASES;
        let held = self.feedback.tool(foreseen.base, 0.0);
        let Some(shot) = self.shots.get_mut(self.last) else { return };
        *shot = Shot {
            sight: Sight { look: Look::at(foreseen.base), held, moved: self.onset.moved() },
            velocity: foreseen.velocity,
            claim: foreseen.claim.and_then(|(lead, radius)| Some((lead.checked_sub(1)?, radius))),
            ..Shot::EMPTY
        };
        let mut last = foreseen.base;
        let mut given = foreseen.path.iter();
        for slot in &mut shot.path {
            last = given.next().copied().unwrap_or(last);
            *slot = last;
        }
        self.waiting = (self.waiting + 1).min(SKILL_LEADS);
    }

    /// A newer sample refines the newest preview.
    fn sight(&mut self, look: &Look) {
        // Unrefined previews know nothing newer than their base, and their baselines must not either.
        let held = self.feedback.tool(look.newest, look.phase);
        let usable = self.waiting > 0 && look.phase.is_finite() && self.per_step;
        let Some(shot) = self.shots.get_mut(self.last).filter(|_| usable) else { return };
        let last = bucket(shot.sight.look.phase);
        let wanted = shot.earlier.is_none() || last <= self.turn;
        if shot.sight.look.news.is_some() && last < bucket(look.phase) && wanted {
            shot.earlier = Some(shot.sight);
        }
        let look = Look { phase: look.phase.clamp(0.0, 1.0), ..*look };
        shot.sight = Sight { look, held, moved: self.onset.moved() };
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

    fn correction_at(&self, refiner: &Refiner, phase: f64, index: usize, terms: Option<&Terms>) -> [f64; 2] {
        if self.per_step { refiner.correction(phase, index, terms) } else { [0.0; 2] }
    }
}

fn untried_leads(parameters: &SkillParameters) -> [Lead; SKILL_LEADS] {
    std::array::from_fn(|index| Lead::untried((index + 1) as f64, parameters))
}

fn square(x: f64, y: f64) -> f64 {
    x * x + y * y
}
