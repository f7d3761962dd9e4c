//! Several capsules that hold a triangle mesh together, as tightly as a search finds.
//!
//! A capsule is convex, so a triangle with three corners in it is inside; one whose corners lie in two
//! capsules need not be. So triangles are dealt out, not vertices; long ones are halved first, so that a
//! tube's can be dealt out too. For given axes and radii each triangle goes to the capsule that must grow
//! least for it (distance of its farthest corner − radius), and then every radius is the largest distance of
//! what it got. Axes and radii are searched from the best set covers (`choices`) by an evolution strategy
//! with one parent, one child and the one-fifth rule for its step. What is minimised is a distance: how much
//! farther than the mesh the capsules reach, in the mean over all directions, which is what distances to
//! others are too small by; and the volume of the union, for what is not at the hull. The search sees
//! patches, triangles whose middles are neighbours; the last deal sees every triangle.
//!
//! Contract: every triangle lies in one capsule, but for what is allowed, whatever the search found. The same
//! mesh gives the same capsules. *Source*: Rechenberg, "Evolutionsstrategie", 1973.

use std::collections::BTreeMap;
use std::sync::LazyLock;

use nalgebra::Vector3;

use crate::capsule::{CapsuleAxis, MeshCapsule, ProfileSample, around, sphere};
use crate::choices::{Choices, Patch};

/// Three corners \[m\].
pub(crate) type Triangle = [Vector3<f64>; 3];

/// Edges of the pieces that are dealt out, and patches of the search, as a share of the mesh's size.
const PATCH: f64 = 1.0 / 20.0;
/// Pieces that long triangles may be halved into, in all.
const PIECES: usize = 2_000_000;
/// How many of the best starts are followed, and by how many children per capsule.
const ROUNDS: [(usize, usize); 2] = [(16, 250), (3, 1500)];
/// Children of a single capsule.
const ALONE: usize = 1000;
/// Points of a capsule by which the volume of the union is measured.
const SAMPLES: usize = 250;
/// Directions in which the reach of capsules is compared with the mesh's.
const REACHES: usize = 150;
/// What the volume counts beside the reach: record 26 compares.
const VOLUME: f64 = 0.5;
/// Of two covers whose costs differ by no more than this, that with fewer capsules is taken \[m\].
const WORTH_M: f64 = 2e-4;

/// At most `most` capsules out of which no point of a triangle sticks by more than `outside` \[m\]; none for
/// no triangles.
pub(crate) fn cover(triangles: &[Triangle], most: usize, outside: f64) -> Vec<MeshCapsule> {
    let corners: Vec<Vector3<f64>> = triangles.iter().flatten().copied().collect();
    let Some(one) = around(&corners) else { return Vec::new() };
    if most < 2 {
        return vec![one.smaller(outside)];
    }
    let pieces = halved(triangles, PATCH * size(&corners));
    let task = CoverTask::new(&one, patches(&pieces, PATCH * size(&corners)));
    let choices = Choices::new(&task.patches);
    let alone = evolved(Dealt::new(vec![CapsuleAxis::of(&one)], &task), &task, ALONE);
    let mut found = vec![alone];
    for count in 2..=most {
        let mut tried: Vec<Dealt> =
            choices.covers(count).into_iter().map(|axes| Dealt::new(axes, &task)).collect();
        for (kept, children) in ROUNDS {
            tried.sort_by(|a, b| a.cost.total_cmp(&b.cost));
            tried.truncate(kept);
            tried = tried.into_iter().map(|start| evolved(start, &task, children)).collect();
        }
        found.extend(tried.into_iter().min_by(|a, b| a.cost.total_cmp(&b.cost)));
    }
    let least = found.iter().map(|dealt| dealt.cost).fold(f64::INFINITY, f64::min);
    let few = found.iter().find(|dealt| dealt.cost <= least + WORTH_M);
    few.map_or_else(Vec::new, |dealt| written(&dealt.axes, &pieces, outside))
}

/// What is to be held, and what a cover is judged by.
struct CoverTask {
    patches: Vec<Patch>,
    /// Unit vectors, and how far the mesh reaches along each \[m\].
    reaches: Vec<(Vector3<f64>, f64)>,
    /// Of one capsule around all: turns volume into a mean distance \[m²\].
    surface: f64,
}

impl CoverTask {
    fn new(one: &MeshCapsule, patches: Vec<Patch>) -> Self {
        let reach = |direction: &Vector3<f64>| {
            patches.iter().flatten().map(|point| direction.dot(point)).fold(f64::NEG_INFINITY, f64::max)
        };
        let reaches = sphere(REACHES).map(|direction| (direction, reach(&direction))).collect();
        let surface = std::f64::consts::TAU * one.radius * (one.length + 2.0 * one.radius);
        Self { patches, reaches, surface }
    }

    /// By how much, in the mean over all directions, capsules reach farther than the mesh, and a share of
    /// their volume over the surface of one around all \[m\].
    fn cost(&self, axes: &[CapsuleAxis]) -> f64 {
        let farther = self.reaches.iter().map(|(direction, mesh)| {
            let reach = axes.iter().map(|axis| axis.reach(direction)).fold(f64::NEG_INFINITY, f64::max);
            reach - mesh
        });
        let mean = farther.sum::<f64>() / self.reaches.len().max(1) as f64;
        mean + VOLUME * union(axes, &SAMPLED) / self.surface
    }
}

fn size(points: &[Vector3<f64>]) -> f64 {
    let (mut low, mut high) = (Vector3::repeat(f64::INFINITY), Vector3::repeat(f64::NEG_INFINITY));
    for point in points {
        (low, high) = (low.inf(point), high.sup(point));
    }
    (high - low).norm()
}

/// Triangles halved at their longest edge until no edge is longer than `edge`, as far as [`PIECES`] go.
fn halved(triangles: &[Triangle], edge: f64) -> Vec<Triangle> {
    let mut done = Vec::with_capacity(triangles.len());
    let mut open = triangles.to_vec();
    while let Some(triangle) = open.pop() {
        let [a, b, c] = longest_first(triangle);
        if (b - a).norm() <= edge || done.len() + open.len() >= PIECES {
            done.push([a, b, c]);
            continue;
        }
        let middle = (a + b) * 0.5;
        open.extend([[a, middle, c], [middle, b, c]]);
    }
    done
}

/// The same corners, those of the longest edge first.
fn longest_first([a, b, c]: Triangle) -> Triangle {
    match [(b - a).norm(), (c - b).norm(), (a - c).norm()] {
        [ab, bc, ca] if ab >= bc && ab >= ca => [a, b, c],
        [_, bc, ca] if bc >= ca => [b, c, a],
        _ => [c, a, b],
    }
}

/// Corners of triangles whose middles lie in the same cell of a grid, only those that are farthest in some
/// of the 26 directions to a cube's faces, edges and corners.
fn patches(pieces: &[Triangle], cell: f64) -> Vec<Patch> {
    let mut cells: BTreeMap<[i64; 3], Patch> = BTreeMap::new();
    for piece in pieces {
        let middle: Vector3<f64> = piece.iter().sum::<Vector3<f64>>() / 3.0;
        let key: [i64; 3] = (middle / cell.max(f64::MIN_POSITIVE)).map(|x| x.floor() as i64).into();
        cells.entry(key).or_default().extend(piece);
    }
    let cube = (0..27).filter(|i| *i != 13);
    let directions: Vec<Vector3<f64>> =
        cube.map(|i| Vector3::new(i % 3 - 1, i / 3 % 3 - 1, i / 9 - 1).map(f64::from).normalize()).collect();
    let outermost = |points: Patch| {
        let farthest = |direction: &Vector3<f64>| {
            let reach = points.iter().map(|point| direction.dot(point)).enumerate();
            reach.max_by(|a, b| a.1.total_cmp(&b.1)).map(|(index, _)| index)
        };
        let mut chosen: Vec<usize> = directions.iter().filter_map(farthest).collect();
        chosen.sort_unstable();
        chosen.dedup();
        chosen.iter().filter_map(|index| points.get(*index)).copied().collect()
    };
    cells.into_values().map(outermost).collect()
}

/// Capsules, and what they were dealt.
#[derive(Debug, Clone)]
struct Dealt {
    axes: Vec<CapsuleAxis>,
    /// Per capsule and patch: how far the patch's farthest corner is from the axis \[m\].
    far: Vec<Vec<f64>>,
    /// \[m\]
    cost: f64,
}

impl Dealt {
    fn new(axes: Vec<CapsuleAxis>, task: &CoverTask) -> Self {
        let far = |axis: &CapsuleAxis| task.patches.iter().map(|patch| axis.farthest(patch)).collect();
        let far = axes.iter().map(far).collect();
        let mut dealt = Self { axes, far, cost: 0.0 };
        dealt.repair(task);
        dealt
    }

    /// The capsule that must grow least to hold `patch`, and how far the patch is from its axis \[m\].
    fn owner(&self, patch: usize) -> Option<(usize, f64)> {
        let each = self.axes.iter().zip(&self.far).enumerate();
        let excess = each.filter_map(|(index, (axis, far))| {
            let far = far.get(patch)?;
            Some((index, *far, far - axis.radius))
        });
        excess.min_by(|a, b| a.2.total_cmp(&b.2)).map(|(index, far, _)| (index, far))
    }

    /// Deals all patches, and gives every capsule the radius that it then needs.
    fn repair(&mut self, task: &CoverTask) {
        let mut radii = vec![0.0_f64; self.axes.len()];
        let count = self.far.first().map_or(0, Vec::len);
        for (index, far) in (0..count).filter_map(|patch| self.owner(patch)) {
            radii.iter_mut().skip(index).take(1).for_each(|radius| *radius = radius.max(far));
        }
        self.axes.iter_mut().zip(radii).for_each(|(axis, radius)| axis.radius = radius);
        self.cost = task.cost(&self.axes);
    }

    /// The same with another axis and radius in place of that at `which`.
    fn with(&self, which: usize, axis: CapsuleAxis, task: &CoverTask) -> Self {
        let mut next = self.clone();
        for (old, far) in next.axes.iter_mut().zip(&mut next.far).skip(which).take(1) {
            *old = axis;
            far.iter_mut().zip(&task.patches).for_each(|(far, patch)| *far = axis.farthest(patch));
        }
        next.repair(task);
        next
    }
}

/// The best of `children` changes per capsule, each of one capsule of the best so far.
fn evolved(start: Dealt, task: &CoverTask, children: usize) -> Dealt {
    let mut best = start;
    let size = best.axes.iter().map(|axis| axis.radius).fold(0.0, f64::max);
    let (mut dice, mut step) = (Dice::new(), 0.2 * size);
    for _ in 0..children * best.axes.len() {
        let which = dice.below(best.axes.len());
        let Some(parent) = best.axes.get(which) else { break };
        let mut axis = *parent;
        let moved = dice.vector() * step;
        // Both ends alike, one of them, or each by itself.
        let ends = match dice.below(4) {
            0 => [moved, moved],
            1 => [moved, Vector3::zeros()],
            2 => [Vector3::zeros(), moved],
            _ => [moved, dice.vector() * step],
        };
        axis.from += ends[0];
        axis.to += ends[1];
        axis.radius += dice.normal() * step;
        let child = best.with(which, axis, task);
        if child.cost < best.cost {
            best = child;
            step = (step * 1.5).min(0.5 * size);
        } else {
            step = (step * 0.95).max(1e-3 * size);
        }
    }
    best
}

/// The capsules of `axes` with numbers as they are written, holding every piece but for `outside` \[m\].
fn written(axes: &[CapsuleAxis], pieces: &[Triangle], outside: f64) -> Vec<MeshCapsule> {
    let mut shares: Vec<Vec<Vector3<f64>>> = vec![Vec::new(); axes.len()];
    for piece in pieces {
        let excess = |axis: &CapsuleAxis| axis.farthest(piece) - axis.radius;
        let owner = axes.iter().map(excess).enumerate().min_by(|a, b| a.1.total_cmp(&b.1));
        let owner = owner.map_or(0, |(index, _)| index);
        shares.iter_mut().skip(owner).take(1).for_each(|share| share.extend(piece));
    }
    let capsules = axes.iter().zip(&shares).filter(|(_, share)| !share.is_empty());
    capsules.map(|(axis, share)| axis.capsule().written(share).smaller(outside)).collect()
}

/// Points of the unit cube, spread evenly: the additive recurrence with the plastic number (Roberts, 2018).
static SAMPLED: LazyLock<Vec<ProfileSample>> = LazyLock::new(|| {
    let plastic = 1.220_744_084_605_759_5_f64;
    let steps = [1.0 / plastic, 1.0 / (plastic * plastic), 1.0 / plastic.powi(3)];
    (1..=SAMPLES).map(|n| ProfileSample::at(steps.map(|step| (0.5 + step * n as f64).fract()))).collect()
});

/// The volume that capsules fill together [m³]: each point of one counts for as much as it is the only one
/// to hold it.
fn union(axes: &[CapsuleAxis], samples: &[ProfileSample]) -> f64 {
    let mut sum = 0.0;
    for (index, axis) in axes.iter().enumerate() {
        let frame = axis.frame();
        let own: f64 = samples
            .iter()
            .map(|sample| {
                let point = frame.at(sample);
                let holds = |(other, shape): &(usize, &CapsuleAxis)| {
                    *other != index && shape.squared(&point) < shape.radius * shape.radius
                };
                1.0 / (1 + axes.iter().enumerate().filter(holds).count()) as f64
            })
            .sum();
        sum += axis.volume() * own / samples.len().max(1) as f64;
    }
    sum
}

/// The volume that capsules fill together \[m³\].
pub(crate) fn volume(capsules: &[MeshCapsule]) -> f64 {
    let axes: Vec<CapsuleAxis> = capsules.iter().map(CapsuleAxis::of).collect();
    union(&axes, &SAMPLED)
}

/// xorshift64* with a fixed seed: the same mesh gives the same capsules.
pub(crate) struct Dice(u64);

impl Dice {
    pub(crate) const fn new() -> Self {
        Self(0x5eed_cafe)
    }

    /// From 0 to 1.
    fn unit(&mut self) -> f64 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        (self.0.wrapping_mul(0x2545_f491_4f6c_dd1d) >> 11) as f64 / (1_u64 << 53) as f64
    }

    pub(crate) fn below(&mut self, count: usize) -> usize {
        ((self.unit() * count as f64) as usize).min(count.saturating_sub(1))
    }

    fn vector(&mut self) -> Vector3<f64> {
        Vector3::new(self.normal(), self.normal(), self.normal())
    }

    /// Variance 1: the sum of twelve (Irwin and Hall).
    fn normal(&mut self) -> f64 {
        (0..12).map(|_| self.unit()).sum::<f64>() - 6.0
    }
}

/// Whether every point of a triangle lies in some capsule or at most `slack` \[m\] outside, by halving it
/// until each part lies in one.
#[cfg(test)]
pub(crate) fn held(cover: &[CapsuleAxis], triangle: &Triangle, slack: f64) -> bool {
    let mut open = vec![(*triangle, 0)];
    while let Some(([a, b, c], depth)) = open.pop() {
        let inside = |axis: &CapsuleAxis| {
            [a, b, c].iter().all(|corner| axis.squared(corner).sqrt() <= axis.radius + slack)
        };
        if cover.iter().any(inside) {
            continue;
        }
        if depth > 24 {
            return false;
        }
        let [a, b, c] = longest_first([a, b, c]);
        let middle = (a + b) * 0.5;
        open.extend([([a, middle, c], depth + 1), ([middle, b, c], depth + 1)]);
    }
    true
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The surface of a box as triangles \[m\].
    fn cuboid(low: [f64; 3], high: [f64; 3]) -> Vec<Triangle> {
        let at =
            |i: u8| Vector3::from(std::array::from_fn(|k| if i >> k & 1 == 0 { low[k] } else { high[k] }));
        let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        quads.iter().flat_map(|[a, b, c, d]| [[*a, *b, *c], [*a, *c, *d]]).map(|f| f.map(at)).collect()
    }

    fn bent() -> Vec<Triangle> {
        [cuboid([0.0, 0.0, 0.0], [0.4, 0.1, 0.1]), cuboid([0.0, 0.0, 0.0], [0.1, 0.1, 0.4])].concat()
    }

    fn axes(capsules: &[MeshCapsule]) -> Vec<CapsuleAxis> {
        capsules.iter().map(CapsuleAxis::of).collect()
    }

    #[test]
    fn every_point_of_every_triangle_is_inside_also_between_two_capsules() {
        for (most, outside) in [(1, 0.0), (2, 0.0), (4, 0.0), (3, 2e-3)] {
            let capsules = cover(&bent(), most, outside);
            assert!(!capsules.is_empty() && capsules.len() <= most);
            let axes = axes(&capsules);
            for triangle in bent() {
                assert!(held(&axes, &triangle, outside + 1e-9), "{most} {outside} {triangle:?}");
            }
            // Not for free: what is allowed to stick out does.
            let tight = bent().iter().any(|triangle| !held(&axes, triangle, outside - 1e-4));
            assert!(tight, "{most} {outside}");
        }
    }

    #[test]
    fn a_bent_link_gets_a_capsule_per_limb() {
        let [one, two] = [1, 2].map(|most| cover(&bent(), most, 0.0));
        assert_eq!((one.len(), two.len()), (1, 2));
        assert!(volume(&two) < 0.45 * volume(&one), "{} {}", volume(&two), volume(&one));
        // A limb by itself: 0.1 x 0.1 x 0.4 in a capsule through its corners.
        let limb = cover(&cuboid([0.0, 0.0, 0.0], [0.4, 0.1, 0.1]), 1, 0.0);
        // Volume is not all that is minimised.
        assert!(volume(&two) < 2.1 * volume(&limb), "{} {}", volume(&two), volume(&limb));
    }

    #[test]
    fn a_flat_plate_is_covered_flat_by_several() {
        let plate = cuboid([-0.1, -0.1, 0.0], [0.1, 0.1, 0.02]);
        let top = |capsules: &[MeshCapsule]| {
            axes(capsules).iter().map(|axis| axis.reach(&Vector3::z())).fold(f64::NEG_INFINITY, f64::max)
        };
        let [one, four] = [1, 4].map(|most| top(&cover(&plate, most, 0.0)));
        assert!(one > 0.1 && four < 0.05, "{one} {four}");
    }

    #[test]
    fn the_same_mesh_gives_the_same_capsules_and_no_more_than_help() {
        assert_eq!(cover(&bent(), 3, 0.0), cover(&bent(), 3, 0.0));
        // A ball needs one.
        let at = |i: usize, j: usize| {
            let (u, v) = (i as f64 * 0.3, j as f64 * 0.3);
            Vector3::new(u.sin() * v.cos(), u.sin() * v.sin(), u.cos()) * 0.1
        };
        let ball: Vec<Triangle> =
            (0..10).flat_map(|i| (0..21).map(move |j| [at(i, j), at(i + 1, j), at(i, j + 1)])).collect();
        assert_eq!(cover(&ball, 4, 0.0).len(), 1);
        assert!(cover(&[], 4, 0.0).is_empty());
    }

    #[test]
    fn triangles_without_size_are_no_fault() {
        let point = [[Vector3::new(1.0, 2.0, 3.0); 3]; 5];
        assert!(held(&axes(&cover(&point, 3, 0.0)), &point[0], 0.0));
        let line = [[Vector3::zeros(), Vector3::x(), Vector3::x() * 0.5]];
        assert!(held(&axes(&cover(&line, 3, 0.0)), &line[0], 0.0));
    }

    #[test]
    fn the_volume_of_a_union_counts_what_is_shared_once() {
        let axis =
            |x: f64| CapsuleAxis { from: Vector3::x() * x, to: Vector3::new(x, 0.0, 0.3), radius: 0.1 };
        let alone = axis(0.0).volume();
        let of = |x: f64| union(&[axis(0.0), axis(x)], &SAMPLED);
        assert!((of(0.0) / alone - 1.0).abs() < 1e-9 && (of(0.5) / alone - 2.0).abs() < 1e-9);
        assert!((1.1..1.9).contains(&(of(0.1) / alone)));
    }
}
