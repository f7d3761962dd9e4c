//! The bridge: joint commands of foretrace to a UR controller, its joints back.
//!
//! In the order that things depend on each other: registers, the program that runs on the controller, its
//! clock on ours, round trips, reactions to everything that may go wrong.

pub mod address;
pub mod registers;
pub mod program;
pub mod clock;
pub mod trip;
pub mod reason;
pub mod reaction;
pub mod target;
pub mod kinematics;
pub mod check;
pub mod pilot;
pub mod remote;
pub mod measures;
pub mod line;
pub mod upload;
pub mod link;
pub mod probe;
pub mod examine;

#[cfg(test)]
mod tests;
