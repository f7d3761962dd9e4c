//! `foretrace status`: shows the daemon's status.

use std::path::Path;
use std::time::{Duration, Instant};

use foretrace_client::{DaemonChange, Foretrace, Lookout, Status, StatusReader, monotonic_now_ns};
use foretrace_doctor::bounded;
use foretrace_report::status::{self, Alarm, Holders, Screen, Tone};
use serde_json::Value;

use crate::attach::unattached;
use crate::failure::{Cause, Failure};
use crate::interrupt::Interrupt;
use crate::output::{JsonArgs, clear_screen, paint, say};
use crate::settings::InstanceArgs;
use crate::terminal::{self, TypedKeys};

/// Columns of the text where no terminal says how many it has.
const PLAIN_COLUMNS: usize = 120;
/// The daemon publishes its status ten times per second.
const PATIENCE: Duration = Duration::from_secs(2);
/// Longest time for attaching and for that, whatever lies in shared memory.
const LONGEST: Duration = Duration::from_secs(8);

/// Show the daemon's mode, rates, latencies, losses, trust and learner
///
/// Spreads are over all ticks since the daemon started: wakeup is from the planned start of a tick to its
/// real one, step from there to the command published, the others are its stages.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:\n  foretrace status --watch\n  foretrace status --watch --json | jq \
                  .pen_to_command.p99_us\n  foretrace status --watch --alarm 'pen_to_command.p99_us>5000' \
                  --alarm 'loop.overruns>100'")]
pub(crate) struct StatusArgs {
    /// Refresh until `q` or Ctrl-C, on the screen that is there (two columns from 120); with `--json` one
    /// line of JSON per second instead
    #[arg(long)]
    watch: bool,

    /// End with exit code 7 when a figure of the JSON breaks this bound; may be given several times
    #[arg(long = "alarm", value_name = "FIGURE>NUMBER", value_parser = status::alarm)]
    alarms: Vec<Alarm>,

    #[command(flatten)]
    instance: InstanceArgs,

    #[command(flatten)]
    json: JsonArgs,
}

pub(crate) fn run(args: &StatusArgs) -> Result<(), Failure> {
    args.json.claim()?;
    let known = status::json(&Status::default(), &Holders::default());
    for alarm in &args.alarms {
        alarm.check(&known).map_err(|wrong| Failure::usage(wrong, ""))?;
    }
    if args.watch && args.json.json.as_deref().is_some_and(|file| file != Path::new("-")) {
        let what = "--watch writes its JSON to stdout only, a line per second";
        return Err(Failure::usage(what, "use --json without a file"));
    }
    if args.watch {
        let foretrace = args.instance.attach()?;
        let reader = foretrace.status().map_err(unattached)?;
        return watch(args, foretrace, reader);
    }
    let instance = args.instance.clone();
    let found = bounded::within(LONGEST, move || newest(&instance)).unwrap_or_else(|| {
        let what = format!("no status within {} s: attaching hangs", LONGEST.as_secs());
        let remedy = "see `foretrace doctor`; `foretrace request stop` does not need to attach";
        Err(Failure::failed(what, remedy))
    });
    let (newest, holders) = found?;
    let figures = status::json(&newest, &holders);
    let columns = terminal::size().map_or(PLAIN_COLUMNS, |(columns, _)| columns);
    say!("{}", status::text_within(columns, &newest, &holders, newest.header.age_ns(monotonic_now_ns())));
    args.json.write(&figures)?;
    judged(&args.alarms, &figures)
}

/// The newest status, and who holds pen and dead-man switch.
fn newest(instance: &InstanceArgs) -> Result<(Box<Status>, Holders), Failure> {
    let foretrace = instance.attach()?;
    let mut reader = foretrace.status().map_err(unattached)?;
    let status = reader.next_within(PATIENCE).ok_or_else(|| silent(&foretrace))?;
    Ok((Box::new(status), Holders::of(foretrace.instance())))
}

/// Two screens per second, or one line of JSON.
fn watch(args: &StatusArgs, mut foretrace: Foretrace, mut reader: StatusReader) -> Result<(), Failure> {
    let streams = args.json.json.is_some();
    let pause = Duration::from_millis(if streams { 1000 } else { 500 });
    let interrupt = Interrupt::listen()?;
    let mut keys = if streams { None } else { TypedKeys::listen() };
    let mut lookout = Lookout::default();
    while !interrupt.is_set() && keys.as_mut().and_then(TypedKeys::pressed) != Some(b'q') {
        match awaited(&mut reader, &interrupt) {
            None if interrupt.is_set() => break,
            Some(newest) => {
                let holders = Holders::of(foretrace.instance());
                let figures = status::json(&newest, &holders);
                if streams {
                    args.json.line(&figures)?;
                } else {
                    clear_screen();
                    let (columns, lines) = terminal::size().unwrap_or(LEAST_SCREEN);
                    let age_ns = newest.header.age_ns(monotonic_now_ns());
                    show(&status::page((columns, lines), &newest, &holders, age_ns));
                }
                judged(&args.alarms, &figures)?;
            }
            None => {
                clear_screen();
                say!("no status for {} s: no daemon running, or it is stuck", PATIENCE.as_secs());
            }
        }
        if lookout.look(&mut foretrace) == DaemonChange::Renewed {
            reader = foretrace.status().map_err(unattached)?;
        }
        interrupt.wait(pause);
    }
    Ok(())
}

/// The next status; looks often whether the user wants to end, because a second Ctrl-C would leave the
/// terminal without an echo.
fn awaited(reader: &mut StatusReader, interrupt: &Interrupt) -> Option<Status> {
    let begin = Instant::now();
    let mut found = None;
    while found.is_none() && begin.elapsed() < PATIENCE && !interrupt.is_set() {
        found = reader.next_within(Duration::from_millis(50));
    }
    found
}

/// What a terminal has that does not say.
const LEAST_SCREEN: (usize, usize) = (80, 24);

/// The page, with its first lines in the colour of their mode where the terminal has it.
fn show(page: &Screen) {
    let colour = terminal::has_colour().then_some(page.tone).and_then(Tone::colour);
    paint(&page.top, colour);
    say!("{}", page.rest);
}

/// The first bound that is broken ends the program.
fn judged(alarms: &[Alarm], figures: &Value) -> Result<(), Failure> {
    let broken = alarms.iter().find_map(|alarm| alarm.broken_by(figures).map(|figure| (alarm, figure)));
    broken.map_or(Ok(()), |(alarm, figure)| {
        Err(Failure::new(
            Cause::Alarm,
            format_args!("alarm {alarm}: it is {figure}"),
            "see `foretrace status`",
        ))
    })
}

fn silent(foretrace: &Foretrace) -> Failure {
    let number = foretrace.instance().number();
    let what = format!("the daemon of instance {number} reports no status");
    Failure::new(Cause::NoDaemon, what, "it is starting, ending or stuck: look at its own messages")
}
