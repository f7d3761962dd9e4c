//! `foretrace record FILE.mcap`: everything that a running instance sees and does.
//!
//! Contract: outlives the daemon. Ctrl-C is the ordinary end; what a killed recorder left is mended by the
//! next one of the same name, under a name of its own.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use foretrace_client::Instance;
use foretrace_live::recorder::{Counts, Options, Recorder, unix_minus_monotonic};
use foretrace_live::source::{Source, Wants};
use foretrace_record::repair::mend_leftovers;
use foretrace_record::write::Facts;
use foretrace_shm::{Status, TickInput, TickRecord, Wire, monotonic_now_ns};
use serde::Serialize;

use super::{RecordArgs, unrecorded};
use crate::attach::news;
use crate::failure::Failure;
use crate::interrupt::Interrupt;
use crate::output::{note, say};

/// Between two looks: pieces of a state wait for a quarter of a second at most.
const NAP: Duration = Duration::from_millis(4);

/// The result; keys are stable.
#[derive(Debug, Serialize)]
struct RecordReport {
    files: Vec<PathBuf>,
    #[serde(flatten)]
    counts: Counts,
}

pub(super) fn run(args: &RecordArgs, file: &Path) -> Result<(), Failure> {
    let interrupt = Interrupt::listen()?;
    for (place, mended) in mend_leftovers(file).map_err(unrecorded)? {
        note!(
            "record: an interrupted recording is mended: {}, {} messages",
            place.display(),
            mended.messages
        );
    }
    let instance = args.instance.instance()?;
    let options = Options {
        target: file.to_path_buf(),
        max_bytes: args.max_size,
        max_files: args.max_files.map(usize::from),
        facts: facts(&instance),
    };
    let source = Source::open(&instance, Wants::ALL).map_err(unrecorded)?;
    let through = if source.is_relayed() { " through the relay" } else { "" };
    let mut recorder = Recorder::start(source, options).map_err(unrecorded)?;
    note!("record: recording everything{through} into {} until Ctrl-C", file.display());
    let deadline = args.seconds.map(|s| Instant::now() + Duration::from_secs_f64(s));
    while !interrupt.is_set() && !recorder.has_failed() {
        if deadline.is_some_and(|deadline| Instant::now() >= deadline) {
            break;
        }
        if let Some(changed) = recorder.hear() {
            note!("record: {}", news(changed));
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

/// What the file says about itself and the daemon that is up. Takes its time, so call it before a source is
/// open.
pub(crate) fn facts(instance: &Instance) -> Facts {
    let pid = instance.daemon().map_or(0, |daemon| daemon.pid);
    let read = |path: &str| std::fs::read_to_string(path).unwrap_or_default().trim().to_owned();
    let layout = |hash: u64| format!("{hash:016x}");
    [
        ("version", env!("CARGO_PKG_VERSION").to_owned()),
        ("layout.tick_input", layout(TickInput::LAYOUT_HASH)),
        ("layout.tick_record", layout(TickRecord::LAYOUT_HASH)),
        ("layout.status", layout(Status::LAYOUT_HASH)),
        ("instance", instance.number().to_string()),
        ("daemon_pid", pid.to_string()),
        ("host", read("/proc/sys/kernel/hostname")),
        ("kernel", read("/proc/sys/kernel/osrelease")),
        ("begun_unix_ns", monotonic_now_ns().wrapping_add(unix_minus_monotonic()).to_string()),
        ("unix_minus_monotonic_ns", unix_minus_monotonic().to_string()),
    ]
    .map(|(key, value)| (key.to_owned(), value))
    .into()
}
