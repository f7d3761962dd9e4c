//! Where the search for several capsules begins: the cheapest choices among many that hold a part each.
//!
//! Parts are the patches between two cuts across one of three axes; around each, the best capsule along each
//! of its principal axes is a choice. Which of them together hold every patch with the least sum of volumes
//! is a set cover: solved by branch and bound on the patch that the fewest choices hold.

use nalgebra::Vector3;

use crate::capsule::{CapsuleAxis, along_each_axis};

/// Points that are dealt together \[m\].
pub(crate) type Patch = Vec<Vector3<f64>>;

/// Slabs along each axis; a part is any run of them.
const SLABS: usize = 10;
/// Covers that are kept.
const KEPT: usize = 300;
/// Steps of branch and bound, at most.
const STEPS: usize = 100_000;
/// A patch counts as held that sticks out by this share of the radius: the search may move axes.
const SLACK: f64 = 0.02;

/// A capsule and the patches that it holds.
struct Choice {
    axis: CapsuleAxis,
    holds: Vec<u64>,
    volume: f64,
}

impl Choice {
    fn holds(&self, patch: usize) -> bool {
        self.holds.get(patch / 64).is_some_and(|word| word >> (patch % 64) & 1 == 1)
    }
}

/// Capsules to choose from, the smallest first.
pub(crate) struct Choices {
    all: Vec<Choice>,
    /// Patches, those that the fewest choices hold first.
    order: Vec<usize>,
}

/// Branch and bound: what is chosen so far, and the best that was found.
struct BranchAndBound {
    steps: usize,
    chosen: Vec<usize>,
    /// Sum of volumes \[m³\] and choices, the best first.
    found: Vec<(f64, Vec<usize>)>,
}

impl Choices {
    pub(crate) fn new(patches: &[Patch]) -> Self {
        let mut all: Vec<Choice> = Vec::new();
        for direction in [Vector3::x(), Vector3::y(), Vector3::z()] {
            let slabs = cut(patches, &direction);
            for from in 0..SLABS {
                for to in from + 1..=SLABS {
                    let part = slabs.get(from..to).unwrap_or_default();
                    let points: Vec<Vector3<f64>> =
                        part.iter().flatten().copied().flatten().copied().collect();
                    all.extend(along_each_axis(&points).into_iter().map(|axis| choice(axis, patches)));
                }
            }
        }
        all.sort_by(|a, b| a.volume.total_cmp(&b.volume));
        let mut kept: Vec<Choice> = Vec::new();
        for next in all {
            let within = |other: &Choice| other.holds.iter().zip(&next.holds).all(|(o, n)| n & !o == 0);
            if !kept.iter().any(within) {
                kept.push(next);
            }
        }
        let rarity = |patch: &usize| kept.iter().filter(|choice| choice.holds(*patch)).count();
        let mut order: Vec<usize> = (0..patches.len()).collect();
        order.sort_by_cached_key(rarity);
        Self { all: kept, order }
    }

    /// The best covers by at most `count` choices.
    pub(crate) fn covers(&self, count: usize) -> Vec<Vec<CapsuleAxis>> {
        let mut search = BranchAndBound { steps: 0, chosen: Vec::new(), found: Vec::new() };
        self.branch(count, 0.0, &mut search);
        let axes = |chosen: &Vec<usize>| chosen.iter().filter_map(|i| Some(self.all.get(*i)?.axis)).collect();
        search.found.iter().map(|(_, chosen)| axes(chosen)).collect()
    }

    fn branch(&self, left: usize, volume: f64, search: &mut BranchAndBound) {
        let held = |patch: usize| {
            search.chosen.iter().filter_map(|index| self.all.get(*index)).any(|choice| choice.holds(patch))
        };
        let Some(open) = self.order.iter().copied().find(|patch| !held(*patch)) else {
            search.found.push((volume, search.chosen.clone()));
            search.found.sort_by(|a, b| a.0.total_cmp(&b.0));
            search.found.truncate(KEPT);
            return;
        };
        if left == 0 {
            return;
        }
        for (index, choice) in self.all.iter().enumerate().filter(|(_, choice)| choice.holds(open)) {
            let bound = search.found.get(KEPT - 1).map_or(f64::INFINITY, |worst| worst.0);
            search.steps += 1;
            // Choices are sorted: all later ones are larger.
            if volume + choice.volume >= bound || search.steps > STEPS {
                return;
            }
            search.chosen.push(index);
            self.branch(left - 1, volume + choice.volume, search);
            search.chosen.pop();
        }
    }
}

fn choice(axis: CapsuleAxis, patches: &[Patch]) -> Choice {
    let mut holds = vec![0; patches.len().div_ceil(64)];
    for (index, _) in
        patches.iter().enumerate().filter(|(_, patch)| axis.farthest(patch) <= axis.radius * (1.0 + SLACK))
    {
        holds.iter_mut().skip(index / 64).take(1).for_each(|word| *word |= 1 << (index % 64));
    }
    Choice { axis, holds, volume: axis.volume() }
}

/// Patches in slabs of equal width across `direction`.
fn cut<'a>(patches: &'a [Patch], direction: &Vector3<f64>) -> Vec<Vec<&'a Patch>> {
    let middle = |patch: &Patch| {
        patch.iter().map(|point| direction.dot(point)).sum::<f64>() / patch.len().max(1) as f64
    };
    let [low, high] = patches
        .iter()
        .map(middle)
        .fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], x| [low.min(x), high.max(x)]);
    let mut slabs = vec![Vec::new(); SLABS];
    for patch in patches {
        let share = (middle(patch) - low) / (high - low).max(f64::MIN_POSITIVE);
        let slab = ((share * SLABS as f64) as usize).min(SLABS - 1);
        slabs.iter_mut().skip(slab).take(1).for_each(|slab| slab.push(patch));
    }
    slabs
}
