//! Arms that move at a fraction of the commanded speed, as behind a speed slider: detection, and the speed
//! that may be asked of them.
//!
//! Contract: a slow arm has a ceiling on its joint speeds, whatever its lag. Its fastest recent motion is
//! compared with that of a model with the same lag and the most damping that such an arm can have: a
//! critically damped filter with the whole lag as its group delay. A sound arm is at least as fast. An arm
//! found too slow twice in a row, after enough motion, is slow; the tool is then asked for no more than what
//! the arm has shown, and for a little more with every window in which the arm keeps up:
//! `Mover::within_reach` limits the plan's references to it.

use super::SPEED_NS;
use super::ceiling::Ceiling;
use super::recent::Recent;
use super::slowest::Filter;
use crate::state::state;
use crate::units::Stamp;

/// Length of a window \[ns\].
const WINDOW_NS: i64 = 100_000_000;
/// Windows in which the arm may already have reached the model's present speed: a model of an arm with
/// unknown lag is slow itself.
const REMEMBERED: usize = 6;
/// An arm that reaches less than this share of the speed of its model is slow, after `SLOW_WINDOWS`.
pub(super) const SLOW_SHARE: f64 = 0.75;
/// So many windows in a row show that an arm is slow.
const SLOW_WINDOWS: u32 = 2;
/// So many windows have to be judged before: the first strokes after arming say little.
const LEAST_WINDOWS: u32 = 8;
/// An arm that reaches less than this share stands still.
const STANDS: f64 = 0.05;
/// A window is judged where the model reaches this speed \[rad/s\].
const JUDGED_RADPS: f64 = 0.25;
/// Factor from window to window on the fastest commanded tool speed.
const TOOL_KEPT: f64 = 0.9;
/// Time for a slow arm to come back to its commands \[ns\].
const PATIENCE_NS: u64 = 1_000_000_000;
/// An arm that reaches this share keeps up; its limit grows by the second factor in the next window.
const KEEPS_UP: f64 = 0.95;
const MORE: f64 = 1.01;
/// The limit is released at this multiple of the speed asked for when the arm was found slow, which may have
/// been the beginning of faster motion.
const RELEASED: f64 = 3.0;
/// The limit falls per window to no less than this share of the speed asked for last, nor below this \[m/s\].
const LEAST_STEP: f64 = 0.3;
const LEAST_MPS: f64 = 0.02;
/// While the arm is behind, the limit is at most this share of it.
const BEHIND_STEP: f64 = 0.95;
/// Smoothing time of the model's speed \[s\]: the arm's speeds are means over two or three joint states,
/// which reduces short strokes more than long ones.
const SMOOTH_S: f64 = 0.012;
/// Longer steps of the model count as this long \[s\].
const LONGEST_STEP_S: f64 = 0.02;

/// Fastest in a window: commands, model and arm, joint by joint \[rad/s\], and the commanded tool \[m/s\].
#[derive(Debug, Clone, Copy)]
struct Peaks<const J: usize> {
    asked: [f64; J],
    model: [f64; J],
    arm: [f64; J],
    tool_mps: f64,
}

state! { [const J: usize] Peaks<J> { asked, model, arm, tool_mps } }

impl<const J: usize> Peaks<J> {
    const NONE: Self = Self { asked: [0.0; J], model: [0.0; J], arm: [0.0; J], tool_mps: 0.0 };
}

/// The model, two windows, and the results.
#[derive(Debug, Clone)]
pub(super) struct PaceMonitor<const J: usize> {
    /// Position, speed and smoothed speed of each joint.
    model: Option<(Stamp, [[f64; 3]; J])>,
    lag_s: f64,
    /// Fastest that the tool was commanded to move in the last windows \[m/s\].
    tool_mps: f64,
    tool: Option<(Stamp, [f64; 3])>,
    before: Peaks<J>,
    now: Peaks<J>,
    /// Fastest in each of the last windows: the arm may be ahead of its model.
    past: [Peaks<J>; REMEMBERED],
    ceiling: Ceiling<J>,
    /// When joints were last measured, and where they were commanded to be \[rad\].
    seen: Option<Stamp>,
    sent: Option<(Stamp, [f64; J])>,
    asks: Recent<J>,
    window: Option<Stamp>,
    windows: u32,
    judged_windows: u32,
    slow_in_a_row: u32,
    /// It was slightly outside its commands in this window.
    behind: bool,
    /// A slow arm has until then to come back to its commands.
    patient_until: Option<Stamp>,
    judged: bool,
    /// Tool speed asked for when the arm was found slow, and the present limit \[m/s\].
    slowed: Option<[f64; 2]>,
}

state! {
    [const J: usize] PaceMonitor<J> {
        model, lag_s, tool_mps, tool, before, now, past, ceiling, seen, sent, asks, window, windows,
        judged_windows, slow_in_a_row, behind, patient_until, judged, slowed,
    }
}

impl<const J: usize> PaceMonitor<J> {
    pub(super) const fn new() -> Self {
        Self {
            model: None,
            lag_s: 0.0,
            tool_mps: 0.0,
            tool: None,
            before: Peaks::NONE,
            now: Peaks::NONE,
            past: [Peaks::NONE; REMEMBERED],
            ceiling: Ceiling::new(),
            seen: None,
            sent: None,
            asks: Recent::new(),
            window: None,
            windows: 0,
            judged_windows: 0,
            slow_in_a_row: 0,
            behind: false,
            patient_until: None,
            judged: false,
            slowed: None,
        }
    }

    /// Fraction of the commanded speed at which the arm moves, 1 unless it is slow; `None` until it has
    /// moved.
    pub(super) fn share(&self) -> Option<f64> {
        self.slowed.map(|[asked, allowed]| (allowed / asked).min(1.0)).or(self.judged.then_some(1.0))
    }

    /// The arm follows, but too slowly, and is being asked for less.
    pub(super) fn patient(&self, stamp: Stamp) -> bool {
        self.slowed.is_some() || self.patient_until.is_some_and(|until| stamp < until)
    }

    /// Speed limit of the tool \[m/s\]; `None`: its own limits.
    pub(super) fn allowed_mps(&self) -> Option<f64> {
        self.slowed.map(|[_, allowed]| allowed)
    }

    /// Joints `q` \[rad\] and tool \[m\] commanded for `stamp`, to an arm with lag `lag_s`.
    pub(super) fn commanded(&mut self, stamp: Stamp, q: &[f64; J], tool: &[f64; 3], lag_s: f64) {
        if let Some((before, from)) = self.tool.replace((stamp, *tool)) {
            let elapsed_s = stamp.seconds_since(before).max(1e-4);
            let [x, y, z] =
                tool.iter().zip(from).map(|(to, from)| to - from).fold([0.0; 3], |[_, y, z], d| [y, z, d]);
            self.now.tool_mps = self.now.tool_mps.max(x.hypot(y).hypot(z) / elapsed_s);
        }
        if let Some((before, from)) = self.sent.replace((stamp, *q)) {
            let elapsed_s = stamp.seconds_since(before).max(1e-4);
            for (index, (to, from)) in q.iter().zip(&from).enumerate() {
                self.ceiling.commanded(index, (to - from) / elapsed_s);
            }
        }
        self.asks.push(stamp, q);
        if let Some(speeds) = self.asks.speed(SPEED_NS) {
            self.now.asked.iter_mut().zip(speeds).for_each(|(peak, speed)| *peak = peak.max(speed.abs()));
        }
        let (before, joints) = self.model.get_or_insert_with(|| (stamp, q.map(|q| [q, 0.0, 0.0])));
        let elapsed_s = stamp.seconds_since(*before).clamp(0.0, LONGEST_STEP_S);
        *before = stamp;
        // The lag of a slow arm seems to grow, and a model with that lag would be as slow.
        self.lag_s = if self.slowed.is_some() { self.lag_s.min(lag_s) } else { lag_s };
        let filter = Filter::new(self.lag_s, elapsed_s);
        let smoothing = 1.0 - (-elapsed_s / SMOOTH_S).exp();
        for ([position, speed, smooth], (target, peak)) in
            joints.iter_mut().zip(q.iter().zip(&mut self.now.model))
        {
            filter.step(position, speed, *target);
            *smooth += smoothing * (*speed - *smooth);
            *peak = peak.max(smooth.abs());
        }
    }

    /// The joints were measured to move at `speeds` \[rad/s\], `behind` their commands or not. Returns the
    /// share of speed of an arm that was just found to be slow.
    pub(super) fn measured(&mut self, stamp: Stamp, speeds: &[f64; J], behind: bool) -> Option<f64> {
        self.behind |= behind;
        let elapsed_s = self.seen.replace(stamp).map_or(0.0, |before| stamp.seconds_since(before));
        self.ceiling.measured(elapsed_s.clamp(0.0, LONGEST_STEP_S), speeds);
        for (peak, speed) in self.now.arm.iter_mut().zip(speeds) {
            *peak = peak.max(speed.abs());
        }
        let begin = *self.window.get_or_insert(stamp);
        if stamp.since(begin) < WINDOW_NS {
            return None;
        }
        self.window = Some(stamp);
        self.windows = self.windows.saturating_add(1);
        let found = if self.windows >= 2 { self.judge(stamp) } else { None };
        self.before = std::mem::replace(&mut self.now, Peaks::NONE);
        self.past.rotate_right(1);
        if let Some(newest) = self.past.first_mut() {
            *newest = self.before;
        }
        found
    }

    fn judge(&mut self, stamp: Stamp) -> Option<f64> {
        self.tool_mps = (TOOL_KEPT * self.tool_mps).max(self.before.tool_mps);
        let (mut fastest, mut asked) = (self.now.arm, self.now.asked);
        for past in &self.past {
            fastest.iter_mut().zip(&past.arm).for_each(|(most, arm)| *most = most.max(*arm));
            asked.iter_mut().zip(&past.asked).for_each(|(most, asked)| *most = most.max(*asked));
        }
        if let Some(share) = self.ceiling.share(SLOW_SHARE) {
            self.judged = true;
            self.patient_until = Some(stamp.plus_ns(PATIENCE_NS));
            let tool_mps = self.tool_mps;
            let begins = self.slowed.is_none();
            let [_, allowed] = self.slowed.get_or_insert([tool_mps, tool_mps]);
            *allowed = (share.max(LEAST_STEP) * *allowed).max(LEAST_MPS);
            return begins.then_some(share);
        }
        let least = |model: [f64; J]| {
            let (model, arm) = model.into_iter().zip(fastest).max_by(|a, b| a.0.total_cmp(&b.0))?;
            (model >= JUDGED_RADPS).then(|| (arm / model).min(1.0))
        };
        // No filter is faster than its fastest command, but the model is while its lag becomes less: a reason
        // for patience, not for a slower tool.
        let mut model = self.before.model;
        let doubted = least(model)?;
        model.iter_mut().zip(asked).for_each(|(model, asked)| *model = model.min(asked));
        let share = least(model).unwrap_or(1.0);
        self.judged = true;
        let behind = std::mem::take(&mut self.behind);
        let is_slow = |share: f64| share < SLOW_SHARE || behind && share < KEEPS_UP;
        let slow = is_slow(share);
        self.judged_windows = self.judged_windows.saturating_add(1);
        self.slow_in_a_row = if slow { self.slow_in_a_row + 1 } else { 0 };
        if is_slow(doubted) && doubted >= STANDS {
            self.patient_until = Some(stamp.plus_ns(PATIENCE_NS));
        }
        let tool_mps = self.before.tool_mps;
        match &mut self.slowed {
            None if self.slow_in_a_row >= SLOW_WINDOWS && self.judged_windows > LEAST_WINDOWS => {
                self.slow_in_a_row = 0;
                self.slowed = Some([tool_mps, (share.max(LEAST_STEP) * tool_mps).max(LEAST_MPS)]);
                Some(share)
            }
            // At its ceiling it falls behind, however near that is to the commanded speed.
            Some([_, allowed]) if share < KEEPS_UP || behind => {
                *allowed = (share.clamp(LEAST_STEP, BEHIND_STEP) * *allowed).max(LEAST_MPS);
                None
            }
            Some([asked, allowed]) if share >= KEEPS_UP => {
                *allowed *= MORE;
                if *allowed >= RELEASED * *asked {
                    self.slowed = None;
                }
                None
            }
            _ => None,
        }
    }
}
