//! The bridge to a Universal Robots controller, as a process of its own.
//!
//! Contract: what has to be right before motion is checked first, and nothing moves before somebody arms the
//! daemon. Outlives daemon and controller: without either it waits, says why, and goes on when they are back.

use std::hash::{BuildHasher, RandomState};
use std::path::PathBuf;
use std::time::{Duration, Instant};

use foretrace_client::wire::arm_flags;
use foretrace_client::{Commands, DaemonChange, Foretrace, StatusReader, monotonic_now_ns};
use foretrace_config::Config;
use foretrace_failure::Failure;
use foretrace_report::failures::{DOCTOR, unattached};
use foretrace_ur::bridge::address::Addresses;
use foretrace_ur::bridge::check::{self, Series};
use foretrace_ur::bridge::kinematics::Deviation;
use foretrace_ur::bridge::link::{Inspect, Link, LinkReport, MeasuredJoints};
use foretrace_ur::bridge::pilot::{Floor, Pilot};
use foretrace_ur::bridge::probe::{Found, inspect, probe};
use foretrace_ur::bridge::program::BridgeProgram;
use foretrace_ur::bridge::reaction::Phase;
use foretrace_ur::bridge::reason::HaltReason;
use foretrace_ur::bridge::registers::RegisterMap;
use foretraced::settings_hash;
use serde::Serialize;

use crate::agreement::Agreement;
use crate::joint_log::JointLog;
use crate::judge::Judge;
use crate::ports::{Daemons, Reads};
use crate::priority;
use crate::refused::RefusedCommands;
use crate::report::CommandReport;
use foretrace_report::Tell;

/// How long a bridge that has to be started again tells the daemon why, before it ends.
const LAST_WORDS: Duration = Duration::from_secs(2);

/// The result; keys are stable.
#[derive(Debug, Serialize)]
pub struct UrReport {
    pub commands: CommandReport,
    pub arm: BridgeReport,
}

#[derive(Debug, Serialize)]
pub struct BridgeReport {
    pub robot: ControllerReport,
    pub daemons: u64,
    /// Joint states that no daemon could take.
    pub states_not_sent: u64,
    pub link: LinkReport,
}

#[derive(Debug, Serialize)]
pub struct ControllerReport {
    pub host: String,
    pub version: String,
    pub series: Series,
    pub arm: Option<&'static str>,
    /// How far the tip is from where the settings' model believes it; none where the controller does not
    /// tell.
    pub deviation: Option<Deviation>,
    pub dead_man: bool,
    /// Why the bridge had no real-time priority; none where it had.
    pub not_real_time: Option<String>,
}

/// What a bridge is asked for.
pub struct UrOptions {
    /// As it was named.
    pub host: String,
    /// An arm on another machine may move although the settings ask for no dead-man.
    pub without_dead_man: bool,
    /// The pen may be lowered although the model is not the arm's factory calibration.
    pub uncalibrated: bool,
    pub no_rights: bool,
    pub seconds: Option<f64>,
    /// A new file for every joint state.
    pub record: Option<PathBuf>,
}

/// A bridge whose controller has been judged, and fits.
pub struct JudgedBridge<'a> {
    config: &'a Config,
    options: UrOptions,
    found: Found,
    deviation: Option<Deviation>,
    link: Link,
}

impl<'a> JudgedBridge<'a> {
    /// Asks the controller at `addresses`, and judges it by `config`.
    ///
    /// # Errors
    ///
    /// It does not answer, or something does not fit.
    pub fn new(
        config: &'a Config,
        addresses: Addresses,
        options: UrOptions,
        tell: Tell<'_>,
    ) -> Result<Self, Failure> {
        let settings = config.settings();
        check::dead_man(addresses.ip(), settings.safety.enable_required, options.without_dead_man)
            .map_err(refused)?;
        let found = probe(&addresses).map_err(|error| Failure::failed(error, DOCTOR))?;
        let deviation = judged(config, &found, addresses.ip().is_loopback())?;
        tell_of(&options, config, &found, deviation, tell);
        let registers = RegisterMap::at(settings.robot.ur.register_base).ok_or_else(|| {
            Failure::bad_input("robot.ur.register_base leaves registers 24 to 41", "use 24")
        })?;
        let cycle_s = 1.0 / f64::from(found.series.rate_hz());
        let program = BridgeProgram::new(&settings.robot.ur, &config.robot().limits, registers, cycle_s);
        let pilot = Pilot::new(config.robot().limits, cycle_s, 1.0 / program.watchdog_hz, None, drawn());
        let watch_remote = found.series.tells_remote_control(found.version);
        let inspection = inspection(config, options.uncalibrated);
        let link = Link::new(addresses, program, pilot, watch_remote, inspection)
            .map_err(|error| Failure::failed(format_args!("no thread for the dashboard: {error}"), ""))?;
        Ok(Self { config, options, found, deviation, link })
    }

    /// Carries commands and states until it is `interrupted`, its time is over, or the arm cannot follow it
    /// any more; then why.
    ///
    /// # Errors
    ///
    /// The daemon has no slot for it, or its file cannot be made or written.
    pub fn run(
        self,
        foretrace: Foretrace,
        interrupted: &dyn Fn() -> bool,
        tell: Tell<'_>,
    ) -> Result<(UrReport, Option<HaltReason>), Failure> {
        let Self { config, options, found, deviation, link } = self;
        let settings = config.settings();
        let dead_man = settings.safety.enable_required;
        let mut bridge = Bridge {
            link,
            daemon: Daemons::attached(foretrace, Reads::Status).map_err(unattached)?,
            agreement: Agreement::new(settings_hash(config)),
            floor_m: Floor::of(config, deviation)
                .filter(|_| !options.uncalibrated)
                .map(|floor| floor.height_m),
            judge: Judge::new(config.robot().limits),
            log: options.record.as_deref().map(JointLog::create).transpose()?,
            without_dead_man: options.without_dead_man && !dead_man,
            detail: None,
            reported: None,
            ready: false,
            not_sent: 0,
            tell,
        };
        // Last, so that no thread that may wait inherits it; below the daemon's loop, whose commands it
        // sends.
        let not_real_time = priority::ask("arm", priority::below_the_loop(settings), options.no_rights, tell);
        let over = bridge.run(options.seconds, interrupted);
        if let Some(log) = bridge.log.take() {
            log.finish()?;
        }
        let robot = ControllerReport {
            host: options.host,
            version: found.version.to_string(),
            series: found.series,
            arm: found.arm(),
            deviation,
            dead_man,
            not_real_time,
        };
        Ok((bridge.report(robot), over))
    }
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

fn refused(refusal: check::CheckRefusal) -> Failure {
    Failure::bad_input(refusal, "")
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

fn tell_of(
    options: &UrOptions,
    config: &Config,
    found: &Found,
    deviation: Option<Deviation>,
    tell: Tell<'_>,
) {
    let settings = config.settings();
    let arm = found.arm().unwrap_or("unknown arm");
    tell(&format!("arm: {} {}, {arm}, {}", found.series, found.version, options.host));
    if let Some(payload) = found.installation.payload_kg {
        let tcp = found
            .installation
            .tcp_m
            .map_or(String::new(), |[x, y, z]| format!(", tool centre point [{x:.4}, {y:.4}, {z:.4}] m"));
        tell(&format!("arm: the installation says a payload of {payload:.2} kg{tcp}"));
    }
    match deviation {
        Some(off) if off.most_mm <= check::CALIBRATED_MM => {}
        Some(off) => tell(&format!(
            "arm: the tip is up to {:.1} mm from where the model believes it (uneven over the paper by \
             {:.1} mm)",
            off.most_mm, off.uneven_mm
        )),
        None => tell("arm: the controller does not tell its calibration: the tip may be off by centimetres"),
    }
    if let Some(floor) = Floor::of(config, deviation) {
        if options.uncalibrated {
            tell("arm: --uncalibrated: the pen is lowered all the same");
        } else {
            let height_mm = floor.height_m * 1e3;
            tell(&format!(
                "arm: the pen stays {height_mm:.0} mm above the paper until the model is calibrated"
            ));
        }
    }
    if options.without_dead_man && !settings.safety.enable_required {
        tell("arm: WITHOUT A DEAD-MAN: only the emergency stop and Ctrl-C stop this arm at once");
    }
    let period_ms = 1e3 / f64::from(settings.control_loop.rate_hz);
    let valid_ms = period_ms * f64::from(settings.control_loop.valid_periods);
    let needed_ms = 1.5e3 / f64::from(found.series.rate_hz()) + 2.0 * period_ms;
    if valid_ms < needed_ms {
        let periods = (needed_ms / period_ms).ceil();
        tell(&format!(
            "arm: commands are valid for {valid_ms:.0} ms, the way to this controller takes up to \
             {needed_ms:.0}: \
             set loop.valid_periods = {periods:.0}, or the arm brakes where nothing is wrong"
        ));
    }
}

/// Why the arm does not follow, and where it is slowed to how many percent.
type Hindrance = Option<(HaltReason, Option<i32>)>;

struct Bridge<'a> {
    link: Link,
    daemon: Daemons,
    agreement: Agreement,
    /// How near to the paper the pen may come, as it was reported \[m\].
    floor_m: Option<f64>,
    judge: Judge,
    log: Option<JointLog>,
    /// Nobody but the emergency stop can stop this arm at once, and somebody asked for that.
    without_dead_man: bool,
    /// What the system says about the reason that was reported last.
    detail: Option<String>,
    /// To which daemon it was reported what keeps the arm from following, and at which speed.
    reported: Option<(u64, Hindrance)>,
    /// That the arm may be armed has been reported.
    ready: bool,
    not_sent: u64,
    tell: Tell<'a>,
}

impl Bridge<'_> {
    /// Until somebody ends it, or the arm cannot follow it any more; then why.
    fn run(&mut self, seconds: Option<f64>, interrupted: &dyn Fn() -> bool) -> Option<HaltReason> {
        let end = seconds.map(|seconds| Instant::now() + Duration::from_secs_f64(seconds));
        let mut over: Option<Instant> = None;
        while !interrupted() && end.is_none_or(|end| Instant::now() < end) {
            self.turn();
            self.tell();
            if matches!(self.daemon.look(self.tell), DaemonChange::Back | DaemonChange::Renewed) {
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
        let (daemon, judge, agreement) = (&mut self.daemon, &mut self.judge, &mut self.agreement);
        let measured = self.link.turn(&mut |pilot: &mut Pilot| {
            if let Some(ports) = daemon.ports() {
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
        if let (Some(MeasuredJoints { stamp_ns, state }), Some(log)) = (measured, &mut self.log) {
            log.add(stamp_ns, &state.q);
        }
        if let (Some(MeasuredJoints { stamp_ns, mut state }), Some(ports)) = (measured, self.daemon.ports()) {
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

    fn report(&self, robot: ControllerReport) -> UrReport {
        let link = self.link.report();
        let commands = self.daemon.commands();
        let (count, newest) =
            commands.map_or((0, None), |commands| (commands.rejections().total(), commands.newest_refused()));
        let mut refused = RefusedCommands::default().with(count, newest);
        refused.jump = link.jumps;
        let lost = commands.map_or(0, Commands::dropped);
        let seen = self.judge.statistics();
        UrReport {
            commands: CommandReport::of(seen, link.commands, lost, refused),
            arm: BridgeReport { robot, daemons: self.daemon.count, states_not_sent: self.not_sent, link },
        }
    }

    /// Tells the daemon why the arm does not follow, whenever that changes, and every new daemon.
    fn say(&mut self) {
        let percent = (100.0 * self.link.speed()).round() as i32;
        let reason =
            self.link.hindrance().map(|reason| (reason, (reason == HaltReason::Slowed).then_some(percent)));
        let now = (self.daemon.count, reason);
        let Some(ports) = self.daemon.ports().filter(|_| self.reported != Some(now)) else { return };
        self.reported = Some(now);
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
                Some(detail) => (self.tell)(&format!("arm: {reason} ({detail})")),
                None => (self.tell)(&format!("arm: {reason}")),
            }
            self.detail = detail;
        }
        self.say();
        if self.link.floor_m() != self.floor_m && self.link.phase() != Phase::Away {
            self.floor_m = self.link.floor_m();
            match self.floor_m {
                Some(m) => (self.tell)(&format!(
                    "arm: another arm than before: the pen stays {:.0} mm above the paper",
                    m * 1e3
                )),
                None => (self.tell)("arm: the model is this arm's own: the pen may come down to the paper"),
            }
        }
        let ready = matches!(self.link.phase(), Phase::Ready);
        if ready && !self.ready {
            (self.tell)("arm: ready; arm the daemon to begin (foretrace request arm)");
        }
        self.ready = ready || (self.ready && matches!(self.link.phase(), Phase::Following { .. }));
    }
}

impl UrReport {
    /// The report for people.
    pub fn lines(&self) -> Vec<String> {
        let Self { commands, arm: BridgeReport { link, robot, .. } } = self;
        let mut lines = vec![
            format!("states      {} at {:.0} Hz, {} skipped", link.states, link.rate_hz, link.states_skipped),
            format!(
                "commands    {} taken, {} too far away, {} lost on the way, {} violations",
                link.commands, link.jumps, commands.lost, commands.limit_violations
            ),
            format!(
                "cycles      {} following, {} without a fresh counter, {} counters lost",
                link.following_cycles, link.late_cycles, link.lost_counters
            ),
            format!("round trip  {:.0} ms, {} connections", link.round_trip_ms, link.connections),
            match &robot.not_real_time {
                None => "priority    real-time".to_owned(),
                Some(why) => format!("priority    ordinary: {why}"),
            },
        ];
        lines.extend(link.stops.iter().map(|(reason, count)| format!("stopped     {count} times: {reason}")));
        lines
    }
}
