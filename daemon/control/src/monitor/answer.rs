//! One or two joints that do not answer their commands as the rest of the arm does.
//!
//! Contract: a hand that comes back makes the range of recent commands as large as its letters, and whatever
//! moves a little in the midst of it is inside. But the joints of an arm answer alike: where the response
//! that fits the arm as a whole ([`crate::arm::response`]) puts the tool is where it is, if all joints do as
//! the others. Time in which the tool is farther from there than [`FAR`] of its tolerance adds up, and is
//! forgotten within a second; [`LASTS`] of it is a fault of the joint that takes the tool farthest. Where
//! more than two joints differ, the arm as a whole has changed: that is for the other parts of the monitor.
//!
//! An arm behind a speed slider cuts off the fastest joints only, at the same share of their limits. As long
//! as those that differ are slower than asked, and no joint has been faster, the arm may be one, and
//! [`super::pace`] is given the time to slow the tool down; but not below a share of [`SLIDER`], where a hand
//! seldom moves so that this can be told from joints that are slow.

#![expect(clippy::indexing_slicing, reason = "indices run over the joints, the length of every array")]

use super::path::BLOCK_NS;
use crate::arm::response::Expected;
use crate::state::state;
use crate::units::Stamp;

/// Share of the tolerance of the tool from which it is far.
const FAR: f64 = 0.75;
/// A joint differs if it alone takes the tool this share of that.
const PART: f64 = 0.35;
/// A joint differs, too, if it is off by this much \[rad\] and by `ALIKE`.
const OFF_RAD: f64 = 2.5e-3;
/// As a share of its motion, by this much of the joint that is farthest off: then the arm has become later as
/// a whole.
const ALIKE: f64 = 0.4;
/// Joints that may differ in a fault of joints.
const MOST: usize = 2;
/// Blocks of far off that latch, and the time in which they are forgotten \[blocks\]. Thirty in any hundred
/// reach the first number: spread evenly they come to 19.
const LASTS: f64 = 16.0;
const FORGOTTEN: f64 = 100.0;
/// The first number while the arm may be behind a speed slider: a block counts less by as much, so that what
/// was seen before it can be none is not lost.
const LASTS_SLOW: f64 = 75.0;
/// Another joint is faster than one that is cut off by this factor on the share of its limit.
const FASTER: f64 = 1.15;
/// Sliders are at this share of the limits or above it, and the joints that they cut off reach less than this
/// share of what is asked.
const SLIDER: f64 = 0.22;
const SLOWER: f64 = 0.9;

/// What is far off, and for how long.
#[derive(Debug, Clone)]
pub(super) struct Answers<const J: usize> {
    seen: Stamp,
    far: f64,
    /// Fastest measured motion lately, as a share of the limit of each joint.
    fastest: [f64; J],
    /// The same of what was expected.
    asked: [f64; J],
}

state! { [const J: usize] Answers<J> { seen, far, fastest, asked } }

/// What one instant is judged by.
#[derive(Debug)]
pub(super) struct JointEvidence<'a, const J: usize, F> {
    /// How far each joint was asked to move lately \[rad\].
    pub(super) moved: &'a [f64; J],
    /// Its measured speed \[rad/s\], and its limit.
    pub(super) speeds: &'a [f64; J],
    pub(super) limits: &'a [f64; J],
    /// Tolerance of the tool \[m\].
    pub(super) tool_m: f64,
    /// The tool of joint positions \[m\].
    pub(super) tool_of: &'a F,
}

/// A joint that does not answer as the rest of the arm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Differs {
    pub(super) joint: usize,
    /// Distance of the tool from where it would be \[m\], and the limit.
    pub(super) away_m: f64,
    pub(super) limit_m: f64,
}

impl<const J: usize> Answers<J> {
    pub(super) const fn new() -> Self {
        Self { seen: Stamp(0), far: 0.0, fastest: [0.0; J], asked: [0.0; J] }
    }

    /// Whether the instant before that at `stamp` was not seen: the response has just become known.
    pub(super) const fn new_to(&self, stamp: Stamp) -> bool {
        stamp.0.saturating_sub(self.seen.0) > 2 * BLOCK_NS
    }

    pub(super) fn see<F: Fn(&[f64; J]) -> [f64; 3]>(
        &mut self,
        expected: &Expected<J>,
        judged: &JointEvidence<'_, J, F>,
    ) -> Option<Differs> {
        if expected.stamp <= self.seen {
            return None;
        }
        let JointEvidence { moved, speeds, limits, tool_m, tool_of } = *judged;
        let blocks = (expected.stamp.0 - self.seen.0) as f64 / BLOCK_NS as f64;
        self.seen = expected.stamp;
        let keep = (1.0 - blocks / FORGOTTEN).max(0.0);
        self.far *= keep;
        for (most, now) in [(&mut self.fastest, speeds), (&mut self.asked, &expected.qd)] {
            *most = std::array::from_fn(|j| (most[j] * keep).max(now[j].abs() / limits[j]));
        }
        let limit_m = FAR * tool_m;
        let there = tool_of(&expected.q);
        let away_m = distance(&tool_of(&expected.measured), &there);
        if !(away_m > limit_m) {
            return None;
        }
        let off_rad: [f64; J] = std::array::from_fn(|j| (expected.q[j] - expected.measured[j]).abs());
        let share = |off: f64, moved: f64| off / moved.max(OFF_RAD);
        let most =
            off_rad.iter().zip(moved.iter()).map(|(off, moved)| share(*off, *moved)).fold(0.0, f64::max);
        let mut worst = (0, 0.0);
        let mut differing = 0;
        let (mut cut_off, mut others, mut slower) = (0.0_f64, 0.0_f64, true);
        for j in 0..J {
            let mut alone = expected.q;
            alone[j] = expected.measured[j];
            let off_m = distance(&tool_of(&alone), &there);
            let alike = off_rad[j] > OFF_RAD && share(off_rad[j], moved[j]) > ALIKE * most;
            let differs = off_m > PART * limit_m || alike;
            differing += usize::from(differs);
            let group = if differs { &mut cut_off } else { &mut others };
            *group = group.max(self.fastest[j]);
            slower &= !differs || self.fastest[j] < SLOWER * self.asked[j];
            if off_m > worst.1 {
                worst = (j, off_m);
            }
        }
        if differing > MOST {
            return None;
        }
        let slider = slower && cut_off >= SLIDER && others <= FASTER * cut_off;
        self.far += if slider { LASTS / LASTS_SLOW } else { 1.0 };
        (self.far >= LASTS).then_some(Differs { joint: worst.0, away_m, limit_m })
    }
}

fn distance(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    let [x, y, z] = [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
    x.hypot(y).hypot(z)
}
