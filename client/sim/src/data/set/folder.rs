//! A folder without a table: every file of its one format, in order of name.
//!
//! Hidden files, links to folders and folders named `include` (UNIPEN's library) are passed over; tables of
//! words (`.tsv`) count as recordings by their contents only.

use super::{ListedFile, SetError};
use crate::data::Format;
use crate::data::hint::what_is_there;
use std::collections::BTreeMap;
use std::path::Path;

const TABLE: &str = "split.tsv";
const DEPTH_MAX: usize = 16;
const FILES_MAX: usize = 200_000;

/// The recordings below `folder`, by name, with the parts that their names tell.
pub(super) fn find(folder: &Path) -> Result<Vec<ListedFile>, SetError> {
    let mut files = Vec::new();
    walk(folder, "", 0, &mut files)?;
    files.sort();
    let (tables, files): (Vec<String>, Vec<String>) =
        files.into_iter().partition(|file| is_split_table(file));
    let found = |files: &[String]| what_is_there(folder, &[&tables, files].concat());
    let by_contents: Vec<Option<Format>> =
        files.iter().map(|f| Format::of_file(&folder.join(f)).unwrap_or_default()).collect();
    let by_name: Vec<Option<Format>> =
        files.iter().map(|f| Format::of_name(Path::new(f)).filter(|_| !is_table(f))).collect();
    let of_each: Vec<Option<Format>> =
        by_contents.iter().zip(&by_name).map(|(contents, name)| contents.or(*name)).collect();
    // The folder above several sets: each has a table of its own, and may be named.
    let inner: Vec<&str> = tables.iter().filter_map(|table| table.strip_suffix(TABLE)).collect();
    let within = |file: &&String| inner.iter().any(|set| file.starts_with(set));
    let mut inked = files.iter().zip(&of_each).filter_map(|(file, format)| format.map(|_| file));
    let above_sets = !inner.is_empty() && inked.all(|file| within(&file));
    let no_format = || SetError::NoFormat { folder: folder.to_path_buf(), found: found(&files) };
    if above_sets {
        return Err(no_format());
    }
    // Names decide only if no contents do: then every file is bad, and each gives its reason.
    let format = match only(folder, &files, &by_contents)? {
        Some(format) => format,
        None => only(folder, &files, &by_name)?.ok_or_else(no_format)?,
    };
    let rows = files.into_iter().zip(of_each);
    Ok(rows
        .filter(|(_, of_file)| *of_file == Some(format))
        .map(|(file, _)| ListedFile {
            word: format.natural_split(&file).map(str::to_owned),
            file,
            writer: String::new(),
            format: Some(format),
        })
        .collect())
}

/// Tells the parts of a set; a folder below another may hold one of its own.
fn is_split_table(file: &str) -> bool {
    file.rsplit('/').next() == Some(TABLE)
}

/// Tables beside recordings, such as lists of labels, are no recordings for their name alone.
fn is_table(file: &str) -> bool {
    Path::new(file).extension().is_some_and(|extension| extension.eq_ignore_ascii_case("tsv"))
}

/// The one format of the files; `None` when no file has one.
fn only(folder: &Path, files: &[String], formats: &[Option<Format>]) -> Result<Option<Format>, SetError> {
    let mut first: BTreeMap<Format, &String> = BTreeMap::new();
    for (file, format) in files.iter().zip(formats) {
        if let Some(format) = format {
            first.entry(*format).or_insert(file);
        }
    }
    if first.len() > 1 {
        let found: Vec<String> = first.iter().map(|(format, file)| format!("{format}: {file}")).collect();
        return Err(SetError::Ambiguous { folder: folder.to_path_buf(), found: found.join(", ") });
    }
    Ok(first.into_keys().next())
}

fn walk(root: &Path, below: &str, depth: usize, files: &mut Vec<String>) -> Result<(), SetError> {
    let folder = if below.is_empty() { root.to_path_buf() } else { root.join(below) };
    let unreadable = |why: String| SetError::Unreadable {
        path: folder.clone(),
        why: format!(
            "cannot read the folder: {why}; a set is a folder of recordings, with or without a split.tsv"
        ),
    };
    if depth > DEPTH_MAX {
        return Err(unreadable(format!("nested deeper than {DEPTH_MAX} folders")));
    }
    for entry in std::fs::read_dir(&folder).map_err(|e| unreadable(e.to_string()))? {
        let entry = entry.map_err(|e| unreadable(e.to_string()))?;
        // Names that are not UTF-8 cannot be written into a table either.
        let Ok(name) = entry.file_name().into_string() else { continue };
        let kind = entry.file_type().map_err(|e| unreadable(e.to_string()))?;
        let path = if below.is_empty() { name.clone() } else { format!("{below}/{name}") };
        if name.starts_with('.') {
            continue;
        }
        if kind.is_dir() {
            if name != "include" {
                walk(root, &path, depth + 1, files)?;
            }
        } else if root.join(&path).is_file() {
            if files.len() == FILES_MAX {
                return Err(unreadable(format!("more than {FILES_MAX} files; name them in a split.tsv")));
            }
            files.push(path);
        }
    }
    Ok(())
}
