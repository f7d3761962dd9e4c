//! `foretrace ur-echo`, hidden: one end of the echo pair that the demo runs beside its bridge.

use std::net::{SocketAddr, TcpListener};

use foretrace_arm::priority;
use foretrace_ur_sim::echo;

use crate::failure::Failure;
use crate::interrupt::Interrupt;
use crate::output::{JsonArgs, tell};

/// Play one end of a bare echo pair: what line and machine do to counters
#[derive(Debug, clap::Args)]
pub(crate) struct UrEchoArgs {
    #[arg(value_enum)]
    role: EchoRole,

    /// Where the controller listens
    #[arg(long, value_name = "ADDRESS:PORT")]
    at: SocketAddr,

    /// Cycles per second of the controller
    #[arg(long, value_name = "HZ", default_value_t = 125.0, value_parser = crate::values::lasting)]
    rate: f64,

    /// SCHED_FIFO priority; without it none is asked for
    #[arg(long, value_name = "N")]
    priority: Option<u32>,

    #[command(flatten)]
    json: JsonArgs,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum EchoRole {
    Controller,
    Bridge,
}

pub(crate) fn run(args: &UrEchoArgs) -> Result<(), Failure> {
    args.json.claim()?;
    let interrupt = Interrupt::listen()?;
    let broken = |error: std::io::Error| Failure::failed(format_args!("{}: {error}", args.at), "");
    let mut goes_on = || !interrupt.is_set();
    if let Some(priority) = args.priority {
        priority::ask("ur-echo", priority, false, &tell);
    }
    match args.role {
        EchoRole::Bridge => echo::bridge(args.at, &mut goes_on).map_err(broken),
        EchoRole::Controller => {
            let listener = TcpListener::bind(args.at).map_err(broken)?;
            let tally = echo::controller(&listener, args.rate, &mut goes_on).map_err(broken)?;
            args.json.write(&tally)
        }
    }
}
