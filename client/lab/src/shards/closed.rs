//! Shards of the closed-loop benchmark: scores of whole hands, which start with a learner of their own.

use std::collections::BTreeSet;
use std::path::PathBuf;

use foretrace_config::Config;
use serde::{Deserialize, Serialize};

use super::exact::{Digest, Exact};
use super::file::{MergeError, merged};
use super::{Shard, few};
use crate::closed_loop::{BenchArm, HandNames, HandsOfArms, MethodOutcome, Rival, SequenceScore};

/// What is the same in all shards of a run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ClosedLoopRun {
    /// Title of what is written.
    pub set: String,
    /// As `--lifts` has it.
    pub lifts: String,
    /// The result lists every sequence.
    pub each: bool,
    /// Arms by name, in the order of the table.
    pub arms: Vec<String>,
    /// How many hands each of them has.
    pub hands: Vec<usize>,
    /// Methods by name, in the order of the table.
    pub predictors: Vec<String>,
    /// What is not ideal, and the numbers of the law.
    pub options: String,
    /// The settings in force, without where they lie.
    pub settings: String,
    /// Of the robot, the networks and the start of refinement that they name.
    pub files: String,
    /// Of everything that is written.
    pub data: String,
}

/// What one shard found.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ClosedLoopPart {
    arms: Vec<ArmPart>,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct ArmPart {
    hands: Vec<HandPart>,
    /// One per method, in their order.
    methods: Vec<MethodPart>,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct HandPart {
    /// Place among the hands of this arm in the run that is not cut, from 0.
    place: usize,
    file: String,
    writer: String,
    /// Labels of its sequences.
    labels: Vec<String>,
}

/// Scores over the sequences of all hands of this shard, hand after hand.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct MethodPart {
    /// Whether a sequence could be scored.
    scored: Vec<bool>,
    /// For each that could, the nine numbers of [`SequenceScore`] in its order.
    scores: Exact,
}

/// The result of all shards.
#[derive(Debug)]
pub struct MergedLoop {
    pub run: ClosedLoopRun,
    pub arms: Vec<(BenchArm, Vec<HandNames>)>,
    pub outcomes: Vec<MethodOutcome>,
}

/// Of everything that the arms write.
#[must_use]
pub fn digest(arms: &HandsOfArms) -> String {
    let mut digest = Digest::default();
    for (arm, hands) in arms {
        digest.text(arm.name());
        for hand in hands {
            digest.text(&hand.file);
            digest.text(&hand.writer);
            for sequence in &hand.sequences {
                digest.text(&sequence.label);
                let samples = sequence.path.samples.iter().zip(&sequence.behind_leap);
                digest.numbers(samples.flat_map(|(s, leap)| {
                    [s.t_s, s.x_m, s.y_m, f64::from(u8::from(s.contact)), f64::from(u8::from(*leap))]
                }));
            }
        }
    }
    digest.finish()
}

/// Of what the files hold that the settings name.
#[must_use]
pub fn files_digest(config: &Config) -> String {
    Digest::of(&(config.robot(), config.models(), config.prior()))
}

/// The hands of `shard`, each with its place, and how many of how many hands there are.
#[must_use]
pub fn own_hands(arms: HandsOfArms, shard: Shard) -> (HandsOfArms, Vec<Vec<usize>>) {
    let keys = arms.iter().flat_map(|(_, hands)| hands).map(|hand| (hand.file.clone(), hand.writer.clone()));
    let mut owned = shard.owned(&keys.collect::<Vec<_>>()).into_iter();
    let of_arm = |(arm, hands): (BenchArm, Vec<_>)| {
        let count = hands.len();
        let numbered = hands.into_iter().enumerate().zip(owned.by_ref().take(count));
        let (places, own): (Vec<_>, Vec<_>) = numbered.filter(|(_, own)| *own).map(|(one, _)| one).unzip();
        ((arm, own), places)
    };
    arms.into_iter().map(of_arm).unzip()
}

/// What a shard writes: its hands, their places, and the outcomes of its benchmark.
#[must_use]
pub fn closed_loop_part(
    names: &[(BenchArm, Vec<HandNames>)],
    places: &[Vec<usize>],
    outcomes: &[MethodOutcome],
) -> ClosedLoopPart {
    let mut of_arms = outcomes.chunks((outcomes.len() / names.len().max(1)).max(1));
    let of_arm = |((_, hands), places): (&(BenchArm, Vec<HandNames>), &Vec<usize>)| {
        let hand = |(hand, place): (&HandNames, &usize)| HandPart {
            place: *place,
            file: hand.file.clone(),
            writer: hand.writer.clone(),
            labels: hand.labels.clone(),
        };
        let methods = of_arms.next().unwrap_or_default().iter().map(|outcome| MethodPart {
            scored: outcome.scores.iter().map(Option::is_some).collect(),
            scores: Exact(outcome.scores.iter().flatten().flat_map(numbers).collect()),
        });
        ArmPart { hands: hands.iter().zip(places).map(hand).collect(), methods: methods.collect() }
    };
    ClosedLoopPart { arms: names.iter().zip(places).map(of_arm).collect() }
}

fn numbers(score: &SequenceScore) -> [f64; 9] {
    let counts = [score.limited, score.illegal, score.ticks].map(f64::from);
    [
        score.mse_m2,
        score.pen_down_mse_m2,
        score.leap_mse_m2,
        score.max_m,
        score.lag_ms,
        score.rms_jerk,
        counts[0],
        counts[1],
        counts[2],
    ]
}

fn score(numbers: &[f64; 9]) -> Option<SequenceScore> {
    let [mse_m2, pen_down_mse_m2, leap_mse_m2, max_m, lag_ms, rms_jerk, counts @ ..] = *numbers;
    let count = |number: f64| {
        ((0.0..=f64::from(u32::MAX)).contains(&number) && number.fract() == 0.0).then_some(number as u32)
    };
    let [limited, illegal, ticks] = counts;
    let (limited, illegal, ticks) = (count(limited)?, count(illegal)?, count(ticks)?);
    Some(SequenceScore {
        mse_m2,
        pen_down_mse_m2,
        leap_mse_m2,
        max_m,
        lag_ms,
        rms_jerk,
        limited,
        illegal,
        ticks,
    })
}

/// A hand with its scores, a list for each method.
type ScoredHand = (HandNames, Vec<Vec<Option<SequenceScore>>>);

impl MergedLoop {
    /// The result of all shards in `files`.
    ///
    /// # Errors
    /// [`MergeError`]: a file that does not fit.
    pub fn of(files: &[PathBuf]) -> Result<Self, MergeError> {
        let (run, parts) = merged::<ClosedLoopRun, ClosedLoopPart>(files)?;
        let bad = |file: &PathBuf, why: String| MergeError::Part { file: file.clone(), why };
        let first = files.first().cloned().unwrap_or_default();
        let arm = |name: &String| BenchArm::ALL.into_iter().find(|arm| arm.name() == name);
        let arms: Vec<BenchArm> = run
            .arms
            .iter()
            .map(|name| arm(name).ok_or_else(|| bad(&first, format!("no arm is called {name:?}"))))
            .collect::<Result<_, _>>()?;
        few(&run.predictors).map_err(|why| bad(&first, why))?;
        let mut known = BTreeSet::new();
        if let Some(twice) = run.predictors.iter().find(|name| !known.insert(name.as_str())) {
            let short: String = twice.chars().take(60).collect();
            return Err(bad(&first, format!("method {short:?} is named twice")));
        }
        let rivals: Vec<Rival> = run
            .predictors
            .iter()
            .map(|name| Rival::named(name).map_err(|error| bad(&first, error.to_string())))
            .collect::<Result<_, _>>()?;
        if run.hands.len() != arms.len() {
            return Err(bad(&first, format!("{} arms, but hands of {}", arms.len(), run.hands.len())));
        }
        let mut hands: Vec<Vec<(usize, ScoredHand)>> = arms.iter().map(|_| Vec::new()).collect();
        for (file, part) in parts {
            if part.arms.len() != arms.len() {
                let why = format!("it has {} arms, the run {}", part.arms.len(), arms.len());
                return Err(bad(&file, why));
            }
            for (arm, hands) in part.arms.into_iter().zip(&mut hands) {
                hands.extend(arm.hands(rivals.len()).map_err(|why| bad(&file, why))?);
            }
        }
        let (mut names, mut outcomes) = (Vec::new(), Vec::new());
        for ((arm, mut hands), count) in arms.into_iter().zip(hands).zip(&run.hands) {
            hands.sort_by_key(|(place, _)| *place);
            if !hands.iter().map(|(place, _)| *place).eq(0..*count) {
                let why =
                    format!("the {} hands on {} are not the {count} of the run", hands.len(), arm.name());
                return Err(bad(&first, why));
            }
            let mut scores: Vec<Vec<Option<SequenceScore>>> = rivals.iter().map(|_| Vec::new()).collect();
            let mut of_arm = Vec::with_capacity(*count);
            for (_, (hand, of_hand)) in hands {
                of_arm.push(hand);
                scores.iter_mut().zip(of_hand).for_each(|(all, mut more)| all.append(&mut more));
            }
            names.push((arm, of_arm));
            let of_method = |(rival, scores)| MethodOutcome { rival, arm, scores };
            outcomes.extend(rivals.iter().copied().zip(scores).map(of_method));
        }
        Ok(Self { run, arms: names, outcomes })
    }
}

impl ArmPart {
    /// Its hands, each with its place and its scores by each of so many methods.
    fn hands(self, methods: usize) -> Result<Vec<(usize, ScoredHand)>, String> {
        let Self { hands, methods: parts } = self;
        if parts.len() != methods {
            return Err(format!("scores of {} methods, the run has {methods}", parts.len()));
        }
        let mut lists = parts.into_iter().map(MethodPart::scores).collect::<Result<Vec<_>, _>>()?;
        let sequences: usize = hands.iter().map(|hand| hand.labels.len()).sum();
        if let Some(list) = lists.iter().find(|list| list.len() != sequences) {
            return Err(format!("{} scores for {sequences} sequences", list.len()));
        }
        let mut scored = Vec::with_capacity(hands.len());
        // From behind, so that every hand takes the end of each list.
        for HandPart { place, file, writer, labels } in hands.into_iter().rev() {
            let count = labels.len();
            let own = lists.iter_mut().map(|list| list.split_off(list.len().saturating_sub(count))).collect();
            scored.push((place, (HandNames { file, writer, labels }, own)));
        }
        Ok(scored)
    }
}

impl MethodPart {
    fn scores(self) -> Result<Vec<Option<SequenceScore>>, String> {
        let (rows, rest) = self.scores.0.as_chunks::<9>();
        let scored = self.scored.iter().filter(|scored| **scored).count();
        if !rest.is_empty() || rows.len() != scored {
            return Err(format!("{} numbers for {scored} scores of nine", self.scores.0.len()));
        }
        let mut rows = rows.iter();
        self.scored
            .iter()
            .map(|scored| match scored {
                false => Ok(None),
                true => {
                    let score = rows.next().and_then(score);
                    score.map(Some).ok_or_else(|| "a count of ticks is none".to_owned())
                }
            })
            .collect()
    }
}
