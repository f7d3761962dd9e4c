//! The flag by which a stop reaches the loop without ring, request or memory: set by the stop socket's thread
//! and by SIGUSR1, read by every tick.
//!
//! Contract: a requested stop is taken by exactly one tick, the next that begins; several requests before
//! that by the same one. Only that tick resets it, so arming cannot lose one. Neither side waits or
//! allocates.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, AtomicU64, Ordering};

use foretrace_control::follower::Mode;
use foretrace_control::units::{Stamp, Trust};

use crate::wire;

/// Shared by those who request a stop and the loop.
#[derive(Debug, Default)]
pub struct StopFlag {
    /// Stops requested at the socket.
    asked: AtomicU64,
    /// A signal came; signal handlers can set no more than this.
    signalled: Arc<AtomicBool>,
    /// How many of `asked` were taken. Written last: its reader sees the fields that belong to it.
    taken: AtomicU64,
    mode: AtomicU32,
    trust: AtomicU64,
    /// Signals taken, for the log.
    signals: AtomicU64,
}

/// Number of the newest stop that a tick has taken, to be reported to those who wait.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct StopTicket(u64);

impl StopFlag {
    /// Requests a stop; returns its number.
    pub fn ask(&self) -> u64 {
        self.asked.fetch_add(1, Ordering::AcqRel).wrapping_add(1)
    }

    /// The flag for a signal handler.
    #[must_use]
    pub fn signal(&self) -> Arc<AtomicBool> {
        self.signalled.clone()
    }

    /// Mode and trust after the tick that took stop `number`, if one has.
    #[must_use]
    pub fn outcome(&self, number: u64) -> Option<(u32, f64)> {
        (self.taken.load(Ordering::Acquire) >= number)
            .then(|| (self.mode.load(Ordering::Relaxed), f64::from_bits(self.trust.load(Ordering::Relaxed))))
    }

    /// Stops taken: requested at the socket, and by signal.
    #[must_use]
    pub fn counts(&self) -> (u64, u64) {
        (self.taken.load(Ordering::Acquire), self.signals.load(Ordering::Relaxed))
    }

    /// For the loop, once per tick: whether a stop was requested since the last call.
    pub fn take(&self) -> Option<StopTicket> {
        let asked = self.asked.load(Ordering::Acquire);
        // The swap alone would be enough, but writes to the cache line in every tick.
        let signalled =
            self.signalled.load(Ordering::Relaxed) && self.signalled.swap(false, Ordering::AcqRel);
        if signalled {
            self.signals.fetch_add(1, Ordering::Relaxed);
        }
        // Only the loop writes `taken`.
        (signalled || asked != self.taken.load(Ordering::Relaxed)).then_some(StopTicket(asked))
    }

    /// For the loop: publishes the result of the stop.
    pub fn report(&self, ticket: StopTicket, mode: Mode, trust: Trust) {
        self.mode.store(wire::mode(mode).into(), Ordering::Relaxed);
        self.trust.store(trust.alpha().to_bits(), Ordering::Relaxed);
        self.taken.store(ticket.0, Ordering::Release);
    }
}

/// The loop's side: the flag, and when the newest stop came.
#[derive(Debug, Default)]
pub struct Stops {
    flag: Arc<StopFlag>,
    newest: Stamp,
}

impl Stops {
    /// Reads `flag`.
    #[must_use]
    pub const fn new(flag: Arc<StopFlag>) -> Self {
        Self { flag, newest: Stamp(0) }
    }

    /// Reads the flag; `now` is a reading of the clock after the look at the requests.
    pub fn look(&mut self, now: Stamp) -> Option<StopTicket> {
        let taken = self.flag.take();
        if taken.is_some() {
            self.newest = now;
        }
        taken
    }

    /// When the newest stop was taken; earlier requests may not undo it.
    #[must_use]
    pub const fn newest(&self) -> Stamp {
        self.newest
    }

    /// Publishes the result for those who wait.
    pub fn report(&self, ticket: Option<StopTicket>, mode: Mode, trust: Trust) {
        if let Some(ticket) = ticket {
            self.flag.report(ticket, mode, trust);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_stop_is_taken_once_and_reported() {
        let flag = StopFlag::default();
        assert_eq!(flag.take(), None);
        let (first, second) = (flag.ask(), flag.ask());
        assert_eq!(flag.outcome(first), None);
        let taken = flag.take().unwrap();
        flag.report(taken, Mode::Stopped, Trust::new(0.25));
        for number in [first, second] {
            assert_eq!(flag.outcome(number), Some((wire::mode(Mode::Stopped).into(), 0.25)));
        }
        assert_eq!((flag.take(), flag.counts()), (None, (2, 0)));
    }

    #[test]
    fn a_stop_that_comes_while_another_is_carried_out_is_not_lost() {
        let flag = StopFlag::default();
        flag.ask();
        let taken = flag.take().unwrap();
        let late = flag.ask();
        flag.report(taken, Mode::Stopped, Trust::NONE);
        assert_eq!(flag.outcome(late), None);
        let taken = flag.take().unwrap();
        flag.report(taken, Mode::Stopped, Trust::NONE);
        assert!(flag.outcome(late).is_some());
    }

    #[test]
    fn a_signal_is_taken_like_a_frame() {
        let flag = StopFlag::default();
        flag.signal().store(true, Ordering::Relaxed);
        let taken = flag.take().unwrap();
        flag.report(taken, Mode::Idle, Trust::NONE);
        assert_eq!((flag.take(), flag.counts()), (None, (0, 1)));
    }
}
