//! The judges of the arm inside the loop, tracking and contact: inputs, and the stops that follow.

use super::Follower;
use super::io::JointReading;
use crate::contact::EffortReading;
use crate::monitor::Known;
use crate::stop::StopReason;
use crate::units::Stamp;

/// A tool commanded to this share of the height at which it travels is in free space.
const LIFTED: f64 = 0.9;

impl<const N: usize, const J: usize> Follower<N, J> {
    /// Compares a joint state with the commands, while there are any to obey.
    pub(super) fn monitor_joints(
        &mut self,
        now: Stamp,
        joints: &JointReading<J>,
        effort: Option<&EffortReading<J>>,
    ) {
        if !self.watch.engaged() {
            self.monitor.watched(joints.stamp, &joints.q);
            self.contact.pause();
            return;
        }
        let (chain, plane) = (&self.settings.chain, &self.settings.plane);
        let tool_of = |q: &[f64; J]| plane.point_from_base(&chain.forward(q).position).into();
        let known = Known { lag: self.lag.estimate(), response: Some(&*self.lag) };
        if let Some(detail) = self.monitor.measured(joints.stamp, &joints.q, &known, tool_of) {
            self.watch.latch_with(now, StopReason::TrackingError, detail);
        }
        if let Some(detail) = effort.and_then(|effort| self.contact.measured(&joints.q, effort)) {
            self.watch.latch_with(now, StopReason::Contact, detail);
        }
    }

    /// Joints `q` \[rad\] were published for `stamp`; they put the tool at `tool` \[m\], plane frame.
    pub(super) fn tell_judges(&mut self, stamp: Stamp, q: &[f64; J], tool: &[f64; 3]) {
        self.monitor.commanded(stamp, q, tool);
        let configured_s = self.settings.dead_time_ns as f64 * 1e-9;
        let lag_s = self.lag.estimate().map_or(configured_s, |lag| lag.lag_s);
        let [_, _, height] = *tool;
        let lifted = height >= LIFTED * self.settings.plane.lift_height;
        self.contact.commanded(stamp, q, lag_s, lifted);
    }
}
