//! Two estimates where another process predicts beside a built-in fallback: each predictor has its own
//! record, shares and corrections, and what both come to is blended last.
//!
//! Contract: with no part in the preview the process changes nothing of what the fallback comes to, neither
//! before it has earned one nor after it has lost it. The process's record judges a step one tick after it
//! closed, so that no tick learns from it twice, and only what is followed is drawn: the ticks that close a
//! step, the longest ones, bear little of the second estimate. Fixed size, no allocation after construction,
//! total.

use super::preview::Noted;
use super::record::Worth;
use super::refine::Refinement;
use super::{Estimate, LEADS, PreviewSource, RefinedPreview};
use crate::pen::{Motion, PenReading};
use crate::predict::{LearnStep, Previewer};
use crate::state::state;

/// The estimate of the predictor in charge, and, where that is another process's, of both.
#[derive(Debug)]
pub(crate) struct Estimates {
    /// Of the built-in predictor.
    own: Estimate,
    own_preview: RefinedPreview,
    /// Of the predictor of another process.
    theirs: Estimate,
    their_preview: RefinedPreview,
    /// Shares of both, as of the newest update.
    own_shares: [f64; LEADS],
    their_shares: [f64; LEADS],
    /// Part of the other process, if one is asked.
    part: Option<f64>,
    /// Which process that is.
    process: u64,
    /// Whether each of the two is followed, as of the newest sample.
    followed: [bool; 2],
    put_off: Option<PutOff>,
    /// The process's record has its preview from the step that closed last.
    recorded: bool,
}

/// The step that closed last, until the process's record has judged it.
#[derive(Debug, Clone, Copy)]
struct PutOff {
    motion: Motion,
    position: [f64; 2],
    scale_m: f64,
    /// The process's preview after it is worth judging.
    in_time: bool,
    /// How that was refined meanwhile.
    refinement: Option<Refinement>,
}

state! { whole [] PutOff { motion, position, scale_m, in_time, refinement } }

state! {
    [] Estimates {
        own, own_preview, theirs, their_preview, own_shares, their_shares, part, process, followed,
        put_off, recorded,
    }
}

impl Estimates {
    /// Both begin as `estimate`, for previews like `preview`.
    pub(crate) fn new(estimate: Estimate, preview: &RefinedPreview) -> Self {
        Self {
            theirs: estimate.clone(),
            own: estimate,
            own_preview: preview.clone(),
            their_preview: preview.clone(),
            own_shares: [0.0; LEADS],
            their_shares: [0.0; LEADS],
            part: None,
            process: 0,
            followed: [true, false],
            put_off: None,
            recorded: false,
        }
    }

    /// As [`Estimate::update`], of the predictor with the larger part. `previewer` made the `preview`, which
    /// reaches as far as `steps` and was `renewed` in this tick.
    pub(crate) fn update(
        &mut self,
        closed: &[LearnStep],
        source: PreviewSource,
        previewer: &Previewer,
        (preview, steps, renewed): (&RefinedPreview, usize, bool),
        nearest: usize,
        saturated: f64,
    ) -> Worth {
        self.part = previewer.part();
        let Some(part) = self.part else {
            self.put_off = None;
            let worth = self.own.update(closed, source, preview, nearest, saturated);
            self.own_shares = worth.believed();
            return worth;
        };
        self.catch_up();
        if renewed {
            self.own_preview.refresh_by(previewer, steps, Previewer::preview_standing_in);
            self.their_preview.refresh_by(previewer, steps, Previewer::preview_of_process);
        }
        let later = source == PreviewSource::LaterThisStep;
        let own_source = if later { PreviewSource::Same } else { source };
        let own = self.own.update(closed, own_source, &self.own_preview, nearest, saturated);
        self.own_shares = own.believed();
        if source == PreviewSource::AnotherPredictor || self.process != previewer.process() {
            self.process = previewer.process();
            // What a past process was worth says nothing; how the pen moves is known.
            self.theirs.clone_from(&self.own);
            self.theirs.forget();
            (self.their_preview.base, self.recorded) = (None, false);
        }
        let in_time = self.answered() && previewer.process_in_time();
        match closed {
            [] if later && in_time => self.record_theirs(),
            [] => {}
            [LearnStep { motion, position, scale_m, .. }] => {
                let (motion, position, scale_m) = (*motion, *position, *scale_m);
                self.put_off = Some(PutOff { motion, position, scale_m, in_time, refinement: None });
            }
            // Ticks are late.
            several => self.judge_theirs(several, in_time, None),
        }
        let theirs = (part > 0.0).then(|| self.theirs.worth(nearest, saturated));
        if let Some(theirs) = &theirs {
            self.their_shares = theirs.believed();
        }
        theirs.filter(|_| part >= 0.5).unwrap_or(own)
    }

    /// Corrects and shrinks the `preview` in force by the `newest` sample, each lead by its share where
    /// `per_step`.
    pub(crate) fn refine(
        &mut self,
        preview: &mut RefinedPreview,
        newest: Option<&PenReading>,
        per_step: bool,
        governor: f64,
    ) {
        let Some(newest) = newest else { return };
        let own_shares = per_step.then_some(&self.own_shares);
        let Some(part) = self.part else {
            self.own.refine(preview, newest, own_shares, governor, true);
            return;
        };
        let part = if self.answered() { part } else { 0.0 };
        let followed = [part < 1.0, part > 0.0];
        if followed != self.followed {
            self.followed = followed;
            self.own_preview.refine_again();
            self.their_preview.refine_again();
        }
        let [own_followed, theirs_followed] = followed;
        self.own.refine(&mut self.own_preview, newest, own_shares, governor, own_followed);
        self.theirs.refiner.observe_as(&self.own.refiner);
        if let Some(noted) = self.their_preview.note(newest, &self.theirs.refiner, per_step) {
            if theirs_followed {
                let shares = per_step.then_some(&self.their_shares);
                self.their_preview.draw(newest.position, &noted, &self.theirs.refiner, shares, governor);
            }
            match (noted, &mut self.put_off) {
                (Noted::Within(refinement), Some(put_off)) => put_off.refinement = Some(refinement),
                (Noted::Within(refinement), None) if self.recorded => {
                    self.theirs.record.record_refinement(&self.theirs.refiner, &refinement);
                }
                _ => {}
            }
        }
        preview.blend(&self.own_preview, &self.their_preview, part);
    }

    /// The process has a preview from the step that closed last.
    fn answered(&self) -> bool {
        self.their_preview.base.is_some() && self.their_preview.base == self.own_preview.base
    }

    /// The process's record judges what was put off.
    fn catch_up(&mut self) {
        if let Some(PutOff { motion, position, scale_m, in_time, refinement }) = self.put_off.take() {
            let step = LearnStep { motion, position, scale_m, ..LearnStep::default() };
            self.judge_theirs(&[step], in_time, refinement.as_ref());
        }
    }

    /// Judges past previews of the process by the steps that `closed`, and records the one after them, if
    /// that is there `in_time`, with its `refinement`.
    fn judge_theirs(&mut self, closed: &[LearnStep], in_time: bool, refinement: Option<&Refinement>) {
        self.theirs.judge(closed);
        self.recorded = false;
        if in_time {
            self.record_theirs();
            if let Some(refinement) = refinement {
                self.theirs.record.record_refinement(&self.theirs.refiner, refinement);
            }
        }
    }

    /// Records the process's preview from the step that closed last, in the place of an earlier one.
    fn record_theirs(&mut self) {
        let made = self.their_preview.made();
        if self.recorded {
            self.theirs.record.replace_preview(&made);
        } else {
            self.theirs.record.record_preview(&made);
        }
        self.recorded = true;
    }
}
