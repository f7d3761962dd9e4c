//! Expressions and calls to instructions. Arguments stand on the stack in the order written.

use super::super::builtins;
use super::super::code::{Op, PreparedCall};
use super::super::error::{ScriptError, ScriptPosition};
use super::super::tree::{Binary, CallExpression, Expression, Give, Sort};
use super::Compiler;

impl Compiler {
    pub(super) fn expression(&mut self, expression: &Expression) -> Result<(), ScriptError> {
        let position = expression.position;
        match &expression.what {
            Give::Value(value) => self.constant(value.clone(), position),
            Give::Name(name) => match self.variable(name) {
                Some(from) => self.simple(Op::Load(from), position),
                None => {
                    let undefined =
                        || ScriptError::new(position, format!("the variable {name} is not defined"));
                    self.constant(builtins::constant(name).ok_or_else(undefined)?, position);
                }
            },
            Give::List(elements) => {
                self.each(elements)?;
                self.simple(Op::List(u16::try_from(elements.len()).unwrap_or(u16::MAX)), position);
            }
            Give::Pose(elements) => {
                self.each(elements)?;
                self.simple(Op::Pose, position);
            }
            Give::Index(of, indices) => {
                self.expression(of)?;
                self.each(indices)?;
                self.simple(Op::Element(u8::try_from(indices.len()).unwrap_or(u8::MAX)), position);
            }
            Give::Call(asked) => self.call(asked, position)?,
            Give::Run(asked) => self.run(asked, position)?,
            Give::Unary(operator, of) => {
                self.expression(of)?;
                self.simple(Op::Unary(*operator), position);
            }
            Give::Binary(operator @ (Binary::And | Binary::Or), left, right) => {
                self.expression(left)?;
                let known = self.emit(Op::JumpIf(*operator == Binary::Or, 0), position);
                self.expression(right)?;
                // Tells a right side that is no truth value.
                self.simple(Op::Binary(*operator), position);
                self.land(known);
            }
            Give::Binary(operator, left, right) => {
                self.expression(left)?;
                self.expression(right)?;
                self.simple(Op::Binary(*operator), position);
            }
        }
        Ok(())
    }

    fn each(&mut self, expressions: &[Expression]) -> Result<(), ScriptError> {
        expressions.iter().try_for_each(|expression| self.expression(expression))
    }

    fn function_number(&self, name: &str) -> Option<usize> {
        self.levels.iter().rev().find_map(|level| level.functions.get(name).copied())
    }

    fn call(&mut self, asked: &CallExpression, position: ScriptPosition) -> Result<(), ScriptError> {
        if let Some(number) = self.function_number(&asked.name) {
            if self.code.bodies.get(number).is_some_and(|body| body.sort == Sort::Thread) {
                let message = format!("{0} is a thread: `run {0}()` starts it", asked.name);
                return Err(ScriptError::new(position, message));
            }
            let call = self.of_program(asked, number, position)?;
            self.simple(Op::Call(call), position);
            return Ok(());
        }
        self.each(&asked.positional)?;
        asked.named.iter().try_for_each(|(_, value)| self.expression(value))?;
        let arguments = asked.positional.len() + asked.named.len();
        let names: Vec<String> = asked.named.iter().map(|(name, _)| name.clone()).collect();
        if let Some(number) = builtins::find(&asked.name) {
            builtins::check(number, asked.positional.len(), &names)
                .map_err(|message| ScriptError::new(position, format!("{} {message}", asked.name)))?;
            let target = u32::try_from(number).unwrap_or(u32::MAX);
            let call = self.asked(PreparedCall { target, slots: Vec::new(), names, arguments });
            self.simple(Op::Own(call), position);
            return Ok(());
        }
        if let Some(op) = self.interpreter_op(asked, &names, arguments, position)? {
            self.simple(op, position);
            return Ok(());
        }
        let target = self.foreign_number(&asked.name, position);
        let call = self.asked(PreparedCall { target, slots: Vec::new(), names, arguments });
        self.simple(Op::Foreign(call), position);
        Ok(())
    }

    fn foreign_number(&mut self, name: &str, position: ScriptPosition) -> u32 {
        let next = self.code.foreign.len();
        let at = *self.foreign.entry(name.to_owned()).or_insert(next);
        if at == next {
            self.code.foreign.push((name.to_owned(), position));
        }
        u32::try_from(at).unwrap_or(u32::MAX)
    }

    /// The instruction for a call of interpreter mode, whose arguments are compiled already.
    fn interpreter_op(
        &mut self,
        asked: &CallExpression,
        names: &[String],
        arguments: usize,
        position: ScriptPosition,
    ) -> Result<Option<Op>, ScriptError> {
        let wrong = |message: &str| ScriptError::new(position, format!("{} {message}", asked.name));
        let op = match asked.name.as_str() {
            "interpreter_mode" if self.interpreting => {
                return Err(wrong("cannot be called in interpreter mode"));
            }
            "interpreter_mode" => {
                let names = names.to_vec();
                let call = self.asked(PreparedCall { target: 0, slots: Vec::new(), names, arguments });
                Op::Interpret(call)
            }
            "end_interpreter" | "clear_interpreter" if arguments > 0 => {
                return Err(wrong("takes no arguments"));
            }
            "end_interpreter" => Op::EndInterpreter,
            "clear_interpreter" if !self.interpreting => {
                return Err(wrong("can be called in interpreter mode only"));
            }
            "clear_interpreter" => Op::ClearInterpreter,
            _ => return Ok(None),
        };
        // Whether a controller has it is for the machine to say.
        self.foreign_number(&asked.name, position);
        Ok(Some(op))
    }

    fn run(&mut self, asked: &CallExpression, position: ScriptPosition) -> Result<(), ScriptError> {
        let number = self
            .function_number(&asked.name)
            .filter(|&number| self.code.bodies.get(number).is_some_and(|body| body.sort == Sort::Thread))
            .ok_or_else(|| ScriptError::new(position, format!("there is no thread {}", asked.name)))?;
        let call = self.of_program(asked, number, position)?;
        self.simple(Op::Run(call), position);
        Ok(())
    }

    /// The arguments of a function or thread of the program, and where each of them goes.
    fn of_program(
        &mut self,
        asked: &CallExpression,
        number: usize,
        position: ScriptPosition,
    ) -> Result<u32, ScriptError> {
        let parameters = self.code.bodies.get(number).map(|body| body.parameters.clone()).unwrap_or_default();
        let wrong = |message: String| ScriptError::new(position, format!("{} {message}", asked.name));
        if asked.positional.len() > parameters.len() {
            let message = format!("takes {} arguments, not {}", parameters.len(), asked.positional.len());
            return Err(wrong(message));
        }
        let mut slots: Vec<u16> = (0..).take(asked.positional.len()).collect();
        self.each(&asked.positional)?;
        for (name, value) in &asked.named {
            let slot = parameters.iter().position(|(parameter, _)| parameter == name);
            let slot = slot.and_then(|slot| u16::try_from(slot).ok());
            let slot = slot.ok_or_else(|| wrong(format!("has no parameter {name}")))?;
            if slots.contains(&slot) {
                return Err(wrong(format!("gets its parameter {name} twice")));
            }
            slots.push(slot);
            self.expression(value)?;
        }
        for (slot, (parameter, has_default)) in (0_u16..).zip(&parameters) {
            if !has_default && !slots.contains(&slot) {
                return Err(wrong(format!("wants an argument for {parameter}")));
            }
        }
        let target = u32::try_from(number).unwrap_or(u32::MAX);
        let arguments = slots.len();
        Ok(self.asked(PreparedCall { target, slots, names: Vec::new(), arguments }))
    }
}
