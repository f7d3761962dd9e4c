//! Which pairs of shapes can come near each other, and how fast at most.

use std::cmp::Ordering;
use std::collections::BinaryHeap;
use std::f64::consts::PI;

use crate::arm::chain::{Chain, Kinematics};
use crate::arm::limits::JointLimits;
use crate::clearance::{Capsule, Obstacle};
use crate::geometry::{Cuboid, HalfSpace, Segment, Separation, point_plane, segment_box, segment_segment};

/// Links two joints apart that may come nearer than this count as able to meet \[m\].
const NEAR_M: f64 = 1e-3;
/// So does what was found this near: to prove the little between would take long \[m\].
const FOUND_M: f64 = 1.5 * NEAR_M;
/// A capsule whose axis is no farther from its joint's than this share of its radius is turned in place.
const TURNED_IN_PLACE: f64 = 0.25;
/// Postures of one joint at which it is looked whether capsules stay neighbours.
const TRIED: u32 = 48;
/// Postures at which two capsules are looked at, at most; beyond, they count as able to meet.
const LOOKS: u32 = 20_000;

/// What is nearest to what.
#[derive(Debug, Clone, PartialEq)]
pub struct Nearest {
    /// Link of the URDF.
    pub link: String,
    /// The other link; `None` for a plane or box.
    pub other: Option<String>,
    /// Between their surfaces \[m\]; negative where they overlap.
    pub distance_m: f64,
}

/// A capsule of the arm and something that it can come near.
#[derive(Debug, Clone)]
pub(super) struct Pair<const J: usize> {
    pub(super) first: Capsule,
    pub(super) other: Other,
    /// Largest change of the pair's distance per rotation of each joint \[m/rad\]: the radius that the moved
    /// side reaches about the joint's axis.
    pub(super) levers: [f64; J],
    /// Largest distance between two of their points while both move with the arm \[m\]; 0 for a fixed
    /// obstacle.
    pub(super) span: f64,
    /// Index of the plane or box as listed in the settings; 0 for a capsule.
    number: usize,
}

/// The other side of a pair.
#[derive(Debug, Clone)]
pub(super) enum Other {
    Plane(HalfSpace),
    Cuboid(Cuboid),
    /// A capsule of a link farther out.
    Capsule(Capsule),
}

impl<const J: usize> Pair<J> {
    /// Link of the other capsule, if it is one.
    pub(super) const fn other_link(&self) -> Option<usize> {
        match &self.other {
            Other::Capsule(capsule) => Some(capsule.link),
            Other::Plane(_) | Other::Cuboid(_) => None,
        }
    }

    /// The two bodies that it is about: pairs of the same have capsules of the same two links, or of a link
    /// and one obstacle.
    pub(super) const fn bodies(&self) -> [usize; 3] {
        let (kind, other) = match &self.other {
            Other::Plane(_) => (0, self.number),
            Other::Cuboid(_) => (1, self.number),
            Other::Capsule(second) => (2, second.link),
        };
        [kind, self.first.link, other]
    }

    /// Calls `found` with every separation that a row may be about, and returns the smallest distance \[m\].
    pub(super) fn separations(&self, kinematics: &Kinematics<J>, mut found: impl FnMut(Separation)) -> f64 {
        let mut nearest = f64::INFINITY;
        let mut add = |separation: Separation, radius: f64| {
            let distance = separation.distance - radius;
            nearest = nearest.min(distance);
            found(Separation { distance, ..separation });
        };
        let (axis, radius) = (kinematics.axis(&self.first), self.first.radius);
        match &self.other {
            // Both ends, so that a capsule parallel to a plane can neither approach nor tilt into it.
            Other::Plane(plane) => {
                add(point_plane(&axis.from, plane), radius);
                if axis.from != axis.to {
                    add(point_plane(&axis.to, plane), radius);
                }
            }
            Other::Cuboid(cuboid) => {
                add(segment_box(&axis, cuboid), radius);
                for end in [axis.from, axis.to] {
                    add(segment_box(&Segment { from: end, to: end }, cuboid), radius);
                }
            }
            Other::Capsule(second) => {
                add(segment_segment(&axis, &kinematics.axis(second)), radius + second.radius);
            }
        }
        nearest
    }

    /// Names of both sides for messages, numbered as in the settings.
    pub(super) fn called(&self) -> String {
        let (link, number) = (&self.first.name, self.number);
        match &self.other {
            Other::Plane(_) => format!("`{link}` and plane {number} of clearance.planes_m"),
            Other::Cuboid(_) => format!("`{link}` and box {number} of clearance.boxes_m"),
            Other::Capsule(second) => format!("`{link}` and `{}`", second.name),
        }
    }

    pub(super) fn nearest(&self, distance_m: f64) -> Nearest {
        let other = match &self.other {
            Other::Capsule(second) => Some(second.name.clone()),
            Other::Plane(_) | Other::Cuboid(_) => None,
        };
        Nearest { link: self.first.name.clone(), other, distance_m }
    }
}

/// Pairs every moving capsule with every obstacle whose distance it can change.
pub(super) fn with_obstacles<const J: usize>(chain: &Chain<J>, obstacles: &[Obstacle]) -> Vec<Pair<J>> {
    let first_axis = chain.forward(&[0.0; J]).jacobian.fixed_view::<3, 1>(3, 0).into_owned();
    // The base does not move.
    let moving = chain.capsules().iter().filter(|capsule| capsule.link > 0);
    let (mut planes, mut boxes) = (0.., 0..);
    let numbers: Vec<usize> = obstacles
        .iter()
        .filter_map(|obstacle| match obstacle {
            Obstacle::HalfSpace(_) => planes.next(),
            Obstacle::Cuboid(_) => boxes.next(),
        })
        .collect();
    let numbered = || obstacles.iter().zip(numbers.iter().copied());
    let pairs = moving.flat_map(|capsule| numbered().map(move |(obstacle, n)| (capsule, obstacle, n)));
    pairs
        .filter_map(|(capsule, obstacle, number)| {
            let other = match obstacle {
                // A first link that turns parallel to the table that the arm stands on, and a housing around
                // the second joint: no joint changes that gap.
                Obstacle::HalfSpace(plane)
                    if (capsule.link == 1 || (capsule.link == 2 && turned_in_place(capsule)))
                        && plane.normal.dot(&first_axis).abs() > 1.0 - 1e-6 =>
                {
                    return None;
                }
                Obstacle::HalfSpace(plane) => Other::Plane(*plane),
                Obstacle::Cuboid(cuboid) => Other::Cuboid(*cuboid),
            };
            Some(Pair { first: capsule.clone(), other, levers: chain.levers(capsule), span: 0.0, number })
        })
        .collect()
}

/// Pairs of capsules that may collide: those of links at least two joints apart, except where exactly two
/// joints lie between and no posture brings them within [`NEAR_M`], or they are [`neighbours`].
pub(super) fn of_itself<const J: usize>(chain: &Chain<J>, limits: &JointLimits<J>) -> Vec<Pair<J>> {
    let capsules = chain.capsules();
    let all = capsules.iter().flat_map(|first| {
        let outer = capsules.iter().filter(move |second| second.link >= first.link + 2);
        outer.map(move |second| (first, second))
    });
    all.filter_map(|(first, second)| {
        let mut levers = chain.levers(second);
        let span = levers.get(first.link).copied().unwrap_or_default();
        // Joints that move both sides alike do not change the distance.
        levers.iter_mut().take(first.link).for_each(|lever| *lever = 0.0);
        let both = [first, second];
        let kept = second.link > first.link + 2
            || !neighbours(chain, limits, both) && can_meet(chain, limits, both, &levers);
        kept.then(|| {
            let turns_at = chain.next_origin(first.link);
            let Segment { from, to } = first.segment;
            let span = span + (from - turns_at).norm().max((to - turns_at).norm());
            Pair { first: first.clone(), other: Other::Capsule(second.clone()), levers, span, number: 0 }
        })
    })
    .collect()
}

/// Whether a capsule that its own joint turns in place, as a housing around that joint's axis, stays within
/// its own width of a capsule two joints further in, however the other joint turns. Only that joint moves the
/// one past the other, so the two are like links with one joint between: its limits keep them apart.
fn neighbours<const J: usize>(
    chain: &Chain<J>,
    limits: &JointLimits<J>,
    [first, second]: [&Capsule; 2],
) -> bool {
    if !turned_in_place(second) {
        return false;
    }
    let [low, turn] = range(limits, first.link);
    let mut q = [0.0; J];
    (0..TRIED).all(|k| {
        let at = low + turn * f64::from(k) / f64::from(TRIED);
        q.iter_mut().skip(first.link).take(1).for_each(|q| *q = at);
        let placed = chain.forward(&q);
        let found = segment_segment(&placed.axis(first), &placed.axis(second));
        found.distance - first.radius - second.radius < 2.0 * second.radius
    })
}

/// Whether a capsule's own joint turns it in place, nearly.
fn turned_in_place(capsule: &Capsule) -> bool {
    let Segment { from, to } = capsule.segment;
    from.xy().norm().max(to.xy().norm()) <= TURNED_IN_PLACE * capsule.radius
}

/// Lower end of a joint's range, and how far it turns from there, a whole turn at most \[rad\].
fn range<const J: usize>(limits: &JointLimits<J>, joint: usize) -> [f64; 2] {
    let [low, high] = limits.position().get(joint).copied().unwrap_or([-PI, PI]);
    [if low.is_finite() { low } else { -PI }, (high - low).min(2.0 * PI)]
}

/// Whether two capsules with two joints between them come within [`FOUND_M`] in some posture; if not, they
/// stay farther apart than [`NEAR_M`]. Ranges of the two joints are halved until the distance in the middle
/// of each shows, by the levers, that it keeps apart everywhere in it; what may come nearest is looked at
/// first.
fn can_meet<const J: usize>(
    chain: &Chain<J>,
    limits: &JointLimits<J>,
    [first, second]: [&Capsule; 2],
    levers: &[f64; J],
) -> bool {
    let joints = [first.link, first.link + 1];
    let lever = joints.map(|joint| levers.get(joint).copied().unwrap_or_default());
    let mut q = [0.0; J];
    let mut look = |ranges: [[f64; 2]; 2]| {
        let middles = ranges.map(|[middle, _]| middle);
        q.iter_mut().skip(first.link).zip(middles).for_each(|(q, middle)| *q = middle);
        let placed = chain.forward(&q);
        let found = segment_segment(&placed.axis(first), &placed.axis(second));
        let apart = found.distance - first.radius - second.radius;
        let [inner_m, outer_m] = [lever[0] * ranges[0][1], lever[1] * ranges[1][1]];
        let nearest = apart - inner_m - outer_m;
        (apart, OpenRanges { nearest, ranges, inner: inner_m > outer_m })
    };
    // Middle and half of each joint's range.
    let whole = joints.map(|joint| {
        let [low, turn] = range(limits, joint);
        [low + 0.5 * turn, 0.5 * turn]
    });
    let mut open = BinaryHeap::from([look(whole).1]);
    for _ in 0..LOOKS / 2 {
        let Some(OpenRanges { ranges: [inner, outer], inner: halve_inner, .. }) = open.pop() else {
            return false;
        };
        let halves = |[middle, half]: [f64; 2]| [-0.5, 0.5].map(|side| [middle + side * half, 0.5 * half]);
        let parts = if halve_inner {
            halves(inner).map(|inner| [inner, outer])
        } else {
            halves(outer).map(|outer| [inner, outer])
        };
        for part in parts {
            let (apart, part) = look(part);
            if !(apart > FOUND_M) {
                return true;
            }
            if !(part.nearest > NEAR_M) {
                open.push(part);
            }
        }
    }
    true
}

/// Ranges of two joints in which capsules may meet; that in which they may come nearest is the greatest.
#[derive(Debug, PartialEq)]
struct OpenRanges {
    /// The least that they can be apart \[m\].
    nearest: f64,
    ranges: [[f64; 2]; 2],
    /// The inner joint is to be halved next.
    inner: bool,
}

impl Eq for OpenRanges {}

impl Ord for OpenRanges {
    fn cmp(&self, other: &Self) -> Ordering {
        other.nearest.total_cmp(&self.nearest)
    }
}

impl PartialOrd for OpenRanges {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}
