//! Taking charge of an arm, giving it back, and resuming after lost time.
//!
//! Contract: a command stamp never decreases, not even across an arming. After lost time the commanded state
//! is that of a consumer which followed the last command as long as it was valid and then braked.

use nalgebra::Vector3;

use super::{CommandedArm, Gap, Mover, SentCommand};
use crate::follower::io::{Health, Refusal};
use crate::guard::{Commanded, StopProfile, consumer_state};
use crate::units::{AxisState, Stamp};

impl<const N: usize, const J: usize> Mover<N, J> {
    /// Takes charge of an arm that stands at `q`.
    pub(in crate::follower) fn seed(&mut self, now: Stamp, q: &[f64; J]) -> Result<(), Refusal> {
        let (kinematics, tool) = self.arming.pose(self.guard.limits(), &self.chain, q)?;
        let start = now.max(self.issued);
        let command = Commanded::at_rest(start, *q).ok_or(Refusal::OutsideJointLimits)?;
        self.ik.bind(true);
        if let Some(envelope) = self.ik.envelope() {
            envelope.begin(&kinematics);
        }
        self.tool = [tool.x, tool.y, tool.z].map(AxisState::at_rest);
        self.arm = self.tool;
        self.plan_start = None;
        self.reach = 1.0;
        self.approaching = true;
        self.height = self.plane.lift_height;
        self.held = Some(CommandedArm::new(command, start + self.valid_ns, kinematics));
        self.kept = None;
        Ok(())
    }

    /// Gives the arm back.
    pub(in crate::follower) fn let_go(&mut self) {
        self.held = None;
        self.kept = None;
        self.plan_start = None;
        self.leave_home();
    }

    /// The commanded state is at rest.
    pub(in crate::follower) fn at_rest(&self) -> bool {
        self.held.as_ref().is_none_or(|held| StopProfile::is_done(&held.command))
    }

    /// Begins a tick at `now`: the last step's command was sent or `unsent`, and consumers may have been
    /// carried on by themselves since.
    pub(in crate::follower) fn begin(&mut self, now: Stamp, unsent: bool, health: &mut Health) -> Gap<J> {
        let begins = self.acknowledge(unsent);
        let lost_ns = self.catch_up(now, health);
        let held = self.held.as_ref().filter(|_| lost_ns > 0);
        let carried = held.map(|held| (*held.command.q(), self.commanded_tool().into()));
        Gap { now, lost_ns, carried, begins }
    }

    /// The last step's command was sent, or consumers still follow the one before. Returns whether that one
    /// should have been their first.
    fn acknowledge(&mut self, unsent: bool) -> bool {
        let Some(held) = &mut self.held else { return false };
        if unsent {
            let SentCommand { command, valid_until } = held.sent;
            (held.command, held.valid_until) = (command, valid_until);
            held.kinematics = self.chain.forward(command.q());
        } else {
            (held.sent, held.fresh) = (held.made, false);
        }
        held.fresh
    }

    /// Puts the commanded state where consumers are at `now`, if periods were lost since the last command.
    ///
    /// Returns how long nothing was commanded \[ns\].
    fn catch_up(&mut self, now: Stamp, health: &mut Health) -> u64 {
        let from = self.commanded_tool();
        let lost = self.held.as_ref().map_or(0, |held| now.since(held.command.stamp()));
        if let Some(envelope) = self.ik.envelope() {
            envelope.tick(now, u64::try_from(lost).unwrap_or(0));
        }
        let Some(held) = &mut self.held else { return 0 };
        let Ok(lost @ 1..) = u64::try_from(lost) else { return 0 };
        health.set(Health::TIME_LOST | Health::RESYNCHRONISED);
        let decel = self.guard.limits().deceleration();
        let motion = consumer_state(&held.command, held.valid_until, decel, now);
        // A finite command stays finite on its way to rest; if not, the arm stays where the command left it.
        let at_rest = Commanded::at_rest(now, *held.command.q());
        held.command = Commanded::new(now, motion).or(at_rest).unwrap_or(held.command);
        held.valid_until = now + self.valid_ns;
        held.kinematics = self.chain.forward(held.command.q());
        let planned = self.tool;
        self.resynchronise();
        if lost > self.valid_ns {
            self.plan_start = None;
            self.arm = self.tool;
        } else {
            self.resume(&planned, &from, lost as f64 * 1e-9);
        }
        self.miss_home(lost);
        lost
    }

    /// Goes on after `lost_s` in which the arm followed the last command, from `from` \[m\].
    ///
    /// Nothing accelerated meanwhile, but the plan's acceleration is taken up where it was: built up again
    /// within the plan's jerk after every gap, it would never be reached by a loop that loses every third
    /// period, and what the plan brakes for would be passed.
    fn resume(&mut self, planned: &[AxisState; 3], from: &Vector3<f64>, lost_s: f64) {
        for (axis, planned) in self.tool.iter_mut().zip(planned) {
            axis.acceleration = planned.acceleration;
        }
        match self.servo {
            Some(servo) => self.trail(&servo, from, lost_s),
            None => self.arm = self.tool,
        }
    }
}
