//! Training of `foresight`: examples are what the loop sees and never the future, gradients are those of the
//! loss, and a training is the same on any number of threads and from any epoch on.

use std::ops::ControlFlow;

use foretrace_control::pen::{PenReading, PenSettings, PenTracker};
use foretrace_control::predict::PenStep;
use foretrace_control::predict::models::foresight::{FEATURES, Foresight, OUTPUTS, PenHistory};
use foretrace_control::predict::{ModelSettings, Models, Networks, PreviewSettings, Previewer};
use foretrace_control::units::Stamp;
use foretrace_lab::train::foresight::{
    Context, Distortion, Examples, ForesightFit, ForesightPlan, ForesightShape, GradientEngine, Study,
    Without, Writing, WrittenCharacter, examples, hold_out, of_writing, weights_of,
};
use foretrace_lab::train::{FitError, Schedule, TrainState};
use foretrace_sim::path::PathSample;

const STEP_NS: u64 = 10_000_000;

/// A hand that loops, lifts and turns with time.
fn samples(seed: u32, count: usize) -> Vec<PathSample> {
    let phase = f64::from(seed);
    (0..count)
        .map(|k| {
            let t_s = k as f64 * 0.005;
            let (a, b) = (9.0 * t_s + phase, 14.0 * t_s + 2.0 * phase);
            let contact = k % 70 < 50;
            // Hover is slower, which only the contact tells ahead.
            let size = if contact { 0.02 } else { 0.01 };
            PathSample { t_s, x_m: size * a.sin() + 0.05 * t_s, y_m: size * b.cos(), contact }
        })
        .collect()
}

fn sequence(samples: Vec<PathSample>) -> WrittenCharacter {
    WrittenCharacter { label: "a".to_owned(), samples, leaps: Vec::new() }
}

fn writing(seed: u32) -> Writing {
    let sequences = (0..3).map(|k| sequence(samples(seed * 10 + k, 300))).collect();
    Writing { writer: format!("set/{seed}"), rate_hz: 200.0, sequences }
}

fn seen(samples: &[PathSample], study: &Study) -> Examples {
    examples(&[sequence(samples.to_vec())], STEP_NS, 0.003, study)
}

#[test]
fn examples_are_what_the_loop_sees() {
    let samples = samples(1, 400);
    let examples = seen(&samples, &Study::default());
    let models = Models::new(ModelSettings::preset(STEP_NS), Networks::default()).unwrap();
    let mut previewer =
        Previewer::new(PreviewSettings::default(), &models, &models.initial_weights()).unwrap();
    let mut tracker = PenTracker::new(PenSettings::default()).unwrap();
    let mut history = PenHistory::EMPTY;
    let mut rows = Vec::new();
    for sample in &samples {
        let stamp = Stamp(((10.003 + sample.t_s) * 1e9).round() as u64);
        tracker.ingest(stamp, &PenReading::new(stamp, [sample.x_m, sample.y_m], sample.contact));
        while let Some(step) = tracker.next_step() {
            let learn = previewer.observe(&step);
            if previewer.history() > 0 {
                history.observe(&learn.pen);
                rows.push(history.look(0.01, 2).features);
            }
        }
    }
    assert!(examples.len() > 150);
    let width = Study::default().inputs();
    for (row, expected) in examples.features.chunks(width).zip(rows) {
        assert_eq!(row[..FEATURES], expected);
        assert!(row[FEATURES..].iter().all(|x| *x == 0.0));
    }
}

#[test]
fn no_example_sees_samples_after_its_own() {
    let samples = samples(2, 300);
    for context in Context::ALL {
        let study = Study { context, ..Study::default() };
        let whole = seen(&samples, &study);
        for cut in [60, 133, 250] {
            let part = seen(&samples[..cut], &study);
            assert_eq!(part.features, whole.features[..part.features.len()], "{context:?}, {cut}");
        }
    }
}

#[test]
fn a_target_is_the_way_that_followed_in_the_frame_of_motion() {
    // Straight along y at 14 per step, so along x of the frame of motion: √2 units of ordinary motion.
    let samples: Vec<PathSample> = (0..400)
        .map(|k| PathSample { t_s: f64::from(k) * 0.005, x_m: 0.0, y_m: f64::from(k) * 7e-4, contact: true })
        .collect();
    let examples = seen(&samples, &Study::default());
    for (target, known) in examples.targets.iter().zip(&examples.known).skip(50) {
        for pair in target.as_chunks::<2>().0.iter().take(usize::from(*known)) {
            assert!((pair[0] - 1.414).abs() < 0.02 && pair[1].abs() < 1e-3, "{pair:?}");
        }
    }
    assert_eq!(examples.known.last(), Some(&1), "the last but one step knows one step ahead");
}

fn plan() -> ForesightPlan {
    ForesightPlan {
        schedule: Schedule::OneCycle { peak: 5e-3, warm_up: 0.2 },
        epochs: 4,
        batch: 256,
        seed: 3,
        step_ns: STEP_NS,
        study: Study::default(),
        changed: 0.5,
        limit_norm: 1.0,
    }
}

fn parts() -> (Vec<Writing>, Vec<Writing>) {
    ((0..6).map(writing).collect(), vec![writing(7)])
}

fn go_on(mut fit: ForesightFit) -> TrainState {
    while !fit.is_finished() {
        fit.epoch(|_| ControlFlow::Continue(())).unwrap();
    }
    fit.state().clone()
}

#[test]
fn any_number_of_threads_and_a_resumed_training_give_the_same_bits() {
    let whole = go_on(ForesightFit::new(plan(), parts(), 1, None));
    assert_eq!(go_on(ForesightFit::new(plan(), parts(), 3, None)), whole);
    let mut first = ForesightFit::new(plan(), parts(), 2, None);
    first.epoch(|_| ControlFlow::Continue(())).unwrap();
    let interrupted = first.epoch(|_| ControlFlow::Break(()));
    assert_eq!(interrupted, Err(FitError::Interrupted));
    let resumed = ForesightFit::new(plan(), parts(), 2, Some(first.state().clone()));
    assert_eq!(go_on(resumed), whole);
    let losses: Vec<f64> = whole.history.iter().map(|epoch| epoch.held_out.unwrap().loss).collect();
    assert!(losses[3] < 0.7 * losses[0], "{losses:?}");
}

#[test]
fn the_gradient_is_that_of_the_loss() {
    let study = Study::default();
    let shape = ForesightShape { inputs: study.inputs() };
    let all = of_writing(&writing(1), &Distortion::NONE, STEP_NS, &study);
    let mut parameters = {
        let fit = ForesightFit::new(plan(), parts(), 1, None);
        fit.state().parameters.clone()
    };
    let batch: Vec<usize> = (0..64).collect();
    let mut engine = GradientEngine::new(shape, 2, study);
    let (_, gradient) = engine.gradient(&parameters, &all, &batch);
    let gradient = gradient.to_vec();
    let largest = gradient.iter().fold(0.0_f32, |largest, g| largest.max(g.abs()));
    let mut checked = 0;
    for place in (0..parameters.len()).step_by(977) {
        if gradient[place].abs() < 0.02 * largest {
            continue;
        }
        let here = parameters[place];
        let mut loss = |value: f32| {
            parameters[place] = value;
            engine.gradient(&parameters, &all, &batch).0
        };
        let measured = (loss(here + 2e-3) - loss(here - 2e-3)) / 4e-3;
        loss(here);
        let expected = f64::from(gradient[place]);
        assert!((measured - expected).abs() < 0.05 * f64::from(largest), "{place}: {measured} {expected}");
        checked += 1;
    }
    assert!(checked > 3, "{checked}");
}

#[test]
fn what_an_ablation_leaves_out_has_no_weight_in_the_loop() {
    let study =
        Study { without: Without { contact: true, time: true, direction: false }, ..Study::default() };
    let mut state = go_on(ForesightFit::new(ForesightPlan { study, ..plan() }, parts(), 2, None));
    // Numbers that the loop need not round.
    state.parameters.iter_mut().for_each(|number| *number = f32::from_bits(number.to_bits() & 0xffff_0000));
    let weights = weights_of(&study, &state.parameters, STEP_NS).unwrap();
    let foresight = Foresight::new(&weights);
    let seen = |contact| {
        let mut history = PenHistory::EMPTY;
        for k in 0..40 {
            let touch = foretrace_control::pen::Touch { contact, steps: if contact { k } else { 0 } };
            history.observe(&PenStep { touch, ..PenStep::of([10.0, f64::from(k)]) });
        }
        *foresight.foresee(&history).path()
    };
    assert_eq!(seen(true), seen(false));
    // The same parameters as in training: the loop says what the trainer scored.
    let all = of_writing(&writing(1), &Distortion::NONE, STEP_NS, &study);
    let mut engine = GradientEngine::new(ForesightShape { inputs: study.inputs() }, 1, study);
    let outputs = engine.outputs(&state.parameters, &all);
    let network = foretrace_control::predict::models::foresight::Network::new(&weights);
    for (row, output) in all.features.chunks(study.inputs()).zip(outputs.as_chunks::<OUTPUTS>().0).take(300) {
        let mut features = [0.0; FEATURES];
        features.copy_from_slice(&row[..FEATURES]);
        for (loop_says, trainer_says) in network.answer(&features).outputs.iter().zip(output) {
            assert!((loop_says - trainer_says).abs() < 1e-4, "{loop_says} {trainer_says}");
        }
    }
}

#[test]
fn writers_are_held_out_whole() {
    let (train, held) = hold_out((0..8).map(|k| writing(k / 2)).collect(), 0.25, 5).unwrap();
    assert_eq!((train.len(), held.len()), (6, 2));
    assert!(train.iter().all(|writing| writing.writer != held[0].writer));
    assert!(hold_out(vec![writing(1)], 0.25, 5).is_err());
}

#[test]
fn nothing_is_learned_across_a_jump_however_short() {
    let mut with = sequence(samples(1, 300));
    with.leaps = vec![101, 202];
    for sample in &mut with.samples[101..] {
        sample.x_m += 2e-3;
    }
    let without = WrittenCharacter { leaps: Vec::new(), ..with.clone() };
    let of = |sequence: &WrittenCharacter| {
        examples(std::slice::from_ref(sequence), STEP_NS, 0.0, &Study::default())
    };
    let (seen, blind) = (of(&with), of(&without));
    // The loop sees the same pen; what the jump hides is no target: nodes of up to 24 steps before each.
    assert!(seen.features[..40] == blind.features[..40]);
    let known = |examples: &Examples| examples.known.iter().map(|known| u32::from(*known)).sum::<u32>();
    assert!(known(&seen) + 2 * 150 < known(&blind), "{} {}", known(&seen), known(&blind));
    // A slower tablet sees only where the jump leads.
    for seed in 0..50 {
        let copy = Distortion::drawn(seed, 0.01, 0.005, 1.0).apply(&with);
        assert_eq!(copy.leaps.len(), 2, "seed {seed}");
        assert!(copy.leaps.iter().all(|leap| (1..copy.samples.len()).contains(leap)));
    }
}

#[test]
fn a_changed_copy_is_another_device_or_hand_and_an_unchanged_one_the_same() {
    let samples = sequence(samples(1, 200));
    assert_eq!(Distortion::NONE.apply(&samples), samples);
    let mut lengths = std::collections::BTreeSet::new();
    for seed in 0..200 {
        let change = Distortion::drawn(seed, 0.01, 0.005, 1.0);
        let copy = change.apply(&samples).samples;
        assert_eq!(change, Distortion::drawn(seed, 0.01, 0.005, 1.0));
        assert!(copy.len() < 2 * samples.samples.len() && copy.len() > 40, "{}", copy.len());
        assert!(copy.windows(2).all(|pair| pair[0].t_s < pair[1].t_s));
        lengths.insert(copy.len());
    }
    assert!(lengths.len() > 10, "slower tablets give fewer samples: {lengths:?}");
}
