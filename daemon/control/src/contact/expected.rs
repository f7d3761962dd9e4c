//! The motion that the arm makes of its commands, and so the torques that it should need.
//!
//! Contract: pure, no allocation, bounded work. Every joint is a critically damped filter of second order
//! with the arm's measured group delay, exact between commands; its acceleration is smooth without any
//! difference being taken. An arm with another response needs other torques for the length of a stroke's
//! corner, not for longer: both sides are smoothed before they are compared.

use crate::state::state;
use crate::units::Stamp;

/// Filtered commands kept: 32 ms at 1000 Hz, 64 ms at 500.
const KEPT: usize = 32;
/// A longer gap between commands begins anew \[s\].
const GAP_S: f64 = 0.1;
/// Least group delay that is filtered \[s\].
const LEAST_S: f64 = 0.004;

/// Where the joints should be at one instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Motion<const J: usize> {
    stamp: Stamp,
    /// \[rad\]
    q: [f64; J],
    /// \[rad/s\]
    pub(super) qd: [f64; J],
    /// [rad/s²]
    pub(super) qdd: [f64; J],
    /// The tool was told to be in free space.
    pub(super) free: bool,
}

state! { whole [const J: usize] Motion<J> { stamp, q, qd, qdd, free } }

/// The filter and its recent past.
#[derive(Debug, Clone)]
pub(super) struct Expected<const J: usize> {
    ring: [Motion<J>; KEPT],
    /// Entries written so far.
    count: usize,
    /// The newest command \[rad\].
    command: [f64; J],
}

state! { [const J: usize] Expected<J> { ring, count, command } }

impl<const J: usize> Expected<J> {
    pub(super) const fn new() -> Self {
        let nothing = Motion { stamp: Stamp(0), q: [0.0; J], qd: [0.0; J], qdd: [0.0; J], free: false };
        Self { ring: [nothing; KEPT], count: 0, command: [0.0; J] }
    }

    /// The arm was told to be at `q` \[rad\] at `stamp`; it follows with the group delay `lag_s` \[s\].
    pub(super) fn commanded(&mut self, stamp: Stamp, q: &[f64; J], lag_s: f64, free: bool) {
        let dt = self.newest().map(|newest| stamp.since(newest.stamp) as f64 * 1e-9);
        let next = match (self.newest(), dt) {
            (Some(_), Some(dt)) if dt <= 0.0 => return,
            (Some(newest), Some(dt)) if dt <= GAP_S => self.followed(newest, stamp, q, dt, lag_s, free),
            _ => {
                self.count = 0;
                Motion { stamp, q: *q, qd: [0.0; J], qdd: [0.0; J], free }
            }
        };
        if let Some(place) = self.ring.get_mut(self.count % KEPT) {
            *place = next;
        }
        self.count = self.count.wrapping_add(1).max(1);
        self.command = *q;
    }

    /// Nothing is known: another stream of commands begins.
    pub(super) fn forget(&mut self) {
        self.count = 0;
    }

    fn newest(&self) -> Option<&Motion<J>> {
        self.ring.get(self.count.checked_sub(1)? % KEPT)
    }

    /// ÿ = ω²(p − y) − 2ωẏ over `dt` in which the command p moved on a straight line; exact.
    fn followed(
        &self,
        from: &Motion<J>,
        stamp: Stamp,
        to: &[f64; J],
        dt: f64,
        lag_s: f64,
        free: bool,
    ) -> Motion<J> {
        let omega = 2.0 / lag_s.max(LEAST_S);
        let decay = (-omega * dt).exp();
        let mut next = Motion { stamp, free, ..*from };
        let joints = next.q.iter_mut().zip(&mut next.qd).zip(&mut next.qdd);
        for (((q, qd), qdd), (before, to)) in joints.zip(self.command.iter().zip(to)) {
            let slope = (to - before) / dt;
            let behind = 2.0 / omega * slope;
            let (e, ed) = (*q - (before - behind), *qd - slope);
            *q = to - behind + (e + (ed + omega * e) * dt) * decay;
            *qd = slope + (ed - omega * (ed + omega * e) * dt) * decay;
            *qdd = omega * omega * (to - *q) - 2.0 * omega * *qd;
        }
        next
    }

    /// Where the joints should have been at `stamp`; `None` before the first command or after the last one,
    /// or too long ago.
    pub(super) fn at(&self, stamp: Stamp) -> Option<Motion<J>> {
        let entries = self.count.min(KEPT);
        let mut later = self.newest().filter(|newest| newest.stamp >= stamp)?;
        for back in 2..=entries {
            let earlier = self.ring.get(self.count.checked_sub(back)? % KEPT)?;
            if earlier.stamp <= stamp {
                let length = later.stamp.since(earlier.stamp) as f64;
                let share = if length > 0.0 { stamp.since(earlier.stamp) as f64 / length } else { 1.0 };
                let mut at = *earlier;
                at.stamp = stamp;
                let ends = later.qd.iter().zip(&later.qdd);
                for ((qd, qdd), (qd_later, qdd_later)) in at.qd.iter_mut().zip(&mut at.qdd).zip(ends) {
                    *qd += (qd_later - *qd) * share;
                    *qdd += (qdd_later - *qdd) * share;
                }
                at.free &= later.free;
                return Some(at);
            }
            later = earlier;
        }
        None
    }
}
