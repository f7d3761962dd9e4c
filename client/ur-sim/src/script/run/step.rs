//! One instruction.

use super::super::code::{Op, PreparedCall, Where};
use super::super::machine::{Arguments, Called, Machine, MachineCall};
use super::super::value::{List, Value};
use super::super::{arithmetic, builtins, limits};
use super::thread::{EMPTY, Thread};
use super::{ScriptRun, ThreadId, ThreadStop};
use std::sync::Arc;

fn weight<'a>(values: impl IntoIterator<Item = &'a Value>) -> usize {
    values.into_iter().map(Value::weight).fold(0, usize::saturating_add)
}

impl ScriptRun {
    /// Executes the thread's next instruction; why the thread stops, if it does. The error does not tell the
    /// position.
    pub(super) fn step(
        &mut self,
        thread: &mut Thread,
        machine: &mut dyn Machine,
    ) -> Result<Option<ThreadStop>, String> {
        let op = *self.code.ops.get(thread.at).ok_or("the program has no more instructions")?;
        match op {
            Op::Interpret(call) => return self.wait_for_statement(thread, call, machine),
            Op::ClearInterpreter => return self.clear_session(thread, machine).map(|()| None),
            // A statement of interpreter mode may have made the variable since the call began.
            Op::Load(Where::Local(_)) | Op::Store(Where::Local(_)) | Op::StoreElement(Where::Local(_), _) => {
                self.grow_for_statements(thread)?
            }
            _ => {}
        }
        let code = Arc::clone(&self.code);
        let mut next = thread.at.saturating_add(1);
        let to = |target: u32| usize::try_from(target).unwrap_or(usize::MAX);
        match op {
            Op::Constant(number) => thread.give(code.constants.get(to(number)).cloned().ok_or(EMPTY)?)?,
            Op::Load(from) => {
                let value = self.variable(thread, from)?.clone();
                let value = value
                    .ok_or_else(|| format!("the variable {} has no value yet", self.name(thread, from)))?;
                thread.give(value)?;
            }
            Op::Store(variable) => {
                let value = thread.take()?;
                *self.variable(thread, variable)? = Some(value);
            }
            Op::StoreElement(variable, count) => {
                let value = thread.take()?;
                let indices = thread.take_many(usize::from(count))?;
                let Some(of) = self.variable(thread, variable)?.take() else {
                    return Err(format!("the variable {} has no value yet", self.name(thread, variable)));
                };
                let changed = arithmetic::with_element(of, &indices, value)?;
                let made = changed.weight();
                *self.variable(thread, variable)? = Some(changed);
                self.made(made, thread)?;
            }
            Op::Drop => {
                thread.take()?;
            }
            Op::Jump(target) => next = to(target),
            Op::JumpUnless(target) => {
                if !arithmetic::truth(&thread.take()?)? {
                    next = to(target);
                }
            }
            Op::JumpIf(wanted, target) => {
                if arithmetic::truth(thread.stack.last().ok_or(EMPTY)?)? == wanted {
                    next = to(target);
                }
            }
            Op::JumpIfGiven(slot, target) => {
                if self.variable(thread, Where::Local(slot))?.is_some() {
                    next = to(target);
                }
            }
            Op::Unary(operator) => {
                let value = arithmetic::unary(operator, &thread.take()?)?;
                self.give_made(thread, value)?;
            }
            Op::Binary(operator) => {
                let (right, left) = (thread.take()?, thread.take()?);
                let value = arithmetic::binary(operator, &left, &right)?;
                let work = arithmetic::work(operator, &left, &right) / 4;
                self.cost = self.cost.saturating_add(u32::try_from(work).unwrap_or(u32::MAX));
                self.made(left.weight().saturating_add(right.weight()), thread)?;
                self.give_made(thread, value)?;
            }
            Op::List(count) => {
                let value = Value::List(List::new(thread.take_many(usize::from(count))?)?);
                self.give_made(thread, value)?;
            }
            Op::Pose => {
                let numbers = thread.take_many(6)?;
                let value = Value::List(List::new(numbers)?);
                thread.give(Value::Pose(value.as_numbers().ok_or("a pose has six numbers")?))?;
            }
            Op::Element(count) => {
                let indices = thread.take_many(usize::from(count))?;
                let of = thread.take()?;
                thread.give(arithmetic::element(&of, &indices)?)?;
            }
            Op::Own(call) => {
                let ready = code.asked.get(to(call)).ok_or(EMPTY)?;
                let arguments = thread.take_many(ready.arguments)?;
                let number = to(ready.target);
                // Unlike the operators they look at every letter and copy every element.
                self.cost = self.cost.saturating_add(u32::try_from(weight(&arguments)).unwrap_or(u32::MAX));
                let value = builtins::call(number, &arguments);
                let value = value.map_err(|message| format!("{} {message}", builtins::name(number)))?;
                self.give_made(thread, value)?;
            }
            Op::Foreign(call) => {
                let ready = code.asked.get(to(call)).ok_or(EMPTY)?;
                let name = &code.foreign.get(to(ready.target)).ok_or(EMPTY)?.0;
                let again = thread.asking.take();
                let first = again.is_none();
                let arguments = match again {
                    Some(arguments) => arguments,
                    None => arguments(thread, ready)?,
                };
                let position = code.positions.get(thread.at).copied().unwrap_or_default();
                let id = thread.id;
                let called =
                    machine.call(&MachineCall { thread: id, name, arguments: &arguments, first, position });
                let named = arguments.named.iter().map(|(_, value)| value);
                let held = weight(arguments.positional.iter().chain(named));
                self.cost = self.cost.saturating_add(machine.spent());
                self.cost = self.cost.saturating_add(u32::try_from(held).unwrap_or(u32::MAX));
                match called {
                    Called::Value(value) => self.give_made(thread, value)?,
                    Called::Cycle(value) => {
                        self.give_made(thread, value)?;
                        thread.at = next;
                        return Ok(Some(ThreadStop::Waits));
                    }
                    Called::Wait => {
                        thread.asking = Some(arguments);
                        return Ok(Some(ThreadStop::Waits));
                    }
                    Called::Unknown => return Err(format!("there is no function {name}")),
                    Called::Failed(message) => return Err(format!("{name}: {message}")),
                }
            }
            Op::Call(call) => {
                let ready = code.asked.get(to(call)).ok_or(EMPTY)?;
                if thread.calls.len() >= limits::CALL_DEPTH {
                    return Err(format!("calls are deeper than {}", limits::CALL_DEPTH));
                }
                let values = values(thread, ready)?;
                let body = to(ready.target);
                let frame = self.open(body, values, next, thread.stack.len())?;
                thread.calls.push(frame);
                next = code.bodies.get(body).ok_or(EMPTY)?.entry;
            }
            Op::Run(call) => {
                let ready = code.asked.get(to(call)).ok_or(EMPTY)?;
                self.cost = self.cost.saturating_add(limits::STEPS_OF_RUN);
                let id = self.start(to(ready.target), Some(thread.id))?;
                thread.give(Value::Thread(id))?;
            }
            Op::Return => {
                let value = thread.take()?;
                let frame = thread.calls.pop().ok_or(EMPTY)?;
                self.live = self.live.saturating_sub(frame.values.len());
                if thread.calls.is_empty() {
                    return Ok(Some(ThreadStop::Over));
                }
                thread.stack.truncate(frame.base);
                thread.give(value)?;
                next = frame.back;
            }
            Op::Kill => {
                if let Some(id) = named_thread(&thread.take()?)? {
                    if id == thread.id {
                        return Ok(Some(ThreadStop::Killed));
                    }
                    self.kill(id, machine);
                }
            }
            Op::Join => {
                let value = thread.take()?;
                if let Some(id) = named_thread(&value)? {
                    if id == thread.id {
                        return Err("a thread cannot wait for itself".to_owned());
                    }
                    if self.is_alive(id) {
                        thread.joining = Some(id);
                        thread.give(value)?;
                        return Ok(Some(ThreadStop::Joins));
                    }
                }
            }
            Op::Halt => return Ok(Some(ThreadStop::Halts)),
            Op::Pause if self.own == ThreadId::SECONDARY => {
                return Err("a secondary program cannot pause".to_owned());
            }
            Op::Pause => {
                machine.pause();
                thread.at = next;
                return Ok(Some(ThreadStop::Pauses));
            }
            Op::EnterCritical => thread.critical = true,
            Op::ExitCritical => thread.critical = false,
            Op::EndInterpreter => {
                self.end_session();
                thread.give(Value::None)?;
            }
            Op::Interpret(_) | Op::ClearInterpreter => return Err(EMPTY.to_owned()),
        }
        thread.at = next;
        Ok(None)
    }

    fn give_made(&mut self, thread: &mut Thread, value: Value) -> Result<(), String> {
        self.made(value.weight(), thread)?;
        thread.give(value)
    }

    fn variable<'a>(
        &'a mut self,
        thread: &'a mut Thread,
        at: Where,
    ) -> Result<&'a mut Option<Value>, String> {
        let variable = match at {
            Where::Global(number) => self.globals.get_mut(usize::from(number)),
            Where::Local(slot) => {
                thread.calls.last_mut().and_then(|call| call.values.get_mut(usize::from(slot)))
            }
        };
        variable.ok_or_else(|| EMPTY.to_owned())
    }

    fn name(&self, thread: &Thread, at: Where) -> &str {
        let name = match at {
            Where::Global(number) => self.code.globals.get(usize::from(number)),
            Where::Local(slot) => thread
                .calls
                .last()
                .and_then(|call| self.code.bodies.get(call.body)?.variables.get(usize::from(slot))),
        };
        name.map_or("", String::as_str)
    }
}

/// The first variables of a call, as its arguments have them.
fn values(thread: &mut Thread, ready: &PreparedCall) -> Result<Vec<Option<Value>>, String> {
    let mut values = vec![None; ready.slots.iter().map(|&slot| usize::from(slot) + 1).max().unwrap_or(0)];
    for (slot, value) in ready.slots.iter().zip(thread.take_many(ready.arguments)?) {
        if let Some(position) = values.get_mut(usize::from(*slot)) {
            *position = Some(value);
        }
    }
    Ok(values)
}

/// The arguments of a call to the machine.
pub(super) fn arguments(thread: &mut Thread, ready: &PreparedCall) -> Result<Arguments, String> {
    let mut positional = thread.take_many(ready.arguments)?;
    let by_name = positional.len().saturating_sub(ready.names.len());
    let named = ready.names.iter().cloned().zip(positional.split_off(by_name)).collect();
    Ok(Arguments { positional, named })
}

/// The thread that a value names; none for a number, with which programs begin such variables.
fn named_thread(value: &Value) -> Result<Option<ThreadId>, String> {
    match value {
        Value::Thread(id) => Ok(Some(*id)),
        Value::Integer(_) => Ok(None),
        other => Err(format!("a thread wanted, not {}", other.kind())),
    }
}
