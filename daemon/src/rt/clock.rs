//! The loop's clock: read it, and sleep until a given time.
//!
//! Contract: one monotonic clock \[ns\], the one with which every message is stamped. Tests use a simulated
//! clock.

use foretrace_control::units::Stamp;

use super::os;

/// A monotonic clock that can also wait.
pub trait Clock {
    /// The present time; never decreases.
    fn now(&self) -> Stamp;

    /// Returns at `instant` or somewhat later; at once when it has passed. May return early when interrupted.
    fn sleep_until(&self, instant: Stamp);
}

/// CLOCK_MONOTONIC of the host.
#[derive(Debug, Clone, Copy, Default)]
pub struct MonotonicClock;

impl Clock for MonotonicClock {
    fn now(&self) -> Stamp {
        Stamp(os::monotonic_ns())
    }

    fn sleep_until(&self, instant: Stamp) {
        os::sleep_until_ns(instant.0);
    }
}
