//! The bounds of a script. All are far above what known programs need: the largest has 50 kB.

/// Length of a program's text \[bytes\].
pub(super) const TEXT_BYTES: usize = 1 << 20;
/// Depth of an expression's tree, and so of every recursion over it.
pub(super) const EXPRESSION_DEPTH: u16 = 100;
pub(super) const BLOCK_DEPTH: u16 = 50;
/// Functions and threads that a program defines.
pub(super) const FUNCTIONS: usize = 4096;
/// Variables of one function, or of all the program as globals.
pub(super) const VARIABLES: usize = 2048;
/// Arguments of a call, parameters of a function.
pub(super) const ARGUMENTS: usize = 64;
/// Elements of a list literal.
pub(super) const LITERAL: usize = 1024;
/// Threads alive at a time, the program's own included.
pub(super) const THREADS: usize = 32;
/// Calls inside calls, in one thread.
pub(super) const CALL_DEPTH: usize = 100;
/// Variables of all calls of all threads that are alive.
pub(super) const LIVE_VARIABLES: usize = 16_384;
/// Elements of a list, those of lists inside it included.
pub(super) const LIST_ELEMENTS: usize = 4096;
pub(super) const LIST_DEPTH: u8 = 4;
/// Length of a string \[bytes\].
pub(super) const STRING_BYTES: usize = 16_384;
/// Length of a string that `str_cat` or `to_str` makes: the manual's \[bytes\].
pub(super) const MADE_STRING_BYTES: usize = 1023;
/// What all values of a run may hold, in elements (see `Value::weight`).
pub(super) const WEIGHT: usize = 1 << 20;
/// Elements made between two countings of `WEIGHT`.
pub(super) const WEIGHT_STEP: usize = 1 << 18;
/// Instructions of one thread in a cycle; then it goes on in the next, as after a frame on a controller.
pub(super) const STEPS_PER_THREAD: u32 = 10_000;
/// What starting a thread counts as.
pub(super) const STEPS_OF_RUN: u32 = 100;
/// Instructions of all threads in a cycle.
pub(super) const STEPS_PER_CYCLE: u32 = 20_000;
/// Multiplications in one product of matrices, which no cycle interrupts.
pub(super) const PRODUCT: usize = 32_768;
/// Cycles in a row that a thread may use up without waiting; then it is an infinite loop.
pub(super) const CYCLES_USED_UP: u32 = 100;
/// Values that one thread's unfinished expressions hold.
pub(super) const STACK: usize = 16_384;
/// Instructions of all statements that interpreter mode has taken and not cleared.
pub(super) const INTERPRETED: usize = 200_000;
/// Statements of interpreter mode that wait to run.
pub(super) const STATEMENTS: usize = 2_000;
/// Length of one line of statements \[bytes\].
pub(super) const STATEMENT_BYTES: usize = 64 * 1024;
