//! The tracking monitor inside the loop: its inputs, and the stops that follow from its findings.

use super::Follower;
use super::io::JointReading;
use crate::stop::StopReason;
use crate::units::Stamp;

impl<const N: usize, const J: usize> Follower<N, J> {
    /// Compares a joint state with the commands, while there are any to obey.
    pub(super) fn monitor_joints(&mut self, now: Stamp, joints: &JointReading<J>) {
        if !self.watch.engaged() {
            self.monitor.watched(joints.stamp, &joints.q);
            return;
        }
        let place = self.settings.chain.forward(&joints.q).position;
        let tool = self.settings.plane.point_from_base(&place).into();
        let lag = self.lag.estimate();
        if let Some(detail) = self.monitor.measured(joints.stamp, &joints.q, &tool, lag.as_ref()) {
            self.watch.latch_with(now, StopReason::TrackingError, detail);
        }
    }
}
