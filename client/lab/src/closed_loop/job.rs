//! Runs methods on arms, over all hands, on all cores.

use foretrace_config::Config;

use super::arm::FREE_GAIN;
use super::baseline::{BaselineDesk, baseline_settings};
use super::pareto::{Tuning, scale_gains, soften};
use super::{BenchArm, BenchRow, Each, Flaws, Hand, Rival, SequenceScore, rows};
use crate::experiments::{
    ClosedLoop, Desk, DeskOptions, OtherPredictor, RunError, StepPredictor, WAIT_S, desk, learner_for,
    settings_for,
};
use crate::parallel;
use crate::process::{PATIENCE, command_of};
use foretrace_control::estimate::LawParameters;
use foretrace_control::predict::PredictorKind;
use foretrace_control::trust::TrustRequest;

/// A benchmark that could not be run.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BenchError {
    /// A sequence.
    #[error("{file}, writer {writer:?}, sequence {index} ({label:?}), {rival} on {arm}: {error}")]
    Run {
        file: String,
        writer: String,
        /// Index among what they wrote in it, from 0.
        index: usize,
        label: String,
        rival: &'static str,
        arm: &'static str,
        error: Box<RunError>,
    },
    /// The settings.
    #[error("{0}")]
    Settings(String),
}

#[derive(Debug)]
pub struct Benchmark<'a> {
    pub config: &'a Config,
    /// The arms, each with its hands.
    pub arms: Vec<(BenchArm, Vec<Hand>)>,
    pub rivals: Vec<Rival>,
    pub flaws: Flaws,
    /// Numbers of the law.
    pub law: LawParameters,
}

/// One method on one arm.
#[derive(Debug, Clone)]
pub struct MethodOutcome {
    pub rival: Rival,
    pub arm: BenchArm,
    /// Per sequence, hand after hand.
    pub scores: Vec<Option<SequenceScore>>,
}

/// One method with its tuning on the arm with this index, over all its hands.
#[derive(Debug)]
pub(super) struct MethodTask {
    pub(super) arm: usize,
    pub(super) rival: Rival,
    pub(super) tuning: Tuning,
}

/// A hand without what it wrote.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct HandNames {
    pub file: String,
    pub writer: String,
    /// Of its sequences in order.
    pub labels: Vec<String>,
}

pub(super) struct Job<'a> {
    pub(super) rival: Rival,
    pub(super) tuning: &'a Tuning,
    pub(super) arm: BenchArm,
    pub(super) hand: &'a Hand,
}

impl Benchmark<'_> {
    /// How often `run` reports.
    #[must_use]
    pub fn jobs(&self) -> usize {
        self.arms.iter().map(|(_, hands)| hands.len()).sum::<usize>() * self.rivals.len()
    }

    /// Writes everything; calls `done` after each hand.
    ///
    /// # Errors
    /// The first sequence that could not be run.
    pub fn run(&self, done: impl FnMut()) -> Result<Vec<MethodOutcome>, BenchError> {
        let pairs = (0..self.arms.len()).flat_map(|arm| self.rivals.iter().map(move |who| (arm, *who)));
        let tasks: Vec<_> =
            pairs.map(|(arm, rival)| MethodTask { arm, rival, tuning: Tuning::Default }).collect();
        let scores = self.all(&tasks, done)?;
        let outcomes = tasks.iter().zip(scores).filter_map(|(task, scores)| {
            let (arm, _) = self.arms.get(task.arm)?;
            Some(MethodOutcome { rival: task.rival, arm: *arm, scores })
        });
        Ok(outcomes.collect())
    }

    /// The scores of each task, hand after hand; calls `done` after each hand.
    pub(super) fn all(
        &self,
        tasks: &[MethodTask],
        done: impl FnMut(),
    ) -> Result<Vec<Vec<Option<SequenceScore>>>, BenchError> {
        let arm_of = |task: &MethodTask| self.arms.get(task.arm);
        let jobs: Vec<_> = tasks
            .iter()
            .filter_map(|task| Some((task, arm_of(task)?)))
            .flat_map(|(task, (arm, hands))| {
                let job = move |hand| Job { rival: task.rival, tuning: &task.tuning, arm: *arm, hand };
                hands.iter().map(job)
            })
            .collect();
        let mut finished = parallel::map(&jobs, |job| self.hand(job), done).into_iter();
        tasks
            .iter()
            .map(|task| {
                let mut scores = Vec::new();
                let hands = arm_of(task).map_or(0, |(_, hands)| hands.len());
                for result in finished.by_ref().take(hands) {
                    scores.extend(result?);
                }
                Ok(scores)
            })
            .collect()
    }

    /// Writes one sequence again after everything that its hand wrote before, so that learners have the same
    /// state; `None`: there is no such one.
    ///
    /// # Errors
    /// A sequence that could not be run.
    pub fn replay(
        &self,
        rival: Rival,
        arm: BenchArm,
        hand: &Hand,
        index: usize,
    ) -> Result<Option<ClosedLoop>, BenchError> {
        Ok(self.replay_all(arm, &[(rival, hand, index)])?.pop().flatten())
    }

    /// Writes sequences again on `arm`, as [`replay`](Self::replay) does; every hand once per method, on all
    /// cores. In the order asked.
    ///
    /// # Errors
    /// A sequence that could not be run.
    pub fn replay_all(
        &self,
        arm: BenchArm,
        wanted: &[(Rival, &Hand, usize)],
    ) -> Result<Vec<Option<ClosedLoop>>, BenchError> {
        let same = |a: &(Rival, &Hand), b: &(Rival, &Hand)| a.0 == b.0 && std::ptr::eq(a.1, b.1);
        let mut pairs: Vec<(Rival, &Hand)> = Vec::new();
        for (rival, hand, _) in wanted {
            let pair = (*rival, *hand);
            if !pairs.iter().any(|known| same(known, &pair)) {
                pairs.push(pair);
            }
        }
        let run = |pair: &(Rival, &Hand)| {
            let mine =
                || wanted.iter().enumerate().filter(|(_, (rival, hand, _))| same(pair, &(*rival, hand)));
            let count = mine().map(|(_, (.., index))| index.saturating_add(1)).max().unwrap_or(0);
            let job = Job { rival: pair.0, tuning: &Tuning::Default, arm, hand: pair.1 };
            let (mut kept, mut next) = (Vec::new(), 0);
            self.write(&job, count, |_, run| {
                kept.extend(
                    mine().filter(|(_, (.., index))| *index == next).map(|(slot, _)| (slot, run.clone())),
                );
                next += 1;
            })?;
            Ok(kept)
        };
        let mut replayed = vec![None; wanted.len()];
        for kept in parallel::map(&pairs, run, || {}) {
            for (slot, run) in kept? {
                if let Some(place) = replayed.get_mut(slot) {
                    *place = Some(run);
                }
            }
        }
        Ok(replayed)
    }

    /// The hands of each arm by name.
    #[must_use]
    pub fn names(&self) -> Vec<(BenchArm, Vec<HandNames>)> {
        let named = |hand: &Hand| HandNames {
            file: hand.file.clone(),
            writer: hand.writer.clone(),
            labels: hand.sequences.iter().map(|sequence| sequence.label.clone()).collect(),
        };
        self.arms.iter().map(|(arm, hands)| (*arm, hands.iter().map(named).collect())).collect()
    }

    /// Why the law refuses the settings of `task`, if it does. Starts no program.
    pub(super) fn refusal(&self, task: &MethodTask) -> Option<BenchError> {
        let (arm, hands) = self.arms.get(task.arm)?;
        let job = Job { rival: task.rival, tuning: &task.tuning, arm: *arm, hand: hands.first()? };
        self.desk_with(&job, |_| Ok(None)).err()
    }

    fn hand(&self, job: &Job<'_>) -> Result<Vec<Option<SequenceScore>>, BenchError> {
        let mut scores = Vec::with_capacity(job.hand.sequences.len());
        self.write(job, usize::MAX, |sequence, run| scores.push(SequenceScore::of(sequence, &run)))?;
        Ok(scores)
    }

    fn write(
        &self,
        job: &Job<'_>,
        count: usize,
        mut take: impl FnMut(&super::Sequence, ClosedLoop),
    ) -> Result<(), BenchError> {
        let mut desk = self.desk(job)?;
        desk.delay_pen(self.flaws.pen_age_ns);
        for (index, sequence) in job.hand.sequences.iter().enumerate().take(count) {
            let run = desk.write(&sequence.path.samples, WAIT_S, &[]).map_err(|error| BenchError::Run {
                file: job.hand.file.clone(),
                writer: job.hand.writer.clone(),
                index,
                label: sequence.label.clone(),
                rival: job.rival.name(),
                arm: job.arm.name(),
                error: Box::new(error),
            })?;
            take(sequence, run);
        }
        Ok(())
    }

    fn desk(&self, job: &Job<'_>) -> Result<Box<dyn Desk>, BenchError> {
        self.desk_with(job, |step_ns| self.process(job, step_ns))
    }

    /// With the other program that `process` starts for steps of so many nanoseconds.
    pub(super) fn desk_with(
        &self,
        job: &Job<'_>,
        process: impl FnOnce(u64) -> Result<Option<Box<dyn StepPredictor>>, BenchError>,
    ) -> Result<Box<dyn Desk>, BenchError> {
        let wrong = |error: &dyn std::fmt::Display| BenchError::Settings(error.to_string());
        let arm = self.flaws.of(job.arm.kind(self.config));
        let facts = arm.facts();
        let (kind, trust) = match job.rival {
            Rival::Law(law) => (law.predictor(), law.trust()),
            Rival::External(_) => (PredictorKind::EXTERNAL, TrustRequest::Auto),
            Rival::Baseline(kind) | Rival::Legal(kind) => {
                let law = settings_for(self.config, &facts, PredictorKind::HOLD);
                let settings = match job.tuning {
                    Tuning::Baseline(settings) => **settings,
                    _ => baseline_settings(self.config, job.arm, kind),
                };
                let desk = BaselineDesk::new(self.config, &law, job.arm, kind, &settings, &self.flaws);
                let desk = desk.map_err(|error| wrong(&error))?;
                let legal = matches!(job.rival, Rival::Legal(_));
                return Ok(Box::new(if legal { desk.kept_legal() } else { desk }));
            }
        };
        let mut settings = settings_for(self.config, &facts, kind);
        settings.trust_request = trust;
        settings.law = self.law;
        job.arm.fit(self.config, &mut settings);
        match *job.tuning {
            Tuning::Gains(factor) => scale_gains(&mut settings.mpc, factor),
            Tuning::Softer(ceiling, damping) => soften(&mut settings, ceiling, damping),
            Tuning::Sharp(gain) => job.arm.sharpen(&mut settings, gain),
            Tuning::Law(ref law) => {
                settings.law = **law;
                job.arm.sharpen(&mut settings, FREE_GAIN);
            }
            Tuning::Default | Tuning::Baseline(_) => job.arm.sharpen(&mut settings, FREE_GAIN),
        }
        let horizon = self.config.settings().mpc.horizon;
        // The one that stands in learns beside the other program.
        let learns = if kind == PredictorKind::EXTERNAL { settings.preview.fallback } else { kind };
        let learner = learner_for(self.config, &settings, learns).map_err(|error| wrong(&error))?;
        let process = process(settings.pen.step_ns)?;
        let arm = arm.built(self.config.robot().home);
        let options = DeskOptions { arm, oracle: kind == PredictorKind::ORACLE, learner, process };
        Ok(desk(horizon, &settings, options).map_err(|error| wrong(&error))?)
    }

    /// The predictor in another program, one for each hand.
    fn process(&self, job: &Job<'_>, step_ns: u64) -> Result<Option<Box<dyn StepPredictor>>, BenchError> {
        let Some(command) = command_of(job.rival.name()) else { return Ok(None) };
        let Hand { file, writer, .. } = job.hand;
        let hand = if writer.is_empty() { file.clone() } else { format!("{file}, {writer}") };
        let started = OtherPredictor::start(command, step_ns, hand.clone(), PATIENCE);
        let wrong = |error| BenchError::Settings(format!("{hand}, {}: {error}", job.rival.name()));
        Ok(Some(Box::new(started.map_err(wrong)?)))
    }
}

impl MethodOutcome {
    /// Every score of `outcomes` with the sequence of `arms` that it belongs to.
    pub fn each<'a>(
        arms: &'a [(BenchArm, Vec<HandNames>)],
        outcomes: &'a [Self],
    ) -> impl Iterator<Item = Each<'a>> {
        let of = |outcome: &'a Self| {
            let hands = arms.iter().find(|(arm, _)| *arm == outcome.arm).map(|(_, hands)| hands);
            let sequences = hands.into_iter().flatten().flat_map(|hand| {
                hand.labels.iter().enumerate().map(move |(index, label)| (hand, index, label))
            });
            sequences.zip(&outcome.scores).filter_map(|((hand, index, label), score)| {
                let (predictor, arm) = (outcome.rival.name(), outcome.arm.name());
                let (file, writer) = (&hand.file, &hand.writer);
                (*score).map(|score| Each { predictor, arm, file, writer, index, label, score })
            })
        };
        outcomes.iter().flat_map(of)
    }

    /// The table: one row per outcome with anything scored, compared with `hold` in front of the same arm.
    #[must_use]
    pub fn table(outcomes: &[Self]) -> Vec<BenchRow> {
        let hold = |arm| outcomes.iter().find(|o| o.rival == Rival::HOLD && o.arm == arm);
        outcomes
            .iter()
            .filter_map(|o| {
                rows(o.rival, o.arm.name(), &o.scores, hold(o.arm).map(|hold| hold.scores.as_slice()))
            })
            .collect()
    }
}
