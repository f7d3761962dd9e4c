//! Faults on purpose, in processes of their own over real shared memory. One test per fault, each named in
//! docs/operate/faults.md.
//!
//! While they happen, a recorder that shares no code with the control law judges every joint command. Each
//! test says how long recovery took; only hangs are asserted, never speed. FORETRACE_CHAOS_ROUNDS (default
//! 20; 300 for the long version) is how often processes are killed over all roles together,
//! FORETRACE_CHAOS_SEED the seed of the moments.

mod config;
mod damaged;
mod hostile_input;
mod kill;
mod learner;
mod leaving;
mod memory;
mod not_following;
mod peers;
mod scene;
mod signals;
mod stale;
mod stops;
mod threads;
mod ur;
