//! Two estimates while another process has a part in the preview: that of the blend in force, and that of the
//! fallback alone.
//!
//! Contract: when the process loses its part, the law goes on as if it had never had one: corrections and shares
//! that were learned with it are not those of the fallback. Fixed size, no allocation after construction.

use super::record::Worth;
use super::{Estimate, LEADS, PreviewSource, RefinedPreview};
use crate::pen::PenReading;
use crate::predict::{LearnStep, Previewer};
use crate::state::state;

/// The estimate in force, and that of the fallback where they differ.
#[derive(Debug)]
pub(crate) struct Estimates {
    in_force: Estimate,
    /// Of the fallback alone, while `beside`.
    fallback: Estimate,
    preview: RefinedPreview,
    /// Another process had a part in the last preview.
    beside: bool,
}

state! { [] Estimates { in_force, fallback, preview, beside } }

impl Estimates {
    /// Both begin as `estimate`, for previews like `preview`.
    pub(crate) fn new(estimate: Estimate, preview: &RefinedPreview) -> Self {
        Self { fallback: estimate.clone(), in_force: estimate, preview: preview.clone(), beside: false }
    }

    /// As [`Estimate::update`]. `previewer` made the `preview`, which reaches as far as `steps`.
    pub(crate) fn update(
        &mut self,
        closed: &[LearnStep],
        source: PreviewSource,
        previewer: &Previewer,
        (preview, steps): (&RefinedPreview, usize),
        nearest: usize,
        saturated: f64,
    ) -> Worth {
        match (std::mem::replace(&mut self.beside, previewer.is_shared()), self.beside) {
            (false, true) => {
                self.fallback.clone_from(&self.in_force);
                self.preview.clone_from(preview);
                self.preview.stand_in(previewer, steps);
            }
            (true, false) => {
                // Its past previews were judged in the steps before; those that closed now come below.
                self.in_force.clone_from(&self.fallback);
            }
            (true, true) if !closed.is_empty() => self.preview.stand_in(previewer, steps),
            _ => {}
        }
        if self.beside {
            let same = match source {
                PreviewSource::LaterThisStep => PreviewSource::Same,
                other => other,
            };
            self.fallback.update(closed, same, &self.preview, nearest, saturated);
        }
        self.in_force.update(closed, source, preview, nearest, saturated)
    }

    /// As [`Estimate::refine`], of the `preview` in force; of the fallback's, as far as its own record allows.
    pub(crate) fn refine(
        &mut self,
        preview: &mut RefinedPreview,
        newest: Option<&PenReading>,
        shares: Option<&[f64; LEADS]>,
        governor: f64,
    ) {
        if self.beside {
            self.fallback.refine(&mut self.preview, newest, shares, governor);
        }
        self.in_force.refine(preview, newest, shares, governor);
    }
}
