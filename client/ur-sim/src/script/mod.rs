//! An interpreter of URScript: text to [`Program`], and [`ScriptRun`], which executes it a control cycle at a
//! time.
//!
//! It knows no robot. What a script asks of one (motion, registers, sockets, messages) goes to a [`Machine`];
//! arithmetic, lists, poses and strings are its own (`builtins`). Everything is bounded (`limits`),
//! because scripts come from a socket.
//!
//! Source: the script manual's pages on scoping, threads, thread scheduling and secondary programs; where
//! they are silent, what the programs of `ur_rtde` and of the Universal Robots client library need.

mod limits;
mod error;
mod value;
mod machine;
mod lexer;
mod tree;
mod parser;
mod code;
mod arithmetic;
mod builtins;
mod compiler;
mod program;
mod run;
mod uploads;

pub use error::{ScriptError, ScriptPosition};
pub use machine::{Arguments, Called, Machine, MachineCall, ThreadId};
pub use program::{Program, Statements};
pub use run::{Interpreted, InterpreterState, Progress, ScriptRun};
pub use uploads::{TooLong, Uploads};
pub use value::{List, Value};
