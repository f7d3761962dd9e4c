//! Errors of one model by look-ahead time.

use serde::Serialize;

use super::super::score::{Mean, median};
use super::targets::Truth;
use super::{LEADS_MS, SHARES};

/// Errors at one look-ahead time.
#[derive(Debug, Clone, Default)]
pub struct LeadTally {
    square: Mean,
    along: Mean,
    along_square: Mean,
    cross_square: Mean,
    lengths: Vec<f32>,
    inside: [Mean; 2],
    radius: Mean,
}

/// A summary of them; lengths in `unit` of the board, `null` where unknown.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct LeadRow {
    /// Look-ahead time \[ms\].
    pub lead_ms: u32,
    pub targets: u64,
    /// RMS of the 2-D position error.
    pub rms: Option<f64>,
    /// The same over the median glyph height of the set.
    pub rms_glyph: Option<f64>,
    /// Median of the 2-D position error.
    pub median: Option<f64>,
    /// RMS of the error along the true motion at the target.
    pub along_rms: Option<f64>,
    /// Mean of the error along the true motion; negative: the prediction lags.
    pub along_mean: Option<f64>,
    /// RMS of the error across the true motion.
    pub cross_rms: Option<f64>,
    /// Share of targets inside the 50 % band \[%\]; `null` without bands.
    pub coverage_50: Option<f64>,
    /// Share of targets inside the 90 % band \[%\].
    pub coverage_90: Option<f64>,
    /// Mean radius of the 90 % band, in units along x.
    pub radius_90: Option<f64>,
}

impl LeadTally {
    /// Scores one prediction of the displacement since the newest point; `unit`: board units per raw unit
    /// along x and y.
    pub fn push(
        &mut self,
        predicted: [f64; 2],
        truth: &Truth,
        radii: Option<[f64; SHARES.len()]>,
        unit: [f64; 2],
    ) {
        let raw = [predicted[0] - truth.position[0], predicted[1] - truth.position[1]];
        let error = [raw[0] * unit[0], raw[1] * unit[1]];
        let motion = [truth.motion[0] * unit[0], truth.motion[1] * unit[1]];
        self.square.push(error[0] * error[0] + error[1] * error[1]);
        self.lengths.push(error[0].hypot(error[1]) as f32);
        let moved = motion[0].hypot(motion[1]);
        if moved > 0.0 {
            let along = (error[0] * motion[0] + error[1] * motion[1]) / moved;
            let cross = (error[1] * motion[0] - error[0] * motion[1]) / moved;
            self.along.push(along);
            self.along_square.push(along * along);
            self.cross_square.push(cross * cross);
        }
        if let Some(radii) = radii {
            for (inside, radius) in self.inside.iter_mut().zip(radii) {
                inside.push(f64::from(u8::from(raw[0].hypot(raw[1]) <= radius)));
            }
            self.radius.push(radii[1] * unit[0]);
        }
    }

    /// The summary at `LEADS_MS[lead]`; `glyph`: median glyph height in board units.
    #[must_use]
    pub fn row(&self, lead: usize, glyph: Option<f64>) -> LeadRow {
        let root = |mean: &Mean| mean.get().map(f64::sqrt);
        let percent = |mean: &Mean| mean.get().map(|share| 100.0 * share);
        let rms = root(&self.square);
        LeadRow {
            lead_ms: LEADS_MS.get(lead).copied().unwrap_or_default(),
            targets: self.square.count,
            rms,
            rms_glyph: rms.zip(glyph).map(|(rms, glyph)| rms / glyph),
            median: median(self.lengths.iter().map(|l| f64::from(*l))),
            along_rms: root(&self.along_square),
            along_mean: self.along.get(),
            cross_rms: root(&self.cross_square),
            coverage_50: percent(&self.inside[0]),
            coverage_90: percent(&self.inside[1]),
            radius_90: self.radius.get(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn error_splits_into_along_and_across_the_true_motion() {
        let mut tally = LeadTally::default();
        // The pen moved along +y in mm (x is 10 units/mm, y 1); predicted 3 mm behind and 4 mm to its right.
        let truth = Truth { position: [20.0, 10.0], motion: [0.0, 5.0] };
        tally.push([60.0, 7.0], &truth, Some([5.0, 50.0]), [0.1, 1.0]);
        let row = tally.row(1, Some(10.0));
        assert_eq!((row.lead_ms, row.targets), (20, 1));
        let close =
            |got: Option<f64>, wanted: f64| assert!((got.unwrap() - wanted).abs() < 1e-6, "{got:?} {wanted}");
        close(row.rms, 5.0);
        close(row.median, 5.0);
        close(row.rms_glyph, 0.5);
        close(row.along_mean, -3.0);
        close(row.along_rms, 3.0);
        close(row.cross_rms, 4.0);
        // Bands are circles in raw units: the error is 40.1 long.
        assert_eq!((row.coverage_50, row.coverage_90), (Some(0.0), Some(100.0)));
    }

    #[test]
    fn where_the_pen_rests_there_is_no_direction() {
        let mut tally = LeadTally::default();
        tally.push([1.0, 0.0], &Truth { position: [0.0; 2], motion: [0.0; 2] }, None, [1.0; 2]);
        let row = tally.row(0, None);
        assert_eq!((row.rms, row.along_rms, row.cross_rms, row.coverage_50), (Some(1.0), None, None, None));
    }
}
