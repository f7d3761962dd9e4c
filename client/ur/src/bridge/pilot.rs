//! One cycle of the bridge: a state of the controller and the newest commands in, a joint state and registers
//! out.
//!
//! Contract: neither sockets nor shared memory nor a clock; arrival times are arguments. Every state gives
//! one joint state for the daemon and one set of inputs for the controller, so that the counter goes on
//! whatever happens.

use foretrace_client::wire::{ArmLine, EffortUnit, command_flags};
use foretrace_client::{JOINTS, JointCommand, JointState, RobotMode, SafetyMode};
use foretrace_config::Config;
use foretrace_control::arm::{Chain, JointLimits};
use nalgebra::Vector3;

use super::check::CALIBRATED_MM;
use super::clock::{ClockMap, Mapped};
use super::kinematics::Deviation;
use super::reaction::{Act, BridgeMachine, Observation, Wanted};
use super::reason::HaltReason;
use super::registers::{Numbers, ProgramAnswer, RegisterInputs, Tokens};
use super::target::{Target, TargetTracker};
use super::trip::Trips;

/// One state of the controller, as RTDE brings it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Package {
    /// Of the controller's clock \[s\].
    pub timestamp: f64,
    /// `actual_q` \[rad\].
    pub q: [f64; JOINTS],
    /// `actual_qd` \[rad/s\].
    pub qd: [f64; JOINTS],
    /// `actual_current` \[A\].
    pub current: [f64; JOINTS],
    /// `robot_mode`.
    pub robot_mode: i32,
    /// `safety_mode`.
    pub safety_mode: i32,
    /// `runtime_state`.
    pub runtime_state: u32,
    /// `speed_scaling`.
    pub speed_scaling: f64,
    /// `target_speed_fraction`.
    pub target_speed_fraction: f64,
    /// What our program writes.
    pub answer: ProgramAnswer,
}

/// Below which height the pen is not lowered.
#[derive(Debug, Clone, PartialEq)]
pub struct Floor {
    /// The arm as the settings believe it, to the tip of the pen.
    pub chain: Chain<JOINTS>,
    /// A point of the paper in the base frame \[m\].
    pub origin: Vector3<f64>,
    /// The paper's normal, of length 1.
    pub normal: Vector3<f64>,
    /// Least height of the tip above the paper \[m\].
    pub height_m: f64,
}

impl Floor {
    /// For an arm whose tip is `deviation` from where the model of `config` believes it; `None` where that is
    /// near enough. The tip may be lower than it is believed to be by as much as the deviation.
    #[must_use]
    pub fn of(config: &Config, deviation: Option<Deviation>) -> Option<Self> {
        let off_mm = deviation.map_or(0.0, |deviation| deviation.most_mm);
        if deviation.is_some() && off_mm <= CALIBRATED_MM {
            return None;
        }
        let (settings, robot) = (config.settings(), config.robot());
        Some(Self {
            chain: robot.chain.clone(),
            origin: settings.plane.origin_m.into(),
            normal: settings.plane.rotation().matrix().column(2).into(),
            height_m: settings.robot.ur.uncalibrated_height_m + off_mm * 1e-3,
        })
    }
}

/// What a cycle gives.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CycleResult {
    /// When the state was measured, on this host's clock \[ns\].
    pub stamp_ns: u64,
    pub state: JointState,
    pub inputs: RegisterInputs,
    /// The program has to be sent, with this token.
    pub upload: Option<i32>,
    /// The controller's clock began again.
    pub restarted: bool,
}

/// Counts of a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Counts {
    /// States of the controller.
    pub states: u64,
    /// States that the controller skipped or the line lost, by its timestamps.
    pub skipped: u64,
    pub commands: u64,
    /// Commands refused because they were too far away.
    pub jumps: u64,
    /// Cycles in which the arm was told to follow.
    pub following: u64,
}

/// Everything that lasts from cycle to cycle.
#[derive(Debug)]
pub struct Pilot {
    cycle_s: f64,
    clock: ClockMap,
    pub trips: Trips,
    /// What the bridge does about what it sees.
    pub machine: BridgeMachine,
    targets: TargetTracker,
    counters: Numbers,
    /// Where the pen has to stay above; `None` for an arm that is calibrated.
    pub floor: Option<Floor>,
    watchdog_s: f64,
    last_timestamp: Option<f64>,
    taken_ns: u64,
    begins: bool,
    pub counts: Counts,
}

/// Share of the watchdog's time without a fresh counter after which it may be why a program ended.
const STARVED: f64 = 0.5;

impl Pilot {
    /// For a controller that cycles every `cycle_s` and ends the program when inputs stay away for
    /// `watchdog_s`. `seed` should be drawn at random: tokens of programs come from it.
    #[must_use]
    pub fn new(
        limits: JointLimits<JOINTS>,
        cycle_s: f64,
        watchdog_s: f64,
        floor: Option<Floor>,
        seed: u64,
    ) -> Self {
        Self {
            cycle_s,
            clock: ClockMap::default(),
            trips: Trips::new(cycle_s, 1),
            machine: BridgeMachine::new(Tokens::from_seed(seed), Numbers::from_seed(seed)),
            targets: TargetTracker::new(limits, cycle_s),
            counters: Numbers::from_seed(seed >> 7),
            floor,
            watchdog_s,
            last_timestamp: None,
            taken_ns: 0,
            begins: false,
            counts: Counts::default(),
        }
    }

    pub fn connected(&mut self) {
        self.clock.reconnected();
        self.trips.restart();
        self.machine.connected(false);
    }

    /// Whether the daemon runs with the settings of this bridge; `None` while that is not known.
    pub fn settings_agree(&mut self, agreed: Option<bool>) {
        self.machine.settings_agree(agreed);
    }

    /// A command that was received at `now_ns`.
    pub fn take(&mut self, command: &JointCommand, now_ns: u64) {
        self.counts.commands += 1;
        self.taken_ns = now_ns;
        self.begins |= command.flags & command_flags::BEGINS != 0;
        self.targets.take(command);
    }

    /// A state that arrived at `arrival_ns`; `None` where its timestamp says nothing new.
    pub fn cycle(&mut self, package: &Package, arrival_ns: u64) -> Option<CycleResult> {
        let (stamp_ns, restarted) = match self.clock.observe(package.timestamp, arrival_ns) {
            Mapped::At(stamp) => (stamp, false),
            Mapped::Restarted(stamp) => (stamp, true),
            Mapped::Unusable => return None,
        };
        if restarted {
            self.trips.restart();
            self.machine.connected(true);
            self.last_timestamp = None;
        }
        self.count(package.timestamp);
        self.trips.answered(&package.answer, package.timestamp);
        let use_ns = stamp_ns.saturating_add((self.trips.usual() as f64 * self.cycle_s * 1e9) as u64);

        let following = matches!(self.machine.phase(), super::reaction::Phase::Following { .. });
        let begins = std::mem::take(&mut self.begins);
        if begins && !following {
            self.targets.begin(use_ns, package.q);
        }
        let target = if following || begins { self.targets.at(use_ns) } else { Target::None };
        let wanted = Wanted {
            // Alive now is what counts; a command that ends before it is used only brakes from there on.
            commanding: self.targets.commanding(arrival_ns),
            begins,
            refused: self.refused(&target, following),
        };
        let act = self.machine.step(package.timestamp, &self.seen(package), wanted);
        if following && wanted.refused == Some(HaltReason::TargetJump) {
            self.counts.jumps += 1;
        }
        let inputs = self.inputs(act, &target, package);
        let upload = (act == Act::Upload).then(|| self.machine.token());
        Some(CycleResult { stamp_ns, state: self.state(package), inputs, upload, restarted })
    }

    fn count(&mut self, timestamp: f64) {
        self.counts.states += 1;
        if let Some(last) = self.last_timestamp.replace(timestamp) {
            let cycles = ((timestamp - last) / self.cycle_s).round();
            if cycles > 1.0 {
                self.counts.skipped = self.counts.skipped.saturating_add(cycles as u64 - 1);
            }
        }
    }

    fn refused(&self, target: &Target, following: bool) -> Option<HaltReason> {
        let motion = match target {
            // A command that is not a number is as bad as one far away.
            Target::None => return following.then_some(HaltReason::TargetJump),
            Target::Jump { .. } => return Some(HaltReason::TargetJump),
            Target::Follow(motion) | Target::Brake(motion) => motion,
        };
        let floor = self.floor.as_ref().filter(|_| following)?;
        let at = floor.chain.forward(&motion.q);
        let height = floor.normal.dot(&(at.position - floor.origin));
        // Down only: an arm that stands too low may leave.
        let sinks = floor.normal.dot(&at.twist(&motion.qd).fixed_rows::<3>(0).into_owned()) < 0.0;
        (!(height >= floor.height_m) && sinks).then_some(HaltReason::Uncalibrated)
    }

    fn seen(&self, package: &Package) -> Observation {
        let silence_s = self.trips.silence_s(package.timestamp);
        Observation {
            robot_mode: package.robot_mode,
            safety_mode: package.safety_mode,
            runtime_state: package.runtime_state,
            speed: package.speed_scaling * package.target_speed_fraction,
            answer: package.answer,
            echoed: self.trips.is_echoed(),
            silence_s,
            starved: silence_s > STARVED * self.watchdog_s,
        }
    }

    fn inputs(&mut self, act: Act, target: &Target, package: &Package) -> RegisterInputs {
        let counter = self.counters.next_number();
        self.trips.sent(counter, package.timestamp);
        let (q, qd) = match (act, target) {
            (Act::Follow(_), Target::Follow(motion) | Target::Brake(motion)) => {
                self.counts.following += 1;
                (motion.q, motion.qd)
            }
            _ => (package.q, [0.0; JOINTS]),
        };
        RegisterInputs { counter, permit: act.permit(), q, qd }
    }

    /// What the daemon hears. Running means that the arm follows: while it does not, the arm counts as idle,
    /// and the daemon stops and has to be armed again.
    fn state(&self, package: &Package) -> JointState {
        let running = package.robot_mode == 7;
        let robot_mode = match u32::try_from(package.robot_mode.saturating_add(1)) {
            Ok(_) if running && !self.machine.may_move() => RobotMode::Idle,
            // The daemon's 0 is "not reported", which simple arms move with; a UR's -1 is no arm at all.
            Ok(0) => RobotMode::Disconnected,
            Ok(mode) => RobotMode::try_from(mode).unwrap_or(RobotMode::Disconnected),
            Err(_) => RobotMode::Disconnected,
        };
        let safety_mode = u32::try_from(package.safety_mode)
            .ok()
            .and_then(|mode| SafetyMode::try_from(mode).ok())
            .filter(|mode| *mode != SafetyMode::Unknown)
            .unwrap_or(SafetyMode::Undefined);
        let mut state = JointState {
            robot_stamp_ns: (package.timestamp * 1e9) as u64,
            commands_received: self.counts.commands,
            commands_refused: self.counts.jumps,
            q: package.q,
            qd: package.qd,
            effort: package.current,
            effort_unit: EffortUnit::Amperes.into(),
            safety_mode: safety_mode.into(),
            robot_mode: robot_mode.into(),
            line: ArmLine {
                round_trip_ns: self.trips.usual_ns(),
                late_cycles: self.trips.late(),
                lost_commands: self.trips.lost(),
                ..ArmLine::default()
            },
            ..JointState::default()
        };
        if let Some(command) = self.targets.newest() {
            state.echo(command, self.taken_ns);
        }
        state
    }
}

#[cfg(test)]
mod tests;
