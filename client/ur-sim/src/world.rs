//! The controller's state behind one lock: robot, inputs, registers, program, log. One call is one control
//! cycle.

use std::collections::{BTreeMap, BTreeSet, VecDeque};

use super::arrival::{Arrival, MOST_ARRIVALS};
use super::inputs::InputVariables;
use super::machine::{Away, Hands, MOST_MESSAGES, MovingThread, Registers, Watchdog};
use super::motion::RobotMotion;
use super::options::ControllerOptions;
use super::robot::SimulatedRobot;
use super::safety::{ProtectiveReason, RobotMode};
use super::sockets::{ProgramSockets, SocketOwner};
use super::statements::InterpreterDesk;
use crate::script::{Interpreted, Program, Progress, ScriptError, ScriptRun, Statements, ThreadId};
use foretrace_ur::primary::MessageContent;

/// Longest name of a program that is kept \[characters\].
const LONGEST_NAME: usize = 100;

/// RTDE's `runtime_state`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Runtime {
    Stopped = 1,
    Playing = 2,
    /// On its way to a pause.
    Pausing = 3,
    Paused = 4,
    /// On its way back to full speed.
    Resuming = 5,
}

impl Runtime {
    #[must_use]
    pub const fn number(self) -> u32 {
        self as u32
    }
}

/// A program that runs or is paused.
#[derive(Debug)]
struct Running {
    run: ScriptRun,
    name: String,
}

/// Everything that a controller knows.
#[derive(Debug)]
pub struct World {
    pub robot: SimulatedRobot,
    /// Input variables of RTDE.
    pub inputs: InputVariables,
    pub registers: Registers,
    /// In remote control: scripts and dashboard commands that move the robot are taken.
    pub remote: bool,
    /// Of a CB3's pendant, as the dashboard set it.
    pub user_role: &'static str,
    /// Of an e-Series, as the dashboard set it.
    pub operational_mode: &'static str,
    /// Messages that wait for ports 30001 and 30002.
    pub messages: VecDeque<MessageContent>,
    program: Option<Running>,
    /// Whose place another program took.
    retired: Option<Program>,
    /// What has come and was not looked at yet.
    arrivals: VecDeque<Arrival>,
    /// Lines of port 30020 that wait.
    pub(super) interpreter: InterpreterDesk,
    watchdogs: Vec<Watchdog>,
    waits: BTreeMap<ThreadId, u64>,
    sockets: ProgramSockets,
    mover: Option<MovingThread>,
    /// Threads whose popup waits to be closed.
    pub(super) popups: BTreeSet<ThreadId>,
    reported: Option<ProtectiveReason>,
    /// In which cycle a program ended last.
    ended: Option<u64>,
}

impl World {
    /// A controller that has booted.
    #[must_use]
    pub fn new(options: ControllerOptions) -> Self {
        let version = options.version;
        Self {
            robot: SimulatedRobot::new(options),
            inputs: InputVariables::new((version.major, version.minor, version.bugfix)),
            registers: Registers::default(),
            remote: true,
            user_role: "programmer",
            operational_mode: "NONE",
            messages: VecDeque::new(),
            program: None,
            retired: None,
            arrivals: VecDeque::new(),
            interpreter: InterpreterDesk::default(),
            watchdogs: Vec::new(),
            waits: BTreeMap::new(),
            sockets: ProgramSockets::new(options.any_host),
            mover: None,
            popups: BTreeSet::new(),
            reported: None,
            ended: None,
        }
    }

    /// RTDE's `runtime_state`.
    #[must_use]
    pub fn runtime(&self) -> Runtime {
        if self.program.is_none() {
            return Runtime::Stopped;
        }
        let scaling = self.robot.speed_scaling;
        match self.robot.paused {
            true if scaling > 0.0 => Runtime::Pausing,
            true => Runtime::Paused,
            false if scaling < self.robot.slider => Runtime::Resuming,
            false => Runtime::Playing,
        }
    }

    /// Name of the running program; empty without one.
    #[must_use]
    pub fn program_name(&self) -> &str {
        self.program.as_ref().map_or("", |running| &running.name)
    }

    /// The line at which the program is, from 1; 0 without one.
    #[must_use]
    pub fn line(&self) -> u32 {
        self.program.as_ref().map_or(0, |running| running.run.line())
    }

    /// A message for the log and the primary interface.
    pub fn say(&mut self, content: MessageContent) {
        if self.messages.len() < MOST_MESSAGES {
            self.messages.push_back(content);
        }
    }

    fn fail(&mut self, error: ScriptError) {
        let [line, column] =
            [error.at.line, error.at.column].map(|number| i32::try_from(number).unwrap_or(i32::MAX));
        self.say(MessageContent::RuntimeException { line, column, text: error.message });
    }

    /// What happened to the program `name`.
    fn say_of_program(&mut self, title: &str, name: String) {
        self.say(MessageContent::Key { code: 0, argument: 0, title: title.to_owned(), text: name });
    }

    /// The program that runs.
    pub(super) fn run(&mut self) -> Option<&mut ScriptRun> {
        self.program.as_mut().map(|running| &mut running.run)
    }

    /// Gives the running program statements for interpreter mode.
    pub(super) fn take_statements(&mut self, statements: &Statements) -> Interpreted {
        let Some(mut running) = self.program.take() else { return Interpreted::Later };
        let taken = self.lend(|hands| running.run.interpret(statements, hands));
        self.program = Some(running);
        taken
    }

    /// Lends the robot to a program.
    fn lend<T>(&mut self, program: impl FnOnce(&mut Hands<'_>) -> T) -> T {
        let mut hands = Hands {
            robot: &mut self.robot,
            inputs: &self.inputs,
            registers: &mut self.registers,
            watchdogs: &mut self.watchdogs,
            waits: &mut self.waits,
            mover: &mut self.mover,
            popups: &mut self.popups,
            messages: &mut self.messages,
            sockets: &mut self.sockets,
            spent: 0,
        };
        program(&mut hands)
    }

    /// Something has come: it is obeyed in one of the next cycles, at most one program a cycle. Gives it back
    /// where too much waits already.
    ///
    /// # Errors
    ///
    /// The arrival.
    pub fn arrive(&mut self, arrival: Arrival) -> Result<(), Arrival> {
        if self.arrivals.len() >= MOST_ARRIVALS {
            return Err(arrival);
        }
        self.arrivals.push_back(arrival);
        Ok(())
    }

    /// Takes a text from a port at once: a program replaces the one that runs.
    pub fn take_script(&mut self, text: &str) {
        self.obey(Arrival::read(text));
    }

    /// In local control a controller obeys its pendant only, in plain lines as in programs.
    fn obey(&mut self, arrival: Arrival) {
        if !self.remote {
            self.say(MessageContent::Text("Refused: the robot is not in remote control".to_owned()));
            return;
        }
        match arrival {
            Arrival::Stop => self.stop(),
            Arrival::Pause => {
                self.pause();
            }
            Arrival::Resume => {
                self.play();
            }
            Arrival::PowerOn => self.power_on(),
            Arrival::Script(Err(error)) => self.fail(error),
            Arrival::Script(Ok(program)) if program.is_secondary() => {
                self.run_beside(&program);
                self.retired = Some(program);
            }
            Arrival::Script(Ok(program)) => {
                let name = if program.name().is_empty() { "script" } else { program.name() };
                let name = name.chars().take(LONGEST_NAME).collect();
                self.start(&program, name);
                self.retired = Some(program);
            }
        }
    }

    /// A program that is of no use any more.
    pub fn retired(&mut self) -> Option<Program> {
        self.retired.take()
    }

    /// A secondary program: done within this cycle, beside the program that runs.
    fn run_beside(&mut self, program: &Program) {
        let result = self.lend(|hands| {
            let mut run = ScriptRun::new(program, hands)?;
            match run.cycle(hands) {
                Progress::Failed(error) => Err(error),
                Progress::Running | Progress::Finished => Ok(()),
            }
        });
        self.sockets.close_of(SocketOwner::Secondary);
        if let Err(error) = result {
            self.fail(error);
        }
    }

    /// Lets the paused program go on; whether there is one and it may. There is no program of the pendant
    /// that could be started, and one that came over a socket never becomes that.
    pub fn play(&mut self) -> bool {
        if !(self.robot.paused && self.program.is_some()) {
            return false;
        }
        self.robot.paused = !self.robot.ready();
        self.robot.ready()
    }

    /// Starts a program in the place of the one that runs; one that is refused leaves that alone.
    fn start(&mut self, program: &Program, name: String) {
        let run = match self.lend(|hands| ScriptRun::new(program, hands)) {
            Err(error) => return self.fail(error),
            Ok(run) => run,
        };
        self.stop();
        self.sockets.close_all();
        if !self.robot.ready() {
            self.say(MessageContent::Text("The program cannot start: the robot is not ready".to_owned()));
            return;
        }
        self.say_of_program("PROGRAM_XXX_STARTED", name.clone());
        self.program = Some(Running { run, name });
    }

    /// Pauses the program, if one runs.
    pub fn pause(&mut self) -> bool {
        self.robot.paused |= self.program.is_some();
        self.program.is_some()
    }

    /// Stops the program; the arm brakes.
    pub fn stop(&mut self) {
        if let Some(mut running) = self.program.take() {
            self.lend(|hands| running.run.stop(hands));
            self.over(running.name);
        }
    }

    /// Stops the program, and whatever clients have sent that has not begun. Whether there was one: PolyScope
    /// sees the end of a program a moment later, so one that ended just now counts.
    pub fn stop_all(&mut self) -> bool {
        let just_ended = self.ended.is_some_and(|ended| {
            self.robot.cycle.saturating_sub(ended) * 2 < u64::from(self.robot.options.series.rate_hz())
        });
        let there = self.program.is_some() || just_ended || !self.arrivals.is_empty();
        self.arrivals.clear();
        self.stop();
        there
    }

    fn over(&mut self, name: String) {
        self.ended = Some(self.robot.cycle);
        self.watchdogs.clear();
        self.waits.clear();
        self.sockets.close_all();
        self.robot.paused = false;
        self.robot.brake(4.0);
        self.say_of_program("PROGRAM_XXX_STOPPED", name);
    }

    /// As after a reboot: no program, and what [`SimulatedRobot::reboot`] says.
    pub fn reboot(&mut self) {
        let mut again = Self::new(self.robot.options);
        self.robot.reboot();
        std::mem::swap(&mut again.robot, &mut self.robot);
        again.remote = self.remote;
        *self = again;
    }

    /// Power on, in steps of its own time.
    pub fn power_on(&mut self) {
        if self.robot.mode == RobotMode::PowerOff && self.robot.safety.lets_power_on() {
            self.robot.mode = RobotMode::PowerOn { until: None, release: false };
        }
    }

    /// Releases the brakes, and powers on before where the power is off; whether the safety system lets it.
    pub fn brake_release(&mut self) -> bool {
        match &mut self.robot.mode {
            RobotMode::PowerOff if !self.robot.safety.lets_power_on() => return false,
            RobotMode::PowerOff => self.robot.mode = RobotMode::PowerOn { until: None, release: true },
            RobotMode::PowerOn { release, .. } => *release = true,
            RobotMode::Idle => self.robot.mode = RobotMode::Releasing { until: None },
            RobotMode::Releasing { .. } | RobotMode::Backdrive | RobotMode::Running => {}
        }
        true
    }

    /// Power off; the program ends.
    pub fn power_off(&mut self) {
        self.stop();
        self.robot.power_off();
    }

    /// An operator has looked and restarts the safety system: power off, violations and faults are over.
    pub fn restart_safety(&mut self) {
        self.power_off();
        self.robot.safety.breach = None;
    }

    /// The drives give way to a hand, or hold the arm again with closed brakes.
    pub fn backdrive(&mut self, on: bool) -> bool {
        let was = self.robot.mode;
        if was == RobotMode::PowerOff || on == (was == RobotMode::Backdrive) {
            return false;
        }
        self.stop();
        self.robot.mode = if on { RobotMode::Backdrive } else { RobotMode::Idle };
        self.robot.halt();
        true
    }

    pub fn cycle(&mut self) {
        // A program takes its time to begin, or to run beside; lines and errors take none.
        while let Some(arrival) = self.arrivals.pop_front() {
            let program = matches!(arrival, Arrival::Script(Ok(_)));
            self.obey(arrival);
            if program {
                break;
            }
        }
        self.watch();
        if !self.robot.paused
            && let Some(mut running) = self.program.take()
        {
            match self.lend(|hands| running.run.cycle(hands)) {
                Progress::Running => self.program = Some(running),
                Progress::Finished => self.over(running.name),
                Progress::Failed(error) => {
                    self.fail(error);
                    self.over(running.name);
                }
            }
        }
        self.begin_interpreting();
        self.sockets.flush();
        self.robot.step();
        self.react();
    }

    /// Inputs that stay away too long.
    fn watch(&mut self) {
        let now = self.robot.cycle;
        let away = self.watchdogs.iter().find(|watchdog| {
            let set = self.inputs.set_at(&watchdog.name).unwrap_or(0).max(watchdog.since);
            watchdog.away != Away::Ignore && now.saturating_sub(set) > watchdog.cycles
        });
        let Some(watchdog) = away.cloned() else { return };
        let text = format!("RTDE watchdog: {} was not updated in time", watchdog.name);
        match watchdog.away {
            Away::Stop => {
                self.say(MessageContent::Text(text));
                self.stop();
            }
            Away::Pause if !self.robot.paused => {
                self.say(MessageContent::Text(text));
                self.pause();
            }
            Away::Pause | Away::Ignore => {}
        }
    }

    /// What safety does to the program and says.
    fn react(&mut self) {
        let safety = self.robot.safety;
        if !safety.lets_programs_be() || self.robot.mode != RobotMode::Running {
            self.stop();
        }
        if safety.safeguard {
            self.pause();
        }
        if safety.protective() != self.reported {
            self.reported = safety.protective();
            if let Some(why) = self.reported {
                let (code, argument) = why.code();
                self.say(MessageContent::Code { code, argument, level: 3, text: why.text().to_owned() });
            }
        }
        debug_assert!(
            !matches!(self.robot.motion, RobotMotion::Servo { .. }) || safety.protective().is_none()
        );
    }
}

/// What a program holds of its controller.
#[cfg(test)]
#[derive(Debug)]
pub(super) struct ProgramLoad {
    pub(super) instructions: u32,
    pub(super) threads: usize,
    pub(super) waits: usize,
    pub(super) watchdogs: usize,
    pub(super) messages: usize,
}

#[cfg(test)]
impl World {
    pub(super) fn held(&self) -> ProgramLoad {
        let run = self.program.as_ref().map(|running| &running.run);
        ProgramLoad {
            instructions: run.map_or(0, ScriptRun::used),
            threads: run.map_or(0, ScriptRun::threads),
            waits: self.waits.len(),
            watchdogs: self.watchdogs.len(),
            messages: self.messages.len(),
        }
    }
}

#[cfg(test)]
#[path = "world_tests.rs"]
mod tests;
