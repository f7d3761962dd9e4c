//! The tree to instructions: functions and statements. Expressions are in `expression`, names in `scope`.

mod append;
mod expression;
mod scope;

pub(super) use append::{AppendScope, append};

use super::code::{Code, CompiledFunction, Op, PreparedCall, Where};
use super::error::{ScriptError, ScriptPosition};
use super::limits;
use super::tree::{Do, Expression, Function, Scope, ScriptStatement, Sort};
use super::value::Value;
use scope::{FunctionScope, Names};
use std::collections::HashMap;

/// Compiles a program: the one `def` or `sec` of the text, or else all its statements.
pub(super) fn program(statements: Vec<ScriptStatement>) -> Result<Code, ScriptError> {
    let position = statements.first().map_or(ScriptPosition { line: 1, column: 1 }, |first| first.position);
    let mut statements = statements;
    let alone = statements.len() == 1;
    let program = match statements.pop() {
        Some(ScriptStatement { what: Do::Define(function), .. })
            if alone && function.sort != Sort::Thread =>
        {
            function
        }
        last => {
            statements.extend(last);
            Function {
                name: String::new(),
                sort: Sort::Def,
                position,
                parameters: Vec::new(),
                body: statements,
            }
        }
    };
    if let Some((name, _)) = program.parameters.first() {
        return Err(ScriptError::new(
            position,
            format!("a program has no parameters, but this one has {name}"),
        ));
    }
    let mut compiler = Compiler {
        code: Code::default(),
        globals: Names::default(),
        levels: Vec::new(),
        loops: Vec::new(),
        foreign: HashMap::new(),
        interpreting: false,
    };
    scope::globals(&program.body, &mut compiler.globals)?;
    compiler.code.bodies.push(CompiledFunction::new(&program, None));
    compiler.function(&program, 0)?;
    compiler.code.globals = compiler.globals.order;
    Ok(compiler.code)
}

struct Compiler {
    code: Code,
    globals: Names,
    /// The functions around what is being compiled, outermost first.
    levels: Vec<FunctionScope>,
    loops: Vec<Loop>,
    /// Of each function of the machine: its number in `Code::foreign`.
    foreign: HashMap<String, usize>,
    /// These are statements for a program in interpreter mode.
    interpreting: bool,
}

struct Loop {
    start: u32,
    /// Jumps to the end, which is not known yet.
    breaks: Vec<usize>,
}

impl Compiler {
    fn emit(&mut self, op: Op, position: ScriptPosition) -> usize {
        self.code.ops.push(op);
        self.code.positions.push(position);
        self.code.ops.len() - 1
    }

    /// The next instruction's address.
    fn here(&self) -> u32 {
        // A text of a megabyte makes fewer instructions than that.
        u32::try_from(self.code.ops.len()).unwrap_or(u32::MAX)
    }

    /// Makes the jump at `at` go to the next instruction.
    fn land(&mut self, at: usize) {
        let here = self.here();
        if let Some(Op::Jump(to) | Op::JumpUnless(to) | Op::JumpIf(_, to) | Op::JumpIfGiven(_, to)) =
            self.code.ops.get_mut(at)
        {
            *to = here;
        }
    }

    fn constant(&mut self, value: Value, position: ScriptPosition) {
        let number = u32::try_from(self.code.constants.len()).unwrap_or(u32::MAX);
        self.code.constants.push(value);
        self.emit(Op::Constant(number), position);
    }

    /// Keeps a call and gives its number.
    fn asked(&mut self, ready: PreparedCall) -> u32 {
        self.code.asked.push(ready);
        u32::try_from(self.code.asked.len() - 1).unwrap_or(u32::MAX)
    }

    fn function(&mut self, function: &Function, number: usize) -> Result<(), ScriptError> {
        let mut level = FunctionScope {
            variables: scope::variables(function, self.levels.is_empty(), &self.globals)?,
            functions: HashMap::new(),
        };
        let mut inside = Vec::new();
        scope::functions(&function.body, &mut inside);
        let numbers = self.declare(&inside, number, &mut level.functions, false)?;
        let (variables, functions) = (level.variables.order.clone(), level.functions.clone());
        self.levels.push(level);
        let loops = std::mem::take(&mut self.loops);
        let entry = self.code.ops.len();
        for (slot, (_, default)) in (0_u16..).zip(&function.parameters) {
            if let Some(default) = default {
                let given = self.emit(Op::JumpIfGiven(slot, 0), default.position);
                self.expression(default)?;
                self.emit(Op::Store(Where::Local(slot)), default.position);
                self.land(given);
            }
        }
        self.body(&function.body)?;
        self.constant(Value::None, function.position);
        self.emit(Op::Return, function.position);
        if let Some(body) = self.code.bodies.get_mut(number) {
            body.entry = entry;
            body.variables = variables;
            body.functions = functions;
        }
        for (number, inner) in numbers.into_iter().zip(&inside) {
            self.function(inner, number)?;
        }
        self.loops = loops;
        self.levels.pop();
        Ok(())
    }

    /// Gives the functions that stand in `parent` their numbers; a name that is taken is an error, unless it
    /// may be defined `anew`.
    fn declare(
        &mut self,
        inside: &[&Function],
        parent: usize,
        known: &mut HashMap<String, usize>,
        anew: bool,
    ) -> Result<Vec<usize>, ScriptError> {
        let mut numbers = Vec::new();
        for inner in inside {
            if inner.sort == Sort::Sec {
                let message = "a secondary program stands alone, in no other";
                return Err(ScriptError::new(inner.position, message));
            }
            let next = self.code.bodies.len();
            if next >= limits::FUNCTIONS {
                return Err(ScriptError::more_than(inner.position, limits::FUNCTIONS, "functions"));
            }
            if known.insert(inner.name.clone(), next).is_some() && !anew {
                return Err(ScriptError::new(inner.position, format!("{} is defined twice", inner.name)));
            }
            self.code.bodies.push(CompiledFunction::new(inner, Some(parent)));
            numbers.push(next);
        }
        Ok(numbers)
    }

    fn body(&mut self, body: &[ScriptStatement]) -> Result<(), ScriptError> {
        body.iter().try_for_each(|statement| self.statement(statement))
    }

    fn statement(&mut self, statement: &ScriptStatement) -> Result<(), ScriptError> {
        let position = statement.position;
        match &statement.what {
            Do::Define(_) | Do::Pass => {}
            Do::Assign { scope, name, indices, value } => {
                self.assign(*scope, name, indices, value.as_ref(), position)?
            }
            Do::If { arms, otherwise } => {
                let mut ends = Vec::new();
                for (condition, arm) in arms {
                    self.expression(condition)?;
                    let next = self.emit(Op::JumpUnless(0), condition.position);
                    self.body(arm)?;
                    ends.push(self.emit(Op::Jump(0), position));
                    self.land(next);
                }
                self.body(otherwise)?;
                ends.into_iter().for_each(|end| self.land(end));
            }
            Do::While(condition, body) => {
                let start = self.here();
                self.expression(condition)?;
                let end = self.emit(Op::JumpUnless(0), condition.position);
                self.loops.push(Loop { start, breaks: vec![end] });
                self.body(body)?;
                self.emit(Op::Jump(start), position);
                let breaks = self.loops.pop().map(|ended| ended.breaks);
                breaks.into_iter().flatten().for_each(|jump| self.land(jump));
            }
            Do::Break => {
                let jump = self.emit(Op::Jump(0), position);
                match self.loops.last_mut() {
                    Some(around) => around.breaks.push(jump),
                    None => return Err(ScriptError::new(position, "`break` outside a loop")),
                }
            }
            Do::Continue => match self.loops.last() {
                Some(around) => {
                    let start = around.start;
                    self.emit(Op::Jump(start), position);
                }
                None => return Err(ScriptError::new(position, "`continue` outside a loop")),
            },
            Do::Return(value) => {
                match value {
                    Some(value) => self.expression(value)?,
                    None => self.constant(Value::None, position),
                }
                self.emit(Op::Return, position);
            }
            Do::Kill(thread) => self.of_thread(thread, Op::Kill)?,
            Do::Join(thread) => self.of_thread(thread, Op::Join)?,
            Do::Halt => self.simple(Op::Halt, position),
            Do::Pause => self.simple(Op::Pause, position),
            Do::EnterCritical => self.simple(Op::EnterCritical, position),
            Do::ExitCritical => self.simple(Op::ExitCritical, position),
            Do::Evaluate(expression) => {
                self.expression(expression)?;
                self.emit(Op::Drop, position);
            }
        }
        Ok(())
    }

    /// The variable that `name` means here.
    fn variable(&self, name: &str) -> Option<Where> {
        scope::find(name, self.levels.last().map(|level| &level.variables), &self.globals)
    }

    fn simple(&mut self, op: Op, position: ScriptPosition) {
        self.emit(op, position);
    }

    fn of_thread(&mut self, thread: &Expression, op: Op) -> Result<(), ScriptError> {
        self.expression(thread)?;
        self.emit(op, thread.position);
        Ok(())
    }

    fn assign(
        &mut self,
        scope: Scope,
        name: &str,
        indices: &[Expression],
        value: Option<&Expression>,
        position: ScriptPosition,
    ) -> Result<(), ScriptError> {
        let Some(value) = value else { return Ok(()) };
        let to = match scope {
            Scope::Global => self.globals.get(name).map(Where::Global),
            _ => self.variable(name),
        };
        let to =
            to.ok_or_else(|| ScriptError::new(position, format!("the variable {name} is not defined")))?;
        for index in indices {
            self.expression(index)?;
        }
        self.expression(value)?;
        let op = match u8::try_from(indices.len()).unwrap_or(u8::MAX) {
            0 => Op::Store(to),
            count => Op::StoreElement(to, count),
        };
        self.emit(op, position);
        Ok(())
    }
}
