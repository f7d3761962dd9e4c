//! The tracking monitor inside the loop: its inputs, and the stops that follow from its findings.

use super::Follower;
use super::io::JointReading;
use crate::monitor::Known;
use crate::stop::StopReason;
use crate::units::Stamp;

impl<const N: usize, const J: usize> Follower<N, J> {
    /// Compares a joint state with the commands, while there are any to obey.
    pub(super) fn monitor_joints(&mut self, now: Stamp, joints: &JointReading<J>) {
        if !self.watch.engaged() {
            self.monitor.watched(joints.stamp, &joints.q);
            return;
        }
        let (chain, plane) = (&self.settings.chain, &self.settings.plane);
        let tool_of = |q: &[f64; J]| plane.point_from_base(&chain.forward(q).position).into();
        let known = Known { lag: self.lag.estimate(), response: Some(&*self.lag) };
        if let Some(detail) = self.monitor.measured(joints.stamp, &joints.q, &known, tool_of) {
            self.watch.latch_with(now, StopReason::TrackingError, detail);
        }
    }
}
