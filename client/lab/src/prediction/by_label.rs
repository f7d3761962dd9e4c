//! The paper's per-symbol analysis: where curvy symbols favour one model and straight ones another.
//!
//! Curviness of a character: smooth turning per glyph height of path \[rad\]. Each stroke is resampled at H/6
//! (H: median height of the characters), the turning angles of the resampled path are added up without those
//! of corners (beyond [`CORNER_RAD`]) and of the device's grid (within [`FLAT_RAD`]), and divided by the
//! path's length in H. A circle of height H has 2, a zigzag about 0.1: a corner inside a piece becomes two
//! lesser turns.

use std::collections::BTreeMap;

use foretrace_sim::spread::median;
use serde::Serialize;

use super::score::Mean;
use super::{CharacterSequence, Run, Tally};

/// A sharper turn between two pieces of the resampled path is a corner, which is not curvy.
const CORNER_RAD: f64 = std::f64::consts::FRAC_PI_3;
/// A smaller one may be the grid of the device.
const FLAT_RAD: f64 = 0.12;
/// Pieces of the resampled path per glyph height.
const PIECES: f64 = 6.0;
/// Labels with fewer sequences are shown, but do not count in correlations.
pub const MIN_SEQUENCES: usize = 5;

#[derive(Debug, Clone, Serialize)]
pub struct LabelRow {
    pub label: String,
    pub sequences: usize,
    /// Smooth turning per glyph height of path, mean over the sequences \[rad\].
    pub curviness: Option<f64>,
    /// Mean squared error of each model \[raw units²\].
    pub mse: BTreeMap<String, Option<f64>>,
    /// The same within strokes.
    pub within: BTreeMap<String, Option<f64>>,
}

/// Whether one model gains on another where symbols are curvy.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Correlation {
    /// The model that is expected to gain.
    pub favoured: String,
    pub against: String,
    /// Spearman's rank correlation over labels of curviness with ln(within of `against` / within of
    /// `favoured`).
    pub spearman: Option<f64>,
    pub labels: usize,
}

/// Errors by symbol, most curvy first.
#[must_use]
pub fn by_label(sequences: &[CharacterSequence], runs: &[Run]) -> Vec<LabelRow> {
    let height = glyph_height(sequences);
    let mut labels: BTreeMap<&str, Vec<usize>> = BTreeMap::new();
    for (index, sequence) in sequences.iter().enumerate() {
        labels.entry(&sequence.label).or_default().push(index);
    }
    let mut rows: Vec<LabelRow> = labels
        .into_iter()
        .map(|(label, members)| {
            let mut curviness = Mean::default();
            for sequence in members.iter().filter_map(|i| sequences.get(*i)) {
                if let Some(value) = height.and_then(|h| curviness_of(sequence, h)) {
                    curviness.push(value);
                }
            }
            let pooled = |run: &Run| {
                members.iter().filter_map(|i| run.tallies.get(*i)).fold(Tally::default(), |mut sum, tally| {
                    sum.merge(tally);
                    sum
                })
            };
            let errors = |of: fn(&Tally) -> Option<f64>| {
                runs.iter().map(|run| (run.model.clone(), of(&pooled(run)))).collect()
            };
            LabelRow {
                label: label.to_owned(),
                sequences: members.len(),
                curviness: curviness.get(),
                mse: errors(Tally::mse),
                within: errors(|t| t.within.get()),
            }
        })
        .collect();
    rows.sort_by(|a, b| b.curviness.unwrap_or(-1.0).total_cmp(&a.curviness.unwrap_or(-1.0)));
    rows
}

/// The gain of `favoured` on every other model against curviness.
#[must_use]
pub fn correlations(rows: &[LabelRow], favoured: &str) -> Vec<Correlation> {
    let models = rows.first().map(|row| row.within.keys()).into_iter().flatten();
    models
        .filter(|model| *model != favoured)
        .map(|against| {
            let points: Vec<(f64, f64)> = gains(rows, favoured, against)
                .filter(|(row, _)| row.sequences >= MIN_SEQUENCES)
                .filter_map(|(row, gain)| Some((row.curviness?, gain)))
                .collect();
            let (favoured, against) = (favoured.to_owned(), against.clone());
            Correlation { favoured, against, spearman: spearman(&points), labels: points.len() }
        })
        .collect()
}

/// ln(within of `against` / within of `favoured`) of every symbol that has both.
pub fn gains<'a>(
    rows: &'a [LabelRow],
    favoured: &'a str,
    against: &'a str,
) -> impl Iterator<Item = (&'a LabelRow, f64)> {
    rows.iter().filter_map(move |row| {
        let within = |model: &str| row.within.get(model).copied().flatten();
        let gain = (within(against)? / within(favoured)?).ln();
        gain.is_finite().then_some((row, gain))
    })
}

/// Median height of the characters that have one \[raw units\], from their displacements.
#[must_use]
pub fn glyph_height(sequences: &[CharacterSequence]) -> Option<f64> {
    median(sequences.iter().map(height_of).filter(|h| *h > 0.0))
}

fn height_of(sequence: &CharacterSequence) -> f64 {
    let (mut y, mut low, mut high) = (0.0_f64, 0.0_f64, 0.0_f64);
    for [_, dy] in &sequence.v {
        y += dy;
        (low, high) = (low.min(y), high.max(y));
    }
    high - low
}

/// Smooth turning per glyph height of path \[rad\]; `None` for characters shorter than three pieces.
#[must_use]
pub fn curviness_of(sequence: &CharacterSequence, glyph_height: f64) -> Option<f64> {
    let piece = glyph_height / PIECES;
    if !(piece > 0.0 && piece.is_finite()) {
        return None;
    }
    let (mut turning, mut length, mut pieces) = (0.0, 0.0, 0_usize);
    // Walks along each stroke; a piece ends where the pen is one piece away from where it began.
    let (mut gone, mut heading): ([f64; 2], Option<[f64; 2]>) = ([0.0; 2], None);
    for (v, jump) in sequence.v.iter().zip(&sequence.jump) {
        if *jump {
            (gone, heading) = ([0.0; 2], None);
            continue;
        }
        gone = [gone[0] + v[0], gone[1] + v[1]];
        let reach = gone[0].hypot(gone[1]);
        if reach < piece {
            continue;
        }
        if let Some(before) = heading {
            let cross = before[0] * gone[1] - before[1] * gone[0];
            let dot = before[0] * gone[0] + before[1] * gone[1];
            let angle = cross.atan2(dot).abs();
            if (FLAT_RAD..CORNER_RAD).contains(&angle) {
                turning += angle;
            }
        }
        (pieces, length) = (pieces + 1, length + reach);
        (heading, gone) = (Some(gone), [0.0; 2]);
    }
    (pieces >= 3).then(|| turning * glyph_height / length)
}

/// Spearman's rank correlation; `None` for fewer than three points or without spread.
fn spearman(points: &[(f64, f64)]) -> Option<f64> {
    if points.len() < 3 {
        return None;
    }
    let x = ranks(points.iter().map(|p| p.0).collect());
    let y = ranks(points.iter().map(|p| p.1).collect());
    let centre = (points.len() as f64 - 1.0) / 2.0;
    let product =
        |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| (a - centre) * (b - centre)).sum::<f64>();
    let spread = (product(&x, &x) * product(&y, &y)).sqrt();
    (spread > 0.0).then(|| product(&x, &y) / spread)
}

/// Rank of every value from 0, the mean rank where values are equal.
fn ranks(values: Vec<f64>) -> Vec<f64> {
    let below = |v: f64| values.iter().filter(|other| **other < v).count();
    let same = |v: f64| values.iter().filter(|other| **other == v).count();
    values.iter().map(|v| below(*v) as f64 + (same(*v) as f64 - 1.0) / 2.0).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn drawn(points: impl IntoIterator<Item = [f64; 2]>) -> CharacterSequence {
        let points: Vec<[f64; 2]> = points.into_iter().collect();
        let v: Vec<[f64; 2]> = points.windows(2).map(|p| [p[1][0] - p[0][0], p[1][1] - p[0][1]]).collect();
        CharacterSequence {
            file: String::new(),
            writer: String::new(),
            segment: 0,
            label: "x".to_owned(),
            jump: vec![false; v.len()],
            v,
            rate_hz: 200.0,
            rate_assumed: false,
            units_per_m: None,
        }
    }

    #[test]
    fn circle_turns_twice_per_height_and_zigzags_hardly() {
        let circle = drawn((0..=400).map(|i| {
            let angle = std::f64::consts::TAU * f64::from(i) / 400.0;
            [50.0 * angle.cos(), 50.0 * angle.sin()]
        }));
        assert!((height_of(&circle) - 100.0).abs() < 0.1);
        let value = curviness_of(&circle, 100.0).unwrap();
        assert!((value - 2.0).abs() < 0.15, "{value}");
        let zigzag = drawn((0..300).map(|i| [f64::from(i), f64::from((i % 200 - 100_i32).abs())]));
        let value = curviness_of(&zigzag, 100.0).unwrap();
        assert!(value < 0.2, "{value}");
        let line = drawn((0..300).map(|i| [f64::from(i), 0.5 * f64::from(i)]));
        assert_eq!(curviness_of(&line, 100.0), Some(0.0));
        assert_eq!(curviness_of(&drawn([[0.0, 0.0], [1.0, 1.0]]), 100.0), None);
    }

    #[test]
    fn rank_correlation_is_worked_out_by_hand() {
        assert_eq!(spearman(&[(1.0, 5.0), (2.0, 6.0), (9.0, 70.0)]), Some(1.0));
        assert_eq!(spearman(&[(1.0, 3.0), (2.0, 2.0), (3.0, 1.0)]), Some(-1.0));
        // Ranks 0 1 2 3 against 1 0 3 2: 1 - 6 * 4 / (4 * 15).
        let value = spearman(&[(1.0, 2.0), (2.0, 1.0), (3.0, 4.0), (4.0, 3.0)]).unwrap();
        assert!((value - 0.6).abs() < 1e-12);
        assert_eq!(spearman(&[(1.0, 1.0), (1.0, 2.0), (1.0, 3.0)]), None);
    }
}
