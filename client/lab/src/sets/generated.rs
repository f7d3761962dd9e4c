//! A small set in the hands of the built-in writer, so that every command of the lab runs without recordings.
//!
//! Contract: the same writers, text and seed give the same bytes. One UNIPEN file per writer, hover between
//! strokes included, and a `split.tsv` by the rule of unipen-tos. What predictors score on it says nothing
//! about people: its hands follow the model that wrote them.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::io::Write as _;
use std::path::{Path, PathBuf};

use foretrace_failure::Failure;
use foretrace_sim::data::{Character, Component};
use foretrace_sim::writer::{WriterError, write_text};

use super::SplitRule;

const RATE_HZ: f64 = 200.0;
/// Of a pen display such as that of unipen-ced.
const UNITS_PER_MM: f64 = 50.0;
/// Capitals of 5 mm.
const UNITS_PER_EM: f64 = 5.0 * UNITS_PER_MM;
/// From one letter's origin to the next one's.
const PITCH_EM: f64 = 1.5;
/// Between two letters, where the pen is away.
const GAP_MS: u32 = 400;

/// What is to be written.
#[derive(Debug, Clone)]
pub struct GeneratedSet {
    /// At least two, one of them for each part.
    pub writers: u32,
    /// What each of them writes; blanks are left out.
    pub text: String,
    /// Of the first writer's hand; the others count on.
    pub seed: u64,
}

/// A set that could not be written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum GenerateError {
    #[error(transparent)]
    Text(#[from] WriterError),
    #[error("{} writers; legal are 2 to 99", .0)]
    Writers(u32),
}

impl GeneratedSet {
    /// Names and contents of its files, `split.tsv` among them.
    ///
    /// # Errors
    /// A text that the built-in writer cannot write, a number of writers outside 2 to 99.
    pub fn files(&self) -> Result<BTreeMap<String, String>, GenerateError> {
        if !(2..=99).contains(&self.writers) {
            return Err(GenerateError::Writers(self.writers));
        }
        let (mut files, mut writers) = (BTreeMap::new(), BTreeMap::new());
        for number in 0..self.writers {
            let writer = format!("hand-{:02}", number + 1);
            let recording = write_text(&self.text, self.seed.wrapping_add(u64::from(number)), RATE_HZ)?;
            let written = recording.segments.iter().filter(|letter| !letter.components.is_empty());
            let name = format!("{writer}.dat");
            files.insert(name.clone(), unipen(&writer, written));
            writers.insert(name, writer);
        }
        files.extend(SplitRule::EVEN_AND_ODD.table(&writers).map(|table| ("split.tsv".to_owned(), table)));
        Ok(files)
    }

    /// Writes the set into `folder`, which must be new or empty; the table, which makes it a set, last.
    ///
    /// # Errors
    /// As [`Self::files`]; a folder with files, or one that cannot be written.
    pub fn write(&self, folder: &Path) -> Result<Vec<PathBuf>, Failure> {
        let files = self.files().map_err(|error| Failure::bad_input(error, ""))?;
        let remedy = "give a new or empty folder that you may write to";
        let refused = |why: &dyn std::fmt::Display| {
            Failure::bad_input(format!("no set can be written to {}: {why}", folder.display()), remedy)
        };
        std::fs::create_dir_all(folder).map_err(|error| refused(&error))?;
        if std::fs::read_dir(folder).map_err(|error| refused(&error))?.next().is_some() {
            return Err(refused(&"it has files"));
        }
        let mut paths = Vec::new();
        // In the order of names the table is last.
        for (name, text) in &files {
            let path = folder.join(name);
            let written = foretrace_host::whole::write(&path, |out| out.write_all(text.as_bytes()));
            written.map_err(|error| {
                Failure::failed(format!("{} cannot be written: {error}", path.display()), remedy)
            })?;
            paths.push(path);
        }
        Ok(paths)
    }
}

/// One writer's letters as UNIPEN 1.0, side by side on a line.
fn unipen<'a>(writer: &str, letters: impl Iterator<Item = &'a Character>) -> String {
    let mut segments = String::new();
    let mut ink = String::new();
    let mut components = 0;
    for (place, letter) in letters.enumerate() {
        let first = components;
        for component in &letter.components {
            block(&mut ink, component, place as f64 * PITCH_EM);
            components += 1;
        }
        let last = components - 1;
        let of = if first == last { first.to_string() } else { format!("{first}-{last}") };
        let label = letter.label.replace('\\', "\\\\").replace('"', "\\\"");
        // Into a text nothing fails.
        let _ = writeln!(segments, ".SEGMENT CHARACTER {of} OK \"{label}\"");
        let _ = writeln!(ink, ".PEN_UP\n.DT {GAP_MS}");
    }
    format!(
        ".VERSION 1.0\n.DATA_SOURCE foretrace\n.COMMENT The built-in writer's hand, no person's.\n.WRITER_ID \
         {writer}\n.COORD X Y\n.POINTS_PER_SECOND {RATE_HZ}\n.X_POINTS_PER_MM {UNITS_PER_MM}\n\
         .Y_POINTS_PER_MM {UNITS_PER_MM}\n{segments}{ink}"
    )
}

fn block(ink: &mut String, component: &Component, right_em: f64) {
    ink.push_str(if component.contact { ".PEN_DOWN\n" } else { ".PEN_UP\n" });
    for [x, y] in &component.points {
        let [x, y] = [x + right_em, *y].map(|em| (em * UNITS_PER_EM).round() as i64);
        let _ = writeln!(ink, "{x} {y}");
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use foretrace_sim::data::{DataSet, Split};

    fn set(text: &str) -> GeneratedSet {
        GeneratedSet { writers: 4, text: text.to_owned(), seed: 7 }
    }

    #[test]
    fn the_same_writers_text_and_seed_give_the_same_bytes_and_others_do_not() {
        let files = set("Ka i").files().unwrap();
        assert_eq!(files, set("Ka i").files().unwrap());
        let hands: Vec<&String> = files.values().collect();
        assert!((1..hands.len()).all(|i| hands[i] != hands[i - 1]));
        let other = GeneratedSet { seed: 8, ..set("Ka i") }.files().unwrap();
        assert_ne!(files["hand-01.dat"], other["hand-01.dat"]);
    }

    #[test]
    fn what_is_written_is_read_as_it_was_meant() {
        let folder = tempfile::tempdir().unwrap();
        let below = folder.path().join("writers");
        let paths = set("Ka i!").write(&below).unwrap();
        assert!(paths.len() == 5 && paths[4].ends_with("split.tsv"), "{paths:?}");
        let load = |split| DataSet::load(&below, &split, true).unwrap();
        let of = |set: &DataSet| set.files.iter().map(|file| file.file.clone()).collect::<Vec<_>>();
        assert_eq!(of(&load(Split::train())), ["hand-01.dat", "hand-03.dat"]);
        assert_eq!(of(&load(Split::test())), ["hand-02.dat", "hand-04.dat"]);
        let all = load(Split::All);
        assert_eq!(all.remarks(), Vec::<String>::new());
        for (number, file) in all.files.iter().enumerate() {
            let read = &file.recording;
            assert_eq!((read.rate_hz, read.rate_assumed), (200.0, false));
            assert_eq!(read.units_per_m, Some([50_000.0; 2]));
            let labels: String = read.segments.iter().map(|letter| letter.label.as_str()).collect();
            assert_eq!(labels, "Kai!");
            assert!(read.segments.iter().all(|letter| letter.writer == format!("hand-{:02}", number + 1)));
            let wrote = write_text("Ka i!", 7 + number as u64, RATE_HZ).unwrap();
            let wrote = wrote.segments.iter().filter(|letter| !letter.components.is_empty());
            for (read, wrote) in read.segments.iter().zip(wrote) {
                let shape = |letter: &Character| {
                    letter.components.iter().map(|c| (c.contact, c.points.len())).collect::<Vec<_>>()
                };
                assert_eq!(shape(read), shape(wrote), "{}", read.label);
            }
        }
    }

    #[test]
    fn what_cannot_be_written_is_refused_and_leaves_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let below = folder.path().join("writers");
        let told = |set: GeneratedSet| set.write(&below).unwrap_err().to_string();
        assert!(told(set("\u{e4}")).contains("no built-in glyph"));
        assert!(told(set(" ")).contains("blank"));
        assert!(told(GeneratedSet { writers: 1, ..set("K") }).contains("2 to 99"));
        assert!(!below.exists());
        std::fs::create_dir(&below).unwrap();
        std::fs::write(below.join("mine"), "").unwrap();
        assert!(told(set("K")).contains("has files"));
    }
}
