//! What a preview is worth: where the arm should aim, given what past previews were worth.
//!
//! With x the newest sample, p_j the preview j steps after the grid point and c_j its correction by the
//! newest sample (`refine`), the arm aims at
//!
//! g_j = x + κ · b · s_j · (p_j − x + c_j)
//!
//! s_j: share of lead j (`share`); b: share at the onset of motion (`onset`); κ: of the governor of the
//! follower. All learn from one record of past previews (`record`), which also holds the evidence for trust.
//! Every number of it is in `parameters`.
//!
//! Contract: fixed size, no allocation after construction, total. In a tick `Estimate::update` comes after
//! the prediction, `Estimate::refine` after that.

mod beside;
mod parameters;
mod preview;

pub mod record;
pub mod refine;
mod onset;
mod share;

use crate::pen::PenReading;
use crate::predict::LearnStep;
use crate::state::state;
pub(crate) use beside::Estimates;
pub use parameters::{LawParameters, Number};
pub(crate) use preview::RefinedPreview;

use preview::Noted;

use record::{PreviewRecord, Worth};
use refine::{RefinePrior, Refiner};

/// Leads with a record, a share and a correction of their own \[steps\]; farther leads use the last one's.
pub const LEADS: usize = 24;

/// Who made the preview in force.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum PreviewSource {
    /// The predictor that made the last one.
    Same,
    /// It came after the newest step had closed, in the place of another.
    LaterThisStep,
    /// Another predictor than made the past ones.
    AnotherPredictor,
}

/// The record of past previews and the corrections of the newest.
#[derive(Debug)]
pub(crate) struct Estimate {
    record: Box<PreviewRecord>,
    refiner: Box<Refiner>,
}

state! { [] Estimate { record, refiner } }

/// Into the memory that is there: ticks allocate nothing.
impl Clone for Estimate {
    fn clone(&self) -> Self {
        Self { record: self.record.clone(), refiner: self.refiner.clone() }
    }

    fn clone_from(&mut self, other: &Self) {
        self.record.clone_from(&other.record);
        self.refiner.clone_from(&other.refiner);
    }
}

impl Estimate {
    /// Without evidence, on a grid of `step_ns` \[ns\]; Hold lags `feedback_lag_s` \[s\] behind the samples.
    /// Previews are judged `per_step` if they are used so ([`PreviewRecord::new`]). `prior`: weights of the
    /// corrections for a new hand.
    pub(crate) fn new(
        step_ns: u64,
        per_step: bool,
        feedback_lag_s: f64,
        law: &LawParameters,
        prior: &RefinePrior,
    ) -> Self {
        let step_s = step_ns as f64 * 1e-9;
        let record = PreviewRecord::tuned(step_s, per_step, law).beside_feedback(feedback_lag_s);
        let refiner = Refiner::tuned(step_s, law, prior);
        Self { record: Box::new(record), refiner: Box::new(refiner) }
    }

    /// Judges past previews by the grid steps that `closed`, and records the `preview` that was made from
    /// them, or took the place of that. `source` says by whom. Returns what previews are worth at the
    /// `nearest` lead that the plan uses and the one behind it, between which its first step lies, to an arm
    /// that is `saturated` in this share of its motion.
    pub(crate) fn update(
        &mut self,
        closed: &[LearnStep],
        source: PreviewSource,
        preview: &RefinedPreview,
        nearest: usize,
        saturated: f64,
    ) -> Worth {
        self.judge(closed);
        if source == PreviewSource::AnotherPredictor {
            self.forget();
        }
        if !closed.is_empty() {
            self.record.record_preview(&preview.made());
        } else if source == PreviewSource::LaterThisStep {
            self.record.replace_preview(&preview.made());
        }
        self.worth(nearest, saturated)
    }

    fn forget(&mut self) {
        self.record.forget();
        self.refiner.forget();
    }

    fn judge(&mut self, closed: &[LearnStep]) {
        self.record.judge(&mut self.refiner, closed);
    }

    fn worth(&self, nearest: usize, saturated: f64) -> Worth {
        self.record.report(nearest, nearest + 1, saturated)
    }

    /// Corrects `preview` by the `newest` sample and shrinks it to the `shares` that past previews justify;
    /// without shares it is used as it is. Unless it is `followed`, only what is to be judged later is noted.
    fn refine(
        &mut self,
        preview: &mut RefinedPreview,
        newest: &PenReading,
        shares: Option<&[f64; LEADS]>,
        governor: f64,
        followed: bool,
    ) {
        self.refiner.observe(newest.stamp, newest.position);
        let Some(noted) = preview.note(newest, &self.refiner, shares.is_some()) else { return };
        if followed {
            preview.draw(newest.position, &noted, &self.refiner, shares, governor);
        }
        if let Noted::Within(refinement) = noted {
            self.record.record_refinement(&self.refiner, &refinement);
        }
    }
}
