//! Port 30020, where a running program in interpreter mode is sent statements.
//!
//! Contract: bounded; every line has one answer, `ack: ID: LINE`, `discard: WHY: LINE` or `state: NUMBER:
//! LINE`, in the order of the lines but for the commands that are obeyed as soon as they come.
//!
//! *Source*: script manual 5.11, "Interpreter Mode". It does not say what answers a line that waits for
//! interpreter mode and is cleared: here it is discarded.

use super::motion::RobotMotion;
use super::statements::InterpreterLine;
use super::world::World;
use crate::script::Interpreted;

/// Lines that wait for interpreter mode.
const MOST_WAITING: usize = 500;
/// How hard a motion that is aborted is braked \[rad/s²\].
const ABORT_RADPS2: f64 = 4.0;

impl World {
    /// Takes a line of port 30020.
    pub fn interpret(&mut self, line: InterpreterLine) {
        if !self.remote {
            line.discard("the robot is not in remote control");
            return;
        }
        let Some(run) = self.run() else {
            line.discard("Program is not running");
            return;
        };
        let state = run.interpreter_state();
        match line.text.as_str() {
            "statelastexecuted" => line.say("state", &state.executed.to_string()),
            "statelastinterpreted" => line.say("state", &state.interpreted.to_string()),
            "statelastcleared" => line.say("state", &state.cleared.to_string()),
            "stateunexecuted" => {
                let waiting = run.unexecuted() + self.interpreter.waiting.len();
                line.say("state", &waiting.to_string());
            }
            "skipbuffer" => {
                run.skip_statements();
                self.clear_statements("skipped");
                line.say("ack", &state.interpreted.to_string());
            }
            "abort" => {
                if matches!(self.robot.motion, RobotMotion::Line(_) | RobotMotion::Straight { .. }) {
                    self.robot.brake(ABORT_RADPS2);
                }
                line.say("ack", &state.interpreted.to_string());
            }
            _ if self.interpreter.waiting.len() >= MOST_WAITING => line.discard("too many statements wait"),
            _ => {
                self.interpreter.waiting.push_back(line);
                self.hand_on_statements();
            }
        }
    }

    /// Gives the program what it can take of what waits.
    pub(super) fn hand_on_statements(&mut self) {
        if self.interpreter.waiting.is_empty() {
            return;
        }
        if self.run().is_none() {
            self.clear_statements("Program is not running");
            return;
        }
        while let Some(line) = self.interpreter.waiting.pop_front() {
            let taken = match &line.read {
                Ok(statements) => self.take_statements(statements),
                Err(error) => Interpreted::Refused(error.clone()),
            };
            match taken {
                Interpreted::Taken(number) => line.say("ack", &number.to_string()),
                Interpreted::Refused(error) => line.discard(&error.to_string()),
                Interpreted::Later => {
                    self.interpreter.waiting.push_front(line);
                    return;
                }
            }
        }
    }

    /// After a cycle of the program: it may have begun interpreter mode and want nothing sent before.
    pub(super) fn begin_interpreting(&mut self) {
        if self.run().is_some_and(crate::script::ScriptRun::wants_queue_cleared) {
            self.clear_statements("cleared when interpreter mode began");
        }
        self.hand_on_statements();
    }

    fn clear_statements(&mut self, why: &str) {
        self.interpreter.waiting.drain(..).for_each(|line| line.discard(why));
    }
}
