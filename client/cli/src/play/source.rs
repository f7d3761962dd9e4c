//! Where a pen path comes from: recordings, a data-set folder, a plain CSV, or the built-in writer.
//!
//! Contract: recorded ink is recentred into the workspace, one scale for all of it; a CSV is taken as it
//! stands. What had to be left out is reported in `notes`.

use std::convert::Infallible;
use std::fmt::Display;
use std::path::Path;

use foretrace_config::Settings;
use foretrace_record::pen::pen_samples;
use foretrace_record::read::Reader;
use foretrace_sim::data::{
    Character, DataSet, Recording, Split, load_csv, load_recording, median_glyph_height,
};
use foretrace_sim::path::{Anchor, Ink, Layout, Lift, PathSample, PenPath, Placement};
use foretrace_sim::writer::text_path;

use crate::failure::Failure;
use crate::record::unrecorded;

const REMEDY: &str =
    "give a recording, a data-set folder, a CSV with t_s,x_m,y_m,contact, an .mcap file, or glyphs:TEXT";

/// Placement of ink in the plane.
#[derive(Debug, Clone, clap::Args)]
pub(crate) struct PathArgs {
    /// Height of a median glyph in the pen's plane [m]; for recorded ink and glyphs
    #[arg(long, value_name = "M", default_value_t = 0.03, value_parser = positive)]
    pub(crate) height: f64,

    /// Enlarge the finished path about the centre of the workspace
    #[arg(long, value_name = "FACTOR", default_value_t = 1.0, value_parser = positive)]
    pub(crate) scale: f64,

    /// Play this many times as fast as recorded
    #[arg(long, value_name = "FACTOR", default_value_t = 1.0, value_parser = positive)]
    pub(crate) speed: f64,

    /// Seed of the built-in writer's hand
    #[arg(long, value_name = "SEED", default_value_t = 1)]
    pub(crate) style: u64,

    /// Play only characters with this label, for example --label K
    #[arg(long, value_name = "LABEL")]
    pub(crate) label: Option<String>,

    /// Play only characters FIRST to LAST of the recording, counted from 0
    #[arg(long, value_name = "FIRST[-LAST]", value_parser = segments)]
    pub(crate) segments: Option<(usize, usize)>,
}

impl Default for PathArgs {
    fn default() -> Self {
        Self { height: 0.03, scale: 1.0, speed: 1.0, style: 1, label: None, segments: None }
    }
}

/// A path to play and what was left out of it.
#[derive(Debug)]
pub(crate) struct Source {
    pub(crate) path: PenPath,
    pub(crate) notes: Vec<String>,
}

/// Loads the sources `names` of the command line into the workspace of `settings`.
///
/// # Errors
///
/// A missing or malformed file, mixed kinds, nothing left to play, an unknown glyph.
pub(crate) fn load(names: &[String], args: &PathArgs, settings: &Settings) -> Result<Source, Failure> {
    let workspace = Workspace::of(settings);
    let mut source = match names {
        [text] if text.starts_with("glyphs:") => {
            glyphs(text.trim_start_matches("glyphs:"), args, &workspace)?
        }
        [file] if has_extension(file, "mcap") => {
            Source { path: recorded_pen(Path::new(file))?, notes: Vec::new() }
        }
        [file] if has_extension(file, "csv") => {
            let path = load_csv(Path::new(file)).map_err(wrong)?;
            in_metres(file, &path, settings.pen.bounds_m)?;
            Source { path, notes: Vec::new() }
        }
        files => recordings(files, args, &workspace)?,
    };
    source.path = scaled(source.path, args.scale, workspace.centre_m).time_scaled(args.speed);
    Ok(source)
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
    Err(Failure::bad_input(what, "millimetres or pixels? write metres of the pen's own plane"))
}

/// The pen of a recording of everything, as the ticks were given it.
fn recorded_pen(file: &Path) -> Result<PenPath, Failure> {
    let mut samples: Vec<PathSample> = Vec::new();
    let mut first_ns = None;
    let mut reader = Reader::open(file).map_err(unrecorded)?;
    let Ok(()) = pen_samples(&mut reader, |sample| {
        let from = *first_ns.get_or_insert(sample.stamp_ns);
        let t_s = sample.stamp_ns.saturating_sub(from) as f64 * 1e-9;
        let rises = samples.last().is_none_or(|last| t_s > last.t_s);
        if rises && sample.x_m.is_finite() && sample.y_m.is_finite() {
            samples.push(PathSample { t_s, x_m: sample.x_m, y_m: sample.y_m, contact: sample.contact });
        }
        Ok::<(), Infallible>(())
    })
    .map_err(unrecorded)?;
    if samples.len() < 2 {
        let what = format!("{}: it holds {} pen samples, a path needs 2", file.display(), samples.len());
        return Err(Failure::bad_input(what, "give a recording made while the pen wrote"));
    }
    Ok(PenPath::from_samples(samples))
}

/// The writing workspace in metres of the pen's own plane.
pub(crate) struct Workspace {
    centre_m: [f64; 2],
    size_m: [f64; 2],
}

impl Workspace {
    pub(crate) fn of(settings: &Settings) -> Self {
        let plane = &settings.plane;
        let [x, y, _] = plane.workspace_m;
        let [x0, y0] = plane.pen_origin_m;
        let pen = |m: f64| m / plane.scale;
        Self {
            centre_m: [x0 + pen(0.5 * (x[0] + x[1])), y0 + pen(0.5 * (y[0] + y[1]))],
            size_m: [pen(x[1] - x[0]), pen(y[1] - y[0])],
        }
    }

    pub(crate) fn placement(&self, height_m: f64, layout: Layout, anchor: Anchor) -> Placement {
        let Self { centre_m, size_m } = *self;
        Placement { centre_m, size_m, glyph_height_m: height_m, layout, anchor, lift: Lift::Travel }
    }
}

/// Rate of the built-in writer's tablet [Hz].
const GLYPH_RATE_HZ: f64 = 200.0;

fn glyphs(text: &str, args: &PathArgs, workspace: &Workspace) -> Result<Source, Failure> {
    let placement = workspace.placement(args.height, Layout::Line, Anchor::Baseline);
    let mut path = text_path(text, args.style, GLYPH_RATE_HZ, &placement).map_err(wrong)?;
    // A line begins at the left border: move the finished text to the middle.
    if let Some([[left, _], [right, _]]) = path.bounds_m() {
        let shift = workspace.centre_m[0] - 0.5 * (left + right);
        path.samples.iter_mut().for_each(|sample| sample.x_m += shift);
    }
    Ok(Source { path, notes: Vec::new() })
}

fn recordings(names: &[String], args: &PathArgs, workspace: &Workspace) -> Result<Source, Failure> {
    let mut notes = Vec::new();
    let mut recordings: Vec<Recording> = Vec::new();
    for name in names {
        let path = Path::new(name);
        if path.is_dir() {
            let words = DataSet::splits(path).map_err(wrong)?;
            let split = if words.iter().any(|word| word == "test") { Split::test() } else { Split::All };
            let set = DataSet::load(path, &split, false).map_err(wrong)?;
            notes.extend(set.errors.iter().map(ToString::to_string));
            recordings.extend(set.files.into_iter().map(|file| file.recording));
        } else {
            recordings.push(load_recording(path).map_err(wrong)?);
        }
    }
    let Some(rate_hz) = recordings.first().map(|recording| recording.rate_hz) else {
        return Err(Failure::bad_input("no pen path was named", REMEDY));
    };
    if let Some(other) = recordings.iter().find(|recording| recording.rate_hz != rate_hz) {
        let what = format!(
            "{} is sampled at {} Hz, the files before it at {rate_hz} Hz",
            other.source.display(),
            other.rate_hz
        );
        return Err(Failure::bad_input(what, "play files of one rate together"));
    }
    if let Some(guessed) = recordings.iter().find(|recording| recording.rate_assumed) {
        notes.push(format!("{} does not state its rate; {rate_hz} Hz assumed", guessed.source.display()));
    }
    let all: Vec<Character> = recordings.into_iter().flat_map(|recording| recording.segments).collect();
    let median_height = median_glyph_height(&all).unwrap_or_default();
    let chosen = chosen(all, args)?;
    let ink = Ink { characters: &chosen, rate_hz, median_height };
    let placement = workspace.placement(args.height, Layout::Centre, Anchor::Middle);
    let (path, skipped) = PenPath::from_ink(ink, &placement).map_err(wrong)?;
    notes.extend(skipped.into_iter().map(|what| format!("left out {what}")));
    Ok(Source { path, notes })
}

fn chosen(all: Vec<Character>, args: &PathArgs) -> Result<Vec<Character>, Failure> {
    let count = all.len();
    let (first, last) = args.segments.unwrap_or((0, usize::MAX));
    let chosen: Vec<Character> = all
        .into_iter()
        .enumerate()
        .filter(|(index, _)| (first..=last).contains(index))
        .map(|(_, character)| character)
        .filter(|character| args.label.as_ref().is_none_or(|label| character.label == *label))
        .collect();
    if chosen.is_empty() {
        let what = match &args.label {
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

fn has_extension(file: &str, extension: &str) -> bool {
    Path::new(file).extension().is_some_and(|found| found.eq_ignore_ascii_case(extension))
}

/// A positive number for the command line.
pub(crate) fn positive(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if value.is_finite() && value > 0.0 && value <= 1000.0 => Ok(value),
        _ => Err("a number above 0, at most 1000".to_owned()),
    }
}

fn segments(text: &str) -> Result<(usize, usize), String> {
    let (first, last) = text.split_once('-').unwrap_or((text, text));
    match (first.parse(), last.parse()) {
        (Ok(first), Ok(last)) if first <= last => Ok((first, last)),
        _ => Err("a number, or FIRST-LAST with FIRST <= LAST".to_owned()),
    }
}
