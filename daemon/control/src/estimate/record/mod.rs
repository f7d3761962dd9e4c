//! The record: what past previews of the active predictor were worth, per lead.
//!
//! Contract: fixed size, no allocation, total. A preview and its refinements are recorded when they are made
//! ([`PreviewRecord::record_preview`], [`PreviewRecord::record_refinement`]); once per closed grid step every
//! pending preview is compared with the pen's real position ([`PreviewRecord::judge`]). Each case goes to the
//! share and the correction of its lead j (steps after the newest grid point of the preview), to the record
//! of onsets, and to the squared errors of the preview, as it would be used, and of Hold. From these the
//! evidence Λ for the preview against Hold follows: the sum of (e_hold² − e_preview²) / 2s², s² the variance
//! of Hold's error, each case and the sum clipped.
//!
//! Lengths are divided by the running scale (RMS 10 per axis in ordinary motion), so a bad stretch counts by
//! its duration, whatever the size of the writing.

mod feedback;
mod lead;
mod pending;

use crate::state::state;
pub use lead::Record;

use feedback::Feedback;
use lead::{Errors, LeadRecord};
use pending::{PendingPreview, PendingRefinement};

use super::onset::Onset;
use super::refine::{BlendTerms, Refinement, Refiner, from};
use super::share::Slope;
use super::{LEADS, LawParameters};
use crate::pen::{Motion, rests};
use crate::predict::LearnStep;

/// A preview as it was made.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NewPreview<'a> {
    /// The newest grid point \[m\].
    pub base: [f64; 2],
    /// Predicted positions \[m\], the first one step after the base.
    pub path: &'a [[f64; 2]],
}

/// What previews are worth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Worth {
    /// Share per lead from 1 \[1\]; 1 where previews are used as they are.
    pub shares: [f64; LEADS],
    /// Factor on it while the pen begins to move \[1\].
    pub begun: f64,
    /// Sums over the leads asked for.
    pub record: Record,
}

impl Worth {
    /// Trust in each step of the preview now \[1\].
    #[must_use]
    pub fn believed(&self) -> [f64; LEADS] {
        self.shares.map(|share| share * self.begun)
    }
}

/// The record of all leads and the pending previews.
#[derive(Debug, Clone)]
pub struct PreviewRecord {
    law: LawParameters,
    /// A ring; `last` is where the newest is, `waiting` how many there are.
    pending: [PendingPreview; LEADS],
    last: usize,
    waiting: usize,
    leads: [LeadRecord; LEADS],
    slopes: [Slope; LEADS],
    shares: [f64; LEADS],
    /// Clarity of the filter by which pending previews were refined.
    clarity: f64,
    step_s: f64,
    feedback: Feedback,
    onset: Onset,
    /// Whether corrections and shares are used; if not, previews are judged as they are.
    per_step: bool,
}

state! {
    [] PreviewRecord { pending, last, waiting, leads, slopes, shares, clarity, feedback, onset }
    fixed { law, step_s, per_step }
}

impl PreviewRecord {
    /// Without evidence; grid step `step_s` \[s\]. `per_step`: previews are used, and therefore judged, with
    /// corrections and shares.
    #[must_use]
    pub fn new(step_s: f64, per_step: bool) -> Self {
        Self::tuned(step_s, per_step, &LawParameters::SHIPPED)
    }

    /// The same with given parameters.
    #[must_use]
    pub fn tuned(step_s: f64, per_step: bool, law: &LawParameters) -> Self {
        let mut record = Self {
            law: *law,
            pending: [PendingPreview::EMPTY; LEADS],
            last: 0,
            waiting: 0,
            leads: untried_leads(law),
            slopes: [Slope::default(); LEADS],
            shares: [1.0; LEADS],
            clarity: 0.0,
            step_s,
            feedback: Feedback::new(0.0),
            onset: Onset::new(law),
            per_step,
        };
        record.share_out();
        record
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
        self.leads = untried_leads(&self.law);
        self.slopes = [Slope::default(); LEADS];
        self.onset.forget();
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

    /// How far previews are trusted by an arm that is `saturated` in this share of its motion, with the
    /// record of the leads `first` to `last` \[steps\].
    #[must_use]
    pub fn report(&self, first: usize, last: usize, saturated: f64) -> Worth {
        // Previews are judged without `begun`: the initial reduction says nothing about them.
        let begun = if self.per_step { self.onset.belief(saturated) } else { 1.0 };
        Worth { shares: self.shares, begun, record: self.record(first, last) }
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
            let at = (self.last + LEADS - index) % LEADS;
            let Some(preview) = self.pending.get_mut(at) else { break };
            let age = preview.age;
            preview.age += 1;
            let preview = *preview;
            let Some(predicted) = preview.path.get(age) else { continue };
            if let Some(judged) = self.judge_refined(refiner, &preview, age, *predicted, position)
                && let Some(lead) = self.leads.get_mut(age)
            {
                lead.add(&judged, &self.law);
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
        predicted: [f64; 2],
        position: [f64; 2],
    ) -> Option<Errors> {
        let (unit_m, refined) = (refiner.unit_m(), &preview.last);
        let normalised = |way: [f64; 2]| way.map(|v| v / unit_m);
        let Refinement { newest, phase, motion } = refined.refinement;
        let ahead = (age + 1) as f64 - phase;
        let usable = motion.filter(|motion| refiner.is_ordinary(motion));
        if motion.is_some() && usable.is_none() {
            return None;
        }
        let terms = usable.map(|motion| motion.terms(from(predicted, newest), ahead).map(normalised));
        let [cx, cy] = self.correction_at(refiner, age, terms.as_ref());
        let [rx, ry] = normalised(from(position, predicted));
        let [yx, yy] = normalised(from(position, newest));
        let (dx, dy) = (yx - (rx - cx), yy - (ry - cy));
        // A hand keeps two thirds of its fastest over several steps. NaN is not ordinary motion either.
        let most = self.law.leap * (2.0 * ahead + 1.0) / 3.0;
        let ordinary =
            [rx, ry, yx, yy, dx, dy].iter().chain(terms.iter().flatten().flatten()).all(|v| v.abs() <= most);
        if !ordinary || (rests([yx, yy]) && rests([dx, dy])) {
            return None;
        }
        let share = self.shares.get(age).copied().unwrap_or(0.0);
        self.onset.judged(refined.moved, [share * dx, share * dy], [yx, yy], ahead);
        let [hx, hy] = normalised(from(position, refined.held));
        if let Some(terms) = &terms {
            refiner.learn(age, terms, [rx, ry], ahead);
        }
        if let Some(slope) = self.slopes.get_mut(age) {
            slope.add([yx, yy], [dx, dy], self.law.forgetting());
        }
        Some(Errors {
            preview: square(yx - share * dx, yy - share * dy),
            hold: square(hx, hy).min(2.0 * most * most),
        })
    }

    /// A preview was made; it is judged when grid steps close.
    pub fn record_preview(&mut self, made: &NewPreview<'_>) {
        self.last = (self.last + 1) % LEADS;
        self.waiting = (self.waiting + 1).min(LEADS);
        self.replace_preview(made);
    }

    /// Another preview from the same base took the place of the newest.
    pub fn replace_preview(&mut self, made: &NewPreview<'_>) {
        let held = self.feedback.tool(made.base, 0.0);
        let Some(preview) = self.pending.get_mut(self.last).filter(|_| self.waiting > 0) else { return };
        let refinement = Refinement::at(made.base);
        *preview = PendingPreview {
            last: PendingRefinement { refinement, held, moved: self.onset.moved() },
            ..PendingPreview::EMPTY
        };
        let mut last = made.base;
        let mut given = made.path.iter();
        for slot in &mut preview.path {
            last = given.next().copied().unwrap_or(last);
            *slot = last;
        }
    }

    /// A newer sample refined the newest preview.
    pub fn record_refinement(&mut self, refiner: &Refiner, refinement: &Refinement) {
        self.follow_filter(refiner);
        // Unrefined previews know nothing newer than their base, and their baselines must not either.
        let held = self.feedback.tool(refinement.newest, refinement.phase);
        let usable = self.waiting > 0 && refinement.phase.is_finite() && self.per_step;
        let Some(preview) = self.pending.get_mut(self.last).filter(|_| usable) else { return };
        let refinement = Refinement { phase: refinement.phase.clamp(0.0, 1.0), ..*refinement };
        preview.last = PendingRefinement { refinement, held, moved: self.onset.moved() };
    }

    fn record(&self, first: usize, last: usize) -> Record {
        let first = first.clamp(1, LEADS);
        let count = last.clamp(first, LEADS) + 1 - first;
        let mut record = Record { evidence: self.law.evidence_most, ..Record::default() };
        for lead in self.leads.iter().skip(first - 1).take(count) {
            record.preview += lead.preview;
            record.hold += lead.hold;
            // One lead in which the preview is good is no evidence for another.
            record.evidence = record.evidence.min(lead.evidence);
        }
        record
    }

    fn share_out(&mut self) {
        if self.per_step {
            let doubt = self.law.doubt;
            for (index, (share, slope)) in self.shares.iter_mut().zip(&self.slopes).enumerate() {
                *share = slope.share((index + 1) as f64, doubt);
            }
        }
    }

    fn correction_at(&self, refiner: &Refiner, index: usize, terms: Option<&BlendTerms>) -> [f64; 2] {
        if self.per_step { refiner.correction(index, terms) } else { [0.0; 2] }
    }
}

fn untried_leads(law: &LawParameters) -> [LeadRecord; LEADS] {
    std::array::from_fn(|index| LeadRecord::untried((index + 1) as f64, law))
}

fn square(x: f64, y: f64) -> f64 {
    x * x + y * y
}
