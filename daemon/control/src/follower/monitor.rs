//! The arm as its joint states show it: how late it is, whether it is where it was commanded to be, and
//! whether it touches something. Everything here is fed by commands and by joint states alone.

use super::io::JointReading;
use super::motion::{Gap, MotionReport};
use super::settings::FollowerSettings;
use crate::arm::Chain;
use crate::arm::lag::{Aim, DeadTime, LagEstimate, LagEstimator};
use crate::contact::{Contact, EffortReading};
use crate::monitor::{ArmKnowledge, Monitor};
use crate::plane::Plane;
use crate::state::state;
use crate::stop::{StopDetail, StopReason};
use crate::units::Stamp;

/// A tool commanded to this share of the height at which it travels is in free space.
const LIFTED: f64 = 0.9;

/// The judges of the arm inside the loop, and its lag.
#[derive(Debug)]
pub(super) struct ArmMonitor<const J: usize> {
    lag: Box<LagEstimator<J>>,
    dead_time: DeadTime,
    tracking: Box<Monitor<J>>,
    contact: Box<Contact<J>>,
    chain: Chain<J>,
    plane: Plane,
    period_ns: u64,
    /// Lag until it is measured \[s\].
    configured_lag_s: f64,
    arm_max_speed: f64,
}

state! {
    [const J: usize] ArmMonitor<J> { lag, dead_time, tracking, contact }
    fixed { chain, plane, period_ns, configured_lag_s, arm_max_speed }
}

impl<const J: usize> ArmMonitor<J> {
    pub(super) fn new(settings: &FollowerSettings<J>) -> Self {
        let aim = if settings.servo_ns() > 0 { Aim::GroupDelay } else { Aim::Shift };
        let safety = &settings.safety;
        Self {
            lag: Box::new(LagEstimator::new()),
            dead_time: DeadTime::new(settings.dead_time_ns, settings.following).aiming_at(aim),
            tracking: Monitor::boxed(safety.tracking, settings.longest_lag_ns(), *settings.limits.velocity()),
            contact: Contact::boxed(safety.contact, &settings.chain, &settings.payload),
            chain: settings.chain.clone(),
            plane: settings.plane,
            period_ns: settings.period_ns,
            configured_lag_s: settings.dead_time_ns as f64 * 1e-9,
            arm_max_speed: safety.arm_max_speed,
        }
    }

    /// The loop takes charge of an arm that stands still.
    pub(super) fn begin(&mut self, now: Stamp) {
        self.tracking.begin(now);
        self.contact.begin();
    }

    /// An operator gives the arm back, and thereby acknowledges what stopped it.
    pub(super) fn acknowledge(&mut self) {
        self.tracking.acknowledge();
    }

    /// The reason for the last stop still shows: the arm may not be taken over.
    pub(super) fn unsettled(&self) -> bool {
        self.tracking.unsettled(self.arm_max_speed)
    }

    /// Joints `q` \[rad\] were published for `stamp`; they put the tool at `tool` \[m\], plane frame.
    fn commanded(&mut self, stamp: Stamp, q: &[f64; J], tool: &[f64; 3]) {
        self.lag.commanded(stamp, q);
        self.tracking.commanded(stamp, q, tool);
        let lag_s = self.lag.estimate().map_or(self.configured_lag_s, |lag| lag.lag_s);
        let [_, _, height] = *tool;
        let lifted = height >= LIFTED * self.plane.lift_height;
        self.contact.commanded(stamp, q, lag_s, lifted);
    }

    /// Consumers that went on by themselves in a `gap`: that is what the joints answer, before the next
    /// command is made.
    pub(super) fn catch_up(&mut self, gap: &Gap<J>) {
        if let Some((q, tool)) = &gap.carried {
            self.commanded(gap.now, q, tool);
        }
    }

    /// Takes in the command that the tick made; without one the arm moves by itself from now on.
    pub(super) fn record(&mut self, moved: &MotionReport<J>) {
        match &moved.command {
            Some(command) => self.commanded(command.stamp, &command.q, &moved.tool),
            None => self.lag.released(),
        }
    }

    /// Compares the `joints` of this tick with the commands, if the arm is `engaged`: has any to obey.
    /// Returns the stop that follows.
    pub(super) fn observe(
        &mut self,
        joints: Option<&JointReading<J>>,
        effort: Option<&EffortReading<J>>,
        engaged: bool,
    ) -> Option<(StopReason, StopDetail)> {
        let stop = joints.and_then(|joints| self.compare(joints, effort, engaged));
        self.dead_time.advance(self.lag.estimate().as_ref(), self.period_ns);
        stop
    }

    fn compare(
        &mut self,
        joints: &JointReading<J>,
        effort: Option<&EffortReading<J>>,
        engaged: bool,
    ) -> Option<(StopReason, StopDetail)> {
        self.lag.measured(joints.stamp, &joints.q);
        if !engaged {
            self.tracking.watched(joints.stamp, &joints.q);
            self.contact.pause();
            return None;
        }
        let (chain, plane) = (&self.chain, &self.plane);
        let tool_of = |q: &[f64; J]| plane.point_from_base(&chain.forward(q).position).into();
        let known = ArmKnowledge { lag: self.lag.estimate(), response: Some(&*self.lag) };
        let wrong = self.tracking.measured(joints.stamp, &joints.q, &known, tool_of);
        let wrong = wrong.map(|detail| (StopReason::TrackingError, detail));
        // Judged in any case: contact keeps a record of every joint state.
        let touched = effort.and_then(|effort| self.contact.measured(&joints.q, effort));
        wrong.or(touched.map(|detail| (StopReason::Contact, detail)))
    }

    /// Dead time τ of the arm at present \[ns\].
    pub(super) fn dead_time_ns(&self) -> u64 {
        self.dead_time.ns()
    }

    pub(super) fn lag(&self) -> Option<LagEstimate> {
        self.lag.estimate()
    }

    /// See [`Monitor::speed_share`].
    pub(super) fn speed_share(&self) -> Option<f64> {
        self.tracking.speed_share()
    }

    /// See [`Monitor::allowed_mps`].
    pub(super) fn allowed_mps(&self) -> Option<f64> {
        self.tracking.allowed_mps()
    }
}
