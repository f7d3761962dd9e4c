//! The rings between the daemon's threads, and the hand-over of weights through one of them, under the model
//! checker loom.
//!
//! `RUSTFLAGS="--cfg loom" cargo test -p foretrace-loom --target-dir target/loom`; without `--cfg loom` this
//! crate is empty. Contract: the code here is the shipped code (`build.rs`). Absent: crossbeam's channels,
//! which no real-time thread uses once it runs, and single flags and counters, which order nothing else.

#[cfg(loom)]
extern crate alloc;

#[cfg(loom)]
// Third-party source: its style is its author's.
#[allow(warnings, clippy::all, clippy::multiple_unsafe_ops_per_block, clippy::undocumented_unsafe_blocks)]
mod rtrb {
    include!(concat!(env!("OUT_DIR"), "/rtrb.rs"));
}

#[cfg(loom)]
#[allow(dead_code, unreachable_pub)]
mod handover {
    include!(concat!(env!("OUT_DIR"), "/handover.rs"));
}

#[cfg(all(loom, test))]
mod tests;
