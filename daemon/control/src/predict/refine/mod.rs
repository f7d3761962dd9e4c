//! Refining a preview by samples newer than the grid: between two grid points newer samples arrive, and without them up to a whole
//! step of what is known about the pen would lie idle.
//!
//! Contract: fixed size, no allocation, total. What a sample says about the preview at each lead is learned while the pen moves
//! (`blend`), from a prior (`prior`), from the velocities of the filter that suits the tablet (`observer`). A preview that is right
//! without is not moved: what past corrections were worth counts as well. The numbers of all that are in `parameters`.

mod prior;
mod parameters;
mod blend;
mod filter;
mod news;
mod observer;

pub use parameters::{BlendParameters, FilterParameters, OBSERVERS, ObserverParameters, RefineParameters};
pub use prior::{
    CURVE_PARTS, Curve, CurvePart, Curves, LARGEST_COEFFICIENT, LEGAL_REACH, PriorError, RefinePrior, Shape,
};

pub(crate) use blend::Terms;
pub(crate) use news::{News, from};

use blend::Blend;
use observer::Observers;

use crate::units::Stamp;

/// Leads with corrections of their own [steps]; farther ahead the last one counts.
pub const REFINED_LEADS: usize = 24;
/// Parts of a grid step that have corrections of their own: devices sample where they like.
pub(crate) const PHASES: usize = 4;

/// What newer samples say, and what that was worth.
#[derive(Debug, Clone)]
pub(crate) struct Refiner {
    parameters: RefineParameters,
    corrections: [[Blend; REFINED_LEADS]; PHASES],
    observers: Observers,
    /// Of the observer that the corrections were learned with.
    clarity: f64,
    /// Newest sample [m] and what it says.
    newest: [f64; 2],
    news: Option<News>,
    step_s: f64,
}

impl Refiner {
    /// Nothing seen yet; grid step `step_s` [s].
    pub(crate) fn new(step_s: f64, parameters: RefineParameters) -> Self {
        Self {
            parameters,
            corrections: fresh(0.0, &parameters),
            observers: Observers::new(parameters.observer),
            clarity: 0.0,
            newest: [0.0; 2],
            news: None,
            step_s,
        }
    }

    /// Another predictor answers from here on: what was learned about the last one goes.
    pub(crate) fn forget(&mut self) {
        self.corrections = fresh(self.clarity, &self.parameters);
    }

    /// The pen was elsewhere at once.
    pub(crate) fn interrupt(&mut self) {
        self.news = None;
        self.observers.forget();
    }

    /// A sample at `stamp` and `position` [m]. True if another filter answers from here on: what was learned, and what waits to be, is
    /// about the velocities of the last one.
    pub(crate) fn observe(&mut self, stamp: Stamp, position: [f64; 2]) -> bool {
        self.observers.see(stamp.0 as f64 * 1e-9, position);
        let clarity = self.observers.clarity();
        let other = clarity != self.clarity;
        if other {
            self.clarity = clarity;
            self.corrections = fresh(clarity, &self.parameters);
        }
        other
    }

    /// What the observed sample at `position` [m] says beside what the preview had `expected` [m] there.
    pub(crate) fn hear(&mut self, position: [f64; 2], expected: [f64; 2]) -> News {
        let [velocity, acceleration] = self.observers.motion();
        let news = News {
            innovation: from(position, expected),
            velocity: velocity.map(|v| v * self.step_s),
            acceleration: acceleration.map(|a| a * self.step_s * self.step_s),
        };
        self.newest = position;
        self.news = Some(news);
        news
    }

    /// The newest sample [m].
    pub(crate) const fn newest(&self) -> [f64; 2] {
        self.newest
    }

    /// What it says.
    pub(crate) const fn news(&self) -> Option<News> {
        self.news
    }

    /// Neither a leap nor what a filter makes of one; `unit_m`: metres per normalised unit.
    pub(crate) fn is_ordinary(&self, news: &News, unit_m: f64) -> bool {
        news.is_ordinary(self.parameters.leap * unit_m)
    }

    /// By how much a preview moves at the lead with this index, corrected by a sample at `phase`; in the unit of `terms`.
    pub(crate) fn correction(&self, phase: f64, index: usize, terms: &Terms) -> [f64; 2] {
        let blend = self.corrections.get(bucket(phase)).and_then(|row| row.get(index));
        blend.map_or([0.0; 2], |blend| blend.correction(terms, &self.parameters.blend))
    }

    /// Learns that the preview was off by `error`, `ahead` steps after a sample at `phase` that said `terms` [normalised].
    pub(crate) fn learn(&mut self, phase: f64, index: usize, terms: &Terms, error: [f64; 2], ahead: f64) {
        if let Some(blend) = self.corrections.get_mut(bucket(phase)).and_then(|row| row.get_mut(index)) {
            blend.learn(terms, error, ahead, &self.parameters.blend);
        }
    }
}

/// The part of a grid step in which `phase` lies.
pub(crate) fn bucket(phase: f64) -> usize {
    ((phase * PHASES as f64) as usize).min(PHASES - 1)
}

fn fresh(clarity: f64, parameters: &RefineParameters) -> [[Blend; REFINED_LEADS]; PHASES] {
    std::array::from_fn(|bucket| {
        let phase = (bucket as f64 + 0.5) / PHASES as f64;
        std::array::from_fn(|index| Blend::new((index + 1) as f64 - phase, clarity, parameters))
    })
}
