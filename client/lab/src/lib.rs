//! The lab: training, ranking of predictors, closed-loop benchmarks against baselines, and the paper's
//! experiments.
//!
//! Contract: nothing here runs in the real-time loop, and no product command needs it. Data sets, paths,
//! arms, metrics and pictures come from [`foretrace_sim`]. The same seed and inputs give the same numbers on
//! any number of cores.

#![forbid(unsafe_code)]

pub mod baselines;
pub mod experiments;
pub mod process;
pub mod lockstep;
pub mod closed_loop;
pub mod prediction;
pub mod shards;
pub mod train;
pub mod sets;
pub mod plot;
mod parallel;
