//! The arm's servo, if it is a filter and not a pure delay.
//!
//! Contract: critically damped second order, ÿ = ω²(p − y) − 2ωẏ from the commanded tool position p to the
//! arm's y, group delay 2/ω, per axis of the plane's frame. [`ServoModel::follow`] gives the arm's response
//! to what was really published; the plan predicts that response (`mpc::behind`). Absent: dynamics beyond
//! this order, and any pure delay before it (which is dead time).

use crate::units::AxisState;

/// The filter, see the module.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct ServoModel {
    /// ω \[1/s\].
    omega: f64,
}

impl ServoModel {
    /// The servo with the group delay `delay_ns` \[ns\]; `None` for 0: the arm is at the command.
    pub(crate) fn new(delay_ns: u64) -> Option<Self> {
        (delay_ns > 0).then(|| Self { omega: 2e9 / delay_ns as f64 })
    }

    /// The arm after `dt` \[s\] in which the command moved linearly from `from` to `to` \[m\]; exact.
    pub(crate) fn follow(&self, arm: &AxisState, from: f64, to: f64, dt: f64) -> AxisState {
        let w = self.omega;
        let slope = (to - from) / dt;
        let lag = 2.0 / w * slope;
        let decay = (-w * dt).exp();
        let (e, ed) = (arm.position - (from - lag), arm.velocity - slope);
        let position = to - lag + (e + (ed + w * e) * dt) * decay;
        let velocity = slope + (ed - w * (ed + w * e) * dt) * decay;
        AxisState { position, velocity, acceleration: w * w * (to - position) - 2.0 * w * velocity }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const DT: f64 = 0.002;

    #[test]
    fn no_delay_is_no_servo() {
        assert_eq!(ServoModel::new(0), None);
    }

    #[test]
    fn arm_trails_a_steady_command_by_the_group_delay() {
        let servo = ServoModel::new(30_000_000).unwrap();
        let mut arm = AxisState::at_rest(0.0);
        for k in 0..1000 {
            arm = servo.follow(&arm, f64::from(k) * 1e-3, f64::from(k + 1) * 1e-3, DT);
        }
        assert!((1.0 - arm.position - 0.5 * 0.030).abs() < 1e-9, "{}", arm.position);
        assert!((arm.velocity - 0.5).abs() < 1e-9 && arm.acceleration.abs() < 1e-6);
    }
}
