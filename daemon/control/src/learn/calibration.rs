//! `Calibration`: the error bands of every predictor, from the outcome of its previews.
//!
//! Adaptive conformal prediction per predictor and lead h. With the score s = |predicted − real| / (level ·
//! metres per unit) of a preview made h steps ago and the current factor c: ln c ← ln c + η·(\[s > c\] − (1 −
//! coverage)). Whatever the pen does, the share of misses after T updates then differs from 1 − coverage by
//! at most (|ln c_T − ln c_0|)/(ηT): no model of the errors is assumed. η starts large and decreases. Source:
//! Gibbs & Candès 2021, Adaptive Conformal Inference Under Distribution Shift, in logarithms so that c stays
//! positive; the level makes one factor fit slow and fast hands.
//!
//! Cases in which the pen rests before and after carry no information and are left out, as are those cut off
//! by a jump.

use crate::pen::REST;
use crate::predict::LearnStep;
use crate::predict::bands::{BAND_LEADS, BandTable, COVERAGE};
use crate::predict::{Models, OnlineWeights, Panel, PredictorKind, WeightsError};

/// Predictors that get bands: all but the oracle and those of other processes.
const KINDS: usize = PredictorKind::BUILT_IN.len();
/// Steps between two judged previews: those of neighbouring steps are nearly the same.
const STRIDE: usize = 3;
/// Most previews waiting for their outcome.
const PENDING: usize = BAND_LEADS.div_ceil(STRIDE);
/// η after many updates.
const RATE: f64 = 0.03;
/// η of the first update; it falls with the root of their number.
const FIRST_RATE: f64 = 0.5;
/// Updates before a band is offered.
const WARM: u32 = 50;
/// Bounds of ln c: c from a thousandth to a thousand recent steps.
const LN_BOUND: f64 = 7.0;

/// The previews made at one step.
#[derive(Debug, Clone, Copy)]
struct PendingPreviews {
    /// Step length of the pen when they were made \[m\].
    unit_m: f64,
    resting: bool,
    age: usize,
    /// Path of the pen since \[m\].
    way: [f64; 2],
    /// Predicted displacements \[m\]; KINDS x BAND_LEADS.
    paths: [[[f64; 2]; BAND_LEADS]; KINDS],
}

/// c of one predictor at one lead, learned from scores s: errors over the recent step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Factor {
    ln: f64,
    updates: u32,
    misses: u32,
}

impl Factor {
    /// As wide as the pen's motion in `steps`: a band too wide is safer than one too narrow.
    #[must_use]
    pub fn untried(steps: f64) -> Self {
        Self { ln: steps.ln().clamp(-LN_BOUND, LN_BOUND), updates: 0, misses: 0 }
    }

    /// Learns from one case so that a share `coverage` of them falls within c.
    pub fn judge(&mut self, score: f64, coverage: f64) {
        let missed = !(score <= self.ln.exp());
        let rate = (FIRST_RATE / f64::from(self.updates.saturating_add(1)).sqrt()).max(RATE);
        let pull = if missed { coverage } else { coverage - 1.0 };
        self.ln = (self.ln + rate * pull).clamp(-LN_BOUND, LN_BOUND);
        self.updates = self.updates.saturating_add(1);
        self.misses = self.misses.saturating_add(u32::from(missed));
    }

    /// c, once enough cases were seen.
    #[must_use]
    pub fn get(&self) -> Option<f64> {
        (self.updates >= WARM).then(|| self.ln.exp())
    }
}

/// The learner's own panel of predictors, and the judgement of their previews.
#[derive(Debug, Clone)]
pub struct Calibration {
    panel: Panel,
    /// Newest first, one per grid step.
    pending: Box<[PendingPreviews]>,
    waiting: usize,
    /// Steps since the newest previews.
    since: usize,
    factors: [[Factor; BAND_LEADS]; KINDS],
}

impl Calibration {
    /// Starts with the bands of `weights`, or with wide ones that are not offered yet.
    ///
    /// # Errors
    ///
    /// Settings or weights that a panel refuses.
    pub fn new(models: &Models, weights: &OnlineWeights) -> Result<Self, WeightsError> {
        let paths = [[[0.0; 2]; BAND_LEADS]; KINDS];
        let empty = PendingPreviews { unit_m: 0.0, resting: true, age: 0, way: [0.0; 2], paths };
        let mut factors = [[Factor { ln: 0.0, updates: 0, misses: 0 }; BAND_LEADS]; KINDS];
        for (kind, of_kind) in PredictorKind::BUILT_IN.into_iter().zip(&mut factors) {
            for ((lead, factor), known) in (1..).zip(of_kind).zip(weights.bands.of(kind)) {
                *factor = Factor::untried(f64::from(lead));
                if *known > 0.0 {
                    *factor = Factor { ln: f64::from(*known).ln(), updates: WARM, misses: 0 };
                }
            }
        }
        let panel = Panel::new(models, weights)?;
        Ok(Self { panel, pending: vec![empty; PENDING].into_boxed_slice(), waiting: 0, since: 0, factors })
    }

    /// The stroke was interrupted.
    pub fn interrupt(&mut self) {
        self.panel.forget();
        self.waiting = 0;
        self.since = 0;
    }

    /// Other weights predict from here on.
    ///
    /// # Errors
    ///
    /// Weights that a panel refuses.
    pub fn set_weights(&mut self, weights: &OnlineWeights) -> Result<(), WeightsError> {
        self.panel.set_weights(weights)
    }

    /// Judges the previews whose outcome this step of ordinary motion shows; every few steps all predictors
    /// make new previews.
    pub fn observe(&mut self, step: &LearnStep) {
        let moved = step.pen.x.map(|x| x * step.scale_m);
        self.judge(moved);
        self.panel.observe(&step.pen);
        self.since += 1;
        if self.since < STRIDE {
            return;
        }
        self.since = 0;
        self.pending.rotate_right(1);
        let Some(previews) = self.pending.first_mut() else { return };
        previews.unit_m = step.level * step.scale_m;
        previews.resting = step.level <= REST;
        (previews.age, previews.way) = (0, [0.0; 2]);
        for (kind, path) in PredictorKind::BUILT_IN.into_iter().zip(&mut previews.paths) {
            self.panel.roll_out(kind, step.limit, step.scale_m, [0.0; 2], path);
        }
        self.waiting = (self.waiting + 1).min(PENDING);
    }

    /// The bands that hold at present.
    #[must_use]
    pub fn table(&self) -> BandTable {
        let mut table = BandTable::default();
        for (kind, of_kind) in PredictorKind::BUILT_IN.into_iter().zip(&self.factors) {
            let Some(out) = table.factors.get_mut(kind.index()) else { continue };
            for (out, factor) in out.iter_mut().zip(of_kind) {
                *out = factor.get().unwrap_or(0.0) as f32;
            }
        }
        table
    }

    /// Cases judged so far, and how many of them fell outside, for `kind` at `lead` steps.
    #[must_use]
    pub fn judged(&self, kind: PredictorKind, lead: usize) -> (u32, u32) {
        let index = PredictorKind::BUILT_IN.into_iter().position(|live| live == kind);
        let factor = index
            .and_then(|index| self.factors.get(index))
            .and_then(|factors| factors.get(lead.checked_sub(1)?));
        factor.map_or((0, 0), |factor| (factor.updates, factor.misses))
    }

    fn judge(&mut self, moved: [f64; 2]) {
        let [dx, dy] = moved;
        for previews in self.pending.iter_mut().take(self.waiting) {
            let lead = previews.age;
            previews.age += 1;
            let [x, y] = &mut previews.way;
            (*x, *y) = (*x + dx, *y + dy);
            if previews.resting && x.hypot(*y) <= previews.unit_m {
                continue;
            }
            for (factors, path) in self.factors.iter_mut().zip(&previews.paths) {
                let (Some(factor), Some([px, py])) = (factors.get_mut(lead), path.get(lead)) else {
                    continue;
                };
                factor.judge((px - *x).hypot(py - *y) / previews.unit_m, COVERAGE);
            }
        }
    }
}
