//! Parts of the bench, each of which can be timed in a process of its own.

use std::fmt;
use std::str::FromStr;

/// A part: the rows that are timed together.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BenchPart {
    /// Planning, without and with active limits.
    Plan,
    Ik,
    Predict,
    Step,
    /// The whole step with each predictor, and the learner's.
    StepByPredictor,
    Lag,
    Evidence,
    Predictors,
}

impl BenchPart {
    /// In the order in which they are timed.
    pub const ALL: [Self; 8] = [
        Self::Plan,
        Self::Ik,
        Self::Predict,
        Self::Step,
        Self::StepByPredictor,
        Self::Lag,
        Self::Evidence,
        Self::Predictors,
    ];

    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Plan => "plan",
            Self::Ik => "ik",
            Self::Predict => "predict",
            Self::Step => "step",
            Self::StepByPredictor => "step-by-predictor",
            Self::Lag => "lag",
            Self::Evidence => "evidence",
            Self::Predictors => "predictors",
        }
    }
}

impl fmt::Display for BenchPart {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for BenchPart {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let found = Self::ALL.into_iter().find(|part| part.name() == text);
        found.ok_or_else(|| format!("parts are {}", Self::ALL.map(Self::name).join(", ")))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_is_its_part_and_others_are_refused_with_the_names_there_are() {
        for part in BenchPart::ALL {
            assert_eq!(part.to_string().parse(), Ok(part));
        }
        assert!("Plan".parse::<BenchPart>().unwrap_err().contains("step-by-predictor"));
    }
}
