//! `foretrace record`: records a running instance, or its pen only; says what is in a recording, and mends
//! one.

pub(crate) mod everything;
mod pen;

use std::path::{Path, PathBuf};

use foretrace_live::LiveError;
use foretrace_record::RecordError;
use foretrace_record::info::{Info, info};
use foretrace_record::read::RecordingReader;
use foretrace_record::repair::{Mended, repair};
use foretrace_record::write::part_of;
use serde::Serialize;

use crate::attach::unattached;
use crate::failure::Failure;
use crate::output::{JsonArgs, say};
use crate::settings::InstanceArgs;

/// Record everything that a running daemon sees and does, or its pen only, until Ctrl-C
///
/// The recording is an MCAP file: what every tick was given, settings, weights and states, so that `foretrace
/// replay` runs it again bit for bit, and the same in numbers and words that Foxglove, Rerun, PlotJuggler and
/// Python read. With --pen it is CSV with the columns t_s,x_m,y_m,contact (metres in the pen's own plane)
/// below a line with version, unit, rate and writer; it can be played, and a folder of such recordings is a
/// data set.
#[derive(Debug, clap::Args)]
#[command(
    group = clap::ArgGroup::new("what").required(true).args(["file", "pen", "info", "repair"]),
    after_help = "Examples:\n  foretrace record run.mcap\n  foretrace record run.mcap --max-size 500M \
                  --max-files 4\n  foretrace record --info run.mcap\n  foretrace record --repair \
                  run.mcap.part\n  foretrace record --pen anna-1.csv --writer anna"
)]
pub(crate) struct RecordArgs {
    /// File of the recording; must not exist yet
    #[arg(value_name = "FILE.mcap")]
    file: Option<PathBuf>,

    /// Record the pen only, into this file, which must not exist yet
    #[arg(long, value_name = "FILE.csv")]
    pen: Option<PathBuf>,

    /// Say what is in a recording, instead of recording
    #[arg(long, value_name = "FILE.mcap")]
    info: Option<PathBuf>,

    /// Mend a recording whose recorder was killed, beside it under a new name
    #[arg(long, value_name = "FILE")]
    repair: Option<PathBuf>,

    /// Name of the writer: one word
    #[arg(long, value_name = "NAME", default_value = "", requires = "pen")]
    writer: String,

    /// Begin another file after this many bytes, for example 500M
    #[arg(long, value_name = "BYTES", value_parser = bytes, requires = "file")]
    max_size: Option<u64>,

    /// Keep only the newest files
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..), requires = "max_size")]
    max_files: Option<u16>,

    /// End after this many seconds
    #[arg(long, value_name = "S", value_parser = crate::values::lasting)]
    seconds: Option<f64>,

    #[command(flatten)]
    instance: InstanceArgs,

    #[command(flatten)]
    json: JsonArgs,
}

pub(crate) fn run(args: &RecordArgs) -> Result<(), Failure> {
    args.json.claim()?;
    match args {
        RecordArgs { pen: Some(pen), .. } => pen::run(args, pen),
        RecordArgs { info: Some(file), .. } => tell(args, file),
        RecordArgs { repair: Some(file), .. } => mend(args, file),
        RecordArgs { file: Some(file), .. } => everything::run(args, file),
        _ => Err(Failure::usage("nothing to record into", "give FILE.mcap")),
    }
}

/// A failure of a recording with its exit code.
pub(crate) fn unrecorded(error: impl Into<LiveError>) -> Failure {
    let error = match error.into() {
        LiveError::Record(error) => error,
        LiveError::Service(error) => return unattached(error),
        other => return Failure::failed(other, ""),
    };
    match error {
        RecordError::Write { .. } => Failure::failed(error, ""),
        RecordError::Read { ref path, .. } => {
            let remedy = unfinished(path);
            Failure::bad_input(error, remedy)
        }
        other => Failure::bad_input(other, ""),
    }
}

/// What to do where `file` is missing and its part is there: its recorder is at work, or did not come to its
/// end.
fn unfinished(file: &Path) -> String {
    let part = part_of(file);
    if file.exists() || !part.exists() {
        return String::new();
    }
    let part = part.display();
    format!("{part} is there: end its recorder, or mend it with `foretrace record --repair {part}`")
}

/// An error if there is `damage`: what was made is of the part before it.
pub(crate) fn undamaged(file: &Path, damage: Option<&str>) -> Result<(), Failure> {
    let Some(damage) = damage else { return Ok(()) };
    let what = format!("{} ends early, {damage}; the result is of what comes before", file.display());
    let remedy = format!("`foretrace record --repair {}` makes a whole file of that", file.display());
    Err(Failure::bad_input(what, remedy))
}

fn tell(args: &RecordArgs, file: &Path) -> Result<(), Failure> {
    let summary: Info = info(file).map_err(unrecorded)?;
    say!("{}: {:.1} s", file.display(), summary.seconds);
    for (key, value) in summary.begin.iter().chain(&summary.end) {
        say!("  {key}: {value}");
    }
    for (topic, count) in &summary.topics {
        say!("  {count:>9} {topic}");
    }
    if let Some((first, last)) = summary.ticks {
        say!("  ticks {first} to {last}, {} missing", summary.missing_ticks);
    }
    for (daemon, build) in &summary.laws {
        say!("  build of the law: {build}, of daemon {daemon:016x}");
    }
    match summary.states.as_slice() {
        [] => say!("  no state to replay from"),
        [first, ..] => say!("  {} states to replay from, the first after tick {first}", summary.states.len()),
    }
    for topic in &summary.foreign {
        say!("  {topic} has another layout than this program's");
    }
    if let Some(damage) = &summary.damage {
        say!("  it ends early, {damage}: `foretrace record --repair {}`", file.display());
    }
    if let Some(passed_over) = &summary.passed_over {
        say!("  not read: {passed_over}");
    }
    args.json.write(&summary)?;
    if summary.damage.is_some() && summary.topics.is_empty() {
        let what = format!("{} holds no message that can be read", file.display());
        return Err(Failure::bad_input(what, "copy it again, or record anew"));
    }
    Ok(())
}

/// What was mended; keys are stable.
#[derive(Debug, Serialize)]
struct MendReport {
    file: PathBuf,
    messages: u64,
    damage: Option<String>,
    /// What else is not in the mended file.
    passed_over: Option<String>,
}

fn mend(args: &RecordArgs, file: &Path) -> Result<(), Failure> {
    // Said before a file is begun beside it.
    RecordingReader::open(file).map_err(unrecorded)?;
    let name = file.file_name().unwrap_or_default().to_string_lossy();
    let stem = name.trim_end_matches(".part").trim_end_matches(".mcap");
    let target = file.with_file_name(format!("{stem}.mended.mcap"));
    let mended = repair(file, &target).map_err(unrecorded)?;
    match &mended.damage {
        Some(damage) => say!("{}: {} messages; damaged {damage}", target.display(), mended.messages),
        None => say!("{}: {} messages; there was no damage", target.display(), mended.messages),
    }
    if let Some(passed_over) = &mended.passed_over {
        say!("not in it: {passed_over}");
    }
    let Mended { messages, damage, passed_over } = mended;
    args.json.write(&MendReport { file: target, messages, damage, passed_over })
}

/// Bytes with k, M or G for powers of a thousand.
pub(crate) fn bytes(text: &str) -> Result<u64, String> {
    let (number, unit) = match text.char_indices().last() {
        Some((at, 'k')) => (&text[..at], 1_000),
        Some((at, 'M')) => (&text[..at], 1_000_000),
        Some((at, 'G')) => (&text[..at], 1_000_000_000),
        _ => (text, 1),
    };
    let legal = "a number of bytes from 1M on, for example 500M or 2G";
    let number: u64 = number.parse().map_err(|_| legal.to_owned())?;
    number.checked_mul(unit).filter(|bytes| *bytes >= 1_000_000).ok_or_else(|| legal.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_recording_that_is_missing_beside_its_part_is_told_with_what_to_do() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("run.mcap");
        let missing = || std::io::Error::from(std::io::ErrorKind::NotFound);
        let summary = || unrecorded(RecordError::Read { path: file.clone(), source: missing() }).to_string();
        assert!(!summary().contains("--repair"), "{}", summary());
        std::fs::write(folder.path().join("run.mcap.part"), "").unwrap();
        assert!(
            summary().contains("run.mcap.part is there") && summary().contains("--repair"),
            "{}",
            summary()
        );
        std::fs::write(&file, "").unwrap();
        assert!(!summary().contains("--repair"), "{}", summary());
    }

    #[test]
    fn sizes_are_read_with_their_units_and_bounded() {
        assert_eq!(bytes("500M"), Ok(500_000_000));
        assert_eq!(bytes("2G"), Ok(2_000_000_000));
        for wrong in ["", "M", "1k", "-1M", "1e9", "99999999999G", "1µ"] {
            assert!(bytes(wrong).is_err(), "{wrong}");
        }
    }
}
