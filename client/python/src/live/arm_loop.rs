//! The loop of an arm: commands in, targets and joint states out, at the arm's own rate, without the
//! interpreter.
//!
//! Contract: a target is what the daemon assumes that the arm does: the command at this instant, and braking
//! at `deceleration` once it is over. States are sent for measurements only, with their stamps. Targets that
//! nobody reads are not made up for: the arm is told to stand until somebody arms again. A target counts as
//! read at its own instant, however late: a process that stood still obeys what was meant before.

use std::sync::mpsc::{Receiver, RecvTimeoutError};
use std::sync::{Arc, Condvar, Mutex};
use std::time::{Duration, Instant};

use foretrace_client::wire::command_flags;
use foretrace_client::{
    Commands, DaemonChange, Demand, Foretrace, JOINTS, JointCommand, JointState, JointStates, Lasting,
    ServiceError, demand_at, monotonic_now_ns,
};
use foretrace_control::arm::limits::JointMotion;
use foretrace_control::guard::{Commanded, consumer_state};
use foretrace_control::units::Stamp;

use super::worker::locked;

/// Slower than this a joint stands \[rad/s\].
const STANDING_RADPS: f64 = 1e-9;

/// Why the target is what it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum TargetState {
    /// The arm must stand: no command, or it has braked.
    #[default]
    Stand,
    /// A valid command is followed.
    Follow,
    /// Commands ended: the joints brake.
    Brake,
    /// Nobody read targets for too long: the arm must stand until it is armed again.
    Paused,
}

impl TargetState {
    pub const fn label(self) -> &'static str {
        match self {
            Self::Stand => "stand",
            Self::Follow => "follow",
            Self::Brake => "brake",
            Self::Paused => "paused",
        }
    }

    /// Whether positions must go to the arm.
    pub const fn moves(self) -> bool {
        matches!(self, Self::Follow | Self::Brake)
    }
}

/// What the arm is to do at an instant.
#[derive(Debug, Clone, Copy, Default)]
pub struct ArmTarget {
    pub state: TargetState,
    /// Positions \[rad\] and velocities \[rad/s\]; none before the first command.
    pub motion: Option<([f64; JOINTS], [f64; JOINTS])>,
    /// The instant \[ns\].
    pub at_ns: u64,
    /// The command behind it.
    pub command: Option<JointCommand>,
}

/// What callers and loop share.
#[derive(Debug, Default)]
pub struct ArmDesk {
    pub target: ArmTarget,
    /// Number of the cycle that made it.
    pub cycle: u64,
    /// The newest cycle that was read, and its instant.
    pub read_cycle: u64,
    pub read_ns: u64,
    /// The newest motion that was read.
    read_motion: Option<[f64; JOINTS]>,
    /// The newest command whose target was read, and when it was.
    obeyed: Option<(JointCommand, u64)>,
    pub counts: ArmCounts,
    /// Why the newest state was not sent, or the newest attempt to open the services failed.
    pub trouble: Option<String>,
    pub over: bool,
}

/// Totals since the start.
#[derive(Debug, Default, Clone, Copy)]
pub struct ArmCounts {
    pub cycles: u64,
    /// Whole cycles that the loop itself came too late for.
    pub cycles_skipped: u64,
    pub states_sent: u64,
    /// Sent while no daemon was there.
    pub states_unheard: u64,
    pub states_not_sent: u64,
    pub commands_received: u64,
    pub commands_lost: u64,
    pub commands_refused: u64,
    pub pauses: u64,
}

pub type SharedDesk = Arc<(Mutex<ArmDesk>, Condvar)>;

impl ArmDesk {
    /// The target, as its reader obeys it from now on.
    pub fn read(&mut self) -> ArmTarget {
        (self.read_cycle, self.read_ns) = (self.cycle, self.target.at_ns);
        if self.target.state.moves() {
            self.read_motion = self.target.motion.map(|(q, _)| q);
        }
        if self.target.state == TargetState::Follow {
            self.obeyed = self.target.command.map(|command| (command, monotonic_now_ns()));
        }
        self.target
    }
}

/// What callers hand to the loop.
pub enum ArmNews {
    /// A state, and when it was measured \[ns\].
    Measured(Box<JointState>, u64),
    /// Why the arm does not follow, and what to do; none: nothing keeps it any more.
    Note(Option<(String, String)>),
}

#[derive(Debug, Clone, Copy)]
pub struct ArmPace {
    pub period: Duration,
    pub deceleration: [f64; JOINTS],
    /// Targets unread for longer are a pause \[ns\].
    pub pause_ns: u64,
}

type LivePorts = (Commands, JointStates);

pub struct ArmLoop {
    ports: Lasting<LivePorts>,
    pace: ArmPace,
    desk: SharedDesk,
    newest: Option<JointCommand>,
    /// The newest command that let the arm move, and until when it does.
    followed: Option<(JointCommand, u64)>,
    /// Since when the arm has to move without a pause \[ns\].
    moving_ns: Option<u64>,
    /// Where the arm stands in a pause, if that is known.
    paused: Option<Option<[f64; JOINTS]>>,
    /// What the program said.
    said: Option<NoteParts>,
    /// Of the pause; comes before that of the program.
    pause_note: Option<NoteParts>,
}

/// Why the arm does not follow, and what to do about it.
type NoteParts = (String, String);

pub fn open_ports(foretrace: &Foretrace) -> Result<LivePorts, ServiceError> {
    Ok((foretrace.commands(Commands::MAX_BUFFER)?, foretrace.joint_states()?))
}

impl ArmLoop {
    pub fn new(ports: Lasting<LivePorts>, pace: ArmPace, desk: SharedDesk) -> Self {
        Self {
            ports,
            pace,
            desk,
            newest: None,
            followed: None,
            moving_ns: None,
            paused: None,
            said: None,
            pause_note: None,
        }
    }

    /// Runs until nobody can send news any more.
    pub fn run(mut self, news: &Receiver<ArmNews>) {
        let mut next = Instant::now() + self.pace.period;
        loop {
            match news.recv_timeout(next.saturating_duration_since(Instant::now())) {
                Ok(ArmNews::Measured(state, measured_ns)) => self.publish(*state, measured_ns),
                Ok(ArmNews::Note(note)) => {
                    self.said = note;
                    self.tell_note();
                }
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => return,
            }
            let now = Instant::now();
            if now < next {
                continue;
            }
            let late = now.saturating_duration_since(next).as_nanos() / self.pace.period.as_nanos().max(1);
            next += self.pace.period * (late as u32).saturating_add(1);
            self.cycle(late as u64);
        }
    }

    /// After every change, and to every daemon anew.
    fn tell_note(&mut self) {
        if let Some((_, states)) = &mut self.ports.handle {
            match self.pause_note.as_ref().or(self.said.as_ref()) {
                Some((text, to_do)) => states.say(text, to_do),
                None => states.say_nothing(),
            }
        }
    }

    fn publish(&mut self, mut state: JointState, measured_ns: u64) {
        let mut desk = locked(&self.desk.0);
        if let Some((command, read_ns)) = &desk.obeyed {
            state.echo(command, *read_ns);
        }
        state.commands_received = desk.counts.commands_received;
        state.commands_refused = desk.counts.commands_refused;
        let Some((_, states)) = &mut self.ports.handle else {
            desk.counts.states_not_sent += 1;
            return;
        };
        match states.publish(measured_ns, state) {
            Ok(true) => desk.counts.states_sent += 1,
            Ok(false) => desk.counts.states_unheard += 1,
            Err(error) => {
                desk.counts.states_not_sent += 1;
                desk.trouble = Some(error.to_string());
            }
        }
    }

    fn cycle(&mut self, skipped: u64) {
        let begins = self.take_commands();
        let now_ns = monotonic_now_ns();
        if begins && self.paused.take().is_some() {
            self.pause_note = None;
            self.tell_note();
        }
        let mut target = self.evaluate(now_ns);
        let shared = self.desk.clone();
        let (mutex, turn) = &*shared;
        let mut desk = locked(mutex);
        if target.state.moves() {
            let since_ns = *self.moving_ns.get_or_insert(now_ns);
            let unread_ns = now_ns.saturating_sub(desk.read_ns.max(since_ns));
            if unread_ns > self.pace.pause_ns {
                let stands = desk.read_motion;
                desk.counts.pauses += 1;
                self.paused = Some(stands);
                self.pause_note = Some((
                    format!("the Python program read no target for {:.0} ms", unread_ns as f64 * 1e-6),
                    "find what held it up, then arm again".to_owned(),
                ));
                self.tell_note();
                target = self.evaluate(now_ns);
            }
        }
        if !target.state.moves() {
            self.moving_ns = None;
        }
        desk.target = target;
        desk.cycle += 1;
        desk.counts.cycles += 1;
        desk.counts.cycles_skipped += skipped;
        if let Some((commands, _)) = &self.ports.handle {
            desk.counts.commands_received = commands.received();
            desk.counts.commands_lost = commands.dropped();
            desk.counts.commands_refused = commands.rejections().total();
        }
        drop(desk);
        turn.notify_all();
        // A look may attach, which takes milliseconds, and seconds where files are damaged.
        if !target.state.moves() {
            let (change, error) = self.ports.look(open_ports);
            if let Some(error) = error {
                locked(mutex).trouble = Some(error.to_string());
            }
            if change == DaemonChange::Renewed {
                self.tell_note();
            }
        }
    }

    /// Takes all commands; whether a new motion begins among them.
    fn take_commands(&mut self) -> bool {
        let Some((commands, _)) = &mut self.ports.handle else { return false };
        let (newest, followed, mut begins) = (&mut self.newest, &mut self.followed, false);
        commands.drain(|command| {
            begins |= command.flags & command_flags::BEGINS != 0;
            if command.flags & command_flags::ENABLED != 0 {
                *followed = Some((*command, command.valid_until_ns));
            } else if let Some((_, until_ns)) = followed {
                // It takes the leave to move back from now on.
                *until_ns = (*until_ns).min(monotonic_now_ns());
            }
            *newest = Some(*command);
        });
        begins
    }

    fn evaluate(&self, at_ns: u64) -> ArmTarget {
        let still = |state, q: [f64; JOINTS]| ArmTarget {
            state,
            motion: Some((q, [0.0; JOINTS])),
            at_ns,
            command: self.newest,
        };
        if let Some(stands) = self.paused {
            let standing = ArmTarget { state: TargetState::Paused, at_ns, ..ArmTarget::default() };
            return stands.map_or(standing, |q| still(TargetState::Paused, q));
        }
        let Some(newest) = &self.newest else { return ArmTarget { at_ns, ..ArmTarget::default() } };
        if let Demand::Follow { q, qd } = demand_at(newest, at_ns) {
            let motion = Some((q, qd));
            return ArmTarget { state: TargetState::Follow, motion, at_ns, command: self.newest };
        }
        let Some((command, until_ns)) = &self.followed else { return still(TargetState::Stand, newest.q) };
        let motion = JointMotion { q: command.q, qd: command.qd, qdd: [0.0; JOINTS] };
        let Some(commanded) = Commanded::new(Stamp(command.header.stamp_ns), motion) else {
            return still(TargetState::Stand, newest.q);
        };
        let motion = consumer_state(&commanded, Stamp(*until_ns), &self.pace.deceleration, Stamp(at_ns));
        if motion.qd.iter().all(|qd| qd.abs() <= STANDING_RADPS) {
            return still(TargetState::Stand, motion.q);
        }
        ArmTarget {
            state: TargetState::Brake,
            motion: Some((motion.q, motion.qd)),
            at_ns,
            command: self.newest,
        }
    }
}
