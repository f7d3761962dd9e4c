//! Refinement of a preview by samples newer than the grid. Without it up to a whole grid step of information
//! about the pen would be unused.
//!
//! Contract: fixed size, no allocation, total. The correction at each lead is a regression learned while the
//! pen moves (`blend`), from a prior (`prior`), on velocities of the filter that suits the tablet
//! (`observer`). A preview that is right is not moved: corrections are weighted by how good past ones were.

mod blend;
mod filter;
mod sample;
mod observer;
mod prior;

use crate::state::state;
pub use prior::{
    CURVE_PARTS, Curve, CurvePart, CurveShape, Curves, LARGEST_COEFFICIENT, LEGAL_REACH, PriorError,
    RefinePrior,
};

pub(crate) use blend::BlendTerms;
pub use sample::Refinement;
pub(crate) use sample::from;

use blend::Blend;
use observer::Observers;
use sample::SampleMotion;

use super::{LEADS, LawParameters};
use crate::units::Stamp;

/// The regressions, and how good their corrections were.
#[derive(Debug, Clone)]
pub struct Refiner {
    law: LawParameters,
    prior: RefinePrior,
    corrections: [Blend; LEADS],
    observers: Observers,
    /// Clarity of the observer with which the corrections were learned.
    clarity: f64,
    /// Metres per normalised unit, the newest known; 0 before.
    unit_m: f64,
    step_s: f64,
}

state! { [] Refiner { corrections, observers, clarity, unit_m, step_s } fixed { law, prior } }

impl Refiner {
    /// Without samples; grid step `step_s` \[s\].
    #[must_use]
    pub fn new(step_s: f64) -> Self {
        Self::tuned(step_s, &LawParameters::SHIPPED, &RefinePrior::SHIPPED)
    }

    /// The same with given parameters, and weights for a new hand.
    #[must_use]
    pub fn tuned(step_s: f64, law: &LawParameters, prior: &RefinePrior) -> Self {
        Self {
            law: *law,
            prior: *prior,
            corrections: fresh(0.0, prior, law),
            observers: Observers::new(law),
            clarity: 0.0,
            unit_m: 0.0,
            step_s,
        }
    }

    /// Samples later than this after the newest grid point do not refine \[steps\].
    pub(crate) fn latest_phase(&self) -> f64 {
        self.law.latest_phase
    }

    /// Another predictor is active from now on: forgets what was learned about the last one.
    pub fn forget(&mut self) {
        self.corrections = fresh(self.clarity, &self.prior, &self.law);
    }

    pub(crate) fn interrupt(&mut self) {
        self.observers.forget();
    }

    /// A sample at `stamp` and `position` \[m\]; it may be repeated. Velocity and acceleration are known only
    /// if every sample is passed. When another filter is selected, the regressions, which concern the
    /// velocities of the last one, are reset.
    pub fn observe(&mut self, stamp: Stamp, position: [f64; 2]) {
        self.observers.see(stamp.0 as f64 * 1e-9, position);
        self.follow_filter();
    }

    /// As `observe`, of all samples that the `other` has observed.
    pub(super) fn observe_as(&mut self, other: &Self) {
        self.observers = other.observers;
        self.follow_filter();
    }

    fn follow_filter(&mut self) {
        let clarity = self.observers.clarity();
        if clarity != self.clarity {
            self.clarity = clarity;
            self.corrections = fresh(clarity, &self.prior, &self.law);
        }
    }

    /// The innovation of the observed sample at `position` \[m\], `phase` of a step after the newest grid
    /// point, for which the preview `expected` \[m\], with the pen's motion.
    #[must_use]
    pub fn refinement(&self, position: [f64; 2], phase: f64, expected: [f64; 2]) -> Refinement {
        let [velocity, acceleration] = self.observers.motion();
        let motion = SampleMotion {
            innovation: from(position, expected),
            velocity: velocity.map(|v| v * self.step_s),
            acceleration: acceleration.map(|a| a * self.step_s * self.step_s),
        };
        Refinement { newest: position, phase, motion: Some(motion) }
    }

    /// The corrected position at `lead` ≥ 1 of a preview that `predicted` \[m\], shrunk to `share`, after the
    /// sample of refinement `by`; the sample's position, if that jumped.
    #[must_use]
    pub fn refined(&self, by: &Refinement, lead: usize, predicted: [f64; 2], share: f64) -> [f64; 2] {
        if self.unit_m > 0.0 && by.motion.is_some_and(|motion| !self.is_ordinary(&motion)) {
            return by.newest;
        }
        let [lx, ly] = from(predicted, by.newest);
        let ahead = lead as f64 - by.phase;
        let index = lead.saturating_sub(1).min(LEADS - 1);
        let terms = by.motion.map(|motion| motion.terms([lx, ly], ahead));
        let [cx, cy] = self.correction(index, terms.as_ref());
        let [x, y] = by.newest;
        [x + share * (lx + cx), y + share * (ly + cy)]
    }

    /// Neither a jump nor a filter's response to one.
    pub(crate) fn is_ordinary(&self, motion: &SampleMotion) -> bool {
        motion.is_ordinary(self.law.leap * self.unit_m)
    }

    /// Which filter is selected, from 0, a coarse tablet, to 1, a clean one. Previews refined with another
    /// filter are not comparable.
    pub(crate) const fn clarity(&self) -> f64 {
        self.clarity
    }

    /// Metres per normalised unit; 0 while unknown.
    pub(crate) const fn unit_m(&self) -> f64 {
        self.unit_m
    }

    /// Sets the metres per normalised unit.
    pub(crate) fn measure(&mut self, unit_m: f64) {
        self.unit_m = unit_m;
    }

    /// The correction of a preview at the lead with this index, by a sample with `terms`; in their unit.
    pub(crate) fn correction(&self, index: usize, terms: Option<&BlendTerms>) -> [f64; 2] {
        terms
            .zip(self.corrections.get(index))
            .map_or([0.0; 2], |(terms, blend)| blend.correction(terms, &self.law))
    }

    /// Learns from the preview's `error`, `ahead` steps after a sample with `terms` \[normalised\].
    pub(crate) fn learn(&mut self, index: usize, terms: &BlendTerms, error: [f64; 2], ahead: f64) {
        if let Some(blend) = self.corrections.get_mut(index) {
            blend.learn(terms, error, ahead, &self.law);
        }
    }
}

/// Samples come at any phase of a grid step: half a step late in the mean.
fn fresh(clarity: f64, prior: &RefinePrior, law: &LawParameters) -> [Blend; LEADS] {
    std::array::from_fn(|index| Blend::new(index as f64 + 0.5, clarity, prior, law))
}
