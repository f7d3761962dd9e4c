//! What a program asks of the robot: motion, registers, inputs and outputs, messages.
//!
//! Contract: total. What is known by name but not simulated stops the program with a sentence that says so;
//! what a controller does not know either is refused when a program is loaded.
//!
//! *Source*: script manual of Universal Robots, 5.x, for parameters and defaults.

use std::collections::{BTreeMap, VecDeque};

use super::inputs::{InputVariables, REGISTERS};
use super::inverse::search;
use super::motion::RobotMotion;
use super::names::{NOT_SIMULATED, SIMULATED};
use super::pose::{frame, pose};
use super::robot::SimulatedRobot;
use super::safety::ProtectiveReason;
use crate::script::{Arguments, Called, Machine, MachineCall, ThreadId, Value};
use foretrace_ur::primary::MessageContent;

/// Watchdogs that a program may set.
const MOST_WATCHDOGS: usize = 64;
/// Messages that wait to be sent.
pub const MOST_MESSAGES: usize = 256;
/// What a step of the search for joints takes, in instructions of a program.
const INSTRUCTIONS_PER_STEP: u32 = 150;
/// What the search for an input by its name takes, or the place of the tool.
const INSTRUCTIONS_PER_SEARCH: u32 = 20;

#[derive(Debug, Clone)]
pub struct Registers {
    pub integers: [i32; REGISTERS],
    pub doubles: [f64; REGISTERS],
    /// Bits 0 to 127.
    pub bits: u128,
}

impl Default for Registers {
    fn default() -> Self {
        Self { integers: [0; REGISTERS], doubles: [0.0; REGISTERS], bits: 0 }
    }
}

/// What happens when an input stays away.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Away {
    Ignore,
    /// The program is paused.
    Pause,
    /// The program is stopped.
    Stop,
}

/// `rtde_set_watchdog`.
#[derive(Debug, Clone)]
pub struct Watchdog {
    pub name: String,
    /// Cycles without it that are allowed.
    pub cycles: u64,
    pub away: Away,
    /// When it was set.
    pub since: u64,
}

/// The robot in the hands of a program.
#[derive(Debug)]
pub struct Hands<'a> {
    pub robot: &'a mut SimulatedRobot,
    pub inputs: &'a InputVariables,
    pub registers: &'a mut Registers,
    pub watchdogs: &'a mut Vec<Watchdog>,
    /// Until which cycle threads wait, and which of them moves the robot.
    pub waits: &'a mut BTreeMap<ThreadId, u64>,
    /// Thread whose motion is going on.
    pub mover: &'a mut Option<ThreadId>,
    /// Messages for ports 30001 and 30002.
    pub messages: &'a mut VecDeque<MessageContent>,
    /// Instructions that calls took since they were counted.
    pub spent: u32,
}

pub(super) type Result<T> = std::result::Result<T, String>;

fn number(value: Option<&Value>, name: &str) -> Result<f64> {
    value.and_then(Value::as_number).ok_or_else(|| format!("wants a number for {name}"))
}

pub(super) fn number_or(value: Option<&Value>, name: &str, usual: f64) -> Result<f64> {
    if value.is_some() { number(value, name) } else { Ok(usual) }
}

pub(super) fn joints(value: Option<&Value>, name: &str) -> Result<[f64; 6]> {
    if matches!(value, Some(Value::Pose(_))) {
        return Err(format!("a pose for {name} is not simulated here, joint positions are"));
    }
    value.and_then(Value::as_numbers::<6>).ok_or_else(|| format!("wants six numbers for {name}"))
}

/// A register's or output's number, below `count`.
fn index(value: Option<&Value>, count: usize) -> Result<usize> {
    let number = value.and_then(Value::as_integer).and_then(|number| usize::try_from(number).ok());
    number.filter(|number| *number < count).ok_or_else(|| format!("wants a number from 0 to {}", count - 1))
}

impl Hands<'_> {
    /// Waits `cycles` from the first call on; 1 is the rest of this cycle.
    pub(super) fn wait(&mut self, call: &MachineCall<'_>, cycles: u64) -> Called {
        let now = self.robot.cycle;
        if call.first {
            if cycles <= 1 {
                return Called::Cycle(Value::None);
            }
            self.waits.insert(call.thread, now.saturating_add(cycles));
            return Called::Wait;
        }
        let over = self.waits.get(&call.thread).is_none_or(|until| now >= *until);
        if over {
            self.waits.remove(&call.thread);
            return Called::Value(Value::None);
        }
        Called::Wait
    }

    pub(super) fn cycles(&self, seconds: f64) -> u64 {
        // Whole cycles of 0.002 as text are not quite those of a float; saturates.
        (seconds / self.robot.dt() - 1e-6).ceil().max(0.0) as u64
    }

    /// Joints for the tool, `tcp` from the flange, at `wanted`.
    pub(super) fn joints_for(
        &mut self,
        tcp: &[f64; 6],
        wanted: &[f64; 6],
        near: &[f64; 6],
    ) -> Option<[f64; 6]> {
        let mut steps = 0;
        let found = search(&self.robot.dh, tcp, wanted, near, &mut steps);
        self.spent = self.spent.saturating_add(steps.saturating_mul(INSTRUCTIONS_PER_STEP));
        found
    }

    fn say(&mut self, text: String) {
        if self.messages.len() < MOST_MESSAGES {
            self.messages.push_back(MessageContent::Text(text));
        }
    }

    /// The tool as a call names it by its offset from the flange, else as it is set.
    fn tool(&self, tcp: Option<&Value>) -> Result<[f64; 6]> {
        let named = tcp.map(|tcp| tcp.as_numbers::<6>().ok_or("wants a pose for tcp")).transpose()?;
        Ok(named.unwrap_or(self.robot.tcp_offset))
    }

    fn registers(&mut self, name: &str, arguments: &Arguments) -> Result<Value> {
        let [at, value] = arguments.bind(["address", "value"])?;
        let count = if name.contains("boolean") { 128 } else { REGISTERS };
        let n = index(at, count)?;
        let none = || "has no such register".to_owned();
        Ok(match name {
            "read_input_integer_register" => Value::Integer(self.inputs.integer(n).ok_or_else(none)?),
            "read_input_float_register" => Value::Float(self.inputs.double(n).ok_or_else(none)?),
            "read_input_boolean_register" => {
                self.spent = self.spent.saturating_add(INSTRUCTIONS_PER_SEARCH);
                Value::Bool(self.inputs.bit(n).ok_or_else(none)?)
            }
            "read_output_integer_register" => {
                Value::Integer(*self.registers.integers.get(n).ok_or_else(none)?)
            }
            "read_output_float_register" => Value::Float(*self.registers.doubles.get(n).ok_or_else(none)?),
            "read_output_boolean_register" => Value::Bool(self.registers.bits >> n & 1 == 1),
            "write_output_integer_register" => {
                let value = value.and_then(Value::as_number).ok_or("wants an integer")?;
                // A float is cut to an integer; saturates.
                *self.registers.integers.get_mut(n).ok_or_else(none)? = value as i32;
                Value::None
            }
            "write_output_float_register" => {
                let value = number(value, "value")?;
                *self.registers.doubles.get_mut(n).ok_or_else(none)? = value;
                Value::None
            }
            _ => {
                let on = value.and_then(Value::as_bool).ok_or("wants a truth value")?;
                self.registers.bits = self.registers.bits & !(1 << n) | u128::from(on) << n;
                Value::None
            }
        })
    }

    fn digital(&mut self, name: &str, arguments: &Arguments) -> Result<Value> {
        let [at, value] = arguments.bind(["n", "b"])?;
        let (first, count) = if name.contains("configurable") {
            (8, 8)
        } else if name.contains("tool") {
            (16, 2)
        } else if name.contains("standard") {
            (0, 8)
        } else {
            // Counts standard, configurable (of old 8 and 9 the tool) through.
            (0, 18)
        };
        let bit = first + index(at, count)?;
        if name.starts_with("set") {
            let on = value.and_then(Value::as_bool).ok_or("wants a truth value")?;
            self.robot.digital_outputs = self.robot.digital_outputs & !(1 << bit) | u64::from(on) << bit;
            return Ok(Value::None);
        }
        let bits = if name.ends_with("_in") { self.robot.digital_inputs } else { self.robot.digital_outputs };
        Ok(Value::Bool(bits >> bit & 1 == 1))
    }

    fn settings(&mut self, name: &str, arguments: &Arguments) -> Result<Value> {
        match name {
            "set_tcp" => {
                let [pose, _] = arguments.bind(["pose", "tcp_name"])?;
                let pose = pose.and_then(Value::as_numbers::<6>).ok_or("wants a pose")?;
                if pose.iter().any(|number| !(number.abs() < 1e3)) {
                    return Err("wants a pose within metres".to_owned());
                }
                self.robot.tcp_offset = pose;
            }
            "set_payload" | "set_target_payload" | "set_payload_mass" => {
                let [m, cog, _, _] = arguments.bind(["m", "cog", "inertia", "transition_time"])?;
                let mass = number(m, "m")?;
                if !(0.0..=100.0).contains(&mass) {
                    return Err("wants a mass from 0 to 100 kg".to_owned());
                }
                self.robot.payload.0 = mass;
                if let Some(cog) = cog {
                    self.robot.payload.1 = cog.as_numbers::<3>().ok_or("wants three numbers for cog")?;
                }
            }
            "set_payload_cog" => {
                let [cog, _] = arguments.bind(["cog", "transition_time"])?;
                let cog = cog.and_then(Value::as_numbers::<3>).ok_or("wants three numbers for cog")?;
                self.robot.payload.1 = cog;
            }
            "set_analog_out" | "set_standard_analog_out" => {
                let [n, f] = arguments.bind(["n", "f"])?;
                let share = number(f, "f")?.clamp(0.0, 1.0);
                let n = index(n, 2)?;
                // Current, 4 to 20 mA, as set at the factory.
                if let Some(output) = self.robot.analog_outputs.get_mut(n) {
                    *output = 0.004 + 0.016 * share;
                }
            }
            "get_analog_out" | "get_standard_analog_out" => {
                let [n] = arguments.bind(["n"])?;
                let output = self.robot.analog_outputs.get(index(n, 2)?).copied().unwrap_or(0.0);
                return Ok(Value::Float((output - 0.004) / 0.016));
            }
            // set_gravity, set_tool_voltage, force settings, ends of modes that never begin: no effect here.
            _ => {}
        }
        Ok(Value::None)
    }

    fn watchdog(&mut self, arguments: &Arguments) -> Result<Value> {
        let [name, hz, action] = arguments.bind(["variable_name", "min_frequency", "action"])?;
        let name = name.and_then(Value::as_text).ok_or("wants the name of an input")?.to_owned();
        self.spent = self.spent.saturating_add(INSTRUCTIONS_PER_SEARCH);
        let hz = number(hz, "min_frequency")?;
        let away = match action.map(|action| action.as_text().unwrap_or("")) {
            None | Some("pause") => Away::Pause,
            Some("stop") => Away::Stop,
            Some("ignore") => Away::Ignore,
            Some(other) => return Err(format!("knows pause, stop and ignore, not {other:?}")),
        };
        if self.inputs.value(&name).is_none() {
            return Err(format!("there is no input {name:?}"));
        }
        if !(hz > 0.0) {
            return Err("wants a frequency above 0".to_owned());
        }
        self.watchdogs.retain(|watchdog| watchdog.name != name);
        if self.watchdogs.len() >= MOST_WATCHDOGS {
            return Err("too many watchdogs".to_owned());
        }
        let (cycles, since) = (self.cycles(1.0 / hz), self.robot.cycle);
        self.watchdogs.push(Watchdog { name, cycles, away, since });
        Ok(Value::None)
    }

    fn state(&mut self, name: &str, arguments: &Arguments) -> Result<Value> {
        let (actual, target) = (self.robot.actual(), self.robot.target);
        self.spent = self.spent.saturating_add(INSTRUCTIONS_PER_SEARCH);
        Ok(match name {
            "get_actual_joint_positions" => Value::floats(&actual.q),
            "get_actual_joint_speeds" => Value::floats(&actual.qd),
            "get_target_joint_positions" => Value::floats(&target.q),
            "get_target_joint_speeds" => Value::floats(&target.qd),
            "get_actual_tcp_pose" => Value::Pose(self.robot.tcp_pose(&actual.q)),
            "get_target_tcp_pose" => Value::Pose(self.robot.tcp_pose(&target.q)),
            "get_actual_tcp_speed" => Value::floats(&self.robot.tcp_speed(&actual)),
            "get_tcp_offset" => Value::Pose(self.robot.tcp_offset),
            "get_target_payload" => Value::Float(self.robot.payload.0),
            "get_target_payload_inertia" => Value::floats(&[0.0; 6]),
            "get_target_payload_cog" => Value::floats(&self.robot.payload.1),
            "get_steptime" => Value::Float(self.robot.dt()),
            "is_steady" => Value::Bool(self.robot.steady()),
            "get_inverse_kin" | "get_inverse_kin_has_solution" => {
                let names = ["x", "qnear", "maxPositionError", "maxOrientationError", "tcp"];
                let [x, near, _, _, tcp] = arguments.bind(names)?;
                let x = x.and_then(Value::as_numbers::<6>).ok_or("wants a pose for x")?;
                let near = if near.is_some() { joints(near, "qnear")? } else { actual.q };
                let tcp = self.tool(tcp)?;
                let found = self.joints_for(&tcp, &x, &near);
                if name == "get_inverse_kin" {
                    Value::floats(&found.ok_or("finds no joints for this pose")?)
                } else {
                    Value::Bool(found.is_some())
                }
            }
            _ => {
                let [q, tcp] = arguments.bind(["q", "tcp"])?;
                let q = if q.is_some() { joints(q, "q")? } else { actual.q };
                Value::Pose(pose(&(self.robot.dh.flange(&q) * frame(&self.tool(tcp)?))))
            }
        })
    }

    fn answer(&mut self, call: &MachineCall<'_>) -> Result<Called> {
        let arguments = call.arguments;
        let value = match call.name {
            "servoj" | "movej" | "movel" | "speedj" | "stopj" | "stopl" => return self.motion(call),
            "sync" => return Ok(Called::Cycle(Value::None)),
            "sleep" => {
                let [t] = arguments.bind(["t"])?;
                let cycles = self.cycles(number(t, "t")?);
                return Ok(if cycles == 0 { Called::Value(Value::None) } else { self.wait(call, cycles) });
            }
            "textmsg" => {
                let [first, second] = arguments.bind(["s1", "s2"])?;
                let text: String = [first, second].iter().flatten().map(ToString::to_string).collect();
                self.say(text);
                Value::None
            }
            "popup" => {
                let [text, ..] = arguments.bind(["s", "title", "warning", "error", "blocking"])?;
                self.say(text.map(ToString::to_string).unwrap_or_default());
                Value::None
            }
            "protective_stop" => {
                self.robot.protective_stop(ProtectiveReason::Asked);
                Value::None
            }
            "rtde_set_watchdog" => self.watchdog(arguments)?,
            name if name.starts_with("read_") || name.starts_with("write_") => {
                self.registers(name, arguments)?
            }
            name if name.contains("digital") => self.digital(name, arguments)?,
            name if name.starts_with("set_") || name.contains("analog") || name.contains("mode") => {
                self.settings(name, arguments)?
            }
            "zero_ftsensor" => Value::None,
            name => self.state(name, arguments)?,
        };
        Ok(Called::Value(value))
    }
}

impl Machine for Hands<'_> {
    fn knows(&self, name: &str) -> bool {
        SIMULATED.contains(&name) || NOT_SIMULATED.contains(&name)
    }

    fn call(&mut self, call: &MachineCall<'_>) -> Called {
        if NOT_SIMULATED.contains(&call.name) {
            return Called::Failed(format!("{} is not simulated", call.name));
        }
        if !SIMULATED.contains(&call.name) {
            return Called::Unknown;
        }
        self.answer(call).unwrap_or_else(|message| Called::Failed(format!("{} {message}", call.name)))
    }

    fn spent(&mut self) -> u32 {
        std::mem::take(&mut self.spent)
    }

    fn ended(&mut self, thread: ThreadId) {
        self.waits.remove(&thread);
        if *self.mover == Some(thread) {
            *self.mover = None;
            // A streamed target is held; a planned motion does not go on without its thread.
            if matches!(
                self.robot.motion,
                RobotMotion::Line(_) | RobotMotion::Straight { .. } | RobotMotion::Speed { .. }
            ) {
                self.robot.brake(4.0);
            }
        }
    }
}
