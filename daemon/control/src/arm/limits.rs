//! Velocity interval of each joint for the next step, from acceleration, velocity, position and jerk limits.
//!
//! Contract: IK and guard restrict their answers to the same [`VelocityBox`], so the guard passes what the IK
//! solves. The box is never empty, and from every *viable* state it leads to viable states only, whatever the
//! length of the next step. A state is viable if a consumer that receives no further command (extrapolate for
//! `hold_s`, then brake at `deceleration`) stops inside the position limits:
//!
//!   q̇·hold + q̇²/(2·a_b) ≤ q_max − q     for q̇ > 0, mirrored for q̇ < 0.
//!
//! Why the box cannot be empty: let q̇ be viable and let the next step last h > 0. Braking by the
//! acceleration limit a ≥ a_b gives q̇' = max(q̇ − a·h, 0), and q̇'(h + hold) + q̇'²/(2a_b) ≤ q̇·hold +
//! q̇²/(2a_b) holds for every h: for q̇ ≥ a·h the difference is q̇h(1 − a/a_b) − a·h(h + hold) + a²h²/(2a_b)
//! ≤ −a²h²/(2a_b) − a·h·hold < 0, otherwise q̇' = 0.

#![expect(clippy::indexing_slicing, reason = "indices run over the joints, the length of every array")]

use crate::state::state;
use thiserror::Error;

/// Why limits were refused.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum LimitError {
    /// The position interval is empty or NaN.
    #[error(
        "joint {joint}: position limits [{lower}, {upper}] rad are not an interval; give lower < upper \
         (infinite for none)"
    )]
    Position {
        /// Joint index from 0, base first.
        joint: usize,
        /// \[rad\]
        lower: f64,
        /// \[rad\]
        upper: f64,
    },
    /// A velocity, acceleration, jerk or deceleration limit is not a positive finite number.
    #[error("joint {joint}: {quantity} limit {value} {unit} must be a positive finite number")]
    NotPositive {
        /// Joint index from 0, base first.
        joint: usize,
        /// Name of the limit, as in the message.
        quantity: &'static str,
        /// The refused value, as it was given.
        value: f64,
        /// Unit of the value, as in the message.
        unit: &'static str,
    },
    /// A consumer would brake harder than the joint may accelerate.
    #[error(
        "joint {joint}: braking at {deceleration} rad/s² exceeds the acceleration limit {acceleration} \
         rad/s²; lower it"
    )]
    Deceleration {
        /// Joint index from 0, base first.
        joint: usize,
        /// \[rad/s²\]
        deceleration: f64,
        /// \[rad/s²\]
        acceleration: f64,
    },
    /// The hold time is negative, too long or NaN.
    #[error("hold time {hold_s} s must be between 0 and 1 s")]
    Hold {
        /// \[s\]
        hold_s: f64,
    },
}

/// Joint limits, validated: finite, positive, intervals not empty.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JointLimits<const J: usize> {
    position: [[f64; 2]; J],
    velocity: [f64; J],
    acceleration: [f64; J],
    jerk: Option<[f64; J]>,
    deceleration: [f64; J],
    hold_s: f64,
}

impl<const J: usize> JointLimits<J> {
    /// Limits without a jerk limit, for a consumer that brakes at once and at the acceleration limit.
    ///
    /// `position` [\[lower, upper\]; J] rad (infinite for a continuous joint), `velocity` rad/s,
    /// `acceleration` rad/s².
    ///
    /// # Errors
    ///
    /// An empty interval, or a limit that is not a positive finite number.
    pub fn new(
        position: [[f64; 2]; J],
        velocity: [f64; J],
        acceleration: [f64; J],
    ) -> Result<Self, LimitError> {
        for (joint, [lower, upper]) in position.into_iter().enumerate() {
            if lower.partial_cmp(&upper) != Some(std::cmp::Ordering::Less) {
                return Err(LimitError::Position { joint, lower, upper });
            }
        }
        positive(&velocity, "velocity", "rad/s")?;
        positive(&acceleration, "acceleration", "rad/s²")?;
        Ok(Self { position, velocity, acceleration, jerk: None, deceleration: acceleration, hold_s: 0.0 })
    }

    /// Adds jerk limits \[rad/s³\]. They narrow the box but yield where acceleration, velocity or position
    /// need it.
    pub fn with_jerk(mut self, jerk: [f64; J]) -> Result<Self, LimitError> {
        positive(&jerk, "jerk", "rad/s³")?;
        self.jerk = Some(jerk);
        Ok(self)
    }

    /// States how a consumer stops by itself: extrapolation for `hold_s` \[s\], then `deceleration`
    /// \[rad/s²\].
    ///
    /// After every command inside the box the stream may then end without leaving the position limits.
    ///
    /// # Errors
    ///
    /// A deceleration above the acceleration limit, a hold time outside \[0, 1\] s.
    pub fn with_stale_braking(mut self, hold_s: f64, deceleration: [f64; J]) -> Result<Self, LimitError> {
        if !(0.0..=1.0).contains(&hold_s) {
            return Err(LimitError::Hold { hold_s });
        }
        positive(&deceleration, "deceleration", "rad/s²")?;
        for (joint, (&deceleration, &acceleration)) in deceleration.iter().zip(&self.acceleration).enumerate()
        {
            if deceleration > acceleration {
                return Err(LimitError::Deceleration { joint, deceleration, acceleration });
            }
        }
        self.deceleration = deceleration;
        self.hold_s = hold_s;
        Ok(self)
    }

    /// \[lower, upper\] per joint \[rad\].
    #[must_use]
    pub const fn position(&self) -> &[[f64; 2]; J] {
        &self.position
    }

    /// Largest speed per joint \[rad/s\].
    #[must_use]
    pub const fn velocity(&self) -> &[f64; J] {
        &self.velocity
    }

    /// Largest acceleration per joint \[rad/s²\].
    #[must_use]
    pub const fn acceleration(&self) -> &[f64; J] {
        &self.acceleration
    }

    /// Largest jerk per joint \[rad/s³\], where limited.
    #[must_use]
    pub const fn jerk(&self) -> Option<&[f64; J]> {
        self.jerk.as_ref()
    }

    /// Deceleration per joint of a consumer without commands \[rad/s²\].
    #[must_use]
    pub const fn deceleration(&self) -> &[f64; J] {
        &self.deceleration
    }

    /// How long a consumer extrapolates before it brakes \[s\].
    #[must_use]
    pub const fn hold_s(&self) -> f64 {
        self.hold_s
    }

    /// Whether every joint is inside its position limits and can still stop there (see the module).
    #[must_use]
    pub fn is_viable(&self, motion: &JointMotion<J>) -> bool {
        (0..J).all(|j| {
            let ([lower, upper], q, qd) = (self.position[j], motion.q[j], motion.qd[j]);
            let needed = qd.abs() * self.hold_s + qd * qd / (2.0 * self.deceleration[j]);
            let room = if qd > 0.0 { upper - q } else { q - lower };
            q >= lower && q <= upper && needed <= room
        })
    }
}

fn positive(values: &[f64], quantity: &'static str, unit: &'static str) -> Result<(), LimitError> {
    match values.iter().enumerate().find(|(_, v)| !(v.is_finite() && **v > 0.0)) {
        Some((joint, &value)) => Err(LimitError::NotPositive { joint, quantity, value, unit }),
        None => Ok(()),
    }
}

/// Joint motion of the last command: position \[rad\], velocity \[rad/s\] and acceleration \[rad/s²\] per
/// joint.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JointMotion<const J: usize> {
    /// \[rad\]
    pub q: [f64; J],
    /// \[rad/s\]
    pub qd: [f64; J],
    /// \[rad/s²\], difference of the last two commanded velocities over their distance in time.
    pub qdd: [f64; J],
}

state! { whole [const J: usize] JointMotion<J> { q, qd, qdd } }

impl<const J: usize> JointMotion<J> {
    /// At rest at `q` \[rad\].
    #[must_use]
    pub const fn at_rest(q: [f64; J]) -> Self {
        Self { q, qd: [0.0; J], qdd: [0.0; J] }
    }

    /// All numbers are finite.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        self.q.iter().chain(&self.qd).chain(&self.qdd).all(|x| x.is_finite())
    }
}

/// Velocities \[rad/s\] a joint may be commanded for the next step; `lower <= upper` for every joint.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VelocityBox<const J: usize> {
    /// \[rad/s\]
    pub lower: [f64; J],
    /// \[rad/s\]
    pub upper: [f64; J],
}

impl<const J: usize> VelocityBox<J> {
    /// The velocities in the box nearest to `qd` \[rad/s\], joint by joint.
    #[must_use]
    pub fn nearest(&self, qd: &[f64; J]) -> [f64; J] {
        std::array::from_fn(|j| within(qd[j], self.lower[j], self.upper[j]))
    }
}

/// The velocity box for a step of `elapsed` seconds from `motion`, which must be finite.
///
/// Acceleration comes first (continuity with the last command), then velocity and viability inside what
/// acceleration leaves, then jerk inside that. Outside the limits the box still contains at least one
/// velocity, and leads back.
#[must_use]
pub fn velocity_box<const J: usize>(
    motion: &JointMotion<J>,
    limits: &JointLimits<J>,
    elapsed: f64,
) -> VelocityBox<J> {
    let mut out = VelocityBox { lower: [0.0; J], upper: [0.0; J] };
    let h = if elapsed > 0.0 { elapsed } else { 0.0 };
    let jerk = limits.jerk.unwrap_or([f64::INFINITY; J]);
    for i in 0..J {
        let (q, qd, qdd, j) = (motion.q[i], motion.qd[i], motion.qdd[i], jerk[i]);
        let (v, a, decel) = (limits.velocity[i], limits.acceleration[i], limits.deceleration[i]);
        let [q_min, q_max] = limits.position[i];
        let (lower, upper) = (qd - a * h, qd + a * h);
        let v_up = viable_velocity(q_max - q, h, limits.hold_s, decel, v);
        let v_down = -viable_velocity(q - q_min, h, limits.hold_s, decel, v);
        let hard_lower = within(v_down.max(-v), lower, upper);
        let hard_upper = within(v_up.min(v), lower, upper).max(hard_lower);
        let (soft_lower, soft_upper) = if j.is_finite() {
            let ease_up = easing_rate(v - qd, h, j);
            let ease_down = -easing_rate(v + qd, h, j);
            ((qdd - j * h).max(ease_down).min(qdd + j * h), (qdd + j * h).min(ease_up).max(qdd - j * h))
        } else {
            (-f64::INFINITY, f64::INFINITY)
        };
        out.lower[i] = within(qd + soft_lower * h, hard_lower, hard_upper);
        out.upper[i] = within(qd + soft_upper * h, hard_lower, hard_upper);
    }
    out
}

/// Largest velocity toward a position limit `room` away that is still viable after a step of `h` at that
/// velocity \[rad/s\].
///
/// The root of v(h + hold) + v²/(2·decel) = room; beyond the limit (`room` < 0) a velocity that leads back,
/// at a tenth of the velocity limit or just to the limit.
#[must_use]
pub fn viable_velocity(room: f64, h: f64, hold: f64, decel: f64, v_max: f64) -> f64 {
    if v_max * (h + hold) + v_max * v_max / (2.0 * decel) <= room {
        // Far from the limit, the usual case: no square root.
        v_max
    } else if room >= 0.0 {
        let b = decel * (h + hold);
        // Written as a quotient: the difference b − √(b² + 2·decel·room) cancels near the limit.
        let root = b + (b * b + 2.0 * decel * room).sqrt();
        if root > 0.0 { 2.0 * decel * room / root } else { 0.0 }
    } else {
        room.max(-0.1 * v_max * h) / if h > 0.0 { h } else { 1.0 }
    }
}

/// The longest time \[s\] in which a joint is stopped from its `velocity` \[rad/s\] by `deceleration`
/// [rad/s²].
pub(crate) fn longest<const J: usize>(velocity: &[f64; J], deceleration: &[f64; J]) -> f64 {
    velocity.iter().zip(deceleration).map(|(v, a)| v / a).fold(0.0, f64::max)
}

/// `qd` \[rad/s\] after braking toward zero for `elapsed` seconds at `deceleration` \[rad/s²\], joint by
/// joint.
#[must_use]
pub fn braking<const J: usize>(qd: &[f64; J], deceleration: &[f64; J], elapsed: f64) -> [f64; J] {
    std::array::from_fn(|j| {
        let most = deceleration[j] * elapsed;
        qd[j] - within(qd[j], -most, most)
    })
}

/// `qd` \[rad/s\] after braking toward zero for `elapsed` seconds, all joints in proportion, the one that
/// needs longest at its `deceleration` \[rad/s²\].
#[must_use]
pub fn braking_straight<const J: usize>(qd: &[f64; J], deceleration: &[f64; J], elapsed: f64) -> [f64; J] {
    let needed = qd.iter().zip(deceleration).map(|(v, a)| v.abs() / a).fold(0.0, f64::max);
    let left = if needed > elapsed { 1.0 - elapsed / needed } else { 0.0 };
    qd.map(|v| v * left)
}

/// Largest acceleration that can still fade out at `jerk` before the velocity has grown by `room` \[rad/s²\].
fn easing_rate(room: f64, h: f64, jerk: f64) -> f64 {
    let b = jerk * h;
    if room >= 0.0 { (b * b + 2.0 * jerk * room).sqrt() - b } else { 0.0 }
}

/// `f64::clamp` panics on an empty interval or NaN bounds; this returns the upper bound instead.
fn within(x: f64, lower: f64, upper: f64) -> f64 {
    x.max(lower).min(upper)
}

/// Default time from full acceleration to full braking without jerk limits \[s\]: ten ticks at 500 Hz. A
/// longer ramp costs more distance than it reduces vibration.
pub const EASE_S: f64 = 0.02;

/// The longest time that a follower's jerk limits may take for the same \[s\].
pub const LONGEST_EASE_S: f64 = 0.05;

/// The jerk limits, or where there are none (acceleration + deceleration)/[`EASE_S`], per joint \[rad/s³\].
#[must_use]
pub fn stop_jerk<const J: usize>(limits: &JointLimits<J>) -> [f64; J] {
    limits.jerk().copied().unwrap_or_else(|| {
        std::array::from_fn(|j| (limits.acceleration[j] + limits.deceleration[j]) / EASE_S)
    })
}

/// The next velocity of one joint, or along one direction, on its way to rest: a step of `h` \[s\] from
/// velocity `v` and acceleration `a`.
///
/// With braking b > 0 against v > 0, the largest b from which steps of `jerk`·h lead b to zero before v is
/// spent solves h·b + h·Σ_k max(b − k·jerk·h, 0) = v, piecewise linear in b: b = (v/h + jerk·h·n(n+1)/2) / (n
/// + 1) where n jerk·h ≤ b. Braking along it is exact in discrete time: v and b reach zero at the same tick.
#[must_use]
pub(crate) fn slowed(v: f64, a: f64, h: f64, decel: f64, jerk: f64) -> f64 {
    let speed = v.abs();
    // At rest the braking direction opposes the remaining acceleration.
    let sign = if v != 0.0 { v.signum() } else { -a.signum() };
    let braking = -a * sign;
    let step = jerk * h;
    let exact = if step.is_finite() {
        let n = ((0.25 + 2.0 * speed / (step * h)).sqrt() - 0.5).floor().max(0.0);
        (speed / h + step * 0.5 * n * (n + 1.0)) / (n + 1.0)
    } else {
        speed / h
    };
    let wanted = exact.min(decel);
    // min and max rather than clamp: an infinite step must not make NaN bounds.
    let rate = if step.is_finite() { wanted.max(braking - step).min(braking + step) } else { wanted };
    if (rate * h - speed).abs() <= 1e-12 {
        return 0.0;
    }
    v - sign * rate * h
}
