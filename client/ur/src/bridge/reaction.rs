//! What the bridge does about what it sees: a state machine without clock or sockets.
//!
//! Contract: the arm follows in one phase only, and the way into it always leads through a command that
//! begins at rest (somebody armed). Whatever stands in the way takes the permit back at once; when it is gone
//! the bridge gets ready again where [`HaltReason::returns`] allows it, and waits. It never starts a program
//! over one of somebody else's and never ends a safety stop.

use super::reason::{HaltReason, Return};
use super::registers::{NO_PERMIT, Numbers, ProgramAnswer, ProgramState, Tokens};

/// What one state of the controller shows, read together.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Observation {
    /// `robot_mode`: 7 runs (RTDE guide).
    pub robot_mode: i32,
    /// `safety_mode`: 1 normal, 2 reduced (RTDE guide).
    pub safety_mode: i32,
    /// `runtime_state`: 1 stopped, 2 playing (RTDE guide).
    pub runtime_state: u32,
    /// `speed_scaling` times `target_speed_fraction`, 0 to 1.
    pub speed: f64,
    /// What the program writes.
    pub answer: ProgramAnswer,
    /// A program has echoed counters of this connection.
    pub echoed: bool,
    /// Since a program last read something new, or since the connection began \[s\].
    pub silence_s: f64,
    /// The program has gone without a fresh counter for so long that the watchdog may have struck.
    pub starved: bool,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Wanted {
    /// The newest command is enabled and still valid.
    pub commanding: bool,
    /// Since the last state a command came that begins at rest.
    pub begins: bool,
    /// The bridge had to refuse the newest command, and why.
    pub refused: Option<HaltReason>,
}

/// What is to be done in this cycle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Act {
    /// Send counters without a permit.
    Wait,
    /// Send the program to the controller, and counters without a permit.
    Upload,
    /// Tell a program of an earlier bridge to end.
    EndEarlier,
    /// Send targets with this permit.
    Follow(i32),
}

/// Where the bridge stands.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Phase {
    Away,
    /// Connected; something stands in the way, or stood there and the daemon has not stopped yet.
    Blocked {
        /// When it was last there, on the controller's clock \[s\].
        last_s: f64,
    },
    /// The program is on its way.
    Starting {
        /// Since when \[s\].
        since_s: f64,
    },
    /// The program runs and waits for a permit.
    Ready,
    Following {
        /// When commands last asked for motion \[s\].
        commanded_s: f64,
        /// When the permit was given \[s\].
        since_s: f64,
    },
}

/// Reacts to what the controller shows and foretrace wants.
#[derive(Debug, Clone)]
pub struct BridgeMachine {
    tokens: Tokens,
    /// Of the program sent last; 0: none yet.
    token: i32,
    permits: Numbers,
    phase: Phase,
    reason: Option<HaltReason>,
    /// In local control nothing is accepted; `None` where the version does not tell.
    remote: Option<bool>,
    /// The daemon runs with our settings; `None`: not known yet of this daemon.
    agreed: Option<bool>,
    /// Not to be tried again before this instant \[s\].
    next_upload_s: f64,
    /// Our program has been seen to run, in whatever phase.
    alive: bool,
    /// Since when a program runs without a pause \[s\].
    playing_s: Option<f64>,
    /// It ended, and nothing says why yet.
    end: Option<ProgramEnd>,
    /// The controller told an error of the program since the last state.
    error_news: bool,
    /// When it told the newest one \[s\].
    error_s: Option<f64>,
}

/// An end of our program.
#[derive(Debug, Clone, Copy)]
struct ProgramEnd {
    /// When \[s\].
    at_s: f64,
    /// Counters had stayed away before.
    starved: bool,
}

/// Below this a speed is scaled.
const FULL_SPEED: f64 = 0.99;
/// Longest time between the end of a program and what explains it, a safety stop or an error \[s\].
const EXPLAINED_S: f64 = 0.5;
/// Longest time for a program to begin \[s\].
const BEGIN_S: f64 = 5.0;
/// How long the speed may take to come up when it begins \[s\].
const SPEEDS_UP_S: f64 = 1.0;
/// Before it is sent again \[s\].
const AGAIN_S: f64 = 10.0;
/// A program that reads nothing new for so long does not answer \[s\].
const SILENT_S: f64 = 0.5;
/// Ours would have been ended by the watchdog after so long without an echo, so that another one runs \[s\].
const REPLACED_S: f64 = 2.0;
/// How long a latch is shown at least, so that the daemon has seen it \[s\].
const SHOWN_S: f64 = 0.3;
/// How long the permit outlives the commands \[s\].
const IDLE_S: f64 = 1.0;
/// How long a program may take to obey a permit \[s\].
const OBEYS_S: f64 = 0.25;

impl BridgeMachine {
    /// A bridge that has not connected yet; each program that it sends carries the next of `tokens`.
    #[must_use]
    pub const fn new(tokens: Tokens, permits: Numbers) -> Self {
        Self {
            tokens,
            token: 0,
            permits,
            phase: Phase::Away,
            reason: None,
            remote: None,
            agreed: None,
            next_upload_s: f64::NEG_INFINITY,
            alive: false,
            playing_s: None,
            end: None,
            error_news: false,
            error_s: None,
        }
    }

    /// Token of the program sent last; 0 before the first.
    #[must_use]
    pub const fn token(&self) -> i32 {
        self.token
    }

    /// Where the bridge stands.
    #[must_use]
    pub const fn phase(&self) -> Phase {
        self.phase
    }

    /// Why the arm does not follow, or why it stopped last until it was armed again.
    #[must_use]
    pub const fn reason(&self) -> Option<HaltReason> {
        self.reason
    }

    /// Whether the arm follows, or would when armed: what the daemon gets.
    #[must_use]
    pub const fn may_move(&self) -> bool {
        matches!(self.phase, Phase::Ready | Phase::Following { .. })
    }

    /// The connection could not be made, or was lost.
    pub fn disconnected(&mut self, reason: HaltReason) {
        if !self.is_final() {
            self.reason = Some(reason);
        }
        self.phase = Phase::Away;
    }

    /// The connection stands. `restarted`: the controller's clock began again since the last one.
    pub fn connected(&mut self, restarted: bool) {
        if restarted && !self.is_final() {
            self.reason = Some(HaltReason::Restarted);
        }
        self.phase = Phase::Blocked { last_s: f64::NEG_INFINITY };
        self.next_upload_s = f64::NEG_INFINITY;
        // What ended while nobody looked starved, or was stopped by somebody who has to arm anyway.
        self.alive = false;
        self.playing_s = None;
        if restarted {
            (self.end, self.error_s) = (None, None);
        }
    }

    /// The controller told an error of the program; if the program ends about now, that is why.
    pub fn program_failed(&mut self) {
        self.error_news = true;
    }

    /// What the dashboard says about remote control.
    pub fn remote_control(&mut self, remote: Option<bool>) {
        self.remote = remote;
    }

    /// Whether the daemon runs with the settings of this bridge; `None` while that is not known, and nothing
    /// moves then.
    pub fn settings_agree(&mut self, agreed: Option<bool>) {
        self.agreed = agreed;
    }

    /// One state of the controller at `now_s` of its clock, and what foretrace wants.
    pub fn step(&mut self, now_s: f64, seen: &Observation, wanted: Wanted) -> Act {
        if let Some(reason) = self.ended(now_s, seen) {
            return self.block(reason, now_s);
        }
        if let Some(reason) = self.hindrance(seen, wanted) {
            return self.block(reason, now_s);
        }
        let fresh = seen.echoed && seen.silence_s <= SILENT_S;
        let named = self.is_named(seen);
        match self.phase {
            Phase::Away => Act::Wait,
            Phase::Blocked { last_s } => {
                let waits = self.end.is_some() || self.agreed.is_none() || wanted.commanding;
                if self.is_final() || waits || now_s - last_s < SHOWN_S {
                    return Act::Wait;
                }
                self.get_ready(now_s, seen, named, fresh)
            }
            Phase::Starting { .. } | Phase::Ready | Phase::Following { .. }
                if self.end.is_some() || self.agreed.is_none() =>
            {
                self.phase = Phase::Blocked { last_s: now_s };
                Act::Wait
            }
            Phase::Starting { since_s } => {
                // Some versions scale the speed up from 0 when a program begins.
                let settled = seen.speed >= FULL_SPEED || now_s - since_s > SPEEDS_UP_S;
                if named && fresh && settled && seen.answer.program() == ProgramState::Waiting {
                    self.phase = Phase::Ready;
                } else if now_s - since_s > BEGIN_S {
                    self.next_upload_s = now_s + AGAIN_S;
                    return self.block(HaltReason::DidNotStart, now_s);
                }
                Act::Wait
            }
            Phase::Ready => {
                if !fresh {
                    let reason = if self.alive { HaltReason::NoAnswer } else { HaltReason::ForeignProgram };
                    return self.block(reason, now_s);
                }
                if !(wanted.begins && wanted.commanding) {
                    return Act::Wait;
                }
                (self.reason, self.error_s) = (None, None);
                self.phase = Phase::Following { commanded_s: now_s, since_s: now_s };
                Act::Follow(self.permits.next_number())
            }
            Phase::Following { commanded_s, since_s } => {
                self.follow(now_s, seen, wanted, commanded_s, since_s)
            }
        }
    }

    /// A program runs, and the registers carry our token: registers that an ended program left behind do too.
    fn is_named(&self, seen: &Observation) -> bool {
        seen.runtime_state == RUNTIME_PLAYING && self.token != 0 && seen.answer.session == self.token
    }

    /// Whether our program has ended, whatever the phase, and why, once that is known. A safety stop and an
    /// arm without power explain themselves.
    fn ended(&mut self, now_s: f64, seen: &Observation) -> Option<HaltReason> {
        if std::mem::take(&mut self.error_news) {
            self.error_s = Some(now_s);
        }
        let runs = (RUNTIME_PLAYING..=RUNTIME_RESUMING).contains(&seen.runtime_state);
        if runs && self.token != 0 && seen.answer.session == self.token {
            self.alive = true;
        } else if std::mem::take(&mut self.alive) {
            self.end = Some(ProgramEnd { at_s: now_s, starved: seen.starved });
        }
        // A program runs, and it is not ours, which the controller would have ended by now.
        let playing = seen.runtime_state == RUNTIME_PLAYING;
        let since_s = *self.playing_s.get_or_insert(now_s);
        if !playing {
            self.playing_s = None;
        } else if self.alive && seen.silence_s.min(now_s - since_s) > REPLACED_S {
            self.alive = false;
            return Some(HaltReason::Replaced);
        }
        let end = self.end?;
        if !matches!(seen.safety_mode, 1 | 2) || seen.robot_mode != 7 {
            self.end = None;
            return None;
        }
        if now_s - end.at_s < EXPLAINED_S {
            return None;
        }
        self.end = None;
        if self.error_s.is_some_and(|error_s| (error_s - end.at_s).abs() <= EXPLAINED_S) {
            return Some(HaltReason::ProgramFailed);
        }
        // Ours does not start again by itself.
        if seen.runtime_state == RUNTIME_PLAYING {
            return Some(HaltReason::Replaced);
        }
        if !end.starved {
            return Some(HaltReason::StoppedByOperator);
        }
        // What kept the counters away may be reported already.
        let reported = matches!(self.reason, Some(HaltReason::CountersLate | HaltReason::NoAnswer));
        (!reported).then_some(HaltReason::StoppedByWatchdog)
    }

    /// Why the arm must not move, by what is seen in this state alone; the gravest first.
    fn hindrance(&self, seen: &Observation, wanted: Wanted) -> Option<HaltReason> {
        match seen.safety_mode {
            1 | 2 => {}
            3 => return Some(HaltReason::ProtectiveStop),
            4 => return Some(HaltReason::Recovery),
            5 => return Some(HaltReason::SafeguardStop),
            6 | 7 => return Some(HaltReason::EmergencyStop),
            _ => return Some(HaltReason::SafetyFault),
        }
        match seen.robot_mode {
            7 => {}
            6 => return Some(HaltReason::Backdrive),
            -1..=2 | 8 => return Some(HaltReason::Booting),
            _ => return Some(HaltReason::NotRunning),
        }
        if self.agreed == Some(false) {
            return Some(HaltReason::OtherSettings);
        }
        if (RUNTIME_PAUSING..=RUNTIME_RESUMING).contains(&seen.runtime_state) {
            return Some(HaltReason::Paused);
        }
        let ours = self.token != 0 && seen.answer.session == self.token;
        let begins = matches!(self.phase, Phase::Starting { .. });
        if ours && !begins && seen.runtime_state == RUNTIME_PLAYING && !(seen.speed >= FULL_SPEED) {
            return Some(HaltReason::Slowed);
        }
        if matches!(self.phase, Phase::Following { .. }) {
            let stopped_by_itself = seen.answer.used == self.permits.newest();
            match seen.answer.program() {
                ProgramState::StoppedLate if ours && stopped_by_itself => {
                    return Some(HaltReason::CountersLate);
                }
                ProgramState::StoppedJump if ours && stopped_by_itself => {
                    return Some(HaltReason::TargetJump);
                }
                _ => {}
            }
        }
        // After its own stop the program is where it is, and every target is far away.
        if wanted.refused.is_some() {
            return wanted.refused;
        }
        // Where our program runs nothing needs remote control any more; what has to be sent does.
        (self.remote == Some(false) && !(ours && seen.runtime_state == RUNTIME_PLAYING))
            .then_some(HaltReason::LocalControl)
    }

    fn block(&mut self, reason: HaltReason, now_s: f64) -> Act {
        if !self.is_final() {
            self.reason = Some(reason);
        }
        self.phase = Phase::Blocked { last_s: now_s };
        Act::Wait
    }

    /// Nothing stands in the way: is there a program, and whose?
    fn get_ready(&mut self, now_s: f64, seen: &Observation, named: bool, fresh: bool) -> Act {
        if seen.runtime_state == RUNTIME_PLAYING {
            return match (fresh, named) {
                // Stopped by itself or waiting: it takes the next permit either way.
                (true, true) => {
                    self.phase = Phase::Ready;
                    Act::Wait
                }
                (true, false) => Act::EndEarlier,
                // After a connection was made, a program needs a moment to echo.
                (false, _) if seen.silence_s <= SILENT_S => Act::Wait,
                (false, _) if self.alive => self.block(HaltReason::NoAnswer, now_s),
                (false, _) => self.block(HaltReason::ForeignProgram, now_s),
            };
        }
        if seen.runtime_state != RUNTIME_STOPPED || now_s < self.next_upload_s {
            return Act::Wait;
        }
        self.phase = Phase::Starting { since_s: now_s };
        self.token = self.tokens.next_token();
        self.error_s = None;
        Act::Upload
    }

    fn follow(
        &mut self,
        now_s: f64,
        seen: &Observation,
        wanted: Wanted,
        commanded_s: f64,
        since_s: f64,
    ) -> Act {
        let permit = self.permits.newest();
        let obeys = seen.answer.used == permit && seen.answer.program() == ProgramState::Following;
        let waited = now_s - since_s > OBEYS_S;
        if (waited && !obeys) || seen.silence_s > SILENT_S {
            return self.block(HaltReason::NoAnswer, now_s);
        }
        let commanded_s = if wanted.commanding { now_s } else { commanded_s };
        if now_s - commanded_s > IDLE_S {
            self.phase = Phase::Ready;
            return Act::Wait;
        }
        self.phase = Phase::Following { commanded_s, since_s };
        Act::Follow(permit)
    }

    /// Whoever runs the bridge has to start it again.
    #[must_use]
    pub fn is_final(&self) -> bool {
        self.reason.is_some_and(|reason| reason.returns() == Return::NewBridge)
    }
}

impl Act {
    /// The permit that goes with it.
    #[must_use]
    pub const fn permit(self) -> i32 {
        match self {
            Self::Wait | Self::Upload => NO_PERMIT,
            Self::EndEarlier => super::registers::END,
            Self::Follow(permit) => permit,
        }
    }
}

const RUNTIME_STOPPED: u32 = 1;
const RUNTIME_PLAYING: u32 = 2;
const RUNTIME_PAUSING: u32 = 3;
const RUNTIME_RESUMING: u32 = 5;

#[cfg(test)]
mod tests;
