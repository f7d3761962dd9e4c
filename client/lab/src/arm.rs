//! The simulated UR5 controller as mathematics: what its joints do with a stream of joint targets.
//!
//! Contract: one call of [`ArmModel::cycle`] is one controller cycle. The target given in one cycle takes effect in
//! the next (one cycle of delay, reached along a straight line), passes a critically damped second-order servo whose
//! group delay is the look-ahead, and then a first-order joint loop. Both stages obey the velocity and acceleration
//! clamps. Absent: clock, commands and their age (the consumer of commands keeps that), gravity, elasticity.
//! Source: UR10e, servoj with look-ahead 0.03 s and gain 1200: about 34 ms between command and motion.

/// Joints of the simulated arm.
pub const JOINTS: usize = 6;

/// What the arm is made of.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ArmSettings {
    /// Controller cycle [s]: 0.002 for e-series, 0.008 for CB3.
    pub cycle_s: f64,
    /// Group delay of the servo, servoj's `lookahead_time` [s].
    pub look_ahead_s: f64,
    /// Time constant of the joint loop [s].
    pub joint_loop_s: f64,
    /// Largest joint speed [rad/s], per joint.
    pub velocity_radps: [f64; JOINTS],
    /// Largest joint acceleration [rad/s²], per joint.
    pub acceleration_radps2: [f64; JOINTS],
}

impl ArmSettings {
    /// A UR5 behind servoj at `cycle_s` with the given look-ahead: 3.342 rad/s and 40 rad/s², 2 ms of joint loop.
    #[must_use]
    pub fn ur5(cycle_s: f64, look_ahead_s: f64) -> Self {
        Self {
            cycle_s,
            look_ahead_s,
            joint_loop_s: 0.002,
            velocity_radps: [3.342; JOINTS],
            acceleration_radps2: [40.0; JOINTS],
        }
    }
}

impl ArmSettings {
    /// Time from a target to the motion it asks for, at low frequency [s]: cycle, servo and joint loop.
    #[must_use]
    pub fn group_delay_s(&self) -> f64 {
        self.cycle_s + self.look_ahead_s + self.joint_loop_s
    }
}

/// Joint positions [rad] and velocities [rad/s].
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Joints {
    /// [rad]
    pub q: [f64; JOINTS],
    /// [rad/s]
    pub qd: [f64; JOINTS],
}

/// The arm: six independent joints and the target of the previous cycle.
#[derive(Debug, Clone)]
pub struct ArmModel {
    settings: ArmSettings,
    previous_target: [f64; JOINTS],
    servo: [Motion; JOINTS],
    joint: [Motion; JOINTS],
}

impl ArmModel {
    /// An arm at rest at `q` [rad].
    #[must_use]
    pub fn at_rest(settings: ArmSettings, q: [f64; JOINTS]) -> Self {
        let still = q.map(|q| Motion { q, qd: 0.0 });
        Self { settings, previous_target: q, servo: still, joint: still }
    }

    /// Moves through one controller cycle with `target` [rad], where the joints ought to be when the cycle starts,
    /// and returns the joints at its end. A target that is not finite counts as "stay where the last one was".
    pub fn cycle(&mut self, target: [f64; JOINTS]) -> Joints {
        let dt = self.settings.cycle_s;
        for axis in 0..JOINTS {
            let from = self.previous_target[axis];
            let to = if target[axis].is_finite() { target[axis] } else { from };
            let clamp = Clamp {
                v: self.settings.velocity_radps[axis],
                a: self.settings.acceleration_radps2[axis],
                dt,
            };
            let before = self.servo[axis];
            let servo = clamp.apply(before, follow(before, from, to, self.settings.look_ahead_s, &clamp));
            let joint = self.joint[axis];
            self.joint[axis] =
                clamp.apply(joint, settle(joint, before.q, servo.q, self.settings.joint_loop_s, dt));
            self.servo[axis] = servo;
            self.previous_target[axis] = to;
        }
        self.joints()
    }

    /// The joints as the controller would report them now.
    #[must_use]
    pub fn joints(&self) -> Joints {
        Joints { q: self.joint.map(|joint| joint.q), qd: self.joint.map(|joint| joint.qd) }
    }

    /// The settings it was built with.
    #[must_use]
    pub fn settings(&self) -> &ArmSettings {
        &self.settings
    }
}

/// Position [rad] and velocity [rad/s] of one joint.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Motion {
    q: f64,
    qd: f64,
}

/// Critically damped second order, w = 2/look-ahead, behind a target going straight `from` → `to` within the cycle.
///
/// In the frame that follows the ramp with the steady lag `look_ahead`·slope the motion is homogeneous and exact:
/// e(t) = (e₀ + (ė₀ + w e₀) t) exp(−w t). Closing speed is bounded by what can still be braked, so that a large step
/// meets the acceleration clamp without overshoot.
fn follow(state: Motion, from: f64, to: f64, look_ahead_s: f64, clamp: &Clamp) -> Motion {
    let dt = clamp.dt;
    let slope = (to - from) / dt;
    let lag = look_ahead_s * slope;
    let w = 2.0 / look_ahead_s;
    let decay = (-w * dt).exp();
    let (e, ed) = (state.q - (from - lag), state.qd - slope);
    let e_next = (e + (ed + w * e) * dt) * decay;
    let mut ed_next = (ed - w * (ed + w * e) * dt) * decay;
    // Near the ramp the servo never asks for more than the acceleration limit, and is left alone.
    let far = e.abs() > clamp.a / (w * w);
    if far && e * ed_next < 0.0 {
        let most = clamp.brakeable((e.abs() - 0.5 * ed.abs() * dt).max(0.0));
        ed_next = ed_next.clamp(-most, most);
    }
    Motion { q: to - lag + e_next, qd: slope + ed_next }
}

/// First order with time constant `tau` behind an input going straight `from` → `to` within the cycle; exact.
fn settle(state: Motion, from: f64, to: f64, tau: f64, dt: f64) -> Motion {
    let slope = (to - from) / dt;
    let lag = tau * slope;
    let e_next = (state.q - (from - lag)) * (-dt / tau).exp();
    Motion { q: to - lag + e_next, qd: slope - e_next / tau }
}

/// The velocity and acceleration clamps of one joint over one cycle.
struct Clamp {
    v: f64,
    a: f64,
    dt: f64,
}

impl Clamp {
    /// `wanted` if it is within reach of `state`, else the nearest velocity that is, with the position it leads to.
    fn apply(&self, state: Motion, wanted: Motion) -> Motion {
        let qd =
            wanted.qd.clamp(state.qd - self.a * self.dt, state.qd + self.a * self.dt).clamp(-self.v, self.v);
        let mean = (wanted.q - state.q) / self.dt;
        if qd == wanted.qd && mean.abs() <= self.v {
            wanted
        } else {
            Motion { q: state.q + 0.5 * (state.qd + qd) * self.dt, qd }
        }
    }

    /// The speed [rad/s] from which a joint still stops within `distance` [rad], in steps of one cycle.
    fn brakeable(&self, distance: f64) -> f64 {
        let half = 0.5 * self.a * self.dt;
        (half * half + 2.0 * self.a * distance).sqrt() - half
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;

    fn arm(rate_hz: f64) -> ArmModel {
        ArmModel::at_rest(ArmSettings::ur5(1.0 / rate_hz, 0.030), [0.0; JOINTS])
    }

    /// Phase lag [s] of joint 0 behind 0.02 rad·sin(2πft), by correlation over whole periods after settling.
    fn lag_of_sine(rate_hz: f64, look_ahead_s: f64, frequency_hz: f64) -> f64 {
        let mut arm = ArmModel::at_rest(ArmSettings::ur5(1.0 / rate_hz, look_ahead_s), [0.0; JOINTS]);
        let w = TAU * frequency_hz;
        let (settling, periods) = (2.0, 4.0);
        let cycles = ((settling + periods / frequency_hz) * rate_hz).round() as usize;
        let (mut in_phase, mut quadrature) = (0.0, 0.0);
        for k in 0..cycles {
            let t = k as f64 / rate_hz;
            let after = t + 1.0 / rate_hz;
            let q = arm.cycle([0.02 * (w * t).sin(); JOINTS]).q[0];
            if t >= settling {
                in_phase += q * (w * after).sin();
                quadrature += q * (w * after).cos();
            }
        }
        -quadrature.atan2(in_phase) / w
    }

    #[test]
    fn arm_is_still_when_the_target_is_where_it_is() {
        let mut arm = ArmModel::at_rest(ArmSettings::ur5(0.002, 0.03), [0.3, -1.0, 1.2, 0.0, 2.0, -0.1]);
        for _ in 0..100 {
            let joints = arm.cycle([0.3, -1.0, 1.2, 0.0, 2.0, -0.1]);
            assert!(joints.qd.iter().all(|qd| qd.abs() < 1e-12));
        }
        assert!((arm.joints().q[2] - 1.2).abs() < 1e-12);
    }

    #[test]
    fn target_moves_nothing_in_its_own_cycle() {
        // One cycle of delay: the step enters as a ramp over the cycle, of which the servo sees the first half late.
        let mut arm = arm(500.0);
        let first = arm.cycle([0.01; JOINTS]).q[0];
        assert!(first < 0.01 * 0.01, "{first}");
    }

    #[test]
    fn small_step_is_answered_without_overshoot_and_settles() {
        let mut arm = arm(500.0);
        let mut highest = 0.0_f64;
        for _ in 0..250 {
            highest = highest.max(arm.cycle([0.01; JOINTS]).q[0]);
        }
        assert!(highest <= 0.01 + 1e-12, "{highest}");
        assert!((arm.joints().q[0] - 0.01).abs() < 1e-9);
        assert!(arm.joints().qd[0].abs() < 1e-7);
    }

    #[test]
    fn half_hertz_sine_lags_by_thirty_to_forty_milliseconds() {
        // Cycle 2 ms + look-ahead 30 ms + joint loop 2 ms = 34 ms at low frequency (measured on a UR10e: 34 ms).
        let lag = lag_of_sine(500.0, 0.030, 0.5);
        assert!((0.0335..0.0345).contains(&lag), "{lag}");
        // CB3: cycle 8 ms.
        let lag = lag_of_sine(125.0, 0.030, 0.5);
        assert!((0.039..0.041).contains(&lag), "{lag}");
    }

    #[test]
    fn longer_look_ahead_lags_longer() {
        let lag = lag_of_sine(500.0, 0.1, 0.5);
        assert!((0.100..0.106).contains(&lag), "{lag}");
    }

    #[test]
    fn clamps_hold_against_a_large_step_and_it_still_arrives_without_overshoot() {
        for rate in [500.0, 125.0] {
            let mut arm = arm(rate);
            let mut before = arm.joints();
            let mut highest = 0.0_f64;
            for _ in 0..(2.0 * rate) as usize {
                let now = arm.cycle([2.0; JOINTS]);
                assert!(now.qd[0].abs() <= 3.342 + 1e-9);
                assert!((now.qd[0] - before.qd[0]).abs() <= 40.0 / rate + 1e-9);
                assert!((now.q[0] - before.q[0]).abs() <= 3.342 / rate + 1e-9);
                highest = highest.max(now.q[0]);
                before = now;
            }
            assert!((before.q[0] - 2.0).abs() < 1e-3, "{}", before.q[0]);
            assert!(highest < 2.01, "{highest}");
        }
    }

    #[test]
    fn ramp_is_followed_with_the_steady_lag() {
        let mut arm = arm(500.0);
        let (speed, mut last) = (0.5, Joints::default());
        for k in 0..1000 {
            last = arm.cycle([speed * k as f64 * 0.002; JOINTS]);
        }
        // `last` is the state at t = 2 s; the target would be 1.0 rad there.
        assert!((1.0 - last.q[0] - speed * 0.034).abs() < 1e-6, "{}", last.q[0]);
        assert!((last.qd[0] - speed).abs() < 1e-6);
    }

    #[test]
    fn target_that_is_not_a_number_moves_nothing() {
        let mut arm = arm(500.0);
        for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            let joints = arm.cycle([bad; JOINTS]);
            assert_eq!(joints, Joints::default());
        }
    }
}
