//! Times the whole step: with every solver, and with every predictor.
//!
//! Contract: all run through the same recorded ticks, in rotating order. With a predictor, the learner runs
//! beside the loop and is not timed; its weights arrive as they do in the daemon.

use std::hint::black_box;
use std::time::Instant;

use foretrace_config::Config;
use foretrace_control::follower::{Budget, Follower, FollowerSettings, NoClock};
use foretrace_control::learn::Learner;
use foretrace_control::predict::{
    ExternalPreview, LearnStep, MAX_PREVIEW, Needs, OnlineWeights, PredictorKind,
};
use serde::Serialize;

use crate::workload::{J, Workload};
use crate::{CostQuantiles, CostRow, SOLVERS, cost, elapsed_us};
use foretrace_failure::Failure;

/// What a step costs with one predictor \[µs\].
#[derive(Debug, Clone, Serialize)]
pub struct PredictorSteps {
    pub predictor: &'static str,
    pub any: CostQuantiles,
    /// Ticks in which a grid step closed: the predictor observes and predicts.
    pub new_preview: CostQuantiles,
    /// Ticks in which weights came in as well.
    pub new_weights: CostQuantiles,
}

/// The whole step, all ways through the same ticks.
pub(crate) fn stepping<const N: usize>(
    config: &Config,
    workload: &Workload<N>,
    samples: u32,
) -> Result<CostRow, Failure> {
    let mut followers = Vec::new();
    for solver in SOLVERS {
        let mut settings = config.follower_settings();
        settings.mpc.backend = solver.backend();
        settings.ik_backend = solver.backend();
        followers.push(follower::<N>(settings)?);
    }
    let skip = warm_up(workload);
    let mut times = [const { Vec::new() }; 3];
    let mut seen = 0;
    for tick in &workload.ticks {
        seen += usize::from(tick.following);
        for turn in 0..SOLVERS.len() {
            let solver = (turn + seen) % SOLVERS.len();
            let input = black_box(tick.input());
            let begin = Instant::now();
            black_box(followers[solver].step(black_box(&input), Budget::default(), &mut NoClock));
            let us = elapsed_us(begin);
            if tick.following && seen > skip {
                times[solver].push(us);
            }
        }
        if times[0].len() >= samples as usize {
            break;
        }
    }
    let [exact, clarabel, tuned] = times.map(cost);
    Ok(CostRow { exact, clarabel: Some(clarabel), clarabel_tuned: Some(tuned) })
}

/// One loop with its predictor, its learner, and what both cost.
struct TimedLoop<const N: usize> {
    kind: PredictorKind,
    follower: Follower<N, J>,
    learner: Learner,
    weights: Option<OnlineWeights>,
    /// Of the process that predicts, where one does.
    coming: Option<ExternalPreview>,
    any: Vec<f64>,
    new_preview: Vec<f64>,
    new_weights: Vec<f64>,
}

/// The whole step with every predictor that these settings have, and what its learner takes for one grid step
/// (all models together).
pub(crate) fn by_predictor<const N: usize>(
    config: &Config,
    workload: &Workload<N>,
    samples: u32,
) -> Result<(Vec<PredictorSteps>, CostQuantiles), Failure> {
    let mut loops = Vec::new();
    for kind in PredictorKind::LIVE.into_iter().filter(|kind| config.models().has(*kind)) {
        let mut settings = config.follower_settings();
        settings.preview.kind = kind;
        let learner = Learner::new(config.learner_settings(), config.models())
            .map_err(|error| Failure::bad_input(error, ""))?;
        let (any, new_preview, new_weights) = (Vec::new(), Vec::new(), Vec::new());
        let follower = follower::<N>(settings)?;
        loops.push(TimedLoop {
            kind,
            follower,
            learner,
            weights: None,
            coming: None,
            any,
            new_preview,
            new_weights,
        });
    }
    let (skip, count) = (warm_up(workload), loops.len());
    let mut learning = Vec::new();
    let mut seen = 0;
    for tick in &workload.ticks {
        seen += usize::from(tick.following);
        for turn in 0..count {
            let one = &mut loops[(turn + seen) % count];
            let weights = one.weights.take();
            let mut input = tick.input();
            input.weights = weights.as_ref();
            let coming = one.coming.take();
            input.preview = coming.as_ref();
            let input = black_box(input);
            let begin = Instant::now();
            let output = black_box(one.follower.step(black_box(&input), Budget::default(), &mut NoClock));
            let us = elapsed_us(begin);
            if tick.following && seen > skip {
                one.any.push(us);
                match (output.learn_count, weights.is_some()) {
                    (_, true) => one.new_weights.push(us),
                    (1.., false) => one.new_preview.push(us),
                    _ => {}
                }
            }
            for step in output.learn.iter().take(output.learn_count) {
                one.coming = (one.kind.needs() == Needs::Process).then(|| repeated(step));
                let begin = Instant::now();
                let lesson = black_box(one.learner.learn(step));
                learning.push(elapsed_us(begin));
                if lesson.hand_over {
                    one.weights = Some(*one.learner.weights());
                }
            }
        }
        if loops.first().is_none_or(|one| one.any.len() >= samples as usize) {
            break;
        }
    }
    let steps = loops.into_iter().map(|one| PredictorSteps {
        predictor: one.kind.name(),
        any: cost(one.any),
        new_preview: cost(one.new_preview),
        new_weights: cost(one.new_weights),
    });
    Ok((steps.collect(), cost(learning)))
}

/// What a process answers that repeats the last displacement.
fn repeated(step: &LearnStep) -> ExternalPreview {
    let [dx, dy] = step.pen.x.map(|x| x * step.scale_m);
    let [x, y] = step.position;
    let mut preview =
        ExternalPreview { base_index: step.index, count: MAX_PREVIEW, ..ExternalPreview::EMPTY };
    for (ahead, slot) in (1..).map(f64::from).zip(&mut preview.positions) {
        *slot = [x + ahead * dx, y + ahead * dy];
    }
    preview
}

fn follower<const N: usize>(settings: FollowerSettings<J>) -> Result<Follower<N, J>, Failure> {
    Follower::<N, J>::new(settings).map_err(|error| Failure::bad_input(error, ""))
}

/// Ticks of following in which the predictor warms up and trust ramps.
fn warm_up<const N: usize>(workload: &Workload<N>) -> usize {
    workload.ticks.iter().filter(|tick| tick.following).count().min(500) / 2
}
