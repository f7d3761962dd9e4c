//! The instructions of the stack machine that runs a script, and a whole program of them.

use super::error::ScriptPosition;
use super::tree::{Binary, Function, Sort, Unary};
use super::value::Value;

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
    EnterCritical,
    ExitCritical,
}

/// A call, made ready.
#[derive(Debug)]
pub(super) struct PreparedCall {
    /// A function's number, an own function's number, or an index into [`Program::foreign`].
    pub(super) target: u32,
    /// For functions of the program: the slot of each argument on the stack.
    pub(super) slots: Vec<u16>,
    /// For functions of the machine: the names of the last arguments.
    pub(super) names: Vec<String>,
    pub(super) arguments: usize,
}

#[derive(Debug)]
pub(super) struct CompiledFunction {
    pub(super) name: String,
    pub(super) sort: Sort,
    pub(super) entry: usize,
    /// Names of its variables, parameters first.
    pub(super) variables: Vec<String>,
}

impl CompiledFunction {
    /// Of a function that is not compiled yet.
    pub(super) fn new(function: &Function) -> Self {
        Self { name: function.name.clone(), sort: function.sort, entry: 0, variables: Vec::new() }
    }
}

/// A program ready to run.
#[derive(Debug, Default)]
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
