//! Sections about the process: instance, loop, telemetry.

use crate::schema::{Legal::*, Presence::*, section};

section! {
    /// Which daemon this is. Two daemons on one machine need two numbers; programs that attach use the same
    /// number.
    pub struct Instance {
        /// Number of the instance; names its services and its folder.
        number: u32 = Between(0.0, 99.0), Default("0"), AtStart,
            "0; 1, 2, ... for more daemons on the same machine";
        /// Folder for the shared-memory bookkeeping, an absolute path of at most 38 bytes (sockets allow 108
        /// in all). Not set: foretrace-N in XDG_RUNTIME_DIR, else /tmp/foretrace-UID-N.
        root_dir: Option<String> = Text, Optional, AtStart, "nothing: leave it out";
    }
}

section! {
    /// The tick: its rate, how it wakes up, and the rights it asks for. Without a right the daemon runs on
    /// and reports which one is missing.
    pub struct Loop {
        /// Ticks per second. A higher rate gives fresher commands and costs processor time.
        rate_hz: u32 = OneOf(&[125.0, 250.0, 500.0, 1000.0]), Required, AtStart, "500";
        /// Time before each tick that is spent spinning instead of sleeping. More gives a steadier start of
        /// the tick and burns spin_us * rate_hz of a core.
        spin_us: u32 = Between(0.0, 200.0), Default("50"), AtStart,
            "50; 0 on a machine with one or two cores";
        /// Core that the loop is pinned to. Not set: the scheduler chooses.
        cpu: Option<u32> = Between(0.0, 1023.0), Optional, AtStart,
            "nothing: leave it out; the last core where cores are isolated (isolcpus, cpusets)";
        /// SCHED_FIFO priority of the loop.
        priority: u32 = Between(1.0, 98.0), Default("80"), AtStart,
            "80: above ordinary interrupts' threads (50)";
        /// Lock the memory of the process, so that no tick waits for a page.
        lock_memory: bool = Flag, Default("true"), AtStart, "true";
        /// Periods for which a consumer may extrapolate the last command before it brakes by itself.
        valid_periods: u32 = Between(2.0, 50.0), Default("5"), AtStart, "5";
    }
}

section! {
    /// What the daemon publishes while it runs.
    pub struct Telemetry {
        /// Every n-th tick is published as a record; 1 = every tick. Inputs for a replay are always whole.
        every_ticks: u32 = Between(1.0, 1000.0), Default("1"), AtStart, "1";
        /// Status messages per second (one more at every change of mode).
        status_hz: u32 = Between(1.0, 100.0), Default("10"), AtStart, "10";
        /// Run the ghost: what feedback alone (trust 0) would have done, tick by tick beside the loop, so
        /// that status, records and reports show what the prediction saves. Costs one more step per tick on
        /// an ordinary thread.
        ghost: bool = Flag, Default("true"), AtStart, "true; false where every core counts";
    }
}
