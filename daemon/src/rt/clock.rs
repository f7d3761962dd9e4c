//! What the loop knows of time: read it, and sleep until an instant of it.
//!
//! Contract: one monotonic clock \[ns\], the one every message is stamped with. Tests put a simulated clock
//! here.

use foretrace_control::units::Stamp;

use super::os;

/// A monotonic clock that can also wait.
pub trait Clock {
    /// The present instant; never goes backwards.
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
