//! What a program asks of the robot: motion, registers, inputs and outputs, messages.
//!
//! Contract: total. What is known by name but not simulated stops the program with a sentence that says so;
//! what a controller does not know either is refused when a program is loaded.
//!
//! *Source*: script manual of Universal Robots, 5.x, for parameters and defaults.

use std::collections::{BTreeMap, BTreeSet, VecDeque};

use super::inputs::{InputVariables, REGISTERS};
use super::inverse::{PoseTolerance, search};
use super::motion::RobotMotion;
use super::names::{KnownAs, known};
use super::pose::{frame, pose};
use super::robot::{SimulatedRobot, within_limits};
use super::safety::ProtectiveReason;
use super::sockets::ProgramSockets;
use crate::script::{Arguments, Called, Machine, MachineCall, ThreadId, Value};
use foretrace_ur::primary::MessageContent;

/// Watchdogs that a program may set.
const MOST_WATCHDOGS: usize = 64;
/// Messages that wait to be sent.
pub const MOST_MESSAGES: usize = 256;
/// What a step of the search for joints takes, in instructions of a program.
const INSTRUCTIONS_PER_STEP: u32 = 150;
/// What the search for an input by its name takes, or the place of the tool.
pub(super) const INSTRUCTIONS_PER_SEARCH: u32 = 20;

#[derive(Debug, Clone)]
pub struct Registers {
    pub integers: [i32; REGISTERS],
    pub doubles: [f64; REGISTERS],
    /// Bits 0 to 127.
    pub bits: u128,
    /// The 32 bits of `set_flag`.
    pub flags: u32,
    pub(super) port_bits: BTreeMap<usize, i32>,
    pub(super) port_registers: BTreeMap<usize, i32>,
    /// Numbers that `random` has given.
    pub draws: u64,
}

impl Default for Registers {
    fn default() -> Self {
        Self {
            integers: [0; REGISTERS],
            doubles: [0.0; REGISTERS],
            bits: 0,
            flags: 0,
            port_bits: BTreeMap::new(),
            port_registers: BTreeMap::new(),
            draws: 0,
        }
    }
}

impl Registers {
    /// Evenly from 0 to 1 (splitmix64); the same numbers in every run.
    fn random(&mut self) -> f64 {
        self.draws = self.draws.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.draws;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
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

/// The thread whose motion call was the last.
#[derive(Debug, Clone, Copy)]
pub struct MovingThread {
    pub thread: ThreadId,
    /// The last cycle in which the call goes on; none where it was answered at once.
    pub until: Option<u64>,
}

/// The robot in the hands of a program.
#[derive(Debug)]
pub struct Hands<'a> {
    pub robot: &'a mut SimulatedRobot,
    pub inputs: &'a InputVariables,
    pub registers: &'a mut Registers,
    pub watchdogs: &'a mut Vec<Watchdog>,
    /// Until which cycle threads wait.
    pub waits: &'a mut BTreeMap<ThreadId, u64>,
    pub mover: &'a mut Option<MovingThread>,
    /// Threads that wait until somebody closes their popup.
    pub popups: &'a mut BTreeSet<ThreadId>,
    /// Messages for ports 30001 and 30002.
    pub messages: &'a mut VecDeque<MessageContent>,
    pub sockets: &'a mut ProgramSockets,
    /// Instructions that calls took since they were counted.
    pub spent: u32,
}

pub(super) type Result<T> = std::result::Result<T, String>;

pub(super) fn number(value: Option<&Value>, name: &str) -> Result<f64> {
    value.and_then(Value::as_number).ok_or_else(|| format!("wants a number for {name}"))
}

pub(super) fn number_or(value: Option<&Value>, name: &str, usual: f64) -> Result<f64> {
    if value.is_some() { number(value, name) } else { Ok(usual) }
}

pub(super) fn joints(value: Option<&Value>, name: &str) -> Result<[f64; 6]> {
    if matches!(value, Some(Value::Pose(_))) {
        return Err(format!("wants joint positions for {name}, not a pose"));
    }
    value.and_then(Value::as_numbers::<6>).ok_or_else(|| format!("wants six numbers for {name}"))
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
        tolerance: PoseTolerance,
    ) -> Option<[f64; 6]> {
        let mut steps = 0;
        let found = search(&self.robot.dh, tcp, wanted, near, tolerance, &mut steps);
        self.spent = self.spent.saturating_add(steps.saturating_mul(INSTRUCTIONS_PER_STEP));
        found
    }

    fn known(&self, name: &str) -> Option<KnownAs> {
        known(name, self.robot.options.series, self.robot.options.version)
    }

    pub(super) fn say(&mut self, text: String) {
        if self.messages.len() < MOST_MESSAGES {
            self.messages.push_back(MessageContent::Text(text));
        }
    }

    /// The tool as a call names it by its offset from the flange, else as it is set.
    fn tool(&self, tcp: Option<&Value>) -> Result<[f64; 6]> {
        // The manual's own default for it is a string.
        let tcp = tcp.filter(|tcp| tcp.as_bytes() != Some(b"active_tcp"));
        let named = tcp.map(|tcp| tcp.as_numbers::<6>().ok_or("wants a pose for tcp")).transpose()?;
        Ok(named.unwrap_or(self.robot.tcp_offset))
    }

    /// Says what a popup would show. One that blocks holds its thread until `close popup` of the dashboard.
    fn popup(&mut self, call: &MachineCall<'_>) -> Result<Called> {
        let names = ["s", "title", "warning", "error", "blocking"];
        let [text, title, warning, error, blocking] = call.arguments.bind(names)?;
        let truth = |value: Option<&Value>, name: &str| match value {
            None => Ok(false),
            Some(value) => value.as_bool().ok_or_else(|| format!("wants a truth value for {name}")),
        };
        truth(warning, "warning")?;
        truth(error, "error")?;
        if title.is_some_and(|title| title.as_bytes().is_none()) {
            return Err("wants a string for title".to_owned());
        }
        let blocks = truth(blocking, "blocking")?;
        if call.first {
            self.say(text.ok_or("wants a string for s")?.to_string());
            if blocks {
                self.popups.insert(call.thread);
            }
        }
        let waits = blocks && self.popups.contains(&call.thread);
        Ok(if waits { Called::Wait } else { Called::Value(Value::None) })
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
        const WITH_ARGUMENTS: [&str; 5] = [
            "get_joint_temp",
            "is_within_safety_limits",
            "get_inverse_kin",
            "get_inverse_kin_has_solution",
            "get_forward_kin",
        ];
        if !WITH_ARGUMENTS.contains(&name) {
            arguments.bind::<0>([])?;
        }
        Ok(match name {
            "get_actual_joint_positions" | "get_joint_positions" => Value::floats(&actual.q),
            "get_actual_joint_speeds" => Value::floats(&actual.qd),
            "get_target_joint_positions" => Value::floats(&target.q),
            "get_target_joint_speeds" => Value::floats(&target.qd),
            "get_actual_tcp_pose" => Value::Pose(self.robot.tcp_pose(&actual.q)),
            "get_target_tcp_pose" => Value::Pose(self.robot.tcp_pose(&target.q)),
            "get_actual_tcp_speed" => Value::floats(&self.robot.tcp_speed(&actual)),
            "get_target_tcp_speed" => Value::floats(&self.robot.tcp_speed(&target)),
            "get_actual_tool_flange_pose" => Value::Pose(pose(&self.robot.dh.flange(&actual.q))),
            "get_tcp_offset" => Value::Pose(self.robot.tcp_offset),
            // Nobody touches this arm, and its joints and controller are as warm as a room.
            "get_tcp_force" | "get_joint_torques" => Value::floats(&[0.0; 6]),
            "force" | "get_tool_current" => Value::Float(0.0),
            "get_controller_temp" => Value::Float(30.0),
            "get_joint_temp" => {
                let [joint] = arguments.bind(["j"])?;
                let joint = joint.and_then(Value::as_integer).filter(|joint| (0..=5).contains(joint));
                joint.ok_or("wants a joint from 0 to 5")?;
                Value::Float(30.0)
            }
            "get_tool_accelerometer_reading" => Value::floats(&[0.0, 0.0, 9.81]),
            "get_freedrive_status" => Value::Integer(0),
            "get_target_payload" => Value::Float(self.robot.payload.0),
            "get_target_payload_inertia" => Value::floats(&self.robot.payload_inertia),
            "get_target_payload_cog" => Value::floats(&self.robot.payload.1),
            "get_steptime" => Value::Float(self.robot.dt()),
            "is_steady" => Value::Bool(self.robot.steady()),
            "is_within_safety_limits" => {
                let [pose] = arguments.bind(["pose"])?;
                Value::Bool(match pose {
                    Some(Value::Pose(x)) => {
                        let tcp = self.robot.tcp_offset;
                        self.joints_for(&tcp, x, &actual.q, PoseTolerance::TIGHT).is_some()
                    }
                    q => within_limits(&joints(q, "pose")?),
                })
            }
            "get_inverse_kin" | "get_inverse_kin_has_solution" => {
                let names = ["x", "qnear", "maxPositionError", "maxOrientationError", "tcp"];
                let [x, near, position, orientation, tcp] = arguments.bind(names)?;
                let x = x.and_then(Value::as_numbers::<6>).ok_or("wants a pose for x")?;
                let near = if near.is_some() { joints(near, "qnear")? } else { actual.q };
                let tolerance = PoseTolerance::new(
                    number_or(position, "maxPositionError", 1e-10)?,
                    number_or(orientation, "maxOrientationError", 1e-10)?,
                );
                let tcp = self.tool(tcp)?;
                let found = self.joints_for(&tcp, &x, &near, tolerance);
                if name == "get_inverse_kin" {
                    Value::floats(&found.ok_or("finds no joints for this pose")?)
                } else {
                    Value::Bool(found.is_some())
                }
            }
            _ => {
                let [q, tcp] = arguments.bind(["q", "tcp"])?;
                let q = q.filter(|q| q.as_bytes() != Some(b"current_joint_positions"));
                let q = if q.is_some() { joints(q, "q")? } else { actual.q };
                Value::Pose(pose(&(self.robot.dh.flange(&q) * frame(&self.tool(tcp)?))))
            }
        })
    }

    fn answer(&mut self, call: &MachineCall<'_>) -> Result<Called> {
        let arguments = call.arguments;
        let value = match call.name {
            name if name.starts_with("socket_") => return self.socket(call),
            "servoj" | "movej" | "movel" | "speedj" | "stopj" | "stopl" => return self.moving(call),
            "sync" => {
                arguments.bind::<0>([])?;
                return Ok(Called::Cycle(Value::None));
            }
            "sleep" => {
                let [t] = arguments.bind(["t"])?;
                let cycles = self.cycles(number(t, "t")?);
                return Ok(if cycles == 0 { Called::Value(Value::None) } else { self.wait(call, cycles) });
            }
            "textmsg" => {
                let [first, second] = arguments.bind(["s1", "s2"])?;
                first.ok_or("wants something to say")?;
                let text: String = [first, second].iter().flatten().map(ToString::to_string).collect();
                self.say(text);
                Value::None
            }
            "popup" => return self.popup(call),
            "protective_stop" => {
                self.robot.protective_stop(ProtectiveReason::Asked);
                Value::None
            }
            "rtde_set_watchdog" => self.watchdog(arguments)?,
            "get_flag" | "set_flag" => self.flags(call.name, arguments)?,
            "modbus_get_signal_status" => self.modbus_status(call)?,
            "random" => {
                arguments.bind::<0>([])?;
                Value::Float(self.registers.random())
            }
            name if name.contains("_port_") => self.ports(name, arguments)?,
            name if name.starts_with("read_") || name.starts_with("write_") => {
                self.registers(name, arguments)?
            }
            name if name.contains("digital") => self.digital(name, arguments)?,
            name if name.contains("analog") => self.analog(name, arguments)?,
            // Modes that never begin end without effect; the sensor reads 0 as it is.
            name if name.contains("_mode") || name == "zero_ftsensor" => Value::None,
            name => self.state(name, arguments)?,
        };
        Ok(Called::Value(value))
    }
}

impl Machine for Hands<'_> {
    fn knows(&self, name: &str) -> bool {
        self.known(name).is_some()
    }

    fn call(&mut self, call: &MachineCall<'_>) -> Called {
        let answer = match self.known(call.name) {
            None => return Called::Unknown,
            Some(KnownAs::Missing) => Err("is not simulated".to_owned()),
            Some(KnownAs::SetUp) => self.set_up(call).map(Called::Value),
            Some(KnownAs::Simulated) => self.answer(call),
        };
        answer.unwrap_or_else(|message| Called::Failed(format!("{} {message}", call.name)))
    }

    fn pause(&mut self) {
        self.robot.paused = true;
    }

    fn spent(&mut self) -> u32 {
        std::mem::take(&mut self.spent)
    }

    fn ended(&mut self, thread: ThreadId) {
        self.waits.remove(&thread);
        self.popups.remove(&thread);
        if self.mover.is_some_and(|mover| mover.thread == thread) {
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
