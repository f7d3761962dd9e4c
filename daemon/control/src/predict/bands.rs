//! Error bands: the recent error of the prediction, per predictor and lead.
//!
//! Contract: a band is a radius r such that the pen came to lie within r of the predicted position in
//! [`COVERAGE`] of the recent cases. The table holds dimensionless factors; r = factor x (level · metres per
//! unit), so that a band scales with the speed of the hand and costs the loop one multiplication. Made by
//! [`crate::learn::Calibration`].

use super::PredictorKind;
use super::online::WeightsError;
use crate::pen::REST;
use crate::state::state;

/// Leads with a band \[steps\]; none farther ahead.
pub const BAND_LEADS: usize = 24;

/// Share of cases in which the pen should lie within the band.
pub const COVERAGE: f64 = 0.9;

/// Largest legal factor: ten thousand times the recent step.
const MAX_FACTOR: f32 = 1e4;

/// Factors of one predictor, one per lead from 1; 0: unknown.
pub type BandFactors = [f32; BAND_LEADS];

/// Factors of all predictors, in the order of [`PredictorKind::ALL`]; the oracle's stay 0.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct BandTable {
    /// Factors per predictor and lead.
    pub factors: [BandFactors; PredictorKind::ALL.len()],
}

state! { whole [] BandTable { factors } }

impl BandTable {
    /// Checks every factor.
    ///
    /// # Errors
    ///
    /// The first that is negative, too large or NaN.
    pub fn validate(&self) -> Result<(), WeightsError> {
        match self.factors.iter().flatten().find(|factor| !(0.0 <= **factor && **factor <= MAX_FACTOR)) {
            Some(got) => Err(WeightsError::Setting {
                model: "error band",
                name: "factor",
                got: f64::from(*got),
                min: 0.0,
                max: f64::from(MAX_FACTOR),
            }),
            None => Ok(()),
        }
    }

    /// Factors of one predictor.
    #[must_use]
    pub fn of(&self, kind: PredictorKind) -> &BandFactors {
        const NONE: BandFactors = [0.0; BAND_LEADS];
        self.factors.get(kind.index()).unwrap_or(&NONE)
    }
}

/// The bands of one preview.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PreviewBands {
    factors: BandFactors,
    unit_m: f64,
}

state! { whole [] PreviewBands { factors, unit_m } }

impl PreviewBands {
    /// `unit_m`: the recent step \[m\], see [`level`].
    #[must_use]
    pub const fn new(factors: BandFactors, unit_m: f64) -> Self {
        Self { factors, unit_m }
    }

    /// Radius \[m\] at `lead` steps after the newest closed one, interpolated linearly between whole leads; 0
    /// at lead 0. `None` beyond [`BAND_LEADS`] or without enough cases.
    #[must_use]
    pub fn at(&self, lead: f64) -> Option<f64> {
        if !(0.0 <= lead && lead <= BAND_LEADS as f64) {
            return None;
        }
        let whole = lead.floor();
        let part = lead - whole;
        let below = self.factor(whole as usize)?;
        let above = if part > 0.0 { self.factor(whole as usize + 1)? } else { below };
        Some((below + part * (above - below)) * self.unit_m)
    }

    /// The same where `given` \[m\], at a lead in steps, says nothing.
    #[must_use]
    pub fn or_given(mut self, given: impl Fn(f64) -> Option<f64>) -> Self {
        if self.unit_m > 0.0 {
            for (lead, factor) in (1..).zip(&mut self.factors) {
                if let Some(radius) = given(f64::from(lead)) {
                    *factor = ((radius / self.unit_m) as f32).clamp(0.0, MAX_FACTOR);
                }
            }
        }
        self
    }

    fn factor(&self, lead: usize) -> Option<f64> {
        let Some(index) = lead.checked_sub(1) else { return Some(0.0) };
        let factor = f64::from(*self.factors.get(index)?);
        (factor > 0.0).then_some(factor)
    }
}

/// Memory of the level \[steps\].
const LEVEL_STEPS: f64 = 8.0;

/// Mean squared step after `x` \[in the plane, squared\].
#[must_use]
pub fn level_square(before: f64, x: [f64; 2]) -> f64 {
    let [dx, dy] = x;
    before + (dx * dx + dy * dy - before) / LEVEL_STEPS
}

/// The recent step \[in the plane\], never below [`REST`], that of a resting pen.
#[must_use]
pub fn level(square: f64) -> f64 {
    if square > REST * REST { square.sqrt() } else { REST }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bands_lie_between_the_leads_and_end_with_them() {
        let mut factors = [0.0; BAND_LEADS];
        (factors[0], factors[1], factors[2]) = (1.0, 3.0, 4.0);
        let bands = PreviewBands::new(factors, 0.002);
        assert_eq!(
            [0.0, 0.5, 1.0, 1.5, 3.0].map(|lead| bands.at(lead).unwrap()),
            [0.0, 0.001, 0.002, 0.004, 0.008]
        );
        for unknown in [-0.1, 3.1, 4.0, 25.0, f64::NAN, f64::INFINITY] {
            assert_eq!(bands.at(unknown), None, "{unknown}");
        }
    }

    #[test]
    fn the_level_is_a_mean_of_squared_lengths_that_forgets() {
        // 3-4-5 in the plane; one part in eight of every step is new.
        assert_eq!(level_square(0.0, [3.0, 4.0]), 25.0 / LEVEL_STEPS);
        assert_eq!(level_square(25.0, [-4.0, 3.0]), 25.0);
        assert_eq!((level(25.0), level(0.0)), (5.0, REST));
    }

    #[test]
    fn factors_that_are_no_radius_are_refused() {
        assert_eq!(BandTable::default().validate(), Ok(()));
        for bad in [f32::NAN, -1.0, f32::INFINITY, 1e5] {
            let mut table = BandTable::default();
            table.factors[1][3] = bad;
            assert!(table.validate().is_err(), "{bad}");
        }
    }
}
