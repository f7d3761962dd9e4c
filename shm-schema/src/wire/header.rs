//! The header that begins every message, and the receiver's check of it.
//!
//! Contract: [`HeaderCheck::admit`] depends on its own memory only, allocates nothing and accepts a message
//! only if it was stamped under this boot, not in the future, not too old, and after the previous one of its
//! sender.

use iceoryx2::prelude::ZeroCopySend;

use super::check::Rejection;
use super::layout::wire;
use super::vocabulary::RejectReason;

wire! {
    /// First field of every message.
    "foretrace.HeaderV1"
    pub struct Header {
        /// Sequence number of the message of its publisher, from 1.
        pub sequence: u64,
        /// Monotonic clock \[ns\]: when it was sent, except for commands (see `JointCommand`).
        pub stamp_ns: u64,
        /// The sender's `host_boot_id()`.
        pub boot_id: u64,
    }
}

impl Header {
    /// Age at `now_ns` \[ns\]; zero for stamps in the future.
    pub fn age_ns(&self, now_ns: u64) -> u64 {
        now_ns.saturating_sub(self.stamp_ns)
    }
}

/// Tolerances of a receiver for headers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct HeaderBounds {
    /// How far a stamp may lie after the receiver's clock \[ns\].
    pub future_ns: u64,
    /// How old a stamp may be \[ns\]; `u64::MAX` for any age.
    pub age_ns: u64,
}

impl HeaderBounds {
    /// Any age, at most 10 ms ahead.
    pub const DEFAULT: Self = Self { future_ns: 10_000_000, age_ns: u64::MAX };
}

/// The receiver's memory of one stream of headers.
///
/// A lower sequence number with a later stamp is a new sender (restart) and accepted; with an earlier stamp
/// it is a leftover of an old one and refused.
#[derive(Debug, Clone, Copy)]
pub struct HeaderCheck {
    boot_id: u64,
    bounds: HeaderBounds,
    last: Option<Header>,
    dropped: u64,
    restarts: u64,
}

impl HeaderCheck {
    /// Accepts only messages stamped under `boot_id`.
    pub fn new(boot_id: u64, bounds: HeaderBounds) -> Self {
        Self { boot_id, bounds, last: None, dropped: 0, restarts: 0 }
    }

    /// Admits or refuses `header` at `now_ns`, and remembers it if admitted.
    ///
    /// # Errors
    ///
    /// `ForeignBoot`, `FromTheFuture`, `TooOld`, `Replayed`, `TimeBackwards`.
    pub fn admit(&mut self, header: &Header, now_ns: u64) -> Result<(), Rejection> {
        let refuse = |reason, field, value, bound| Err(Rejection::new(reason, field).because(value, bound));
        let seconds = |ns: u64| ns as f64 * 1e-9;
        if header.boot_id != self.boot_id {
            return refuse(RejectReason::ForeignBoot, "boot_id", f64::NAN, f64::NAN);
        }
        let ahead_ns = header.stamp_ns.saturating_sub(now_ns);
        if ahead_ns > self.bounds.future_ns {
            let bound_s = seconds(self.bounds.future_ns);
            return refuse(RejectReason::FromTheFuture, "stamp_ns", seconds(ahead_ns), bound_s);
        }
        let age_ns = header.age_ns(now_ns);
        if age_ns > self.bounds.age_ns {
            return refuse(RejectReason::TooOld, "stamp_ns", seconds(age_ns), seconds(self.bounds.age_ns));
        }
        if let Some(last) = self.last {
            let newer = header.sequence > last.sequence;
            if newer && header.stamp_ns < last.stamp_ns {
                let back_s = seconds(last.stamp_ns - header.stamp_ns);
                return refuse(RejectReason::TimeBackwards, "stamp_ns", back_s, 0.0);
            }
            if !newer && header.stamp_ns <= last.stamp_ns {
                let (sequence, seen) = (header.sequence as f64, last.sequence as f64);
                return refuse(RejectReason::Replayed, "sequence", sequence, seen);
            }
            let lost = if newer {
                header.sequence - last.sequence - 1
            } else {
                self.restarts = self.restarts.saturating_add(1);
                header.sequence.saturating_sub(1)
            };
            self.dropped = self.dropped.saturating_add(lost);
        }
        self.last = Some(*header);
        Ok(())
    }

    /// Messages missing in the sequence so far.
    pub fn dropped(&self) -> u64 {
        self.dropped
    }

    /// How often a new sender took over.
    pub fn restarts(&self) -> u64 {
        self.restarts
    }

    /// The newest admitted header.
    pub fn last(&self) -> Option<Header> {
        self.last
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const BOOT: u64 = 7;

    fn header(sequence: u64, stamp_ns: u64) -> Header {
        Header { sequence, stamp_ns, boot_id: BOOT }
    }

    fn check() -> HeaderCheck {
        HeaderCheck::new(BOOT, HeaderBounds { future_ns: 10, age_ns: 1000 })
    }

    fn reason(result: Result<(), Rejection>) -> RejectReason {
        result.unwrap_err().reason
    }

    #[test]
    fn a_gap_in_the_sequence_is_counted_as_dropped() {
        let mut check = check();
        for sequence in [5, 6, 9] {
            check.admit(&header(sequence, 100 + sequence), 110).unwrap();
        }
        assert_eq!((check.dropped(), check.restarts()), (2, 0));
    }

    #[test]
    fn foreign_boot_future_and_old_stamps_are_refused() {
        let mut check = check();
        assert_eq!(
            reason(check.admit(&Header { boot_id: 8, ..header(1, 100) }, 100)),
            RejectReason::ForeignBoot
        );
        assert_eq!(reason(check.admit(&header(1, 111), 100)), RejectReason::FromTheFuture);
        assert_eq!(reason(check.admit(&header(1, 100), 1101)), RejectReason::TooOld);
        check.admit(&header(1, 110), 100).unwrap();
        check.admit(&header(2, 110), 1110).unwrap();
    }

    #[test]
    fn replay_is_refused_and_time_may_not_run_backwards() {
        let mut check = check();
        check.admit(&header(3, 100), 100).unwrap();
        assert_eq!(reason(check.admit(&header(3, 100), 100)), RejectReason::Replayed);
        assert_eq!(reason(check.admit(&header(2, 99), 100)), RejectReason::Replayed);
        assert_eq!(reason(check.admit(&header(4, 99), 100)), RejectReason::TimeBackwards);
        check.admit(&header(4, 100), 100).unwrap();
    }

    #[test]
    fn a_restarted_sender_is_accepted_and_its_lost_beginning_counted() {
        let mut check = check();
        check.admit(&header(500, 100), 100).unwrap();
        check.admit(&header(3, 200), 200).unwrap();
        assert_eq!((check.dropped(), check.restarts()), (2, 1));
        assert_eq!(reason(check.admit(&header(501, 101), 200)), RejectReason::TimeBackwards);
    }

    #[test]
    fn extreme_numbers_neither_panic_nor_stick() {
        let mut check = HeaderCheck::new(BOOT, HeaderBounds { future_ns: u64::MAX, age_ns: u64::MAX });
        check.admit(&header(0, 0), 0).unwrap();
        check.admit(&header(u64::MAX, 1), 0).unwrap();
        check.admit(&header(1, 2), 0).unwrap();
        assert_eq!(check.dropped(), u64::MAX - 1);
    }

    #[test]
    fn the_same_number_with_a_later_stamp_is_another_sender() {
        let mut check = check();
        check.admit(&header(3, 100), 100).unwrap();
        check.admit(&header(3, 101), 101).unwrap();
        assert_eq!((check.dropped(), check.restarts(), check.last()), (2, 1, Some(header(3, 101))));
        assert_eq!(HeaderCheck::new(BOOT, HeaderBounds::DEFAULT).last(), None);
    }

    #[test]
    fn refusals_carry_seconds_and_leave_the_memory_as_it_was() {
        let second = 1_000_000_000;
        let bounds = HeaderBounds { future_ns: second, age_ns: 4 * second };
        let mut check = HeaderCheck::new(BOOT, bounds);
        let evidence = |result: Result<(), Rejection>| {
            let refused = result.unwrap_err();
            [refused.value, refused.bound].map(|seconds| (seconds * 10.0).round() / 10.0)
        };
        assert_eq!(evidence(check.admit(&header(1, 13 * second), 10 * second)), [3.0, 1.0]);
        assert_eq!(evidence(check.admit(&header(1, 3 * second), 10 * second)), [7.0, 4.0]);
        check.admit(&header(5, 10 * second), 10 * second).unwrap();
        assert_eq!(evidence(check.admit(&header(6, 8 * second), 10 * second)), [2.0, 0.0]);
        assert_eq!(evidence(check.admit(&header(4, 9 * second), 10 * second)), [4.0, 5.0]);
        assert_eq!((check.last(), check.dropped()), (Some(header(5, 10 * second)), 0));
    }

    #[test]
    fn ages_count_from_the_stamp_and_are_zero_before_it() {
        assert_eq!([90, 100, 140].map(|now_ns| header(1, 100).age_ns(now_ns)), [0, 0, 40]);
        assert_eq!(HeaderBounds::DEFAULT, HeaderBounds { future_ns: 10_000_000, age_ns: u64::MAX });
    }
}
