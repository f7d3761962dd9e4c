//! The arm at a desk, and the limits of its joints.

use std::collections::VecDeque;

use foretrace_control::arm::{Chain, JointLimits};
use foretrace_control::follower::{JointCommand, JointReading};
use foretrace_control::plane::Plane;
use foretrace_control::units::Stamp;
use foretrace_sim::arm::{ArmModel, ArmSettings, JOINTS};

/// The arm at the other end.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ArmKind {
    /// Follows commands exactly, without delay.
    Ideal,
    /// Follows commands with this delay \[s\]; no limits.
    Delayed(f64),
    /// A simulated UR5 behind its servo.
    Ur5(ArmSettings),
}

/// A joint is asked for more velocity, or for more acceleration from `before` to `after` \[rad/s\], than it
/// is allowed.
pub(crate) fn exceeds(
    limits: &JointLimits<JOINTS>,
    before: &[f64; JOINTS],
    after: &[f64; JOINTS],
    period_s: f64,
) -> bool {
    // Tolerance for rounding.
    const ROUNDING: f64 = 1.0 + 1e-6;
    let allowed = limits.velocity().iter().zip(limits.acceleration());
    before.iter().zip(after).zip(allowed).any(|((before, after), (velocity, acceleration))| {
        after.abs() > velocity * ROUNDING || (after - before).abs() > acceleration * period_s * ROUNDING
    })
}

/// Either arm, as the loop sees it.
pub(crate) struct Arm {
    q: [f64; JOINTS],
    qd: [f64; JOINTS],
    servo: Option<ArmModel>,
    /// Delay \[s\] and the commands that are on their way, oldest first.
    delay: Option<(f64, VecDeque<JointCommand<JOINTS>>)>,
}

impl Arm {
    pub(crate) fn new(kind: ArmKind, home: [f64; JOINTS]) -> Self {
        let servo = match kind {
            ArmKind::Ideal | ArmKind::Delayed(_) => None,
            ArmKind::Ur5(settings) => Some(ArmModel::at_rest(settings, home)),
        };
        let delay = match kind {
            ArmKind::Delayed(delay_s) => Some((delay_s, VecDeque::new())),
            _ => None,
        };
        Self { q: home, qd: [0.0; JOINTS], servo, delay }
    }

    pub(super) fn reading(&self, stamp: Stamp) -> JointReading<JOINTS> {
        JointReading { stamp, q: self.q, qd: self.qd, motion_allowed: true }
    }

    /// Moves through one period with the command made at its beginning.
    pub(crate) fn obey(&mut self, command: &JointCommand<JOINTS>) {
        if let Some((delay_s, underway)) = &mut self.delay {
            underway.push_back(*command);
            // The command that ends at or after the instant which the arm has reached holds for it, as a
            // line.
            let reached = |c: &JointCommand<JOINTS>| command.stamp.seconds_since(c.stamp) - *delay_s;
            while underway.len() > 1 && underway.front().is_some_and(|c| reached(c) > 1e-9) {
                underway.pop_front();
            }
            if let Some(due) =
                underway.front().filter(|c| command.stamp.seconds_since(c.stamp) > *delay_s - 1e-9)
            {
                (self.q, self.qd) = (due.q, due.qd);
            }
            return;
        }
        match &mut self.servo {
            None => (self.q, self.qd) = (command.q, command.qd),
            Some(servo) => {
                // The controller follows the command's line; at the beginning of its cycle that is one period
                // back.
                let cycle_s = servo.settings().cycle_s;
                let mut target = command.q;
                for (q, qd) in target.iter_mut().zip(&command.qd) {
                    *q -= qd * cycle_s;
                }
                let joints = servo.cycle(target);
                (self.q, self.qd) = (joints.q, joints.qd);
            }
        }
    }

    /// Where the tool is in the plane \[m\].
    pub(crate) fn tool(&self, chain: &Chain<JOINTS>, plane: &Plane) -> [f64; 2] {
        let tool = plane.point_from_base(&chain.forward(&self.q).position);
        [tool.x, tool.y]
    }

    /// A limit of the arm itself shaped its last cycle.
    pub(crate) fn clamped(&self) -> bool {
        self.servo.as_ref().is_some_and(ArmModel::clamped)
    }
}
