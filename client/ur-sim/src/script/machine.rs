//! The seam to the robot: what a script asks of it, and how it answers.

use super::error::ScriptPosition;
use super::value::Value;

/// A thread of a run. Numbers are not used again within a run. A secondary program has others than the
/// program that it runs beside, so that its end is not taken for the other's.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct ThreadId(pub(super) u32);

impl ThreadId {
    pub const PROGRAM: Self = Self(0);
    /// A secondary program itself.
    pub const SECONDARY: Self = Self(1 << 31);

    /// Its number, from 0.
    #[must_use]
    pub fn number(self) -> u32 {
        self.0
    }
}

/// The arguments of a call, in the order written, then those given by name.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Arguments {
    /// Those given by position.
    pub positional: Vec<Value>,
    /// Those given by name.
    pub named: Vec<(String, Value)>,
}

impl Arguments {
    /// The arguments in the order of `parameters`; `None` where nothing was given.
    ///
    /// # Errors
    /// More arguments than parameters, a name that no parameter has, or a parameter given twice.
    pub fn bind<const N: usize>(&self, parameters: [&str; N]) -> Result<[Option<&Value>; N], String> {
        if self.positional.len() > N {
            return Err(format!("takes at most {N} arguments, not {}", self.positional.len()));
        }
        let mut bound = [None; N];
        for (position, value) in bound.iter_mut().zip(&self.positional) {
            *position = Some(value);
        }
        for (name, value) in &self.named {
            let position = parameters.iter().position(|p| p == name).and_then(|at| bound.get_mut(at));
            match position {
                None => return Err(format!("has no parameter {name}")),
                Some(Some(_)) => return Err(format!("parameter {name} is given twice")),
                Some(empty) => *empty = Some(value),
            }
        }
        Ok(bound)
    }
}

/// One question to the machine.
#[derive(Debug, Clone, Copy)]
pub struct MachineCall<'a> {
    pub thread: ThreadId,
    pub name: &'a str,
    /// What it is called with.
    pub arguments: &'a Arguments,
    /// False when the machine answered [`Called::Wait`] a cycle ago and is asked again.
    pub first: bool,
    /// Where the call stands in the script.
    pub position: ScriptPosition,
}

#[derive(Debug, Clone, PartialEq)]
pub enum Called {
    /// Done; the thread goes on in this cycle.
    Value(Value),
    /// Done, and the thread's cycle is used up: it goes on in the next one (`servoj`, `sync`).
    Cycle(Value),
    /// Not done: ask again in the next cycle (`movej`, `stopj`, `sleep`).
    Wait,
    /// There is no function of that name.
    Unknown,
    /// The call fails and with it the program, with this message.
    Failed(String),
}

/// What a script runs on.
pub trait Machine {
    /// Whether there is a function of that name. Asked when a program is loaded: a controller refuses a
    /// program that calls what it does not know, also where it would never come by.
    fn knows(&self, name: &str) -> bool;

    fn call(&mut self, call: &MachineCall<'_>) -> Called;

    /// The program says `pause`: it goes on when it is cycled again.
    fn pause(&mut self) {}

    /// What the calls since it was last asked took, in instructions, beside one for each and what their
    /// arguments hold. A machine that calculates tells it here: a program then has so many less in its cycle.
    fn spent(&mut self) -> u32 {
        0
    }

    /// A thread is over: it returned, was killed, or the program ended. What it waited for is no longer asked
    /// for.
    fn ended(&mut self, thread: ThreadId) {
        let _ = thread;
    }
}
