//! Whether a folder has a published set as it was measured, and its `split.tsv` by the rule.

use std::collections::{BTreeMap, BTreeSet};
use std::io::{ErrorKind, Write as _};
use std::path::Path;

use foretrace_failure::Failure;
use foretrace_host::sha256::sha256_of_file;
use foretrace_sim::data::{DataSet, load_recording};
use serde::Serialize;

use super::split_rule::by_place;
use super::{PublishedSet, SplitRule};

/// Files in a message.
const SHOWN: usize = 3;

/// What was found in a folder; keys are stable.
#[derive(Debug, Serialize)]
pub struct CheckedSet {
    pub set: &'static str,
    /// Files that have the known sum.
    pub same: usize,
    /// What no sum is known of.
    pub unknown: Option<&'static str>,
    pub split: SplitFound,
    /// The words that `--split` takes.
    pub parts: Vec<String>,
}

/// What became of `split.tsv`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum SplitFound {
    Written,
    /// It was there, and names the same parts.
    Agrees,
    /// The set needs none.
    NotNeeded,
}

/// Compares the files of `folder` with the sums of `set`, then writes its `split.tsv`, unless there is one.
///
/// # Errors
/// Missing files, files with another sum, writers that the published set does not have, a `split.tsv` with
/// other parts, a folder that cannot be read or written. Nothing is written then.
pub fn check(set: &'static PublishedSet, folder: &Path) -> Result<CheckedSet, Failure> {
    let same = compared(set, folder)?;
    let split = split(set, folder)?;
    let parts = DataSet::splits(folder).map_err(|error| Failure::bad_input(error, ""))?;
    Ok(CheckedSet { set: set.name, same, unknown: set.unknown, split, parts })
}

/// How many files have their sum, which are all.
fn compared(set: &PublishedSet, folder: &Path) -> Result<usize, Failure> {
    let (mut same, mut missing, mut other) = (0, Vec::new(), Vec::new());
    for (file, sum) in set.sums() {
        match sha256_of_file(&folder.join(file)) {
            Ok(found) if found == sum => same += 1,
            Ok(_) => other.push(file),
            Err(error) if error.kind() == ErrorKind::NotFound => missing.push(file),
            Err(error) => {
                let what = format!("{} cannot be read: {error}", folder.join(file).display());
                return Err(Failure::bad_input(what, "make it a file that you may read"));
            }
        }
    }
    let all = set.sums().count();
    let failed = |files: &[&str], what: &str| {
        let shown = files.iter().take(SHOWN).copied().collect::<Vec<_>>().join(", ");
        let more = match files.len().saturating_sub(SHOWN) {
            0 => String::new(),
            more => format!(" and {more} more"),
        };
        Failure::bad_input(
            format!("{}: {} of {all} files {what}: {shown}{more}", folder.display(), files.len()),
            format_args!("unpack the set as `foretrace lab fetch {}` says", set.name),
        )
    };
    if !missing.is_empty() {
        return Err(failed(&missing, "are missing"));
    }
    if !other.is_empty() {
        return Err(failed(&other, "differ from those that the results were measured with"));
    }
    Ok(same)
}

fn split(set: &PublishedSet, folder: &Path) -> Result<SplitFound, Failure> {
    if set.split == SplitRule::ByFile {
        return Ok(SplitFound::NotNeeded);
    }
    let known: BTreeSet<&str> =
        set.sums().map(|(file, _)| file).filter(|file| PublishedSet::is_recording(file)).collect();
    let files = writers_of(set, folder, &known)?;
    let table = table(set, &files, &known).map_err(|why| {
        let what = format!("{}: {why}", folder.display());
        Failure::bad_input(what, format_args!("unpack the set as `foretrace lab fetch {}` says", set.name))
    })?;
    let path = folder.join("split.tsv");
    match std::fs::read_to_string(&path) {
        Ok(there) if parts_of(&there) == parts_of(&table) => Ok(SplitFound::Agrees),
        Ok(_) => {
            let what = format!("{} names other parts than the rule ({})", path.display(), set.split_words);
            Err(Failure::bad_input(what, "move it away to get the one of the results"))
        }
        Err(error) if error.kind() == ErrorKind::NotFound => {
            let written = foretrace_host::whole::write(&path, |out| out.write_all(table.as_bytes()));
            written.map_err(|error| {
                let what = format!("{} cannot be written: {error}", path.display());
                Failure::failed(what, "make the folder one that you may write to")
            })?;
            Ok(SplitFound::Written)
        }
        Err(error) => {
            Err(Failure::bad_input(format!("{} cannot be read: {error}", path.display()), "move it away"))
        }
    }
}

/// The recordings below the folders that known ones lie in, with their writers.
fn writers_of(
    set: &PublishedSet,
    folder: &Path,
    known: &BTreeSet<&str>,
) -> Result<BTreeMap<String, String>, Failure> {
    let folders: BTreeSet<&str> = known.iter().filter_map(|file| Some(file.rsplit_once('/')?.0)).collect();
    let unreadable = |what: &dyn std::fmt::Display| {
        Failure::bad_input(what, format_args!("unpack the set as `foretrace lab fetch {}` says", set.name))
    };
    let mut found = BTreeMap::new();
    for below in folders {
        let path = folder.join(below);
        let entries = std::fs::read_dir(&path)
            .map_err(|error| unreadable(&format_args!("{}: {error}", path.display())))?;
        for entry in entries.flatten() {
            // Names that are not UTF-8 are none of the set's.
            let Ok(name) = entry.file_name().into_string() else { continue };
            if !name.ends_with(".dat") {
                continue;
            }
            let recording = load_recording(&entry.path()).map_err(|error| unreadable(&error))?;
            let writer = recording.segments.first().map(|character| character.writer.clone());
            found.insert(format!("{below}/{name}"), writer.unwrap_or_default());
        }
    }
    Ok(found)
}

/// `split.tsv` by the rule, which must take the files that were measured.
fn table(
    set: &PublishedSet,
    files: &BTreeMap<String, String>,
    known: &BTreeSet<&str>,
) -> Result<String, String> {
    let SplitRule::ByWriter { words } = set.split else { return Ok(String::new()) };
    let writers: BTreeSet<&String> = files.values().collect();
    let only_known = files.keys().map(String::as_str).eq(known.iter().copied());
    let text = if writers.len() == set.writers {
        by_place(files, words)
    } else if only_known {
        // Those that the rule leaves out are not there: the others keep their words in turn.
        let used: Vec<Option<&str>> = words.iter().copied().filter(Option::is_some).collect();
        by_place(files, &used)
    } else {
        return Err(format!("{} writers; the published set has {}", writers.len(), set.writers));
    };
    let taken: BTreeSet<String> = parts_of(&text).into_keys().collect();
    if !taken.iter().map(String::as_str).eq(known.iter().copied()) {
        return Err(format!("the rule ({}) takes other files than those measured", set.split_words));
    }
    Ok(text)
}

/// Files with their words and writers, whatever else a table has.
fn parts_of(table: &str) -> BTreeMap<String, (String, String)> {
    let mut lines = table.lines();
    let header: Vec<&str> = lines.next().unwrap_or_default().split('\t').collect();
    let at = |name: &str| header.iter().position(|column| *column == name);
    let (set, writer, file) = (at("set"), at("writer"), at("file"));
    let row = |line: &str| {
        let cells: Vec<&str> = line.split('\t').collect();
        let cell = |at: Option<usize>| at.and_then(|at| cells.get(at)).map_or("", |cell| cell).to_owned();
        (cell(file), (cell(set), cell(writer)))
    };
    lines.filter(|line| !line.trim().is_empty()).map(row).collect()
}
