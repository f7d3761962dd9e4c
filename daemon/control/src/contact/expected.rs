//! The motion that the arm makes of its commands, and so the torques that it should need.
//!
//! Contract: pure, no allocation, bounded work. Every joint is a critically damped filter of second order
//! with the arm's measured group delay, exact between commands; its acceleration is smooth without any
//! difference being taken. An arm with another response needs other torques for the length of a stroke's
//! corner, not for longer: both sides are smoothed before they are compared.

#![expect(clippy::indexing_slicing, reason = "indices run over the joints, the length of every array")]

use crate::history::History;
use crate::state::state;
use crate::units::Stamp;

/// Filtered commands kept: 32 ms at 1000 Hz, 64 ms at 500.
const KEPT: usize = 32;
/// A longer gap between commands begins again \[s\].
const GAP_S: f64 = 0.1;
/// Least group delay that is filtered \[s\].
const LEAST_S: f64 = 0.004;

/// Where the joints should be at one instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct ExpectedMotion<const J: usize> {
    stamp: Stamp,
    /// \[rad\]
    q: [f64; J],
    /// \[rad/s\]
    pub(super) qd: [f64; J],
    /// [rad/s²]
    pub(super) qdd: [f64; J],
    /// The tool was commanded into free space.
    pub(super) free: bool,
}

state! { whole [const J: usize] ExpectedMotion<J> { stamp, q, qd, qdd, free } }

/// The filter and its recent past.
#[derive(Debug, Clone)]
pub(super) struct ExpectedJoints<const J: usize> {
    motions: History<ExpectedMotion<J>, KEPT>,
    /// The newest command \[rad\].
    command: [f64; J],
}

state! { [const J: usize] ExpectedJoints<J> { motions, command } }

impl<const J: usize> ExpectedJoints<J> {
    pub(super) const fn new() -> Self {
        let (q, qd, qdd) = ([0.0; J], [0.0; J], [0.0; J]);
        let nothing = ExpectedMotion { stamp: Stamp(0), q, qd, qdd, free: false };
        Self { motions: History::new(nothing), command: [0.0; J] }
    }

    /// The arm was commanded to `q` \[rad\] at `stamp`; it follows with the group delay `lag_s` \[s\].
    pub(super) fn commanded(&mut self, stamp: Stamp, q: &[f64; J], lag_s: f64, free: bool) {
        let newest = self.motions.back(0).copied();
        let dt = newest.map_or(f64::INFINITY, |newest| stamp.since(newest.stamp) as f64 * 1e-9);
        let next = match newest {
            Some(_) if dt <= 0.0 => return,
            Some(newest) if dt <= GAP_S => self.followed(&newest, stamp, q, dt, lag_s, free),
            _ => {
                self.forget();
                ExpectedMotion { stamp, q: *q, qd: [0.0; J], qdd: [0.0; J], free }
            }
        };
        self.motions.push(next);
        self.command = *q;
    }

    /// Nothing is known: another stream of commands begins.
    pub(super) fn forget(&mut self) {
        self.motions.restart(0);
    }

    /// ÿ = ω²(p − y) − 2ωẏ over `dt` in which the command p moved on a straight line; exact.
    fn followed(
        &self,
        from: &ExpectedMotion<J>,
        stamp: Stamp,
        to: &[f64; J],
        dt: f64,
        lag_s: f64,
        free: bool,
    ) -> ExpectedMotion<J> {
        let omega = 2.0 / lag_s.max(LEAST_S);
        let decay = (-omega * dt).exp();
        let mut next = ExpectedMotion { stamp, free, ..*from };
        for j in 0..J {
            let slope = (to[j] - self.command[j]) / dt;
            let behind = 2.0 / omega * slope;
            let (e, ed) = (from.q[j] - (self.command[j] - behind), from.qd[j] - slope);
            next.q[j] = to[j] - behind + (e + (ed + omega * e) * dt) * decay;
            next.qd[j] = slope + (ed - omega * (ed + omega * e) * dt) * decay;
            next.qdd[j] = omega * omega * (to[j] - next.q[j]) - 2.0 * omega * next.qd[j];
        }
        next
    }

    /// Where the joints should have been at `stamp`; `None` before the first command or after the last one,
    /// or too long ago.
    pub(super) fn at(&self, stamp: Stamp) -> Option<ExpectedMotion<J>> {
        let mut later = self.motions.back(0).filter(|newest| newest.stamp >= stamp)?;
        for age in 1..KEPT as u64 {
            let earlier = self.motions.back(age)?;
            if earlier.stamp <= stamp {
                let length = later.stamp.since(earlier.stamp) as f64;
                let share = if length > 0.0 { stamp.since(earlier.stamp) as f64 / length } else { 1.0 };
                let mut at = *earlier;
                at.stamp = stamp;
                at.qd = std::array::from_fn(|j| at.qd[j] + (later.qd[j] - at.qd[j]) * share);
                at.qdd = std::array::from_fn(|j| at.qdd[j] + (later.qdd[j] - at.qdd[j]) * share);
                at.free &= later.free;
                return Some(at);
            }
            later = earlier;
        }
        None
    }
}
