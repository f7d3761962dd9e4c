//! Interpreter mode: a program waits for statements, which become part of it and run in its own thread.
//!
//! *Source*: script manual 5.11, "Interpreter Mode". Where it is silent: statements run in the thread that
//! called `interpreter_mode`, on the variables of that call; what they assign to and nobody knew is a
//! variable of the session.

use std::collections::VecDeque;
use std::sync::Arc;

use super::super::code::CodeMark;
use super::super::compiler::{self, AppendScope};
use super::super::error::ScriptError;
use super::super::limits;
use super::super::machine::{Machine, ThreadId};
use super::super::program::Statements;
use super::super::value::Value;
use super::thread::{EMPTY, Thread};
use super::{ScriptRun, ThreadStop};

/// What became of a statement that was sent.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Interpreted {
    /// It is part of the program now, with this number, from 1; it runs when those before it have.
    Taken(u32),
    /// It is none that this program can have.
    Refused(ScriptError),
    /// The program is not in interpreter mode, or about to forget what it was sent: ask again.
    Later,
}

/// What a client asks of interpreter mode: numbers of statements, 0 where there is none.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct InterpreterState {
    /// The newest statement that was taken.
    pub interpreted: u32,
    /// The newest that began to run.
    pub executed: u32,
    /// The newest that was forgotten.
    pub cleared: u32,
}

/// Interpreter mode of a run.
#[derive(Debug, Default)]
pub(super) struct Interpreter {
    state: InterpreterState,
    session: Option<InterpreterSession>,
    /// Statements of sessions before that were not to be cleared: their functions.
    kept: std::collections::HashMap<String, usize>,
    /// Statements that were sent before are to be forgotten: the session asked so when it began.
    clear_queue: bool,
}

#[derive(Debug)]
struct InterpreterSession {
    /// The instruction that waits.
    at: usize,
    /// Calls and values of the thread when it began.
    calls: usize,
    stack: usize,
    /// Variables of the call that waits.
    variables: usize,
    code: CodeMark,
    scope: AppendScope,
    /// The number of the first thread that a statement would start.
    first_thread: u32,
    clear_on_end: bool,
    ending: bool,
    /// Statements that wait to run: number and first instruction; whether they forget all.
    queue: VecDeque<(u32, usize, bool)>,
}

impl ScriptRun {
    /// Takes statements for interpreter mode.
    pub fn interpret(&mut self, statements: &Statements, machine: &dyn Machine) -> Interpreted {
        let Some(session) = &mut self.interpreter.session else { return Interpreted::Later };
        // What is sent after a `clear_interpreter` is compiled when that is done.
        let clears = session.queue.iter().any(|(.., clears)| *clears);
        if session.ending || clears || session.queue.len() >= limits::STATEMENTS {
            return Interpreted::Later;
        }
        let code = Arc::make_mut(&mut self.code);
        let mark = code.mark();
        let before = session.scope.clone();
        let entry = match compiler::append(code, &mut session.scope, statements.items()) {
            Ok(entry) => entry,
            Err(error) => return Interpreted::Refused(error),
        };
        let unknown = code.foreign_since(mark).find(|(name, _)| !machine.knows(name));
        let wrong = match unknown {
            Some((name, position)) => {
                Some(ScriptError::new(*position, format!("there is no function {name}")))
            }
            None if code.longer_than(session.code, limits::INTERPRETED) => {
                let position = statements.items().first().map(|first| first.position).unwrap_or_default();
                let message = "the interpreted statements are too long: clear_interpreter() makes room";
                Some(ScriptError::new(position, message))
            }
            None => None,
        };
        if let Some(error) = wrong {
            code.cut(mark);
            session.scope = before;
            return Interpreted::Refused(error);
        }
        let state = &mut self.interpreter.state;
        state.interpreted = state.interpreted.checked_add(1).unwrap_or(1);
        session.queue.push_back((state.interpreted, entry, statements.clears()));
        Interpreted::Taken(state.interpreted)
    }

    /// Forgets statements that were taken and have not begun; how many.
    pub fn skip_statements(&mut self) -> usize {
        let queue = self.interpreter.session.as_mut().map(|session| std::mem::take(&mut session.queue));
        queue.map_or(0, |queue| queue.len())
    }

    /// Statements that were taken and have not begun.
    #[must_use]
    pub fn unexecuted(&self) -> usize {
        self.interpreter.session.as_ref().map_or(0, |session| session.queue.len())
    }

    #[must_use]
    pub const fn interpreter_state(&self) -> InterpreterState {
        self.interpreter.state
    }

    /// Whether a session has begun that wants none of the statements sent before; tells it once.
    pub fn wants_queue_cleared(&mut self) -> bool {
        std::mem::take(&mut self.interpreter.clear_queue)
    }

    /// `interpreter_mode`: begins, runs the next statement, waits or ends.
    pub(super) fn wait_for_statement(
        &mut self,
        thread: &mut Thread,
        call: u32,
        machine: &mut dyn Machine,
    ) -> Result<Option<ThreadStop>, String> {
        let waits_here = |session: &InterpreterSession| session.at == thread.at && thread.id == self.own;
        if !self.interpreter.session.as_ref().is_some_and(waits_here) {
            self.begin_session(thread, call)?;
        }
        let Some(session) = &mut self.interpreter.session else { return Err(EMPTY.to_owned()) };
        if !session.ending {
            let Some((number, entry, _)) = session.queue.pop_front() else {
                return Ok(Some(ThreadStop::Waits));
            };
            self.interpreter.state.executed = number;
            thread.at = entry;
            return Ok(None);
        }
        if session.clear_on_end {
            self.forget_statements(thread, machine);
        }
        if let Some(session) = self.interpreter.session.take() {
            self.interpreter.kept = session.scope.functions;
        }
        thread.give(Value::None)?;
        thread.at = thread.at.saturating_add(1);
        Ok(None)
    }

    fn begin_session(&mut self, thread: &mut Thread, call: u32) -> Result<(), String> {
        if thread.id != self.own || self.interpreter.session.is_some() || self.own == ThreadId::SECONDARY {
            return Err("interpreter_mode can be called in the main thread of a program only".to_owned());
        }
        let code = Arc::clone(&self.code);
        let ready = code.asked.get(usize::try_from(call).unwrap_or(usize::MAX)).ok_or(EMPTY)?;
        let arguments = super::step::arguments(thread, ready)?;
        let wrong = |message: String| format!("interpreter_mode {message}");
        let [clear_queue, clear_end] = arguments.bind(["clearQueueOnEnter", "clearOnEnd"]).map_err(wrong)?;
        let truth = |value: Option<&Value>| match value {
            None => Ok(true),
            Some(value) => value.as_bool().ok_or_else(|| wrong("wants truth values".to_owned())),
        };
        let frame = thread.calls.last().ok_or(EMPTY)?;
        let scope = AppendScope {
            body: frame.body,
            back: u32::try_from(thread.at).unwrap_or(u32::MAX),
            variables: Vec::new(),
            functions: self.interpreter.kept.clone(),
        };
        self.interpreter.clear_queue = truth(clear_queue)?;
        self.interpreter.session = Some(InterpreterSession {
            at: thread.at,
            calls: thread.calls.len(),
            stack: thread.stack.len(),
            variables: frame.values.len(),
            code: self.code.mark(),
            scope,
            first_thread: self.next,
            clear_on_end: truth(clear_end)?,
            ending: false,
            queue: VecDeque::new(),
        });
        Ok(())
    }

    /// Makes room for the variables that statements have made.
    pub(super) fn grow_for_statements(&mut self, thread: &mut Thread) -> Result<(), String> {
        let Some(session) = &self.interpreter.session else { return Ok(()) };
        let wanted = session.variables.saturating_add(session.scope.variables.len());
        let here = thread.id == self.own && thread.calls.len() == session.calls;
        if let Some(frame) = thread.calls.last_mut().filter(|_| here)
            && frame.values.len() < wanted
        {
            self.live = self.live.saturating_add(wanted - frame.values.len());
            if self.live > limits::LIVE_VARIABLES {
                return Err(format!(
                    "more than {} variables in all calls that are open",
                    limits::LIVE_VARIABLES
                ));
            }
            frame.values.resize(wanted, None);
        }
        Ok(())
    }

    /// `end_interpreter`, of any thread.
    pub(super) fn end_session(&mut self) {
        if let Some(session) = &mut self.interpreter.session {
            session.ending = true;
        }
    }

    /// `clear_interpreter`: the thread goes back to waiting, and all that was sent is gone.
    pub(super) fn clear_session(
        &mut self,
        thread: &mut Thread,
        machine: &mut dyn Machine,
    ) -> Result<(), String> {
        if thread.id != self.own || self.interpreter.session.is_none() {
            return Err("clear_interpreter can be called in interpreter mode only".to_owned());
        }
        self.forget_statements(thread, machine);
        if let Some(session) = &self.interpreter.session {
            thread.at = session.at;
        }
        Ok(())
    }

    fn forget_statements(&mut self, thread: &mut Thread, machine: &mut dyn Machine) {
        let Some(session) = &mut self.interpreter.session else { return };
        session.queue.clear();
        session.scope.variables.clear();
        session.scope.functions = self.interpreter.kept.clone();
        let (first, calls, stack) = (session.first_thread, session.calls, session.stack);
        let (variables, code) = (session.variables, session.code);
        let started: Vec<ThreadId> = self.threads.iter().flatten().map(|thread| thread.id).collect();
        for id in started.into_iter().filter(|id| id.0 >= first) {
            self.kill(id, machine);
        }
        for gone in thread.calls.drain(calls.min(thread.calls.len())..) {
            self.live = self.live.saturating_sub(gone.values.len());
        }
        if let Some(frame) = thread.calls.last_mut() {
            self.live = self.live.saturating_sub(frame.values.len().saturating_sub(variables));
            frame.values.truncate(variables);
        }
        thread.stack.truncate(stack);
        Arc::make_mut(&mut self.code).cut(code);
        let state = &mut self.interpreter.state;
        state.cleared = state.executed;
    }
}
