//! `foretrace bench`: what the parts of a tick cost on this machine, the exact path beside Clarabel.
//!
//! Contract: every backend is timed once per instance, in rotating order, so that all see the same machine
//! and about the same caches. The clock's own cost is reported, not subtracted. Percentiles are over
//! instances.

mod evidence;
mod lag;
mod online;
mod predictors;
mod workload;
mod stepping;

use std::hint::black_box;
use std::time::Instant;

use foretrace_config::Config;
use foretrace_control::ik::{Ik, IkBackend};
use foretrace_control::mpc::{Backend, ClarabelProfile, Mpc, Plan};
use foretrace_control::pen::PenTracker;
use foretrace_control::predict::Previewer;
use foretrace_control::units::Trust;
use serde::Serialize;

use crate::failure::Failure;
use crate::output::{JsonArgs, note, say};
use crate::play::source::{self, PathArgs};
use crate::settings::{SettingsArgs, judged};
use workload::{J, Workload};

/// Time the parts of a tick on this machine, the exact path beside Clarabel
///
/// Runs a loop on handwriting (the settings' horizon, DyBM at trust 1), then times every problem that
/// occurred in it with each backend in turn: planning without and with 3 to 8 active limits, one step of
/// inverse kinematics, one roll-out of the predictor, and the whole step from pen samples to a legal command.
/// Only release builds give meaningful figures.
#[derive(Debug, clap::Args)]
pub(crate) struct BenchArgs {
    /// Instances per row
    #[arg(long, value_name = "N", default_value_t = 2000, value_parser = clap::value_parser!(u32)
        .range(50..=1_000_000))]
    samples: u32,

    /// Handwriting to follow: UNIPEN file, data-set folder, CSV, or glyphs:TEXT
    #[arg(long, value_name = "SOURCE", default_value = "glyphs:Kx4 Rg8 Sy2 mB5")]
    pen: String,

    #[command(flatten)]
    settings: SettingsArgs,

    #[command(flatten)]
    json: JsonArgs,
}

/// The three ways to solve, in the order of the table.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Way {
    Exact,
    Clarabel,
    Tuned,
}

const WAYS: [Way; 3] = [Way::Exact, Way::Clarabel, Way::Tuned];

impl Way {
    const fn mpc(self) -> Backend {
        match self {
            Self::Exact => Backend::Exact,
            Self::Clarabel => Backend::Clarabel(ClarabelProfile::Default),
            Self::Tuned => Backend::Clarabel(ClarabelProfile::Tuned),
        }
    }

    const fn ik(self) -> IkBackend {
        match self {
            Self::Exact => IkBackend::Exact,
            Self::Clarabel => IkBackend::Clarabel(ClarabelProfile::Default),
            Self::Tuned => IkBackend::Clarabel(ClarabelProfile::Tuned),
        }
    }
}

/// Two percentiles [µs].
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
struct Cost {
    p50: f64,
    p99: f64,
}

/// One row of the table.
#[derive(Debug, Clone, Copy, Serialize)]
struct Row {
    exact: Cost,
    #[serde(skip_serializing_if = "Option::is_none")]
    clarabel: Option<Cost>,
    #[serde(skip_serializing_if = "Option::is_none")]
    clarabel_tuned: Option<Cost>,
}

/// The result; keys are stable.
#[derive(Debug, Serialize)]
struct BenchReport {
    /// Steps of the plan, as in the settings.
    horizon: usize,
    mpc_free_us: Row,
    mpc_active_us: Row,
    ik_us: Row,
    predict_us: Row,
    step_us: Row,
    /// The whole step with each predictor, weights coming in as in the daemon.
    step_by_predictor_us: Vec<stepping::PredictorSteps>,
    /// One grid step of the learner: all models, their comparisons, all bands.
    learn_us: Cost,
    /// The lag estimator's part of a tick.
    lag_us: lag::LagCost,
    /// Trust evidence: scoring previews, and correcting the newest.
    evidence_us: evidence::EvidenceCost,
    /// One observation and one preview each.
    predictors_us: Vec<predictors::PredictorCost>,
    clock_us: f64,
    samples: u32,
    optimised_build: bool,
}

pub(crate) fn run(args: &BenchArgs) -> Result<(), Failure> {
    args.json.claim()?;
    if cfg!(debug_assertions) {
        note!(
            "foretrace: built for a quick start; for numbers that mean something: `cargo run --release -p foretrace \
             --bin foretrace -- bench`, or the installed program"
        );
    }
    let config = configured(&args.settings)?;
    let report = match config.settings().mpc.horizon {
        10 => measured::<10>(args, &config),
        20 => measured::<20>(args, &config),
        _ => measured::<30>(args, &config),
    }?;
    table(&report);
    args.json.write(&report)
}

/// Everything under the clock, with plans of N steps.
fn measured<const N: usize>(args: &BenchArgs, config: &Config) -> Result<BenchReport, Failure> {
    let path = source::load(std::slice::from_ref(&args.pen), &PathArgs::default(), config.settings())?.path;
    let seconds = (f64::from(args.samples) * 0.02).clamp(20.0, 600.0);
    let workload = workload::record::<N>(config, &path, seconds)?;
    let (step_by_predictor_us, learn_us) = stepping::by_predictor(config, &workload, args.samples)?;
    Ok(BenchReport {
        horizon: N,
        mpc_free_us: planning(config, &workload, 0..=0, args.samples)?,
        mpc_active_us: planning(config, &workload, 3..=8, args.samples)?,
        ik_us: reaching(config, &workload, args.samples)?,
        predict_us: predicting(config, &workload, args.samples)?,
        step_us: stepping::stepping(config, &workload, args.samples)?,
        step_by_predictor_us,
        learn_us,
        lag_us: lag::lag(&workload, args.samples),
        evidence_us: evidence::evidence(config, &workload, args.samples)?,
        predictors_us: predictors::predictors(config, &workload, args.samples)?,
        clock_us: clock_cost(),
        samples: args.samples,
        optimised_build: !cfg!(debug_assertions),
    })
}

/// DyBM at trust 1, whatever the settings say; a setting that differs is reported.
fn configured(args: &SettingsArgs) -> Result<Config, Failure> {
    let fixed = [("predictor.kind", "dybm"), ("trust.mode", "manual"), ("trust.value", "1.0")];
    for (key, value) in fixed {
        if args.set.iter().any(|pair| pair.split_once('=').is_some_and(|(asked, _)| asked.trim() == key)) {
            note!("bench: --set {key} changes nothing here: the loop that is timed has {key} = {value}");
        }
    }
    judged(&fixed.iter().fold(args.source()?, |source, (key, value)| source.with(key, value)))
}

/// Planning problems whose exact solution has this many active limits (`active`).
fn planning<const N: usize>(
    config: &Config,
    workload: &Workload<N>,
    active: std::ops::RangeInclusive<u32>,
    samples: u32,
) -> Result<Row, Failure> {
    let settings = config.follower_settings().mpc;
    let mut planners = Vec::new();
    for way in WAYS {
        let built = Mpc::<N>::new(&foretrace_control::mpc::MpcSettings { backend: way.mpc(), ..settings });
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
    Ok(interleaved(&chosen, samples, |way, problem| {
        let planner = &mut planners[way as usize];
        // In a tick the problem was written a moment ago: fetching it from the recording is not part of the
        // cost.
        let problem = black_box(**problem);
        let begin = Instant::now();
        black_box(solve(planner, black_box(&problem)));
        elapsed_us(begin)
    }))
}

/// Forward kinematics and one IK step.
fn reaching<const N: usize>(config: &Config, workload: &Workload<N>, samples: u32) -> Result<Row, Failure> {
    let settings = config.follower_settings();
    let period_s = settings.period_ns as f64 * 1e-9;
    let mut arms = Vec::new();
    for way in WAYS {
        let arm = Ik::<J>::new(settings.limits, settings.ik).with_backend(way.ik());
        arms.push(arm.map_err(|error| Failure::failed(error, ""))?);
    }
    let chosen: Vec<_> = workload.reachings.iter().collect();
    Ok(interleaved(&chosen, samples, |way, problem| {
        let arm = &mut arms[way as usize];
        let problem = black_box(**problem);
        let begin = Instant::now();
        let kinematics = settings.chain.forward(black_box(&problem.motion.q));
        black_box(arm.step(&kinematics, &problem.motion, &problem.target, period_s));
        elapsed_us(begin)
    }))
}

/// One roll-out of the DyBM, after every step of the pen's grid.
fn predicting<const N: usize>(config: &Config, workload: &Workload<N>, samples: u32) -> Result<Row, Failure> {
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
        for reading in &tick.pen {
            let position = settings.plane.from_pen(reading.position);
            tracker.ingest(tick.now, &foretrace_control::pen::PenReading { position, ..*reading });
        }
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
    Ok(Row { exact: cost(times), clarabel: None, clarabel_tuned: None })
}

/// Times `solve` for every backend on `samples` of `problems`, in an order that neither cache nor prefetcher
/// can predict.
fn interleaved<T>(problems: &[T], samples: u32, mut solve: impl FnMut(Way, &T) -> f64) -> Row {
    let mut times = [const { Vec::new() }; 3];
    let mut dice = 0x9e37_79b9_7f4a_7c15_u64;
    for round in 0..samples as usize {
        dice = dice.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        let problem = &problems[(dice >> 33) as usize % problems.len()];
        for turn in 0..WAYS.len() {
            let way = WAYS[(turn + round) % WAYS.len()];
            times[way as usize].push(solve(way, problem));
        }
    }
    let [exact, clarabel, tuned] = times.map(cost);
    Row { exact, clarabel: Some(clarabel), clarabel_tuned: Some(tuned) }
}

fn cost(mut times: Vec<f64>) -> Cost {
    times.sort_by(f64::total_cmp);
    let at = |share: f64| {
        let index = (share * times.len().saturating_sub(1) as f64).round() as usize;
        times.get(index).copied().unwrap_or(f64::NAN)
    };
    Cost { p50: at(0.5), p99: at(0.99) }
}

fn clock_cost() -> f64 {
    cost((0..10_000).map(|_| elapsed_us(black_box(Instant::now()))).collect()).p50
}

fn elapsed_us(begin: Instant) -> f64 {
    begin.elapsed().as_nanos() as f64 * 1e-3
}

fn table(report: &BenchReport) {
    say!(
        "µs, p50 / p99 of {} instances each, plans of {} steps; the clock's own {:.3} µs included\n",
        report.samples,
        report.horizon,
        report.clock_us
    );
    say!(
        "{:<22} {:>15} {:>19} {:>8} {:>19} {:>8}",
        "",
        "exact",
        "Clarabel",
        "ratio",
        "Clarabel tuned",
        "ratio"
    );
    for (name, row) in [
        ("plan, no limit active", &report.mpc_free_us),
        ("plan, 3-8 active", &report.mpc_active_us),
        ("inverse kinematics", &report.ik_us),
        ("predict", &report.predict_us),
        ("whole step", &report.step_us),
    ] {
        let pair = |cost: &Cost| format!("{:.2} / {:.2}", cost.p50, cost.p99);
        let other = |cost: &Option<Cost>| cost.as_ref().map_or_else(|| "-".to_owned(), pair);
        let ratio = |cost: &Option<Cost>| {
            cost.as_ref().map_or_else(String::new, |cost| format!("{:.0} x", cost.p50 / row.exact.p50))
        };
        say!(
            "{:<22} {:>15} {:>19} {:>8} {:>19} {:>8}",
            name,
            pair(&row.exact),
            other(&row.clarabel),
            ratio(&row.clarabel),
            other(&row.clarabel_tuned),
            ratio(&row.clarabel_tuned)
        );
    }
    say!(
        "\n{:<22} {:>15} {:>19} {:>19}",
        "whole step with",
        "any tick",
        "with a new preview",
        "with new weights"
    );
    let pair = |cost: &Cost| format!("{:.2} / {:.2}", cost.p50, cost.p99);
    for stepping::PredictorSteps { predictor, any, new_preview, new_weights } in &report.step_by_predictor_us
    {
        say!("{:<22} {:>15} {:>19} {:>19}", predictor, pair(any), pair(new_preview), pair(new_weights));
    }
    say!("{:<22} {:>15}   off the loop: all models, all bands", "learner's step", pair(&report.learn_us));
    let lag = &report.lag_us;
    let (name, p90) = ("lag of the arm, a tick", lag.p90);
    say!("{name:<22} {:>15}   {p90:.2} where a grid step closes", pair(&lag.per_tick));
    let evidence = &report.evidence_us;
    say!(
        "{:<22} {:>15}   {} where a grid step closes",
        "trust evidence, a tick",
        pair(&evidence.between),
        pair(&evidence.closing)
    );
    say!("");
    for predictors::PredictorCost { name, steps, us } in &report.predictors_us {
        let what = if *steps == 0 { "learn".to_owned() } else { format!("observe, {steps} steps") };
        say!("{:<22} {:>15}   {what}", name, format!("{:.2} / {:.2}", us.p50, us.p99));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentiles_of_a_hundred_and_one_numbers() {
        let cost = cost((0..=100).rev().map(f64::from).collect());
        assert_eq!(cost, Cost { p50: 50.0, p99: 99.0 });
    }

    #[test]
    fn recorded_loop_has_plans_with_and_without_active_limits() {
        let config =
            configured(&SettingsArgs { preset: "ur5".to_owned(), ..SettingsArgs::default() }).unwrap();
        let pen = ["glyphs:Kx4".to_owned()];
        let path = source::load(&pen, &PathArgs::default(), config.settings()).unwrap().path;
        let workload = workload::record::<20>(&config, &path, 6.0).unwrap();
        assert!(workload.ticks.iter().filter(|tick| tick.following).count() > 2000);
        assert_eq!(workload.plannings.len(), workload.reachings.len());
        assert!(planning(&config, &workload, 0..=0, 50).is_ok());
        assert!(planning(&config, &workload, 3..=8, 50).is_ok());
    }

    #[test]
    fn every_way_gets_every_instance_once_per_round() {
        let mut seen = [0; 3];
        interleaved(&[(); 7], 300, |way, ()| {
            seen[way as usize] += 1;
            1.0
        });
        assert_eq!(seen, [300; 3]);
    }
}
