//! Whole trainings: their scores, interruption at any point, and refusals.

use crate::shared::shared;
use foretrace_lab::train::checkpoint::{self, CheckpointError};
use foretrace_lab::train::corpus::{self, CorpusError, Item};
use foretrace_lab::train::{
    Engine, Fit, FitError, Recipe, Schedule, Setup, Strokes, TrainPlan, TrainState, bench::made_up, model,
};
use foretrace_sim::data::{DataSet, Split};
use std::collections::BTreeMap;
use std::ops::ControlFlow;
use std::sync::Arc;

fn setup(recipe: Recipe, cells: usize, scale: f64) -> Setup {
    Setup { network: recipe.network(cells, 1), objective: recipe.objective(1), scale }
}

fn plan(recipe: Recipe, epochs: usize) -> TrainPlan {
    TrainPlan {
        schedule: recipe.schedule(None),
        epochs,
        batch: recipe.batch(),
        seed: 7,
        limit_norm: Some(5.0),
        augment: "none".parse().unwrap(),
        keep_speed: false,
        patience: None,
    }
}

fn fit(plan: &TrainPlan, threads: usize, state: Option<TrainState>) -> Fit {
    let parts = (made_up(70, 1), made_up(20, 2));
    Fit::new(plan.clone(), setup(Recipe::Robust, 6, 10.0), parts, threads, state)
}

fn run(fit: &mut Fit) {
    while !fit.is_finished() {
        fit.epoch(|| ControlFlow::Continue(())).unwrap();
    }
}

#[test]
fn training_lowers_the_held_out_loss_and_keeps_the_best_epoch() {
    let mut fit = fit(&plan(Recipe::Robust, 8), 2, None);
    run(&mut fit);
    let losses: Vec<f64> = fit.state().history.iter().map(|e| e.held_out.unwrap().loss).collect();
    let (best, parameters) = fit.outcome();
    assert!(losses[best] < 0.6 * losses[0] && losses.iter().all(|l| losses[best] <= *l), "{losses:?}");
    let held_out = Arc::new(made_up(20, 2));
    let again = Engine::new(setup(Recipe::Robust, 6, 10.0), 1).scores(
        parameters,
        &held_out,
        &(0..20).collect::<Vec<_>>(),
    );
    assert_eq!(again.loss, losses[best]);
}

#[test]
fn a_training_continued_from_any_checkpoint_is_the_same_to_the_bit() {
    let folder = tempfile::tempdir().unwrap();
    let mut plan = plan(Recipe::Robust, 5);
    plan.augment = "scale=0.5..2,time=0.8..1.25,decimate=0.3,noise=0.05,rotate=5".parse().unwrap();
    let mut whole = fit(&plan, 1, None);
    run(&mut whole);
    for stop in 1..5 {
        let mut first = fit(&plan, 2, None);
        for _ in 0..stop {
            first.epoch(|| ControlFlow::Continue(())).unwrap();
        }
        // Interrupted in the middle of the next epoch: nothing of it stays.
        let before = first.state().clone();
        assert_eq!(first.epoch(|| ControlFlow::Break(())), Err(FitError::Interrupted));
        assert_eq!(first.state(), &before);
        let file = folder.path().join(format!("{stop}.checkpoint"));
        checkpoint::save(&file, "a plan", first.state()).unwrap();
        let state = checkpoint::load(&file, "a plan", before.parameters.len()).unwrap();
        assert_eq!(state, before);
        let mut second = fit(&plan, 3, Some(state));
        run(&mut second);
        assert_eq!(second.state(), whole.state(), "stopped after {stop}");
    }
}

#[test]
fn damaged_or_foreign_checkpoints_are_refused_with_the_reason() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("a.checkpoint");
    let mut fit = fit(&plan(Recipe::Robust, 2), 1, None);
    run(&mut fit);
    let count = fit.state().parameters.len();
    checkpoint::save(&file, "cells 6\nseed 7", fit.state()).unwrap();
    let different = checkpoint::load(&file, "cells 6\nseed 8", count).unwrap_err();
    assert!(different.to_string().contains("(seed 7, now seed 8)"), "{different}");
    assert!(matches!(checkpoint::load(&file, "cells 6\nseed 7", 3), Err(CheckpointError::Damaged { .. })));
    let whole = std::fs::read(&file).unwrap();
    for length in (0..whole.len()).step_by(97) {
        std::fs::write(&file, &whole[..length]).unwrap();
        let refused = checkpoint::load(&file, "cells 6\nseed 7", count);
        assert!(matches!(refused, Err(CheckpointError::Damaged { .. })), "{length}: {refused:?}");
    }
    assert!(matches!(
        checkpoint::load(&folder.path().join("none"), "", count),
        Err(CheckpointError::File { .. })
    ));
}

#[test]
fn divergence_is_reported_and_leaves_the_last_good_state() {
    let mut plan = plan(Recipe::Paper, 50);
    plan.schedule = Schedule::Constant { rate: 1e39 };
    let mut fit = fit(&plan, 1, None);
    let wrong = (0..50).find_map(|_| fit.epoch(|| ControlFlow::Continue(())).err()).expect("it diverges");
    assert!(wrong.to_string().contains("lower --rate"), "{wrong}");
    assert!(fit.state().parameters.iter().all(|p| p.is_finite()));
}

fn item(writer: &str, rate_hz: f64, strokes: Strokes) -> Item {
    Item { strokes, writer: writer.to_owned(), rate_hz }
}

#[test]
fn writers_are_held_out_whole_and_as_the_seed_says() {
    let items: Vec<Item> =
        (0..60).map(|i| item(&format!("w{}", i % 6), 200.0, made_up(1, i).remove(0))).collect();
    let (train, held) = corpus::hold_out(items.clone(), 0.34, 3).unwrap();
    assert_eq!((train.len(), held.len()), (40, 20));
    assert!(held.iter().all(|h| train.iter().all(|t| t.writer != h.writer)));
    assert_eq!(corpus::hold_out(items.clone(), 0.34, 3).unwrap().1, held);
    assert!((4..30).any(|seed| corpus::hold_out(items.clone(), 0.34, seed).unwrap().1 != held));
    let alone = corpus::hold_out(items[..1].to_vec(), 0.5, 0).unwrap_err();
    assert_eq!(alone, CorpusError::Writers { writers: 1 });
}

#[test]
fn a_common_step_takes_both_phases_and_refuses_what_no_device_saw() {
    let strokes = made_up(1, 4).remove(0);
    let items = vec![item("a", 200.0, strokes.clone()), item("b", 100.0, strokes.clone())];
    let (changed, step_ms) = corpus::at_step(items.clone(), Some(10.0)).unwrap();
    assert_eq!((changed.len(), step_ms), (3, 10.0));
    assert_eq!(changed[2].strokes, strokes);
    let sum = |s: &Strokes| s.v.iter().fold([0.0; 2], |a, v| [a[0] + v[0], a[1] + v[1]]);
    assert!((sum(&changed[0].strokes)[0] - sum(&strokes)[0]).abs() < 1e-9);
    assert_ne!(changed[0].strokes, changed[1].strokes);
    assert!(matches!(corpus::at_step(items.clone(), None), Err(CorpusError::Rates { .. })));
    assert!(matches!(corpus::at_step(items, Some(5.0)), Err(CorpusError::TooFine { .. })));
    let estimated = vec![item("a", 199.999_999_8, strokes.clone()), item("b", 200.4, strokes.clone())];
    assert_eq!(corpus::at_step(estimated.clone(), None).unwrap().1, 4.99);
    assert_eq!(corpus::at_step(estimated[..1].to_vec(), None).unwrap().1, 5.0);
    assert_eq!(corpus::at_step(estimated, Some(10.0)).unwrap().0.len(), 4);
    let still = vec![item("a", 200.0, Strokes::plain(vec![[0.0; 2]; 9]))];
    assert_eq!(corpus::at_step(still, None), Err(CorpusError::Empty));
}

#[test]
fn normalised_units_do_not_know_the_device() {
    let sized = |factor: f64| {
        let mut items: Vec<Item> = made_up(40, 6)
            .into_iter()
            .map(|mut s| {
                s.v.iter_mut().flatten().for_each(|x| *x *= factor);
                item("a", 200.0, s)
            })
            .collect();
        corpus::normalise(&mut items);
        items
    };
    let (small, large) = (sized(0.01), sized(300.0));
    for (a, b) in small.iter().zip(&large) {
        for (x, y) in a.strokes.v.iter().flatten().zip(b.strokes.v.iter().flatten()) {
            assert!((x - y).abs() < 1e-6 * x.abs().max(1.0), "{x} {y}");
        }
    }
    let rms = corpus::rms(small.iter().map(|i| &i.strokes));
    assert!((6.0..12.0).contains(&rms), "{rms}");
}

#[test]
fn the_model_file_predicts_what_the_training_saw() {
    use foretrace_config::models::DType;
    use foretrace_control::predict::{Lstm, Predictor as _};
    let mut plan = plan(Recipe::Robust, 2);
    plan.seed = 3;
    let setup = setup(Recipe::Robust, 10, 10.0);
    let parts = (made_up(40, 1), Vec::new());
    let mut fit = Fit::new(plan, setup.clone(), parts, 1, None);
    run(&mut fit);
    let (_, parameters) = fit.outcome();
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("m.safetensors");
    let notes = BTreeMap::from([("seed".to_owned(), "3".to_owned())]);
    model("m", &setup, parameters, 5.0, notes).unwrap().save(&file, DType::F32).unwrap();
    let loaded = foretrace_config::models::LstmModel::load(&file).unwrap();
    assert_eq!(loaded.notes["seed"], "3");
    let test = made_up(5, 9);
    let (mut squares, mut count) = (0.0, 0.0);
    for strokes in &test {
        let mut lstm = Lstm::new(loaded.weights.clone());
        for (t, v) in strokes.v.iter().enumerate() {
            let mut out = [[0.0; 2]];
            if t > 0 {
                lstm.preview(&mut out);
                squares += (out[0][0] - v[0]).powi(2) + (out[0][1] - v[1]).powi(2);
                count += 2.0;
            }
            lstm.observe(*v);
        }
    }
    let scores = Engine::new(setup, 1).scores(parameters, &Arc::new(test), &[0, 1, 2, 3, 4]);
    assert!((scores.mse - squares / count).abs() < 1e-4 * scores.mse, "{} {}", scores.mse, squares / count);
}

/// Six epochs of the paper's recipe come near what forty reach (63.2, within strokes 4.9).
#[test]
fn the_papers_recipe_learns_real_handwriting() {
    let Some(shared) = shared() else { return };
    let strokes = |split: Split| -> Vec<Strokes> {
        let set = DataSet::load(&shared.join("data/unipen-ced"), &split, true).unwrap();
        corpus::items(&set).into_iter().map(|item| item.strokes).collect()
    };
    let (train, test) = (strokes(Split::train()), strokes(Split::test()));
    let scale = corpus::rms(&train);
    assert!((scale - 10.1345).abs() < 1e-4, "{scale}");
    let setup = setup(Recipe::Paper, 10, scale);
    let mut plan = plan(Recipe::Paper, 6);
    plan.limit_norm = None;
    let mut fit = Fit::new(plan, setup.clone(), (train, Vec::new()), 2, None);
    run(&mut fit);
    let all: Vec<usize> = (0..test.len()).collect();
    let scores = Engine::new(setup, 2).scores(fit.outcome().1, &Arc::new(test), &all);
    assert!(scores.mse < 65.0 && scores.within < 5.3, "{scores:?}");
}
