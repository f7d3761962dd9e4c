//! `foretrace play`: plays handwriting in real time.
//!
//! Contract: every sample carries the instant at which the pen was there and is sent at that instant, by
//! absolute sleeps, at the device's rate; late samples keep their stamps, as those of a real tablet do.
//! Outlives the daemon.

mod piped;
pub(crate) mod source;
mod route;

use std::path::PathBuf;
use std::time::Duration;

use foretrace_client::{Claimant, HolderKind, PenReading, monotonic_now_ns};
use foretrace_config::Config;
use foretrace_sim::data::write_csv;
use foretrace_sim::path::{PathSample, PenPath};
use foretraced::rt::os::sleep_until_ns;
use serde::Serialize;

use crate::attach::instance_of;
use crate::failure::Failure;
use crate::interrupt::Interrupt;
use crate::output::{JsonArgs, note, say};
use crate::settings::SettingsArgs;
use crate::take_over::TakeOver;
use route::{PenRoute, SendOutcome};
use source::PathArgs;

/// Time before the pen writes, for the loop to get ready.
const LEAD_NS: u64 = 50_000_000;
/// Longest sleep without looking for Ctrl-C.
const NAP_NS: u64 = 100_000_000;

/// Play handwriting into the loop, in real time, as a pen tablet would
///
/// SOURCE is one or more recordings (UNIPEN, InkML, Character Trajectories), a data-set folder (its test
/// part, or all where it has none), one CSV with columns of time, x and y, one .mcap file of
/// foretrace record, or glyphs:TEXT for the built-in writer. Recorded ink is recentred into the workspace
/// of the settings; where a recording has no hover between two strokes, a lift and travel is inserted. A
/// single - reads samples from a pipe, one line x_m,y_m,contact each, and sends them as they come.
#[derive(Debug, clap::Args)]
#[command(
    allow_negative_numbers = true,
    after_help = "Examples:\n  foretrace play glyphs:Hello\n  foretrace play data/unipen-ced/data/001.dat \
                  --label K --loop\n  foretrace play path.csv --speed 0.5\n  \
                  my-tracker | foretrace play -"
)]
pub(crate) struct PlayArgs {
    /// What to play
    #[arg(value_name = "SOURCE", required = true)]
    sources: Vec<String>,

    #[command(flatten)]
    path: PathArgs,

    /// Repeat until --seconds are over or Ctrl-C
    #[arg(long = "loop")]
    repeat: bool,

    /// End after this many seconds
    #[arg(long, value_name = "S", value_parser = crate::values::lasting)]
    seconds: Option<f64>,

    /// Seconds to wait for the daemon to come up
    #[arg(long, value_name = "S", default_value_t = 0.0, value_parser = crate::values::wait)]
    wait: f64,

    /// Send to the socket of a `foretrace gateway` instead of into shared memory; for users other than the
    /// daemon's
    #[arg(long, value_name = "PATH")]
    gateway: Option<PathBuf>,

    #[command(flatten)]
    take_over: TakeOver,

    /// Write what was sent as CSV: t_s (monotonic clock), x_m, y_m, contact
    #[arg(long, value_name = "FILE")]
    record: Option<PathBuf>,

    #[command(flatten)]
    settings: SettingsArgs,

    #[command(flatten)]
    json: JsonArgs,
}

/// The result; keys are stable.
#[derive(Debug, Default, Serialize)]
struct PlayReport {
    samples: u64,
    /// Sent while no daemon listened; a gateway does not tell.
    unheard: u64,
    /// Refused by the shared memory.
    failed: u64,
    rate_hz: f64,
    seconds: f64,
    /// The latest that a sample was sent after its stamp [ms].
    latest_ms: f64,
}

pub(crate) fn run(args: &PlayArgs) -> Result<(), Failure> {
    args.json.claim()?;
    let interrupt = Interrupt::listen()?;
    let config = args.settings.load()?;
    if args.sources == ["-"] {
        return piped(args, &config, &interrupt);
    }
    let source = args.path.load(&args.sources, config.settings())?;
    for what in &source.notes {
        note!("play: {what}");
    }
    let path = if args.repeat { source.path.closed() } else { source.path };
    note!(
        "play: {} samples at {:.0} Hz, {:.1} s{}, {} lifts put in",
        path.samples.len(),
        path.rate_hz,
        path.duration_s(),
        if args.repeat { ", over and over" } else { "" },
        path.inserted_travels
    );
    let mut player = Player::of(args, &config)?;
    player.report.rate_hz = path.rate_hz;
    let begin = monotonic_now_ns() + LEAD_NS;
    let turns = if args.repeat { usize::MAX } else { path.samples.len() };
    let first_s = path.samples.first().map_or(0.0, |sample| sample.t_s);
    for sample in path.cycle().take(turns) {
        let after_s = sample.t_s - first_s;
        let due = begin + (after_s * 1e9) as u64;
        if args.seconds.is_some_and(|seconds| after_s >= seconds) || !slept_until(due, &interrupt) {
            break;
        }
        player.send(due, &sample)?;
        player.route.look();
        player.report.seconds = after_s;
    }
    player.finish(args, &interrupt)
}

/// Samples of a pipe.
fn piped(args: &PlayArgs, config: &Config, interrupt: &Interrupt) -> Result<(), Failure> {
    if args.repeat {
        return Err(Failure::usage("a pipe has no end to go on from", "leave out --loop"));
    }
    let mut player = Player::of(args, config)?;
    note!("play: samples from stdin, one line x_m,y_m,contact each");
    piped::run(&mut player, args.seconds, interrupt)?;
    let report = &mut player.report;
    report.rate_hz = if report.seconds > 0.0 { report.samples as f64 / report.seconds } else { 0.0 };
    player.finish(args, interrupt)
}

struct Player {
    route: PenRoute,
    report: PlayReport,
    sent: Option<Vec<PathSample>>,
    /// What the loop did not take yet is lost with the player: one that was held up for longer has latched a
    /// stop by then \[ns\].
    lingers_ns: u64,
}

impl Player {
    fn of(args: &PlayArgs, config: &Config) -> Result<Self, Failure> {
        let route = match &args.gateway {
            Some(path) => PenRoute::gateway(path)?,
            None => {
                let wait = Duration::from_secs_f64(args.wait);
                let who = Claimant::new(HolderKind::Player, &args.sources.join(" "));
                PenRoute::shared(&instance_of(config.settings())?, wait, who, args.take_over)?
            }
        };
        let sent = args.record.is_some().then(Vec::new);
        let lingers_ns = (config.settings().safety.latch_after_ms * 1e6) as u64;
        Ok(Self { route, report: PlayReport::default(), sent, lingers_ns })
    }

    /// Lets the loop take what was sent, writes what was asked for, and tells how it went.
    fn finish(self, args: &PlayArgs, interrupt: &Interrupt) -> Result<(), Failure> {
        if self.report.unheard < self.report.samples {
            slept_until(monotonic_now_ns() + self.lingers_ns, interrupt);
        }
        if let (Some(file), Some(sent)) = (&args.record, self.sent) {
            write_csv(file, &PenPath::from_samples(sent)).map_err(|error| {
                Failure::failed(format_args!("{}: {error}", file.display()), "give a writable --record FILE")
            })?;
        }
        if let Some(words) = self.route.finish() {
            note!("play: {words}");
        }
        let report = self.report;
        say!(
            "{} samples sent in {:.1} s, {} unheard, {} failed, at most {:.1} ms late",
            report.samples,
            report.seconds,
            report.unheard,
            report.failed,
            report.latest_ms
        );
        args.json.write(&report)
    }

    fn send(&mut self, due: u64, sample: &PathSample) -> Result<(), Failure> {
        let reading = PenReading {
            device_stamp_ns: due,
            x_m: sample.x_m,
            y_m: sample.y_m,
            contact: sample.contact,
            more_flags: foretrace_client::wire::pen_flags::IN_RANGE,
            ..PenReading::default()
        };
        match self.route.send(reading)? {
            SendOutcome::Heard => {}
            SendOutcome::Unheard => self.report.unheard += 1,
            SendOutcome::Failed(error) => {
                if self.report.failed == 0 {
                    note!("play: {error}");
                }
                self.report.failed += 1;
            }
        }
        self.report.samples += 1;
        let late_ms = monotonic_now_ns().saturating_sub(due) as f64 * 1e-6;
        self.report.latest_ms = self.report.latest_ms.max(late_ms);
        if let Some(sent) = &mut self.sent {
            sent.push(PathSample { t_s: due as f64 * 1e-9, ..*sample });
        }
        Ok(())
    }
}

/// Sleeps in short naps; false when the program shall end.
fn slept_until(due: u64, interrupt: &Interrupt) -> bool {
    loop {
        if interrupt.is_set() {
            return false;
        }
        let now = monotonic_now_ns();
        if now >= due {
            return true;
        }
        sleep_until_ns(due.min(now + NAP_NS));
    }
}
