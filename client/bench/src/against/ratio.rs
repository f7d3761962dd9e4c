//! The ratio of two programs' medians of a row, with what chance may have made of it.

use std::collections::BTreeMap;

use foretrace_sim::spread::median;
use serde::Serialize;

use super::rows::BenchCell;
use crate::dice::BenchDice;

/// Share of the bootstraps inside an interval.
pub(super) const CONFIDENCE: f64 = 0.95;
pub(super) const RESAMPLES: u32 = 2000;
/// The interval needs so many rounds. The widest that bootstraps of n rounds can be, least to largest ratio,
/// misses the median of all rounds with probability 2^(1 - n): of five, more often than one in twenty.
pub(super) const ROUNDS_MIN: usize = 6;

/// One row of both.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RowRatio {
    pub row: String,
    /// Medians over rounds \[µs\].
    pub this_us: f64,
    pub other_us: f64,
    /// Other over this: above 1, this program is faster.
    pub ratio: f64,
    /// The interval around it; `null` with fewer than 6 rounds, which say too little for one.
    pub low: Option<f64>,
    pub high: Option<f64>,
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
    let [this_us, other_us] = [this, other].map(|rounds| median(rounds.iter().copied()).unwrap_or(f64::NAN));
    let [low, high] = interval(this, other).map_or([None; 2], |ends| ends.map(Some));
    RowRatio { row, this_us, other_us, ratio: other_us / this_us, low, high }
}

fn interval(this: &[f64], other: &[f64]) -> Option<[f64; 2]> {
    if this.len() < ROUNDS_MIN {
        return None;
    }
    let mut dice = BenchDice::new();
    let mut ratios: Vec<f64> = (0..RESAMPLES)
        .map(|_| {
            let drawn: Vec<usize> = this.iter().map(|_| dice.place(this.len())).collect();
            let of = |rounds: &[f64]| median(drawn.iter().map(|round| rounds[*round])).unwrap_or(f64::NAN);
            of(other) / of(this)
        })
        .collect();
    ratios.sort_by(f64::total_cmp);
    let at = |share: f64| ratios.get((share * (ratios.len() - 1) as f64).round() as usize).copied();
    let tail = (1.0 - CONFIDENCE) / 2.0;
    Some([at(tail)?, at(1.0 - tail)?])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_rounds_leave_no_doubt_and_the_ratio_is_the_others_over_ours() {
        let row = ratio("ik".to_owned(), &[2.0; 6], &[3.0; 6]);
        assert_eq!((row.this_us, row.other_us, row.ratio), (2.0, 3.0, 1.5));
        assert_eq!((row.low, row.high), (Some(1.5), Some(1.5)));
    }

    /// What is called 95 % holds the truth that often: the median of a wide lot from which rounds are drawn.
    #[test]
    fn intervals_hold_the_truth_as_often_as_they_say_and_fewer_rounds_have_none() {
        let few = ratio("few".to_owned(), &[1.0; 5], &[1.0, 2.0, 3.0, 4.0, 5.0]);
        assert_eq!((few.ratio, few.low, few.high), (3.0, None, None));
        let mut dice = BenchDice::new();
        for (rounds, least) in [(6, 0.93), (10, 0.93)] {
            let holds = (0..400).filter(|_| {
                let other: Vec<f64> =
                    (0..rounds).map(|_| 1.0 + dice.next() as f64 / BenchDice::BOUND as f64).collect();
                let row = ratio("row".to_owned(), &vec![1.0; rounds], &other);
                row.low.unwrap() <= 1.5 && 1.5 <= row.high.unwrap()
            });
            let share = holds.count() as f64 / 400.0;
            assert!(share > least, "{share} of {rounds} rounds");
        }
    }

    /// Rounds in which the whole machine was slow say nothing about the two.
    #[test]
    fn what_both_shared_widens_nothing_and_what_one_had_alone_does() {
        let slow: Vec<f64> = (1..=10).map(f64::from).collect();
        let twice: Vec<f64> = slow.iter().map(|us| 2.0 * us).collect();
        let shared = ratio("shared".to_owned(), &slow, &twice);
        let ends = |row: &RowRatio| [row.low.unwrap(), row.high.unwrap()];
        assert!(ends(&shared).iter().all(|end| (end - 2.0).abs() < 1e-12), "{shared:?}");
        let alone = ratio("alone".to_owned(), &[5.5; 10], &slow);
        let [low, high] = ends(&alone);
        assert!(low < 0.8 && high > 1.2 && low <= alone.ratio, "{alone:?}");
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
