//! Turns plain data about ticks into lines of the log.
//!
//! Contract: changes are logged at once, floods once per second with their number. A refusal for a reason not
//! logged before is logged at once too.

use foretrace_control::follower::{Health, Mode};
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
use crate::wire::{self, Refused};

/// Time between two lines about the same flood \[ns\].
const FLOOD_NS: i64 = 1_000_000_000;
/// Time in which related events are gathered after the first \[ns\].
const GATHER_NS: i64 = 20_000_000;

/// Time between two lines about new weights of one model \[ns\].
const LEARNED_NS: i64 = 10_000_000_000;

/// Counts between two lines about new weights of a model.
#[derive(Debug, Clone, Copy, Default)]
struct Lessons {
    reported_at: Option<Stamp>,
    better: u32,
    back: u32,
}

/// What comes in floods: its name, how often it has come, and, where it is a refusal, the
/// sender and what it has to know.
type Flood = (&'static str, fn(&TickFacts) -> u64, Option<(&'static str, NewestRefusal)>);
type NewestRefusal = fn(&TickFacts) -> Option<Refused>;

const FLOODS: [Flood; 15] = [
    ("ticks after their deadline", |facts| facts.tally.overruns, None),
    ("whole periods lost", |facts| facts.tally.skipped, None),
    ("solves shed for lack of time", |facts| facts.tally.shed, None),
    ("commands not sent", |facts| facts.ports.commands_failed, None),
    ("commands over before they could be sent", |facts| facts.tally.commands_over, None),
    ("pen samples refused", pen_rejected, Some(("pen", refused::pen))),
    ("pen samples missing", |facts| facts.ports.pen_dropped, None),
    ("ticks with more pen samples than one takes", |facts| facts.ports.pen_deferred, None),
    ("joint states refused", joints_rejected, Some(("arm", |facts| facts.ports.joints_refused))),
    (
        "dead-man messages refused",
        |facts| facts.ports.enable_rejected,
        Some(("dead man", |facts| facts.ports.enable_refused)),
    ),
    ("joint states missing", |facts| facts.ports.joints_dropped, None),
    ("tick records lost inside the daemon", |facts| facts.tally.evidence_dropped, None),
    ("grid steps lost on the way to the learner", |facts| facts.tally.learn_dropped, None),
    ("sets of weights refused", |facts| facts.tally.weights_refused, None),
    ("receives failed", |facts| facts.ports.receive_failures, None),
];

/// How often each of [`FLOODS`] has come.
type FloodCounts = [u64; FLOODS.len()];

fn pen_rejected(facts: &TickFacts) -> u64 {
    let pen = &facts.output.pen_counters;
    let by_grid = pen.non_finite + pen.out_of_range + pen.from_future + pen.time_backwards;
    facts.ports.pen_rejected.iter().fold(by_grid, |sum, count| sum.saturating_add(*count))
}

fn joints_rejected(facts: &TickFacts) -> u64 {
    facts.ports.joints_rejected.iter().fold(0, |sum, count| sum.saturating_add(*count))
}

/// What has come since `before`, each with its number.
fn since<'a>(
    now: &'a FloodCounts,
    before: &'a FloodCounts,
) -> impl Iterator<Item = (&'static Flood, u64)> + 'a {
    let counts = now.iter().zip(before).map(|(now, before)| now.saturating_sub(*before));
    FLOODS.iter().zip(counts).filter(|(_, more)| *more > 0)
}

/// An arm at less than the first share of the commanded speed is slow; above the second it no longer is.
const SLOW_SHARE: f64 = 0.75;
const KEEPS_UP_SHARE: f64 = 0.95;

/// So many samples in a row show how old they are when they arrive.
const AGED_SAMPLES: i32 = 20;

/// What has been logged.
#[derive(Debug, Default)]
pub struct Narrator {
    mode: Mode,
    predictor: Option<PredictorKind>,
    /// The arm was reported slow.
    slow: bool,
    /// Pen samples were reported as too old.
    pen_old: bool,
    /// Samples in a row that arrived too old, or with the sign reversed in time.
    aged: i32,
    pen_stamp: Option<Stamp>,
    /// That it moves without a dead-man was logged.
    without_dead_man: bool,
    reported: FloodCounts,
    reported_at: Stamp,
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
        self.pen_age(facts);
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

    /// Logs once that pen samples are too old when they arrive, and once that they no longer are.
    fn pen_age(&mut self, facts: &TickFacts) {
        let output = &facts.output;
        let Some(stamp) = output.pen_stamp.filter(|stamp| self.pen_stamp != Some(*stamp)) else { return };
        self.pen_stamp = Some(stamp);
        let old = output.health.has(Health::PEN_STALE);
        self.aged = match (old, self.aged) {
            (true, 0..) => (self.aged + 1).min(AGED_SAMPLES),
            (false, ..=0) => (self.aged - 1).max(-AGED_SAMPLES),
            (old, _) => {
                if old {
                    1
                } else {
                    -1
                }
            }
        };
        let tick = facts.tick;
        if self.aged >= AGED_SAMPLES && !self.pen_old {
            self.pen_old = true;
            let age_ms = facts.finished.since(stamp) / 1_000_000;
            warn!(
                tick,
                "pen samples are {age_ms} ms old when they arrive, more than pen.stale_ms: they are not \
                 predicted and begin no motion; raise pen.stale_ms, or shorten their way"
            );
        } else if self.aged <= -AGED_SAMPLES && self.pen_old {
            self.pen_old = false;
            info!(tick, "pen samples arrive within pen.stale_ms again");
        }
    }

    fn floods(&mut self, facts: &TickFacts) {
        let now = FLOODS.map(|(_, count, _)| count(facts));
        if now == self.reported {
            return;
        }
        let increased: Vec<_> = since(&now, &self.reported).collect();
        // A sender can fix what was refused only if the log says why.
        let refusals = increased.iter().filter_map(|((_, _, sender), _)| {
            let (who, newest) = (*sender)?;
            newest(facts).map(|refused| (who, refused.why))
        });
        let refusals: Vec<_> = refusals.collect();
        let mut new_reason = false;
        for reason in refusals.iter().map(|(who, why)| (*who, why.reason, why.field)) {
            // There are three senders, nine reasons and some twenty fields.
            if !self.reasons.contains(&reason) {
                self.reasons.push(reason);
                new_reason = true;
            }
        }
        let since = *self.since.get_or_insert(facts.finished);
        let recent = facts.finished.since(self.reported_at) < FLOOD_NS;
        if (recent || facts.finished.since(since) < GATHER_NS) && !new_reason {
            return;
        }
        self.since = None;
        let counts = increased.iter().map(|((what, ..), more)| format!("{more} {what}"));
        let reasons = refusals.iter().map(|(who, why)| format!("; {who}: {why}"));
        let lines = counts.collect::<Vec<_>>().join(", ") + &reasons.collect::<String>();
        // The two numbers separate late wake-ups by the system from long steps of the loop.
        let (wakeup_us, step_us) = (self.worst_wakeup_ns / 1000, self.worst_step_ns / 1000);
        warn!(tick = facts.tick, "{lines} (worst wake-up {wakeup_us} us late, longest step {step_us} us)");
        self.reported = now;
        self.reported_at = facts.finished;
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
        if lessons.reported_at.is_some_and(|at| now.since(at) < LEARNED_NS) {
            return;
        }
        let Lessons { better, back, .. } = std::mem::take(lessons);
        lessons.reported_at = Some(now);
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
    fn only_what_increased_is_logged() {
        let mut later = facts(9);
        later.tally.overruns = 3;
        later.ports.pen_rejected = [1, 0, 2, 0, 0, 0, 0, 0, 0];
        let [now, before] = [&later, &facts(1)].map(|facts| FLOODS.map(|(_, count, _)| count(facts)));
        let lines: Vec<_> = since(&now, &before).map(|((what, ..), more)| (more, *what)).collect();
        assert_eq!(lines, [(3, "ticks after their deadline"), (3, "pen samples refused")]);
        assert_eq!(since(&now, &now).count(), 0);
    }

    #[test]
    fn a_stream_of_old_samples_is_logged_once_and_a_gap_is_none() {
        let mut narrator = Narrator::default();
        let mut ms = 1000;
        // So many new samples, each seen by three ticks.
        let mut reported = |samples: u64, old: bool| {
            for _ in 0..samples {
                ms += 5;
                let mut facts = facts(ms);
                facts.output.pen_stamp = Some(Stamp(ms * 1_000_000));
                facts.output.health = Health(if old { Health::PEN_STALE } else { 0 });
                for _ in 0..3 {
                    narrator.tick(&facts);
                }
            }
            narrator.pen_old
        };
        assert!(!reported(100, false) && !reported(19, true), "a short stretch says nothing");
        assert!(!reported(1, false) && !reported(19, true), "it is counted from its beginning");
        assert!(reported(1, true) && reported(19, false));
        assert!(!reported(1, false) && !reported(5, true));
    }

    #[test]
    fn what_is_refused_for_another_reason_is_logged_at_once() {
        let mut narrator = Narrator::default();
        let mut facts = facts(1);
        let refused =
            |reason, field| Some(Refused { why: foretrace_shm::Rejection::new(reason, field), at: Stamp(1) });
        let (degrees, future) =
            (refused(RejectReason::OutOfRange, "q"), refused(RejectReason::FromTheFuture, "stamp_ns"));
        let joints = FLOODS.iter().position(|(what, ..)| *what == "joint states refused").unwrap();
        // All within one second of a line about late ticks.
        let mut reported = Vec::new();
        for (ms, newest) in [(2000, None), (2100, degrees), (2200, degrees), (2300, future), (2400, degrees)]
        {
            facts.finished = Stamp(ms * 1_000_000);
            facts.tally.overruns = 5;
            facts.ports.joints_refused = newest;
            facts.ports.joints_rejected[0] += u64::from(newest.is_some());
            narrator.tick(&facts);
            reported.push(narrator.reported[joints]);
        }
        assert_eq!(reported, [0, 1, 1, 3, 3]);
    }

    #[test]
    fn an_arm_without_a_dead_man_is_logged_when_it_comes_and_when_it_goes() {
        let mut narrator = Narrator::default();
        let mut facts = facts(1);
        let mut lines = Vec::new();
        for flags in [0, arm_flags::WITHOUT_DEAD_MAN, arm_flags::WITHOUT_DEAD_MAN, 0, 0] {
            facts.ports.arm_line.flags = flags;
            lines.push(narrator.dead_man(&facts).map(|line| line.contains("WITHOUT A DEAD-MAN")));
        }
        assert_eq!(lines, [None, Some(true), None, Some(false), None]);
    }

    #[test]
    fn new_weights_are_logged_at_once_then_counted_for_ten_seconds() {
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
        // 0: logged, and counted again.
        assert_eq!(seen, [0, 1, 2, 3, 0]);
    }

    #[test]
    fn a_slow_arm_is_logged_once() {
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
