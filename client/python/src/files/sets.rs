//! Data sets: every format that the lab reads, as sequences of samples in metres.
//!
//! Contract: positions are those of the file, scaled only: by its own unit of length, or where it names none,
//! so that a glyph of median height is as high as asked, one scale for the set, as in the lab. Samples that
//! have no stamps get those of the rate. What readers remarked, refused or found damaged stays with the set.

use std::path::PathBuf;

use foretrace_sim::data::{
    Character, CsvUnits, DataSet, Quantity, Recording, SetError, SetFile, Split, load_recording_in,
    median_glyph_height,
};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict, PyList};

use super::failed::of_set;
use super::values::{bytes_of, table};
use super::work::apart;
use crate::problem::{invalid, problem};

/// A set as it was loaded.
#[pyclass(frozen, module = "foretrace._native")]
struct LoadedSet {
    set: DataSet,
    /// Of each file: whether its points have stamps of their own.
    stamped: Vec<bool>,
    /// Metres per unit of files that name no unit.
    scale: f64,
    /// Every sequence: file and character.
    places: Vec<(usize, usize)>,
}

impl LoadedSet {
    fn of(mut set: DataSet, scale: f64) -> Self {
        let has = |character: &Character| character.components.iter().any(|c| !c.stamps_s.is_empty());
        let stamped: Vec<bool> =
            set.files.iter().map(|file| file.recording.segments.iter().any(has)).collect();
        set.files.iter_mut().for_each(|file| file.recording.stamp());
        let counts = set.files.iter().map(|file| file.recording.segments.len()).enumerate();
        let places = counts.flat_map(|(file, count)| (0..count).map(move |n| (file, n))).collect();
        Self { set, stamped, scale, places }
    }

    fn place(&self, index: usize) -> PyResult<(usize, &SetFile, &Character)> {
        let found = self.places.get(index).and_then(|(at, n)| {
            let file = self.set.files.get(*at)?;
            Some((*at, file, file.recording.segments.get(*n)?))
        });
        let count = self.places.len();
        found.ok_or_else(|| invalid(format_args!("sequence {index}; legal: 0 to below {count}")))
    }

    /// Metres per unit along x and y, and whether the file says so.
    fn metres(&self, recording: &Recording) -> ([f64; 2], bool) {
        match recording.units_per_m {
            Some(units) => (units.map(|per_m| 1.0 / per_m), true),
            None => ([self.scale; 2], false),
        }
    }
}

/// Of a file: name, part, rate [Hz], whether the rate is assumed, damage.
type FileFacts<'a> = (&'a str, Option<&'a str>, f64, bool, Option<&'a str>);

#[pymethods]
impl LoadedSet {
    #[getter]
    fn name(&self) -> &str {
        &self.set.name
    }

    /// Its files, in their order.
    #[getter]
    fn files(&self) -> Vec<FileFacts<'_>> {
        let files = self.set.files.iter();
        files
            .map(|SetFile { file, word, recording }| {
                let damage = recording.damage.as_deref();
                (file.as_str(), word.as_deref(), recording.rate_hz, recording.rate_assumed, damage)
            })
            .collect()
    }

    /// What could not be read, and what ends early: the reader's words.
    #[getter]
    fn errors(&self) -> Vec<String> {
        self.set.errors.iter().map(ToString::to_string).collect()
    }

    #[getter]
    fn remarks(&self) -> Vec<String> {
        self.set.remarks()
    }

    fn __len__(&self) -> usize {
        self.places.len()
    }

    /// About a sequence, without its samples.
    fn about<'py>(&self, python: Python<'py>, index: usize) -> PyResult<Bound<'py, PyDict>> {
        let (at, file, character) = self.place(index)?;
        let ([x, y], stated) = self.metres(&file.recording);
        let velocity = file.recording.quantity == Quantity::Velocity;
        Ok(table!(python;
            "label" => &character.label,
            "writer" => &character.writer,
            "split" => &file.word,
            "file" => &file.file,
            "index" => character.segment_index,
            "rate_hz" => file.recording.rate_hz,
            "rate_assumed" => file.recording.rate_assumed,
            "stamped" => self.stamped.get(at).copied().unwrap_or_default(),
            "metres_per_unit" => (x, y),
            "unit_stated" => stated,
            "integrated" => velocity,
        ))
    }

    /// Its samples: rows of 29 bytes, t [s], x and y [m], contact (u8), stroke (u32); the strokes: contact,
    /// samples, time without samples before [s], whether the stroke before goes on; place holders left out.
    fn samples<'py>(&self, python: Python<'py>, index: usize) -> PyResult<Bound<'py, PyDict>> {
        let (_, file, character) = self.place(index)?;
        let ([x_m, y_m], _) = self.metres(&file.recording);
        let (mut rows, mut number, mut holders) = (Vec::new(), 0_u32, 0_u32);
        let strokes = PyList::empty(python);
        for component in &character.components {
            if component.is_dummy() {
                holders += 1;
                continue;
            }
            for ([x, y], t_s) in component.points.iter().zip(&component.stamps_s) {
                rows.extend(bytes_of([*t_s, x * x_m, y * y_m]));
                rows.push(component.contact.into());
                rows.extend_from_slice(&number.to_le_bytes());
            }
            let (gap_s, goes_on) = (component.dt_before_s, component.continues);
            strokes.append((component.contact, component.points.len(), gap_s, goes_on))?;
            number += 1;
        }
        Ok(table!(python;
            "rows" => PyBytes::new(python, &rows),
            "strokes" => strokes,
            "place_holders" => holders,
        ))
    }
}

fn units(text: Option<&str>) -> PyResult<CsvUnits> {
    let units = text.map_or_else(|| Ok(CsvUnits::default()), str::parse);
    units.map_err(|legal| invalid(format_args!("unit is {text:?}; legal: {legal}")))
}

/// A single file as a set of one.
fn alone(path: PathBuf, units: CsvUnits) -> Result<DataSet, SetError> {
    let recording = load_recording_in(&path, units)?;
    let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let file = path.to_string_lossy().into_owned();
    let damage = recording.damage.as_ref().map(|damage| foretrace_sim::data::FileError {
        file: path.clone(),
        line: 0,
        reason: damage.clone(),
    });
    let files = vec![SetFile { file, word: None, recording }];
    Ok(DataSet { name, files, errors: Vec::new(), damaged: damage.into_iter().collect() })
}

fn loaded(
    path: PathBuf,
    split: &Split,
    strict: bool,
    units: CsvUnits,
    height_m: f64,
) -> Result<Option<LoadedSet>, SetError> {
    let set = if path.is_dir() {
        DataSet::load_in(&path, split, strict, units)?
    } else {
        alone(path.clone(), units)?
    };
    if set.files.iter().all(|file| file.recording.units_per_m.is_some()) {
        return Ok(Some(LoadedSet::of(set, f64::NAN)));
    }
    // Parts of a set are scaled alike, as in the lab: by its train part, else by all of it.
    let by = match split {
        _ if !path.is_dir() => None,
        Split::Named(word) if word == "train" => None,
        _ if DataSet::splits(&path)?.iter().any(|word| word == "train") => Some(Split::train()),
        Split::All => None,
        Split::Named(_) => Some(Split::All),
    };
    let by = by.map(|by| DataSet::load_in(&path, &by, strict, units)).transpose()?;
    let median = median_glyph_height(by.as_ref().unwrap_or(&set).characters());
    Ok(median.map(|median| LoadedSet::of(set, height_m / median)))
}

/// Loads a part of the set in a folder, or a single file.
#[pyfunction]
fn load_set(
    python: Python<'_>,
    path: PathBuf,
    split: &str,
    strict: bool,
    unit: Option<&str>,
    height_m: f64,
) -> PyResult<LoadedSet> {
    if !(height_m > 0.0 && height_m.is_finite()) {
        return Err(invalid(format_args!("height_m is {height_m} m; legal: positive and finite")));
    }
    let split = if split == "all" { Split::All } else { Split::Named(split.to_owned()) };
    if !path.is_dir() && split != Split::All {
        let what = "a single file has no parts: leave split out, or give the folder of the set";
        return Err(invalid(format_args!("{}: {what}", path.display())));
    }
    let units = units(unit)?;
    let shown = path.display().to_string();
    let found = apart(python, move |_| loaded(path, &split, strict, units, height_m))?.map_err(of_set)?;
    found.ok_or_else(|| {
        let what = "no glyph with a height to scale by, and no unit of length: give files that have one";
        problem(format_args!("{shown}: {what}"))
    })
}

/// The parts of the set in a folder, then `all`.
#[pyfunction]
fn set_splits(python: Python<'_>, folder: PathBuf) -> PyResult<Vec<String>> {
    apart(python, move |_| DataSet::splits(&folder))?.map_err(of_set)
}

pub fn add(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<LoadedSet>()?;
    module.add_function(wrap_pyfunction!(load_set, module)?)?;
    module.add_function(wrap_pyfunction!(set_splits, module)?)
}
