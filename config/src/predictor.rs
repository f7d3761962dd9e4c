//! The predictors: sizes and learning rules from the settings, the trained network from its file.
//!
//! Contract: a network is loaded and judged when the settings are, so that a daemon that starts has a network that fits.

use foretrace_control::predict::ar_rls::ArRlsSettings;
use foretrace_control::predict::dybm::{DybmShape, TraceInput};
use foretrace_control::predict::esn::ReservoirSettings;
use foretrace_control::predict::{
    DybmSettings, InitialWeights, ModelSettings, Models, Optimiser, PredictorKind,
};

use crate::check::Report;
use crate::models::LstmModel;
use crate::settings::{self, PredictorChoice, Settings, TraceChoice};

impl PredictorChoice {
    /// The predictor of the control law.
    #[must_use]
    pub const fn kind(self) -> PredictorKind {
        match self {
            Self::Hold => PredictorKind::Hold,
            Self::ConstantVelocity => PredictorKind::ConstantVelocity,
            Self::Dybm => PredictorKind::Dybm,
            Self::DybmEsn => PredictorKind::DybmEsn,
            Self::Lstm => PredictorKind::Lstm,
            Self::ArRls => PredictorKind::ArRls,
        }
    }
}

/// Builds what the predictors are made of; `None` when something was reported.
pub(crate) fn models(settings: &Settings, report: &mut Report<'_>) -> Option<Models> {
    let lstm = match &settings.predictor.lstm {
        Some(name) => match network(name, settings.step_ns()) {
            Ok(model) => Some(model.weights),
            Err(error) => {
                report.conflict(
                    "predictor.lstm",
                    format!("cannot be used: {error}"),
                    "name another network, or leave the key out",
                );
                return None;
            }
        },
        None if settings.predictor.kind == PredictorChoice::Lstm => {
            report.conflict(
                "predictor.kind",
                "needs a trained network, and predictor.lstm is not set",
                "set predictor.lstm to a .safetensors file, or choose another predictor",
            );
            return None;
        }
        None => None,
    };
    match Models::new(model_settings(settings), lstm) {
        Ok(models) => Some(models),
        Err(error) => {
            report.conflict("predictor.kind", format!("cannot be built: {error}"), "correct that setting");
            None
        }
    }
}

fn network(name: &str, step_ns: u64) -> Result<LstmModel, crate::models::ModelError> {
    let model = LstmModel::find(name)?;
    model.fits(step_ns)?;
    Ok(model)
}

fn model_settings(s: &Settings) -> ModelSettings {
    let settings::Predictor { dybm, esn, ar_rls, .. } = &s.predictor;
    ModelSettings {
        step_ns: s.step_ns(),
        dybm: DybmSettings {
            shape: DybmShape::new(
                dybm.delay as usize,
                &dybm.decays,
                match dybm.trace_input {
                    TraceChoice::Newest => TraceInput::Newest,
                    TraceChoice::Delayed => TraceInput::Delayed,
                },
            ),
            optimiser: match dybm.optimiser {
                settings::Optimiser::Adagrad => Optimiser::ada_grad(dybm.rate),
                settings::Optimiser::Rmsprop => Optimiser::rms_prop(dybm.rate),
                settings::Optimiser::Adam => Optimiser::adam(dybm.rate),
            },
            l1: dybm.l1,
            l2: dybm.l2,
        },
        initial: if s.learner.initial_persistence > 0.0 {
            InitialWeights::Persistent(s.learner.initial_persistence)
        } else {
            InitialWeights::Zero
        },
        reservoir: ReservoirSettings {
            seed: u64::from(esn.seed),
            leak: esn.leak,
            spectral_radius: esn.spectral_radius,
            ..ReservoirSettings::default()
        },
        readout: Optimiser::ada_grad(esn.rate),
        ar_rls: ArRlsSettings {
            forgetting: ar_rls.forgetting,
            gate: ar_rls.gate,
            huber: ar_rls.huber,
            ..ArRlsSettings::default()
        },
    }
}
