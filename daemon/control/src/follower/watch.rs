//! Modes: whether the loop is in charge of the arm, and what ends that.
//!
//! Contract: nothing here moves the arm. A stop is latched until an explicit `Arm` request finds a healthy
//! arm at rest.

use super::io::{EnableReading, Health, JointReading, Mode, Refusal, StepInput};
use super::motion::MotionReport;
use super::settings::{FollowerSettings, SafetySettings};
use crate::state::state;
use crate::stop::{StopDetail, StopReason};
use crate::units::Stamp;

/// Stamps may be this far ahead of the tick's release \[ns\]: messages arrive after it, and periods are up to
/// 20 ms.
const MAX_AHEAD_NS: i64 = 50_000_000;

/// A joint state older than this many of its own intervals \[1\], and than this \[ns\], is not enough for
/// arming; the next one is awaited. It may be the last state of an arm that is gone, and the next arm may
/// stand elsewhere.
const ARMING_INTERVALS: i64 = 3;
const ARMING_LEAST_NS: i64 = 20_000_000;

/// What is known about the arm and its operator, and the mode that follows from it.
#[derive(Debug, Clone)]
pub(super) struct ModeWatch<const J: usize> {
    settings: SafetySettings,
    /// Pen samples older than this are stale \[ns\].
    stale_after_ns: u64,
    /// Distance that the arm keeps on its way home \[m\].
    pub(super) margin_m: f64,
    mode: Mode,
    pub(super) reason: StopReason,
    /// Kept across an arming, so that the last stop can be read afterwards.
    pub(super) detail: StopDetail,
    /// Go to Idle once at rest.
    letting_go: bool,
    joints: Option<JointReading<J>>,
    /// Between the newest two joint states \[ns\].
    interval_ns: i64,
    enable: Option<EnableReading>,
    /// The dead-man switch was held at some time since arming, so its loss counts.
    enable_honoured: bool,
}

state! {
    [const J: usize] ModeWatch<J> {
        mode, reason, detail, letting_go, joints, interval_ns, enable, enable_honoured,
    }
    fixed { settings, stale_after_ns, margin_m }
}

impl<const J: usize> ModeWatch<J> {
    pub(super) fn new(settings: &FollowerSettings<J>) -> Self {
        Self {
            settings: settings.safety,
            stale_after_ns: settings.trust.stale_after_ns,
            margin_m: settings.clearance.as_ref().map_or(0.0, |clearance| clearance.margin_m),
            mode: Mode::Idle,
            reason: StopReason::None,
            detail: StopDetail::default(),
            letting_go: false,
            joints: None,
            interval_ns: 0,
            enable: None,
            enable_honoured: false,
        }
    }

    pub(super) fn mode(&self) -> Mode {
        self.mode
    }

    /// The arm is to move with the pen.
    pub(super) fn follows(&self) -> bool {
        matches!(self.mode, Mode::Following | Mode::Holding)
    }

    /// In charge of an arm that obeys, moving or not.
    pub(super) fn engaged(&self) -> bool {
        matches!(self.mode, Mode::Armed | Mode::Following | Mode::Holding | Mode::Homing)
    }

    /// A stop is latched.
    pub(super) fn stopped(&self) -> bool {
        matches!(self.mode, Mode::Stopped | Mode::Fault)
    }

    /// Takes in what arrived after `lost_ns` without ticks; never replaces something newer by something
    /// older. Stops that the shell demands latch here. Returns the joint state, if it was accepted.
    ///
    /// Stamps far ahead of `now` are refused: they would look fresh for a long time.
    pub(super) fn observe<'a>(
        &mut self,
        input: &StepInput<'a, J>,
        lost_ns: u64,
        health: &mut Health,
    ) -> Option<&'a JointReading<J>> {
        let now = input.now;
        if lost_ns > self.settings.latch_after_ns {
            self.latch(now, StopReason::TimeLost);
        }
        if let Some((reason, detail)) = input.halt {
            self.latch_with(now, reason, detail);
        }
        let sound = |stamp: Stamp| stamp.since(now) <= MAX_AHEAD_NS;
        if let Some(new) = input.enable
            && sound(new.stamp)
            && self.enable.is_none_or(|old| new.stamp >= old.stamp)
        {
            self.enable = Some(new);
        }
        let new = input.joints?;
        let finite = new.q.iter().chain(&new.qd).all(|value| value.is_finite());
        let newer = self.joints.as_ref().is_none_or(|old| new.stamp >= old.stamp);
        if !(sound(new.stamp) && finite && newer) {
            health.set(Health::JOINTS_REJECTED);
            return None;
        }
        self.interval_ns = self.joints.as_ref().map_or(0, |old| new.stamp.since(old.stamp));
        self.joints = Some(*new);
        Some(new)
    }

    /// Latches a stop if arm or operator are stale. Judged by stamps.
    pub(super) fn check(&mut self, now: Stamp, health: &mut Health) {
        let stale = !self.joints_fresh(now);
        if stale {
            health.set(Health::JOINTS_STALE);
        }
        let held = self.enable_held(now);
        self.enable_honoured |= held && self.mode != Mode::Idle;
        let lost = self.enable_stops() || !held && (self.settings.enable_required || self.enable_honoured);
        if lost {
            health.set(Health::ENABLE_MISSING);
        }
        if !self.engaged() {
            return;
        }
        if self.joints.as_ref().is_some_and(|joints| !joints.motion_allowed) {
            self.latch(now, StopReason::ArmSafety);
        } else if stale {
            self.latch(now, StopReason::JointStateLost);
        } else if lost {
            self.latch(now, StopReason::EnableLost);
        }
    }

    /// Follows while the pen is live, holds when it is silent for `silent_ns`, or when its newest sample was
    /// `late_ns` old on arrival and that is far too old.
    pub(super) fn observe_pen(&mut self, silent_ns: Option<u64>, late_ns: Option<u64>) {
        let within = |ns: Option<u64>, most_ns: u64| ns.is_some_and(|ns| ns <= most_ns);
        let (hold_after_ns, stale_after_ns) = (self.settings.hold_after_ns, self.stale_after_ns);
        // Both have hysteresis of a factor of 2: a stream near its bound would begin and end motion all the
        // time.
        let live = within(silent_ns, hold_after_ns / 2) && within(late_ns, stale_after_ns);
        let gone = !within(silent_ns, hold_after_ns) || !within(late_ns, 2 * stale_after_ns);
        self.mode = match self.mode {
            Mode::Armed | Mode::Holding if live => Mode::Following,
            Mode::Following if gone => Mode::Holding,
            other => other,
        };
    }

    /// Stops and stays stopped; the first reason stays.
    pub(super) fn latch(&mut self, now: Stamp, reason: StopReason) {
        self.latch_with(now, reason, StopDetail::default());
    }

    /// The same with the evidence.
    pub(super) fn latch_with(&mut self, now: Stamp, reason: StopReason, detail: StopDetail) {
        if self.engaged() {
            self.mode = if reason == StopReason::ArmSafety { Mode::Fault } else { Mode::Stopped };
            self.reason = reason;
            self.detail = StopDetail { at: now, ..detail };
        }
    }

    /// Stops for what was found wrong with the arm.
    pub(super) fn latch_found(&mut self, now: Stamp, stop: Option<(StopReason, StopDetail)>) {
        if let Some((reason, detail)) = stop {
            self.latch_with(now, reason, detail);
        }
    }

    /// Stops, then lets go of the arm.
    pub(super) fn disarm(&mut self, now: Stamp) {
        self.latch(now, StopReason::Requested);
        self.letting_go = true;
    }

    /// Takes in what the tick came to. Returns the result of checking the way home, if there is one, and
    /// whether the loop lets go of the arm.
    pub(super) fn record(
        &mut self,
        now: Stamp,
        moved: &MotionReport<J>,
    ) -> (Option<Result<(), Refusal>>, bool) {
        if let Some(detail) = moved.breach {
            self.latch_with(now, StopReason::Envelope, detail);
        }
        let (way, at_home) = self.record_home(now, &moved.home);
        let lets_go = moved.at_rest && self.letting_go && self.stopped();
        if lets_go {
            self.leave();
            self.reason = StopReason::None;
            self.letting_go = false;
        }
        (way, at_home || lets_go)
    }

    /// Checks everything about arming that needs no geometry; returns the joints to start from.
    pub(super) fn may_arm(&self, now: Stamp, at_rest: bool) -> Result<JointReading<J>, Refusal> {
        match self.mode {
            Mode::Armed | Mode::Following | Mode::Holding => return Err(Refusal::AlreadyArmed),
            Mode::Homing => return Err(Refusal::MovesHome),
            Mode::Idle | Mode::Stopped | Mode::Fault => {}
        }
        if !at_rest {
            return Err(Refusal::StillStopping);
        }
        let joints = self.joints.as_ref().ok_or(Refusal::NoJointState)?;
        let oldest_ns = self.interval_ns.saturating_mul(ARMING_INTERVALS).max(ARMING_LEAST_NS);
        if !self.joints_fresh(now) || now.since(joints.stamp) > oldest_ns {
            return Err(Refusal::JointStateStale);
        }
        if !joints.motion_allowed {
            return Err(Refusal::MotionNotAllowed);
        }
        if !joints.qd.iter().all(|qd| qd.abs() <= self.settings.arm_max_speed) {
            return Err(Refusal::ArmMoves);
        }
        if self.enable_stops() || self.settings.enable_required && !self.enable_held(now) {
            return Err(Refusal::EnableMissing);
        }
        Ok(*joints)
    }

    /// Takes charge, to follow the pen.
    pub(super) fn arm(&mut self, now: Stamp) {
        self.take_charge(now, Mode::Armed);
    }

    /// Takes charge, to move the arm home.
    pub(super) fn move_home(&mut self, now: Stamp) {
        self.take_charge(now, Mode::Homing);
    }

    /// Gives back an arm that stands still.
    pub(super) fn leave(&mut self) {
        self.mode = Mode::Idle;
    }

    fn take_charge(&mut self, now: Stamp, mode: Mode) {
        self.mode = mode;
        self.reason = StopReason::None;
        self.letting_go = false;
        self.enable_honoured = self.enable_held(now);
    }

    /// Whether the operator has let go: the last message counts, however old, until the switch is held again.
    fn enable_stops(&self) -> bool {
        self.enable.is_some_and(|enable| enable.stop)
    }

    fn joints_fresh(&self, now: Stamp) -> bool {
        self.joints
            .as_ref()
            .is_some_and(|joints| now.since(joints.stamp) <= signed(self.settings.joint_state_timeout_ns))
    }

    fn enable_held(&self, now: Stamp) -> bool {
        self.enable.is_some_and(|enable| {
            !enable.stop && now.since(enable.stamp) <= signed(self.settings.enable_timeout_ns)
        })
    }
}

fn signed(ns: u64) -> i64 {
    i64::try_from(ns).unwrap_or(i64::MAX)
}
