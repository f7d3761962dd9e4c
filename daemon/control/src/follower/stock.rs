//! What a tick leaves for later ticks: stops, records of planning and following, and who has the arm.

use super::Follower;
use super::io::{Health, Refusal};
use super::motion::Moved;
use crate::stop::StopReason;
use crate::units::Stamp;

impl<const N: usize, const J: usize> Follower<N, J> {
    /// Takes stock of `moved`. `followed`: the pen was to be followed. Returns the outcome of the way home.
    pub(super) fn record_outcome(
        &mut self,
        now: Stamp,
        lost_ns: u64,
        followed: bool,
        moved: &Moved<J>,
        health: Health,
    ) -> Option<Result<(), Refusal>> {
        if let Some(detail) = moved.breach {
            self.watch.latch_with(now, StopReason::Envelope, detail);
        }
        let way = self.record_outcome_of_home(now, &moved.home);
        self.overtaxed = self.overtaxed_by(moved, now, lost_ns);
        self.left.at_limit = moved.at_limit;
        if followed {
            self.plans.see(moved.rung, health);
        }
        if moved.at_rest && self.watch.stopped() && self.watch.came_to_rest() {
            self.mover.let_go();
        }
        match &moved.command {
            Some(command) => {
                self.lag.commanded(command.stamp, &command.q);
                self.tell_judges(command.stamp, &command.q, &moved.tool);
            }
            None => self.lag.released(),
        }
        way
    }

    /// See [`crate::trust::TrustInputs::overtaxed`].
    fn overtaxed_by(&mut self, moved: &Moved<J>, now: Stamp, lost_ns: u64) -> Option<bool> {
        if lost_ns > 0 {
            self.outcome.break_off();
        }
        let Some(pen) = self.pen.newest().filter(|_| moved.follows) else {
            self.outcome.forget();
            return None;
        };
        let [x, y, _] = moved.tool;
        let sample = (pen.stamp, self.settings.mpc.inside(pen.position));
        self.outcome.see(now, [x, y], sample, self.dead_time.ns());
        moved.at_limit.map(|at_limit| at_limit && self.outcome.is_poor())
    }
}
