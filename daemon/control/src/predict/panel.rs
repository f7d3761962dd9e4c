//! `Panel`: every predictor behind one memory of the pen, in normalised units.
//!
//! Contract: all observe every step, so a switch needs no new history. The loop previews from its panel, the learner
//! calibrates error bands on one of its own: the same code, fed with the same steps, so the bands are those of the loop.
//! A further predictor is a field here and a line in `observe`, `forget`, `preview` and `set_weights`; one that learns
//! online needs its parameters in [`OnlineWeights`] besides.

use super::bands::BandTable;
use super::online::{ModelParameters, OnlineModel, WeightsError};
use super::online_weights::OnlineWeights;
use super::{
    ConstantVelocity, DybmLearner, DybmSettings, DybmWeights, Hold, MAX_PREVIEW, Oracle, Predictor,
    PredictorKind,
};

/// A model that learns online as a predictor: its memory, and parameters from elsewhere.
#[derive(Debug, Clone)]
pub struct Student<M: OnlineModel> {
    model: M,
}

impl<M: OnlineModel> Student<M> {
    /// Predicts with the parameters of `model`.
    pub const fn new(model: M) -> Self {
        Self { model }
    }

    /// Exchanges the parameters, unless they are the same version; memory stays.
    ///
    /// *Errors*: parameters that are invalid or do not fit; the old ones stay.
    pub fn set_parameters(&mut self, parameters: &M::Parameters) -> Result<(), WeightsError> {
        if parameters.version() == self.model.parameters().version() {
            return Ok(());
        }
        self.model.continue_from(parameters)
    }

    /// Checks what `set_parameters` would refuse.
    ///
    /// *Errors*: parameters that are invalid or do not fit.
    pub fn check(&self, parameters: &M::Parameters) -> Result<(), WeightsError> {
        if parameters.version() == self.model.parameters().version() {
            return Ok(());
        }
        parameters.validate()?;
        self.model.parameters().accepts(parameters)
    }

    /// Parameters in use.
    pub fn parameters(&self) -> &M::Parameters {
        self.model.parameters()
    }

    /// Memory of the pen.
    pub fn memory(&self) -> &M::Memory {
        self.model.memory()
    }
}

impl<M: OnlineModel> Predictor for Student<M> {
    fn observe(&mut self, x: [f64; 2]) {
        self.model.observe(x);
    }

    fn preview_within(&self, limit: f64, out: &mut [[f64; 2]]) {
        self.model.preview_from(self.model.parameters(), self.model.memory(), limit, out);
    }

    fn reset(&mut self) {
        self.model.reset_state();
    }
}

/// Weights before anything was learned.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum InitialWeights {
    /// All zero, as in the paper: predicts like Hold at first.
    Zero,
    /// W_1 = this·I: predicts the last displacement, fading by this factor per step.
    Persistent(f64),
}

/// Sizes and learning rules of the models that learn online.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ModelSettings {
    /// Δ [ns].
    pub step_ns: u64,
    /// Linear DyBM.
    pub dybm: DybmSettings,
    /// Its start.
    pub initial: InitialWeights,
}

impl ModelSettings {
    /// The weights before anything was learned.
    #[must_use]
    pub fn initial_weights(&self) -> OnlineWeights {
        let dybm = match self.initial {
            InitialWeights::Zero => DybmWeights::zero(self.step_ns, self.dybm.shape),
            InitialWeights::Persistent(factor) => {
                DybmWeights::persistent(self.step_ns, self.dybm.shape, factor)
            }
        };
        OnlineWeights { version: 0, dybm, bands: BandTable::default() }
    }
}

/// What a roll-out came to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RollOut {
    /// Every number was finite; if not, all positions are the first.
    pub finite: bool,
    /// Predicted displacements that the bound shortened.
    pub limited: u32,
}

/// All predictors.
#[derive(Debug, Clone)]
pub struct Panel {
    hold: Hold,
    constant_velocity: ConstantVelocity,
    dybm: Student<DybmLearner>,
    oracle: Option<Oracle>,
}

impl Panel {
    /// Starts with empty memories.
    ///
    /// *Errors*: settings outside their bounds, or weights that are invalid or made for another loop.
    pub fn new(settings: &ModelSettings, weights: &OnlineWeights) -> Result<Self, WeightsError> {
        weights.validate()?;
        weights.fits(settings.step_ns)?;
        Ok(Self {
            hold: Hold,
            constant_velocity: ConstantVelocity::default(),
            dybm: Student::new(DybmLearner::new(settings.dybm, weights.dybm)?),
            oracle: None,
        })
    }

    /// Remembers one real normalised displacement.
    pub fn observe(&mut self, x: [f64; 2]) {
        self.hold.observe(x);
        self.constant_velocity.observe(x);
        self.dybm.observe(x);
    }

    /// Empties all memories.
    pub fn forget(&mut self) {
        self.hold.reset();
        self.constant_velocity.reset();
        self.dybm.reset();
    }

    /// The linear DyBM.
    #[must_use]
    pub const fn dybm(&self) -> &Student<DybmLearner> {
        &self.dybm
    }

    /// `kind` can be chosen.
    #[must_use]
    pub fn offers(&self, kind: PredictorKind) -> bool {
        kind != PredictorKind::Oracle || self.oracle.is_some()
    }

    /// Takes over what changed, all or nothing; memories stay.
    ///
    /// *Errors*: weights that are invalid or do not fit; the old ones stay.
    pub fn set_weights(&mut self, weights: &OnlineWeights) -> Result<(), WeightsError> {
        self.dybm.check(&weights.dybm)?;
        self.dybm.set_parameters(&weights.dybm)
    }

    /// Positions [m] from `from` on, one per entry of `out`, with `scale_m` metres per unit and no displacement longer
    /// than `limit` (normalised); beyond [`MAX_PREVIEW`] the last is repeated.
    pub fn roll_out(
        &self,
        kind: PredictorKind,
        limit: f64,
        scale_m: f64,
        from: [f64; 2],
        out: &mut [[f64; 2]],
    ) -> RollOut {
        let mut scratch = [[0.0; 2]; MAX_PREVIEW];
        let wanted = out.len().min(MAX_PREVIEW);
        let steps = scratch.get_mut(..wanted).unwrap_or_default();
        // What is known is not bounded.
        let limit = if kind == PredictorKind::Oracle { f64::INFINITY } else { limit };
        self.preview(kind, limit, steps);
        let mut report = RollOut { finite: true, limited: 0 };
        let almost = limit * (1.0 - 1e-9);
        let [mut x, mut y] = from;
        let mut steps = steps.iter();
        for position in out.iter_mut() {
            if let Some([dx, dy]) = steps.next() {
                report.limited += u32::from(dx * dx + dy * dy >= almost * almost);
                x += scale_m * dx;
                y += scale_m * dy;
            }
            *position = [x, y];
        }
        // One NaN anywhere is in every later sum.
        if !(x.is_finite() && y.is_finite()) {
            report.finite = false;
            out.fill(from);
        }
        report
    }

    /// Gives the recorded future to the oracle.
    pub(super) fn load(&mut self, oracle: Oracle) {
        self.oracle = Some(oracle);
    }

    /// Tells the oracle where the loop is.
    pub(super) fn place(&mut self, index: u64, scale_m: f64) {
        if let Some(oracle) = &mut self.oracle {
            oracle.place(index, scale_m);
        }
    }

    /// The weights in use as a set.
    pub(super) fn weights(&self, version: u64, bands: BandTable) -> OnlineWeights {
        OnlineWeights { version, dybm: *self.dybm.parameters(), bands }
    }

    fn preview(&self, kind: PredictorKind, limit: f64, out: &mut [[f64; 2]]) {
        match (kind, &self.oracle) {
            (PredictorKind::Hold, _) | (PredictorKind::Oracle, None) => self.hold.preview_within(limit, out),
            (PredictorKind::ConstantVelocity, _) => self.constant_velocity.preview_within(limit, out),
            (PredictorKind::Dybm, _) => self.dybm.preview_within(limit, out),
            (PredictorKind::Oracle, Some(oracle)) => oracle.preview_within(limit, out),
        }
    }
}
