//! Turns plain data about ticks into lines of the log.
//!
//! Contract: changes are logged at once, floods once per second with their number. A refusal for a reason not
//! logged before is logged at once too.

use foretrace_control::follower::Mode;
use foretrace_control::learn::{Promotion, PromotionCause};
use foretrace_control::pen::TARGET_RMS;
use foretrace_control::predict::PredictorKind;
use foretrace_control::stop::StopReason;
use foretrace_control::units::Stamp;
use foretrace_shm::{RejectReason, arm_flags};
use tracing::{debug, info, warn};

use super::refused;
use crate::learner::LearnerEvent;
use crate::rt::facts::TickFacts;
use crate::wire;

/// Time between two lines about the same flood \[ns\].
const FLOOD_NS: i64 = 1_000_000_000;
/// Time in which related events are gathered after the first \[ns\].
const GATHER_NS: i64 = 20_000_000;

/// Time between two lines about new weights of one model \[ns\].
const LEARNED_NS: i64 = 10_000_000_000;

/// Counts between two lines about new weights of a model.
#[derive(Debug, Clone, Copy, Default)]
struct Lessons {
    told_at: Option<Stamp>,
    better: u32,
    back: u32,
}

/// Counts between two lines about a flood.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
struct Troubles {
    overruns: u64,
    skipped: u64,
    shed: u64,
    not_sent: u64,
    over: u64,
    pen_rejected: u64,
    pen_dropped: u64,
    pen_deferred: u64,
    joints_rejected: u64,
    enable_rejected: u64,
    joints_dropped: u64,
    evidence_dropped: u64,
    learn_dropped: u64,
    weights_refused: u64,
    receive_failures: u64,
}

impl Troubles {
    fn of(facts: &TickFacts) -> Self {
        let (tally, ports) = (&facts.tally, &facts.ports);
        let pen = &facts.output.pen_counters;
        let by_grid = pen.non_finite + pen.out_of_range + pen.from_future + pen.time_backwards;
        let sum = |counts: &[u64]| counts.iter().fold(0_u64, |sum, n| sum.saturating_add(*n));
        Self {
            overruns: tally.overruns,
            skipped: tally.skipped,
            shed: tally.shed,
            not_sent: ports.commands_failed,
            over: tally.commands_over,
            pen_rejected: sum(&ports.pen_rejected) + by_grid,
            pen_dropped: ports.pen_dropped,
            pen_deferred: ports.pen_deferred,
            joints_rejected: sum(&ports.joints_rejected),
            enable_rejected: ports.enable_rejected,
            joints_dropped: ports.joints_dropped,
            evidence_dropped: tally.evidence_dropped,
            learn_dropped: tally.learn_dropped,
            weights_refused: tally.weights_refused,
            receive_failures: ports.receive_failures,
        }
    }

    /// The counts that increased since `before`, in words.
    fn since(&self, before: &Self) -> Vec<String> {
        [
            ("ticks after their deadline", self.overruns, before.overruns),
            ("whole periods lost", self.skipped, before.skipped),
            ("solves shed for lack of time", self.shed, before.shed),
            ("commands not sent", self.not_sent, before.not_sent),
            ("commands over before they could be sent", self.over, before.over),
            ("pen samples refused", self.pen_rejected, before.pen_rejected),
            ("pen samples missing", self.pen_dropped, before.pen_dropped),
            ("ticks with more pen samples than one takes", self.pen_deferred, before.pen_deferred),
            ("joint states refused", self.joints_rejected, before.joints_rejected),
            ("dead-man messages refused", self.enable_rejected, before.enable_rejected),
            ("joint states missing", self.joints_dropped, before.joints_dropped),
            ("tick records lost inside the daemon", self.evidence_dropped, before.evidence_dropped),
            ("grid steps lost on the way to the learner", self.learn_dropped, before.learn_dropped),
            ("sets of weights refused", self.weights_refused, before.weights_refused),
            ("receives failed", self.receive_failures, before.receive_failures),
        ]
        .into_iter()
        .filter(|(_, now, then)| now > then)
        .map(|(what, now, then)| format!("{} {what}", now - then))
        .collect()
    }
}

/// An arm at less than the first share of the commanded speed is slow; above the second it no longer is.
const SLOW_SHARE: f64 = 0.75;
const KEEPS_UP_SHARE: f64 = 0.95;

/// What has been logged.
#[derive(Debug, Default)]
pub struct Narrator {
    mode: Mode,
    predictor: Option<PredictorKind>,
    /// The arm was reported slow.
    slow: bool,
    /// That it moves without a dead-man was logged.
    without_dead_man: bool,
    told: Troubles,
    told_at: Stamp,
    /// Time of the first event not logged yet.
    since: Option<Stamp>,
    worst_wakeup_ns: u64,
    worst_step_ns: u64,
    /// The end of the newest tick.
    now: Stamp,
    lessons: [Lessons; PredictorKind::ALL.len()],
    /// Refusals that were logged: sender, reason and field.
    reasons: Vec<(&'static str, RejectReason, &'static str)>,
}

impl Narrator {
    /// Takes in a tick; returns whether it changed the mode.
    pub fn tick(&mut self, facts: &TickFacts) -> bool {
        let output = &facts.output;
        self.now = facts.finished;
        self.worst_wakeup_ns = self.worst_wakeup_ns.max(facts.times.wakeup);
        self.worst_step_ns = self.worst_step_ns.max(facts.times.step);
        let changed = output.mode != self.mode;
        if changed {
            let (from, to) = (wire::mode(self.mode).label(), wire::mode(output.mode).label());
            match output.stop_reason {
                StopReason::None => info!(tick = facts.tick, "mode {from} -> {to}"),
                StopReason::Requested => info!(tick = facts.tick, "mode {from} -> {to}: as requested"),
                reason => {
                    let mut why = wire::fault(reason).label().to_owned();
                    let detail = wire::stop_detail(&output.stop_detail).to_string();
                    if !detail.is_empty() {
                        why = format!("{why}: {detail}");
                    }
                    warn!(tick = facts.tick, "mode {from} -> {to}: {why}; arm again to continue");
                }
            }
            self.mode = output.mode;
        }
        if self.predictor != Some(output.predictor) {
            if self.predictor.is_some() {
                info!(tick = facts.tick, "predictor {} has taken over", output.predictor.name());
            }
            self.predictor = Some(output.predictor);
        }
        if let Some(news) = self.dead_man(facts) {
            warn!(tick = facts.tick, "{news}");
        }
        self.pace(facts);
        self.floods(facts);
        changed
    }

    /// Says once that an arm moves without a dead-man, and once that it no longer does.
    fn dead_man(&mut self, facts: &TickFacts) -> Option<&'static str> {
        let without = facts.ports.arm_line.flags & arm_flags::WITHOUT_DEAD_MAN != 0;
        match (std::mem::replace(&mut self.without_dead_man, without), without) {
            (false, true) => Some("the arm moves WITHOUT A DEAD-MAN, as started with --without-dead-man"),
            (true, false) => Some("the arm no longer moves without a dead-man"),
            _ => None,
        }
    }

    /// Logs once that the arm is slow, and once that it no longer is; with hysteresis.
    fn pace(&mut self, facts: &TickFacts) {
        let Some(share) = facts.output.arm_speed_share else { return };
        let tick = facts.tick;
        if share < SLOW_SHARE && !self.slow {
            self.slow = true;
            let percent = 100.0 * share;
            warn!(
                tick,
                "the arm moves at about {percent:.0} % of what is asked; the tool slows with it \
                 (safety.tracking.slow_arm)"
            );
        } else if share > KEEPS_UP_SHARE && self.slow {
            self.slow = false;
            info!(tick, "the arm keeps up with what is asked again");
        }
    }

    fn floods(&mut self, facts: &TickFacts) {
        let now = Troubles::of(facts);
        if now == self.told {
            return;
        }
        // A sender can fix what was refused only if the log says why.
        let refusals = [
            ("pen", refused::pen(facts), now.pen_rejected > self.told.pen_rejected),
            ("arm", facts.ports.joints_refused, now.joints_rejected > self.told.joints_rejected),
            ("dead man", facts.ports.enable_refused, now.enable_rejected > self.told.enable_rejected),
        ];
        let refusals = refusals.map(|(who, refused, more)| (who, refused.filter(|_| more)));
        let mut unheard = false;
        for (who, refused) in refusals {
            let Some(why) = refused.map(|refused| refused.why) else { continue };
            let reason = (who, why.reason, why.field);
            // There are three senders, nine reasons and some twenty fields.
            if !self.reasons.contains(&reason) {
                self.reasons.push(reason);
                unheard = true;
            }
        }
        let since = *self.since.get_or_insert(facts.finished);
        let soon = facts.finished.since(self.told_at) < FLOOD_NS || facts.finished.since(since) < GATHER_NS;
        if soon && !unheard {
            return;
        }
        self.since = None;
        let mut lines = now.since(&self.told).join(", ");
        for (who, refused) in refusals {
            if let Some(refused) = refused {
                lines = format!("{lines}; {who}: {}", refused.why);
            }
        }
        // The two numbers separate late wake-ups by the system from long steps of the loop.
        let (wakeup_us, step_us) = (self.worst_wakeup_ns / 1000, self.worst_step_ns / 1000);
        warn!(tick = facts.tick, "{lines} (worst wake-up {wakeup_us} us late, longest step {step_us} us)");
        self.told = now;
        self.told_at = facts.finished;
        self.worst_wakeup_ns = 0;
        self.worst_step_ns = 0;
    }

    /// Logs an event of the learner.
    pub fn learner(&mut self, event: &LearnerEvent) {
        match event {
            LearnerEvent::Promoted(promotion) => self.learned(promotion),
            LearnerEvent::Rules(Ok(())) => info!("learner follows new rules"),
            LearnerEvent::Rules(Err(error)) => warn!("learner keeps its rules: {error}"),
            LearnerEvent::Failed(text) => {
                warn!("learner has failed ({text}); the loop continues with its present weights");
            }
        }
    }

    /// New weights, at most once per [`LEARNED_NS`] and model, with their number since the last line.
    fn learned(&mut self, promotion: &Promotion) {
        let Promotion { model, version, cause, error_leaving, error_coming, .. } = *promotion;
        let name = model.name();
        // Errors are squares in normalised units, and TARGET_RMS is the pen's usual displacement per grid
        // step.
        let steps = |squared: f64| squared.sqrt() / TARGET_RMS;
        let (before, after) = (steps(error_leaving), steps(error_coming));
        if cause == PromotionCause::Followed {
            // Ten times a second.
            debug!(version, "{name} learns: rms error of its previews {before:.2} -> {after:.2} pen steps");
            return;
        }
        let now = self.now;
        let Some(lessons) = self.lessons.get_mut(model.index()) else { return };
        match cause {
            PromotionCause::RolledBack => lessons.back += 1,
            _ => lessons.better += 1,
        }
        if lessons.told_at.is_some_and(|told_at| now.since(told_at) < LEARNED_NS) {
            return;
        }
        let Lessons { better, back, .. } = std::mem::take(lessons);
        lessons.told_at = Some(now);
        let back = if back > 0 { format!(", rolled back {back} times") } else { String::new() };
        info!(
            version,
            "{name} has learned: took better weights {better} times{back}; \
             rms error of its previews {before:.2} -> {after:.2} pen steps"
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ipc::tests::facts;

    #[test]
    fn only_what_increased_is_told() {
        let mut later = facts(9);
        later.tally.overruns = 3;
        later.ports.pen_rejected = [1, 0, 2, 0, 0, 0, 0, 0, 0];
        let lines = Troubles::of(&later).since(&Troubles::of(&facts(1)));
        assert_eq!(lines, ["3 ticks after their deadline", "3 pen samples refused"]);
        assert!(Troubles::of(&later).since(&Troubles::of(&later)).is_empty());
    }

    #[test]
    fn what_is_refused_for_another_reason_is_told_at_once() {
        let mut narrator = Narrator::default();
        let mut facts = facts(1);
        let refused = |reason, field| {
            Some(crate::wire::Refused { why: foretrace_shm::Rejection::new(reason, field), at: Stamp(1) })
        };
        let (degrees, future) =
            (refused(RejectReason::OutOfRange, "q"), refused(RejectReason::FromTheFuture, "stamp_ns"));
        // All within one second of a line about late ticks.
        let mut told = Vec::new();
        for (ms, newest) in [(2000, None), (2100, degrees), (2200, degrees), (2300, future), (2400, degrees)]
        {
            facts.finished = Stamp(ms * 1_000_000);
            facts.tally.overruns = 5;
            facts.ports.joints_refused = newest;
            facts.ports.joints_rejected[0] += u64::from(newest.is_some());
            narrator.tick(&facts);
            told.push(narrator.told.joints_rejected);
        }
        assert_eq!(told, [0, 1, 1, 3, 3]);
    }

    #[test]
    fn an_arm_without_a_dead_man_is_logged_when_it_comes_and_when_it_goes() {
        let mut narrator = Narrator::default();
        let mut facts = facts(1);
        let mut said = Vec::new();
        for flags in [0, arm_flags::WITHOUT_DEAD_MAN, arm_flags::WITHOUT_DEAD_MAN, 0, 0] {
            facts.ports.arm_line.flags = flags;
            said.push(narrator.dead_man(&facts).map(|line| line.contains("WITHOUT A DEAD-MAN")));
        }
        assert_eq!(said, [None, Some(true), None, Some(false), None]);
    }

    #[test]
    fn new_weights_are_told_at_once_then_counted_for_ten_seconds() {
        let mut narrator = Narrator::default();
        let mut facts = facts(1);
        let promotion = Promotion {
            model: PredictorKind::DYBM,
            version: 2,
            cause: PromotionCause::Improved,
            index: 1,
            error_leaving: 4.0,
            error_coming: 1.0,
        };
        let counts = |narrator: &Narrator| narrator.lessons[PredictorKind::DYBM.index()].better;
        let mut seen = Vec::new();
        for second in [1_u64, 2, 5, 10, 12] {
            facts.finished = Stamp(second * 1_000_000_000);
            narrator.tick(&facts);
            narrator.learner(&LearnerEvent::Promoted(promotion));
            seen.push(counts(&narrator));
        }
        // 0: logged, and counted anew.
        assert_eq!(seen, [0, 1, 2, 3, 0]);
    }

    #[test]
    fn a_slow_arm_is_told_once() {
        let mut narrator = Narrator::default();
        let mut facts = facts(1);
        for (share, slow) in
            [(None, false), (Some(0.8), false), (Some(0.3), true), (Some(0.9), true), (Some(1.0), false)]
        {
            facts.output.arm_speed_share = share;
            narrator.tick(&facts);
            assert_eq!(narrator.slow, slow, "{share:?}");
        }
    }

    #[test]
    fn a_change_of_mode_is_noticed_once() {
        let mut narrator = Narrator::default();
        let mut facts = facts(1);
        assert!(!narrator.tick(&facts));
        facts.output.mode = Mode::Armed;
        assert!(narrator.tick(&facts));
        assert!(!narrator.tick(&facts));
    }
}
