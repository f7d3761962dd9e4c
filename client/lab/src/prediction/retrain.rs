//! Networks trained again on the train part of a set, by the recipes behind the reference rows.
//!
//! The paper's recipe for 10 cells, the robust one for more; seed 0, all train writers, no epoch chosen by
//! scores.

use std::collections::BTreeMap;
use std::ops::ControlFlow;
use std::time::Instant;

use foretrace_config::models::LstmModel;
use foretrace_control::predict::LstmError;

use super::Set;
use crate::train::{Augment, Fit, FitError, Recipe, Setup, Strokes, TrainPlan, corpus, model};

/// The names that can be trained, with their cells.
pub const TRAINABLE: [(&str, usize); 2] = [("lstm10", 10), ("lstm32", 32)];

/// A network and what an epoch of its training took.
#[derive(Debug, Clone)]
pub struct Retrained {
    pub model: LstmModel,
    /// Wall time of an epoch, mean \[s\].
    pub train_s_per_epoch: f64,
}

#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum RetrainError {
    /// Nothing to train on.
    #[error("{set} has no train part with motion in it; leave --train out, or give a set with one")]
    Empty { set: String },
    /// It diverged.
    #[error(transparent)]
    Fit(#[from] FitError),
    /// The loop would refuse the result.
    #[error(transparent)]
    Network(#[from] LstmError),
}

/// Epochs that [`retrain`] makes.
#[must_use]
pub fn retrain_epochs(cells: usize) -> usize {
    recipe(cells).epochs(cells)
}

/// Trains `name` with `cells` cells on the train part of `set`; calls `done` after every epoch.
///
/// # Errors
/// [`RetrainError`]: no train part, or a training that diverged.
pub fn retrain(name: &str, cells: usize, set: &Set, done: &dyn Fn()) -> Result<Retrained, RetrainError> {
    let recipe = recipe(cells);
    let strokes: Vec<Strokes> =
        set.train.iter().map(|s| Strokes { v: s.v.clone(), jump: s.jump.clone() }).collect();
    let scale = corpus::rms(&strokes);
    let Some(rate_hz) = set.train.first().map(|s| s.rate_hz).filter(|_| scale > 0.0) else {
        return Err(RetrainError::Empty { set: set.name.clone() });
    };
    let epochs = recipe.epochs(cells);
    let plan = TrainPlan {
        schedule: recipe.schedule(None),
        epochs,
        batch: recipe.batch(),
        seed: 0,
        limit_norm: None,
        augment: Augment::default(),
        keep_speed: false,
        patience: None,
    };
    let setup = Setup { network: recipe.network(cells, 1), objective: recipe.objective(1), scale };
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    let started = Instant::now();
    let mut fit = Fit::new(plan, setup.clone(), (strokes, Vec::new()), threads, None);
    while !fit.is_finished() {
        fit.epoch(|| ControlFlow::Continue(()))?;
        done();
    }
    let train_s_per_epoch = started.elapsed().as_secs_f64() / epochs.max(1) as f64;
    let notes = BTreeMap::from([("units".to_owned(), "raw".to_owned())]);
    let model = model(name, &setup, fit.outcome().1, 1e3 / rate_hz, notes)?;
    Ok(Retrained { model, train_s_per_epoch })
}

fn recipe(cells: usize) -> Recipe {
    if cells <= 10 { Recipe::Paper } else { Recipe::Robust }
}
