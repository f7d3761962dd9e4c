//! Taking charge of an arm, giving it back, and resuming after lost time.
//!
//! Contract: a command stamp never decreases, not even across an arming. After lost time the commanded state
//! is that of a consumer which followed the last command as long as it was valid and then braked.

use super::{Held, Mover};
use crate::follower::io::{Health, Refusal};
use crate::guard::{Commanded, StopProfile, consumer_state};
use crate::units::{AxisState, Stamp};

impl<const N: usize, const J: usize> Mover<N, J> {
    /// Takes charge of an arm that stands at `q`.
    pub(in crate::follower) fn seed(&mut self, now: Stamp, q: &[f64; J]) -> Result<(), Refusal> {
        let (kinematics, tool) = self.arming.place(self.guard.limits(), &self.chain, q)?;
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
        self.held = Some(Held { command, valid_until: start + self.valid_ns, kinematics });
        Ok(())
    }

    /// Gives the arm back.
    pub(in crate::follower) fn let_go(&mut self) {
        self.held = None;
        self.plan_start = None;
        self.leave_home();
    }

    /// The commanded state is at rest.
    pub(in crate::follower) fn at_rest(&self) -> bool {
        self.held.as_ref().is_none_or(|held| StopProfile::is_done(&held.command))
    }

    /// Puts the commanded state where consumers are at `now`, if periods were lost since the last command.
    ///
    /// Returns how long nothing was commanded \[ns\].
    pub(in crate::follower) fn catch_up(&mut self, now: Stamp, health: &mut Health) -> u64 {
        let Some(held) = &mut self.held else { return 0 };
        let Ok(lost @ 1..) = u64::try_from(now.since(held.command.stamp())) else { return 0 };
        health.set(Health::TIME_LOST | Health::RESYNCHRONISED);
        let decel = self.guard.limits().deceleration();
        let motion = consumer_state(&held.command, held.valid_until, decel, now);
        // A finite command stays finite on its way to rest; if not, the arm stays where the command left it.
        let at_rest = Commanded::at_rest(now, *held.command.q());
        held.command = Commanded::new(now, motion).or(at_rest).unwrap_or(held.command);
        held.valid_until = now + self.valid_ns;
        held.kinematics = self.chain.forward(held.command.q());
        if lost > self.valid_ns {
            self.plan_start = None;
        }
        self.resynchronise();
        self.arm = self.tool;
        self.miss_home(lost);
        lost
    }
}
