//! The first stages of a tick: input from joints, dead-man switch, operator and pen.

use super::Follower;
use super::io::{Health, JointReading, MAX_STEPS_PER_TICK, Refusal, Request, StepInput};
use crate::contact::EffortReading;
use crate::pen::{Motion, PenReading};
use crate::predict::LearnStep;
use crate::skill::Closed;
use crate::stop::StopReason;
use crate::units::Stamp;

/// What joints, dead-man switch and operator reported.
pub(super) struct Seen {
    /// Time without ticks before this one \[ns\].
    pub(super) lost_ns: u64,
    /// Answer to the request.
    pub(super) answer: Option<Result<(), Refusal>>,
    /// The next command begins where the arm stands.
    pub(super) begins: bool,
}

/// What the pen reported in one tick.
pub(super) struct PenNews {
    pub(super) learn: [LearnStep; MAX_STEPS_PER_TICK],
    /// The same steps for the skill.
    pub(super) closed: [Closed; MAX_STEPS_PER_TICK],
    /// Grid steps closed.
    pub(super) count: usize,
    pub(super) jumped: bool,
    /// Error of the one-step prediction of the first of them \[m\].
    pub(super) error: Option<f64>,
    /// Age of the newest sample \[ns\].
    pub(super) age_ns: Option<u64>,
}

impl<const N: usize, const J: usize> Follower<N, J> {
    /// Watch and monitor. Stops latch here, before anything is planned.
    pub(super) fn take_in(&mut self, input: &StepInput<'_, J>, health: &mut Health) -> Seen {
        let now = input.now;
        let begins_again = self.mover.settle(input.unsent);
        let lost_ns = self.mover.catch_up(now, health);
        if lost_ns > self.settings.safety.latch_after_ns {
            self.watch.latch(now, StopReason::TimeLost);
        }
        // The arm went on by itself: that is what its joints answer, before the next command is made.
        if lost_ns > 0
            && let Some((q, tool)) = self.mover.carried()
        {
            self.lag.commanded(now, &q);
            self.tell_judges(now, &q, &tool);
        }
        if let Some((reason, detail)) = input.halt {
            self.watch.latch_with(now, reason, detail);
        }
        self.watch.observe(now, input.joints, input.enable, health);
        if let Some(joints) = input.joints.filter(|_| !health.has(Health::JOINTS_REJECTED)) {
            self.measure(now, joints, input.effort);
        }
        self.dead_time.advance(self.lag.estimate().as_ref(), self.settings.period_ns);
        let answer = input.request.map(|request| self.answer(now, request));
        let begins =
            matches!((input.request, answer), (Some(Request::Arm | Request::MoveHome), Some(Ok(()))));
        self.watch.check(now, health);
        Seen { lost_ns, answer, begins: begins || begins_again }
    }

    fn measure(&mut self, now: Stamp, joints: &JointReading<J>, effort: Option<&EffortReading<J>>) {
        self.lag.measured(joints.stamp, &joints.q);
        self.monitor_joints(now, joints, effort);
    }

    /// Takes in the pen samples, and closes grid steps with them.
    pub(super) fn read_pen(&mut self, now: Stamp, samples: &[PenReading], health: &mut Health) -> PenNews {
        let before = self.pen.counters().rejected();
        for sample in samples {
            let position = self.settings.plane.from_pen(sample.position);
            self.pen.ingest(now, &PenReading { position, ..*sample });
        }
        if self.pen.counters().rejected() > before {
            health.set(Health::PEN_REJECTED);
        }
        let mut news = PenNews {
            learn: [LearnStep::default(); MAX_STEPS_PER_TICK],
            closed: [Closed::default(); MAX_STEPS_PER_TICK],
            count: 0,
            jumped: false,
            error: None,
            age_ns: self.pen.age_ns(now),
        };
        let mut expected = self.preview.next_displacement();
        for (slot, closed) in news.learn.iter_mut().zip(&mut news.closed) {
            let Some(step) = self.pen.next_step() else { break };
            *slot = self.previewer.observe(&step);
            *closed = Closed { motion: slot.motion, position: step.position, unit_m: slot.scale_m };
            news.count += 1;
            match slot.motion {
                Motion::Continues => {
                    // Only the first step of a tick was predicted from the step just before it.
                    if let Some([x, y]) = expected.take() {
                        let [dx, dy] = step.displacement;
                        news.error = Some((dx - x).hypot(dy - y));
                    }
                }
                Motion::Jump => {
                    news.jumped = true;
                    expected = None;
                }
                Motion::Start => expected = None,
            }
        }
        if news.jumped {
            health.set(Health::PEN_JUMP);
        }
        if news.age_ns.is_none_or(|age| age > self.settings.trust.stale_after_ns) {
            health.set(Health::PEN_STALE);
        }
        if let Some(newest) = self.pen.newest() {
            self.silence.hear(&newest);
        }
        self.watch.observe_pen(news.age_ns);
        news
    }
}
