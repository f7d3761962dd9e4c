//! Whether the arm is where it was commanded to be: measured joints against all commands that they may be
//! answering.
//!
//! Contract: pure, total, no allocation, bounded work per joint state; judges by stamps only. An arm with any
//! lag that the settings allow, by a delay, a servo filter or both, with jitter or a changing lag, is never
//! reported: its joints are weighted means of commands within \[stamp − (longest lag + spread of the filter),
//! stamp\], so they lie inside the span of those. Reported per joint:
//! - *deviation*: outside the span by more than the tolerance, the tool as well;
//! - *runaway* and *wrong direction*: outside by half of the tolerance and moving away;
//! - *oscillation*: outside on alternating sides, farther with each swing;
//! - *no motion*: commands moved the joint, at every lag that is possible, and it stood, though the slowest
//!   arm that is possible would have moved;
//! - *response*: up to two joints do not answer as the rest of the arm does.
//!
//! An arm that only moves slower than it is told is no failure by default: `pace` gives a speed that it can.
//!
//! A servo whose damping is below critical leaves the span by its overshoot: the span is widened by where the
//! arm's own response has the joints, and until that is known by where servos with little damping would be.
//!
//! After a stop for such a reason the arm may not be armed while it moves by itself or is not where it is
//! held, until an operator disarms. Absent: the arm before it was commanded; force.

#![expect(clippy::indexing_slicing, reason = "indices run over the joints, the length of every array")]

mod answer;
mod ceiling;
mod direction;
mod overshoot;
mod pace;
mod path;
mod recent;
mod settings;
mod slowest;
mod swing;

use crate::state::state;
pub use settings::{SlowArm, TrackingSettings};

use answer::{Answers, JointEvidence};
use direction::Directions;
use overshoot::Overshoot;
use pace::{PaceMonitor, SLOW_SHARE};
use path::{BLOCK_NS, KEPT_NS, RangeHistory};
use recent::Recent;
use swing::Swings;

use crate::arm::lag::{LagEstimate, LagEstimator};
use crate::arm::response::Expected;
use crate::stop::{StopCause, StopDetail};
use crate::units::Stamp;

/// The longest lag, if the settings do not say \[ns\].
pub const LONGEST_LAG_NS: u64 = 200_000_000;
/// A command may take effect up to a period after the stamp of the joint state that answers it, and stamps
/// are inexact \[ns\].
const AHEAD_NS: u64 = 10_000_000;
/// A critically damped filter with group delay T has answered all but 1.7 % of a command after 3 T: T, and
/// this multiple of it more.
const SPREAD: f64 = 2.0;
/// The lag estimate determines the spread only if its standard deviation is at most this \[s\].
const GOOD_S: f64 = 3e-3;
/// It does so only after the arm has moved in this many blocks of 10 ms since it was armed, by when the
/// evidence of another arm is forgotten.
const LEARNED_BLOCKS: u32 = 200;
/// Blocks count in which a joint was commanded to move by this much \[rad\].
const MOVING_RAD: f64 = 5e-4;
/// Allowance for jitter and uncertainty on top of it \[ns\].
const JITTER_NS: u64 = 20_000_000;
/// Commands must have moved a joint within a window of this length, which ended one longest lag ago \[ns\].
const MOTION_NS: u64 = 250_000_000;
/// A joint that moves by less than this share of its commands stands still.
const STILL_SHARE: f64 = 0.05;
/// That is a fault where it moves by less than this share of what the slowest possible arm would, because a
/// servo filter takes short strokes away.
const SLOWEST_SHARE: f64 = 0.5;
/// less what an encoder that counts coarsely may hide \[rad\].
const HIDDEN_RAD: f64 = 5e-4;
/// A joint outside its commands by this share of the tolerance and moving away is leaving.
const LEAVING: f64 = 0.5;
/// Swings outside the commands count from the first share of the tolerance, and are reported from the second.
const SWINGING: f64 = 0.1;
const SWUNG: f64 = 0.25;
/// Travel against commands that is reported, as a multiple of the motion that must show.
const AGAINST: f64 = 2.0;
/// An arm outside its commands by this share of the tolerances is behind.
const BEHIND: f64 = 0.1;
/// Factor on the tolerances of a slow arm while the tool is being slowed down, and on that of the tool until
/// the arm has moved enough to be known.
const PATIENT: f64 = 3.0;
/// The expected joints are those of an instant that may be this much older than the measured ones \[s\].
const AGE_S: f64 = 0.015;
/// Speeds are measured over this time at least \[ns\].
const SPEED_NS: u64 = 16_000_000;

/// The monitor of an arm of `J` joints.
#[derive(Debug, Clone)]
pub struct Monitor<const J: usize> {
    settings: TrackingSettings,
    longest_ns: u64,
    /// Velocity limits of the joints \[rad/s\].
    fastest_radps: [f64; J],
    commands: RangeHistory<J>,
    tools: RangeHistory<3>,
    measured: RangeHistory<J>,
    recent: Recent<J>,
    swings: Swings<J>,
    directions: Directions<J>,
    pace: PaceMonitor<J>,
    answers: Answers<J>,
    overshoot: Overshoot<J>,
    /// The block in which the commands were last widened.
    widened: u64,
    /// The newest joint state was slightly outside the commands.
    behind: bool,
    /// Assumed lag of the arm \[s\].
    lag_s: f64,
    /// Joint states from before this are ignored.
    begun: Stamp,
    /// Blocks of commanded motion since then.
    moved: u32,
    /// Since when something is wrong, and the first finding.
    since: Option<(Stamp, StopDetail)>,
    /// The block in which standing still was last checked.
    looked: u64,
    /// A stop was latched here and has not been acknowledged.
    suspect: bool,
}

state! {
    [const J: usize] Monitor<J> {
        commands, tools, measured, recent, swings, directions, pace, answers, overshoot, widened,
        behind, lag_s, begun, moved, since, looked, suspect,
    }
    fixed { settings, longest_ns, fastest_radps }
}

/// What is known about the arm's answer to its commands.
#[derive(Debug, Clone, Copy, Default)]
pub struct ArmKnowledge<'a, const J: usize> {
    /// How late it is.
    pub lag: Option<LagEstimate>,
    /// Where its own response has the joints.
    pub response: Option<&'a LagEstimator<J>>,
}

/// How a joint differs from its commands.
#[derive(Debug, Clone, Copy)]
struct JointFinding {
    detail: StopDetail,
    severity: f64,
}

impl<const J: usize> Monitor<J> {
    /// A monitor without observations, of an arm whose lag is at most `longest_ns` and whose joints are no
    /// faster than `fastest_radps` \[rad/s\].
    #[must_use]
    pub fn new(settings: TrackingSettings, longest_ns: u64, fastest_radps: [f64; J]) -> Self {
        Self {
            settings,
            fastest_radps,
            longest_ns: longest_ns.min(KEPT_NS / 2),
            commands: RangeHistory::new(),
            tools: RangeHistory::new(),
            measured: RangeHistory::new(),
            recent: Recent::new(),
            swings: Swings::new(),
            directions: Directions::new(),
            pace: PaceMonitor::new(),
            answers: Answers::new(),
            overshoot: Overshoot::new(),
            widened: 0,
            behind: false,
            lag_s: longest_ns as f64 * 1e-9,
            begun: Stamp(0),
            moved: 0,
            since: None,
            looked: 0,
            suspect: false,
        }
    }

    /// The same on the heap; on a stack frame of its own, because it is large.
    #[must_use]
    #[inline(never)]
    pub fn boxed(settings: TrackingSettings, longest_ns: u64, fastest_radps: [f64; J]) -> Box<Self> {
        Box::new(Self::new(settings, longest_ns, fastest_radps))
    }

    /// The loop takes charge of an arm that stands still: earlier commands and joint states are ignored.
    pub fn begin(&mut self, now: Stamp) {
        self.commands.clear();
        self.tools.clear();
        self.measured.clear();
        self.swings = Swings::new();
        self.directions = Directions::new();
        self.pace = PaceMonitor::new();
        self.answers = Answers::new();
        self.overshoot.forget();
        self.begun = now;
        self.moved = 0;
        self.since = None;
        self.suspect = false;
    }

    /// The joints `q` \[rad\] were commanded for `stamp`, which put the tool at `tool` \[m\], plane frame.
    pub fn commanded(&mut self, stamp: Stamp, q: &[f64; J], tool: &[f64; 3]) {
        self.commands.push(stamp, q);
        self.tools.push(stamp, tool);
        self.pace.commanded(stamp, q, tool, self.lag_s);
        if self.moved < LEARNED_BLOCKS {
            self.overshoot.commanded(stamp, q);
            for joints in self.overshoot.positions() {
                self.commands.widen(joints);
            }
        }
    }

    /// Fraction of the commanded speed at which the arm moves; `None` until it has moved.
    #[must_use]
    pub fn speed_share(&self) -> Option<f64> {
        self.pace.share()
    }

    /// Speed limit of the tool for a slow arm \[m/s\]; `None`: its own limits.
    #[must_use]
    pub fn allowed_mps(&self) -> Option<f64> {
        self.pace.allowed_mps().filter(|_| self.settings.slow_arm == SlowArm::SlowDown)
    }

    /// A joint state of an arm in charge: joints `q` \[rad\], measured at `stamp`. `tool_of` gives the tool
    /// that joints have \[m\], plane frame. Returns what is wrong, once that has lasted.
    pub fn measured(
        &mut self,
        stamp: Stamp,
        q: &[f64; J],
        known: &ArmKnowledge<'_, J>,
        tool_of: impl Fn(&[f64; J]) -> [f64; 3],
    ) -> Option<StopDetail> {
        if self.recent.newest().is_some_and(|newest| newest >= stamp) {
            return None;
        }
        self.recent.push(stamp, q);
        if stamp < self.begun {
            return None;
        }
        self.measured.push(stamp, q);
        self.widen(known.response.and_then(LagEstimator::expected), &tool_of);
        let reach_ns = self.reach_ns(known.lag.as_ref());
        let oldest = Stamp(stamp.0.saturating_sub(reach_ns));
        let speeds = self.recent.speed(SPEED_NS);
        let found = self.outside(oldest, stamp, q, &tool_of(q), &speeds.unwrap_or([0.0; J]));
        self.since = self.since.filter(|_| found.is_some());
        let lasting = self.lasting(stamp, found);
        let still = self.standing(stamp);
        let differs = known.response.and_then(|response| self.differs(response, speeds.as_ref(), &tool_of));
        let slow = speeds.and_then(|speeds| self.slow(stamp, &speeds));
        let wrong = lasting.or(still).or(differs).or(slow);
        self.suspect |= wrong.is_some();
        wrong
    }

    /// A joint state while the arm is not in charge or stopped.
    pub fn watched(&mut self, stamp: Stamp, q: &[f64; J]) {
        if self.recent.newest().is_none_or(|newest| newest < stamp) {
            self.recent.push(stamp, q);
        }
    }

    /// An operator gives the arm back, and thereby acknowledges what stopped it.
    pub fn acknowledge(&mut self) {
        self.suspect = false;
    }

    /// Whether the reason for the stop still shows: the arm moves by itself at more than `speed_radps`, or is
    /// not where it is held.
    #[must_use]
    pub fn unsettled(&self, speed_radps: f64) -> bool {
        if !self.suspect {
            return false;
        }
        let moves =
            self.recent.speed(5 * SPEED_NS).is_none_or(|speed| speed.iter().any(|v| v.abs() > speed_radps));
        let held = self.commands.last().map(|(_, held)| held);
        let away = held.zip(self.recent.last()).is_none_or(|(held, q)| {
            held.iter().zip(q).any(|(held, q)| !((held - q).abs() <= self.settings.joint_rad))
        });
        moves || away
    }

    /// Adds to the span what servos with overshoot make of the commands, once per block.
    fn widen(&mut self, expected: Option<&Expected<J>>, tool_of: &impl Fn(&[f64; J]) -> [f64; 3]) {
        if self.widened == self.measured.newest() {
            return;
        }
        self.widened = self.measured.newest();
        if self.moved < LEARNED_BLOCKS {
            for joints in self.overshoot.positions() {
                self.tools.widen(&tool_of(joints));
            }
        }
        let Some(expected) = expected else { return };
        let mut ahead = expected.q;
        ahead.iter_mut().zip(&expected.qd).for_each(|(q, qd)| *q += qd * AGE_S);
        for joints in [&expected.q, &ahead] {
            self.commands.widen(joints);
            self.tools.widen(&tool_of(joints));
        }
    }

    /// A joint that does not answer as the rest of the arm.
    fn differs(
        &mut self,
        response: &LagEstimator<J>,
        speeds: Option<&[f64; J]>,
        tool_of: &impl Fn(&[f64; J]) -> [f64; 3],
    ) -> Option<StopDetail> {
        let newest = response.expected()?;
        let (begun, tool_m) = (self.begun, self.settings.tool_m);
        let lately = Stamp(newest.stamp.0.saturating_sub(self.longest_ns + MOTION_NS));
        let moved = self.commands.span_of_ends(lately, newest.stamp)?.width();
        let (speeds, limits) = (speeds.unwrap_or(&[0.0; J]), &self.fastest_radps);
        let judged = JointEvidence { moved: &moved, speeds, limits, tool_m, tool_of };
        let mut found = None;
        if self.answers.new_to(newest.stamp) {
            // What the arm did before its response was known is judged now.
            response.expected_lately(|expected| {
                if expected.stamp >= begun {
                    found = self.answers.see(expected, &judged).or(found);
                }
            });
        } else {
            found = self.answers.see(newest, &judged);
        }
        let found = found?;
        let (cause, joint) = (StopCause::Response, u8::try_from(found.joint).ok());
        let (amount, limit) = (found.away_m, found.limit_m);
        Some(StopDetail { cause, joint, amount, limit, ..StopDetail::default() })
    }

    /// Age of the oldest command that a joint state may still be answering \[ns\].
    fn reach_ns(&mut self, lag: Option<&LagEstimate>) -> u64 {
        let longest_s = self.longest_ns as f64 * 1e-9;
        let known = lag.filter(|lag| self.moved >= LEARNED_BLOCKS && lag.std_s <= GOOD_S);
        let filter_s = known.map_or(longest_s, |lag| lag.lag_s.clamp(0.0, longest_s));
        self.lag_s =
            lag.filter(|lag| lag.std_s <= GOOD_S).map_or(longest_s, |lag| lag.lag_s.clamp(0.0, longest_s));
        let spread_ns = (SPREAD * filter_s * 1e9) as u64;
        self.longest_ns.saturating_add(spread_ns).saturating_add(JITTER_NS).min(KEPT_NS)
    }

    /// The largest deviation from all commands from `oldest` to `stamp`.
    fn outside(
        &mut self,
        oldest: Stamp,
        stamp: Stamp,
        q: &[f64; J],
        tool: &[f64; 3],
        speeds: &[f64; J],
    ) -> Option<JointFinding> {
        let newest = stamp.plus_ns(AHEAD_NS);
        let span = self.commands.span(oldest, newest)?;
        let outside = span.outside(q);
        let TrackingSettings { joint_rad, tool_m, runaway_radps, .. } = self.settings;
        self.behind = outside.iter().any(|outside| outside.abs() > BEHIND * joint_rad);
        let grown = self.swings.see(stamp, &outside, SWINGING * self.settings.joint_rad);
        let slow = if self.pace.patient(stamp) { PATIENT } else { 1.0 };
        // An arm that is not known yet may turn out to be slow.
        let unknown = if self.moved < LEARNED_BLOCKS { PATIENT } else { 1.0 };
        let (far_rad, far_m) = (slow * joint_rad, slow * unknown * tool_m);
        let tool_away = self.tools.span(oldest, newest).map_or(0.0, |span| {
            let [x, y, z] = span.outside(tool);
            x.hypot(y).hypot(z)
        });
        self.behind |= tool_away > BEHIND * tool_m;
        let mut worst: Option<JointFinding> = None;
        let mut blame = |cause, joint, amount: f64, limit: f64| {
            let severity = amount / limit;
            if severity > worst.as_ref().map_or(1.0, |worst| worst.severity) {
                let detail = StopDetail { cause, joint, amount, limit, ..StopDetail::default() };
                worst = Some(JointFinding { detail, severity });
            }
        };
        let then = self.commands.last().map_or(q, |(_, commanded)| commanded);
        for j in 0..J {
            let joint = u8::try_from(j).ok();
            let away = outside[j].abs();
            if let Some(swing) = grown[j] {
                blame(StopCause::Oscillation, joint, swing, SWUNG * joint_rad);
            }
            let leaving = speeds[j] * outside[j].signum();
            // Where the tool is away already, the joint that takes it there is named.
            let least = if tool_away > far_m { BEHIND } else { LEAVING };
            if away > least * joint_rad && away <= joint_rad && leaving > runaway_radps {
                // The largest lead of the commands in the other direction, of all that may be answered.
                let against = if outside[j] > 0.0 { span.high[j] - then[j] } else { then[j] - span.low[j] };
                if against > LEAVING * joint_rad && away > LEAVING * joint_rad {
                    blame(StopCause::WrongDirection, joint, away, LEAVING * joint_rad);
                } else {
                    blame(StopCause::Runaway, joint, leaving, runaway_radps);
                }
            }
            blame(StopCause::JointDeviation, joint, away, far_rad);
        }
        // Several joints that are each a little off: what names a joint comes first.
        if worst.is_none() {
            let detail = StopDetail {
                cause: StopCause::ToolDeviation,
                amount: tool_away,
                limit: far_m,
                ..StopDetail::default()
            };
            worst = (tool_away > far_m).then_some(JointFinding { detail, severity: tool_away / far_m });
        }
        worst
    }

    /// What is wrong, once that has lasted. The first finding remains the cause: a runaway also ends as a
    /// deviation.
    fn lasting(&mut self, stamp: Stamp, found: Option<JointFinding>) -> Option<StopDetail> {
        let detail = found?.detail;
        let (since, first) = self.since.get_or_insert((stamp, detail));
        if first.cause == detail.cause {
            *first = detail;
        }
        let hold_ns = i64::try_from(self.settings.hold_ns).unwrap_or(i64::MAX).max(1);
        (stamp.since(*since) >= hold_ns).then_some(*first)
    }

    /// An arm that was just found to be slow, if that is a reason to stop.
    fn slow(&mut self, stamp: Stamp, speeds: &[f64; J]) -> Option<StopDetail> {
        let share = self.pace.measured(stamp, speeds, self.behind)?;
        let (cause, amount) = (StopCause::SlowArm, share);
        let detail = StopDetail { cause, joint: None, amount, limit: SLOW_SHARE, ..StopDetail::default() };
        (self.settings.slow_arm == SlowArm::Stop).then_some(detail)
    }

    /// A joint that stood while its commands moved it, at every possible lag, or moved against them; checked
    /// once per block.
    fn standing(&mut self, stamp: Stamp) -> Option<StopDetail> {
        if self.measured.newest() == self.looked {
            return None;
        }
        self.looked = self.measured.newest();
        let widest = |width: [f64; J]| width.iter().fold(0.0, |most: f64, width| most.max(*width));
        let block_ago = Stamp(stamp.0.saturating_sub(BLOCK_NS));
        let last_block = self.commands.span_of_ends(block_ago, stamp)?.width();
        if widest(last_block) > MOVING_RAD {
            self.moved = self.moved.saturating_add(1);
        }
        let limit = AGAINST * self.settings.still_rad;
        let complete = self.looked.saturating_sub(1);
        if let Some((joint, amount)) = self.directions.see(complete, &self.measured, &self.commands, limit) {
            let (cause, joint) = (StopCause::WrongDirection, u8::try_from(joint).ok());
            return Some(StopDetail { cause, joint, amount, limit, ..StopDetail::default() });
        }
        let begin = Stamp(stamp.0.checked_sub(self.longest_ns + MOTION_NS)?);
        if begin < self.begun {
            return None;
        }
        let lately = Stamp(stamp.0.saturating_sub(self.longest_ns));
        let asked = self.commands.span_of_ends(begin, lately)?.width();
        let done = self.measured.span(begin, stamp)?.width();
        let limit = self.settings.still_rad;
        let moved = asked.iter().filter(|asked| **asked > limit).count();
        let pairs = asked.iter().zip(&done).enumerate();
        let still = pairs.filter(|(joint, (asked, done))| {
            let stands = **asked > limit && **done < STILL_SHARE * **asked;
            let slowest = || slowest::moved(&self.commands, *joint, self.lag_s, begin);
            stands && **done < SLOWEST_SHARE * slowest() - HIDDEN_RAD
        });
        let count = still.clone().count();
        let (joint, (asked, _)) = still.max_by(|a, b| a.1.0.total_cmp(b.1.0))?;
        // All joints that were commanded stand: report the arm, not a joint.
        let joint = if count == moved && moved > 1 { None } else { u8::try_from(joint).ok() };
        Some(StopDetail { cause: StopCause::NoMotion, joint, amount: *asked, limit, ..StopDetail::default() })
    }
}
