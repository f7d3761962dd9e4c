//! `foretrace flight`: keeps the last seconds in memory, and writes them when something goes wrong.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use foretrace_live::flight::{Flight, FlightFile, FlightOptions};
use foretrace_live::last_flight;
use foretrace_live::record_button::facts;
use foretrace_live::recorder::unix_minus_monotonic;
use foretrace_live::source::{LiveSource, Wants};
use foretrace_shm::monotonic_now_ns;
use serde::Serialize;

use crate::failure::Failure;
use crate::interrupt::Interrupt;
use crate::output::{JsonArgs, note, say};
use crate::record::unrecorded;
use crate::settings::InstanceArgs;

/// Between two looks: chunks of a state wait for a quarter of a second at most.
const NAP: Duration = Duration::from_millis(4);

/// Keep the last seconds in memory, and write them when a tick is late, a stop latches or plans fail
///
/// Each time a recording (for foretrace replay and explain) and a Perfetto trace, from --keep seconds before
/// to a second after. SIGUSR1 writes one too. Every half of --keep the loop copies its state, so that what
/// is written can be replayed.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:\n  foretrace flight black-box\n  foretrace flight black-box --keep 30 \
                        --max-files 5")]
pub(crate) struct FlightArgs {
    /// Folder of the files; made if it is not there
    #[arg(value_name = "DIR")]
    folder: PathBuf,

    /// Seconds before the trigger that are written, 1 to 120
    #[arg(long, value_name = "S", default_value_t = 10,
          value_parser = clap::value_parser!(u64).range(1..=120))]
    keep: u64,

    /// Seconds between two files at least; stops and requests do not wait
    #[arg(long, value_name = "S", default_value_t = 60)]
    apart: u64,

    /// Keep only the newest files
    #[arg(long, value_name = "N", default_value_t = 10, value_parser = clap::value_parser!(u16).range(1..))]
    max_files: u16,

    /// End after this many seconds
    #[arg(long, value_name = "S", value_parser = crate::values::lasting)]
    seconds: Option<f64>,

    #[command(flatten)]
    instance: InstanceArgs,

    #[command(flatten)]
    json: JsonArgs,
}

/// The result; keys are stable.
#[derive(Debug, Serialize)]
struct FlightReport {
    files: Vec<FlightFile>,
    suppressed: u64,
}

pub(crate) fn run(args: &FlightArgs) -> Result<(), Failure> {
    args.json.claim()?;
    let interrupt = Interrupt::listen()?;
    let asked = Arc::new(AtomicBool::new(false));
    signal_hook::flag::register(signal_hook::consts::SIGUSR1, asked.clone())
        .map_err(|error| Failure::failed(format_args!("cannot listen to SIGUSR1: {error}"), ""))?;
    let instance = args.instance.instance()?;
    let options = FlightOptions {
        folder: args.folder.clone(),
        keep: Duration::from_secs(args.keep),
        apart: Duration::from_secs(args.apart),
        max_files: usize::from(args.max_files),
        facts: facts(&instance),
    };
    let source = LiveSource::open(&instance, Wants::ALL).map_err(unrecorded)?;
    let mut flight = Flight::start(source, options).map_err(unrecorded)?;
    note!("flight: the last {} s are kept; files go to {}", args.keep, args.folder.display());
    let deadline = args.seconds.map(|s| Instant::now() + Duration::from_secs_f64(s));
    let mut files = Vec::new();
    while !interrupt.is_set() && deadline.is_none_or(|deadline| Instant::now() < deadline) {
        if asked.swap(false, Ordering::AcqRel) {
            flight.ask();
        }
        match flight.hear(|changed| note!("flight: {}", changed.words())) {
            Ok(None) => {}
            Ok(Some(written)) => {
                note!("flight: {}: {}", written.trigger.word(), written.recording.display());
                let unix_ns = monotonic_now_ns().wrapping_add(unix_minus_monotonic());
                if let Err(error) = last_flight::note(instance.root(), &written, unix_ns) {
                    note!("flight: `foretrace status` cannot show it: {}", unrecorded(error));
                }
                files.push(written);
            }
            // The memory is still there: the next trigger may find room.
            Err(error) => note!("flight: {}", unrecorded(error)),
        }
        std::thread::sleep(NAP);
    }
    say!("{} files, {} triggers came too soon after one", files.len(), flight.suppressed());
    args.json.write(&FlightReport { files, suppressed: flight.suppressed() })
}
