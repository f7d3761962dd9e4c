//! Predictions made elsewhere: a CSV with the columns `file,segment,t,lead,x,y` and optionally `r50,r90`.
//!
//! One row per target that `export` lists: `x,y` is the position \[raw units, in the coordinates of the
//! exported points\] at which the pen is expected `lead` ms after point `t`, from nothing newer than that
//! point; `r50`, `r90` are the radii \[raw units\] that should hold half and nine tenths of the true
//! positions. Rows may stand in any order.

use foretrace_config::files::read_text;
use foretrace_sim::data::shortened;
use std::collections::HashMap;
use std::path::{Path, PathBuf};

use super::super::CharacterSequence;
use super::targets::Targets;
use super::{LEADS_MS, SHARES};

const COLUMNS: [&str; 6] = ["file", "segment", "t", "lead", "x", "y"];
const BANDS: [&str; 2] = ["r50", "r90"];
const POSITION_MAX: f64 = 1e12;
/// Longest file \[bytes\]: ten million rows.
const LONGEST: u64 = 512 << 20;

/// A file of predictions that was refused.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum PredictionError {
    /// The system refused.
    #[error("{}: cannot read predictions: {why}", file.display())]
    Unreadable { file: PathBuf, why: String },
    /// A line that does not fit.
    #[error("{}:{line}: {why}", file.display())]
    Row {
        file: PathBuf,
        /// Line from 1.
        line: usize,
        /// What does not fit and what would.
        why: String,
    },
    /// Targets without a prediction.
    #[error(
        "{}: {missing} of {wanted} targets of {set} have no prediction, first: {first}; predict every row \
         that \
         --export-targets writes",
        file.display()
    )]
    Missing {
        file: PathBuf,
        set: String,
        /// How many are missing.
        missing: usize,
        /// How many there are.
        wanted: usize,
        /// The first missing one.
        first: String,
    },
}

#[derive(Debug, Clone, Copy)]
struct PredictionRow {
    line: usize,
    /// Index into `files`.
    file: usize,
    segment: usize,
    point: usize,
    lead: usize,
    answer: BandedPosition,
}

/// A predicted position and its error bands.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BandedPosition {
    /// Expected position, in the coordinates of the points \[raw units\].
    pub position: [f64; 2],
    /// 50 % and 90 % radius \[raw units\].
    pub radii: Option<[f64; SHARES.len()]>,
}

/// The content of a file of predictions.
#[derive(Debug, Clone)]
pub struct Predictions {
    path: PathBuf,
    files: Vec<String>,
    rows: Vec<PredictionRow>,
}

impl Predictions {
    /// Reads and checks everything that can be checked without a set.
    ///
    /// # Errors
    /// [`PredictionError`] with file and line.
    pub fn load(path: &Path) -> Result<Self, PredictionError> {
        let text = read_text(path, LONGEST)
            .map_err(|e| PredictionError::Unreadable { file: path.to_path_buf(), why: e.to_string() })?;
        Self::parse(&text, path)
    }

    pub(super) fn parse(text: &str, path: &Path) -> Result<Self, PredictionError> {
        let bad = |line: usize, why: String| PredictionError::Row { file: path.to_path_buf(), line, why };
        let mut lines = text
            .trim_start_matches('\u{feff}')
            .lines()
            .enumerate()
            .map(|(index, line)| (index + 1, line.trim()))
            .filter(|(_, line)| !line.is_empty() && !line.starts_with('#'));
        let (line, header) = lines.next().unwrap_or((1, ""));
        let header = fields(header);
        let column = |name: &str| header.iter().position(|h| h == name);
        let (Some(columns), bands) = (all(COLUMNS.map(column)), all(BANDS.map(column))) else {
            let (wanted, found) = (COLUMNS.join(","), shortened(&format!("{header:?}"), 200));
            return Err(bad(
                line,
                format!("the header must name {wanted} and may name r50,r90; found {found}"),
            ));
        };
        let mut predictions = Self { path: path.to_path_buf(), files: Vec::new(), rows: Vec::new() };
        let mut known: HashMap<String, usize> = HashMap::new();
        for (line, text) in lines {
            let cells = fields(text);
            let cell = |index: usize| cells.get(index).map_or("", String::as_str);
            let (name, [segment, point, lead]) =
                (cell(columns[0]), [cell(columns[1]), cell(columns[2]), cell(columns[3])]);
            let count = |what: &str, text: &str| {
                text.parse::<usize>().map_err(|_| {
                    bad(line, format!("{what} is {:?}; legal: 0, 1, 2 ...", shortened(text, 40)))
                })
            };
            let length = |what: &str, text: &str, low: f64| {
                let value = text.parse::<f64>().ok().filter(|v| (low..=POSITION_MAX).contains(v));
                value.ok_or_else(|| {
                    let text = shortened(text, 40);
                    bad(line, format!("{what} is {text:?}; legal: {low:e} to {POSITION_MAX:e}"))
                })
            };
            let ahead =
                lead.parse::<f64>().ok().and_then(|ms| LEADS_MS.iter().position(|l| f64::from(*l) == ms));
            let Some(ahead) = ahead else {
                let lead = shortened(lead, 40);
                return Err(bad(line, format!("lead is {lead:?}; legal: 10, 20 ... 200 [ms]")));
            };
            let position = [
                length("x", cell(columns[4]), -POSITION_MAX)?,
                length("y", cell(columns[5]), -POSITION_MAX)?,
            ];
            let radii = match bands {
                Some([half, most]) => {
                    Some([length("r50", cell(half), 0.0)?, length("r90", cell(most), 0.0)?])
                }
                None => None,
            };
            let file = *known.entry(name.to_owned()).or_insert_with(|| {
                predictions.files.push(name.to_owned());
                predictions.files.len() - 1
            });
            let (segment, point) = (count("segment", segment)?, count("t", point)?);
            let answer = BandedPosition { position, radii };
            predictions.rows.push(PredictionRow { line, file, segment, point, lead: ahead, answer });
        }
        Ok(predictions)
    }

    /// The answers to every target of a set, in the order of its instants and leads; `None` if no row is
    /// about the set.
    ///
    /// # Errors
    /// [`PredictionError`]: rows about characters or instants that the set does not have, twice the same, or
    /// targets left out.
    pub fn answers(
        &self,
        set: &str,
        sequences: &[CharacterSequence],
        targets: &Targets,
    ) -> Result<Option<Vec<BandedPosition>>, PredictionError> {
        let bad = |line: usize, why: String| PredictionError::Row { file: self.path.clone(), line, why };
        let here: HashMap<&str, ()> = sequences.iter().map(|s| (s.file.as_str(), ())).collect();
        let ours: Vec<bool> = self.files.iter().map(|f| here.contains_key(f.as_str())).collect();
        let mut slots: HashMap<(&str, usize, usize, usize), usize> = HashMap::new();
        for instant in &targets.instants {
            let Some(s) = sequences.get(instant.sequence) else { continue };
            for lead in instant.scored() {
                let slot = slots.len();
                slots.insert((&s.file, s.segment, instant.point, lead), slot);
            }
        }
        let mut answers: Vec<Option<BandedPosition>> = vec![None; slots.len()];
        let mut any = false;
        for row in self.rows.iter().filter(|row| ours.get(row.file).copied().unwrap_or(false)) {
            let name = self.files.get(row.file).map_or("", String::as_str);
            any = true;
            let Some(slot) = slots.get(&(name, row.segment, row.point, row.lead)) else {
                let PredictionRow { segment, point, .. } = row;
                let lead = LEADS_MS.get(row.lead).copied().unwrap_or_default();
                return Err(bad(
                    row.line,
                    format!(
                        "file {name:?}, segment {segment}, t {point}, lead {lead} is not a target of {set}; \
                         predict the rows that --export-targets writes"
                    ),
                ));
            };
            match answers.get_mut(*slot) {
                Some(slot @ None) => *slot = Some(row.answer),
                _ => return Err(bad(row.line, "this target was predicted before".to_owned())),
            }
        }
        if !any {
            return Ok(None);
        }
        let missing = answers.iter().filter(|a| a.is_none()).count();
        if missing > 0 {
            let first = answers.iter().position(Option::is_none).unwrap_or_default();
            let key = slots.iter().find(|(_, slot)| **slot == first).map(|(key, _)| *key);
            let first = key.map_or_else(String::new, |(file, segment, t, lead)| {
                let lead = LEADS_MS.get(lead).copied().unwrap_or_default();
                format!("file {file:?}, segment {segment}, t {t}, lead {lead}")
            });
            let (file, set, wanted) = (self.path.clone(), set.to_owned(), answers.len());
            return Err(PredictionError::Missing { file, set, missing, wanted, first });
        }
        Ok(Some(answers.into_iter().flatten().collect()))
    }

    /// The first row about a file that none of the sets has.
    ///
    /// # Errors
    /// That row.
    pub fn about_known_files(&self, sets: &[&[CharacterSequence]]) -> Result<(), PredictionError> {
        let stray = |row: &&PredictionRow| {
            let name = self.files.get(row.file).map_or("", String::as_str);
            !sets.iter().any(|set| set.iter().any(|s| s.file == name))
        };
        // One test per file name, not per row.
        let mut tested = vec![false; self.files.len()];
        let mut firsts = self
            .rows
            .iter()
            .filter(|row| tested.get_mut(row.file).is_some_and(|tested| !std::mem::replace(tested, true)));
        match firsts.find(stray) {
            None => Ok(()),
            Some(row) => {
                let name = self.files.get(row.file).map_or("", String::as_str);
                let why = format!("file {name:?} is in none of the sets; write it as --export-targets does");
                Err(PredictionError::Row { file: self.path.clone(), line: row.line, why })
            }
        }
    }
}

fn all<const N: usize>(positions: [Option<usize>; N]) -> Option<[usize; N]> {
    let found = positions.map(Option::unwrap_or_default);
    positions.iter().all(Option::is_some).then_some(found)
}

/// The fields of a CSV line; a field in double quotes may hold commas, and quotes written twice.
fn fields(line: &str) -> Vec<String> {
    let mut fields = vec![String::new()];
    let mut quoted = false;
    let mut characters = line.chars().peekable();
    while let Some(character) = characters.next() {
        match character {
            '"' if quoted && characters.peek() == Some(&'"') => {
                characters.next();
                fields.last_mut().iter_mut().for_each(|f| f.push('"'));
            }
            '"' => quoted = !quoted,
            ',' if !quoted => fields.push(String::new()),
            other => fields.last_mut().iter_mut().for_each(|f| f.push(other)),
        }
    }
    fields.iter().map(|field| field.trim().to_owned()).collect()
}
