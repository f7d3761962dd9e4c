//! `foretrace record FILE.mcap`: everything that a running instance sees and does.
//!
//! Contract: outlives the daemon. Ctrl-C is the ordinary end; what a killed recorder left is mended by the
//! next one of the same name, under a name of its own.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use foretrace_live::record_button::facts;
use foretrace_live::recorder::{Recorder, RecorderOptions, RecordingCounts};
use foretrace_live::source::{LiveSource, Wants};
use foretrace_record::repair::mend_leftovers;
use serde::Serialize;

use super::{RecordArgs, unrecorded};
use crate::failure::Failure;
use crate::interrupt::Interrupt;
use crate::output::{note, say};

/// Between two looks: chunks of a state wait for a quarter of a second at most.
const NAP: Duration = Duration::from_millis(4);

/// The result; keys are stable.
#[derive(Debug, Serialize)]
struct RecordReport {
    files: Vec<PathBuf>,
    #[serde(flatten)]
    counts: RecordingCounts,
}

pub(super) fn run(args: &RecordArgs, file: &Path) -> Result<(), Failure> {
    let interrupt = Interrupt::listen()?;
    for (path, mended) in mend_leftovers(file).map_err(unrecorded)? {
        note!("record: an interrupted recording is mended: {}, {} messages", path.display(), mended.messages);
    }
    let instance = args.instance.instance()?;
    let options = RecorderOptions {
        target: file.to_path_buf(),
        max_bytes: args.max_size,
        max_files: args.max_files.map(usize::from),
        facts: facts(&instance),
    };
    let source = LiveSource::open(&instance, Wants::ALL).map_err(unrecorded)?;
    let through = if source.is_relayed() { " through the relay" } else { "" };
    let mut recorder = Recorder::start(source, options).map_err(unrecorded)?;
    note!("record: recording everything{through} into {} until Ctrl-C", file.display());
    let deadline = args.seconds.map(|s| Instant::now() + Duration::from_secs_f64(s));
    while !interrupt.is_set() && !recorder.has_failed() {
        if deadline.is_some_and(|deadline| Instant::now() >= deadline) {
            break;
        }
        if let Some(changed) = recorder.hear() {
            note!("record: {}", changed.words());
        }
        std::thread::sleep(NAP);
    }
    let (files, counts) = recorder.finish().map_err(unrecorded)?;
    say!(
        "{}: {} ticks, {} inputs, {} states to replay from, {} messages lost",
        files.iter().map(|file| file.display().to_string()).collect::<Vec<_>>().join(", "),
        counts.ticks,
        counts.inputs,
        counts.states,
        counts.lost(),
    );
    args.json.write(&RecordReport { files, counts })
}
