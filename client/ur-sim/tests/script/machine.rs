//! A machine for tests: it knows a few functions, keeps what it was asked, and moves nothing.

use foretrace_ur_sim::script::{Called, Machine, MachineCall, Program, Progress, ScriptRun, ThreadId, Value};
use std::collections::HashMap;

/// Every call that was answered, as text, with the cycle and the thread's number.
#[derive(Debug, Default)]
pub(crate) struct Recorder {
    pub calls: Vec<(u32, u32, String)>,
    pub cycle: u32,
    pub ended: Vec<u32>,
    /// Register number to value; what is not there is 0.
    pub registers: HashMap<i32, Value>,
    waits: HashMap<ThreadId, u32>,
}

const KNOWN: [&str; 8] = ["textmsg", "sync", "servoj", "movej", "sleep", "read", "write", "get_steptime"];

impl Machine for Recorder {
    fn knows(&self, name: &str) -> bool {
        KNOWN.contains(&name)
    }

    fn call(&mut self, call: &MachineCall<'_>) -> Called {
        let number = |at: usize| call.arguments.positional.get(at).and_then(Value::as_integer);
        let answer = match call.name {
            "sync" | "servoj" => Called::Cycle(Value::None),
            // Both take as many cycles as they are told.
            "movej" | "sleep" => {
                if call.first {
                    self.waits
                        .insert(call.thread, number(0).and_then(|n| u32::try_from(n).ok()).unwrap_or(1));
                }
                match self.waits.get_mut(&call.thread) {
                    Some(left) if *left > 0 => {
                        *left -= 1;
                        return Called::Wait;
                    }
                    _ => Called::Value(Value::None),
                }
            }
            "read" => match number(0) {
                Some(register) => {
                    return Called::Value(
                        self.registers.get(&register).cloned().unwrap_or(Value::Integer(0)),
                    );
                }
                None => return Called::Failed("no register".to_owned()),
            },
            "write" => {
                let value = call.arguments.positional.get(1).cloned().unwrap_or(Value::None);
                self.registers.insert(number(0).unwrap_or(-1), value);
                return Called::Value(Value::None);
            }
            "get_steptime" => return Called::Value(Value::Float(0.002)),
            "textmsg" => Called::Value(Value::None),
            _ => return Called::Unknown,
        };
        let mut told: Vec<String> = call.arguments.positional.iter().map(ToString::to_string).collect();
        told.extend(call.arguments.named.iter().map(|(name, value)| format!("{name}={value}")));
        let told =
            if call.name == "textmsg" { told.concat() } else { format!("{} {}", call.name, told.join(" ")) };
        self.calls.push((self.cycle, call.thread.number(), told));
        answer
    }

    fn ended(&mut self, thread: ThreadId) {
        self.ended.push(thread.number());
    }
}

impl Recorder {
    /// Runs a program for at most so many cycles.
    pub(crate) fn run(&mut self, text: &str, cycles: u32) -> Progress {
        let program = match Program::parse(text) {
            Ok(program) => program,
            Err(error) => return Progress::Failed(error),
        };
        let mut run = match ScriptRun::new(&program, self) {
            Ok(run) => run,
            Err(error) => return Progress::Failed(error),
        };
        for _ in 0..cycles {
            self.cycle += 1;
            let progress = run.cycle(self);
            if progress != Progress::Running {
                return progress;
            }
        }
        Progress::Running
    }

    /// What `textmsg` said.
    pub(crate) fn content(&self) -> Vec<&str> {
        self.calls.iter().map(|(_, _, told)| told.trim()).collect()
    }
}

/// What a program that ends within 100 cycles says with `textmsg`.
#[track_caller]
pub(crate) fn content(text: &str) -> Vec<String> {
    let mut machine = Recorder::default();
    let progress = machine.run(text, 100);
    assert_eq!(progress, Progress::Finished, "{text}");
    machine.content().into_iter().map(str::to_owned).collect()
}

/// The value of an expression, as text.
#[track_caller]
pub(crate) fn value(expression: &str) -> String {
    content(&format!("textmsg({expression})")).concat()
}

/// The error of a program that must fail: line, column, message.
#[track_caller]
pub(crate) fn error(text: &str) -> (u32, u32, String) {
    match Recorder::default().run(text, 300) {
        Progress::Failed(error) => (error.at.line, error.at.column, error.message),
        other => panic!("{other:?} instead of an error: {text}"),
    }
}
