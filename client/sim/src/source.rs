//! Where a pen path comes from: recordings, a data-set folder, a plain CSV, or the built-in writer.
//!
//! Contract: recorded ink is recentred into the workspace, one scale for all of it; a CSV is taken as it
//! stands. What had to be left out is reported in `notes`.

use std::fmt::Display;
use std::path::Path;

use foretrace_config::Settings;
use foretrace_failure::Failure;

use crate::data::{
    Character, CsvUnits, DataSet, Recording, Split, load_recording_in, median_glyph_height, read_csv, remarks,
};
use crate::path::{Anchor, Ink, Layout, Lift, PathSample, PenPath, Placement};
use crate::writer::text_path;

/// Part by which rates of files that are played together may differ.
const RATE_TOLERANCE: f64 = 0.05;
const REMEDY: &str =
    "give a recording, a data-set folder, a CSV with columns of time, x and y, an .mcap file, or glyphs:TEXT";

/// Placement of ink in the plane, and what is chosen of it.
#[derive(Debug, Clone)]
pub struct PathOptions {
    /// Height of a median glyph in the pen's plane \[m\]; for recorded ink and glyphs.
    pub height_m: f64,
    /// Enlarges the finished path about the centre of the workspace.
    pub scale: f64,
    /// So many times as fast as recorded.
    pub speed: f64,
    /// Seed of the built-in writer's hand.
    pub style: u64,
    /// Only characters with this label.
    pub label: Option<String>,
    /// Only these characters of the recording, counted from 0.
    pub segments: Option<(usize, usize)>,
    /// Units of columns of a CSV whose names have none.
    pub units: CsvUnits,
}

impl Default for PathOptions {
    fn default() -> Self {
        let units = CsvUnits::default();
        Self { height_m: 0.03, scale: 1.0, speed: 1.0, style: 1, label: None, segments: None, units }
    }
}

/// A path to play and what was left out of it.
#[derive(Debug)]
pub struct PenSource {
    pub path: PenPath,
    pub notes: Vec<String>,
}

impl PenSource {
    /// A path as it stands, enlarged and sped up as `options` say.
    pub fn of(path: PenPath, options: &PathOptions, settings: &Settings) -> Self {
        let path = scaled(path, options.scale, Workspace::of(settings).centre_m).time_scaled(options.speed);
        Self { path, notes: Vec::new() }
    }
}

/// Loads the sources `names` into the workspace of `settings`.
///
/// # Errors
///
/// A missing or malformed file, mixed kinds, nothing left to play, an unknown glyph.
pub fn load(names: &[String], options: &PathOptions, settings: &Settings) -> Result<PenSource, Failure> {
    let workspace = Workspace::of(settings);
    let (path, notes) = match names {
        [text] if text.starts_with("glyphs:") => {
            (glyphs(text.trim_start_matches("glyphs:"), options, &workspace)?, Vec::new())
        }
        [file] if has_extension(file, "csv") || has_extension(file, "tsv") => {
            let pen = read_csv(Path::new(file), options.units).map_err(wrong)?;
            if pen.metric {
                in_metres(file, &pen.path, settings.pen.bounds_m)?;
                (pen.path, remarks([(file.as_str(), &pen.remarks[..])]))
            } else {
                let (path, mut notes) = recordings(names, options, &workspace)?;
                notes.push(format!(
                    "{file}: x and y name no unit of length: written {} m high, in the middle of the workspace \
                     (x_mm and y_mm, or --unit mm, take it as it stands)",
                    options.height_m
                ));
                (path, notes)
            }
        }
        files => recordings(files, options, &workspace)?,
    };
    Ok(PenSource { notes, ..PenSource::of(path, options, settings) })
}

/// A path outside what the daemon takes from a pen is refused before anything starts.
fn in_metres(file: &str, path: &PenPath, [x, y]: [[f64; 2]; 2]) -> Result<(), Failure> {
    let Some([[x0, y0], [x1, y1]]) = path.bounds_m() else { return Ok(()) };
    if x0 >= x[0] && x1 <= x[1] && y0 >= y[0] && y1 <= y[1] {
        return Ok(());
    }
    let what = format!(
        "{file}: the pen goes from {x0:.3} to {x1:.3} m and from {y0:.3} to {y1:.3} m, {:.3} by {:.3} m in all; \
         pen.bounds_m takes {} to {} and {} to {} m",
        x1 - x0,
        y1 - y0,
        x[0],
        x[1],
        y[0],
        y[1]
    );
    Err(Failure::bad_input(
        what,
        "millimetres or pixels? write metres of the pen's own plane, or name the unit (x_mm, --unit mm)",
    ))
}

/// The writing workspace in metres of the pen's own plane.
pub struct Workspace {
    centre_m: [f64; 2],
    size_m: [f64; 2],
}

impl Workspace {
    pub fn of(settings: &Settings) -> Self {
        let plane = &settings.plane;
        let [x, y, _] = plane.workspace_m;
        let [x0, y0] = plane.pen_origin_m;
        let pen = |m: f64| m / plane.scale;
        Self {
            centre_m: [x0 + pen(0.5 * (x[0] + x[1])), y0 + pen(0.5 * (y[0] + y[1]))],
            size_m: [pen(x[1] - x[0]), pen(y[1] - y[0])],
        }
    }

    pub fn placement(&self, height_m: f64, layout: Layout, anchor: Anchor) -> Placement {
        let Self { centre_m, size_m } = *self;
        Placement { centre_m, size_m, glyph_height_m: height_m, layout, anchor, lift: Lift::Travel }
    }
}

/// Rate of the built-in writer's tablet \[Hz\].
const GLYPH_RATE_HZ: f64 = 200.0;

fn glyphs(text: &str, options: &PathOptions, workspace: &Workspace) -> Result<PenPath, Failure> {
    let placement = workspace.placement(options.height_m, Layout::Line, Anchor::Baseline);
    let mut path = text_path(text, options.style, GLYPH_RATE_HZ, &placement).map_err(wrong)?;
    // A line begins at the left border: move the finished text to the middle.
    if let Some([[left, _], [right, _]]) = path.bounds_m() {
        let shift = workspace.centre_m[0] - 0.5 * (left + right);
        path.samples.iter_mut().for_each(|sample| sample.x_m += shift);
    }
    Ok(path)
}

fn recordings(
    names: &[String],
    options: &PathOptions,
    workspace: &Workspace,
) -> Result<(PenPath, Vec<String>), Failure> {
    let mut notes = Vec::new();
    let mut recordings: Vec<Recording> = Vec::new();
    for name in names {
        let path = Path::new(name);
        if path.is_dir() {
            let words = DataSet::splits(path).map_err(wrong)?;
            let split = if words.iter().any(|word| word == "test") { Split::test() } else { Split::All };
            let set = DataSet::load_in(path, &split, false, options.units).map_err(wrong)?;
            notes.extend(set.errors.iter().chain(&set.damaged).map(ToString::to_string));
            recordings.extend(set.files.into_iter().map(|file| file.recording));
        } else {
            let recording = load_recording_in(path, options.units).map_err(wrong)?;
            notes.extend(recording.damage.iter().map(|damage| format!("{name}: {damage}")));
            recordings.push(recording);
        }
    }
    let Some(rate_hz) = recordings.first().map(|recording| recording.rate_hz) else {
        return Err(Failure::bad_input("no pen path was named", REMEDY));
    };
    let other = |recording: &&Recording| (recording.rate_hz / rate_hz - 1.0).abs() > RATE_TOLERANCE;
    if let Some(other) = recordings.iter().find(other) {
        let what = format!(
            "{} is sampled at {} Hz, the files before it at {rate_hz} Hz",
            other.source.display(),
            other.rate_hz
        );
        return Err(Failure::bad_input(what, "play files of one rate together"));
    }
    // Rates that were found from stamps are never quite the same.
    for recording in recordings.iter_mut().filter(|recording| recording.rate_hz != rate_hz) {
        recording.stamp();
    }
    let files =
        recordings.iter().map(|recording| (recording.source.to_string_lossy(), &recording.remarks[..]));
    let files: Vec<_> = files.collect();
    notes.extend(remarks(files.iter().map(|(file, remarks)| (file.as_ref(), *remarks))));
    if let Some(guessed) = recordings.iter().find(|recording| recording.rate_assumed) {
        notes.push(format!("{} does not state its rate; {rate_hz} Hz assumed", guessed.source.display()));
    }
    let all: Vec<Character> = recordings.into_iter().flat_map(|recording| recording.segments).collect();
    let median_height = median_glyph_height(&all).unwrap_or_default();
    let chosen = chosen(all, options)?;
    let ink = Ink { characters: &chosen, rate_hz, median_height };
    let placement = workspace.placement(options.height_m, Layout::Centre, Anchor::Middle);
    let (path, skipped) = PenPath::from_ink(ink, &placement).map_err(wrong)?;
    notes.extend(skipped.into_iter().map(|what| format!("left out {what}")));
    Ok((path, notes))
}

fn chosen(all: Vec<Character>, options: &PathOptions) -> Result<Vec<Character>, Failure> {
    let count = all.len();
    let (first, last) = options.segments.unwrap_or((0, usize::MAX));
    let chosen: Vec<Character> = all
        .into_iter()
        .enumerate()
        .filter(|(index, _)| (first..=last).contains(index))
        .map(|(_, character)| character)
        .filter(|character| options.label.as_ref().is_none_or(|label| character.label == *label))
        .collect();
    if chosen.is_empty() {
        let what = match &options.label {
            Some(label) => format!("no character {label:?} among the {count} of the recording"),
            None => format!("no character numbered {first} or more among the {count} of the recording"),
        };
        return Err(Failure::bad_input(what, "choose others with --label or --segments"));
    }
    Ok(chosen)
}

fn scaled(mut path: PenPath, factor: f64, centre: [f64; 2]) -> PenPath {
    let [x0, y0] = centre;
    for sample in &mut path.samples {
        let PathSample { x_m, y_m, .. } = sample;
        *x_m = x0 + factor * (*x_m - x0);
        *y_m = y0 + factor * (*y_m - y0);
    }
    path
}

fn wrong(error: impl Display) -> Failure {
    Failure::bad_input(error, REMEDY)
}

/// Whether the name of `file` ends in `.extension`, in letters of any case.
pub fn has_extension(file: &str, extension: &str) -> bool {
    Path::new(file).extension().is_some_and(|found| found.eq_ignore_ascii_case(extension))
}
