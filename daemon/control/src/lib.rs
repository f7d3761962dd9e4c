//! The control law of foretrace as pure mathematics: pen samples in, a legal joint command out.
//!
//! Contract: no clock, thread, file, socket, shared memory or log is reachable from here. Time is an argument.
//! The same build and inputs give the same outputs, bit for bit.
//! Modules stand in the order in which data flows through one tick.

#![forbid(unsafe_code)]
#![cfg_attr(
    not(test),
    deny(
        clippy::unwrap_used,
        clippy::expect_used,
        clippy::panic,
        clippy::indexing_slicing,
        clippy::unreachable
    )
)]

pub mod units;
pub mod plane;
pub mod geometry;
pub mod stop;
pub mod pen;
pub mod predict;
pub mod learn;
pub mod skill;
pub mod trust;
mod reference;
pub mod arm;
pub mod qp;
pub mod mpc;
pub mod envelope;
pub mod clearance;
pub mod ik;
pub mod guard;
pub mod monitor;
pub mod follower;
pub mod ghost;
pub mod extent;
