//! `foretrace replay`: a recording through the law once more, bit for bit.

use std::path::PathBuf;

use foretrace_record::picture::draw;
use foretrace_record::replay::{ReplayError, ReplayOutcome, replay};
use foretrace_record::verdict::Unequal;
use foretrace_record::what_if::{Variant, WhatIfError, what_if};

use crate::failure::Failure;
use crate::output::{JsonArgs, note, say};
use crate::record::{undamaged, unrecorded};

/// Run the recorded ticks again, and compare every command bit for bit
///
/// The same program gives the same commands. A replay begins at the daemon's first tick or at the first state
/// in the recording, and ends at the first gap. Differences end with exit code 1.
///
/// With --what-if the same hand is put in front of another law: predictor, trust or any setting may differ.
/// The arm is fitted to the recording, and the table says how far that model is from it.
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Examples:\n  foretrace replay run.mcap\n  foretrace replay run.mcap --what-if predictor=dybm \
                  --what-if trust=0\n  foretrace replay run.mcap --what-if predictor=hold,trust=1"
)]
pub(crate) struct ReplayArgs {
    /// A recording of `foretrace record`
    #[arg(value_name = "FILE.mcap")]
    file: PathBuf,

    /// Change these settings, and compare; may be repeated
    #[arg(long, value_name = "KEY=VALUE,...")]
    what_if: Vec<String>,

    /// Draw error over time and the worst stroke of the recording, of all variants, into this file; must not
    /// exist yet
    #[arg(long, value_name = "FILE.svg", requires = "what_if")]
    picture: Option<PathBuf>,

    #[command(flatten)]
    json: JsonArgs,
}

pub(crate) fn run(args: &ReplayArgs) -> Result<(), Failure> {
    args.json.claim()?;
    if !args.what_if.is_empty() {
        return compare(args);
    }
    let outcome = replay(&args.file).map_err(unreplayed)?;
    say!("{}: {}", args.file.display(), outcome.summary());
    say_gone(&outcome.gone);
    let verdict = verdict(&outcome).and(undamaged(&args.file, outcome.damage.as_deref()));
    args.json.write(&outcome)?;
    verdict
}

/// Runs the variants and shows them beside the recording.
fn compare(args: &ReplayArgs) -> Result<(), Failure> {
    let variants: Result<Vec<_>, _> = args.what_if.iter().map(|text| Variant::parse(text)).collect();
    let variants = variants.map_err(unanswered)?;
    if let Some(picture) = args.picture.as_ref().filter(|picture| picture.exists()) {
        let what = format!("{} exists already", picture.display());
        return Err(Failure::bad_input(what, "give a new name, or remove it"));
    }
    let threads = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
    let answer = what_if(&args.file, &variants, threads).map_err(unanswered)?;
    say!(
        "{}: {:.1} s, {} ticks of the longest armed stretch",
        args.file.display(),
        answer.seconds,
        answer.ticks
    );
    say_gone(&answer.gone);
    if answer.previews_missing > 0 {
        say!(
            "{} previews of another process are missing in the file: the fallback served there",
            answer.previews_missing
        );
    }
    say!(
        "the arm: {:.1} ms of delay, {:.1} ms of servo, {:.1} ms of joint loop; under the recorded commands it is \
         {:.3} mm rms from the recorded one",
        1e3 * answer.arm.delay_s,
        1e3 * answer.arm.filter_s,
        1e3 * answer.arm.joint_loop_s,
        answer.arm_misfit_mm
    );
    let width = answer.rows.iter().map(|row| row.name.chars().count()).max().unwrap_or(0);
    say!("{:width$}   rms mm   max mm   lag ms  jerk m/s³  limited  worst stroke mm (at s)", "");
    for row in &answer.rows {
        let limited = row.saturated.map_or_else(|| "-".to_owned(), |share| format!("{:.1} %", 1e2 * share));
        let stopped = row.stopped.as_ref().map_or_else(String::new, |why| format!("  STOPPED {why}"));
        say!(
            "{:width$} {:8.3} {:8.3} {:8.1} {:10.1} {limited:>8} {:9.3} ({:.1}){stopped}",
            row.name,
            row.rms_mm,
            row.max_mm,
            row.lag_ms,
            row.jerk_mps3,
            row.worst_stroke_mm,
            row.worst_stroke_at_s,
        );
    }
    if let Some(picture) = &args.picture {
        let name = args.file.file_name().unwrap_or_default().to_string_lossy();
        draw(picture, &name, &answer).map_err(|error| Failure::failed(error, ""))?;
        say!("{}", picture.display());
    }
    args.json.write(&answer)?;
    undamaged(&args.file, answer.damage.as_deref())
}

/// Names the recorded settings that this version has not.
fn say_gone(keys: &[String]) {
    keys.iter().for_each(|key| note!("replay: of the recorded settings {key}"));
}

fn unanswered(error: WhatIfError) -> Failure {
    match error {
        WhatIfError::File(error) => unrecorded(error),
        error @ WhatIfError::Change { .. } => Failure::usage(error, ""),
        other => Failure::bad_input(other, ""),
    }
}

/// An error if anything differs, or nothing was compared.
fn verdict(outcome: &ReplayOutcome) -> Result<(), Failure> {
    match outcome.verdict() {
        Ok("") => {}
        Ok(same) => say!("{same}"),
        Err(Unequal { what, remedy }) => return Err(Failure::failed(what, remedy)),
    }
    Ok(())
}

fn unreplayed(error: ReplayError) -> Failure {
    match error {
        ReplayError::File(error) => unrecorded(error),
        other => Failure::bad_input(other, ""),
    }
}
