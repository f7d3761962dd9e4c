//! What programs need of the machine they run on: files that are written whole or not at all, sums of files,
//! dates, child processes.
//!
//! Contract: nothing here knows of hands, arms or the law, and nothing here runs in the real-time loop. What
//! a program that ends leaves half-done is removed: [`whole::give_up`], [`children::end_all`].

#![forbid(unsafe_code)]

pub mod whole;
pub mod sha256;
pub mod calendar;
pub mod children;
