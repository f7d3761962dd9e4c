//! `foretrace move home`: let the daemon move the arm home, and stay until it is there.
//!
//! Contract: moves nothing without `--yes` or a `yes` on the terminal. Leaving stops the arm: on Ctrl-C, and
//! if the answer or the status does not come, it is stopped in the way that needs no middleware.

use std::io::IsTerminal;
use std::time::{Duration, Instant};

use foretrace_client::wire::{FaultReason, WayHome};
use foretrace_client::{Instance, Mode, RequestError, Status, StatusReader, monotonic_now_ns};
use foretrace_report::failures::refused;
use foretrace_report::stopped;
use serde_json::json;

use crate::attach::unattached;
use crate::failure::{Cause, Failure};
use crate::interrupt::Interrupt;
use crate::output::{JsonArgs, may_draw, note, say};
use crate::settings::InstanceArgs;
use crate::terminal::agreed;

/// Longer than the daemon's own limit for an answer.
const ANSWER: Duration = Duration::from_secs(3);
/// Longest wait for a status, and for the confirmation of a stop.
const PATIENCE: Duration = Duration::from_secs(2);
const LOOK_EVERY: Duration = Duration::from_millis(50);
/// Largest distance of a joint at which the arm counts as home [rad]: the presets' bound on the tracking
/// error.
const AT_HOME_RAD: f64 = 0.02;

/// `foretrace move ...`
#[derive(Debug, clap::Subcommand)]
pub(crate) enum MoveCommand {
    Home(HomeArgs),
}

/// Move the arm home from where it stands, slowly and straight in joint space
///
/// No joint is faster than 0.25 rad/s. The daemon checks the whole path before anything moves: if the arm
/// would come too near itself, a plane or a box of [clearance], it refuses and names the obstacle. It does
/// not see what is not in the settings, people among them: stand at the arm's own stop button. Ctrl-C stops
/// the arm, as `foretrace request stop` does. At home the arm is disarmed; `foretrace request arm` takes it
/// over.
#[derive(Debug, clap::Args)]
pub(crate) struct HomeArgs {
    /// Move without asking on the terminal
    #[arg(long)]
    yes: bool,

    #[command(flatten)]
    instance: InstanceArgs,

    #[command(flatten)]
    json: JsonArgs,
}

pub(crate) fn run(command: &MoveCommand) -> Result<(), Failure> {
    match command {
        MoveCommand::Home(args) => home(args),
    }
}

fn home(args: &HomeArgs) -> Result<(), Failure> {
    args.json.claim()?;
    let may_ask = std::io::stdin().is_terminal() && std::io::stderr().is_terminal();
    if !args.yes && !may_ask {
        return Err(Failure::new(
            Cause::Usage,
            "the arm would move, and there is no terminal to ask on",
            "look at the arm, then give --yes",
        ));
    }
    let instance = args.instance.instance()?;
    let foretrace = args.instance.attach()?;
    let mut reader = foretrace.status().map_err(unattached)?;
    let mut requests = foretrace.requests();
    let before = reader.next_within(PATIENCE).ok_or_else(silent)?;
    let way = before.way_home;
    if way.farthest_rad >= 0.0 {
        say!(
            "home is {:.2} rad away for joint {}, which turns farthest: {:.1} s in a straight line of the \
             joints",
            way.farthest_rad,
            way.joint,
            way.left_s
        );
    }
    if !args.yes && !agreed("The arm will move. Is its way clear of people and things?")? {
        return Err(Failure::new(Cause::Interrupted, "nothing was moved", "answer yes to move the arm"));
    }
    // From here on Ctrl-C stops the arm; before, it just ends the program.
    let interrupt = Interrupt::listen()?;
    let begin = Instant::now();
    let answered = requests.move_home(ANSWER);
    if let Err(error @ (RequestError::NoAnswer(_) | RequestError::NotConnected(_))) = answered {
        // It may move nevertheless.
        return Err(halted(&instance, Cause::Failed, &refused(&error).to_string()));
    }
    answered.map_err(|error| refused(&error))?;
    let moving = MovingHome { instance: &instance, interrupt: &interrupt, since_ns: monotonic_now_ns() };
    let at_home = moving.watch(&mut reader)?;
    let took_s = begin.elapsed().as_secs_f64();
    say!(
        "at home within {:.4} rad, after {took_s:.1} s: `foretrace request arm` takes the arm over",
        at_home.farthest_rad
    );
    args.json.write(&json!({
        "at_home": true,
        "way_rad": way.farthest_rad,
        "left_rad": at_home.farthest_rad,
        "seconds": took_s,
    }))
}

fn silent() -> Failure {
    Failure::failed("the daemon does not report its status", "see `foretrace doctor`")
}

/// Stops the arm because of `why`.
fn halted(instance: &Instance, cause: Cause, why: &str) -> Failure {
    match foretrace_client::stop(instance, PATIENCE) {
        Ok(_) => Failure::new(cause, why, "the arm was stopped where it is"),
        Err(error) => Failure::failed(format_args!("{why}; {error}"), "use the arm's own stop button"),
    }
}

/// An arm on its way.
struct MovingHome<'a> {
    instance: &'a Instance,
    interrupt: &'a Interrupt,
    /// When the daemon answered; older statuses are from before the motion.
    since_ns: u64,
}

impl MovingHome<'_> {
    /// Waits until it is at home; returns the remaining distance.
    fn watch(&self, reader: &mut StatusReader) -> Result<WayHome, Failure> {
        let (mut heard, mut reported) = (Instant::now(), Instant::now());
        loop {
            if self.interrupt.is_set() {
                return Err(halted(self.instance, Cause::Interrupted, "interrupted on the way home"));
            }
            let Some(status) = reader.next_within(LOOK_EVERY) else {
                if heard.elapsed() > PATIENCE {
                    return Err(halted(self.instance, Cause::Failed, "the daemon stopped reporting"));
                }
                continue;
            };
            heard = Instant::now();
            if status.header.stamp_ns <= self.since_ns {
                continue;
            }
            if Mode::try_from(status.mode) != Ok(Mode::Homing) {
                return ended(&status);
            }
            if may_draw() && reported.elapsed() >= Duration::from_secs(1) {
                reported = Instant::now();
                let way = &status.way_home;
                note!("{:3.0} % of the way, {:.0} s to go", way.share.max(0.0) * 100.0, way.left_s.max(0.0));
            }
        }
    }
}

/// Why an arm no longer moves home.
fn ended(status: &Status) -> Result<WayHome, Failure> {
    let way = status.way_home;
    let left = format!("{:.2} rad from home", way.farthest_rad);
    match Mode::try_from(status.mode) {
        Ok(Mode::Idle) if (0.0..=AT_HOME_RAD).contains(&way.farthest_rad) => Ok(way),
        Ok(Mode::Stopped | Mode::Fault) => {
            let fault = FaultReason::try_from(status.fault).unwrap_or(FaultReason::Internal);
            let remedy = match fault {
                FaultReason::None | FaultReason::Requested => {
                    "`foretrace move home` goes on from there".to_owned()
                }
                _ => stopped::explained(status).1,
            };
            let why = stopped::explained(status).0;
            Err(Failure::failed(format_args!("the arm was stopped {left}: {why}"), remedy))
        }
        _ => Err(Failure::failed(
            format_args!("the arm was let go of {left} (mode {})", mode_of(status)),
            "`foretrace move home` goes on from there",
        )),
    }
}

fn mode_of(status: &Status) -> &'static str {
    Mode::try_from(status.mode).map_or("unknown", Mode::label)
}

#[cfg(test)]
mod tests {
    use foretrace_client::wire::{StopCause, StopDetail};

    use super::*;

    fn status(mode: Mode, farthest_rad: f64) -> Status {
        let way_home = WayHome { farthest_rad, ..WayHome::UNKNOWN };
        Status { mode: mode.into(), way_home, ..Status::default() }
    }

    #[test]
    fn only_an_arm_that_is_measured_at_home_is_there() {
        assert!(ended(&status(Mode::Idle, 0.003)).is_ok());
        for elsewhere in [0.5, -1.0, f64::NAN] {
            let failure = ended(&status(Mode::Idle, elsewhere)).unwrap_err();
            assert!(failure.to_string().contains("let go of"), "{failure}");
        }
    }

    #[test]
    fn a_stop_on_the_way_is_told_with_its_reason() {
        let stop = StopDetail {
            cause: StopCause::Clearance.into(),
            joint: -1,
            amount: 0.004,
            limit: 0.02,
            at_ns: 1,
        };
        let held = Status { fault: FaultReason::WayBlocked.into(), stop, ..status(Mode::Stopped, 0.5) };
        let failure = ended(&held).unwrap_err().to_string();
        assert!(failure.contains("0.50 rad from home: blocked while homing"), "{failure}");
        assert!(failure.contains("4.0 mm from the arm"), "{failure}");
        let asked = ended(&status(Mode::Stopped, 0.5)).unwrap_err().to_string();
        assert!(asked.contains("requested") && asked.contains("move home"), "{asked}");
    }
}
