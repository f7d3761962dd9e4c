//! What the bridge does about what it sees: a state machine without clock or sockets.
//!
//! Contract: the arm follows in one phase only, and the way into it always leads through a command that
//! begins at rest (somebody armed). Whatever stands in the way takes the leave back at once; when it is gone
//! the bridge gets ready again where [`Reason::returns`] allows it, and waits. It never starts a program over
//! one of somebody else's and never ends a safety stop.

use super::reason::{Reason, Return};
use super::registers::{Answer, NO_LEAVE, Numbers, ProgramState, Tokens};

/// What one state of the controller shows, read together.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Seen {
    /// `robot_mode`: 7 runs (RTDE guide).
    pub robot_mode: i32,
    /// `safety_mode`: 1 normal, 2 reduced (RTDE guide).
    pub safety_mode: i32,
    /// `runtime_state`: 1 stopped, 2 playing (RTDE guide).
    pub runtime_state: u32,
    /// `speed_scaling` times `target_speed_fraction`, 0 to 1.
    pub speed: f64,
    /// What the program writes.
    pub answer: Answer,
    /// A program has echoed counters of this connection.
    pub echoed: bool,
    /// Since a program last read something new, or since the connection began \[s\].
    pub silence_s: f64,
    /// The program has gone without a fresh counter for so long that the watchdog may have struck.
    pub starved: bool,
}

/// What foretrace wants.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Wanted {
    /// The newest command is enabled and still valid.
    pub commanding: bool,
    /// Since the last state a command came that begins at rest.
    pub begins: bool,
    /// The bridge had to refuse the newest command, and why.
    pub refused: Option<Reason>,
}

/// What is to be done in this cycle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Act {
    /// Send counters without a leave.
    Wait,
    /// Send the program to the controller, and counters without a leave.
    Upload,
    /// Tell a program of an earlier bridge to end.
    EndEarlier,
    /// Send targets with this leave.
    Follow(i32),
}

/// Where the bridge stands.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Phase {
    /// No connection.
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
    /// The program runs and waits for a leave.
    Ready,
    /// The program follows.
    Following {
        /// When commands last asked for motion \[s\].
        commanded_s: f64,
        /// When the leave was given \[s\].
        since_s: f64,
    },
}

/// Reacts to what the controller shows and foretrace wants.
#[derive(Debug, Clone)]
pub struct Machine {
    tokens: Tokens,
    /// Of the program sent last; 0: none yet.
    token: i32,
    leaves: Numbers,
    phase: Phase,
    reason: Option<Reason>,
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
    end: Option<End>,
    /// The controller told an error of the program since the last state.
    error_news: bool,
    /// When it told the newest one \[s\].
    error_s: Option<f64>,
}

/// An end of our program.
#[derive(Debug, Clone, Copy)]
struct End {
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
/// How long the leave outlives the commands \[s\].
const IDLE_S: f64 = 1.0;
/// How long a program may take to obey a leave \[s\].
const OBEYS_S: f64 = 0.25;

impl Machine {
    /// A bridge that has not connected yet; each program that it sends carries the next of `tokens`.
    #[must_use]
    pub const fn new(tokens: Tokens, leaves: Numbers) -> Self {
        Self {
            tokens,
            token: 0,
            leaves,
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
    pub const fn reason(&self) -> Option<Reason> {
        self.reason
    }

    /// Whether the arm follows, or would when armed: what the daemon is told.
    #[must_use]
    pub const fn may_move(&self) -> bool {
        matches!(self.phase, Phase::Ready | Phase::Following { .. })
    }

    /// The connection could not be made, or was lost.
    pub fn disconnected(&mut self, reason: Reason) {
        if !self.is_final() {
            self.reason = Some(reason);
        }
        self.phase = Phase::Away;
    }

    /// The connection stands. `restarted`: the controller's clock began anew since the last one.
    pub fn connected(&mut self, restarted: bool) {
        if restarted && !self.is_final() {
            self.reason = Some(Reason::Restarted);
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
    pub fn step(&mut self, now_s: f64, seen: &Seen, wanted: Wanted) -> Act {
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
                    return self.block(Reason::DidNotStart, now_s);
                }
                Act::Wait
            }
            Phase::Ready => {
                if !fresh {
                    let reason = if self.alive { Reason::NoAnswer } else { Reason::ForeignProgram };
                    return self.block(reason, now_s);
                }
                if !(wanted.begins && wanted.commanding) {
                    return Act::Wait;
                }
                (self.reason, self.error_s) = (None, None);
                self.phase = Phase::Following { commanded_s: now_s, since_s: now_s };
                Act::Follow(self.leaves.next_number())
            }
            Phase::Following { commanded_s, since_s } => {
                self.follow(now_s, seen, wanted, commanded_s, since_s)
            }
        }
    }

    /// A program runs, and the registers carry our token: registers that an ended program left behind do too.
    fn is_named(&self, seen: &Seen) -> bool {
        seen.runtime_state == RUNTIME_PLAYING && self.token != 0 && seen.answer.session == self.token
    }

    /// Whether our program has ended, whatever the phase, and why, once that is known. A safety stop and an
    /// arm without power explain themselves.
    fn ended(&mut self, now_s: f64, seen: &Seen) -> Option<Reason> {
        if std::mem::take(&mut self.error_news) {
            self.error_s = Some(now_s);
        }
        let runs = (RUNTIME_PLAYING..=RUNTIME_RESUMING).contains(&seen.runtime_state);
        if runs && self.token != 0 && seen.answer.session == self.token {
            self.alive = true;
        } else if std::mem::take(&mut self.alive) {
            self.end = Some(End { at_s: now_s, starved: seen.starved });
        }
        // A program runs, and it is not ours, which the controller would have ended by now.
        let playing = seen.runtime_state == RUNTIME_PLAYING;
        let since_s = *self.playing_s.get_or_insert(now_s);
        if !playing {
            self.playing_s = None;
        } else if self.alive && seen.silence_s.min(now_s - since_s) > REPLACED_S {
            self.alive = false;
            return Some(Reason::Replaced);
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
            return Some(Reason::ProgramFailed);
        }
        // Ours does not start again by itself.
        if seen.runtime_state == RUNTIME_PLAYING {
            return Some(Reason::Replaced);
        }
        if !end.starved {
            return Some(Reason::StoppedByOperator);
        }
        // What kept the counters away may be told already.
        let told = matches!(self.reason, Some(Reason::CountersLate | Reason::NoAnswer));
        (!told).then_some(Reason::StoppedByWatchdog)
    }

    /// Why the arm must not move, by what is seen in this state alone; the gravest first.
    fn hindrance(&self, seen: &Seen, wanted: Wanted) -> Option<Reason> {
        match seen.safety_mode {
            1 | 2 => {}
            3 => return Some(Reason::ProtectiveStop),
            4 => return Some(Reason::Recovery),
            5 => return Some(Reason::SafeguardStop),
            6 | 7 => return Some(Reason::EmergencyStop),
            _ => return Some(Reason::SafetyFault),
        }
        match seen.robot_mode {
            7 => {}
            6 => return Some(Reason::Backdrive),
            -1..=2 | 8 => return Some(Reason::Booting),
            _ => return Some(Reason::NotRunning),
        }
        if self.agreed == Some(false) {
            return Some(Reason::OtherSettings);
        }
        if (RUNTIME_PAUSING..=RUNTIME_RESUMING).contains(&seen.runtime_state) {
            return Some(Reason::Paused);
        }
        let ours = self.token != 0 && seen.answer.session == self.token;
        let begins = matches!(self.phase, Phase::Starting { .. });
        if ours && !begins && seen.runtime_state == RUNTIME_PLAYING && !(seen.speed >= FULL_SPEED) {
            return Some(Reason::Slowed);
        }
        if matches!(self.phase, Phase::Following { .. }) {
            let stopped_by_itself = seen.answer.used == self.leaves.newest();
            match seen.answer.program() {
                ProgramState::StoppedLate if ours && stopped_by_itself => return Some(Reason::CountersLate),
                ProgramState::StoppedJump if ours && stopped_by_itself => return Some(Reason::TargetJump),
                _ => {}
            }
        }
        // After its own stop the program is where it is, and every target is far away.
        if wanted.refused.is_some() {
            return wanted.refused;
        }
        // Where our program runs nothing needs remote control any more; what has to be sent does.
        (self.remote == Some(false) && !(ours && seen.runtime_state == RUNTIME_PLAYING))
            .then_some(Reason::LocalControl)
    }

    fn block(&mut self, reason: Reason, now_s: f64) -> Act {
        if !self.is_final() {
            self.reason = Some(reason);
        }
        self.phase = Phase::Blocked { last_s: now_s };
        Act::Wait
    }

    /// Nothing stands in the way: is there a program, and whose?
    fn get_ready(&mut self, now_s: f64, seen: &Seen, named: bool, fresh: bool) -> Act {
        if seen.runtime_state == RUNTIME_PLAYING {
            return match (fresh, named) {
                // Stopped by itself or waiting: it takes the next leave either way.
                (true, true) => {
                    self.phase = Phase::Ready;
                    Act::Wait
                }
                (true, false) => Act::EndEarlier,
                // After a connection was made, a program needs a moment to echo.
                (false, _) if seen.silence_s <= SILENT_S => Act::Wait,
                (false, _) if self.alive => self.block(Reason::NoAnswer, now_s),
                (false, _) => self.block(Reason::ForeignProgram, now_s),
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

    fn follow(&mut self, now_s: f64, seen: &Seen, wanted: Wanted, commanded_s: f64, since_s: f64) -> Act {
        let leave = self.leaves.newest();
        let obeys = seen.answer.used == leave && seen.answer.program() == ProgramState::Following;
        let waited = now_s - since_s > OBEYS_S;
        if (waited && !obeys) || seen.silence_s > SILENT_S {
            return self.block(Reason::NoAnswer, now_s);
        }
        let commanded_s = if wanted.commanding { now_s } else { commanded_s };
        if now_s - commanded_s > IDLE_S {
            self.phase = Phase::Ready;
            return Act::Wait;
        }
        self.phase = Phase::Following { commanded_s, since_s };
        Act::Follow(leave)
    }

    /// Whoever runs the bridge has to start it anew.
    #[must_use]
    pub fn is_final(&self) -> bool {
        self.reason.is_some_and(|reason| reason.returns() == Return::NewBridge)
    }
}

impl Act {
    /// The leave that goes with it.
    #[must_use]
    pub const fn leave(self) -> i32 {
        match self {
            Self::Wait | Self::Upload => NO_LEAVE,
            Self::EndEarlier => super::registers::END,
            Self::Follow(leave) => leave,
        }
    }
}

const RUNTIME_STOPPED: u32 = 1;
const RUNTIME_PLAYING: u32 = 2;
const RUNTIME_PAUSING: u32 = 3;
const RUNTIME_RESUMING: u32 = 5;

#[cfg(test)]
mod tests;
