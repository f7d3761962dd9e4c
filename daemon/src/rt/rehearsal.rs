//! The loop without its work: how late releases come on this machine, with the rights and the rhythm of the
//! real loop.
//!
//! Contract: the thread takes its rights as the real-time thread does and waits on the same [`Cyclic`];
//! nothing is allocated, locked or written during the measurement. No port, no follower: a rehearsal commands
//! nothing.

use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;

use hdrhistogram::Histogram;

use crate::alloc_count;

use super::clock::{Clock, MonotonicClock};
use super::cyclic::Cyclic;
use super::os::{self, Missing};
use super::thread::{RtSettings, take_rights};

/// Largest delay resolved \[ns\].
const LATEST_NS: u64 = 10_000_000_000;
/// Warm-up time, not counted \[ns\].
const WARM_UP_NS: u64 = 200_000_000;

/// Results of a rehearsal.
#[derive(Debug, Clone)]
pub struct Rehearsal {
    /// From the release that was waited for to the start of the tick \[ns\], one per tick.
    pub lateness: Histogram<u64>,
    /// Whole periods that passed without a tick.
    pub missed: u64,
    /// Page faults of the thread meanwhile, without and with reading from disk.
    pub page_faults: (u64, u64),
    /// Allocations of the thread meanwhile, if the counting allocator is installed.
    pub allocations: u64,
    /// Rights that were refused.
    pub missing: Vec<Missing>,
}

/// Starts a rehearsal of `seconds` in a separate thread, optionally with the memory of the process locked; it
/// ends early once `quit` is set.
///
/// # Errors
/// The system refuses another thread or its memory.
pub fn rehearse(
    settings: RtSettings,
    lock_memory: bool,
    seconds: f64,
    quit: Arc<AtomicBool>,
) -> io::Result<JoinHandle<Rehearsal>> {
    let mut lateness = Histogram::new_with_bounds(1, LATEST_NS, 3).map_err(io::Error::other)?;
    // Touches every page of it.
    lateness.reset();
    std::thread::Builder::new().name("foretrace-rehearsal".to_owned()).stack_size(1 << 20).spawn(move || {
        let mut missing = take_rights(&settings);
        if lock_memory {
            missing.extend(os::lock_memory().err());
        }
        let mut cyclic = Cyclic::new(MonotonicClock, settings.rhythm);
        let (mut missed, mut before) = (0, None);
        let begin = cyclic.clock().now();
        let warm = begin.plus_ns(WARM_UP_NS);
        let end = warm.plus_ns((seconds.max(0.0) * 1e9) as u64);
        while !quit.load(Ordering::Acquire) {
            let wake = cyclic.wait();
            if wake.due < warm {
                continue;
            }
            if wake.due >= end {
                break;
            }
            if before.is_none() {
                before = Some((os::page_faults(), alloc_count::allocations()));
            }
            lateness.saturating_record(wake.latency_ns());
            missed += wake.skipped;
        }
        let (faults, allocations) = (os::page_faults(), alloc_count::allocations());
        let (faults_before, allocations_before) = before.unwrap_or((faults, allocations));
        let page_faults =
            (faults.0.saturating_sub(faults_before.0), faults.1.saturating_sub(faults_before.1));
        Rehearsal {
            lateness,
            missed,
            page_faults,
            allocations: allocations.saturating_sub(allocations_before),
            missing,
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rt::cyclic::Rhythm;
    use crate::rt::overruns::OverrunLimit;

    fn ordinary() -> RtSettings {
        RtSettings {
            rhythm: Rhythm { period_ns: 2_000_000, spin_ns: 0 },
            priority: None,
            cpu: None,
            max_iterations: 1,
            overruns: OverrunLimit::NONE,
        }
    }

    #[test]
    fn every_period_is_a_tick_or_missed() {
        let quit = Arc::new(AtomicBool::new(false));
        let seen = rehearse(ordinary(), false, 0.3, quit).unwrap().join().unwrap();
        // A stall at either end may hide a period at the border; no other may be lost.
        let periods = seen.lateness.len() + seen.missed;
        assert!(
            !seen.lateness.is_empty() && periods.abs_diff(150) <= 1 + seen.missed,
            "{periods}, {}",
            seen.missed
        );
        assert!(seen.lateness.min() > 0);
    }

    #[test]
    fn a_refused_right_is_told_and_the_rehearsal_runs_on() {
        let quit = Arc::new(AtomicBool::new(false));
        let settings = RtSettings { cpu: Some(100_000), ..ordinary() };
        let seen = rehearse(settings, false, 0.02, quit).unwrap().join().unwrap();
        assert_eq!(seen.missing.len(), 1);
        assert!(seen.missing[0].text.contains("CPU 100000"), "{}", seen.missing[0]);
    }

    #[test]
    fn told_to_quit_it_ends_early() {
        let quit = Arc::new(AtomicBool::new(true));
        let seen = rehearse(ordinary(), false, 3600.0, quit).unwrap().join().unwrap();
        assert_eq!((seen.lateness.len(), seen.missed), (0, 0));
    }
}
