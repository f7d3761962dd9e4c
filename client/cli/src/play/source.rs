//! `--height` and the like, and the path of a recording: where a pen path comes from.

use std::convert::Infallible;
use std::path::Path;

use foretrace_config::Settings;
use foretrace_record::pen::pen_samples;
use foretrace_record::read::RecordingReader;
use foretrace_sim::path::{PathSample, PenPath};
use foretrace_sim::source::{self, PathOptions, PenSource, has_extension};

use crate::failure::Failure;
use crate::record::unrecorded;
use crate::units::UnitArgs;
use crate::values::positive;

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

    #[command(flatten)]
    pub(crate) unit: UnitArgs,
}

impl Default for PathArgs {
    fn default() -> Self {
        let PathOptions { height_m: height, scale, speed, style, label, segments, .. } =
            PathOptions::default();
        Self { height, scale, speed, style, label, segments, unit: UnitArgs::default() }
    }
}

impl PathArgs {
    /// Loads the sources `names` of the command line into the workspace of `settings`.
    pub(crate) fn load(&self, names: &[String], settings: &Settings) -> Result<PenSource, Failure> {
        let Self { height, scale, speed, style, label, segments, unit } = self.clone();
        let units = unit.units();
        let options = PathOptions { height_m: height, scale, speed, style, label, segments, units };
        match names {
            [file] if has_extension(file, "mcap") => {
                let (pen, notes) = recorded_pen(Path::new(file))?;
                Ok(PenSource { notes, ..PenSource::of(pen, &options, settings) })
            }
            _ => source::load(names, &options, settings),
        }
    }
}

/// The pen of a recording of everything, as the ticks were given it, and what of the file was left out.
fn recorded_pen(file: &Path) -> Result<(PenPath, Vec<String>), Failure> {
    let mut samples: Vec<PathSample> = Vec::new();
    let mut first_ns = None;
    let mut reader = RecordingReader::open(file).map_err(unrecorded)?;
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
        let why = format!("it holds {} pen samples, a path needs 2", samples.len());
        let what = || {
            let remedy = "give a recording made while the pen wrote";
            Failure::bad_input(format!("{}: {why}", file.display()), remedy)
        };
        return Err(reader.lack(&why).map_or_else(what, unrecorded));
    }
    let left_out = |damage| format!("{} ends early, {damage}; what comes before is played", file.display());
    Ok((PenPath::from_samples(samples), reader.damage().map(left_out).into_iter().collect()))
}

fn segments(text: &str) -> Result<(usize, usize), String> {
    let (first, last) = text.split_once('-').unwrap_or((text, text));
    match (first.parse(), last.parse()) {
        (Ok(first), Ok(last)) if first <= last => Ok((first, last)),
        _ => Err("a number, or FIRST-LAST with FIRST <= LAST".to_owned()),
    }
}
