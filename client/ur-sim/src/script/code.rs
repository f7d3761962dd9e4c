//! The instructions of the stack machine that runs a script, and a whole program of them.

use super::error::ScriptPosition;
use super::tree::{Binary, Function, Sort, Unary};
use super::value::Value;
use std::collections::HashMap;

/// Where a variable is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Where {
    Global(u16),
    /// Of the call that runs.
    Local(u16),
}

/// One instruction. "Takes" is off the stack, "gives" onto it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Op {
    Constant(u32),
    Load(Where),
    Store(Where),
    /// Takes a value and the indices before it.
    StoreElement(Where, u8),
    Drop,
    Jump(u32),
    /// Takes a truth value.
    JumpUnless(u32),
    /// Looks at the truth value on top and jumps if it is this one.
    JumpIf(bool, u32),
    /// Jumps if this variable of the call has a value: the parameter's default is not wanted.
    JumpIfGiven(u16, u32),
    Unary(Unary),
    Binary(Binary),
    /// Takes so many elements.
    List(u16),
    Pose,
    /// Takes so many indices and what they index.
    Element(u8),
    /// Takes the arguments of a [`Program::asked`] and calls.
    Call(u32),
    Run(u32),
    Own(u32),
    Foreign(u32),
    /// Takes the value that the function gives.
    Return,
    Kill,
    Join,
    Halt,
    Pause,
    EnterCritical,
    ExitCritical,
    /// Waits for statements and runs them; takes the arguments of `interpreter_mode` when it begins.
    Interpret(u32),
    EndInterpreter,
    ClearInterpreter,
}

/// A call, made ready.
#[derive(Debug, Clone)]
pub(super) struct PreparedCall {
    /// A function's number, an own function's number, or an index into [`Program::foreign`].
    pub(super) target: u32,
    /// For functions of the program: the slot of each argument on the stack.
    pub(super) slots: Vec<u16>,
    /// For functions of the machine: the names of the last arguments.
    pub(super) names: Vec<String>,
    pub(super) arguments: usize,
}

#[derive(Debug, Clone)]
pub(super) struct CompiledFunction {
    pub(super) name: String,
    pub(super) sort: Sort,
    pub(super) entry: usize,
    /// Names of its variables, parameters first.
    pub(super) variables: Vec<String>,
    /// The parameters' names, and whether they have a default.
    pub(super) parameters: Vec<(String, bool)>,
    /// The function around it.
    pub(super) parent: Option<usize>,
    /// Functions that stand in it.
    pub(super) functions: HashMap<String, usize>,
}

impl CompiledFunction {
    /// Of a function that is not compiled yet.
    pub(super) fn new(function: &Function, parent: Option<usize>) -> Self {
        Self {
            name: function.name.clone(),
            sort: function.sort,
            entry: 0,
            variables: Vec::new(),
            parameters: function
                .parameters
                .iter()
                .map(|(name, usual)| (name.clone(), usual.is_some()))
                .collect(),
            parent,
            functions: HashMap::new(),
        }
    }
}

/// A program ready to run.
#[derive(Debug, Clone, Default)]
pub(super) struct Code {
    pub(super) ops: Vec<Op>,
    /// The position of each instruction.
    pub(super) positions: Vec<ScriptPosition>,
    pub(super) constants: Vec<Value>,
    pub(super) asked: Vec<PreparedCall>,
    /// Functions of the machine, each with the position of its first call.
    pub(super) foreign: Vec<(String, ScriptPosition)>,
    /// The program itself is the first.
    pub(super) bodies: Vec<CompiledFunction>,
    /// Names of the globals.
    pub(super) globals: Vec<String>,
}

/// How long a program's lists were: what came later can be taken off again.
#[derive(Debug, Clone, Copy)]
pub(super) struct CodeMark([usize; 5]);

impl Code {
    pub(super) fn mark(&self) -> CodeMark {
        let Self { ops, constants, asked, foreign, bodies, .. } = self;
        CodeMark([ops.len(), constants.len(), asked.len(), foreign.len(), bodies.len()])
    }

    /// The functions of the machine that are wanted since the mark.
    pub(super) fn foreign_since(
        &self,
        CodeMark([_, _, _, foreign, _]): CodeMark,
    ) -> impl Iterator<Item = &(String, ScriptPosition)> {
        self.foreign.iter().skip(foreign)
    }

    /// Whether there are more than `most` instructions or functions since the mark.
    pub(super) fn longer_than(&self, CodeMark([ops, _, _, _, bodies]): CodeMark, most: usize) -> bool {
        self.ops.len().saturating_sub(ops) > most || self.bodies.len().saturating_sub(bodies) > most
    }

    /// Takes off what came after the mark.
    pub(super) fn cut(&mut self, CodeMark([ops, constants, asked, foreign, bodies]): CodeMark) {
        self.ops.truncate(ops);
        self.positions.truncate(ops);
        self.constants.truncate(constants);
        self.asked.truncate(asked);
        self.foreign.truncate(foreign);
        self.bodies.truncate(bodies);
    }
}
