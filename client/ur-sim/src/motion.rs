//! Motions of a program: what the joints are sent to in each cycle.
//!
//! Contract: total; no motion asks for more than its speed and acceleration, `servoj` aside, whose targets
//! the robot checks. Joints brake and accelerate together: the leading one as asked, the others in
//! proportion.

use super::inverse::Straight;

/// Deceleration where a straight way leads out of reach \[rad/s²\].
const UNREACHED_RADPS2: f64 = 10.0;

/// Positions \[rad\] and speeds \[rad/s\] of the joints.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JointPoint {
    /// \[rad\]
    pub q: [f64; 6],
    /// \[rad/s\]
    pub qd: [f64; 6],
}

/// What is going on.
#[derive(Debug, Clone, Copy, PartialEq)]
#[expect(clippy::large_enum_variant, reason = "a robot has one motion at a time")]
pub enum RobotMotion {
    Rest,
    /// The newest target of `servoj`.
    Servo {
        /// \[rad\]
        target: [f64; 6],
    },
    /// `movej`: a trapezoid along the straight line between two postures.
    Line(Trapezoid),
    /// `movel`: a trapezoid along a straight line of the tool.
    Straight {
        way: Straight,
        /// The share of it, as a line of length 1 in its first number.
        share: Trapezoid,
    },
    /// `speedj`.
    Speed {
        /// \[rad/s\]
        qd: [f64; 6],
        /// Of the leading joint \[rad/s²\].
        acceleration: f64,
        /// Cycles until it brakes unless it is renewed.
        left: u64,
    },
    Brake {
        /// Of the leading joint \[rad/s²\].
        deceleration: f64,
    },
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Trapezoid {
    from: [f64; 6],
    by: [f64; 6],
    /// Of the leading joint \[rad\], \[rad/s\], \[rad/s²\].
    length: f64,
    speed: f64,
    acceleration: f64,
    /// Since its beginning \[s\].
    t_s: f64,
}

impl Trapezoid {
    /// From rest at `from` to `to` \[rad\], the leading joint at `speed` \[rad/s\] and `acceleration`
    /// \[rad/s²\]; in `duration_s` where that is more than 0.
    #[must_use]
    pub fn new(from: [f64; 6], to: [f64; 6], speed: f64, acceleration: f64, duration_s: f64) -> Self {
        let mut by = to;
        by.iter_mut().zip(from).for_each(|(by, from)| *by -= from);
        let length = largest(&by);
        let (mut speed, mut acceleration) = (speed.max(1e-3), acceleration.max(1e-3));
        if duration_s > 0.0 {
            // A third each for speeding up, cruising and braking.
            speed = 1.5 * length / duration_s;
            acceleration = 4.5 * length / (duration_s * duration_s);
        }
        Self { from, by, length, speed, acceleration, t_s: 0.0 }
    }

    /// The way gone \[rad\] and its speed \[rad/s\] after `t_s`, of the leading joint; `None` at the end.
    fn at(&self) -> Option<(f64, f64)> {
        let (v, a) = (self.speed, self.acceleration);
        let ramp = (v / a).min((self.length / a).sqrt());
        let top = a * ramp;
        if !(self.length > 0.0 && top > 0.0) {
            return None;
        }
        let cruise = ((self.length - top * ramp) / top).max(0.0);
        let t = self.t_s;
        let end = 2.0 * ramp + cruise;
        if t < ramp {
            Some((0.5 * a * t * t, a * t))
        } else if t < ramp + cruise {
            Some((0.5 * a * ramp * ramp + top * (t - ramp), top))
        } else if t < end {
            let left = end - t;
            Some((self.length - 0.5 * a * left * left, a * left))
        } else {
            None
        }
    }
}

impl RobotMotion {
    /// One cycle of `dt` \[s\] from `point`, at `scaling` of the motion's own time. True where the motion is
    /// over.
    pub fn step(&mut self, point: &mut JointPoint, dt: f64, scaling: f64) -> bool {
        match self {
            Self::Rest => {
                point.qd = [0.0; 6];
                true
            }
            Self::Servo { target } => {
                let mut qd = *target;
                qd.iter_mut().zip(point.q).for_each(|(qd, q)| *qd = (*qd - q) / dt);
                *point = JointPoint { q: *target, qd };
                false
            }
            Self::Line(line) => {
                line.t_s += dt * scaling;
                let (way, speed) = line.at().unwrap_or((line.length, 0.0));
                let over = line.length <= 0.0 || way >= line.length;
                let share = |by: f64, of: f64| if line.length > 0.0 { by * of / line.length } else { 0.0 };
                for ((q, qd), (from, by)) in
                    point.q.iter_mut().zip(&mut point.qd).zip(line.from.iter().zip(line.by))
                {
                    *q = from + share(by, way);
                    *qd = share(by, speed) * scaling;
                }
                over
            }
            Self::Straight { way, share } => {
                share.t_s += dt * scaling;
                let gone = share.at().map_or(1.0, |(gone, _)| gone);
                let Some(q) = way.joints(gone, &point.q) else {
                    // Out of reach on the way: it goes no farther.
                    *self = Self::Brake { deceleration: UNREACHED_RADPS2 };
                    return self.step(point, dt, scaling);
                };
                let mut qd = q;
                qd.iter_mut().zip(point.q).for_each(|(qd, before)| *qd = (*qd - before) / dt);
                let over = gone >= 1.0;
                *point = JointPoint { q, qd: if over { [0.0; 6] } else { qd } };
                over
            }
            Self::Speed { qd, acceleration, left } => {
                let wanted = qd.map(|qd| qd * scaling);
                approach(point, &wanted, *acceleration, dt);
                *left = left.saturating_sub(1);
                if *left == 0 {
                    *self = Self::Brake { deceleration: *acceleration };
                }
                false
            }
            Self::Brake { deceleration } => {
                approach(point, &[0.0; 6], *deceleration, dt);
                largest(&point.qd) <= 0.0
            }
        }
    }

    /// Whether `speedj` has come to its speed.
    #[must_use]
    pub fn at_speed(&self, point: &JointPoint) -> bool {
        match self {
            Self::Speed { qd, .. } => qd.iter().zip(point.qd).all(|(a, b)| (a - b).abs() < 1e-9),
            _ => true,
        }
    }
}

/// Brings the speeds nearer to `wanted`, the one farthest away at `acceleration`, and moves on.
fn approach(point: &mut JointPoint, wanted: &[f64; 6], acceleration: f64, dt: f64) {
    let mut off = *wanted;
    off.iter_mut().zip(point.qd).for_each(|(off, qd)| *off -= qd);
    let most = largest(&off);
    let share = if most > 0.0 { (acceleration * dt / most).min(1.0) } else { 1.0 };
    for ((q, qd), (wanted, off)) in point.q.iter_mut().zip(&mut point.qd).zip(wanted.iter().zip(off)) {
        let before = *qd;
        *qd = if share < 1.0 { before + share * off } else { *wanted };
        *q += 0.5 * (before + *qd) * dt;
    }
}

fn largest(values: &[f64; 6]) -> f64 {
    values.iter().fold(0.0, |most, value| f64::max(most, value.abs()))
}

#[cfg(test)]
mod tests {
    use super::*;

    const DT: f64 = 0.002;

    /// Runs a motion to its end; the fastest speed, hardest acceleration of joint 0, and the time it took.
    fn run(mut motion: RobotMotion, point: &mut JointPoint) -> (f64, f64, f64) {
        let (mut fastest, mut hardest, mut t) = (0.0f64, 0.0f64, 0.0);
        for _ in 0..100_000 {
            let before = *point;
            let over = motion.step(point, DT, 1.0);
            t += DT;
            fastest = fastest.max(point.qd[0].abs());
            hardest = hardest.max((point.qd[0] - before.qd[0]).abs() / DT);
            if over {
                break;
            }
        }
        (fastest, hardest, t)
    }

    #[test]
    fn movej_is_a_trapezoid_of_the_leading_joint() {
        let mut point = JointPoint { q: [0.0; 6], qd: [0.0; 6] };
        let line = Trapezoid::new([0.0; 6], [1.0, 0.5, 0.0, 0.0, 0.0, -0.25], 1.0, 2.0, 0.0);
        let (fastest, hardest, t) = run(RobotMotion::Line(line), &mut point);
        assert!((fastest - 1.0).abs() < 1e-9 && hardest < 2.0 + 1e-6, "{fastest} {hardest}");
        // 0.5 s up, 0.5 s cruise, 0.5 s down.
        assert!((t - 1.5).abs() < 2.0 * DT, "{t}");
        assert_eq!(point.qd, [0.0; 6]);
        assert!((point.q[0] - 1.0).abs() < 1e-12 && (point.q[5] + 0.25).abs() < 1e-12);
    }

    #[test]
    fn a_short_movej_is_a_triangle_and_one_with_a_duration_takes_it() {
        let mut point = JointPoint { q: [0.0; 6], qd: [0.0; 6] };
        let short = Trapezoid::new([0.0; 6], [0.02; 6], 1.0, 2.0, 0.0);
        let (fastest, hardest, _) = run(RobotMotion::Line(short), &mut point);
        assert!(fastest < 0.21 && hardest < 2.0 + 1e-6, "{fastest} {hardest}");
        let timed = Trapezoid::new([0.02; 6], [0.5; 6], 1.0, 2.0, 3.0);
        let (_, _, t) = run(RobotMotion::Line(timed), &mut point);
        assert!((t - 3.0).abs() < 2.0 * DT, "{t}");
        let nowhere = Trapezoid::new([0.5; 6], [0.5; 6], 1.0, 2.0, 0.0);
        assert!(RobotMotion::Line(nowhere).step(&mut point, DT, 1.0));
    }

    #[test]
    fn speedj_brakes_when_it_is_not_renewed() {
        let mut point = JointPoint { q: [0.0; 6], qd: [0.0; 6] };
        let motion = RobotMotion::Speed { qd: [0.5, 0.25, 0.0, 0.0, 0.0, 0.0], acceleration: 1.0, left: 400 };
        let (fastest, hardest, t) = run(motion, &mut point);
        assert!((fastest - 0.5).abs() < 1e-9 && hardest < 1.0 + 1e-6, "{fastest} {hardest}");
        assert!((t - 1.3).abs() < 3.0 * DT && point.qd == [0.0; 6], "{t}");
        // 0.125 up, 0.15 at speed, 0.125 down.
        assert!((point.q[0] - 0.4).abs() < 2e-3 && (point.q[1] - 0.2).abs() < 1e-3, "{point:?}");
    }

    #[test]
    fn brakes_stop_all_joints_together() {
        let mut point = JointPoint { q: [0.0; 6], qd: [1.0, -0.5, 0.0, 0.0, 0.0, 0.2] };
        let mut motion = RobotMotion::Brake { deceleration: 4.0 };
        let mut cycles = 0;
        while !motion.step(&mut point, DT, 1.0) {
            cycles += 1;
            assert!((point.qd[1] + 0.5 * point.qd[0]).abs() < 1e-9 && cycles < 1000);
        }
        assert!((f64::from(cycles) * DT - 0.25).abs() < 2.0 * DT);
    }
}
