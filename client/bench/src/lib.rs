//! What the parts of a tick cost on this machine: the exact path beside Clarabel, every predictor, the
//! learner.
//!
//! Contract: every backend is timed once per instance, in rotating order, so that all see the same machine
//! and about the same caches. The clock's own cost is reported, not subtracted. Percentiles are over
//! instances.

#![forbid(unsafe_code)]

pub mod against;
mod part;
mod dice;
mod table;
mod workload;
mod evidence;
mod lag;
mod predictors;
mod online;
mod stepping;

use std::hint::black_box;
use std::time::Instant;

use foretrace_clarabel::ClarabelProfile;
use foretrace_config::Config;
use foretrace_control::ik::Ik;
use foretrace_control::mpc::{Mpc, MpcSettings, Plan};
use foretrace_control::pen::PenTracker;
use foretrace_control::predict::Previewer;
use foretrace_control::qp::backend::Backend;
use foretrace_control::units::Trust;
use foretrace_failure::Failure;
use foretrace_sim::path::PenPath;
use serde::Serialize;

use dice::BenchDice;
pub use evidence::EvidenceCost;
pub use lag::LagCost;
pub use part::BenchPart;
pub use predictors::PredictorCost;
pub use stepping::PredictorSteps;
use workload::{J, Workload};

/// Settings of the loop that is timed, whatever else they say.
pub const FIXED: [(&str, &str); 3] =
    [("predictor.kind", "dybm"), ("trust.mode", "manual"), ("trust.value", "1.0")];

/// The three ways to solve, in the order of the table.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Solver {
    Exact,
    Clarabel,
    Tuned,
}

const SOLVERS: [Solver; 3] = [Solver::Exact, Solver::Clarabel, Solver::Tuned];

impl Solver {
    const fn backend(self) -> Backend {
        match self {
            Self::Exact => Backend::Exact,
            Self::Clarabel => Backend::Other(&ClarabelProfile::Default),
            Self::Tuned => Backend::Other(&ClarabelProfile::Tuned),
        }
    }
}

/// Two percentiles \[µs\].
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct CostQuantiles {
    pub p50: f64,
    pub p99: f64,
}

/// One row of the table.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct CostRow {
    pub exact: CostQuantiles,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub clarabel: Option<CostQuantiles>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub clarabel_tuned: Option<CostQuantiles>,
}

/// The result; keys are stable. What was not asked for is not there.
#[derive(Debug, Serialize)]
pub struct BenchReport {
    /// Steps of the plan, as in the settings.
    pub horizon: usize,
    #[serde(flatten)]
    pub costs: BenchCosts,
    pub clock_us: f64,
    pub samples: u32,
    pub optimised_build: bool,
}

/// Rows of the table, those of the parts that were timed \[µs\].
#[derive(Debug, Default, Serialize)]
pub struct BenchCosts {
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mpc_free_us: Option<CostRow>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mpc_active_us: Option<CostRow>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub ik_us: Option<CostRow>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub predict_us: Option<CostRow>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub step_us: Option<CostRow>,
    /// The whole step with each predictor, weights coming in as in the daemon.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub step_by_predictor_us: Option<Vec<stepping::PredictorSteps>>,
    /// One grid step of the learner: all models, their comparisons, all bands.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub learn_us: Option<CostQuantiles>,
    /// The lag estimator's part of a tick.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub lag_us: Option<lag::LagCost>,
    /// Trust evidence: scoring previews, and correcting the newest.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub evidence_us: Option<evidence::EvidenceCost>,
    /// One observation and one preview each.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub predictors_us: Option<Vec<predictors::PredictorCost>>,
}

/// Runs a loop of `config`, which has [`FIXED`], on `path`, and times `samples` instances of every problem of
/// `parts` that occurred in it.
///
/// # Errors
///
/// Settings that the loop refuses, a path on which the arm never follows, or without a problem of each kind.
pub fn measure(
    config: &Config,
    path: &PenPath,
    samples: u32,
    parts: &[BenchPart],
) -> Result<BenchReport, Failure> {
    match config.settings().mpc.horizon {
        10 => measured::<10>(config, path, samples, parts),
        20 => measured::<20>(config, path, samples, parts),
        _ => measured::<30>(config, path, samples, parts),
    }
}

/// Everything under the clock, with plans of N steps.
fn measured<const N: usize>(
    config: &Config,
    path: &PenPath,
    samples: u32,
    parts: &[BenchPart],
) -> Result<BenchReport, Failure> {
    let seconds = (f64::from(samples) * 0.02).clamp(20.0, 600.0);
    let workload = workload::record::<N>(config, path, seconds)?;
    let mut costs = BenchCosts::default();
    for part in parts {
        match part {
            BenchPart::Plan => {
                costs.mpc_free_us = Some(planning(config, &workload, 0..=0, samples)?);
                costs.mpc_active_us = Some(planning(config, &workload, 3..=8, samples)?);
            }
            BenchPart::Ik => costs.ik_us = Some(reaching(config, &workload, samples)?),
            BenchPart::Predict => costs.predict_us = Some(predicting(config, &workload, samples)?),
            BenchPart::Step => costs.step_us = Some(stepping::stepping(config, &workload, samples)?),
            BenchPart::StepByPredictor => {
                let (steps, learn) = stepping::by_predictor(config, &workload, samples)?;
                (costs.step_by_predictor_us, costs.learn_us) = (Some(steps), Some(learn));
            }
            BenchPart::Lag => costs.lag_us = Some(lag::lag(&workload, samples)),
            BenchPart::Evidence => costs.evidence_us = Some(evidence::evidence(config, &workload, samples)?),
            BenchPart::Predictors => {
                costs.predictors_us = Some(predictors::predictors(config, &workload, samples)?);
            }
        }
    }
    let (clock_us, optimised_build) = (clock_cost(), !cfg!(debug_assertions));
    Ok(BenchReport { horizon: N, costs, clock_us, samples, optimised_build })
}

/// Planning problems whose exact solution has this many active limits (`active`).
fn planning<const N: usize>(
    config: &Config,
    workload: &Workload<N>,
    active: std::ops::RangeInclusive<u32>,
    samples: u32,
) -> Result<CostRow, Failure> {
    let settings = config.follower_settings().mpc;
    let mut planners = Vec::new();
    for solver in SOLVERS {
        let built = Mpc::<N>::new(&MpcSettings { backend: solver.backend(), ..settings });
        planners.push(built.map_err(|error| Failure::bad_input(error, ""))?);
    }
    let mut plan = Plan::resting(settings.step_s);
    let mut solve = |planner: &mut Mpc<N>, problem: &workload::Planning<N>| {
        planner.plan(&problem.start, &problem.held, &problem.preview, Trust::FULL, u32::MAX, &mut plan)
    };
    let mut chosen = Vec::new();
    for problem in &workload.plannings {
        let report = solve(&mut planners[0], problem);
        if report.usable() && active.contains(&report.active()) {
            chosen.push(problem);
        }
    }
    if chosen.is_empty() {
        let what = format!("no planning problem with {} to {} active limits", active.start(), active.end());
        return Err(Failure::bad_input(what, "choose a livelier --pen"));
    }
    Ok(interleaved(&chosen, samples, |solver, problem| {
        let planner = &mut planners[solver as usize];
        // In a tick the problem was written a moment ago: fetching it from the recording is not part of the
        // cost.
        let problem = black_box(**problem);
        let begin = Instant::now();
        black_box(solve(planner, black_box(&problem)));
        elapsed_us(begin)
    }))
}

/// Forward kinematics and one IK step.
fn reaching<const N: usize>(
    config: &Config,
    workload: &Workload<N>,
    samples: u32,
) -> Result<CostRow, Failure> {
    let settings = config.follower_settings();
    let period_s = settings.period_ns as f64 * 1e-9;
    let mut arms = Vec::new();
    for solver in SOLVERS {
        let arm = Ik::<J>::new(settings.limits, settings.ik).with_backend(solver.backend());
        arms.push(arm.map_err(|error| Failure::failed(error, ""))?);
    }
    let chosen: Vec<_> = workload.reachings.iter().collect();
    Ok(interleaved(&chosen, samples, |solver, problem| {
        let arm = &mut arms[solver as usize];
        let problem = black_box(**problem);
        let begin = Instant::now();
        let kinematics = settings.chain.forward(black_box(&problem.motion.q));
        black_box(arm.step(&kinematics, &problem.motion, &problem.target, period_s));
        elapsed_us(begin)
    }))
}

/// One roll-out of the DyBM, after every step of the pen's grid.
fn predicting<const N: usize>(
    config: &Config,
    workload: &Workload<N>,
    samples: u32,
) -> Result<CostRow, Failure> {
    let settings = config.follower_settings();
    let refused = |error: &dyn std::fmt::Display| Failure::bad_input(error, "");
    let steps = settings.preview_steps(N).map_err(|error| refused(&error))?;
    let mut tracker = PenTracker::new(settings.pen).map_err(|error| refused(&error))?;
    let mut previewer = Previewer::new(settings.preview, &settings.models, &settings.weights)
        .map_err(|error| refused(&error))?;
    let mut out = vec![[0.0; 2]; steps];
    let mut times = Vec::new();
    for tick in workload.ticks.iter().cycle() {
        if times.len() >= samples as usize {
            break;
        }
        tick.ingest(&mut tracker, &settings.plane);
        while let Some(step) = tracker.next_step() {
            previewer.observe(&step);
            let begin = Instant::now();
            black_box(previewer.preview(black_box(&mut out)));
            times.push(elapsed_us(begin));
        }
        if tick.now == workload.ticks[workload.ticks.len() - 1].now {
            // The recording restarts, and time with it.
            tracker = PenTracker::new(settings.pen).map_err(|error| refused(&error))?;
            previewer.forget();
        }
    }
    Ok(CostRow { exact: cost(times), clarabel: None, clarabel_tuned: None })
}

/// Times `solve` for every backend on `samples` of `problems`, in an order that neither cache nor prefetcher
/// can predict.
fn interleaved<T>(problems: &[T], samples: u32, mut solve: impl FnMut(Solver, &T) -> f64) -> CostRow {
    let mut times = [const { Vec::new() }; 3];
    let mut dice = BenchDice::new();
    for round in 0..samples as usize {
        let problem = &problems[dice.place(problems.len())];
        for turn in 0..SOLVERS.len() {
            let solver = SOLVERS[(turn + round) % SOLVERS.len()];
            times[solver as usize].push(solve(solver, problem));
        }
    }
    let [exact, clarabel, tuned] = times.map(cost);
    CostRow { exact, clarabel: Some(clarabel), clarabel_tuned: Some(tuned) }
}

fn cost(mut times: Vec<f64>) -> CostQuantiles {
    times.sort_by(f64::total_cmp);
    let at = |share: f64| {
        let index = (share * times.len().saturating_sub(1) as f64).round() as usize;
        times.get(index).copied().unwrap_or(f64::NAN)
    };
    CostQuantiles { p50: at(0.5), p99: at(0.99) }
}

fn clock_cost() -> f64 {
    cost((0..10_000).map(|_| elapsed_us(black_box(Instant::now()))).collect()).p50
}

fn elapsed_us(begin: Instant) -> f64 {
    begin.elapsed().as_nanos() as f64 * 1e-3
}

#[cfg(test)]
mod tests {
    use foretrace_sim::source::{PathOptions, load};

    use super::*;

    #[test]
    fn percentiles_of_a_hundred_and_one_numbers() {
        let cost = cost((0..=100).rev().map(f64::from).collect());
        assert_eq!(cost, CostQuantiles { p50: 50.0, p99: 99.0 });
    }

    #[test]
    fn recorded_loop_has_plans_with_and_without_active_limits() {
        let text =
            "preset = \"ur5\"\n[predictor]\nkind = \"dybm\"\n[trust]\nmode = \"manual\"\nvalue = 1.0\n";
        let config = Config::parse(text, "t.toml", ".").unwrap();
        let path = load(&["glyphs:Kx4".to_owned()], &PathOptions::default(), config.settings()).unwrap().path;
        let workload = workload::record::<20>(&config, &path, 6.0).unwrap();
        assert!(workload.ticks.iter().filter(|tick| tick.following).count() > 2000);
        assert_eq!(workload.plannings.len(), workload.reachings.len());
        assert!(planning(&config, &workload, 0..=0, 50).is_ok());
        assert!(planning(&config, &workload, 3..=8, 50).is_ok());
    }

    #[test]
    fn every_solver_gets_every_instance_once_per_round() {
        let mut seen = [0; 3];
        interleaved(&[(); 7], 300, |solver, ()| {
            seen[solver as usize] += 1;
            1.0
        });
        assert_eq!(seen, [300; 3]);
    }
}
