//! The bridge on its one thread: connect, receive, answer, again and again.
//!
//! Contract: every wait is bounded; whatever goes wrong ends in a [`HaltReason`], never in an end of the
//! bridge.
//! It connects again by itself, because nothing moves before somebody arms.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use foretrace_client::{JointState, monotonic_now_ns};
use serde::Serialize;

use super::address::Addresses;
use super::line::{self, RtdeLine};
use super::pilot::{Counts, Floor, Pilot};
use super::probe::is_simulated;
use super::program::BridgeProgram;
use super::reaction::Phase;
use super::reason::HaltReason;
use super::registers::END;
use super::remote::RemoteWatch;
use super::upload::{Upload, UploadEvent};

/// Longest wait for one state, so that Ctrl-C and the daemon are looked at.
const WAIT: Duration = Duration::from_millis(50);
/// Without a state for so long the connection counts as lost.
const SILENCE: Duration = Duration::from_secs(1);
/// Between two attempts to connect.
const AGAIN: Duration = Duration::from_secs(1);
/// Most messages of the controller that are taken in one cycle.
const HEARD_AT_ONCE: usize = 8;
/// Longest time for a connection, or for the program to be sent.
const PATIENCE: Duration = Duration::from_secs(1);

/// Before another look at a controller that does not fit.
const LOOK_AGAIN: Duration = Duration::from_secs(5);

/// Asks and judges the controller behind every new connection: where the pen has to stay above, or why
/// nothing may move. May take seconds.
pub type Inspect = Box<dyn FnMut(&Addresses) -> Result<Option<Floor>, (HaltReason, String)>>;

/// A controller and everything that is known about it.
pub struct Link {
    addresses: Addresses,
    inspect: Inspect,
    program: BridgeProgram,
    pilot: Pilot,
    line: Option<RtdeLine>,
    /// What is behind the connection says that it is a simulator on this machine.
    simulated: bool,
    remote: Option<RemoteWatch>,
    upload: Option<Upload>,
    heard: Instant,
    /// Waits in a row in which nothing came.
    silent_turns: u32,
    next_attempt: Instant,
    connections: u64,
    reasons: BTreeMap<&'static str, u64>,
    counted: Option<HaltReason>,
    /// Why the arm did not follow when the end began; ending is no reason.
    at_end: Option<Option<HaltReason>>,
    reported: Option<HaltReason>,
    detail: Option<String>,
    /// See [`Link::speed`].
    speed: f64,
}

/// Joints that were measured.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MeasuredJoints {
    /// When, on this host's clock \[ns\].
    pub stamp_ns: u64,
    pub state: JointState,
}

/// A run in figures; keys are stable.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct LinkReport {
    /// Of the controller \[Hz\].
    pub rate_hz: f64,
    pub states: u64,
    /// States that the controller skipped or the line lost.
    pub states_skipped: u64,
    pub connections: u64,
    pub commands: u64,
    /// Commands refused: too far from the one before.
    pub jumps: u64,
    /// Cycles in which the arm was told to follow.
    pub following_cycles: u64,
    /// Cycles in which the program found no fresh counter.
    pub late_cycles: u64,
    /// Counters that the program never saw.
    pub lost_counters: u64,
    /// The usual round trip of a counter, from a state to the cycle that uses the answer \[ms\].
    pub round_trip_ms: f64,
    /// Number of round trips of 0, 1, 2, … cycles; the last holds all longer ones.
    pub round_trips: Vec<u64>,
    /// How often the arm stopped following, by reason.
    pub stops: BTreeMap<&'static str, u64>,
    /// Why it does not follow in the end; none where it would.
    pub reason: Option<HaltReason>,
}

impl Link {
    /// A link to the controller at `addresses` that runs `program`; `watch_remote` where the version tells
    /// remote control. Nothing moves over a connection before `inspect` has let it pass.
    ///
    /// # Errors
    ///
    /// Where the system gives no thread.
    pub fn new(
        addresses: Addresses,
        program: BridgeProgram,
        pilot: Pilot,
        watch_remote: bool,
        inspect: Inspect,
    ) -> std::io::Result<Self> {
        let remote = if watch_remote { Some(RemoteWatch::begin(addresses.dashboard)?) } else { None };
        let now = Instant::now();
        Ok(Self {
            addresses,
            inspect,
            program,
            pilot,
            line: None,
            simulated: false,
            remote,
            upload: None,
            heard: now,
            silent_turns: 0,
            next_attempt: now,
            connections: 0,
            reasons: BTreeMap::new(),
            counted: None,
            at_end: None,
            reported: None,
            detail: None,
            speed: 1.0,
        })
    }

    /// Waits for the next state, for 50 ms at most (seconds while connecting), and answers it at once.
    /// `commands` is called just before, to hand over the newest ones with [`Pilot::take`].
    pub fn turn(&mut self, commands: &mut dyn FnMut(&mut Pilot)) -> Option<MeasuredJoints> {
        let Some(line) = &mut self.line else {
            commands(&mut self.pilot);
            self.connect();
            return None;
        };
        let package = match line.receive(WAIT) {
            Ok(Some(package)) => package,
            Ok(None) => {
                // Once is not enough: this process itself may have stood still, with states waiting.
                self.silent_turns = self.silent_turns.saturating_add(1);
                if self.silent_turns > 2 && self.heard.elapsed() > SILENCE {
                    self.lose(HaltReason::ConnectionLost, Some("no state for a second".to_owned()));
                }
                return None;
            }
            Err(error) => {
                self.lose(HaltReason::ConnectionLost, Some(error.to_string()));
                return None;
            }
        };
        let arrival_ns = monotonic_now_ns();
        self.speed = package.speed_scaling.min(package.target_speed_fraction);
        (self.heard, self.silent_turns) = (Instant::now(), 0);
        commands(&mut self.pilot);
        if let Some(remote) = &self.remote {
            self.pilot.machine.remote_control(remote.remote());
        }
        let followed = matches!(self.phase(), Phase::Following { .. });
        let outcome = self.pilot.cycle(&package, arrival_ns)?;
        let line = self.line.as_mut()?;
        if outcome.restarted {
            // It may be another arm now, or another installation.
            self.lose(HaltReason::Restarted, None);
            return None;
        }
        if let Err(error) = line.send(&outcome.inputs) {
            self.lose(HaltReason::ConnectionLost, Some(error.to_string()));
            return None;
        }
        if let Some(token) = outcome.upload {
            self.send_program(token);
        }
        if !followed && matches!(self.phase(), Phase::Following { .. }) {
            // What was said before the arm was told to follow explains no later stop.
            self.detail = None;
        }
        self.hear();
        self.note();
        Some(MeasuredJoints { stamp_ns: outcome.stamp_ns, state: outcome.state })
    }

    /// The program on the controller is told to stop the arm and to end.
    pub fn end(&mut self) {
        self.at_end = Some(self.hindrance());
        let Some(line) = &mut self.line else { return };
        let end = Instant::now() + Duration::from_millis(200);
        while Instant::now() < end {
            let Ok(Some(package)) = line.receive(WAIT) else { break };
            let Some(mut outcome) = self.pilot.cycle(&package, monotonic_now_ns()) else { continue };
            outcome.inputs.permit = END;
            let ours = package.answer.session == self.pilot.machine.token() && package.runtime_state == 2;
            if !ours || line.send(&outcome.inputs).is_err() {
                break;
            }
        }
        self.line = None;
    }

    /// Where the bridge stands.
    #[must_use]
    pub const fn phase(&self) -> Phase {
        self.pilot.machine.phase()
    }

    /// Why the arm does not follow, or stopped last.
    #[must_use]
    pub const fn reason(&self) -> Option<HaltReason> {
        self.pilot.machine.reason()
    }

    /// The controller says that it is a simulator on this machine: nothing real moves.
    #[must_use]
    pub const fn is_simulated(&self) -> bool {
        self.simulated
    }

    /// Share of the full speed that the controller moves at, by its slider and its own limits.
    #[must_use]
    pub const fn speed(&self) -> f64 {
        self.speed
    }

    /// The arm cannot follow this bridge any more: it has to be started again, when it is agreed to.
    #[must_use]
    pub fn is_over(&self) -> bool {
        self.pilot.machine.is_final()
    }

    /// How near to the paper the model's tip may come \[m\]; `None`: as near as the settings say.
    #[must_use]
    pub fn floor_m(&self) -> Option<f64> {
        self.pilot.floor.as_ref().map(|floor| floor.height_m)
    }

    /// A reason that was not reported yet, with what the system said about it.
    pub fn news(&mut self) -> Option<(HaltReason, Option<String>)> {
        let reason = self.reason().filter(|reason| Some(*reason) != self.reported);
        self.reported = self.reason();
        reason.map(|reason| (reason, self.detail.take()))
    }

    /// The run so far.
    #[must_use]
    pub fn report(&self) -> LinkReport {
        let Counts { states, skipped, commands, jumps, following } = self.pilot.counts;
        let trips = &self.pilot.trips;
        LinkReport {
            rate_hz: 1.0 / self.program.cycle_s,
            states,
            states_skipped: skipped,
            connections: self.connections,
            commands,
            jumps,
            following_cycles: following,
            late_cycles: trips.late(),
            lost_counters: trips.lost(),
            round_trip_ms: trips.usual() as f64 * self.program.cycle_s * 1e3,
            round_trips: trips.counts().to_vec(),
            stops: self.reasons.clone(),
            reason: self.at_end.unwrap_or_else(|| self.hindrance()),
        }
    }

    /// Why the arm does not follow now.
    #[must_use]
    pub fn hindrance(&self) -> Option<HaltReason> {
        self.reason().filter(|_| !self.pilot.machine.may_move())
    }

    fn connect(&mut self) {
        let now = Instant::now();
        if now < self.next_attempt {
            std::thread::sleep(self.next_attempt.duration_since(now).min(WAIT));
            return;
        }
        self.next_attempt = now + AGAIN;
        let rate_hz = 1.0 / self.program.cycle_s;
        match RtdeLine::connect(self.addresses.rtde, &self.program.registers, rate_hz, PATIENCE) {
            Ok(line) => match (self.inspect)(&self.addresses) {
                Ok(floor) => {
                    self.line = Some(line);
                    self.simulated = is_simulated(&self.addresses);
                    self.connections += 1;
                    (self.heard, self.silent_turns, self.detail) = (Instant::now(), 0, None);
                    self.pilot.floor = floor;
                    self.pilot.connected();
                }
                Err((reason, words)) => {
                    self.lose(reason, Some(words));
                    self.next_attempt = Instant::now() + LOOK_AGAIN;
                }
            },
            Err(error) => self.lose(line::reason(&error), Some(error.to_string())),
        }
    }

    fn lose(&mut self, reason: HaltReason, detail: Option<String>) {
        (self.line, self.simulated) = (None, false);
        self.upload = None;
        self.next_attempt = Instant::now() + AGAIN;
        self.pilot.machine.disconnected(reason);
        self.detail = detail;
        self.note();
    }

    fn send_program(&mut self, token: i32) {
        match Upload::begin(self.addresses.primary, self.program.text(token), PATIENCE) {
            Ok(upload) => self.upload = Some(upload),
            // The machine notices that nothing runs; this tells why.
            Err(error) => self.detail = Some(format!("no thread to send the program: {error}")),
        }
    }

    /// What the controller says about the program; without a wait.
    fn hear(&mut self) {
        for _ in 0..HEARD_AT_ONCE {
            match self.upload.as_mut().and_then(Upload::heard) {
                Some(UploadEvent::Exception(words)) => {
                    self.detail = Some(words);
                    self.pilot.machine.program_failed();
                }
                Some(UploadEvent::Warning(words) | UploadEvent::Lost(words)) => self.detail = Some(words),
                None => return,
            }
        }
    }

    /// Counts a stop once, when its reason appears.
    fn note(&mut self) {
        let reason = self.reason();
        if let Some(reason) = reason.filter(|reason| self.counted != Some(*reason)) {
            *self.reasons.entry(reason.text()).or_insert(0) += 1;
        }
        self.counted = reason;
    }
}
