//! `foretrace export`: numbers of a recording as CSV, or its pen as a recording that can be played.
//!
//! Contract: the file appears whole or not at all, and nothing is overwritten.

use std::io::BufWriter;
use std::path::{Path, PathBuf};

use foretrace_record::pen::pen_samples;
use foretrace_record::read::RecordingReader;
use foretrace_record::table;
use foretrace_sim::data::PenLog;
use serde::Serialize;

use crate::failure::Failure;
use crate::output::{JsonArgs, say};
use crate::record::{undamaged, unrecorded};

/// Write a recording's numbers as CSV, or its pen for `foretrace play`
///
/// The CSV has the time and one column per number of a raw topic, its unit in the header. Recordings of other
/// versions are read by the layout that they name themselves.
#[derive(Debug, clap::Args)]
#[command(
    group = clap::ArgGroup::new("what").required(true).args(["csv", "pen"]),
    after_help = "Examples:\n  foretrace export run.mcap --csv run.csv --every 10\n  foretrace export run.mcap \
                  --csv q.csv --topic /raw/input --fields tick,q\n  foretrace export run.mcap --pen p.csv"
)]
pub(crate) struct ExportArgs {
    /// A recording of `foretrace record`
    #[arg(value_name = "FILE.mcap")]
    file: PathBuf,

    /// Write numbers into this file, which must not exist yet
    #[arg(long, value_name = "FILE.csv")]
    csv: Option<PathBuf>,

    /// Write the pen samples into this file, which must not exist yet
    #[arg(long, value_name = "FILE.csv")]
    pen: Option<PathBuf>,

    /// Topic of the numbers: /raw/tick, /raw/input or /raw/status
    #[arg(long, value_name = "TOPIC", default_value = "/raw/tick", conflicts_with = "pen")]
    topic: String,

    /// Only these fields
    #[arg(long, value_name = "FIELD,...", value_delimiter = ',', conflicts_with = "pen")]
    fields: Vec<String>,

    /// Only every n-th message
    #[arg(long, value_name = "N", default_value_t = 1, conflicts_with = "pen",
          value_parser = clap::value_parser!(u64).range(1..))]
    every: u64,

    /// Name of the writer of the pen: one word
    #[arg(long, value_name = "NAME", default_value = "", requires = "pen")]
    writer: String,

    #[command(flatten)]
    json: JsonArgs,
}

/// The result; keys are stable.
#[derive(Debug, Serialize)]
struct ExportReport {
    file: PathBuf,
    rows: u64,
}

pub(crate) fn run(args: &ExportArgs) -> Result<(), Failure> {
    args.json.claim()?;
    let (target, (rows, damage)) = match (&args.csv, &args.pen) {
        (Some(target), _) => (target, numbers(args, target)?),
        (None, Some(target)) => (target, pen(args, target)?),
        (None, None) => return Err(Failure::usage("nothing to write", "give --csv or --pen")),
    };
    say!("{}: {rows} rows", target.display());
    args.json.write(&ExportReport { file: target.clone(), rows })?;
    undamaged(&args.file, damage.as_deref())
}

fn numbers(args: &ExportArgs, target: &Path) -> Result<(u64, Option<String>), Failure> {
    let mut reader = RecordingReader::open(&args.file).map_err(unrecorded)?;
    let written = foretrace_record::whole(target, |file| {
        table::csv(&mut reader, &args.topic, args.every, &args.fields, &mut BufWriter::new(file))
    });
    written.map(|rows| (rows, reader.damage())).map_err(unrecorded)
}

/// Writes the pen samples that the ticks were given.
fn pen(args: &ExportArgs, target: &Path) -> Result<(u64, Option<String>), Failure> {
    let mut reader = RecordingReader::open(&args.file).map_err(unrecorded)?;
    let mut log = PenLog::copy(target, &args.writer).map_err(|error| {
        Failure::bad_input(error, "give a new --pen FILE in a folder that can be written")
    })?;
    let part = log.part().to_path_buf();
    // Half a recording helps nobody here: the whole one is still in the other file.
    let given_up = |failure: Failure| {
        let _ = std::fs::remove_file(&part);
        failure
    };
    let kept =
        |error: std::io::Error| given_up(Failure::failed(format_args!("cannot write the pen: {error}"), ""));
    let pushed =
        pen_samples(&mut reader, |seen| log.push(seen.stamp_ns, seen.x_m, seen.y_m, seen.contact).map(drop));
    pushed.map_err(|error| given_up(unrecorded(error)))?.map_err(kept)?;
    let summary = log.finish().map_err(kept)?;
    if summary.rate_hz.is_none() {
        let why = format!("it holds {} pen samples, a path needs 2", summary.samples);
        let what =
            || Failure::bad_input(format!("{}: {why}", args.file.display()), "record while the pen writes");
        return Err(given_up(reader.lack(&why).map_or_else(what, unrecorded)));
    }
    Ok((summary.samples, reader.damage()))
}
