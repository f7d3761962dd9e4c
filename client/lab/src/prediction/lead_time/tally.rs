//! Errors and side effects of one model by look-ahead time: of all targets, and of each sequence.

use serde::Serialize;

use super::super::score::Mean;
use super::judged::JudgedTarget;
use super::targets::{Instant, Targets, Truth};
use super::{LEADS_MS, SHARES};

/// What was wrong at one look-ahead time.
#[derive(Debug, Clone, Default)]
pub struct LeadTally {
    square: Mean,
    along: Mean,
    along_square: Mean,
    cross_square: Mean,
    lengths: Vec<f32>,
    lateness: Vec<f32>,
    over_anticipation: Vec<f32>,
    wrong_direction_deg: Vec<f32>,
    jitter: Vec<f32>,
    inside: [Mean; 2],
    radius: Mean,
}

/// Mean and percentiles over targets; `null` without any, or where one is not a number.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct TargetSpread {
    pub mean: Option<f64>,
    /// Median, the mean of the middle two.
    pub p50: Option<f64>,
    /// 95th percentile, linear between the two nearest.
    pub p95: Option<f64>,
    /// 99th percentile, likewise.
    pub p99: Option<f64>,
}

/// A summary of them; lengths in `unit` of the board, `null` where unknown.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct LeadRow {
    /// Look-ahead time \[ms\].
    pub lead_ms: u32,
    pub targets: u64,
    /// RMS of the 2-D position error.
    pub rms: Option<f64>,
    /// 95 % of it over writers ([`super::WriterBootstrap`]); `null` with one writer.
    pub rms_interval: Option<[f64; 2]>,
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
    /// The 2-D position error itself.
    pub error: TargetSpread,
    /// How far behind the pen, as [`JudgedTarget`] has it.
    pub lateness: TargetSpread,
    /// How far ahead of the pen.
    pub over_anticipation: TargetSpread,
    /// Angle between the predicted and the true way \[degrees\].
    pub wrong_direction_deg: TargetSpread,
    /// Change of the error from instant to instant.
    pub jitter: TargetSpread,
    /// Share of targets inside the 50 % band \[%\]; `null` without bands.
    pub coverage_50: Option<f64>,
    /// Share of targets inside the 90 % band \[%\].
    pub coverage_90: Option<f64>,
    /// Mean radius of the 90 % band, in units along x.
    pub radius_90: Option<f64>,
}

/// Sums over the targets of one sequence at one look-ahead time, lengths in the unit of the board.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct LeadSums {
    /// Squared 2-D position error.
    pub square: Mean,
    pub lateness: Mean,
    pub over_anticipation: Mean,
    /// \[degrees\]
    pub wrong_direction_deg: Mean,
    pub jitter: Mean,
}

/// A sequence by its number, and its sums by look-ahead time.
pub type SequenceSums = (usize, [LeadSums; LEADS_MS.len()]);

/// Every target of a set, as one model predicted it.
#[derive(Debug, Clone)]
pub struct LaneTally {
    /// By look-ahead time, over all sequences.
    pub leads: [LeadTally; LEADS_MS.len()],
    /// By look-ahead time, of each sequence with targets.
    pub sequences: Vec<SequenceSums>,
    /// The newest instant with a target at each look-ahead time, and the offset there.
    before: [Option<(Instant, [f64; 2])>; LEADS_MS.len()],
    unit: [f64; 2],
}

impl LaneTally {
    /// Nothing yet; `unit`: board units per raw unit along x and y.
    #[must_use]
    pub fn new(unit: [f64; 2]) -> Self {
        Self { leads: Default::default(), sequences: Vec::new(), before: [None; LEADS_MS.len()], unit }
    }

    /// Scores one prediction of the displacement since the newest point \[raw units\], instants in their
    /// order.
    pub fn push(
        &mut self,
        targets: &Targets,
        (instant, lead): (Instant, usize),
        predicted: [f64; 2],
        truth: &Truth,
        radii: Option<[f64; SHARES.len()]>,
    ) {
        let Some(before) = self.before.get_mut(lead) else { return };
        let offset = before.filter(|(last, _)| targets.follows(*last, instant)).map(|(_, offset)| offset);
        let judged = JudgedTarget::of(predicted, truth, self.unit, offset);
        *before = Some((instant, judged.offset));
        if let Some(tally) = self.leads.get_mut(lead) {
            tally.push(&judged);
            if let Some(radii) = radii {
                let raw = [predicted[0] - truth.position[0], predicted[1] - truth.position[1]];
                tally.push_bands(raw[0].hypot(raw[1]), radii, self.unit[0]);
            }
        }
        // A sequence without targets costs nothing, however many a file claims.
        if self.sequences.last().is_none_or(|(sequence, _)| *sequence != instant.sequence) {
            self.sequences.push((instant.sequence, Default::default()));
        }
        if let Some(sums) = self.sequences.last_mut().and_then(|(_, leads)| leads.get_mut(lead)) {
            sums.push(&judged);
        }
    }
}

impl LeadSums {
    fn push(&mut self, judged: &JudgedTarget) {
        self.square.push(judged.square());
        for (mean, value) in [
            (&mut self.lateness, judged.lateness()),
            (&mut self.over_anticipation, judged.over_anticipation()),
            (&mut self.wrong_direction_deg, judged.wrong_direction_deg),
            (&mut self.jitter, judged.jitter),
        ] {
            value.into_iter().for_each(|value| mean.push(value));
        }
    }
}

impl LeadTally {
    fn push(&mut self, judged: &JudgedTarget) {
        self.square.push(judged.square());
        self.lengths.push(judged.offset[0].hypot(judged.offset[1]) as f32);
        if let (Some(along), Some(cross)) = (judged.along, judged.cross) {
            self.along.push(along);
            self.along_square.push(along * along);
            self.cross_square.push(cross * cross);
        }
        for (values, value) in [
            (&mut self.lateness, judged.lateness()),
            (&mut self.over_anticipation, judged.over_anticipation()),
            (&mut self.wrong_direction_deg, judged.wrong_direction_deg),
            (&mut self.jitter, judged.jitter),
        ] {
            values.extend(value.map(|value| value as f32));
        }
    }

    /// `error` and `radii` in raw units; `unit`: board units per raw unit along x.
    fn push_bands(&mut self, error: f64, radii: [f64; SHARES.len()], unit: f64) {
        for (inside, radius) in self.inside.iter_mut().zip(radii) {
            inside.push(f64::from(u8::from(error <= radius)));
        }
        self.radius.push(radii[1] * unit);
    }

    /// The summary at `LEADS_MS[lead]`; `glyph`: median glyph height in board units.
    #[must_use]
    pub fn row(&self, lead: usize, glyph: Option<f64>) -> LeadRow {
        let root = |mean: &Mean| mean.get().map(f64::sqrt);
        let percent = |mean: &Mean| mean.get().map(|share| 100.0 * share);
        let rms = root(&self.square);
        let error = TargetSpread::of(&self.lengths);
        LeadRow {
            lead_ms: LEADS_MS.get(lead).copied().unwrap_or_default(),
            targets: self.square.count,
            rms,
            rms_interval: None,
            rms_glyph: rms.zip(glyph).map(|(rms, glyph)| rms / glyph),
            median: error.p50,
            along_rms: root(&self.along_square),
            along_mean: self.along.get(),
            cross_rms: root(&self.cross_square),
            error,
            lateness: TargetSpread::of(&self.lateness),
            over_anticipation: TargetSpread::of(&self.over_anticipation),
            wrong_direction_deg: TargetSpread::of(&self.wrong_direction_deg),
            jitter: TargetSpread::of(&self.jitter),
            coverage_50: percent(&self.inside[0]),
            coverage_90: percent(&self.inside[1]),
            radius_90: self.radius.get(),
        }
    }
}

impl TargetSpread {
    fn of(values: &[f32]) -> Self {
        if values.iter().any(|value| value.is_nan()) {
            return Self::default();
        }
        let mut sorted = values.to_vec();
        sorted.sort_by(f32::total_cmp);
        let percentile = |share: f64| {
            let at = share * (sorted.len().checked_sub(1)? as f64);
            let low = f64::from(*sorted.get(at.floor() as usize)?);
            let high = f64::from(*sorted.get(at.ceil() as usize)?);
            // Between two infinities lies no difference.
            Some(if low == high { low } else { low + at.fract() * (high - low) })
        };
        let sum: f64 = sorted.iter().map(|value| f64::from(*value)).sum();
        Self {
            mean: (!sorted.is_empty()).then(|| sum / sorted.len() as f64),
            p50: percentile(0.5),
            p95: percentile(0.95),
            p99: percentile(0.99),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn close(got: Option<f64>, wanted: f64) {
        assert!((got.unwrap() - wanted).abs() < 1e-6, "{got:?} {wanted}");
    }

    fn one(
        predicted: [f64; 2],
        truth: &Truth,
        radii: Option<[f64; 2]>,
        unit: [f64; 2],
        lead: usize,
    ) -> LaneTally {
        let mut lane = LaneTally::new(unit);
        let instant = Instant { sequence: 0, point: 2, leads: 1 << lead };
        lane.push(&Targets::of(&[]), (instant, lead), predicted, truth, radii);
        lane
    }

    #[test]
    fn error_splits_into_along_and_across_the_true_motion() {
        // The pen moved along +y in mm (x is 10 units/mm, y 1); predicted 3 mm behind and 4 mm to its right.
        let truth = Truth { position: [20.0, 10.0], motion: [0.0, 5.0] };
        let lane = one([60.0, 7.0], &truth, Some([5.0, 50.0]), [0.1, 1.0], 1);
        let row = lane.leads[1].row(1, Some(10.0));
        assert_eq!((row.lead_ms, row.targets), (20, 1));
        close(row.rms, 5.0);
        close(row.median, 5.0);
        close(row.rms_glyph, 0.5);
        close(row.along_mean, -3.0);
        close(row.along_rms, 3.0);
        close(row.cross_rms, 4.0);
        close(row.lateness.mean, 3.0);
        close(row.over_anticipation.p99, 0.0);
        assert_eq!(row.jitter, TargetSpread::default());
        // Bands are circles in raw units: the error is 40.1 long.
        assert_eq!((row.coverage_50, row.coverage_90), (Some(0.0), Some(100.0)));
        let sums = lane.sequences[0].1[1];
        assert_eq!((sums.square.count, sums.lateness.count, sums.jitter.count), (1, 1, 0));
        assert!((sums.square.sum - 25.0).abs() < 1e-9 && (sums.lateness.sum - 3.0).abs() < 1e-9);
    }

    #[test]
    fn where_the_pen_rests_there_is_no_direction() {
        let rests = Truth { position: [0.0; 2], motion: [0.0; 2] };
        let row = one([1.0, 0.0], &rests, None, [1.0; 2], 0).leads[0].row(0, None);
        assert_eq!((row.rms, row.along_rms, row.cross_rms, row.coverage_50), (Some(1.0), None, None, None));
        assert_eq!((row.lateness, row.error.p99), (TargetSpread::default(), Some(1.0)));
    }

    #[test]
    fn percentiles_are_linear_between_neighbours() {
        // 0, 1 … 100 in some order.
        let values: Vec<f32> = (0..101_u16).map(|i| f32::from(i * 37 % 101)).collect();
        let spread = TargetSpread::of(&values);
        assert_eq!(
            [spread.mean, spread.p50, spread.p95, spread.p99],
            [Some(50.0), Some(50.0), Some(95.0), Some(99.0)]
        );
        let two = TargetSpread::of(&[3.0, 1.0]);
        close(two.p95, 2.9);
        assert_eq!(TargetSpread::of(&[]), TargetSpread::default());
        assert_eq!(TargetSpread::of(&[1.0, f32::NAN]), TargetSpread::default());
        assert_eq!(TargetSpread::of(&[f32::INFINITY; 3]).p95, Some(f64::INFINITY));
    }
}
