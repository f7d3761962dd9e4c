//! `Panel`: every predictor behind one memory of the pen, in normalised units.
//!
//! Contract: all observe every step, so a switch needs no new history. The loop previews from its panel, the learner
//! calibrates error bands on one of its own: the same code, fed with the same steps, so the bands are those of the loop.
//! A further predictor is a field here and a line in `observe`, `forget` and `predictor`; one that learns online needs its
//! parameters in [`OnlineWeights`], a line in `set_weights` and `weights`, and a course in [`crate::learn::Learner`] besides.

use super::bands::BandTable;
use super::online::{ModelParameters, WeightsError};
use super::online_weights::OnlineWeights;
use super::{
    ArRls, ArRlsWeights, ConstantVelocity, Dybm, DybmEsn, DybmEsnWeights, DybmWeights, Hold, Lstm,
    MAX_PREVIEW, Mixture, MixtureParameters, Models, Oracle, Predictor, PredictorKind,
};

/// A predictor whose parameters are learned elsewhere.
trait Taught: Predictor {
    type Parameters: ModelParameters;

    /// Parameters in use.
    fn parameters(&self) -> &Self::Parameters;

    /// Exchanges the parameters; memory stays.
    fn exchange(&mut self, parameters: &Self::Parameters) -> Result<(), WeightsError>;

    /// What `exchange` would say; the version in use is not judged again.
    fn judge(&self, parameters: &Self::Parameters) -> Result<(), WeightsError> {
        if parameters.version() == self.parameters().version() {
            return Ok(());
        }
        parameters.validate()?;
        self.parameters().accepts(parameters)
    }

    /// Exchanges the parameters, unless they are the version in use.
    fn take_over(&mut self, parameters: &Self::Parameters) -> Result<(), WeightsError> {
        if parameters.version() == self.parameters().version() {
            return Ok(());
        }
        self.exchange(parameters)
    }
}

macro_rules! taught {
    ($($predictor:ty => $parameters:ty),* $(,)?) => {$(
        impl Taught for $predictor {
            type Parameters = $parameters;

            fn parameters(&self) -> &$parameters {
                self.weights()
            }

            fn exchange(&mut self, parameters: &$parameters) -> Result<(), WeightsError> {
                self.set_weights(parameters)
            }
        }
    )*};
}

taught! { Dybm => DybmWeights, DybmEsn => DybmEsnWeights, ArRls => ArRlsWeights, Mixture => MixtureParameters }

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
    dybm: Dybm,
    dybm_esn: DybmEsn,
    ar_rls: ArRls,
    mixture: Mixture,
    lstm: Option<Lstm>,
    oracle: Option<Oracle>,
    /// Something was observed since the memories were last emptied.
    knows: bool,
}

impl Panel {
    /// Starts with empty memories.
    ///
    /// *Errors*: weights that are invalid or made for another loop.
    pub fn new(models: &Models, weights: &OnlineWeights) -> Result<Self, WeightsError> {
        weights.validate()?;
        weights.fits(models.settings().step_ns)?;
        Ok(Self {
            hold: Hold,
            constant_velocity: ConstantVelocity::default(),
            dybm: models.dybm(weights)?,
            dybm_esn: models.dybm_esn(weights)?,
            ar_rls: models.ar_rls(weights)?,
            mixture: models.mixture(weights)?,
            lstm: models.lstm(),
            oracle: None,
            knows: false,
        })
    }

    /// Remembers one real normalised displacement.
    pub fn observe(&mut self, x: [f64; 2]) {
        self.hold.observe(x);
        self.constant_velocity.observe(x);
        self.dybm.observe(x);
        self.dybm_esn.observe(x);
        self.ar_rls.observe(x);
        self.mixture.observe(x);
        if let Some(lstm) = &mut self.lstm {
            lstm.observe(x);
        }
        self.knows = true;
    }

    /// Empties all memories.
    pub fn forget(&mut self) {
        self.hold.reset();
        self.constant_velocity.reset();
        self.dybm.reset();
        self.dybm_esn.reset();
        self.ar_rls.reset();
        self.mixture.reset();
        if let Some(lstm) = &mut self.lstm {
            lstm.reset();
        }
        self.knows = false;
    }

    /// `kind` can be chosen.
    #[must_use]
    pub fn offers(&self, kind: PredictorKind) -> bool {
        match kind {
            PredictorKind::ORACLE => self.oracle.is_some(),
            PredictorKind::LSTM => self.lstm.is_some(),
            _ => true,
        }
    }

    /// Takes over what changed, all or nothing; memories stay.
    ///
    /// *Errors*: weights that are invalid or do not fit; the old ones stay.
    pub fn set_weights(&mut self, weights: &OnlineWeights) -> Result<(), WeightsError> {
        self.dybm.judge(&weights.dybm)?;
        self.dybm_esn.judge(&weights.dybm_esn)?;
        self.ar_rls.judge(&weights.ar_rls)?;
        self.mixture.judge(&weights.mixture)?;
        self.dybm.take_over(&weights.dybm)?;
        self.dybm_esn.take_over(&weights.dybm_esn)?;
        self.ar_rls.take_over(&weights.ar_rls)?;
        self.mixture.take_over(&weights.mixture)
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
        let limit = if kind == PredictorKind::ORACLE { f64::INFINITY } else { limit };
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
        OnlineWeights {
            version,
            dybm: *self.dybm.parameters(),
            dybm_esn: *self.dybm_esn.parameters(),
            ar_rls: *self.ar_rls.parameters(),
            mixture: *self.mixture.parameters(),
            bands,
        }
    }

    fn preview(&self, kind: PredictorKind, limit: f64, out: &mut [[f64; 2]]) {
        self.predictor(kind).preview_within(limit, out);
    }

    /// Whoever answers for `kind`: Hold for what is not there, and for everybody who knows nothing yet.
    fn predictor(&self, kind: PredictorKind) -> &dyn Predictor {
        match kind {
            PredictorKind::ORACLE => self.oracle.as_ref().map_or(&self.hold, |oracle| oracle),
            _ if !self.knows => &self.hold,
            PredictorKind::CONSTANT_VELOCITY => &self.constant_velocity,
            PredictorKind::DYBM => &self.dybm,
            PredictorKind::DYBM_ESN => &self.dybm_esn,
            PredictorKind::AR_RLS => &self.ar_rls,
            PredictorKind::MIXTURE => &self.mixture,
            PredictorKind::LSTM => self.lstm.as_ref().map_or(&self.hold, |lstm| lstm),
            _ => &self.hold,
        }
    }
}
