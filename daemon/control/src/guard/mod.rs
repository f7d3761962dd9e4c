//! The last stage before a command is published: whatever is proposed, what leaves is legal.
//!
//! Contract: independent of everything above it and usable alone. The answer is finite, continuous with the
//! last command, inside velocity and acceleration limits judged by the stamps of the two commands, inside the
//! position limits, and leads to a state that a consumer without further commands stops inside them (see
//! [`crate::arm::limits`]). If the last command was outside its limits, acceleration is kept and the way
//! leads back. Absent: collision, tool-space limits, and planning: a far goal is approached as fast as the
//! limits allow, and overshot.
//!
//! # In a loop of your own
//!
//! Three rules: send nothing but [`Verdict::command`]; after lost time go on from [`consumer_state`], where
//! the arm is that extrapolated the last command and then braked; stop with [`StopProfile`]. `hold_s` of the
//! limits must be the time between a command's stamp and the end of its validity, `deceleration` what the arm
//! brakes with by itself. A whole loop at 500 Hz: `daemon/control/examples/guard_alone.rs`.
//!
//! ```
//! use foretrace_control::guard::{Commanded, Guard, Reasons, StopProfile};
//! use foretrace_control::arm::JointLimits;
//! use foretrace_control::units::Stamp;
//!
//! // Two joints [rad, rad/s, rad/s²]; the consumer extrapolates for 10 ms, then brakes at 20 and 10 rad/s².
//! let limits = JointLimits::new([[-3.1, 3.1], [-1.0, 0.5]], [3.0, 1.5], [40.0, 20.0])?
//!     .with_stale_braking(0.010, [20.0, 10.0])?;
//! let (guard, stop) = (Guard::new(limits), StopProfile::new(limits));
//! let mut last = Commanded::at_rest(Stamp(0), [0.0, 0.0]).ok_or("not finite")?;
//!
//! let leap = guard.clamp(&last, &[0.1, f64::NAN], last.stamp() + 2_000_000);
//! assert!(leap.reasons.contains(Reasons::NOT_FINITE) && *leap.command.q() == [0.0, 0.0]);
//! for _ in 0..1000 {
//!     last = guard.clamp(&last, &[9.0, -9.0], last.stamp() + 2_000_000).command;
//! }
//! assert!(last.q()[0] <= 3.1 && last.q()[1] >= -1.0 && limits.is_viable(last.motion()));
//! while !StopProfile::is_done(&last) {
//!     let (h, qd) = (0.002, stop.next(&last, last.stamp() + 2_000_000));
//!     let q = std::array::from_fn(|i| last.q()[i] + qd[i] * h);
//!     last = guard.clamp(&last, &q, last.stamp() + 2_000_000).command;
//! }
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

#![expect(clippy::indexing_slicing, reason = "indices run over the joints, the length of every array")]

pub mod check;
pub mod consumer;
pub mod stop;

use crate::state::state;
pub use check::{CommandChecker, CommandStatistics, Violations};
pub use consumer::consumer_state;
pub use stop::StopProfile;

use crate::arm::{JointLimits, JointMotion, limits};
use crate::units::Stamp;

/// A velocity this far outside its interval \[rad/s\] is rounding of (q' − q)/elapsed, not a violation.
const ROUNDING_RADPS: f64 = 1e-9;
/// In short steps less: this share of the change that acceleration allows.
const ROUNDING_SHARE: f64 = 1e-7;

/// The last command, known to be finite: joint motion and the instant at which it holds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Commanded<const J: usize> {
    stamp: Stamp,
    motion: JointMotion<J>,
}

state! { whole [const J: usize] Commanded<J> { stamp, motion } }

impl<const J: usize> Commanded<J> {
    /// The joint `motion` to hold at `stamp`; `None` unless every number is finite.
    #[must_use]
    pub fn new(stamp: Stamp, motion: JointMotion<J>) -> Option<Self> {
        motion.is_finite().then_some(Self { stamp, motion })
    }

    /// At rest at `q` \[rad\]; `None` unless finite.
    #[must_use]
    pub fn at_rest(stamp: Stamp, q: [f64; J]) -> Option<Self> {
        Self::new(stamp, JointMotion::at_rest(q))
    }

    /// The instant at which `q` holds.
    #[must_use]
    pub const fn stamp(&self) -> Stamp {
        self.stamp
    }

    /// Position, velocity and acceleration.
    #[must_use]
    pub const fn motion(&self) -> &JointMotion<J> {
        &self.motion
    }

    /// \[rad\]
    #[must_use]
    pub const fn q(&self) -> &[f64; J] {
        &self.motion.q
    }

    /// \[rad/s\]: mean velocity of the step that ended at the stamp.
    #[must_use]
    pub const fn qd(&self) -> &[f64; J] {
        &self.motion.qd
    }

    /// [rad/s²]: change of `qd` against the command before, over their distance in time.
    #[must_use]
    pub const fn qdd(&self) -> &[f64; J] {
        &self.motion.qdd
    }
}

/// What the guard let pass.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Verdict<const J: usize> {
    /// The command that may leave.
    pub command: Commanded<J>,
    /// Joints whose position differs from the proposal, one bit each, joint 0 lowest.
    pub altered: u32,
    /// Why, over all joints.
    pub reasons: Reasons,
}

/// Set of reasons for altering a proposal.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Reasons(u16);

impl Reasons {
    /// Nothing was altered: no reason.
    pub const NONE: Self = Self(0);
    /// A proposed number was NaN or infinite: all joints brake.
    pub const NOT_FINITE: Self = Self(1);
    /// Outside the position limits, or unable to stop inside them.
    pub const POSITION: Self = Self(1 << 1);
    /// Faster than the velocity limit.
    pub const VELOCITY: Self = Self(1 << 2);
    /// Velocity changed faster than the acceleration limit.
    pub const ACCELERATION: Self = Self(1 << 3);
    /// Acceleration changed faster than the jerk limit.
    pub const JERK: Self = Self(1 << 4);
    /// The stamp is not after the last command's: the last command stands.
    pub const STAMP: Self = Self(1 << 5);
    /// The last command is older than the longest step: only that much motion is allowed.
    pub const GAP: Self = Self(1 << 6);

    /// The reasons of both sets together.
    #[must_use]
    pub const fn with(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }

    /// True when all of `other` is in the set.
    #[must_use]
    pub const fn contains(self, other: Self) -> bool {
        self.0 & other.0 == other.0
    }

    /// True for the empty set.
    #[must_use]
    pub const fn is_empty(self) -> bool {
        self.0 == 0
    }

    /// One bit per reason, as on the wire.
    #[must_use]
    pub const fn bits(self) -> u16 {
        self.0
    }
}

/// The guard of one arm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Guard<const J: usize> {
    limits: JointLimits<J>,
    longest_step_s: f64,
}

impl<const J: usize> Guard<J> {
    /// A guard that keeps `limits`; steps longer than 0.1 s, or longer than consumers extrapolate, count as
    /// that long.
    #[must_use]
    pub const fn new(limits: JointLimits<J>) -> Self {
        Self { limits, longest_step_s: limits.hold_s().max(0.1) }
    }

    /// The limits that it keeps.
    #[must_use]
    pub const fn limits(&self) -> &JointLimits<J> {
        &self.limits
    }

    /// The legal command for `stamp` nearest to the proposed joint positions `q` \[rad\], joint by joint.
    ///
    /// Velocity is what positions and stamps imply, (q − q_last)/elapsed; no claimed velocity is used. `last`
    /// is what the consumer follows at `stamp`: where it may already brake by itself, take `last` from
    /// [`consumer_state`].
    #[must_use]
    pub fn clamp(&self, last: &Commanded<J>, q: &[f64; J], stamp: Stamp) -> Verdict<J> {
        let elapsed = stamp.seconds_since(last.stamp);
        if elapsed <= 0.0 {
            let altered = last.q().iter().zip(q).enumerate().filter(|(_, (old, new))| old != new);
            let altered = altered.fold(0, |bits, (joint, _)| bits | 1 << joint);
            return Verdict { command: *last, altered, reasons: Reasons::STAMP };
        }
        let h = elapsed.min(self.longest_step_s);
        let mut reasons = if h < elapsed { Reasons::GAP } else { Reasons::NONE };
        let finite = q.iter().all(|x| x.is_finite());
        let mut wanted = limits::braking(last.qd(), self.limits.deceleration(), h);
        if finite {
            for (v, (new, old)) in wanted.iter_mut().zip(q.iter().zip(last.q())) {
                *v = (new - old) / h;
            }
        } else {
            reasons = reasons.with(Reasons::NOT_FINITE);
        }
        self.bounded(last, q, &wanted, stamp, h, reasons)
    }

    fn bounded(
        &self,
        last: &Commanded<J>,
        proposed: &[f64; J],
        wanted: &[f64; J],
        stamp: Stamp,
        h: f64,
        mut reasons: Reasons,
    ) -> Verdict<J> {
        let allowed = limits::velocity_box(&last.motion, &self.limits, h);
        let finite = !reasons.contains(Reasons::NOT_FINITE);
        let mut altered = 0;
        let mut motion = last.motion;
        for j in 0..J {
            let (old_q, old_qd, a) = (motion.q[j], motion.qd[j], self.limits.acceleration()[j]);
            let (lower, upper, [q_min, q_max]) =
                (allowed.lower[j], allowed.upper[j], self.limits.position()[j]);
            let rounding = rounding_radps(old_q, a, h);
            let inside = wanted[j] >= lower - rounding && wanted[j] <= upper + rounding;
            let v = if inside { wanted[j] } else { wanted[j].max(lower).min(upper) };
            // A proposal inside the box passes bit for bit.
            let mut q = if inside && finite { proposed[j] } else { old_q + v * h };
            // Rounding must put no joint outside its limits, and none farther outside. More than rounding
            // would break the acceleration.
            let kept = q.max(q_min.min(old_q)).min(q_max.max(old_q));
            if ((kept - old_q) / h - old_qd).abs() <= a * h + rounding {
                q = kept;
            }
            let mut qd = (q - old_q) / h;
            let mut qdd = (qd - old_qd) / h;
            if !(q.is_finite() && qd.is_finite() && qdd.is_finite()) {
                // Only states near the largest representable numbers come here; no motion from them is
                // meaningful.
                (q, qd, qdd) = (old_q, 0.0, 0.0);
            }
            (motion.q[j], motion.qd[j], motion.qdd[j]) = (q, qd, qdd);
            if !inside {
                reasons = reasons.with(why(&self.limits, &last.motion, j, wanted[j], h));
            }
            // NaN differs from everything, itself included.
            if !(q == proposed[j]) {
                altered |= 1 << j;
            }
        }
        Verdict { command: Commanded { stamp, motion }, altered, reasons }
    }
}

/// How far outside its interval a velocity \[rad/s\] still counts as rounding, given the precision of
/// positions near `q`.
fn rounding_radps(q: f64, acceleration: f64, h: f64) -> f64 {
    let grain = 2.0 * f64::EPSILON * q.abs() / h;
    ROUNDING_RADPS.min(grain.max(ROUNDING_SHARE * acceleration * h))
}

/// Which limits the velocity `wanted` \[rad/s\] breaks for joint `joint` after `last`.
fn why<const J: usize>(
    limits: &JointLimits<J>,
    last: &JointMotion<J>,
    joint: usize,
    wanted: f64,
    h: f64,
) -> Reasons {
    let of = |values: &[f64; J]| values[joint];
    let (q, qd, qdd) = (of(&last.q), of(&last.qd), of(&last.qdd));
    let (v, a, decel) = (of(limits.velocity()), of(limits.acceleration()), of(limits.deceleration()));
    // Without the velocity limit, which is a reason of its own.
    let [q_min, q_max] = limits.position()[joint];
    let viable = |room| limits::viable_velocity(room, h, limits.hold_s(), decel, f64::INFINITY);
    let acceleration = (wanted - qd) / h;
    let broken = [
        (Reasons::VELOCITY, wanted.abs() <= v),
        (Reasons::ACCELERATION, acceleration.abs() <= a),
        (Reasons::POSITION, wanted <= viable(q_max - q) && -wanted <= viable(q - q_min)),
    ];
    let hard = broken.iter().filter(|(_, kept)| !kept).fold(Reasons::NONE, |all, (r, _)| all.with(*r));
    let jerk = limits.jerk().is_some_and(|j| (acceleration - qdd).abs() > of(j) * h);
    // Jerk also bounds the approach to the velocity limit: the only reason left when no other is broken.
    if jerk || hard.is_empty() { hard.with(Reasons::JERK) } else { hard }
}
