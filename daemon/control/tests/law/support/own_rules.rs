//! The rules of one joint written again from the contract's text, without arithmetic of guard, box or stop.

use foretrace_control::arm::JointLimits;

/// Instants at which a braking consumer is looked at.
const BRAKING_STEPS: u32 = 12;

/// Limits of one joint as plain numbers.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Joint {
    pub(crate) low: f64,
    pub(crate) high: f64,
    pub(crate) velocity: f64,
    pub(crate) acceleration: f64,
    pub(crate) jerk: f64,
    pub(crate) deceleration: f64,
    pub(crate) hold_s: f64,
}

/// Position \[rad\], velocity \[rad/s\] and acceleration \[rad/s²\] of one joint.
#[derive(Debug, Clone, Copy)]
pub(crate) struct State {
    pub(crate) q: f64,
    pub(crate) qd: f64,
    pub(crate) qdd: f64,
}

pub(crate) fn joint<const J: usize>(limits: &JointLimits<J>, i: usize) -> Joint {
    let [low, high] = limits.position()[i];
    Joint {
        low,
        high,
        velocity: limits.velocity()[i],
        acceleration: limits.acceleration()[i],
        jerk: limits.jerk().map_or(f64::INFINITY, |jerk| jerk[i]),
        deceleration: limits.deceleration()[i],
        hold_s: limits.hold_s(),
    }
}

impl Joint {
    /// How far outside the position limits \[rad\] a consumer without commands gets: at `v` for the time of
    /// validity, then braking at `deceleration`, sampled step by step. Negative: the remaining room.
    pub(crate) fn excess(&self, q: f64, v: f64) -> f64 {
        let mut worst = (q - self.high).max(self.low - q);
        let mut look = |q: f64| worst = worst.max(q - self.high).max(self.low - q);
        let mut at = q + v * self.hold_s;
        look(at);
        let dt = v.abs() / self.deceleration / f64::from(BRAKING_STEPS);
        let rate = if v > 0.0 { -self.deceleration } else { self.deceleration };
        let mut speed = v;
        for _ in 0..BRAKING_STEPS {
            at += dt * (speed + 0.5 * rate * dt);
            speed += rate * dt;
            look(at);
        }
        worst
    }

    /// True if a consumer that continued from `from` at `v` for `h` could not stop inside, with tolerance
    /// `slack` \[rad/s\].
    pub(crate) fn cannot_stop(&self, from: &State, v: f64, h: f64, slack: f64) -> bool {
        self.excess(from.q + v * h, v) > -slack * (h + self.hold_s + self.velocity / self.deceleration)
    }

    /// True if continuing so breaks a limit that must never be broken.
    pub(crate) fn breaks_hard(&self, from: &State, v: f64, h: f64, slack: f64) -> bool {
        v.abs() > self.velocity - slack
            || (v - from.qd).abs() > self.acceleration * h - slack
            || self.cannot_stop(from, v, h, slack)
    }

    /// True when the acceleration of `from` can fade at the jerk limit before the velocity limit is reached.
    pub(crate) fn can_fade(&self, from: &State, slack: f64) -> bool {
        from.qdd.signum() * from.qd + from.qdd * from.qdd / (2.0 * self.jerk) <= self.velocity - slack
            && from.qdd.abs() <= self.acceleration * (1.0 + 1e-6)
    }

    /// Velocity after braking at `deceleration` for `h`.
    pub(crate) fn braked(&self, v: f64, h: f64) -> f64 {
        if v.abs() <= self.deceleration * h { 0.0 } else { v - v.signum() * self.deceleration * h }
    }

    /// True when it breaks the jerk limit, or could not let its acceleration fade before the velocity limit.
    pub(crate) fn breaks_jerk(&self, from: &State, v: f64, h: f64, slack: f64) -> bool {
        let a = (v - from.qd) / h;
        (a - from.qdd).abs() * h > self.jerk * h * h - slack
            || a.signum() * v + a * a / (2.0 * self.jerk)
                > self.velocity - slack * (1.0 + a.abs() / (self.jerk * h))
    }
}
