//! The bridge of `foretrace-ur` against the simulated controller: its program under the interpreter, both
//! ends in lock-step, both ends over sockets.

mod program;
mod scene;
mod sockets;
mod world;
