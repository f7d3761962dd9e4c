//! The record of past previews at one lead: sums over judged cases, with forgetting.

use super::SkillParameters;
use crate::pen::TARGET_RMS;
use crate::state::state;

#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct LeadRecord {
    /// Squared errors \[in the plane, squared\].
    pub(super) preview: f64,
    pub(super) hold: f64,
    pub(super) steady: f64,
    /// ⟨real displacement, real⟩, ⟨real, predicted⟩ and ⟨predicted, predicted⟩.
    pub(super) real: f64,
    pub(super) along: f64,
    pub(super) way: f64,
    pub(super) cases: f64,
}

state! { [] LeadRecord { preview, hold, steady, real, along, way, cases } }

impl LeadRecord {
    /// Before the first case: a few cases of ordinary motion, `ahead` steps long, in which the preview was
    /// better than Hold.
    pub(super) fn untried(ahead: f64, parameters: &SkillParameters) -> Self {
        let way = TARGET_RMS * ahead;
        let hold = parameters.head_start_cases * way * way;
        Self { preview: parameters.head_start_error * hold, hold, steady: hold, ..Self::default() }
    }

    /// w, `ahead` steps ahead.
    pub(super) fn share(&self, ahead: f64, doubt: f64) -> f64 {
        if !(self.way > 0.0) {
            return 1.0;
        }
        let slope = self.along / self.way;
        // Errors at far leads are correlated from step to step.
        let independent = 2.0 * self.cases / ahead;
        let deviation = ((self.real / self.way - slope * slope).max(0.0) / independent).sqrt();
        (slope + doubt * deviation).clamp(0.0, 1.0)
    }

    pub(super) fn add(&mut self, case: &Self, forgetting: f64) {
        let Self { preview, hold, steady, real, along, way, cases } = self;
        let sums = [preview, hold, steady, real, along, way, cases];
        let values = [case.preview, case.hold, case.steady, case.real, case.along, case.way, case.cases];
        for (sum, value) in sums.into_iter().zip(values) {
            *sum = forgetting * *sum + value;
        }
    }
}

/// Squared errors over the leads that a plan uses \[in the plane, squared\], and the number of cases.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Record {
    /// Of the preview, as it would be used.
    pub preview: f64,
    /// Of Hold, that is feedback alone.
    pub hold: f64,
    /// Of constant velocity, the simplest prediction.
    pub steady: f64,
    /// Cases of motion of the lead that has most: just before a grid point closes hardly any displacement is
    /// left to judge.
    pub cases: f64,
    /// Share of recent previews whose claimed band the pen left, \[0, 1\]; bands promise 0.1.
    pub surprise: f64,
}
