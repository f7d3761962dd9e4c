//! Times the models that learn online: predicting, and learning.
//!
//! Contract: a learner's row costs one `learn`: the prediction before the displacement is seen, the update,
//! the memory. The DyBM is that of the reference tables (delay 2, decay 0.5, AdaGrad 0.1) and starts at zero;
//! time does not depend on what was learned.

use foretrace_control::predict::models::dybm::{DybmShape, TraceInput};
use foretrace_control::predict::models::esn::{ReadoutRule, Reservoir, ReservoirSettings};
use foretrace_control::predict::{
    ArRls, ArRlsLearner, ArRlsSettings, ArRlsWeights, Dybm, DybmEsn, DybmEsnLearner, DybmEsnSettings,
    DybmLearner, DybmSettings, DybmWeights, Learning, Models, OnlineModel, Optimiser, PredictorKind,
    WeightsError,
};

use crate::predictors::Candidate;

/// One row each for predicting 10 steps and for learning.
pub(crate) fn candidates(step_ns: u64) -> Result<Vec<Candidate>, WeightsError> {
    let shape = DybmShape::new(2, &[0.5], TraceInput::Newest);
    let optimiser = Optimiser::ada_grad(0.1);
    let dybm = DybmSettings { shape, optimiser, l1: 0.0, l2: 0.0 };
    let dybm_weights = DybmWeights::zero(step_ns, shape);
    let reservoir = Reservoir::shared(&ReservoirSettings::default())?;
    let esn = DybmEsnSettings { dybm, readout: optimiser, rule: ReadoutRule::SharedResidual };
    let esn = DybmEsnLearner::untrained(esn, dybm_weights, reservoir.clone())?;
    let ar_weights = ArRlsWeights::constant_velocity(step_ns);
    let ar_settings = ArRlsSettings::default();
    let predicting = |name: &str, predictor| Candidate { name: name.to_owned(), steps: 10, predictor };
    let learning = |name: &str, predictor| Candidate { name: name.to_owned(), steps: 0, predictor };
    Ok(vec![
        predicting("dybm", Box::new(Dybm::new(dybm_weights)?)),
        predicting("dybm-esn", Box::new(DybmEsn::new(*esn.parameters(), reservoir)?)),
        predicting("ar-rls", Box::new(ArRls::new(ar_weights, ar_settings.gate)?)),
        learning("dybm, learning", Box::new(Learning(DybmLearner::new(dybm, dybm_weights)?))),
        learning("dybm-esn, learning", Box::new(Learning(esn))),
        learning("ar-rls, learning", Box::new(Learning(ArRlsLearner::new(ar_settings, ar_weights)?))),
    ])
}

/// A predictor as the loop has it, predicting `leads` steps, and learning if it learns.
pub(crate) fn of_the_loop(
    kind: PredictorKind,
    models: &Models,
    leads: usize,
) -> Result<Vec<Candidate>, WeightsError> {
    let weights = models.initial_weights();
    let mut rows = Vec::new();
    if let Some(predictor) = kind.predictor(models, &weights)? {
        rows.push(Candidate { name: kind.name().to_owned(), steps: leads, predictor });
    }
    if let Some(predictor) = kind.learner(models, &weights)? {
        rows.push(Candidate { name: format!("{}, learning", kind.name()), steps: 0, predictor });
    }
    Ok(rows)
}
