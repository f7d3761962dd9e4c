//! The record of past previews at one lead: sums over judged cases, with forgetting.

use crate::estimate::LawParameters;
use crate::pen::TARGET_RMS;
use crate::state::state;

/// Squared errors \[normalised²\] of a judged case.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Errors {
    /// Of the preview, as it would be used.
    pub(super) preview: f64,
    /// Of Hold, that is feedback alone.
    pub(super) hold: f64,
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct LeadRecord {
    /// Sums of squared errors \[normalised²\], and of cases.
    pub(super) preview: f64,
    pub(super) hold: f64,
    cases: f64,
    /// Λ, the log-likelihood ratio of the preview over feedback alone, clipped.
    pub(super) evidence: f64,
}

state! { [] LeadRecord { preview, hold, cases, evidence } }

impl LeadRecord {
    /// Before the first case: the first cases of ordinary motion, `ahead` steps long, in which the preview
    /// was as good as Hold.
    pub(super) fn untried(ahead: f64, law: &LawParameters) -> Self {
        let way = TARGET_RMS * ahead;
        let hold = law.first_cases * way * way;
        Self { preview: hold, hold, cases: law.first_cases, evidence: law.evidence_most }
    }

    /// Adds a judged case: to the sums, and to Λ what it says for the preview against feedback, both normal
    /// about the pen with the variance that feedback had.
    pub(super) fn add(&mut self, case: &Errors, law: &LawParameters) {
        let (forgetting, evidence_most) = (law.forgetting(), law.evidence_most);
        let variance = self.hold / self.cases.max(1.0);
        let gain = (case.hold - case.preview) / (2.0 * variance);
        // Where neither has an error there is nothing to tell them apart by.
        let gain = if gain.is_nan() { 0.0 } else { within(gain, 0.2 * evidence_most) };
        self.evidence = within(self.evidence + gain, evidence_most);
        self.preview = forgetting * self.preview + case.preview;
        self.hold = forgetting * self.hold + case.hold;
        self.cases = forgetting * self.cases + 1.0;
    }
}

/// `value`, at most ± `most`; total, unlike `clamp`, for any `most`.
fn within(value: f64, most: f64) -> f64 {
    value.max(-most).min(most)
}

/// Squared errors over the leads that a plan uses \[normalised²\], and what they are evidence for.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Record {
    /// Of the preview, as it would be used.
    pub preview: f64,
    /// Of Hold, that is feedback alone.
    pub hold: f64,
    /// Λ, the evidence for the preview against feedback alone: the least of the clipped log-likelihood ratios
    /// of those leads.
    pub evidence: f64,
}
