//! What inputs and training sets are worth: networks trained with less or more, judged on other writers.

use std::collections::BTreeMap;
use std::ops::ControlFlow;

use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64;

use super::corpus::{Distortion, Writing};
use super::fit::{ForesightFit, ForesightPlan, GradientEngine, of_writing};
use super::network::ForesightShape;
use super::score::{ErrorSums, LEADS_S};
use super::study::{Context, Study, Without};
use crate::train::fit::FitError;

/// Bootstraps of an interval.
const BOOTSTRAPS: usize = 2000;

/// One way to train.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ForesightTrial {
    /// What the network sees.
    pub study: Study,
    /// The set that it is not trained on.
    pub left_out: Option<String>,
}

impl ForesightTrial {
    /// The loop's inputs, each kind left out, all of them left out, more context, and each of `sets` left
    /// out of the training.
    #[must_use]
    pub fn all(sets: &[String]) -> Vec<Self> {
        let none = Without::default();
        let without = [
            none,
            Without { contact: true, ..none },
            Without { direction: true, ..none },
            Without { time: true, ..none },
            Without { contact: true, direction: true, time: true },
        ];
        let less = without.map(|without| Study { without, context: Context::Short });
        let more = Context::ALL.into_iter().skip(1).map(|context| Study { without: none, context });
        let seen = less.into_iter().chain(more).map(|study| Self { study, left_out: None });
        let left_out = |set: &String| Self { study: Study::default(), left_out: Some(set.clone()) };
        // With one set nothing would be left to train on.
        let sets = if sets.len() > 1 { sets } else { &[] };
        seen.chain(sets.iter().map(left_out)).collect()
    }

    /// What the network sees, in words of a table.
    #[must_use]
    pub fn inputs(&self) -> String {
        let Without { contact, direction, time } = self.study.without;
        let kinds = [("contact", contact), ("direction", direction), ("time", time)];
        let absent: Vec<_> = kinds.iter().filter(|(_, absent)| *absent).map(|(name, _)| *name).collect();
        match (self.study.context, absent.as_slice()) {
            (Context::Short, []) => "all".to_owned(),
            (Context::Short, absent) => format!("without {}", absent.join(" ")),
            (Context::Second, _) => "all and 1 s".to_owned(),
            (Context::Letter, _) => "all and 1 s and the letter so far".to_owned(),
            (Context::Told, _) => "all and 1 s and the letter so far and which it is".to_owned(),
        }
    }

    /// The writings that it is trained on.
    #[must_use]
    pub fn of(&self, train: &[Writing]) -> Vec<Writing> {
        let in_set = |writing: &Writing, set: &str| {
            writing.writer.strip_prefix(set).is_some_and(|rest| rest.starts_with('/'))
        };
        let kept = |w: &&Writing| self.left_out.as_ref().is_none_or(|set| !in_set(w, set));
        train.iter().filter(kept).cloned().collect()
    }
}

/// Squared error over that of standing still at one lead, and the middle 95 % of bootstraps over writers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Judgement {
    /// Lead \[s\].
    pub lead_s: f64,
    /// Squared error over that of standing still.
    pub share: f64,
    pub low: f64,
    pub high: f64,
    pub writers: usize,
}

/// Trains as `plan` says; calls `watch` after each batch with the share of the training that is done.
///
/// # Errors
/// [`FitError`].
pub fn train(
    plan: &ForesightPlan,
    train: Vec<Writing>,
    threads: usize,
    mut watch: impl FnMut(f64) -> ControlFlow<()>,
) -> Result<Vec<f32>, FitError> {
    let epochs = plan.epochs.max(1) as f64;
    let mut fit = ForesightFit::new(plan.clone(), (train, Vec::new()), threads, None);
    while !fit.is_finished() {
        let before = fit.state().history.len() as f64;
        fit.epoch(|share| watch((before + share) / epochs))?;
    }
    Ok(fit.outcome().1.to_vec())
}

/// The errors of a network on `writings`, as recorded.
#[must_use]
pub fn judge(
    plan: &ForesightPlan,
    parameters: &[f32],
    writings: &[Writing],
    threads: usize,
) -> Vec<Judgement> {
    let step_s = plan.step_ns as f64 * 1e-9;
    let mut engine = GradientEngine::new(ForesightShape { inputs: plan.study.inputs() }, threads, plan.study);
    let mut writers: BTreeMap<&str, ErrorSums> = BTreeMap::new();
    for writing in writings {
        let examples = of_writing(writing, &Distortion::NONE, plan.step_ns, &plan.study);
        let tally = engine.tally(parameters, &examples, step_s);
        writers.entry(&writing.writer).or_insert_with(|| ErrorSums::new(step_s)).merge(&tally);
    }
    let tallies: Vec<ErrorSums> = writers.into_values().collect();
    let judgement = |(lead, lead_s): (usize, &f64)| {
        let share = |tallies: &mut dyn Iterator<Item = &ErrorSums>| {
            let sums = tallies.map(|tally| tally.sums()[lead]);
            let [error, still] = sums.fold([0.0; 2], |[a, b], [error, still]| [a + error, b + still]);
            if still > 0.0 { error / still } else { 0.0 }
        };
        let mut rng = Pcg64::seed_from_u64(lead as u64);
        let mut drawn: Vec<f64> = (0..BOOTSTRAPS)
            .map(|_| share(&mut (0..tallies.len()).map(|_| &tallies[rng.random_range(0..tallies.len())])))
            .collect();
        drawn.sort_by(f64::total_cmp);
        let at = |part: f64| drawn[((BOOTSTRAPS - 1) as f64 * part) as usize];
        let (low, high) = (at(0.025), at(0.975));
        Judgement { lead_s: *lead_s, share: share(&mut tallies.iter()), low, high, writers: tallies.len() }
    };
    if tallies.is_empty() { Vec::new() } else { LEADS_S.iter().enumerate().map(judgement).collect() }
}
