//! A thread: where it is, and the values that its unfinished expressions and calls hold.

use super::super::limits;
use super::super::machine::{Arguments, ThreadId};
use super::super::value::Value;

/// The compiler makes no program that takes more than it gave; this is the answer if it does.
pub(super) const EMPTY: &str = "the interpreter lost count of its values";

#[derive(Debug)]
pub(super) struct Thread {
    pub(super) id: ThreadId,
    /// The thread that started it.
    pub(super) parent: Option<ThreadId>,
    pub(super) at: usize,
    pub(super) stack: Vec<Value>,
    pub(super) calls: Vec<CallFrame>,
    /// The machine is asked again with these.
    pub(super) asking: Option<Arguments>,
    /// Waits for this thread's end.
    pub(super) joining: Option<ThreadId>,
    /// Not before the next cycle.
    pub(super) rests: bool,
    pub(super) critical: bool,
    /// Cycles in a row that were used up.
    pub(super) used_up: u32,
}

/// The variables of a call.
#[derive(Debug)]
pub(super) struct CallFrame {
    pub(super) body: usize,
    pub(super) values: Vec<Option<Value>>,
    /// The instruction after the call.
    pub(super) back: usize,
    /// How many values stood on the stack.
    pub(super) base: usize,
}

impl Thread {
    pub(super) fn give(&mut self, value: Value) -> Result<(), String> {
        if self.stack.len() >= limits::STACK {
            return Err(format!("more than {} values in open expressions", limits::STACK));
        }
        self.stack.push(value);
        Ok(())
    }

    pub(super) fn take(&mut self) -> Result<Value, String> {
        self.stack.pop().ok_or_else(|| EMPTY.to_owned())
    }

    /// The last `count` values, in the order they were given.
    pub(super) fn take_many(&mut self, count: usize) -> Result<Vec<Value>, String> {
        let from = self.stack.len().checked_sub(count).ok_or(EMPTY)?;
        Ok(self.stack.split_off(from))
    }
}
