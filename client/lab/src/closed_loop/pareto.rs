//! Error against jerk: every method swept over its own tuning.
//!
//! Contract: the baselines along [`baselines::sweep`](crate::baselines::sweep). The law on arms without
//! limits along one factor on its gains for position and velocity, feedback and feed-forward alike, which is
//! the same as dividing the price of jerk by the factor's square; with limits, where that changes little,
//! along `trust.ceiling` and then `mpc.feedback.velocity`. The point with the shipped settings is marked;
//! others that the law refuses, for example as unstable, are left out. Absent: tuning of predictors.

use foretrace_control::estimate::LawParameters;
use foretrace_control::follower::FollowerSettings;
use foretrace_control::mpc::MpcSettings;
use foretrace_control::trust::TrustRequest;
use foretrace_control::units::Trust;
use foretrace_sim::arm::JOINTS;
use serde::Serialize;

use super::baseline::baseline_settings;
use super::job::MethodTask;
use super::{BenchArm, BenchError, Benchmark, Rival, rows};
use crate::baselines::{BaselineSettings, sweep};

/// With limits: the ceiling of trust, and a factor on the damping of feedback, smooth to stiff.
const SOFTER: [(f64, f64); 9] = [
    (0.1, 8.0),
    (0.1, 4.0),
    (0.1, 2.0),
    (0.1, 1.4),
    (0.1, 1.0),
    (0.3, 1.0),
    (0.5, 1.0),
    (0.7, 1.0),
    (0.9, 1.0),
];
/// The same for feedback only (trust 0).
const HELD: [(f64, f64); 6] = [(0.0, 8.0), (0.0, 4.0), (0.0, 2.0), (0.0, 1.4), (0.0, 0.5), (0.0, 0.2)];
/// Without limits: factors on the law's gains, then with the gains towards the prediction up to that of the
/// benchmark.
const FREE_FACTORS: [f64; 6] = [0.01, 0.02, 0.05, 0.2, 0.6, 1.0];
const FREE_GAINS: [f64; 5] = [3.0, 10.0, 30.0, 100.0, 300.0];
/// Feedback alone has no gain towards a prediction.
const HOLD_FACTORS: [f64; 7] = [0.05, 0.2, 0.6, 1.0, 3.0, 10.0, 100.0];

/// The settings of a method in the sweep.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Tuning {
    Default,
    /// The law in the plan's own steps, its gains multiplied.
    Gains(f64),
    /// The law with at most this trust, the gain of feedback on velocity multiplied.
    Softer(f64, f64),
    /// The sharpest plan for an arm without limits, with this gain towards the prediction.
    Sharp(f64),
    /// The law with these numbers.
    Law(Box<LawParameters>),
    /// A baseline with these settings.
    Baseline(Box<BaselineSettings>),
}

/// A method with one tuning on one arm.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ParetoPoint {
    pub method: &'static str,
    /// How it was tuned.
    pub label: String,
    pub arm: &'static str,
    /// Root of the mean over sequences of the mean squared 2-D error, hover included, jumps left out \[m\].
    pub rms_m: f64,
    /// Root of the mean over sequences of the squared RMS jerk of the tool \[m/s³\].
    pub rms_jerk: f64,
    pub default: bool,
}

/// Multiplies what errors of position and velocity in the plane cost.
pub(super) fn scale_gains(mpc: &mut MpcSettings, factor: f64) {
    let both = mpc.gains_feedback.iter_mut().take(2).chain(mpc.gains_feedforward.iter_mut().take(2));
    for gains in both {
        gains.position *= factor;
        gains.velocity *= factor;
    }
}

/// Limits the trust to `ceiling`, and scales the damping of feedback by `damping`.
pub(super) fn soften(settings: &mut FollowerSettings<JOINTS>, ceiling: f64, damping: f64) {
    let least = |trust: Trust| Trust::new(trust.alpha().min(ceiling));
    settings.trust.auto_ceiling = least(settings.trust.auto_ceiling);
    if let TrustRequest::Manual(trust) = &mut settings.trust_request {
        *trust = least(*trust);
    }
    for gains in settings.mpc.gains_feedback.iter_mut().take(2) {
        gains.velocity *= damping;
    }
}

/// The points of a sweep, each with its label.
#[derive(Debug)]
pub struct ParetoSweep {
    points: Vec<(MethodTask, String)>,
    /// Those that are left out, each with the law's reason.
    pub refused: Vec<String>,
    /// How often [`Benchmark::pareto`] reports.
    pub jobs: usize,
}

impl Benchmark<'_> {
    /// Sweeps every method on every arm; calls `done` after each hand.
    ///
    /// # Errors
    /// The first sequence that could not be run.
    pub fn pareto(&self, sweep: ParetoSweep, done: impl FnMut()) -> Result<Vec<ParetoPoint>, BenchError> {
        let (tasks, labels): (Vec<_>, Vec<_>) = sweep.points.into_iter().unzip();
        let scores = self.all(&tasks, done)?;
        let scored = tasks.iter().zip(labels).zip(scores);
        let point = |((task, label), scores): ((&MethodTask, String), Vec<_>)| {
            let (arm, _) = self.arms.get(task.arm)?;
            let row = rows(task.rival, arm.name(), &scores, None)?;
            Some(ParetoPoint {
                method: task.rival.name(),
                label,
                arm: arm.name(),
                rms_m: row.mse_m2.sqrt(),
                rms_jerk: row.rms_jerk,
                default: task.tuning == Tuning::Default,
            })
        };
        Ok(scored.filter_map(point).collect())
    }

    /// What is to be swept. The shipped settings are never left out: [`Self::pareto`] fails if they are
    /// refused.
    #[must_use]
    pub fn pareto_sweep(&self) -> ParetoSweep {
        let mut sweep = ParetoSweep { points: Vec::new(), refused: Vec::new(), jobs: 0 };
        for (task, label) in self.swept() {
            let Some((arm, hands)) = self.arms.get(task.arm) else { continue };
            match (task.tuning != Tuning::Default).then(|| self.refusal(&task)).flatten() {
                Some(error) => {
                    let point = format!("{} on {}, {label}", task.rival.name(), arm.name());
                    sweep.refused.push(format!("{point}: {error}"));
                }
                None => {
                    sweep.jobs += hands.len();
                    sweep.points.push((task, label));
                }
            }
        }
        sweep
    }

    fn swept(&self) -> Vec<(MethodTask, String)> {
        let mut points = Vec::new();
        for (index, (arm, _)) in self.arms.iter().enumerate() {
            for rival in &self.rivals {
                let tuned = self.tunings(*arm, *rival).into_iter();
                points.extend(
                    tuned.map(|(tuning, label)| (MethodTask { arm: index, rival: *rival, tuning }, label)),
                );
            }
        }
        points
    }

    fn tunings(&self, arm: BenchArm, rival: Rival) -> Vec<(Tuning, String)> {
        let (Rival::Baseline(kind) | Rival::Legal(kind)) = rival else {
            let shipped = (Tuning::Default, "default".to_owned());
            let gains = |factor: f64| (Tuning::Gains(factor), format!("gains x {factor}"));
            if arm.limited() {
                let soften = |(ceiling, damping)| {
                    (Tuning::Softer(ceiling, damping), format!("trust to {ceiling}, damping x {damping}"))
                };
                let (trusted, held) = (SOFTER.as_slice(), HELD.as_slice());
                let softer = if rival == Rival::HOLD { held } else { trusted };
                return softer.iter().copied().map(soften).chain([shipped, gains(2.0)]).collect();
            }
            if rival == Rival::HOLD {
                return HOLD_FACTORS.map(gains).into_iter().chain([shipped]).collect();
            }
            let sharp = FREE_GAINS.map(|gain| (Tuning::Sharp(gain), format!("sharp, gain {gain}")));
            return FREE_FACTORS.map(gains).into_iter().chain(sharp).chain([shipped]).collect();
        };
        let shipped = baseline_settings(self.config, arm, kind);
        sweep(kind, &shipped)
            .into_iter()
            // The slow arm's servo is fixed: those points would all be the same.
            .filter(|(_, settings)| arm != BenchArm::Slow || settings.servo == shipped.servo)
            .map(|(label, settings)| {
                let tuning =
                    if settings == shipped { Tuning::Default } else { Tuning::Baseline(Box::new(settings)) };
                (tuning, label)
            })
            .collect()
    }
}
