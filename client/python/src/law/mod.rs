//! The law without a daemon: the follower tick by tick, the guard alone, the kinematic chain.
//!
//! Contract: every number goes to the Rust calls and back as it is, so that results are theirs bit for bit.
//! What the law would refuse is an exception before it is called; the law itself never fails. Calls keep the
//! interpreter's lock: what a tick computes is bounded.

mod numbers;
mod step;
mod follower;
mod guard;
mod chain;

use pyo3::prelude::*;

pub fn add(module: &Bound<'_, PyModule>) -> PyResult<()> {
    step::add(module)?;
    follower::add(module)?;
    guard::add(module)?;
    chain::add(module)
}
