//! Ctrl-C, Ctrl-\, SIGTERM and SIGHUP: as a flag that loops look at, or as the end of the program at once. A
//! second Ctrl-C ends it at once anyway.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use signal_hook::consts::{SIGHUP, SIGINT, SIGQUIT, SIGTERM};
use signal_hook::iterator::Signals;

use crate::failure::{Cause, Failure};
use crate::os::tie_to_parent;
use crate::output::note;

/// Who wants the program to end sends one of these. What it runs has process groups of its own, so that what
/// a terminal sends at Ctrl-C, at Ctrl-\ (SIGQUIT) and when it closes (SIGHUP) reaches nobody else.
const ENDS: [i32; 4] = [SIGINT, SIGTERM, SIGHUP, SIGQUIT];

/// Set once the user wants the program to end.
#[derive(Debug, Clone)]
pub(crate) struct Interrupt(Arc<AtomicBool>);

impl Interrupt {
    /// Takes over [`ENDS`].
    pub(crate) fn listen() -> Result<Self, Failure> {
        let flag = Arc::new(AtomicBool::new(false));
        for signal in ENDS {
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

/// For commands that only compute, run other programs and write files: [`ENDS`] end them at once, without
/// half-written files, and with the programs that they run; these end with one that is killed, too.
pub(crate) fn ends_at_once() -> Result<(), Failure> {
    foretrace_host::children::tie_with(|command| {
        tie_to_parent(command);
    });
    let refused = |error: std::io::Error| {
        Failure::failed(
            format_args!("cannot listen to Ctrl-C: {error}"),
            "free some memory, threads or files",
        )
    };
    let mut signals = Signals::new(ENDS).map_err(refused)?;
    let ends = move || {
        if signals.forever().next().is_some() {
            foretrace_host::whole::give_up();
            foretrace_host::children::end_all();
            note!("foretrace: interrupted");
            std::process::exit(i32::from(Cause::Interrupted as u8));
        }
    };
    std::thread::Builder::new().name("foretrace-signals".to_owned()).spawn(ends).map_err(refused)?;
    Ok(())
}
