//! The numbers behind refinement, each with what it measures, where it starts and ends to count, and why it
//! has its value.
//!
//! Lengths are normalised (see [`crate::predict`]) unless they say metres. Set on train writers of the data
//! sets, judged on the test writers of all four (docs/results/closed-loop.md).

use super::blend::TERMS;
use super::prior::RefinePrior;

/// Kalman filters side by side, from coarse tablets to clean ones.
pub const OBSERVERS: usize = 5;

/// See the module's description.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RefineParameters {
    /// News beyond this tell of a leap, and nothing of where the pen goes next: innovation, velocity and
    /// acceleration \[per axis, and per step and step²\]. 15 ordinary steps.
    pub leap: f64,
    /// What is learned of the preview's errors.
    pub blend: BlendParameters,
    /// Where the pen is going right now.
    pub observer: ObserverParameters,
    /// The weights that a new hand starts with.
    pub prior: RefinePrior,
}

/// How the regression of a preview's error forgets, and what it starts from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BlendParameters {
    /// Factor by which the past loses weight per judged case \[1\]: 1 forgets nothing, 0.998 remembers about
    /// 500 steps of motion.
    pub forgetting: f64,
    /// Square of each term in ordinary motion, one step ahead \[per axis, squared\]; a case adds the squares
    /// of both axes. Way left and the velocity's way are an ordinary step, 10; the innovation is a third of
    /// it, the acceleration's way a fifth.
    pub ordinary: [f64; TERMS],
    /// The prior weighs as much as this many cases of ordinary motion, and as many more per step ahead:
    /// errors far ahead repeat themselves from case to case. 0: only the hand's own cases count.
    pub prior_cases: f64,
    /// Cases that the prior weighs by which corrections are worth what they say: the fewer, the sooner a
    /// preview that is right without is left alone.
    pub prior_worth: f64,
    /// No weight is larger \[1\].
    pub largest: f64,
    /// Least horizon that a case is divided by \[steps\]: nearer leads count as if they were as far as that.
    pub shortest: f64,
}

/// Which filter answers for the pen's velocity and acceleration.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ObserverParameters {
    /// Change of acceleration per sample over the noise of its position \[1/s²\], one per filter, from coarse
    /// to clean: a tablet of coarse steps and a clean one differ by a hundred.
    pub changes: [f64; OBSERVERS],
    /// How far the filters extrapolate to be judged \[s\].
    pub reach_s: f64,
    /// How much a judgement counts if the pen moved a lot \[1\]: 0 judges nothing, 1 forgets all judgements
    /// before. At rest none counts.
    pub pace: f64,
    /// Judgements before another filter than the coarsest is chosen.
    pub settled: u32,
    /// A filter is exchanged for one whose mean squared error is below this part of its own \[1\]: 1 takes
    /// the best at once and changes for nothing; with every change what was learned of corrections goes.
    pub better: f64,
    /// Where each filter starts.
    pub filter: FilterParameters,
}

/// Where a Kalman filter starts, and when it does anew.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FilterParameters {
    /// First standard deviations per axis of position \[1\], velocity \[1/s\] and acceleration \[1/s²\], in
    /// units of a sample's noise: of a hand, 0.3 m/s and 10 m/s² for 0.3 mm. With an acceleration that may be
    /// anything it would explain the whole way to the second sample.
    pub first: [f64; 3],
    /// A longer silence tells nothing about the velocity any more \[s\].
    pub forget_after_s: f64,
}

impl RefineParameters {
    /// Those of the presets.
    pub const SHIPPED: Self = Self {
        leap: 150.0,
        blend: BlendParameters {
            forgetting: 0.998,
            ordinary: [100.0, 10.0, 100.0, 4.0],
            prior_cases: 40.0,
            prior_worth: 5.0,
            largest: 4.0,
            shortest: 0.5,
        },
        observer: ObserverParameters {
            changes: [3e3, 1e4, 3e4, 1e5, 3e5],
            reach_s: 0.015,
            pace: 0.03,
            settled: 8,
            better: 0.85,
            filter: FilterParameters { first: [1.0, 1e3, 3e4], forget_after_s: 0.1 },
        },
        prior: RefinePrior::SHIPPED,
    };
}

impl Default for RefineParameters {
    fn default() -> Self {
        Self::SHIPPED
    }
}
