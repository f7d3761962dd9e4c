//! Ctrl-C, SIGTERM and SIGHUP as a flag that loops look at. A second Ctrl-C ends the program at once.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};

use crate::failure::{Cause, Failure};

/// Set once the user wants the program to end.
#[derive(Debug, Clone)]
pub(crate) struct Interrupt(Arc<AtomicBool>);

impl Interrupt {
    /// Takes over SIGINT, SIGTERM and, for terminals that close, SIGHUP.
    pub(crate) fn listen() -> Result<Self, Failure> {
        let flag = Arc::new(AtomicBool::new(false));
        for signal in [SIGINT, SIGTERM, SIGHUP] {
            // Order matters: the first signal finds the flag down, the second one finds it up and exits.
            signal_hook::flag::register_conditional_shutdown(signal, 130, flag.clone())
                .and_then(|_| signal_hook::flag::register(signal, flag.clone()))
                .map_err(|error| Failure::failed(format_args!("cannot listen to Ctrl-C: {error}"), ""))?;
        }
        Ok(Self(flag))
    }

    pub(crate) fn is_set(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }

    /// Waits for `pause`, or until the user wants to end.
    pub(crate) fn wait(&self, pause: Duration) {
        let end = Instant::now() + pause;
        while !self.is_set() && Instant::now() < end {
            std::thread::sleep(Duration::from_millis(20).min(end - Instant::now().min(end)));
        }
    }

    /// An error if the user wants to end.
    pub(crate) fn check(&self) -> Result<(), Failure> {
        if self.is_set() { Err(Failure::new(Cause::Interrupted, "interrupted", "")) } else { Ok(()) }
    }
}
