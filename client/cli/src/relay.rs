//! `foretrace relay`: one process that listens to a daemon for any number of others.

use std::time::{Duration, Instant};

use foretrace_live::relay::Relay;

use crate::failure::Failure;
use crate::interrupt::Interrupt;
use crate::output::{JsonArgs, note, say};
use crate::record::unrecorded;
use crate::settings::InstanceArgs;

/// Between two looks: what a message waits here at most.
const NAP: Duration = Duration::from_millis(2);

/// Pass everything on to any number of recorders, viewers and metrics, until Ctrl-C
///
/// Shared memory has room for two recorders and three viewers. A relay takes one place of each; foretrace
/// record, flight, foxglove and metrics that begin after it find it by themselves and listen to it instead.
/// If it ends, they go on with places of their own, as far as there are any. One that reads too slowly loses
/// the oldest messages, which are counted, and holds up nobody.
#[derive(Debug, clap::Args)]
#[command(after_help = "Example:\n  foretrace relay")]
pub(crate) struct RelayArgs {
    /// End after this many seconds
    #[arg(long, value_name = "S", value_parser = crate::values::lasting)]
    seconds: Option<f64>,

    #[command(flatten)]
    instance: InstanceArgs,

    #[command(flatten)]
    json: JsonArgs,
}

pub(crate) fn run(args: &RelayArgs) -> Result<(), Failure> {
    args.json.claim()?;
    let interrupt = Interrupt::listen()?;
    let mut relay = Relay::open(&args.instance.instance()?).map_err(unrecorded)?;
    note!("relay: passing everything on at {} until Ctrl-C", relay.path().display());
    let deadline = args.seconds.map(|s| Instant::now() + Duration::from_secs_f64(s));
    let mut listeners = 0;
    while !interrupt.is_set() && deadline.is_none_or(|deadline| Instant::now() < deadline) {
        if let Some(changed) = relay.turn() {
            note!("relay: {}", changed.words());
        }
        let now = relay.tally().listeners;
        if std::mem::replace(&mut listeners, now) != now {
            note!("relay: {now} listeners");
        }
        std::thread::sleep(NAP);
    }
    let tally = relay.tally();
    say!(
        "{} listeners, {} refused; {} messages passed on, {} found no room",
        tally.admitted,
        tally.refused,
        tally.passed,
        tally.dropped
    );
    args.json.write(&tally)
}
