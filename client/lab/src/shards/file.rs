//! The files of shards: what stands in them, and whether some of them are all the shards of one run.
//!
//! A file is JSON: the format's number, the program, the command, which shard of how many, the run (what must
//! be the same in every shard) and the part (what this one found).

use std::path::{Path, PathBuf};

use foretrace_config::files::read_text;
use foretrace_sim::data::shortened;
use serde::de::{DeserializeOwned, IgnoredAny};
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::Shard;

/// Raised when a field changes its meaning.
const FORMAT: u32 = 2;
/// Longest file \[bytes\].
pub const LONGEST: u64 = 4 << 30;
/// Missing shards that a message names.
const NAMED: usize = 20;

/// What one shard found.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ShardFile<R, P> {
    foretrace_lab_shard: u32,
    /// Version of the program, with its commit where it knows it.
    program: String,
    /// Sum of the program's own file: of two builds of a version, results may differ.
    program_file: String,
    command: String,
    pub shard: Shard,
    pub run: R,
    pub part: P,
}

/// Files that are not all the shards of one run.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum MergeError {
    #[error("{}: cannot read: {why}; give files that `foretrace lab ... --shard I/N --json FILE` wrote", file.display())]
    Unreadable { file: PathBuf, why: String },
    /// Not a file of a shard, or a damaged one.
    #[error("{}: no shard of a lab run: {why}; give files that `foretrace lab ... --shard I/N --json FILE` wrote", file.display())]
    Foreign { file: PathBuf, why: String },
    /// Of another version of the format.
    #[error("{}: written in format {found}, this program reads {FORMAT}; merge with the program that wrote it", file.display())]
    Format { file: PathBuf, found: u32 },
    /// Numbers that do not fit each other.
    #[error("{}: {why}; run this shard again", file.display())]
    Part { file: PathBuf, why: String },
    #[error("{} and {} are of different runs: {key} is {first_value} in the first and {other_value} in the second; \
             give the shards of one run, made with the same program, data and options", first.display(), other.display())]
    Mixed { first: PathBuf, other: PathBuf, key: String, first_value: String, other_value: String },
    /// The same shard again.
    #[error("{} and {} are both shard {shard}; give each once", first.display(), second.display())]
    Twice { shard: Shard, first: PathBuf, second: PathBuf },
    /// Shards without a file.
    #[error("{missing} of {count} shards are missing: {names}; run them, and give the files of all")]
    Missing { missing: usize, count: usize, names: String },
    #[error("no files; give those of all shards")]
    Nothing,
}

impl<R: Serialize, P: Serialize> ShardFile<R, P> {
    /// Of `program`: its version, and the [`Digest`](super::Digest) of its file.
    pub fn new(program: (&str, String), command: &str, shard: Shard, run: R, part: P) -> Self {
        let (program, program_file, command) = (program.0.to_owned(), program.1, command.to_owned());
        Self { foretrace_lab_shard: FORMAT, program, program_file, command, shard, run, part }
    }
}

/// What is looked at first.
#[derive(Deserialize)]
struct ShardHead {
    foretrace_lab_shard: u32,
    program: String,
    program_file: String,
    command: String,
    shard: Shard,
    run: Value,
    #[serde(rename = "part")]
    _part: IgnoredAny,
}

fn parsed<T: DeserializeOwned>(file: &Path) -> Result<T, MergeError> {
    let text = read_text(file, LONGEST)
        .map_err(|error| MergeError::Unreadable { file: file.to_owned(), why: error.to_string() })?;
    serde_json::from_str(&text).map_err(|error| MergeError::Foreign {
        file: file.to_owned(),
        why: shortened(&error.to_string(), 300),
    })
}

/// The command whose shards `files` are, all of them and each once.
///
/// # Errors
/// [`MergeError`]: the first thing that is wrong.
pub fn command_of(files: &[PathBuf]) -> Result<String, MergeError> {
    let mut heads: Vec<(&PathBuf, ShardHead)> = Vec::with_capacity(files.len());
    for file in files {
        let head: ShardHead = parsed(file)?;
        if head.foretrace_lab_shard != FORMAT {
            return Err(MergeError::Format { file: file.clone(), found: head.foretrace_lab_shard });
        }
        let Shard { index, count } = head.shard;
        if !(1..=count).contains(&index) || count > super::MOST_SHARDS {
            return Err(MergeError::Foreign {
                file: file.clone(),
                why: format!("it says that it is shard {index}/{count}"),
            });
        }
        heads.push((file, head));
    }
    let Some((first, told)) = heads.first() else { return Err(MergeError::Nothing) };
    for (other, head) in &heads {
        if let Some((key, first_value, other_value)) = difference(told, head) {
            let (first, other) = ((*first).clone(), (*other).clone());
            return Err(MergeError::Mixed { first, other, key, first_value, other_value });
        }
    }
    let mut owners: Vec<Option<&PathBuf>> = vec![None; told.shard.count];
    for (file, head) in &heads {
        match owners.get_mut(head.shard.index - 1) {
            Some(Some(first)) => {
                let (first, second) = ((*first).clone(), (*file).clone());
                return Err(MergeError::Twice { shard: head.shard, first, second });
            }
            Some(owner) => *owner = Some(file),
            None => {}
        }
    }
    let missing: Vec<String> =
        (1..).zip(&owners).filter(|(_, owner)| owner.is_none()).map(|(index, _)| index.to_string()).collect();
    if !missing.is_empty() {
        let more = if missing.len() > NAMED { " ..." } else { "" };
        let names = missing[..missing.len().min(NAMED)].join(", ") + more;
        return Err(MergeError::Missing { missing: missing.len(), count: owners.len(), names });
    }
    Ok(told.command.clone())
}

/// What two shards do not have in common, if anything.
fn difference(a: &ShardHead, b: &ShardHead) -> Option<(String, String, String)> {
    let plain = [
        ("command", &a.command, &b.command),
        ("program", &a.program, &b.program),
        ("program_file", &a.program_file, &b.program_file),
        ("N", &a.shard.count.to_string(), &b.shard.count.to_string()),
    ]
    .map(|(key, a, b)| (key.to_owned(), a.clone(), b.clone()));
    plain.into_iter().find(|(_, a, b)| a != b).or_else(|| differs("run", &a.run, &b.run))
}

fn differs(path: &str, a: &Value, b: &Value) -> Option<(String, String, String)> {
    match (a, b) {
        (Value::Object(ours), Value::Object(theirs)) => {
            let keys = ours.keys().chain(theirs.keys().filter(|key| !ours.contains_key(*key)));
            let value =
                |of: &serde_json::Map<String, Value>, key: &str| of.get(key).cloned().unwrap_or_default();
            keys.into_iter().find_map(|key| {
                differs(&format!("{path}.{}", shortened(key, 60)), &value(ours, key), &value(theirs, key))
            })
        }
        (Value::Array(ours), Value::Array(theirs)) if ours.len() == theirs.len() => (0..)
            .zip(ours.iter().zip(theirs))
            .find_map(|(index, (ours, theirs))| differs(&format!("{path}[{index}]"), ours, theirs)),
        // Settings are a text of hundreds of lines, of which one differs.
        (Value::String(ours), Value::String(theirs)) if ours != theirs => {
            let lines = ours.lines().zip(theirs.lines()).find(|(ours, theirs)| ours != theirs);
            let (ours, theirs) = lines.unwrap_or((ours, theirs));
            Some((
                path.to_owned(),
                shortened(&format!("{ours:?}"), 120),
                shortened(&format!("{theirs:?}"), 120),
            ))
        }
        _ => (a != b)
            .then(|| (path.to_owned(), shortened(&a.to_string(), 120), shortened(&b.to_string(), 120))),
    }
}

/// The run and the parts of `files`, which [`command_of`] has judged, with the file of each.
///
/// # Errors
/// A part that cannot be read.
pub(super) fn merged<R: DeserializeOwned, P: DeserializeOwned>(
    files: &[PathBuf],
) -> Result<(R, Vec<(PathBuf, P)>), MergeError> {
    let (mut run, mut parts) = (None, Vec::with_capacity(files.len()));
    for file in files {
        let ShardFile::<R, P> { run: told, part, .. } = parsed(file)?;
        run.get_or_insert(told);
        parts.push((file.clone(), part));
    }
    Ok((run.ok_or(MergeError::Nothing)?, parts))
}
