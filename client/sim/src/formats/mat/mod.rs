//! UCI Character Trajectories: MATLAB v5 files with a cell array of 3 x T matrices, one per character, to
//! [`Recording`].
//!
//! Rows are pen-tip velocity along x and y and pen-tip force, 200 times per second, smoothed before
//! publication; columns of zeros before and after a character are padding and are cut off. Velocities are
//! summed up to positions ([`Quantity::Velocity`]). Labels: `ytrain` beside `xtrain` (any `x…`, `y…`), or
//! `charlabels` of the published file's `consts`, as numbers from 1 into `key`; a file without them gives
//! characters without labels. One writer. Absent: force, MATLAB v4 and v7.3 (HDF5). Source: Williams,
//! Toussaint, Storkey, "Extracting motion primitives from natural handwriting data", ICANN 2006.

mod bytes;
mod array;

use crate::data::{Character, Component, FileError, Quantity, Recording};
use array::{Array, ArrayContent, read_file};
use std::path::Path;

const RATE_HZ: f64 = 200.0;
const VELOCITY_MAX: f64 = 1e6;

/// Reads the bytes of a file of the set.
///
/// # Errors
/// [`FileError`] that names the variable and cell: not MATLAB v5, damaged, too large when inflated, no or
/// several cell arrays of 3 x T matrices, numbers that are not finite, labels that do not fit.
pub(crate) fn parse_mat(data: &[u8], path: &Path) -> Result<Recording, FileError> {
    let segments = read_file(data).and_then(|variables| characters(&variables));
    Ok(Recording {
        source: path.to_path_buf(),
        rate_hz: RATE_HZ,
        rate_assumed: false,
        damage: None,
        units_per_m: None,
        quantity: Quantity::Velocity,
        segments: segments.map_err(|why| FileError::whole(path, why))?,
        remarks: Vec::new(),
    })
}

fn characters(variables: &[Array]) -> Result<Vec<Character>, String> {
    let sets: Vec<(&Array, &[Array])> =
        variables.iter().filter_map(|v| Some((v, v.cells()?))).filter(|(_, c)| trajectories(c)).collect();
    let [(variable, cells)] = sets[..] else {
        let names = |list: &[&str]| list.join(", ");
        return Err(if sets.is_empty() {
            let all: Vec<&str> = variables.iter().map(|v| v.name.as_str()).collect();
            format!(
                "no cell array of 3 x T matrices (velocity x, velocity y, force) among the variables [{}]",
                names(&all)
            )
        } else {
            let several: Vec<&str> = sets.iter().map(|(v, _)| v.name.as_str()).collect();
            format!("several cell arrays of 3 x T matrices: {}; keep one per file", names(&several))
        });
    };
    let labels = labels(variables, &variable.name, cells.len())?;
    let mut characters = Vec::with_capacity(cells.len());
    for (index, cell) in cells.iter().enumerate() {
        let points = positions(cell).map_err(|why| format!("{}{{{}}}: {why}", variable.name, index + 1))?;
        characters.push(Character {
            label: labels.get(index).cloned().unwrap_or_default(),
            writer: "1".to_owned(),
            segment_index: index,
            components: vec![Component { contact: true, points, ..Component::default() }],
        });
    }
    Ok(characters)
}

/// A cell array of nothing but 3 x T matrices.
fn trajectories(cells: &[Array]) -> bool {
    !cells.is_empty()
        && cells.iter().all(|c| matches!(c.content, ArrayContent::Numbers(_)) && matches!(c.dims[..], [3, _]))
}

/// Sums the velocities of one character up, from (0, 0), padding cut off: T velocities make T + 1 points.
fn positions(cell: &Array) -> Result<Vec<[f64; 2]>, String> {
    let ArrayContent::Numbers(values) = &cell.content else {
        return Err("not a matrix of numbers".to_owned());
    };
    // MATLAB stores columns one after the other.
    let columns: Vec<&[f64]> = values.chunks_exact(3).collect();
    let is_ink = |column: &&[f64]| column.iter().any(|v| *v != 0.0);
    let (Some(first), Some(last)) = (columns.iter().position(is_ink), columns.iter().rposition(is_ink))
    else {
        return Err("nothing but zeros, which are padding".to_owned());
    };
    let mut at = [0.0; 2];
    let mut points = vec![at];
    for (index, column) in columns.iter().enumerate().take(last + 1).skip(first) {
        for (axis, value) in at.iter_mut().zip(column.iter()) {
            if !(value.abs() <= VELOCITY_MAX) {
                return Err(format!(
                    "velocity {value} in column {} is outside [-{VELOCITY_MAX}, {VELOCITY_MAX}]",
                    index + 1
                ));
            }
            *axis += value;
        }
        points.push(at);
    }
    Ok(points)
}

/// One label per character, or none at all.
fn labels(variables: &[Array], trajectories: &str, count: usize) -> Result<Vec<String>, String> {
    let beside = trajectories.strip_prefix('x').map(|rest| format!("y{rest}"));
    let consts = variables.iter().find(|v| v.name == "consts");
    let found = variables
        .iter()
        .find(|v| Some(&v.name) == beside.as_ref())
        .or_else(|| consts.and_then(|c| c.field("charlabels")));
    let Some(numbers) = found else { return Ok(Vec::new()) };
    let name = &numbers.name;
    let ArrayContent::Numbers(values) = &numbers.content else { return Err(format!("{name}: not numbers")) };
    if values.len() != count {
        return Err(format!("{name}: {} labels for {count} characters", values.len()));
    }
    let key = variables.iter().find(|v| v.name == "key").or_else(|| consts.and_then(|c| c.field("key")));
    let words: Option<Vec<String>> = key.map(words).transpose()?;
    let label = |(index, value): (usize, &f64)| match &words {
        None => Ok(value.to_string()),
        Some(words) => {
            let number = (*value >= 1.0 && value.fract() == 0.0).then_some(*value as usize);
            number.and_then(|n| words.get(n - 1)).cloned().ok_or_else(|| {
                format!("{name}({}) is {value}; legal: 1 to {}, the entries of key", index + 1, words.len())
            })
        }
    };
    values.iter().enumerate().map(label).collect()
}

/// The entries of `key`: a cell array of texts, or one text with a letter per entry.
fn words(key: &Array) -> Result<Vec<String>, String> {
    let words = match &key.content {
        ArrayContent::Text(text) => Some(text.chars().map(String::from).collect()),
        ArrayContent::Cells(cells) => cells.iter().map(|c| c.text().map(str::to_owned)).collect(),
        _ => None,
    };
    words.ok_or_else(|| "key: neither a text nor a cell array of texts".to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Write as _;

    #[test]
    fn the_published_matrices_have_the_lengths_their_readme_states() {
        let shared = std::env::var_os("FORETRACE_SHARED")
            .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared"), Into::into);
        let folder = shared.join("data/character-trajectories");
        if !folder.is_dir() {
            // Past the capture of the test runner: a skipped test must be seen.
            let _ = writeln!(std::io::stderr(), "skipped: no {} (set FORETRACE_SHARED)", folder.display());
            return;
        }
        let mut lengths: Vec<usize> = Vec::new();
        for name in ["trajectories_train.mat", "trajectories_xtest.mat"] {
            let variables = read_file(&std::fs::read(folder.join(name)).unwrap()).unwrap();
            let cells = variables.iter().filter_map(Array::cells).find(|cells| trajectories(cells)).unwrap();
            lengths.extend(cells.iter().map(|c| c.dims[1]));
        }
        lengths.sort_unstable();
        let found = (lengths.len(), lengths[0], lengths[1429], lengths[2857], lengths.iter().sum::<usize>());
        assert_eq!(found, (2858, 109, 174, 205, 487_277));
    }
}
