//! [`OfTheLoop`]: a predictor of the control law's registry as the loop configures it, for tables without a
//! row of its own for it.
//!
//! Contract: what learns online learns as it is scored, from the loop's own start and with the preset's
//! rules; inputs are normalised as the loop does it.

use foretrace_control::pen::TARGET_RMS;
use foretrace_control::predict::{
    AnyPredictor, Hold, ModelSettings, Models, ModelsError, Needs, Networks, PredictorKind,
};

use super::model::Contestant;
use super::scaled::Scaled;

/// Those with rows of their own in the tables, on other inputs or from another start.
const HAVE_ROWS: [PredictorKind; 7] = [
    PredictorKind::HOLD,
    PredictorKind::CONSTANT_VELOCITY,
    PredictorKind::DYBM,
    PredictorKind::LSTM,
    PredictorKind::DYBM_ESN,
    PredictorKind::AR_RLS,
    PredictorKind::MIXTURE,
];

/// All others that need only the pen.
pub(super) fn others() -> impl Iterator<Item = PredictorKind> {
    PredictorKind::ALL.into_iter().filter(|kind| kind.needs() == Needs::Nothing && !HAVE_ROWS.contains(kind))
}

/// A predictor of the loop as a contestant.
#[derive(Debug)]
struct OfTheLoop(Box<dyn AnyPredictor>);

impl Contestant for OfTheLoop {
    fn start_sequence(&mut self) {
        self.0.reset();
    }

    fn observe(&mut self, v: [f64; 2]) {
        self.0.observe(v);
    }

    fn preview(&self, out: &mut [[f64; 2]]) {
        self.0.preview(out);
    }
}

/// The contestant for a device with this step \[ns\].
///
/// # Errors
///
/// Settings that the control law refuses.
pub(super) fn of_the_loop(kind: PredictorKind, step_ns: u64) -> Result<Box<dyn Contestant>, ModelsError> {
    let models = Models::new(ModelSettings::preset(step_ns), Networks::default())?;
    let weights = models.initial_weights();
    let model = match kind.learner(&models, &weights)? {
        Some(learner) => Some(learner),
        None => kind.predictor(&models, &weights)?,
    };
    let model = OfTheLoop(model.unwrap_or(Box::new(Hold)));
    Ok(Box::new(Scaled::new(model, TARGET_RMS)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::prediction::{names, order};

    #[test]
    fn every_predictor_of_the_registry_has_a_row() {
        for kind in PredictorKind::ALL.into_iter().filter(|kind| kind.needs() == Needs::Nothing) {
            assert!(HAVE_ROWS.contains(&kind) || names().contains(&kind.name()), "{kind:?} has no row");
        }
        let mut once = order();
        once.sort_unstable();
        once.dedup();
        assert_eq!(once.len(), order().len(), "a name stands twice");
    }

    #[test]
    fn a_predictor_of_the_loop_takes_part_in_the_raw_units_of_any_device() {
        for kind in [PredictorKind::CONSTANT_VELOCITY, PredictorKind::AR_RLS] {
            let mut contestant = of_the_loop(kind, 10_000_000).unwrap();
            contestant.start_sequence();
            for _ in 0..400 {
                contestant.observe([0.003, -0.001]);
            }
            let mut out = [[0.0; 2]; 4];
            contestant.preview(&mut out);
            for [x, y] in out {
                assert!((x - 0.003).abs() < 1e-4 && (y + 0.001).abs() < 1e-4, "{kind:?}: {out:?}");
            }
        }
    }
}
