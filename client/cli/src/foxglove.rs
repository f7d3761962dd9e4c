//! `foretrace foxglove`: a running instance, live in Foxglove or Lichtblick.

use std::net::SocketAddr;
use std::time::{Duration, Instant};

use foretrace_live::foxglove::{FoxgloveError, FoxgloveOptions, Server};

use crate::failure::Failure;
use crate::interrupt::Interrupt;
use crate::output::{JsonArgs, note, say};
use crate::record::unrecorded;
use crate::settings::InstanceArgs;

/// Panels for a first look.
const LAYOUT: &str = include_str!("../../../docs/operate/foxglove/foretrace-layout.json");

/// Show a running daemon in Foxglove or Lichtblick, live, until Ctrl-C
///
/// A WebSocket server: in the viewer, open a connection to the address that it prints. It sends /tick, /tf,
/// /log and /scene as in a recording, the trust and the predictor as parameters, and takes two services:
/// anybody who can connect may stop the arm; to arm it, or to set a parameter, a viewer gives the token that
/// is printed. A viewer that reads too slowly loses the oldest messages and holds up nobody.
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Examples:\n  foretrace foxglove\n  foretrace foxglove --layout > foretrace-layout.json  \
                        # panels; import the file in the viewer"
)]
pub(crate) struct FoxgloveArgs {
    /// Address and port to listen on; another address than 127.0.0.1 is open to the network
    #[arg(long, value_name = "ADDRESS:PORT", default_value = "127.0.0.1:8765")]
    listen: SocketAddr,

    /// Let pages of this origin in, beside Foxglove's own and those of this machine; may be repeated
    #[arg(long, value_name = "URL")]
    allow_origin: Vec<String>,

    /// Print a layout for the viewer, instead of serving
    #[arg(long)]
    layout: bool,

    /// End after this many seconds
    #[arg(long, value_name = "S", value_parser = crate::values::lasting)]
    seconds: Option<f64>,

    #[command(flatten)]
    instance: InstanceArgs,

    #[command(flatten)]
    json: JsonArgs,
}

pub(crate) fn run(args: &FoxgloveArgs) -> Result<(), Failure> {
    if args.layout {
        say!("{}", LAYOUT.trim_end());
        return Ok(());
    }
    args.json.claim()?;
    let interrupt = Interrupt::listen()?;
    let options = FoxgloveOptions { listen: args.listen, origins: args.allow_origin.clone() };
    let server = Server::open(&args.instance.instance()?, options).map_err(|error| match error {
        FoxgloveError::Source(error) => unrecorded(error),
        other => Failure::failed(other, ""),
    })?;
    say!("open ws://{} in Foxglove or Lichtblick", server.at());
    say!("to arm and to set parameters as well, open ws://{}/?token={}", server.at(), server.token());
    if !server.at().ip().is_loopback() {
        note!("foxglove: whoever reaches {} can watch, and stop the arm; nothing is encrypted", server.at());
    }
    let deadline = args.seconds.map(|s| Instant::now() + Duration::from_secs_f64(s));
    let tally = server.run(
        |changed| note!("foxglove: {}", changed.words()),
        || interrupt.is_set() || deadline.is_some_and(|deadline| Instant::now() >= deadline),
    );
    say!(
        "{} viewers; {} messages sent, {} found no room; {} refusals, {} stops",
        tally.viewers,
        tally.sent,
        tally.dropped,
        tally.refused.values().sum::<u64>(),
        tally.stops
    );
    args.json.write(&tally)
}

#[cfg(test)]
mod tests {
    use super::*;
    use foretrace_record::topics::TICK;
    use serde_json::Value;

    #[test]
    fn the_layout_shows_only_fields_that_there_are_and_every_panel_has_its_place() {
        let layout: Value = serde_json::from_str(LAYOUT).unwrap();
        let panels = layout["configById"].as_object().unwrap();
        let mut shown = 0;
        for path in panels.values().filter_map(|panel| panel["paths"].as_array()).flatten() {
            let value = path["value"].as_str().unwrap();
            let field = value.strip_prefix("/tick.").unwrap().split('[').next().unwrap();
            assert!(TICK.fields.iter().any(|(name, _)| *name == field), "{value}");
            shown += 1;
        }
        assert!(shown > 8, "{shown}");
        let arrangement = layout["layout"].to_string();
        for name in panels.keys() {
            assert!(arrangement.contains(&format!("\"{name}\"")), "{name} has no place");
        }
    }
}
