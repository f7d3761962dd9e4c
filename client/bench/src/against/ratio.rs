//! The ratio of two programs' medians of a row, with what chance may have made of it.

use std::collections::BTreeMap;

use serde::Serialize;

use super::rows::BenchCell;

/// Share of the bootstraps inside an interval.
pub(super) const CONFIDENCE: f64 = 0.95;
pub(super) const RESAMPLES: u32 = 2000;
/// Fixed, so that the same cells give the same interval.
pub(super) const SEED: u64 = 0x9e37_79b9_7f4a_7c15;

/// One row of both.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RowRatio {
    pub row: String,
    /// Medians over rounds \[µs\].
    pub this_us: f64,
    pub other_us: f64,
    /// Other over this: above 1, this program is faster.
    pub ratio: f64,
    pub low: f64,
    pub high: f64,
}

/// Rows that were looked at.
#[derive(Debug, Default)]
pub(super) struct ComparedRows {
    /// Both have them in every round.
    pub(super) rows: Vec<RowRatio>,
    pub(super) only_this: Vec<String>,
    pub(super) only_other: Vec<String>,
    /// Both have them, one of them not in every round.
    pub(super) not_every_round: Vec<String>,
}

/// Compares what can be compared, and names the rest.
pub(super) fn compared([this, other]: &[Vec<BenchCell>; 2]) -> ComparedRows {
    let mut others = rounds_of(other);
    let mut found = ComparedRows::default();
    for (row, of_this) in rounds_of(this) {
        match others.remove(&row) {
            None => found.only_this.push(row),
            Some(of_other) if of_this.len() == this.len() && of_other.len() == other.len() => {
                found.rows.push(ratio(row, &of_this, &of_other));
            }
            Some(_) => found.not_every_round.push(row),
        }
    }
    found.only_other = others.into_keys().collect();
    found
}

/// Every row's medians in the order of the rounds that have it \[µs\].
fn rounds_of(cells: &[BenchCell]) -> BTreeMap<String, Vec<f64>> {
    let mut found: BTreeMap<String, Vec<f64>> = BTreeMap::new();
    for cell in cells {
        for (row, us) in cell.rows() {
            found.entry(row.clone()).or_default().push(*us);
        }
    }
    found
}

/// Ratio of medians, and the middle of its bootstraps: whole rounds are drawn with replacement, so that both
/// programs keep the moment that they shared.
///
/// Source: Efron and Tibshirani 1993, An Introduction to the Bootstrap, section 13.3 (percentile interval).
fn ratio(row: String, this: &[f64], other: &[f64]) -> RowRatio {
    let mut dice = SEED;
    let mut ratios: Vec<f64> = (0..RESAMPLES)
        .map(|_| {
            let drawn: Vec<usize> = this.iter().map(|_| next(&mut dice) % this.len()).collect();
            let of = |rounds: &[f64]| median(drawn.iter().map(|round| rounds[*round]).collect());
            of(other) / of(this)
        })
        .collect();
    ratios.sort_by(f64::total_cmp);
    let at = |share: f64| ratios[(share * (ratios.len() - 1) as f64).round() as usize];
    let tail = (1.0 - CONFIDENCE) / 2.0;
    let (this_us, other_us) = (median(this.to_vec()), median(other.to_vec()));
    RowRatio { row, this_us, other_us, ratio: other_us / this_us, low: at(tail), high: at(1.0 - tail) }
}

fn next(dice: &mut u64) -> usize {
    *dice = dice.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
    (*dice >> 33) as usize
}

/// The middle one, or the mean of the two in the middle.
fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    let half = values.len() / 2;
    if values.len() % 2 == 1 { values[half] } else { f64::midpoint(values[half - 1], values[half]) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_median_of_an_even_count_lies_between_the_two_in_the_middle() {
        assert_eq!(median(vec![4.0, 1.0, 2.0, 100.0]), 3.0);
        assert_eq!(median(vec![4.0, 1.0, 2.0]), 2.0);
    }

    #[test]
    fn equal_rounds_leave_no_doubt_and_the_ratio_is_the_others_over_ours() {
        let row = ratio("ik".to_owned(), &[2.0; 5], &[3.0; 5]);
        assert_eq!((row.this_us, row.other_us, row.ratio), (2.0, 3.0, 1.5));
        assert_eq!((row.low, row.high), (1.5, 1.5));
    }

    /// Rounds in which the whole machine was slow say nothing about the two.
    #[test]
    fn what_both_shared_widens_nothing_and_what_one_had_alone_does() {
        let slow: Vec<f64> = (1..=10).map(f64::from).collect();
        let twice: Vec<f64> = slow.iter().map(|us| 2.0 * us).collect();
        let shared = ratio("shared".to_owned(), &slow, &twice);
        assert!((shared.low - 2.0).abs() < 1e-12 && (shared.high - 2.0).abs() < 1e-12, "{shared:?}");
        let alone = ratio("alone".to_owned(), &[5.5; 10], &slow);
        assert!(alone.low < 0.8 && alone.high > 1.2 && alone.low <= alone.ratio, "{alone:?}");
        assert_eq!(alone, ratio("alone".to_owned(), &[5.5; 10], &slow));
    }

    #[test]
    fn rows_that_one_lacks_in_any_round_are_named_and_not_compared() {
        let cell = |rows: &str| {
            let text = format!(r#"{{"horizon": 20, "samples": 50, "optimised_build": true, {rows}}}"#);
            let mut cell = BenchCell::default();
            cell.take_in(&text, "p").unwrap();
            cell
        };
        let both = || cell(r#""a": {"p50": 1}, "b": {"p50": 2}"#);
        let with_c = cell(r#""a": {"p50": 3}, "c": {"p50": 1}"#);
        let without = cell(r#""a": {"p50": 3}, "b": {"p50": 1}"#);
        let found = compared(&[vec![both(), both()], vec![with_c, without]]);
        assert_eq!(
            found.rows.iter().map(|row| (row.row.as_str(), row.ratio)).collect::<Vec<_>>(),
            [("a", 3.0)]
        );
        assert_eq!((found.not_every_round, found.only_other), (vec!["b".to_owned()], vec!["c".to_owned()]));
        assert!(found.only_this.is_empty());
        let found = compared(&[vec![both()], vec![cell(r#""a": {"p50": 1}"#)]]);
        assert_eq!(found.only_this, ["b"]);
    }
}
