//! Parameters of refinement, each with what it measures, its range of effect, and the reason for its value.
//!
//! Lengths are normalised (see [`crate::predict`]) unless in metres. Tuned on train writers of the data sets,
//! tested on the test writers of all four (docs/results/closed-loop.md).

use super::blend::TERMS;
use super::prior::RefinePrior;

/// Kalman filters side by side, from coarse tablets to clean ones.
pub const OBSERVERS: usize = 5;

/// All parameters of [`crate::estimate::refine`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RefineParameters {
    /// Larger innovations, velocities and accelerations are jumps and carry no information about the future
    /// \[per axis, and per step and step²\]. 15 ordinary steps.
    pub leap: f64,
    /// Samples later than this after the newest grid point \[steps\] do not refine the preview, as after a
    /// pause.
    pub latest_phase: f64,
    /// Regression of the preview's error.
    pub blend: BlendParameters,
    /// The pen's present motion.
    pub observer: ObserverParameters,
    /// Initial weights for a new hand.
    pub prior: RefinePrior,
}

/// Forgetting and initial state of the regression.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BlendParameters {
    /// Forgetting factor per judged case \[1\]: 1 forgets nothing, 0.998 remembers about 500 steps of motion.
    pub forgetting: f64,
    /// Square of each term in ordinary motion, one step ahead \[per axis, squared\]; a case adds the squares
    /// of both axes. The remaining displacement and that by velocity are an ordinary step, 10; the innovation
    /// is a third of it, the displacement by acceleration a fifth.
    pub ordinary: [f64; TERMS],
    /// The prior weighs as much as this many cases of ordinary motion, and as many more per step ahead,
    /// because errors far ahead are correlated. 0: only the hand's own cases count.
    pub prior_cases: f64,
    /// Weight, in cases, of the initial assumption that corrections are right: the smaller, the sooner a
    /// preview that is right is left alone.
    pub prior_worth: f64,
    /// Largest weight \[1\].
    pub largest: f64,
    /// Least horizon that a case is divided by \[steps\]; nearer leads use this value.
    pub shortest: f64,
}

/// Selection of the filter for the pen's velocity and acceleration.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ObserverParameters {
    /// Change of acceleration per sample over the noise of its position \[1/s²\], one per filter, from coarse
    /// to clean: coarse tablets and clean ones differ by a factor of a hundred.
    pub changes: [f64; OBSERVERS],
    /// Extrapolation by which the filters are judged \[s\].
    pub reach_s: f64,
    /// Weight of a judgement while the pen moves fast \[1\]: 0 judges nothing, 1 forgets all earlier
    /// judgements. At rest none counts.
    pub pace: f64,
    /// Judgements before another filter than the coarsest is selected.
    pub settled: u32,
    /// A filter is replaced by one whose mean squared error is below this share of its own \[1\]. At 1 the
    /// best is selected at once, but every change resets the regressions.
    pub better: f64,
    /// Initial state of each filter.
    pub filter: FilterParameters,
}

/// Initial state of a Kalman filter, and when it restarts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FilterParameters {
    /// Initial standard deviations per axis of position \[1\], velocity \[1/s\] and acceleration \[1/s²\], in
    /// units of a sample's noise: of a hand, 0.3 m/s and 10 m/s² for 0.3 mm. With an unlimited acceleration
    /// that would explain the whole displacement to the second sample.
    pub first: [f64; 3],
    /// After a longer silence the velocity is unknown \[s\].
    pub forget_after_s: f64,
}

impl RefineParameters {
    /// Those of the presets.
    pub const SHIPPED: Self = Self {
        leap: 150.0,
        latest_phase: 1.5,
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
