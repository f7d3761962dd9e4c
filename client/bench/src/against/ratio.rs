//! The ratio of two programs in a row, round by round, with what chance may have made of its median.

use std::collections::BTreeMap;

use foretrace_sim::spread::median;
use serde::Serialize;

use super::rows::BenchCell;

/// An interval holds the median of the ratios of all rounds that there could be at least so often.
pub(super) const CONFIDENCE: f64 = 0.95;
/// The interval needs so many rounds: that of five from the least ratio to the largest misses the median with
/// probability 2^(1 - 5), more often than one in twenty.
pub(super) const ROUNDS_MIN: usize = 6;

/// One row of both.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RowRatio {
    pub row: String,
    /// Medians over rounds \[µs\].
    pub this_us: f64,
    pub other_us: f64,
    /// Median over rounds of other over this, both of one round: above 1, this program is faster.
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

/// Each round gives one ratio, so that both programs keep the moment that they shared.
fn ratio(row: String, this: &[f64], other: &[f64]) -> RowRatio {
    let middle = |values: &[f64]| median(values.iter().copied()).unwrap_or(f64::NAN);
    let mut ratios: Vec<f64> = this.iter().zip(other).map(|(this, other)| other / this).collect();
    ratios.sort_by(f64::total_cmp);
    let [low, high] = interval(&ratios).map_or([None; 2], |ends| ends.map(Some));
    RowRatio { row, this_us: middle(this), other_us: middle(other), ratio: middle(&ratios), low, high }
}

/// From the k-th smallest to the k-th largest ratio. Nothing is assumed of how ratios are spread: each lies
/// below their median as often as above it.
///
/// Source: Conover 1999, Practical Nonparametric Statistics, 3rd edition, section 3.2 (intervals of
/// quantiles).
fn interval(sorted: &[f64]) -> Option<[f64; 2]> {
    let rank = rank(sorted.len())?;
    Some([*sorted.get(rank - 1)?, *sorted.get(sorted.len() - rank)?])
}

/// The largest k for which fewer than k of so many fair coins, on either side, fall with at most the
/// probability that [`CONFIDENCE`] leaves; none below [`ROUNDS_MIN`].
fn rank(rounds: usize) -> Option<usize> {
    // That exactly k coins fall, and fewer than k.
    let (mut exactly, mut fewer) = (0.5_f64.powi(i32::try_from(rounds).ok()?), 0.0);
    let mut rank = None;
    for k in 1..=rounds {
        fewer += exactly;
        if 2.0 * fewer > 1.0 - CONFIDENCE {
            break;
        }
        exactly *= (rounds - k + 1) as f64 / k as f64;
        rank = Some(k);
    }
    rank
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dice::BenchDice;

    #[test]
    fn equal_rounds_leave_no_doubt_and_the_ratio_is_the_others_over_ours() {
        let row = ratio("ik".to_owned(), &[2.0; 6], &[3.0; 6]);
        assert_eq!((row.this_us, row.other_us, row.ratio), (2.0, 3.0, 1.5));
        assert_eq!((row.low, row.high), (Some(1.5), Some(1.5)));
    }

    /// The interval misses the median where fewer than k of n ratios lie on one side of it: counted in whole
    /// numbers, over all ways in which n coins fall.
    #[test]
    fn intervals_hold_the_median_in_95_of_100_cases_and_the_next_narrower_ones_do_not() {
        assert_eq!((0..6).map(rank).collect::<Vec<_>>(), [None; 6]);
        for rounds in 6..=100_usize {
            let mut row = vec![1_u128];
            for _ in 0..rounds {
                let next =
                    |k: usize| row.get(k).unwrap_or(&0) + k.checked_sub(1).map_or(0, |below| row[below]);
                row = (0..=row.len()).map(next).collect();
            }
            let all: u128 = row.iter().sum();
            // In twentieths.
            let misses = |rank: usize| 20 * 2 * row[..rank].iter().sum::<u128>() > all;
            let rank = rank(rounds).unwrap();
            assert!(!misses(rank) && misses(rank + 1), "{rank} of {rounds}");
        }
        let ranks = [(6, 1), (8, 1), (9, 2), (11, 2), (12, 3), (20, 6), (40, 14)];
        assert!(ranks.iter().all(|(rounds, k)| rank(*rounds) == Some(*k)));
    }

    /// The same by chance, with ratios that are spread unevenly and rounds of which the machine was slow.
    #[test]
    fn intervals_hold_the_truth_as_often_as_they_say_and_fewer_rounds_have_none() {
        let few = ratio("few".to_owned(), &[1.0; 5], &[1.0, 2.0, 3.0, 4.0, 5.0]);
        assert_eq!((few.ratio, few.low, few.high), (3.0, None, None));
        let mut dice = BenchDice::new();
        let mut drawn = || dice.next() as f64 / BenchDice::BOUND as f64;
        for rounds in [6, 7, 8, 10, 14, 21] {
            let holds = (0..4000).filter(|_| {
                let slow: Vec<f64> = (0..rounds).map(|_| 1.0 + 9.0 * drawn()).collect();
                // The square of what is even from 0 to 1 has the median 1/4.
                let other: Vec<f64> = slow.iter().map(|us| us * (1.0 + drawn().powi(2))).collect();
                let row = ratio("row".to_owned(), &slow, &other);
                assert!(row.low.unwrap() <= row.ratio && row.ratio <= row.high.unwrap());
                row.low.unwrap() <= 1.25 && 1.25 <= row.high.unwrap()
            });
            let share = holds.count() as f64 / 4000.0;
            // Three times what 4000 draws make of a share of 0.95.
            assert!(share > 0.95 - 0.0104, "{share} of {rounds} rounds");
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
