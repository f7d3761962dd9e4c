//! A process that records every pen sample, command and tick record of an instance.
//!
//! Contract: `observe SECONDS --instance=N --root=DIR` prints one JSON object: `pens` \[sequence, device
//! stamp\], `commands` \[tick, pen sequence, pen stamp, published\], `ticks` (see `tick`), `lost`. Part of
//! the program under test, because shared memory belongs to the user who runs it.

use std::process::ExitCode;
use std::time::{Duration, Instant};

use foretrace_client::{Commands, Foretrace, Stage, TickRecord};
use serde_json::{Value, json};

/// The observer, with the arguments after `observe`.
#[must_use]
pub fn main(arguments: &[String]) -> ExitCode {
    match run(arguments) {
        Ok(seen) => {
            println!("{seen}");
            ExitCode::SUCCESS
        }
        Err(error) => {
            eprintln!("{error}");
            ExitCode::FAILURE
        }
    }
}

fn run(arguments: &[String]) -> Result<Value, Box<dyn std::error::Error>> {
    let seconds: f64 = arguments.first().ok_or("how many seconds?")?.parse()?;
    let instance = crate::instance_of(arguments)?;
    let foretrace = Foretrace::attach_within(&instance, Duration::from_secs(30))?;
    let mut pen = foretrace.pen_watch()?;
    let mut commands = foretrace.commands(Commands::MAX_BUFFER)?;
    let mut telemetry = foretrace.telemetry()?;
    let (mut pens, mut sent, mut ticks) = (Vec::new(), Vec::new(), Vec::new());
    let end = Instant::now() + Duration::from_secs_f64(seconds);
    while Instant::now() < end {
        pen.drain(|sample| pens.push(json!([sample.header.sequence, sample.device_stamp_ns])));
        commands.drain(|command| {
            sent.push(json!([
                command.tick,
                command.pen_sequence,
                command.pen_stamp_ns,
                command.published_ns
            ]));
        });
        telemetry.drain(|record| ticks.push(tick(record)));
        std::thread::sleep(Duration::from_millis(5));
    }
    let lost = pen.lost() + commands.dropped() + telemetry.lost();
    Ok(json!({ "pens": pens, "commands": sent, "ticks": ticks, "lost": lost }))
}

/// The fields of a tick record about the chain.
fn tick(record: &TickRecord) -> Value {
    let chain = record.chain;
    let known = |ns: u64| (ns != u64::MAX).then_some(ns);
    json!({
        "tick": record.tick,
        "release_ns": record.release_ns,
        "skipped": record.skipped_ticks,
        "mode": record.mode,
        "pen": [record.pen_sequence, record.pen_stamp_ns],
        "echo_tick": record.echo_tick,
        "echo_pen": [record.echo_pen_sequence, record.echo_pen_stamp_ns],
        "wakeup_ns": record.stage(Stage::Wakeup),
        "pen_reader_ns": known(chain.pen_reader_ns),
        "pen_transport_ns": known(chain.pen_transport_ns),
        "pen_age_ns": known(chain.pen_age_ns),
        "compute_ns": known(chain.compute_ns),
        "command_transport_ns": known(chain.command_transport_ns),
    })
}
