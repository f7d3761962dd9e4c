//! `foretrace arm ur`: the bridge to a Universal Robots controller, as a process of its own.
//!
//! Contract: what has to be right before motion is checked first, and nothing moves before somebody arms the
//! daemon. Outlives daemon and controller: without either it waits, says why, and goes on when they are back.

use std::hash::{BuildHasher, RandomState};
use std::path::PathBuf;
use std::time::{Duration, Instant};

use foretrace_client::{Commands, StatusReader, arm_flags, monotonic_now_ns};
use foretrace_config::Config;
use foretrace_ur::bridge::check::{self, Series};
use foretrace_ur::bridge::kinematics::Deviation;
use foretrace_ur::bridge::link::{Inspect, Link, LinkReport, Measured};
use foretrace_ur::bridge::pilot::{Floor, Pilot};
use foretrace_ur::bridge::probe::{Found, inspect, probe};
use foretrace_ur::bridge::program::Program;
use foretrace_ur::bridge::reaction::Phase;
use foretrace_ur::bridge::reason::Reason;
use foretrace_ur::bridge::registers::Registers;
use foretraced::settings_hash;
use serde::Serialize;

use super::agreement::Agreement;
use super::judge::Judge;
use super::ports::{Daemons, Reads};
use super::record::Record;
use super::refused::Refused;
use super::report::CommandReport;
use crate::attach::{News, attach_within, instance_of};
use crate::failure::{Cause, Failure};
use crate::interrupt::Interrupt;
use crate::output::{JsonArgs, note, say};
use crate::punctual;
use crate::robot::{self, HostArgs};
use crate::settings::{SettingsArgs, judged as loaded};

/// Drive a Universal Robots arm: joint commands to its controller, its joints back
///
/// For CB3 from PolyScope 3.9 and e-Series from 5.3, or `foretrace ur-sim`. Uses RTDE registers 24 to 41 and
/// a program of its own that stops the arm by itself when commands stay away. Checks version, model, payload
/// and tool first; nothing moves before somebody arms the daemon, which has to run with the same settings.
/// Never ends a protective stop: that is done
/// on the pendant.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:\n  foretrace arm ur --robot 127.0.0.1    beside foretrace ur-sim\n  \
                  foretrace arm ur --robot 192.168.0.9 --preset ur5-first-run")]
pub(crate) struct UrArgs {
    #[command(flatten)]
    host: HostArgs,

    /// Move an arm on another machine although safety.enable_required is false: without a dead-man nobody but
    /// the emergency stop can stop it at once
    #[arg(long)]
    without_dead_man: bool,

    /// Lower the pen as far as the settings say although the model is not the arm's factory calibration
    #[arg(long)]
    uncalibrated: bool,

    /// The rate that the daemon was given by --rate [Hz]; its settings have to be these
    #[arg(long, value_name = "HZ", value_parser = foretraced::options::rate)]
    rate: Option<u32>,

    /// Ask for no real-time priority
    #[arg(long)]
    no_rights: bool,

    /// End after this many seconds; otherwise on Ctrl-C
    #[arg(long, value_name = "S", value_parser = crate::values::lasting)]
    seconds: Option<f64>,

    /// Write every joint state as CSV: t_s (monotonic clock), q1..q6 [rad]
    #[arg(long, value_name = "FILE")]
    record: Option<PathBuf>,

    /// Seconds to wait for the daemon to come up
    #[arg(long, value_name = "S", default_value_t = 0.0, value_parser = crate::values::wait)]
    wait: f64,

    #[command(flatten)]
    settings: SettingsArgs,

    #[command(flatten)]
    json: JsonArgs,
}

/// How long a bridge that has to be started anew tells the daemon why, before it ends.
const LAST_WORDS: Duration = Duration::from_secs(2);

/// The result; keys are stable.
#[derive(Debug, Serialize)]
struct UrReport {
    commands: CommandReport,
    arm: ArmReport,
}

#[derive(Debug, Serialize)]
struct ArmReport {
    robot: RobotReport,
    /// Daemons attached to.
    daemons: u64,
    /// Joint states that no daemon could take.
    states_not_sent: u64,
    link: LinkReport,
}

#[derive(Debug, Serialize)]
struct RobotReport {
    host: String,
    version: String,
    series: Series,
    arm: Option<&'static str>,
    /// How far the tip is from where the settings' model believes it; none where the controller does not
    /// tell.
    deviation: Option<Deviation>,
    dead_man: bool,
    /// Why the bridge had no real-time priority; none where it had.
    not_real_time: Option<String>,
}

pub(crate) fn run(args: &UrArgs) -> Result<(), Failure> {
    args.json.claim()?;
    let interrupt = Interrupt::listen()?;
    let mut source = args.settings.source()?;
    source.rate_hz = args.rate;
    let config = loaded(&source)?;
    let addresses = args.host.addresses()?;
    let settings = config.settings();
    let dead_man = settings.safety.enable_required;
    check::dead_man(addresses.ip(), dead_man, args.without_dead_man).map_err(refused)?;
    let found = probe(&addresses).map_err(|error| Failure::failed(error, robot::DOCTOR))?;
    let deviation = judged(&config, &found, addresses.ip().is_loopback())?;
    tell(args, &config, &found, deviation);

    let registers = Registers::at(settings.robot.ur.register_base)
        .ok_or_else(|| Failure::bad_input("robot.ur.register_base leaves registers 24 to 41", "use 24"))?;
    let cycle_s = 1.0 / f64::from(found.series.rate_hz());
    let program = Program::new(&settings.robot.ur, &config.robot().limits, registers, cycle_s);
    let pilot = Pilot::new(config.robot().limits, cycle_s, 1.0 / program.watchdog_hz, None, drawn());
    let watch_remote = found.series.tells_remote_control(found.version);
    let link = Link::new(addresses, program, pilot, watch_remote, inspection(&config, args.uncalibrated))
        .map_err(|error| Failure::failed(format_args!("no thread for the dashboard: {error}"), ""))?;

    let foretrace = attach_within(&instance_of(settings)?, Duration::from_secs_f64(args.wait))?;
    let daemon = Daemons::attached(foretrace, Reads::Status)?;
    let mut bridge = Bridge {
        link,
        daemon,
        agreement: Agreement::new(settings_hash(&config)),
        floor_m: Floor::of(&config, deviation).filter(|_| !args.uncalibrated).map(|floor| floor.height_m),
        judge: Judge::new(config.robot().limits),
        record: args.record.as_deref().map(Record::create).transpose()?,
        without_dead_man: args.without_dead_man && !dead_man,
        detail: None,
        said: None,
        ready: false,
        not_sent: 0,
    };
    // Last, so that no thread that may wait inherits it; below the daemon's loop, whose commands it sends.
    let priority = punctual::below_the_loop(settings);
    let missing = punctual::ask("arm", priority, args.no_rights);
    let over = bridge.run(args.seconds, &interrupt);
    if let Some(record) = bridge.record.take() {
        record.finish()?;
    }
    let robot = RobotReport {
        host: args.host.robot.clone(),
        version: found.version.to_string(),
        series: found.series,
        arm: found.arm(),
        deviation,
        dead_man,
        not_real_time: missing,
    };
    let report = bridge.report(robot);
    summary(&report);
    args.json.write(&report)?;
    over.map_or(Ok(()), |reason| Err(Failure::failed(reason.text(), reason.remedy())))
}

/// What every connection is judged by.
fn inspection(config: &Config, uncalibrated: bool) -> Inspect {
    let config = config.clone();
    Box::new(move |addresses| inspect(addresses, &config).map(|floor| floor.filter(|_| !uncalibrated)))
}

/// A number that no other bridge is likely to begin with.
fn drawn() -> u64 {
    // Keyed at random by the standard library.
    RandomState::new().hash_one(monotonic_now_ns())
}

fn refused(refusal: check::Refusal) -> Failure {
    Failure::new(Cause::BadInput, refusal, "")
}

/// Everything that does not fit is told in one go.
fn judged(config: &Config, found: &Found, loopback: bool) -> Result<Option<Deviation>, Failure> {
    found.judged(config, loopback).map_err(|wrong| match wrong.as_slice() {
        [only] => refused(only.clone()),
        many => {
            let lines: Vec<String> = many.iter().map(ToString::to_string).collect();
            let count = many.len();
            Failure::bad_input(format_args!("{count} things do not fit:\n  {}", lines.join("\n  ")), "")
        }
    })
}

fn tell(args: &UrArgs, config: &Config, found: &Found, deviation: Option<Deviation>) {
    let settings = config.settings();
    let arm = found.arm().unwrap_or("unknown arm");
    note!("arm: {} {}, {arm}, {}", found.series, found.version, args.host.robot);
    if let Some(payload) = found.installation.payload_kg {
        let tcp = found
            .installation
            .tcp_m
            .map_or(String::new(), |[x, y, z]| format!(", tool centre point [{x:.4}, {y:.4}, {z:.4}] m"));
        note!("arm: the installation says a payload of {payload:.2} kg{tcp}");
    }
    match deviation {
        Some(off) if off.most_mm <= check::CALIBRATED_MM => {}
        Some(off) => note!(
            "arm: the tip is up to {:.1} mm from where the model believes it (uneven over the paper by \
             {:.1} mm)",
            off.most_mm,
            off.uneven_mm
        ),
        None => note!("arm: the controller does not tell its calibration: the tip may be off by centimetres"),
    }
    if let Some(floor) = Floor::of(config, deviation) {
        if args.uncalibrated {
            note!("arm: --uncalibrated: the pen is lowered all the same");
        } else {
            let height_mm = floor.height_m * 1e3;
            note!("arm: the pen stays {height_mm:.0} mm above the paper until the model is calibrated");
        }
    }
    if args.without_dead_man && !settings.safety.enable_required {
        note!("arm: WITHOUT A DEAD-MAN: only the emergency stop and Ctrl-C stop this arm at once");
    }
    let period_ms = 1e3 / f64::from(settings.control_loop.rate_hz);
    let valid_ms = period_ms * f64::from(settings.control_loop.valid_periods);
    let needed_ms = 1.5e3 / f64::from(found.series.rate_hz()) + 2.0 * period_ms;
    if valid_ms < needed_ms {
        let periods = (needed_ms / period_ms).ceil();
        note!(
            "arm: commands are valid for {valid_ms:.0} ms, the way to this controller takes up to \
             {needed_ms:.0}: \
             set loop.valid_periods = {periods:.0}, or the arm brakes where nothing is wrong"
        );
    }
}

/// Why the arm does not follow, and where it is slowed to how many percent.
type Hindrance = Option<(Reason, Option<i32>)>;

struct Bridge {
    link: Link,
    daemon: Daemons,
    agreement: Agreement,
    /// What was told of how near to the paper the pen may come [m].
    floor_m: Option<f64>,
    judge: Judge,
    record: Option<Record>,
    /// Nobody but the emergency stop can stop this arm at once, and somebody said so.
    without_dead_man: bool,
    /// What the system said about the reason that was told last.
    detail: Option<String>,
    /// Which daemon was told what keeps the arm from following, and at which speed.
    said: Option<(u64, Hindrance)>,
    /// That the arm may be armed has been said.
    ready: bool,
    not_sent: u64,
}

impl Bridge {
    /// Until somebody ends it, or the arm cannot follow it any more; then why.
    fn run(&mut self, seconds: Option<f64>, interrupt: &Interrupt) -> Option<Reason> {
        let end = seconds.map(|seconds| Instant::now() + Duration::from_secs_f64(seconds));
        let mut over: Option<Instant> = None;
        while !interrupt.is_set() && end.is_none_or(|end| Instant::now() < end) {
            self.turn();
            self.tell();
            if !matches!(self.daemon.look(), News::None | News::Gone) {
                self.agreement.forget(monotonic_now_ns());
            }
            over = if self.link.is_over() { over.or_else(|| Some(Instant::now())) } else { None };
            if over.is_some_and(|since| since.elapsed() > LAST_WORDS) {
                break;
            }
        }
        self.link.end();
        over.and_then(|_| self.link.reason())
    }

    fn turn(&mut self) {
        let (ports, judge, agreement) = (&mut self.daemon.ports, &mut self.judge, &mut self.agreement);
        let measured = self.link.turn(&mut |pilot: &mut Pilot| {
            if let Some(ports) = ports {
                let now_ns = monotonic_now_ns();
                ports.commands.drain(|command| {
                    judge.see(command);
                    // After it was sent, whatever the machine did between.
                    pilot.take(command, monotonic_now_ns());
                });
                agreement.taken_over(ports.commands.restarts(), now_ns);
                if let Some(status) = ports.status.as_mut().and_then(StatusReader::latest) {
                    agreement.see(status);
                }
            }
            pilot.settings_agree(agreement.verdict());
        });
        if let (Some(Measured { stamp_ns, state }), Some(record)) = (measured, &mut self.record) {
            record.add(stamp_ns, &state.q);
        }
        if let (Some(Measured { stamp_ns, mut state }), Some(ports)) = (measured, &mut self.daemon.ports) {
            if self.without_dead_man {
                state.line.flags |= arm_flags::WITHOUT_DEAD_MAN;
            }
            if self.link.is_simulated() {
                state.line.flags |= arm_flags::SIMULATED;
            }
            state.commands_refused =
                state.commands_refused.saturating_add(ports.commands.rejections().total());
            if !ports.states.publish(stamp_ns, state).unwrap_or(false) {
                self.not_sent += 1;
            }
        }
    }

    fn report(&self, robot: RobotReport) -> UrReport {
        let link = self.link.report();
        let commands = self.daemon.ports.as_ref().map(|ports| &ports.commands);
        let (count, newest) =
            commands.map_or((0, None), |commands| (commands.rejections().total(), commands.newest_refused()));
        let mut refused = Refused::default().with(count, newest);
        refused.jump = link.jumps;
        let lost = commands.map_or(0, Commands::dropped);
        let seen = self.judge.statistics();
        UrReport {
            commands: CommandReport::of(seen, link.commands, lost, refused),
            arm: ArmReport { robot, daemons: self.daemon.count, states_not_sent: self.not_sent, link },
        }
    }

    /// Tells the daemon why the arm does not follow, whenever that changes, and every new daemon.
    fn say(&mut self) {
        let percent = (100.0 * self.link.speed()).round() as i32;
        let reason =
            self.link.hindrance().map(|reason| (reason, (reason == Reason::Slowed).then_some(percent)));
        let now = (self.daemon.count, reason);
        let Some(ports) = self.daemon.ports.as_mut().filter(|_| self.said != Some(now)) else { return };
        self.said = Some(now);
        match reason {
            Some((reason, Some(percent))) => {
                ports.states.say(&format!("speed scaling is at {percent} %"), reason.remedy());
            }
            Some((reason, None)) => {
                let detail = self.detail.as_deref().map_or(String::new(), |detail| format!(" ({detail})"));
                ports.states.say(&format!("{}{detail}", reason.text()), reason.remedy());
            }
            None => ports.states.say_nothing(),
        }
    }

    fn tell(&mut self) {
        if let Some((reason, detail)) = self.link.news() {
            match &detail {
                Some(detail) => note!("arm: {reason} ({detail})"),
                None => note!("arm: {reason}"),
            }
            self.detail = detail;
        }
        self.say();
        if self.link.floor_m() != self.floor_m && self.link.phase() != Phase::Away {
            self.floor_m = self.link.floor_m();
            match self.floor_m {
                Some(m) => {
                    note!("arm: another arm than before: the pen stays {:.0} mm above the paper", m * 1e3)
                }
                None => note!("arm: the model is this arm's own: the pen may come down to the paper"),
            }
        }
        let ready = matches!(self.link.phase(), Phase::Ready);
        if ready && !self.ready {
            note!("arm: ready; arm the daemon to begin (foretrace request arm)");
        }
        self.ready = ready || (self.ready && matches!(self.link.phase(), Phase::Following { .. }));
    }
}

fn summary(report: &UrReport) {
    let UrReport { commands, arm: ArmReport { link, .. } } = report;
    say!("states      {} at {:.0} Hz, {} skipped", link.states, link.rate_hz, link.states_skipped);
    say!(
        "commands    {} taken, {} too far away, {} lost on the way, {} violations",
        link.commands,
        link.jumps,
        commands.lost,
        commands.limit_violations
    );
    say!(
        "cycles      {} following, {} without a fresh counter, {} counters lost",
        link.following_cycles,
        link.late_cycles,
        link.lost_counters
    );
    say!("round trip  {:.0} ms, {} connections", link.round_trip_ms, link.connections);
    match &report.arm.robot.not_real_time {
        None => say!("priority    real-time"),
        Some(why) => say!("priority    ordinary: {why}"),
    }
    for (reason, count) in &link.stops {
        say!("stopped     {count} times: {reason}");
    }
}
