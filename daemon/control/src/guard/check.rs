//! An independent judge of published commands: recomputes every limit from stamps and positions.
//!
//! Contract: shares no arithmetic with guard, IK, stop or `consumer_state`, so that an error there cannot
//! hide here. Counts, never alters. Absent: jerk, whose limit yields to the others.

#![expect(clippy::indexing_slicing, reason = "indices run over the joints, the length of every array")]

use crate::arm::limits::JointLimits;
use crate::units::Stamp;

/// Allowed excess relative to each limit: rounding of (q₁ − q₀)/elapsed at 1 kHz is below 1e-12 rad / (1 ms)²
/// = 1e-6 rad/s².
const RELATIVE: f64 = 1e-6;
/// Allowed excess of positions \[rad\], for rounding of the sum q + q̇·elapsed. A stopping distance may
/// additionally be [`RELATIVE`] too long.
const POSITION_RAD: f64 = 1e-9;

/// How many commands broke which rule. One command can break several.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Violations {
    /// NaN or infinite numbers.
    pub not_finite: u64,
    /// A stamp not after the one before.
    pub stamp: u64,
    /// A joint outside its position limits.
    pub position: u64,
    /// Claimed velocity, or distance over elapsed time, above the limit.
    pub velocity: u64,
    /// Change of claimed velocity over elapsed time above the limit.
    pub acceleration: u64,
    /// The positions do not follow from the claimed velocities: the command jumped.
    pub continuity: u64,
    /// A consumer that receives nothing after this command leaves the position limits: it cannot stop inside
    /// them.
    pub viability: u64,
}

/// Counts and extremes so far.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct CommandStatistics {
    /// Commands judged, the first included.
    pub count: u64,
    /// Commands that broke at least one rule.
    pub limit_violations: u64,
    /// Counts of violations, by rule.
    pub violations: Violations,
    /// Largest change of a joint between two commands \[rad\].
    pub max_step_rad: f64,
    /// Largest velocity, claimed or covered \[rad/s\].
    pub max_velocity_radps: f64,
    /// Largest change of claimed velocity over elapsed time \[rad/s²\].
    pub max_acceleration_radps2: f64,
}

/// Judges commands one by one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CommandChecker<const J: usize> {
    limits: JointLimits<J>,
    last: Option<Received<J>>,
    statistics: CommandStatistics,
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct Received<const J: usize> {
    stamp: Stamp,
    valid_until: Stamp,
    q: [f64; J],
    qd: [f64; J],
}

impl<const J: usize> CommandChecker<J> {
    /// A judge by position, velocity, acceleration and deceleration of `limits`.
    #[must_use]
    pub fn new(limits: JointLimits<J>) -> Self {
        Self { limits, last: None, statistics: CommandStatistics::default() }
    }

    /// Counts and extremes so far.
    #[must_use]
    pub const fn statistics(&self) -> &CommandStatistics {
        &self.statistics
    }

    /// Forgets the last command, not the counts: the next one starts a new stream (a new arming, another
    /// daemon).
    pub fn restart(&mut self) {
        self.last = None;
    }

    /// Judges a command: joint positions `q` \[rad\] at `stamp`, velocities `qd` \[rad/s\]; true when it is
    /// legal.
    ///
    /// Velocity and acceleration are judged over the time between the two stamps. Positions must lie between
    /// what the old and the new velocity cover in that time; once the old command is past `valid_until` its
    /// consumer may have braked, and rest counts as a third velocity. Continuing at `qd` until `valid_until`,
    /// then braking at the limits' deceleration, must end inside the position limits; a joint that is already
    /// outside is not counted again for that side. A command that is non-finite or not newer does not become
    /// the last one.
    pub fn observe(&mut self, stamp: Stamp, valid_until: Stamp, q: &[f64; J], qd: &[f64; J]) -> bool {
        self.statistics.count += 1;
        let before = self.statistics.violations;
        let usable = self.judge(stamp, valid_until, q, qd);
        if usable {
            self.last = Some(Received { stamp, valid_until, q: *q, qd: *qd });
        }
        let legal = before == self.statistics.violations;
        if !legal {
            self.statistics.limit_violations += 1;
        }
        legal
    }

    fn judge(&mut self, stamp: Stamp, valid_until: Stamp, q: &[f64; J], qd: &[f64; J]) -> bool {
        let seen = &mut self.statistics;
        let counts = &mut seen.violations;
        if !q.iter().chain(qd).all(|x| x.is_finite()) {
            counts.not_finite += 1;
            return false;
        }
        let mut broken = [false; 5];
        let [position, velocity, acceleration, continuity, viability] = &mut broken;
        let gliding_s = valid_until.seconds_since(stamp).max(0.0);
        for j in 0..J {
            let ([lower, upper], q, v) = (self.limits.position()[j], q[j], qd[j]);
            let to_rest = v.abs() * (gliding_s + v.abs() / self.limits.deceleration()[j] / 2.0);
            let room = if v > 0.0 { upper - q } else { q - lower };
            *viability |= room >= -POSITION_RAD && to_rest * (1.0 - RELATIVE) > room + POSITION_RAD;
            *position |= q < lower - POSITION_RAD || q > upper + POSITION_RAD;
            seen.max_velocity_radps = seen.max_velocity_radps.max(v.abs());
            *velocity |= v.abs() > self.limits.velocity()[j] * (1.0 + RELATIVE);
        }
        let mut newer = true;
        if let Some(last) = &self.last {
            let elapsed = stamp.seconds_since(last.stamp);
            if elapsed > 0.0 {
                let late = stamp > last.valid_until;
                for j in 0..J {
                    let (v_max, a_max) = (self.limits.velocity()[j], self.limits.acceleration()[j]);
                    let (step, v0, v1) = (q[j] - last.q[j], last.qd[j], qd[j]);
                    let covered = step.abs() / elapsed;
                    let change = (v1 - v0).abs() / elapsed;
                    seen.max_step_rad = seen.max_step_rad.max(step.abs());
                    seen.max_velocity_radps = seen.max_velocity_radps.max(covered);
                    seen.max_acceleration_radps2 = seen.max_acceleration_radps2.max(change);
                    *velocity |= covered > v_max * (1.0 + RELATIVE);
                    *acceleration |= change > a_max * (1.0 + RELATIVE);
                    let rest = if late { 0.0 } else { v0 };
                    let slowest = v1.min(v0).min(rest) * elapsed - POSITION_RAD;
                    let fastest = v1.max(v0).max(rest) * elapsed + POSITION_RAD;
                    *continuity |= !(step >= slowest && step <= fastest);
                }
            } else {
                counts.stamp += 1;
                newer = false;
            }
        }
        let [position, velocity, acceleration, continuity, viability] = broken;
        counts.position += u64::from(position);
        counts.velocity += u64::from(velocity);
        counts.acceleration += u64::from(acceleration);
        counts.continuity += u64::from(continuity);
        counts.viability += u64::from(viability);
        newer
    }
}
