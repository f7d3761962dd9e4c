//! A program running: its threads, and how they share a cycle.
//!
//! Each thread runs until it waits (the machine says so) or has used up its instructions; then it rests until
//! the next cycle, as the manual's page on thread scheduling has it. The program's own thread is first, the
//! others follow in the order they were started; a thread that is started or that a `join` lets go runs in
//! the same cycle still. Between `enter_critical` and `exit_critical` no other thread runs, except while this
//! one waits (the manual's page on threads).

mod interpret;
mod step;
mod thread;

pub use interpret::{Interpreted, InterpreterState};

use super::code::Code;
use super::error::{ScriptError, ScriptPosition};
use super::limits;
use super::machine::{Machine, ThreadId};
use super::program::Program;
use super::value::Value;
use interpret::Interpreter;
use std::sync::Arc;
use thread::{CallFrame, Thread};

/// Where a run stands after a cycle.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Progress {
    /// It goes on in the next cycle.
    Running,
    /// The program's own thread returned, or a thread said `halt`.
    Finished,
    /// Something went wrong in a thread; that ends the program.
    Failed(ScriptError),
}

#[derive(Debug)]
pub struct ScriptRun {
    code: Arc<Code>,
    /// The program's own thread.
    own: ThreadId,
    globals: Vec<Option<Value>>,
    /// Variables of all calls.
    live: usize,
    /// In the order they were started; `None` while one runs and when it is over, until the cycle's end.
    threads: Vec<Option<Thread>>,
    /// The number of the next thread.
    next: u32,
    /// The thread whose instructions were used up between `enter_critical` and `exit_critical`.
    holder: Option<ThreadId>,
    /// Elements made since they were last counted.
    made: usize,
    /// What the present instruction costs.
    cost: u32,
    /// What the cycle has cost.
    used: u32,
    over: Option<Progress>,
    interpreter: Interpreter,
}

/// Why a thread no longer runs in this cycle.
enum ThreadStop {
    Waits,
    /// No thread runs on in this cycle.
    Pauses,
    UsedUp,
    Joins,
    Over,
    Killed,
    Halts,
}

impl ScriptRun {
    /// A run that has not begun.
    ///
    /// # Errors
    /// The program calls a function that neither it nor the machine has: a controller refuses such a program
    /// when it is loaded, which is why clients leave lines out that older versions do not know.
    pub fn new(program: &Program, machine: &dyn Machine) -> Result<Self, ScriptError> {
        if let Some((name, position)) = program.wanted().find(|(name, _)| !machine.knows(name)) {
            return Err(ScriptError::new(position, format!("there is no function {name}")));
        }
        let code = Arc::clone(&program.code);
        let own = if program.is_secondary() { ThreadId::SECONDARY } else { ThreadId::PROGRAM };
        let mut run = Self {
            globals: vec![None; code.globals.len()],
            code,
            own,
            live: 0,
            threads: Vec::new(),
            next: own.0,
            holder: None,
            made: 0,
            cost: 0,
            used: 0,
            over: None,
            interpreter: Interpreter::default(),
        };
        run.start(0, None)
            .map_err(|message| ScriptError::new(ScriptPosition { line: 1, column: 1 }, message))?;
        Ok(run)
    }

    /// Runs every thread for one cycle. After the end it gives the end again.
    pub fn cycle(&mut self, machine: &mut dyn Machine) -> Progress {
        if let Some(over) = &self.over {
            return over.clone();
        }
        self.used = 0;
        for thread in self.threads.iter_mut().flatten() {
            thread.rests = false;
        }
        let progress = match self.all_threads(machine) {
            Ok(false) if self.own == ThreadId::SECONDARY => {
                let position = self.position(self.own);
                Progress::Failed(ScriptError::new(
                    position,
                    "a secondary program must be done within a cycle",
                ))
            }
            Ok(false) => Progress::Running,
            Ok(true) => Progress::Finished,
            Err(error) => Progress::Failed(error),
        };
        self.threads.retain(Option::is_some);
        if progress != Progress::Running {
            self.end(progress.clone(), machine);
        }
        progress
    }

    /// Ends the run from outside, as an operator's stop does.
    pub fn stop(&mut self, machine: &mut dyn Machine) {
        if self.over.is_none() {
            self.end(Progress::Finished, machine);
        }
    }

    /// The line that the program's own thread is at, from 1; 0 after the end.
    #[must_use]
    pub fn line(&self) -> u32 {
        self.position(self.own).line
    }

    /// Instructions that the last cycle used up, calls at what they cost.
    #[cfg(test)]
    pub(crate) fn used(&self) -> u32 {
        self.used
    }

    /// How many threads are alive, the program's own included.
    #[must_use]
    pub fn threads(&self) -> usize {
        self.threads.iter().flatten().count()
    }

    fn end(&mut self, over: Progress, machine: &mut dyn Machine) {
        self.over = Some(over);
        for thread in std::mem::take(&mut self.threads).into_iter().flatten() {
            self.ended(thread, machine);
        }
    }

    /// Whether the program is over.
    fn all_threads(&mut self, machine: &mut dyn Machine) -> Result<bool, ScriptError> {
        let mut left = limits::STEPS_PER_CYCLE;
        if let Some(holder) = self.holder.take()
            && let Some(at) =
                self.threads.iter().position(|thread| thread.as_ref().is_some_and(|t| t.id == holder))
        {
            let over = self.turn(at, &mut left, machine)?;
            if over || self.holder.is_some() || left == 0 {
                return Ok(over);
            }
        }
        // Each round lets at least one thread make a step, and the steps are counted.
        loop {
            let mut ran = false;
            let mut at = 0;
            while at < self.threads.len() {
                if self.may_run(at) {
                    ran = true;
                    let over = self.turn(at, &mut left, machine)?;
                    if over || self.holder.is_some() || left == 0 {
                        return Ok(over);
                    }
                }
                at += 1;
            }
            if !ran {
                return Ok(false);
            }
        }
    }

    fn may_run(&self, at: usize) -> bool {
        let Some(Some(thread)) = self.threads.get(at) else { return false };
        !thread.rests && thread.joining.is_none_or(|other| !self.is_alive(other))
    }

    fn is_alive(&self, id: ThreadId) -> bool {
        self.threads.iter().flatten().any(|thread| thread.id == id)
    }

    /// Lets the thread at `at` run; whether the program is over.
    fn turn(&mut self, at: usize, left: &mut u32, machine: &mut dyn Machine) -> Result<bool, ScriptError> {
        let Some(mut thread) = self.threads.get_mut(at).and_then(Option::take) else { return Ok(false) };
        thread.joining = None;
        let stop = self.slice(&mut thread, left, machine);
        match stop {
            Ok(ThreadStop::Waits) => {
                thread.rests = true;
                thread.used_up = 0;
            }
            Ok(ThreadStop::Pauses) => {
                thread.rests = true;
                thread.used_up = 0;
                *left = 0;
            }
            Ok(ThreadStop::Joins) => thread.used_up = 0,
            Ok(ThreadStop::UsedUp) => {
                thread.rests = true;
                thread.used_up = thread.used_up.saturating_add(1);
                if thread.critical {
                    self.holder = Some(thread.id);
                }
            }
            Ok(ThreadStop::Killed) => {
                self.kill_children(thread.id, machine);
                self.ended(thread, machine);
                return Ok(false);
            }
            Ok(ThreadStop::Over) => {
                let over = thread.id == self.own;
                self.ended(thread, machine);
                return Ok(over);
            }
            Ok(ThreadStop::Halts) => {
                self.ended(thread, machine);
                return Ok(true);
            }
            Err(error) => {
                self.ended(thread, machine);
                return Err(error);
            }
        }
        let used_up = thread.used_up > limits::CYCLES_USED_UP;
        let position = self.code.positions.get(thread.at).copied().unwrap_or_default();
        if let Some(slot) = self.threads.get_mut(at) {
            *slot = Some(thread);
        }
        if used_up {
            let message = "an infinite loop: it neither moves nor calls sync or sleep";
            return Err(ScriptError::new(position, message));
        }
        Ok(false)
    }

    fn slice(
        &mut self,
        thread: &mut Thread,
        left: &mut u32,
        machine: &mut dyn Machine,
    ) -> Result<ThreadStop, ScriptError> {
        let mut steps = limits::STEPS_PER_THREAD.min(*left);
        while steps > 0 {
            let position = self.code.positions.get(thread.at).copied().unwrap_or_default();
            self.cost = 1;
            let stop = self.step(thread, machine).map_err(|message| ScriptError::new(position, message))?;
            self.used = self.used.saturating_add(self.cost);
            steps = steps.saturating_sub(self.cost);
            *left = left.saturating_sub(self.cost);
            if let Some(stop) = stop {
                return Ok(stop);
            }
        }
        Ok(ThreadStop::UsedUp)
    }

    /// Starts a thread in the function `body`; its number.
    fn start(&mut self, body: usize, parent: Option<ThreadId>) -> Result<ThreadId, String> {
        if self.threads.iter().flatten().count() >= limits::THREADS {
            return Err(format!("more than {} threads", limits::THREADS));
        }
        let code = Arc::clone(&self.code);
        let function = code.bodies.get(body).ok_or("there is no such function")?;
        let frame = self.open(body, Vec::new(), 0, 0)?;
        let id = ThreadId(self.next);
        self.next = self.next.checked_add(1).ok_or("too many threads were started")?;
        self.threads.push(Some(Thread {
            id,
            parent,
            at: function.entry,
            stack: Vec::new(),
            calls: vec![frame],
            asking: None,
            joining: None,
            rests: false,
            critical: false,
            used_up: 0,
        }));
        Ok(id)
    }

    /// The frame of a call of `body` whose first variables are these.
    fn open(
        &mut self,
        body: usize,
        values: Vec<Option<Value>>,
        back: usize,
        base: usize,
    ) -> Result<CallFrame, String> {
        let count = self.code.bodies.get(body).map_or(0, |body| body.variables.len());
        let live = self.live.saturating_add(count);
        if live > limits::LIVE_VARIABLES {
            return Err(format!("more than {} variables in all calls that are open", limits::LIVE_VARIABLES));
        }
        self.live = live;
        let mut values = values;
        values.resize(count, None);
        Ok(CallFrame { body, values, back, base })
    }

    fn kill(&mut self, id: ThreadId, machine: &mut dyn Machine) {
        let mut threads = self.threads.iter_mut();
        if let Some(slot) = threads.find(|thread| thread.as_ref().is_some_and(|thread| thread.id == id))
            && let Some(thread) = slot.take()
        {
            self.ended(thread, machine);
        }
        self.kill_children(id, machine);
    }

    /// Ends every thread that `id` started, and those that they started.
    fn kill_children(&mut self, id: ThreadId, machine: &mut dyn Machine) {
        let mut parents = vec![id];
        // Every round takes a thread away, so it ends.
        while let Some(parent) = parents.pop() {
            let mut threads = self.threads.iter_mut();
            let child = threads.find(|thread| thread.as_ref().is_some_and(|t| t.parent == Some(parent)));
            if let Some(child) = child.and_then(Option::take) {
                parents.extend([parent, child.id]);
                self.ended(child, machine);
            }
        }
    }

    fn ended(&mut self, thread: Thread, machine: &mut dyn Machine) {
        for frame in &thread.calls {
            self.live = self.live.saturating_sub(frame.values.len());
        }
        if self.holder == Some(thread.id) {
            self.holder = None;
        }
        machine.ended(thread.id);
    }

    fn position(&self, id: ThreadId) -> ScriptPosition {
        let thread = self.threads.iter().flatten().find(|thread| thread.id == id);
        thread.and_then(|thread| self.code.positions.get(thread.at)).copied().unwrap_or_default()
    }

    /// Counts what an instruction made against the bounds of time and memory.
    fn made(&mut self, weight: usize, thread: &Thread) -> Result<(), String> {
        self.cost = self.cost.saturating_add(u32::try_from(weight / 8).unwrap_or(u32::MAX));
        self.made = self.made.saturating_add(weight);
        if self.made <= limits::WEIGHT_STEP {
            return Ok(());
        }
        self.made = 0;
        let sum = |values: &mut dyn Iterator<Item = &Value>| {
            values.map(Value::weight).fold(0, usize::saturating_add)
        };
        let mut weight = sum(&mut self.globals.iter().flatten());
        for thread in self.threads.iter().flatten().chain([thread]) {
            let asking = thread
                .asking
                .iter()
                .flat_map(|asked| asked.positional.iter().chain(asked.named.iter().map(|(_, value)| value)));
            let variables = thread.calls.iter().flat_map(|frame| frame.values.iter().flatten());
            weight = weight.saturating_add(sum(&mut thread.stack.iter().chain(asking).chain(variables)));
        }
        if weight > limits::WEIGHT {
            return Err("the program's values are too large".to_owned());
        }
        Ok(())
    }
}
