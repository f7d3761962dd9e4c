//! Scores of sequences and the rows that they add up to.

use foretrace_sim::metrics::{motion, tracking};
use serde::Serialize;

use super::{Rival, Sequence};
use crate::experiments::{ClosedLoop, median};

/// Worse than `hold` by more than this part of its mean squared error...
const WORSE_SHARE: f64 = 0.02;
/// ... and by more than this in its root \[m\].
const WORSE_M: f64 = 2e-4;

/// How one sequence was written.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct SequenceScore {
    /// Mean squared 2-D error, hover included, jumps left out \[m²\].
    pub mse_m2: f64,
    /// The same with the pen down \[m²\]; NaN where it never is.
    pub pen_down_mse_m2: f64,
    /// After jumps \[m²\]; NaN without.
    pub leap_mse_m2: f64,
    /// Largest error of what `mse_m2` counts \[m\].
    pub max_m: f64,
    /// Shift of the pen that fits the tool best \[ms\]; positive: the tool is late.
    pub lag_ms: f64,
    /// RMS jerk of the tool \[m/s³\].
    pub rms_jerk: f64,
    /// Ticks in which a motion limit shaped the command.
    pub limited: u32,
    /// Ticks whose command asks a joint for more than its limits.
    pub illegal: u32,
    pub ticks: u32,
}

impl SequenceScore {
    /// `None` when nothing of the sequence can be scored.
    #[must_use]
    pub fn of(sequence: &Sequence, run: &ClosedLoop) -> Option<Self> {
        let all = tracking(&sequence.scored(|_, leap| !leap), &run.tool)?;
        let down = tracking(&sequence.scored(|sample, leap| sample.contact && !leap), &run.tool);
        let leaps = sequence.leaps().then(|| tracking(&sequence.scored(|_, leap| leap), &run.tool)).flatten();
        let mse = |tracking: Option<foretrace_sim::metrics::TrackingErrors>| {
            tracking.map_or(f64::NAN, |t| t.mse_m2)
        };
        let (first, last) = sequence.path.samples.first().zip(sequence.path.samples.last())?;
        let within = |t_s: f64| (first.t_s..=last.t_s).contains(&t_s);
        let written: Vec<_> = run.tool.iter().filter(|sample| within(sample.t_s)).copied().collect();
        let ticks = run.ticks.iter().filter(|tick| within(tick.t_s));
        Some(Self {
            mse_m2: all.mse_m2,
            pen_down_mse_m2: mse(down),
            leap_mse_m2: mse(leaps),
            max_m: all.max_m,
            lag_ms: all.lag_ms,
            rms_jerk: motion(&written).rms_jerk_mps3,
            limited: ticks.clone().filter(|tick| tick.limited).count() as u32,
            illegal: ticks.clone().filter(|tick| tick.illegal).count() as u32,
            ticks: ticks.count() as u32,
        })
    }

    /// Worse than `hold` by more than noise.
    #[must_use]
    pub fn worse_than(&self, hold: &Self) -> bool {
        self.mse_m2 > (1.0 + WORSE_SHARE) * hold.mse_m2 && self.rms_beyond(hold) > WORSE_M
    }

    /// RMS error above that of `hold` \[m\]; negative: below.
    #[must_use]
    pub fn rms_beyond(&self, hold: &Self) -> f64 {
        self.mse_m2.sqrt() - hold.mse_m2.sqrt()
    }
}

/// The scores of one method on one arm for one sequence: for paired comparisons.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Each<'a> {
    pub predictor: &'static str,
    pub arm: &'static str,
    pub file: &'a str,
    pub writer: &'a str,
    /// Index among what they wrote in it, from 0.
    pub index: usize,
    /// Label of the sequence.
    pub label: &'a str,
    #[serde(flatten)]
    pub score: SequenceScore,
}

/// One method on one arm, over all sequences.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct BenchRow {
    pub predictor: String,
    pub arm: &'static str,
    /// Mean over sequences of the mean squared 2-D error \[m²\].
    pub mse_m2: f64,
    /// Median over sequences \[m²\].
    pub median_mse_m2: f64,
    /// Mean over sequences with the pen down \[m²\].
    pub pen_down_mse_m2: f64,
    /// Mean over sequences with jumps, after them \[m²\]; absent without.
    pub leap_mse_m2: Option<f64>,
    /// Largest error of any sequence \[m\].
    pub max_m: f64,
    /// Median over sequences \[ms\].
    pub lag_ms: f64,
    /// Root of the mean over sequences of the squared RMS jerk \[m/s³\].
    pub rms_jerk: f64,
    /// Ticks in which a motion limit shaped the command \[%\].
    pub saturated_pct: f64,
    /// Ticks whose command asks a joint for more velocity or acceleration than its limit \[%\].
    pub illegal_pct: f64,
    /// Sequences worse than `hold` by more than 2 % and by more than 0.2 mm RMS \[%\]; absent without `hold`.
    pub worse_than_hold_pct: Option<f64>,
    /// Largest RMS error of a sequence above that of `hold` \[m\]; absent without `hold`.
    pub worst_beyond_hold_m: Option<f64>,
    pub sequences: usize,
}

/// The row of `scores` (one per sequence, in their order) on `arm`, compared with those of `hold` in front of
/// the same arm.
#[must_use]
pub fn rows(
    rival: Rival,
    arm: &'static str,
    scores: &[Option<SequenceScore>],
    hold: Option<&[Option<SequenceScore>]>,
) -> Option<BenchRow> {
    let known = || scores.iter().flatten();
    let count = known().count();
    if count == 0 {
        return None;
    }
    let mean = |of: fn(&SequenceScore) -> f64| {
        let finite = || known().map(of).filter(|value| value.is_finite());
        finite().sum::<f64>() / finite().count() as f64
    };
    let leap = mean(|score| score.leap_mse_m2);
    let pairs = || {
        hold.into_iter()
            .flat_map(|hold| scores.iter().zip(hold).filter_map(|(a, b)| Some((a.as_ref()?, b.as_ref()?))))
    };
    let ticks: u64 = known().map(|score| u64::from(score.ticks)).sum();
    let part = |of: fn(&SequenceScore) -> u32| {
        100.0 * known().map(|score| u64::from(of(score))).sum::<u64>() as f64 / ticks.max(1) as f64
    };
    let worse = pairs().filter(|(score, hold)| score.worse_than(hold)).count();
    Some(BenchRow {
        predictor: rival.name().to_owned(),
        arm,
        mse_m2: mean(|score| score.mse_m2),
        median_mse_m2: median(known().map(|score| score.mse_m2)),
        pen_down_mse_m2: mean(|score| score.pen_down_mse_m2),
        leap_mse_m2: leap.is_finite().then_some(leap),
        max_m: known().map(|score| score.max_m).fold(0.0, f64::max),
        lag_ms: median(known().map(|score| score.lag_ms)),
        rms_jerk: mean(|score| score.rms_jerk * score.rms_jerk).sqrt(),
        saturated_pct: part(|score| score.limited),
        illegal_pct: part(|score| score.illegal),
        worse_than_hold_pct: hold.map(|_| 100.0 * worse as f64 / count as f64),
        worst_beyond_hold_m: hold
            .map(|_| pairs().map(|(score, hold)| score.rms_beyond(hold)).fold(f64::NEG_INFINITY, f64::max)),
        sequences: count,
    })
}
