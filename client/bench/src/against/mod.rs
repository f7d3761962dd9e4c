//! Two programs in turn: every cell, which is one part of the bench in one round, in a fresh process of each.
//!
//! Contract: who begins alternates by round. What each process printed is kept as it is. A row is the median
//! over rounds of a cell's p50; a ratio is the median over rounds of the other program's p50 over this one's
//! in the same round, with an interval of ranks; too few rounds give none. Whatever a program does instead of
//! measuring is an error that names it, round and part. None outlives this one.

mod child;
mod ratio;
mod rows;

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use foretrace_failure::Failure;
use serde::Serialize;

use crate::BenchPart;
use child::BenchProgram;
pub use ratio::RowRatio;
use ratio::{CONFIDENCE, ComparedRows, ROUNDS_MIN, compared};
use rows::BenchCell;

/// What to measure, and how.
#[derive(Debug)]
pub struct AgainstPlan<'a> {
    /// This program and the other.
    pub programs: [&'a Path; 2],
    /// Options of `foretrace bench` for both, without `--part` and `--json`.
    pub options: &'a [String],
    pub parts: &'a [BenchPart],
    pub rounds: u32,
    /// How long one process may take.
    pub patience: Duration,
    /// Where what the processes printed is kept; it is there, and empty.
    pub folder: &'a Path,
}

/// One of the two.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
enum BenchSide {
    This,
    Other,
}

impl BenchSide {
    const BOTH: [Self; 2] = [Self::This, Self::Other];

    const fn name(self) -> &'static str {
        match self {
            Self::This => "this",
            Self::Other => "other",
        }
    }

    /// Who goes first, then who goes second.
    const fn order(round: u32) -> [Self; 2] {
        if round.is_multiple_of(2) { Self::BOTH } else { [Self::Other, Self::This] }
    }
}

/// A process that ran, in the order of the list.
#[derive(Debug, Serialize)]
struct RanCell {
    round: u32,
    part: &'static str,
    side: BenchSide,
    /// What it printed, in the folder of cells.
    file: String,
    wall_s: f64,
}

/// A program as it named itself.
#[derive(Debug, Serialize)]
struct NamedProgram {
    program: PathBuf,
    /// SHA-256 of its file, the same before and after.
    sha256: String,
    version: String,
    optimised_build: bool,
}

/// The result; keys are stable.
#[derive(Debug, Serialize)]
pub struct BenchComparison {
    this: NamedProgram,
    other: NamedProgram,
    rounds: u32,
    horizon: u64,
    samples: u64,
    /// How often an interval holds the median, at least.
    confidence: f64,
    /// Options that both got.
    options: Vec<String>,
    pub rows: Vec<RowRatio>,
    /// Rows that only one of the two has; they are not compared.
    pub only_this: Vec<String>,
    pub only_other: Vec<String>,
    /// Rows of both that one of the two did not have in every round.
    pub not_every_round: Vec<String>,
    cells: Vec<RanCell>,
}

/// Word for a cell that is a whole bench, because one of the two does not know parts.
const WHOLE: &str = "all";

/// Runs both programs, and calls `done` with the number of every round that ended, from 1.
///
/// # Errors
/// A program that is not there, is not foretrace, ends with an error, takes too long or prints something
/// else; two that measured different problems; a folder that cannot be written.
pub fn compare(plan: &AgainstPlan<'_>, mut done: impl FnMut(u32)) -> Result<BenchComparison, Failure> {
    let [this, other] = plan.programs;
    let programs = [BenchProgram::greeted(this)?, BenchProgram::greeted(other)?];
    let parts = parts_of_both(&programs, plan.parts)?;
    let (mut cells, mut ran): ([Vec<BenchCell>; 2], Vec<RanCell>) = Default::default();
    let mut problem = None;
    for round in 0..plan.rounds {
        let mut found = [BenchCell::default(), BenchCell::default()];
        for part in &parts {
            for side in BenchSide::order(round) {
                let name = part.map_or(WHOLE, BenchPart::name);
                let file = format!("round-{:03}-{name}-{}.json", round + 1, side.name());
                let place =
                    format!("{}, round {}, part {name}", programs[side as usize].path().display(), round + 1);
                let began = Instant::now();
                let printed = programs[side as usize].bench(
                    plan.options,
                    *part,
                    plan.patience,
                    &plan.folder.join(&file),
                    &place,
                )?;
                // Said at once: the rest may take hours.
                same_problem(&mut problem, found[side as usize].take_in(&printed, &place)?)?;
                let wall_s = began.elapsed().as_secs_f64();
                ran.push(RanCell { round: round + 1, part: name, side, file, wall_s });
            }
        }
        for (kept, cell) in cells.iter_mut().zip(found) {
            kept.push(cell);
        }
        done(round + 1);
    }
    programs.iter().try_for_each(BenchProgram::unchanged)?;
    let [horizon, samples] = problem.unwrap_or_default();
    let ComparedRows { rows, only_this, only_other, not_every_round } = compared(&cells);
    let [this, other] = [BenchSide::This, BenchSide::Other].map(|side| NamedProgram {
        program: programs[side as usize].path().to_owned(),
        sha256: programs[side as usize].sha256().to_owned(),
        version: programs[side as usize].version().to_owned(),
        optimised_build: cells[side as usize].iter().all(BenchCell::optimised),
    });
    if rows.is_empty() {
        let what =
            format!("{} and {} have no row in common", this.program.display(), other.program.display());
        return Err(Failure::bad_input(what, "compare with a version nearer to this one"));
    }
    Ok(BenchComparison {
        this,
        other,
        rounds: plan.rounds,
        horizon,
        samples,
        confidence: CONFIDENCE,
        options: plan.options.to_vec(),
        rows,
        only_this,
        only_other,
        not_every_round,
        cells: ran,
    })
}

/// The parts that each get a process, or one whole bench where a program does not know them.
fn parts_of_both(
    programs: &[BenchProgram; 2],
    wanted: &[BenchPart],
) -> Result<Vec<Option<BenchPart>>, Failure> {
    let Some(without) = programs.iter().find(|program| !program.knows_parts()) else {
        return Ok(wanted.iter().copied().map(Some).collect());
    };
    if wanted.len() < BenchPart::ALL.len() {
        let what = format!("{} cannot time parts of the bench alone", without.path().display());
        return Err(Failure::usage(what, "leave --part out: then a cell is a whole bench"));
    }
    Ok(vec![None])
}

/// Refuses steps of the plan and instances per row that are not those of the first cell.
fn same_problem(first: &mut Option<[u64; 2]>, found: [u64; 2]) -> Result<(), Failure> {
    let first = *first.get_or_insert(found);
    if first == found {
        return Ok(());
    }
    let [one, other] =
        [first, found].map(|[steps, samples]| format!("{steps} steps and {samples} instances"));
    let what = format!("the two measured different problems: plans of {one}, and of {other}");
    Err(Failure::bad_input(what, "set what differs for both, for example --set mpc.horizon=20"))
}

impl BenchComparison {
    /// The table for people.
    #[must_use]
    pub fn lines(&self) -> Vec<String> {
        let mut lines = vec![
            format!("this     {}   {}", self.this.version, self.this.program.display()),
            format!("other    {}   {}", self.other.version, self.other.program.display()),
            format!(
                "medians over {} rounds of p50 [µs], plans of {} steps, {} instances",
                self.rounds, self.horizon, self.samples
            ),
            format!(
                "ratio: median of the rounds' own ratios, other / this; interval: their {:.0} % interval by rank\n",
                self.confidence * 100.0
            ),
        ];
        lines.extend(self.remarks());
        let width = self.rows.iter().map(|row| row.row.chars().count()).max().unwrap_or(0);
        lines.push(format!("{:<width$} {:>10} {:>10} {:>8}   interval", "", "this", "other", "ratio"));
        for RowRatio { row, this_us, other_us, ratio, low, high } in &self.rows {
            let interval = match (low, high) {
                (Some(low), Some(high)) => format!("{low:.3} to {high:.3}"),
                _ => "too few rounds".to_owned(),
            };
            lines.push(format!("{row:<width$} {this_us:>10.3} {other_us:>10.3} {ratio:>8.3}   {interval}"));
        }
        for (side, rows) in [("this", &self.only_this), ("other", &self.only_other)] {
            lines.extend(rows.iter().map(|row| format!("{row}: only {side} has it")));
        }
        let seldom = self.not_every_round.iter();
        lines.extend(seldom.map(|row| format!("{row}: not in every round; give more --samples")));
        lines
    }

    /// What a reader of the ratios has to know.
    fn remarks(&self) -> Vec<String> {
        let mut remarks = Vec::new();
        if self.cells.iter().any(|cell| cell.part == WHOLE) {
            remarks.push("one of the two cannot time parts alone: a cell is a whole bench\n".to_owned());
        }
        if self.rounds < ROUNDS_MIN as u32 {
            remarks.push(format!("an interval needs {ROUNDS_MIN} rounds (--rounds)\n"));
        }
        if self.this.optimised_build != self.other.optimised_build {
            let quick = if self.this.optimised_build { "other" } else { "this" };
            remarks.push(format!("{quick} is built for a quick start: these ratios compare builds\n"));
        }
        remarks
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn who_begins_alternates() {
        assert_eq!(BenchSide::order(0), [BenchSide::This, BenchSide::Other]);
        assert_eq!(BenchSide::order(1), [BenchSide::Other, BenchSide::This]);
        assert_eq!(BenchSide::order(2), BenchSide::order(0));
    }
}
