//! What the network sees: a pure function of the last displacements and of the pen's touch.
//!
//! Everything is in the frame of motion (turned so that the recent way points along x), in units of an
//! ordinary step, and in seconds, so that size and speed of the writing and the grid matter little. The one
//! absolute quantity is the direction of that frame in the plane.

use crate::pen::{TARGET_RMS, Touch};
use crate::predict::PenStep;
use crate::predict::models::mixture::is_motion;
use crate::state::state;

/// Displacements that enter one by one, and blocks of displacements before them.
const SINGLE: usize = 8;
/// Displacements whose first halves enter too: how speed and direction change just now.
const HALVES: usize = 6;
/// Blocks of displacements that enter as sums.
const BLOCKS: usize = 8;
/// Longest block \[steps\]: a second of history at 10 ms.
pub const LONGEST_BLOCK: usize = 12;
/// Displacements that are remembered.
pub const HISTORY: usize = SINGLE + BLOCKS * LONGEST_BLOCK;
/// Reach of the history \[s\].
const REACH_S: f64 = 0.24;
/// Weight of a displacement in the direction of motion, over that of the next one.
const DIRECTION_DECAY: f64 = 0.7;
/// A way shorter than this has no direction \[normalised, in the plane\].
const LEAST_WAY: f64 = 1e-3;

/// How many numbers the network sees.
pub const FEATURES: usize = 72;

/// Where the features of one kind stand, for studies that leave them out.
pub mod kinds {
    use std::ops::Range;

    /// Touch, its age and the age of the phase before.
    pub const CONTACT: Range<usize> = 45..49;
    /// Time since the last jump, and since pen down or pen up.
    pub const TIME: Range<usize> = 46..51;
    /// The direction of motion in the plane.
    pub const DIRECTION: Range<usize> = 51..55;
}

/// The features at one step, and the frame that they are in.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Look {
    /// What the network sees.
    pub features: [f32; FEATURES],
    /// Cosine and sine of the direction of motion in the plane; (1, 0) at rest.
    pub frame: [f64; 2],
}

/// The last displacements and the touch; cleared where the pen starts or jumps.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PenHistory {
    /// Newest first, normalised displacements per step.
    recent: [[f32; 2]; HISTORY],
    /// First halves of the newest, less half of the displacements.
    halves: [[f32; 2]; HALVES],
    /// From the newest step's end to the newest sample, normalised.
    ahead: [f32; 2],
    /// How long that took \[s\].
    ahead_s: f32,
    /// Steps since it was cleared.
    steps: u32,
    /// The touch at the newest step.
    touch: Touch,
    /// Steps that the phase before the present one lasted; 0: not seen.
    before: u32,
}

state! { [] PenHistory { recent, halves, ahead, ahead_s, steps, touch, before } }

impl PenHistory {
    /// Before the first step of the pen.
    pub const EMPTY: Self = Self {
        recent: [[0.0; 2]; HISTORY],
        halves: [[0.0; 2]; HALVES],
        ahead: [0.0; 2],
        ahead_s: 0.0,
        steps: 0,
        touch: Touch::INK,
        before: 0,
    };

    /// Remembers a step; a jump clears the memory and counts as rest.
    pub fn observe(&mut self, step: &PenStep) {
        let PenStep { x, half, ahead, ahead_s, touch } = *step;
        if !is_motion(x) {
            *self = Self::EMPTY;
            return self.observe(&PenStep { touch, ..PenStep::of([0.0; 2]) });
        }
        let [hx, hy] = if is_motion(half) { half } else { x.map(|x| 0.5 * x) };
        let known = is_motion(ahead) && ahead_s.is_finite();
        (self.ahead, self.ahead_s) =
            if known { (ahead.map(|x| x as f32), ahead_s as f32) } else { ([0.0; 2], 0.0) };
        self.halves.copy_within(..HALVES - 1, 1);
        let [newest, ..] = &mut self.halves;
        *newest = [(hx - 0.5 * x[0]) as f32, (hy - 0.5 * x[1]) as f32];
        self.recent.copy_within(..HISTORY - 1, 1);
        let [newest, ..] = &mut self.recent;
        *newest = x.map(|x| x as f32);
        if self.steps > 0 && touch.contact != self.touch.contact {
            self.before = self.touch.steps.min(self.steps).saturating_add(1);
        }
        self.steps = self.steps.saturating_add(1);
        self.touch = touch;
    }

    /// Steps since it was cleared.
    #[must_use]
    pub const fn steps(&self) -> u32 {
        self.steps
    }

    /// What the network sees of it on a grid of `step_s` \[s\], with blocks of `block` steps.
    #[must_use]
    pub fn look(&self, step_s: f64, block: usize) -> Look {
        let recent = |from: usize, steps: usize| sum(self.recent.get(from..from + steps).unwrap_or_default());
        let block = block.clamp(1, LONGEST_BLOCK);
        let singles: [[f64; 2]; SINGLE] = std::array::from_fn(|lag| recent(lag, 1));
        let blocks: [[f64; 2]; BLOCKS] = std::array::from_fn(|n| recent(SINGLE + n * block, block));
        let frame = direction(&singles, &blocks);
        let moving = frame != [0.0; 2];
        let [c, s] = if moving { frame } else { [1.0, 0.0] };
        let turned = |[x, y]: [f64; 2]| [c * x + s * y, c * y - s * x];
        let mut features = FeatureRow { numbers: [0.0; FEATURES], next: 0 };
        for single in singles {
            features.extend(turned(single).map(|x| x / TARGET_RMS));
        }
        for sum in blocks {
            features.extend(turned(sum).map(|x| x / (TARGET_RMS * block as f64)));
        }
        let way = |from: usize, steps: usize| recent(from, steps);
        for (from, steps) in [(0, 1), (1, 1), (0, 4), (4, 4), (0, SINGLE + BLOCKS * block)] {
            features.push((length(way(from, steps)) / (TARGET_RMS * steps as f64)).sqrt());
        }
        for ((from, steps), (other, others)) in
            [((0, 1), (1, 1)), ((1, 1), (2, 1)), ((0, 2), (2, 2)), ((0, 4), (4, 4))]
        {
            features.extend(turn(way(from, steps), way(other, others)));
        }
        // Contact, ages: their indices are named in `kinds`.
        let (steps, touch) = (self.steps, self.touch);
        let age_s = f64::from(touch.steps.min(steps)) * step_s;
        let before_s = f64::from(self.before) * step_s;
        features.push(if touch.contact { 1.0 } else { -1.0 });
        features.extend([age_s / (age_s + 0.08), age_s / (age_s + 0.5)]);
        features.push(before_s / (before_s + 0.2));
        let whole_s = f64::from(steps) * step_s;
        features.extend([whole_s / (whole_s + 0.1), whole_s / (whole_s + 1.0)]);
        features.extend(if moving { [c, s] } else { [0.0; 2] });
        features.extend(if moving { [c * c - s * s, 2.0 * s * c] } else { [0.0; 2] });
        for half in self.halves {
            features.extend(turned(half.map(f64::from)).map(|x| 4.0 * x / TARGET_RMS));
        }
        // The newest sample: where it is, how far beyond the way so far, and how new.
        let share = (f64::from(self.ahead_s) / step_s).clamp(0.0, 1.0);
        let ahead = self.ahead.map(f64::from);
        let [x, y] = singles[0];
        features.extend(turned(ahead).map(|x| 2.0 * x / TARGET_RMS));
        features.extend(turned([ahead[0] - share * x, ahead[1] - share * y]).map(|x| 4.0 * x / TARGET_RMS));
        features.push(2.0 * share);
        Look { features: features.numbers, frame: [c, s] }
    }
}

/// Steps of a block of the history on a grid of `step_s` \[s\], for a reach of about 0.24 s.
#[must_use]
pub fn block_of(step_s: f64) -> usize {
    block_for(REACH_S, step_s)
}

/// The same for a reach of `reach_s` \[s\].
#[must_use]
pub fn block_for(reach_s: f64, step_s: f64) -> usize {
    let steps = reach_s / step_s - SINGLE as f64;
    ((steps / BLOCKS as f64).round().max(1.0) as usize).min(LONGEST_BLOCK)
}

/// Numbers written one after another.
struct FeatureRow {
    numbers: [f32; FEATURES],
    next: usize,
}

impl FeatureRow {
    fn push(&mut self, number: f64) {
        if let Some(slot) = self.numbers.get_mut(self.next) {
            *slot = number as f32;
        }
        self.next += 1;
    }

    fn extend<const N: usize>(&mut self, numbers: [f64; N]) {
        for number in numbers {
            self.push(number);
        }
    }
}

fn sum(steps: &[[f32; 2]]) -> [f64; 2] {
    steps.iter().fold([0.0; 2], |[x, y], [dx, dy]| [x + f64::from(*dx), y + f64::from(*dy)])
}

fn length([x, y]: [f64; 2]) -> f64 {
    (x * x + y * y).sqrt()
}

/// Unit vector of the recent way, the newest steps weighing most; zero at rest.
fn direction(singles: &[[f64; 2]; SINGLE], blocks: &[[f64; 2]; BLOCKS]) -> [f64; 2] {
    let mut weight = 1.0;
    let mut way = [0.0; 2];
    for [x, y] in singles.iter().chain(blocks) {
        way = [way[0] + weight * x, way[1] + weight * y];
        weight *= DIRECTION_DECAY;
    }
    let length = length(way);
    if length > LEAST_WAY { way.map(|x| x / length) } else { [0.0; 2] }
}

/// Cosine and sine of the turn from `before` to `after`, less of both where a way is short.
fn turn(after: [f64; 2], before: [f64; 2]) -> [f64; 2] {
    let ([ax, ay], [bx, by]) = (after, before);
    let product = length(after) * length(before) + 1.0;
    [(ax * bx + ay * by) / product, (ay * bx - ax * by) / product]
}
