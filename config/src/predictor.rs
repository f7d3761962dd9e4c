//! The predictors: sizes and learning rules from the settings, trained networks and the start of refinement
//! from their files.
//!
//! Contract: networks are loaded and checked with the settings, so that a daemon that starts has networks
//! that fit.

use std::sync::Arc;

use foretrace_control::estimate::refine::RefinePrior;
use foretrace_control::predict::models::ar_rls::ArRlsSettings;
use foretrace_control::predict::models::dybm::{DybmShape, TraceInput};
use foretrace_control::predict::models::esn::ReservoirSettings;
use foretrace_control::predict::{
    DybmSettings, InitialWeights, MixtureSettings, ModelSettings, Models, Networks, Optimiser, PredictorKind,
};

use crate::check::Findings;
use crate::models::{ForesightModel, LstmModel, ModelError, SHIPPED_PRIOR, find_prior_in, shipped};
use crate::problem::Problem;
use crate::schema::ValueRule;
use crate::settings::{self, Settings, TraceChoice};
use crate::value::{SettingValue, word};
use crate::written::Node;

impl SettingValue for PredictorKind {
    fn read(node: &Node, rule: &ValueRule<'_>, problems: &mut Vec<Problem>) -> Option<Self> {
        // The key's rule only accepts names of the registry.
        word(node, rule, problems).and_then(Self::from_name)
    }

    fn write(&self) -> Option<String> {
        Some(format!("{:?}", self.name()))
    }

    fn explained() -> String {
        let each = Self::LIVE.map(|kind| format!("{:?}: {}", kind.name(), kind.about()));
        format!(" {}.", each.join("; "))
    }
}

/// A predictor that this process runs itself.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct BuiltIn(pub PredictorKind);

impl SettingValue for BuiltIn {
    fn read(node: &Node, rule: &ValueRule<'_>, problems: &mut Vec<Problem>) -> Option<Self> {
        // The key's rule has no other.
        PredictorKind::read(node, rule, problems).map(Self)
    }

    fn write(&self) -> Option<String> {
        self.0.write()
    }
}

/// Says that a network shall not be used, not even a shipped one.
pub(crate) const NO_NETWORK: &str = "none";

/// Builds what the predictors are made of; `None` when something was reported.
pub(crate) fn models(settings: &Settings, report: &mut Findings<'_>) -> Option<Models> {
    let section = &settings.predictor;
    let step_ns = settings.step_ns();
    let files = report.files;
    let lstm = |name: &str| {
        let model = LstmModel::find_in(name, files)?;
        model.fits(step_ns).map(|()| model.weights)
    };
    let foresight = |name: &str| {
        let model = ForesightModel::find_in(name, files)?;
        model.fits(step_ns).map(|()| model.weights)
    };
    let named = &section.mixture;
    let alone = network("predictor.lstm", section.lstm.as_deref(), "lstm10", lstm, settings, report);
    let mixture =
        network("predictor.mixture.network", named.network.as_deref(), "mixture", lstm, settings, report);
    let key = "predictor.mixture.foresight";
    let foresight = network(key, named.foresight.as_deref(), "foresight", foresight, settings, report);
    let networks = Networks { lstm: alone?, mixture: mixture?, foresight: foresight? };
    let (key, kind) = match section.kind {
        PredictorKind::EXTERNAL => ("predictor.external.fallback", section.external.fallback.0),
        kind => ("predictor.kind", kind),
    };
    match Models::new(model_settings(settings), networks) {
        Ok(models) if models.has(kind) => Some(models),
        Ok(_) => {
            let name = kind.name();
            report.conflict(
                key,
                format!(
                    "needs a trained network, and none is there for pen.step_ms = \
                         {}",
                    settings.pen.step_ms
                ),
                format!(
                    "set predictor.{name} to a .safetensors file made for this step, or choose another \
                         predictor"
                ),
            );
            None
        }
        Err(error) => {
            report.conflict("predictor.kind", format!("cannot be built: {error}"), "correct that setting");
            None
        }
    }
}

/// The network of `key`: as named; where nothing is named, the shipped one of `family` for this step, if
/// there is one. `None` when something was reported.
fn network<W>(
    key: &str,
    name: Option<&str>,
    family: &str,
    load: impl Fn(&str) -> Result<Arc<W>, ModelError>,
    settings: &Settings,
    report: &mut Findings<'_>,
) -> Option<Option<Arc<W>>> {
    let suited = format!("{family}-{}ms", settings.pen.step_ms);
    let name = match name {
        Some(NO_NETWORK) => return Some(None),
        Some(name) => name,
        None if shipped(&suited).is_some() => &suited,
        None => return Some(None),
    };
    match load(name) {
        Ok(weights) => Some(Some(weights)),
        Err(error) => {
            report.conflict(
                key,
                format!("cannot be used: {error}"),
                format!("name another network, or leave the key out (\"{NO_NETWORK}\" does without)"),
            );
            None
        }
    }
}

/// The weights from which refinement starts; `None` when something was reported.
pub(crate) fn prior(settings: &Settings, report: &mut Findings<'_>) -> Option<RefinePrior> {
    let name = settings.predictor.refine.prior.as_deref().unwrap_or(SHIPPED_PRIOR.name);
    match find_prior_in(name, report.files) {
        Ok(prior) => Some(prior),
        Err(error) => {
            let remedy = "name another file, or leave the key out";
            report.conflict("predictor.refine.prior", format!("cannot be used: {error}"), remedy);
            None
        }
    }
}

fn model_settings(s: &Settings) -> ModelSettings {
    let settings::Predictor { dybm, esn, ar_rls, mixture, .. } = &s.predictor;
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
        mixture: MixtureSettings { forgetting: mixture.forgetting, rate: mixture.rate, share: mixture.share },
        ar_rls: ArRlsSettings {
            forgetting: ar_rls.forgetting,
            gate: ar_rls.gate,
            huber: ar_rls.huber,
            ..ArRlsSettings::default()
        },
    }
}
