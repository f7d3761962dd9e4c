//! `foretrace status`: what the daemon says about itself.

mod view;
mod chain;

use std::io::IsTerminal;
use std::time::Duration;

use foretrace_client::{Foretrace, StatusReader, monotonic_now_ns};

use crate::attach::{Lookout, News, unattached};
use crate::failure::{Cause, Failure};
use crate::interrupt::Interrupt;
use crate::output::{JsonArgs, say};
use crate::settings::InstanceArgs;

/// The daemon speaks ten times per second.
const PATIENCE: Duration = Duration::from_secs(2);

/// Show the daemon's mode, rates, latencies, losses, trust and learner
///
/// Spreads are over all ticks since the daemon started: wakeup is from the planned start of a tick to its real one, step
/// from there to the command published, the others are its stages.
#[derive(Debug, clap::Args)]
pub(crate) struct StatusArgs {
    /// Show it anew twice per second until Ctrl-C
    #[arg(long, conflicts_with = "json")]
    watch: bool,

    #[command(flatten)]
    instance: InstanceArgs,

    #[command(flatten)]
    json: JsonArgs,
}

pub(crate) fn run(args: &StatusArgs) -> Result<(), Failure> {
    args.json.claim()?;
    let foretrace = args.instance.attach()?;
    let mut reader = foretrace.status().map_err(unattached)?;
    if args.watch {
        return watch(foretrace, reader);
    }
    let status = reader.next_within(PATIENCE).ok_or_else(|| silent(&foretrace))?;
    say!("{}", view::text(&status, status.header.age_ns(monotonic_now_ns())).trim_end());
    args.json.write(&view::json(&status))
}

fn watch(mut foretrace: Foretrace, mut reader: StatusReader) -> Result<(), Failure> {
    let interrupt = Interrupt::listen()?;
    let clear = if std::io::stdout().is_terminal() { "\x1b[H\x1b[2J" } else { "" };
    let mut lookout = Lookout::new();
    while !interrupt.is_set() {
        match reader.next_within(PATIENCE) {
            Some(status) => {
                say!("{clear}{}", view::text(&status, status.header.age_ns(monotonic_now_ns())));
            }
            None => say!("{clear}no status for {} s: no daemon running, or it is stuck", PATIENCE.as_secs()),
        }
        if lookout.look(&mut foretrace) == News::Renewed {
            reader = foretrace.status().map_err(unattached)?;
        }
        std::thread::sleep(Duration::from_millis(500));
    }
    Ok(())
}

fn silent(foretrace: &Foretrace) -> Failure {
    let number = foretrace.instance().number();
    let what = format!("the daemon of instance {number} says nothing");
    Failure::new(Cause::NoDaemon, what, "it is starting, ending or stuck: look at its own messages")
}
