//! The real-time thread, from the operating system inwards: system calls, rhythm, tick.

#![cfg_attr(not(test), deny(clippy::indexing_slicing, clippy::unreachable))]

pub mod os;
pub mod clock;
pub mod cyclic;
pub mod external;
pub mod facts;
pub mod handover;
pub mod stops;
pub mod overruns;
pub mod tick;
pub mod thread;
pub mod rehearsal;
