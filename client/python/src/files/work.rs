//! Long work, beside the interpreter.
//!
//! Contract: the interpreter's lock is free while the work runs; Ctrl-C ends the wait at once and asks the
//! work to end. Work that cannot ask goes on in its thread until it is done, and nobody hears of it.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{RecvTimeoutError, sync_channel};
use std::time::Duration;

use pyo3::prelude::*;

use crate::problem::problem;

/// How late Ctrl-C may be heard.
const POLL: Duration = Duration::from_millis(50);
/// A whole law is too large for an ordinary stack.
const STACK_BYTES: usize = 32 << 20;

/// Whether the work is still wanted.
#[derive(Clone, Default)]
pub struct StillWanted(Arc<AtomicBool>);

impl StillWanted {
    /// False once the wait was interrupted.
    pub fn still(&self) -> bool {
        !self.0.load(Ordering::Relaxed)
    }
}

/// Runs `work` on a thread of its own and waits for it without the interpreter's lock.
///
/// # Errors
///
/// No thread can be had; KeyboardInterrupt, or whatever a signal handler raised.
pub fn apart<T: Send + 'static>(
    python: Python<'_>,
    work: impl FnOnce(&StillWanted) -> T + Send + 'static,
) -> PyResult<T> {
    let (done, mut wait) = sync_channel(1);
    let wanted = StillWanted::default();
    let own = wanted.clone();
    let begun =
        std::thread::Builder::new().name("foretrace".to_owned()).stack_size(STACK_BYTES).spawn(move || {
            // Nobody listens after an interrupt.
            let _ = done.send(work(&own));
        });
    begun.map_err(|error| problem(format_args!("no thread can be had: {error}; end other programs")))?;
    loop {
        let (back, result) = python.detach(move || {
            let result = wait.recv_timeout(POLL);
            (wait, result)
        });
        wait = back;
        match result {
            Ok(result) => return Ok(result),
            Err(RecvTimeoutError::Timeout) => python.check_signals().inspect_err(|_| {
                wanted.0.store(true, Ordering::Relaxed);
            })?,
            Err(RecvTimeoutError::Disconnected) => {
                let what = "the work ended without a result, which is a fault of foretrace: please report it \
                            with the call and its files";
                return Err(problem(what));
            }
        }
    }
}
