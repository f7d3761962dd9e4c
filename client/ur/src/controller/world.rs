//! The controller's state behind one lock: robot, inputs, registers, program, log. One call is one control
//! cycle.

use std::collections::{BTreeMap, VecDeque};

use super::inputs::Inputs;
use super::machine::{Away, Hands, MOST_SAID, Registers, Watchdog};
use super::motion::Motion;
use super::options::Options;
use super::robot::Robot;
use super::safety::{RobotMode, Stopped};
use crate::primary::Said;
use crate::rtde::Value;
use crate::script::{Program, Progress, Run, ScriptError, ThreadId};

/// RTDE's `runtime_state`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Runtime {
    /// 1
    Stopped,
    /// 2
    Playing,
    /// 3
    Pausing,
    /// 4
    Paused,
    /// 5
    Resuming,
}

impl Runtime {
    /// RTDE's number.
    #[must_use]
    pub const fn number(self) -> u32 {
        match self {
            Self::Stopped => 1,
            Self::Playing => 2,
            Self::Pausing => 3,
            Self::Paused => 4,
            Self::Resuming => 5,
        }
    }
}

/// A program that runs or is paused.
#[derive(Debug)]
struct Running {
    run: Run,
    name: String,
}

/// Everything that a controller knows.
#[derive(Debug)]
pub struct World {
    /// The robot.
    pub robot: Robot,
    /// Input variables of RTDE.
    pub inputs: Inputs,
    /// Output registers.
    pub registers: Registers,
    /// In remote control: scripts and dashboard commands that move the robot are taken.
    pub remote: bool,
    /// Messages that wait for ports 30001 and 30002.
    pub said: VecDeque<Said>,
    program: Option<Running>,
    /// The program that was sent last, for `play`.
    loaded: Option<(Program, String)>,
    watchdogs: Vec<Watchdog>,
    waits: BTreeMap<ThreadId, u64>,
    mover: Option<ThreadId>,
    told: Option<Stopped>,
}

impl World {
    /// A controller that has booted.
    #[must_use]
    pub fn new(options: Options) -> Self {
        let version = options.version;
        Self {
            robot: Robot::new(options),
            inputs: Inputs::new((version.major, version.minor)),
            registers: Registers::default(),
            remote: true,
            said: VecDeque::new(),
            program: None,
            loaded: None,
            watchdogs: Vec::new(),
            waits: BTreeMap::new(),
            mover: None,
            told: None,
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

    /// Name of the running program, else of the one that was sent last.
    #[must_use]
    pub fn program_name(&self) -> &str {
        let loaded = || self.loaded.as_ref().map_or("", |(_, name)| name);
        self.program.as_ref().map_or_else(loaded, |running| &running.name)
    }

    /// The line at which the program is, from 1; 0 without one.
    #[must_use]
    pub fn line(&self) -> u32 {
        self.program.as_ref().map_or(0, |running| running.run.line())
    }

    /// A message for the log and the primary interface.
    pub fn say(&mut self, said: Said) {
        if self.said.len() < MOST_SAID {
            self.said.push_back(said);
        }
    }

    fn fail(&mut self, error: ScriptError) {
        let number = |number: u32| i32::try_from(number).unwrap_or(i32::MAX);
        let (line, column) = (number(error.line), number(error.column));
        self.say(Said::RuntimeException { line, column, text: error.message });
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
            said: &mut self.said,
        };
        program(&mut hands)
    }

    /// Takes the text of a program from a port: it takes the place of the one that runs.
    pub fn take_script(&mut self, text: &str) {
        if !self.remote {
            self.say(Said::Text("Script refused: the robot is not in remote control".to_owned()));
            return;
        }
        match Program::parse(text) {
            Err(error) => self.fail(error),
            Ok(program) if program.is_secondary() => self.run_beside(&program),
            Ok(program) => {
                let name = if program.name().is_empty() { "script" } else { program.name() }.to_owned();
                self.loaded = Some((program, name));
                self.start();
            }
        }
    }

    /// A secondary program: done within this cycle, beside the program that runs.
    fn run_beside(&mut self, program: &Program) {
        let result = self.lend(|hands| {
            let mut run = Run::new(program, hands)?;
            match run.cycle(hands) {
                Progress::Failed(error) => Err(error),
                Progress::Running | Progress::Finished => Ok(()),
            }
        });
        if let Err(error) = result {
            self.fail(error);
        }
    }

    /// Starts the program that was sent last, or lets the paused one go on; whether there is one and it may
    /// run.
    pub fn play(&mut self) -> bool {
        if self.robot.paused && self.program.is_some() {
            self.robot.paused = !self.robot.ready();
            return self.robot.ready();
        }
        self.start()
    }

    fn start(&mut self) -> bool {
        let Some((program, name)) = self.loaded.clone() else { return false };
        self.stop();
        if !self.robot.ready() {
            self.say(Said::Text("The program cannot start: the robot is not ready".to_owned()));
            return false;
        }
        match self.lend(|hands| Run::new(&program, hands)) {
            Err(error) => {
                self.fail(error);
                false
            }
            Ok(run) => {
                let said = |title: &str| Said::Key {
                    code: 0,
                    argument: 0,
                    title: title.to_owned(),
                    text: name.clone(),
                };
                self.say(said("PROGRAM_XXX_STARTED"));
                self.program = Some(Running { run, name });
                true
            }
        }
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
            self.over(&running.name);
        }
    }

    fn over(&mut self, name: &str) {
        self.watchdogs.clear();
        self.waits.clear();
        self.robot.paused = false;
        self.robot.brake(4.0);
        let title = "PROGRAM_XXX_STOPPED".to_owned();
        self.say(Said::Key { code: 0, argument: 0, title, text: name.to_owned() });
    }

    /// As after a reboot: power off, no program, time 0. Settings of the pendant stay.
    pub fn reboot(&mut self) {
        let mut options = self.robot.options;
        options.running = false;
        let q = self.robot.actual().q;
        let mut again = Self::new(options);
        again.robot.place(q);
        again.robot.tcp_offset = self.robot.tcp_offset;
        again.robot.payload = self.robot.payload;
        again.remote = self.remote;
        *self = again;
    }

    /// Power on, in steps of its own time.
    pub fn power_on(&mut self) {
        if self.robot.mode == RobotMode::PowerOff && !self.robot.safety.emergency {
            self.robot.mode = RobotMode::PowerOn { until: None };
        }
    }

    /// Releases the brakes; powers on where needed is an act of its own.
    pub fn brake_release(&mut self) {
        if matches!(self.robot.mode, RobotMode::Idle | RobotMode::PowerOn { .. }) {
            self.robot.mode = RobotMode::Releasing { until: None };
        }
    }

    /// Power off; the program ends.
    pub fn power_off(&mut self) {
        self.stop();
        self.robot.power_off();
    }

    /// Does what the input `name` asks for, if it is no register: the slider, digital and analog outputs,
    /// where their mask says so.
    pub fn apply_input(&mut self, name: &str) {
        let inputs = &self.inputs;
        let word = |name: &str| inputs.value(name).and_then(Value::uint8).unwrap_or(0);
        let number = |name: &str| inputs.value(name).and_then(Value::double).unwrap_or(0.0);
        if name.starts_with("speed_slider") {
            let mask = inputs.value("speed_slider_mask").and_then(Value::uint32).unwrap_or(0);
            let fraction = number("speed_slider_fraction");
            if mask & 1 == 1 && fraction.is_finite() {
                self.robot.slider = fraction.clamp(0.0, 1.0);
            }
        }
        for (group, shift) in [("standard_digital", 0), ("configurable_digital", 8), ("tool_digital", 16)] {
            if name.starts_with(group) {
                let bits = u64::from(word(&format!("{group}_output"))) << shift;
                let mask = u64::from(word(&format!("{group}_output_mask"))) << shift;
                let outputs = &mut self.robot.digital_outputs;
                *outputs = *outputs & !mask | bits & mask;
            }
        }
        if name.starts_with("standard_analog") {
            let (mask, kind) = (word("standard_analog_output_mask"), word("standard_analog_output_type"));
            for (index, output) in self.robot.analog_outputs.iter_mut().enumerate() {
                let share = number(&format!("standard_analog_output_{index}"));
                if mask >> index & 1 == 1 && share.is_finite() {
                    let share = share.clamp(0.0, 1.0);
                    // 1 is a voltage, 0 a current.
                    *output = if kind >> index & 1 == 1 { 10.0 * share } else { 0.004 + 0.016 * share };
                }
            }
        }
    }

    /// One control cycle.
    pub fn cycle(&mut self) {
        self.watch();
        if !self.robot.paused
            && let Some(mut running) = self.program.take()
        {
            match self.lend(|hands| running.run.cycle(hands)) {
                Progress::Running => self.program = Some(running),
                Progress::Finished => self.over(&running.name),
                Progress::Failed(error) => {
                    self.fail(error);
                    self.over(&running.name);
                }
            }
        }
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
                self.say(Said::Text(text));
                self.stop();
            }
            Away::Pause if !self.robot.paused => {
                self.say(Said::Text(text));
                self.pause();
            }
            Away::Pause | Away::Ignore => {}
        }
    }

    /// What safety does to the program and says.
    fn react(&mut self) {
        let safety = self.robot.safety;
        if (safety.protective().is_some() || safety.emergency) && self.program.is_some() {
            self.stop();
        }
        if self.robot.mode != RobotMode::Running && self.program.is_some() {
            self.stop();
        }
        if safety.protective() != self.told {
            self.told = safety.protective();
            if let Some(why) = self.told {
                let (code, argument) = why.code();
                self.say(Said::Code { code, argument, level: 3, text: why.text().to_owned() });
            }
        }
        debug_assert!(!matches!(self.robot.motion, Motion::Servo { .. }) || safety.protective().is_none());
    }
}

#[cfg(test)]
#[path = "world_tests.rs"]
mod tests;
