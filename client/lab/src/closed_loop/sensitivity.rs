//! What half and double of each number of the law do to the error, in every cell of the benchmark.

use foretrace_control::estimate::{LawParameters, Number};
use serde::Serialize;

use super::job::MethodTask;
use super::pareto::Tuning;
use super::{BenchArm, BenchError, Benchmark, Rival, SequenceScore};

/// One number at half or double its value, in front of one arm.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct NumberEffect {
    pub number: &'static str,
    pub value: f64,
    pub arm: &'static str,
    /// Mean squared error relative to that with the law's own value, over the same sequences \[1\].
    pub error_ratio: f64,
}

/// The values tried of a number: half and double of `value`, or what of it is in the range.
#[must_use]
pub fn half_and_double(number: &Number, value: f64) -> [f64; 2] {
    let [least, most] = number.range;
    [0.5 * value, 2.0 * value].map(|value| value.clamp(least, most))
}

impl Benchmark<'_> {
    /// How often [`Self::sensitivity`] reports, for so many numbers.
    #[must_use]
    pub fn sensitivity_jobs(&self, numbers: usize) -> usize {
        (1 + 2 * numbers) * self.arms.iter().map(|(_, hands)| hands.len()).sum::<usize>()
    }

    /// Writes everything with `law` in the law's own values and in half and double of each of `numbers`;
    /// calls `done` after each hand.
    ///
    /// # Errors
    /// The first sequence that could not be run.
    pub fn sensitivity(
        &self,
        law: Rival,
        numbers: &[Number],
        done: impl FnMut(),
    ) -> Result<Vec<NumberEffect>, BenchError> {
        let mut tried = vec![(None, self.law)];
        for number in numbers {
            for value in half_and_double(number, number.value) {
                tried.push((Some((number.name, value)), self.law.with(number, value)));
            }
        }
        let task = |arm: usize, parameters: &LawParameters| MethodTask {
            arm,
            rival: law,
            tuning: Tuning::Law(Box::new(*parameters)),
        };
        let tasks: Vec<_> = (0..self.arms.len())
            .flat_map(|arm| tried.iter().map(move |(_, parameters)| task(arm, parameters)))
            .collect();
        let scores = self.all(&tasks, done)?;
        let mut effects = Vec::new();
        for ((arm, _), scores) in self.arms.iter().zip(scores.chunks(tried.len().max(1))) {
            effects.extend(of_arm(*arm, &tried, scores));
        }
        Ok(effects)
    }
}

type Tried = (Option<(&'static str, f64)>, LawParameters);

fn of_arm(arm: BenchArm, tried: &[Tried], scores: &[Vec<Option<SequenceScore>>]) -> Vec<NumberEffect> {
    let error = |scores: &Vec<Option<SequenceScore>>| scores.iter().flatten().map(|s| s.mse_m2).sum::<f64>();
    let Some(own) = scores.first().map(error) else { return Vec::new() };
    let effect = |((changed, _), scores): (&Tried, &Vec<Option<SequenceScore>>)| {
        let (number, value) = (*changed)?;
        Some(NumberEffect { number, value, arm: arm.name(), error_ratio: error(scores) / own })
    };
    tried.iter().zip(scores).filter_map(effect).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn half_and_double_stay_in_the_range() {
        let of = |name: &str| *LawParameters::named(name).expect("known");
        assert_eq!(half_and_double(&of("prior_cases"), 40.0), [20.0, 80.0]);
        assert_eq!(half_and_double(&of("outcome_poor"), 0.6), [0.3, 1.0]);
    }
}
