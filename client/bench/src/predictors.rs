//! One row per predictor: the cost of observing a displacement and predicting from it.
//!
//! Contract: every predictor sees the same displacements of the recorded pen, normalised like the loop's, one
//! after the other, and is timed in rotating order. A cost is one `observe` and one `preview`, or one
//! `learn`. The values of a network's weights do not change its time, so sizes without shipped weights run on
//! random ones.

use std::hint::black_box;
use std::sync::Arc;
use std::time::Instant;

use foretrace_config::Config;
use foretrace_config::models::LstmModel;
use foretrace_control::pen::{Motion, PenTracker, SpeedScale};
use foretrace_control::predict::models::lstm::{LstmSpec, LstmTensors};
use foretrace_control::predict::{AnyPredictor, Lstm, LstmWeights, MAX_PREVIEW, PredictorKind};
use serde::Serialize;

use crate::dice::BenchDice;
use crate::online;
use crate::workload::Workload;
use crate::{CostQuantiles, cost, elapsed_us};
use foretrace_failure::Failure;

/// A predictor to be timed.
pub(crate) struct Candidate {
    pub(crate) name: String,
    /// Steps it previews; none for one that learns instead.
    pub(crate) steps: usize,
    pub(crate) predictor: Box<dyn AnyPredictor>,
}

/// What one predictor costs.
#[derive(Debug, Clone, Serialize)]
pub struct PredictorCost {
    pub name: String,
    pub steps: usize,
    #[serde(flatten)]
    pub us: CostQuantiles,
}

/// Times every predictor on `samples` displacements of the recorded pen.
///
/// # Errors
///
/// Settings the pen's grid refuses, a pen that never moves.
pub(crate) fn predictors<const N: usize>(
    config: &Config,
    workload: &Workload<N>,
    samples: u32,
) -> Result<Vec<PredictorCost>, Failure> {
    let pen = displacements(config, workload)?;
    if pen.is_empty() {
        return Err(Failure::bad_input("the pen never moves in the recorded loop", "choose another --pen"));
    }
    let mut candidates = candidates(config)?;
    let mut times = vec![Vec::new(); candidates.len()];
    let mut out = [[0.0; 2]; MAX_PREVIEW];
    let count = candidates.len();
    for (round, x) in pen.iter().cycle().take(samples as usize).enumerate() {
        for turn in 0..count {
            let which = (turn + round) % count;
            let Candidate { steps, predictor, .. } = &mut candidates[which];
            let out = &mut out[..*steps];
            let x = black_box(*x);
            let begin = Instant::now();
            predictor.observe(x);
            predictor.preview(black_box(out));
            times[which].push(elapsed_us(begin));
        }
    }
    let costs = candidates.into_iter().zip(times);
    Ok(costs.map(|(c, times)| PredictorCost { name: c.name, steps: c.steps, us: cost(times) }).collect())
}

fn candidates(config: &Config) -> Result<Vec<Candidate>, Failure> {
    let refused = |error: &dyn std::fmt::Display| Failure::failed(error, "");
    let step_ns = config.follower_settings().preview.step_ns;
    let reference = LstmModel::find("lstm10-reference").map_err(|error| refused(&error))?.weights;
    let plain = made_up(LstmSpec::plain(32, 10.0, step_ns)).map_err(|error| refused(&error))?;
    let spec =
        LstmSpec { leads: 24, residual: true, input_clip: Some(4.0), ..LstmSpec::plain(64, 10.0, step_ns) };
    let direct = made_up(spec).map_err(|error| refused(&error))?;
    let lstm = |name: &str, weights, steps| {
        let predictor = Box::new(Lstm::new(weights));
        Candidate { name: name.to_owned(), steps, predictor }
    };
    let mut candidates = vec![
        lstm("lstm10, rolled out", reference, 10),
        lstm("lstm32, rolled out", plain, 10),
        lstm("lstm64, direct", direct, 24),
    ];
    candidates.extend(online::candidates(step_ns).map_err(|error| refused(&error))?);
    // As the loop has it: its network, and as many steps as its plan and dead time ask for.
    let models = config.models();
    let leads = config.learner_settings().leads.last();
    let others = PredictorKind::BUILT_IN.into_iter().filter(|kind| models.has(*kind));
    for kind in others.filter(|kind| !HAVE_ROWS.contains(kind)) {
        candidates.extend(online::of_the_loop(kind, models, leads).map_err(|error| refused(&error))?);
    }
    Ok(candidates)
}

/// Predictors that have rows of their own, or nothing to time; the registry provides all others.
const HAVE_ROWS: [PredictorKind; 6] = [
    PredictorKind::HOLD,
    PredictorKind::CONSTANT_VELOCITY,
    PredictorKind::LSTM,
    PredictorKind::DYBM,
    PredictorKind::DYBM_ESN,
    PredictorKind::AR_RLS,
];

/// Weights within ±0.5, like those of a trained network.
fn made_up(spec: LstmSpec) -> Result<Arc<LstmWeights>, foretrace_control::predict::LstmError> {
    let mut tensors = LstmTensors::zero(spec.hidden, spec.leads);
    let mut dice = BenchDice::new();
    for value in tensors.all_mut().into_iter().flatten() {
        *value = dice.next() as f64 / BenchDice::BOUND as f64 - 0.5;
    }
    LstmWeights::new(spec, tensors).map(Arc::new)
}

/// The recorded pen's grid steps, normalised.
fn displacements<const N: usize>(config: &Config, workload: &Workload<N>) -> Result<Vec<[f64; 2]>, Failure> {
    let settings = config.follower_settings();
    let refused = |error: &dyn std::fmt::Display| Failure::bad_input(error, "");
    let mut tracker = PenTracker::new(settings.pen).map_err(|error| refused(&error))?;
    let mut scale = SpeedScale::new(settings.preview.scale).map_err(|error| refused(&error))?;
    let mut out = Vec::new();
    for tick in &workload.ticks {
        tick.ingest(&mut tracker, &settings.plane);
        while let Some(step) = tracker.next_step() {
            if step.motion == Motion::Continues {
                scale.observe(&step);
                out.push(scale.normalise(step.displacement));
            }
        }
    }
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_predictor_but_the_two_that_cost_nothing_has_a_row() {
        let rows = candidates(&Config::preset("ur5").unwrap()).unwrap();
        let costs =
            |kind: &PredictorKind| ![PredictorKind::HOLD, PredictorKind::CONSTANT_VELOCITY].contains(kind);
        for kind in PredictorKind::BUILT_IN.into_iter().filter(costs) {
            assert!(rows.iter().any(|row| row.name.starts_with(kind.name())), "{kind:?} has no row");
        }
    }
}
