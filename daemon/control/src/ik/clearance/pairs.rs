//! Capsules in the base frame, and which of them can meet.

use std::f64::consts::PI;

use nalgebra::Vector3;

use super::MAX_CAPSULES;
use super::distance::{Segment, Separation, segment_segment};
use super::shape::Capsule;
use crate::ik::chain::Chain;
use crate::ik::limit::JointLimits;

/// Postures per joint in which neighbours of neighbours are tried.
const TRIED: u32 = 48;

/// What is nearest to what.
#[derive(Debug, Clone, PartialEq)]
pub struct Nearest {
    /// Link of the URDF.
    pub link: String,
    /// The other link; `None` for a plane or box.
    pub other: Option<String>,
    /// Between their surfaces [m]; negative where they overlap.
    pub distance_m: f64,
}

impl Nearest {
    pub(super) fn of(capsules: &[Capsule], first: usize, second: Option<usize>, distance_m: f64) -> Self {
        let name = |link: usize| {
            let named = capsules.iter().find(|capsule| capsule.link == link);
            named.map_or_else(String::new, |capsule| capsule.name.clone())
        };
        Self { link: name(first), other: second.map(name), distance_m }
    }
}

/// The axes of all capsules at one joint position, base frame.
pub(super) struct Placed {
    pub(super) axes: [Segment; MAX_CAPSULES],
}

impl Placed {
    pub(super) fn new<const J: usize>(chain: &Chain<J>, q: &[f64; J]) -> Self {
        let frames = chain.frames(q);
        let mut axes = [Segment { from: Vector3::zeros(), to: Vector3::zeros() }; MAX_CAPSULES];
        for (axis, capsule) in axes.iter_mut().zip(chain.capsules()) {
            let frame = capsule.link.checked_sub(1).and_then(|index| frames.get(index));
            *axis = frame.map_or(capsule.segment, |(rotation, origin)| Segment {
                from: rotation * capsule.segment.from + origin,
                to: rotation * capsule.segment.to + origin,
            });
        }
        Self { axes }
    }
}

impl Separation {
    /// The separation of shapes that are thicker than what was measured by `radius` in all [m].
    pub(super) fn less(self, radius: f64) -> Self {
        Self { distance: self.distance - radius, ..self }
    }
}

/// Pairs of capsules that may meet: those of links at least two joints apart, except where exactly two joints lie between and
/// no posture of these (of `TRIED` by `TRIED`) makes them meet.
pub(super) fn of_itself<const J: usize>(chain: &Chain<J>, limits: &JointLimits<J>) -> Vec<[usize; 2]> {
    let capsules = chain.capsules();
    let all = capsules.iter().enumerate().flat_map(|(a, first)| {
        capsules
            .iter()
            .enumerate()
            .filter_map(move |(b, second)| (second.link >= first.link + 2).then_some(([a, b], first, second)))
    });
    all.filter(|(_, first, second)| second.link > first.link + 2 || can_meet(chain, limits, first, second))
        .map(|(pair, ..)| pair)
        .collect()
}

fn can_meet<const J: usize>(
    chain: &Chain<J>,
    limits: &JointLimits<J>,
    first: &Capsule,
    second: &Capsule,
) -> bool {
    let range = |joint: usize| {
        let [low, high] = limits.position().get(joint).copied().unwrap_or([-PI, PI]);
        let turn = (high - low).min(2.0 * PI);
        let low = if low.is_finite() { low } else { -PI };
        (0..=TRIED).map(move |k| low + turn * f64::from(k) / f64::from(TRIED))
    };
    let place = |q: &[f64; J], capsule: &Capsule| {
        let frames = chain.frames(q);
        let frame = capsule.link.checked_sub(1).and_then(|index| frames.get(index).copied());
        frame.map_or(capsule.segment, |(rotation, origin)| Segment {
            from: rotation * capsule.segment.from + origin,
            to: rotation * capsule.segment.to + origin,
        })
    };
    let mut q = [0.0; J];
    range(first.link).any(|inner| {
        range(first.link + 1).any(|outer| {
            let both = q.iter_mut().skip(first.link).zip([inner, outer]);
            both.for_each(|(q, value)| *q = value);
            let found = segment_segment(&place(&q, first), &place(&q, second));
            found.distance <= first.radius + second.radius
        })
    })
}
