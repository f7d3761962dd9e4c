//! `foretrace explain`: what a tick of a recording saw, decided and cost, and which moments matter.

use std::io::Write as _;
use std::path::{Path, PathBuf};

use foretrace_record::explain::{self, Explanation};
use foretrace_record::{RecordError, page};
use serde::Serialize;

use crate::failure::Failure;
use crate::output::{JsonArgs, say};
use crate::record::{undamaged, unrecorded};

/// Say in plain words what happened in a recording
///
/// Without --tick, the ten moments that matter most: stops, late ticks, falls of trust, the largest error,
/// what was lost or refused. With it, what that tick saw, decided and cost, and why trust was what it was.
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Examples:\n  foretrace explain run.mcap\n  foretrace explain run.mcap --tick 1234\n  \
                  foretrace explain run.mcap --html run.html"
)]
pub(crate) struct ExplainArgs {
    /// A recording of `foretrace record`
    #[arg(value_name = "FILE.mcap")]
    file: PathBuf,

    /// Number of a tick
    #[arg(long, value_name = "N")]
    tick: Option<u64>,

    /// Also write a page that shows the run: a replay, lag, error, moments; must not exist yet
    #[arg(long, value_name = "FILE.html", conflicts_with = "tick")]
    html: Option<PathBuf>,

    #[command(flatten)]
    json: JsonArgs,
}

/// The result; keys are stable.
#[derive(Debug, Serialize)]
struct ExplainReport {
    moments: Vec<explain::Moment>,
    sentences: Vec<String>,
    /// One tick of so many has a record; 1 with `--tick`.
    every_ticks: u64,
    /// Where and why the file ends early.
    damage: Option<String>,
}

pub(crate) fn run(args: &ExplainArgs) -> Result<(), Failure> {
    args.json.claim()?;
    let mut report =
        ExplainReport { moments: Vec::new(), sentences: Vec::new(), every_ticks: 1, damage: None };
    match args.tick {
        Some(tick) => {
            report.sentences = explain::tick(&args.file, tick).map_err(unrecorded)?;
            for sentence in &report.sentences {
                say!("{sentence}");
            }
        }
        None => {
            let summary = match &args.html {
                Some(target) => paged(&args.file, target)?,
                None => explain::moments(&args.file).map_err(unrecorded)?,
            };
            (report.moments, report.every_ticks, report.damage) =
                (summary.moments, summary.every_ticks, summary.damage);
            if report.every_ticks > 1 {
                say!(
                    "one tick of {} has a record (telemetry.every_ticks): what happened between two is told of the \
                     next one, and the largest error or the latest tick may be missing",
                    report.every_ticks
                );
            }
            for moment in &report.moments {
                say!("tick {:>8}  {:>9.3} s  {}", moment.tick, moment.after_s, moment.what);
            }
        }
    }
    if let Some(target) = &args.html {
        say!("page: {}", target.display());
    }
    args.json.write(&report)?;
    undamaged(&args.file, report.damage.as_deref())
}

/// Writes the page of `file` into the new file `target`; returns its summary.
fn paged(file: &Path, target: &Path) -> Result<Explanation, Failure> {
    // Before the file is read, which may take a while.
    if target.exists() {
        return Err(unrecorded(RecordError::Exists { path: target.to_path_buf() }));
    }
    let (text, summary) = page::of_recording(file).map_err(unrecorded)?;
    let written = foretrace_record::whole(target, |out| {
        let unwritten = |error| format!("the page cannot be written: {error}");
        out.write_all(text.as_bytes())
            .map_err(|error| RecordError::Format { path: target.to_path_buf(), why: unwritten(error) })
    });
    written.map_err(unrecorded)?;
    Ok(summary)
}
