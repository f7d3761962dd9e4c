//! Two estimates where another process predicts beside a built-in fallback: each predictor has its own
//! record, shares and corrections, and what both come to is blended last.
//!
//! Contract: with no part in the preview the process changes nothing of what the fallback comes to, neither
//! before it has earned one nor after it has lost it. Fixed size, no allocation after construction, total.

use super::record::Worth;
use super::{Estimate, LEADS, PreviewSource, RefinedPreview};
use crate::pen::PenReading;
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
}

state! {
    [] Estimates { own, own_preview, theirs, their_preview, own_shares, their_shares, part }
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
            let worth = self.own.update(closed, source, preview, nearest, saturated);
            self.own_shares = worth.believed();
            return worth;
        };
        let later = source == PreviewSource::LaterThisStep;
        if renewed {
            self.own_preview.refresh_by(previewer, steps, Previewer::preview_standing_in);
        }
        let own_source = if later { PreviewSource::Same } else { source };
        let own = self.own.update(closed, own_source, &self.own_preview, nearest, saturated);
        self.own_shares = own.believed();
        let answered =
            renewed && self.their_preview.refresh_by(previewer, steps, Previewer::preview_of_process);
        let theirs = if answered {
            self.theirs.update(closed, source, &self.their_preview, nearest, saturated)
        } else {
            self.theirs.judge(closed, nearest, saturated)
        };
        self.their_shares = theirs.believed();
        if part >= 0.5 { theirs } else { own }
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
        let own_shares = per_step.then_some(&self.own_shares);
        let Some(part) = self.part else {
            self.own.refine(preview, newest, own_shares, governor);
            return;
        };
        self.own.refine(&mut self.own_preview, newest, own_shares, governor);
        let their_shares = per_step.then_some(&self.their_shares);
        self.theirs.refine(&mut self.their_preview, newest, their_shares, governor);
        preview.blend(&self.own_preview, &self.their_preview, part);
    }
}
