//! Predictors and the previewer: memory untouched by rollouts, units, bounds, hostile input.

use crate::support;

use foretrace_control::pen::{GridStep, Motion, SpeedScaleSettings};
use foretrace_control::predict::models::dybm::{DybmShape, TraceInput};
use foretrace_control::predict::{
    ConstantVelocity, Dybm, DybmWeights, Hold, MAX_PREVIEW, ModelSettings, Models, OnlineWeights, Oracle,
    Panel, PenStep, Predictor, PredictorKind, PreviewError, PreviewSettings, Previewer,
};
use proptest::prelude::*;

const STEP_NS: u64 = 10_000_000;

fn shape() -> DybmShape {
    DybmShape::new(9, &[0.5, 0.9], TraceInput::Delayed)
}

fn models() -> Models {
    let mut settings = ModelSettings::preset(STEP_NS);
    settings.dybm.shape = shape();
    Models::new(settings, support::networks(STEP_NS)).unwrap()
}

fn with(dybm: DybmWeights) -> OnlineWeights {
    OnlineWeights { dybm, ..models().initial_weights() }
}

fn previewer(weights: DybmWeights) -> Previewer {
    Previewer::new(PreviewSettings::default(), &models(), &with(weights)).unwrap()
}

fn start(index: u64, position: [f64; 2]) -> GridStep {
    GridStep {
        index,
        position,
        displacement: [0.0; 2],
        motion: Motion::Start,
        contact: true,
        ..GridStep::default()
    }
}

/// A circle of 2 cm at about 0.13 m/s, one step per index.
fn circle(index: u64) -> GridStep {
    let at = |k: f64| [0.02 * (0.065 * k).cos(), 0.02 * (0.065 * k).sin()];
    let (now, before) = (at(index as f64), at(index as f64 - 1.0));
    let displacement = [now[0] - before[0], now[1] - before[1]];
    let motion = if index == 0 { Motion::Start } else { Motion::Continues };
    GridStep { index, position: now, displacement, motion, contact: true, ..GridStep::default() }
}

#[test]
fn hold_stays_and_constant_velocity_goes_on() {
    let mut previewer = previewer(DybmWeights::zero(STEP_NS, shape()));
    previewer.observe(&start(100, [0.10, 0.20]));
    let displacement = [0.001, -0.002];
    let step = GridStep {
        index: 101,
        position: [0.101, 0.198],
        displacement,
        motion: Motion::Continues,
        contact: true,
        ..GridStep::default()
    };
    previewer.observe(&step);
    let mut out = [[0.0; 2]; 3];
    let report = previewer.preview_of(PredictorKind::HOLD, &mut out).unwrap();
    assert_eq!((report.base_index, report.base_position), (101, [0.101, 0.198]));
    assert_eq!(out, [[0.101, 0.198]; 3]);
    previewer.preview_of(PredictorKind::CONSTANT_VELOCITY, &mut out).unwrap();
    for (ahead, [x, y]) in (1..).zip(out) {
        assert!((x - (0.101 + 0.001 * f64::from(ahead))).abs() < 1e-15);
        assert!((y - (0.198 - 0.002 * f64::from(ahead))).abs() < 1e-15);
    }
}

#[test]
fn untrained_persistent_dybm_fades_like_its_persistence() {
    let mut dybm = Dybm::new(DybmWeights::persistent(STEP_NS, shape(), 0.5)).unwrap();
    dybm.observe([3.0, 1.0]);
    dybm.observe([8.0, -4.0]);
    let mut out = [[0.0; 2]; 3];
    dybm.preview(&mut out);
    assert_eq!(out, [[4.0, -2.0], [2.0, -1.0], [1.0, -0.5]]);
}

#[test]
fn previews_leave_every_memory_untouched() {
    let mut weights = DybmWeights::persistent(STEP_NS, shape(), 0.9);
    weights.parameters.traces[1] = [[0.03, -0.01], [0.02, 0.05]];
    let mut one = previewer(weights);
    let mut other = previewer(weights);
    let mut scratch = [[0.0; 2]; MAX_PREVIEW];
    for index in 0..200 {
        one.observe(&circle(index));
        other.observe(&circle(index));
        for kind in PredictorKind::LIVE {
            one.preview_of(kind, &mut scratch).unwrap();
        }
    }
    let (mut after_many, mut after_none) = ([[0.0; 2]; 20], [[0.0; 2]; 20]);
    for kind in PredictorKind::LIVE {
        one.preview_of(kind, &mut after_many);
        other.preview_of(kind, &mut after_none);
        assert_eq!(after_many, after_none, "{kind:?}");
    }
}

#[test]
fn starts_jumps_and_lost_steps_empty_the_memory() {
    for interruption in [
        GridStep { motion: Motion::Start, displacement: [0.0; 2], ..circle(50) },
        GridStep { motion: Motion::Jump, displacement: [0.3, 0.3], ..circle(50) },
        circle(57),
    ] {
        let mut previewer = previewer(DybmWeights::persistent(STEP_NS, shape(), 0.9));
        for index in 0..50 {
            previewer.observe(&circle(index));
        }
        assert_eq!(previewer.history(), 49);
        let learned = previewer.observe(&interruption);
        assert!(learned.motion != Motion::Continues && learned.pen.x == [0.0; 2]);
        assert_eq!(previewer.history(), 0);
        let mut out = [[0.0; 2]; 10];
        for kind in PredictorKind::LIVE {
            previewer.preview_of(kind, &mut out).unwrap();
            assert_eq!(out, [interruption.position; 10], "{kind:?}");
        }
    }
}

#[test]
fn diverging_weights_are_bounded_by_the_recent_peak_in_the_previewer_only() {
    let weights = DybmWeights::persistent(STEP_NS, shape(), 1.6);
    let mut bounded = previewer(weights);
    let mut free = Dybm::new(weights).unwrap();
    let mut peak = 0.0_f64;
    for index in 0..100 {
        let x = bounded.observe(&circle(index)).pen.x;
        peak = peak.max(circle(index).displacement[0].hypot(circle(index).displacement[1]));
        free.observe(x);
    }
    let mut positions = [[0.0; 2]; 16];
    let report = bounded.preview_of(PredictorKind::DYBM, &mut positions).unwrap();
    assert!(report.finite && report.limited >= 14, "{report:?}");
    let mut before = report.base_position;
    for [x, y] in positions {
        assert!((x - before[0]).hypot(y - before[1]) <= 1.3 * peak);
        before = [x, y];
    }
    let mut out = [[0.0; 2]; 16];
    free.preview(&mut out);
    assert!(out[15][0].hypot(out[15][1]) > 1000.0 * out[0][0].hypot(out[0][1]));
}

#[test]
fn oracle_previews_the_recording_by_grid_index() {
    let recording: Vec<[f64; 2]> = (1000..1300).map(|index| circle(index).displacement).collect();
    let mut previewer = previewer(DybmWeights::zero(STEP_NS, shape()));
    assert_eq!(
        previewer.choose(PredictorKind::ORACLE),
        Err(PreviewError::NoRecording { predictor: "oracle" })
    );
    previewer.load_recording(Oracle::new(1000, recording.into_boxed_slice()));
    previewer.choose(PredictorKind::ORACLE).unwrap();
    // From the start, and again after an interruption in the middle.
    for first in [1000, 1100] {
        for index in first..first + 50 {
            previewer.observe(&circle(index));
        }
        let mut out = [[0.0; 2]; 16];
        let report = previewer.preview(&mut out).unwrap();
        for (index, [x, y]) in (report.base_index + 1..).zip(out) {
            let real = circle(index).position;
            assert!((x - real[0]).abs() < 1e-12 && (y - real[1]).abs() < 1e-12, "index {index}");
        }
    }
    // Past its end the pen rests.
    previewer.observe(&circle(5000));
    let mut out = [[0.0; 2]; 4];
    previewer.preview(&mut out).unwrap();
    assert_eq!(out, [circle(5000).position; 4]);
}

#[test]
fn preview_in_other_units_of_length_is_the_same_preview() {
    let unit = 2.0_f64.powi(10);
    let base = SpeedScaleSettings::default();
    let scaled = SpeedScaleSettings {
        initial_m: base.initial_m * unit,
        min_m: base.min_m * unit,
        max_m: base.max_m * unit,
        still_m: base.still_m * unit,
        ..base
    };
    let weights = DybmWeights::persistent(STEP_NS, shape(), 0.95);
    let mut one = previewer(weights);
    let mut other = Previewer::new(
        PreviewSettings { scale: scaled, ..PreviewSettings::default() },
        &models(),
        &with(weights),
    )
    .unwrap();
    let (mut a, mut b) = ([[0.0; 2]; 16], [[0.0; 2]; 16]);
    for index in 0..300 {
        let step = circle(index);
        let larger = GridStep {
            position: step.position.map(|p| p * unit),
            displacement: step.displacement.map(|d| d * unit),
            ..step
        };
        assert_eq!(one.observe(&step).pen.x, other.observe(&larger).pen.x);
        one.preview(&mut a);
        other.preview(&mut b);
        assert_eq!(a.map(|p| p.map(|p| p * unit)), b);
    }
}

#[test]
fn there_is_no_preview_before_the_first_step() {
    let previewer = previewer(DybmWeights::zero(STEP_NS, shape()));
    let mut out = [[7.0; 2]; 3];
    assert_eq!(previewer.preview(&mut out), None);
    assert_eq!(out, [[7.0; 2]; 3]);
}

#[test]
fn previews_longer_than_the_longest_end_at_rest() {
    let mut previewer = previewer(DybmWeights::persistent(STEP_NS, shape(), 1.0));
    (0..20).for_each(|index| {
        previewer.observe(&circle(index));
    });
    let mut out = [[0.0; 2]; MAX_PREVIEW + 5];
    previewer.preview(&mut out).unwrap();
    assert!(out[MAX_PREVIEW - 2] != out[MAX_PREVIEW - 1]);
    assert_eq!(out[MAX_PREVIEW..], [out[MAX_PREVIEW - 1]; 5]);
}

#[test]
fn settings_and_weights_of_another_loop_are_refused_at_start() {
    let good = PreviewSettings::default();
    let weights = DybmWeights::zero(STEP_NS, shape());
    let bad_scale = SpeedScaleSettings { min_m: 2.0, ..good.scale };
    for bad in [
        PreviewSettings { limit_factor: f64::NAN, ..good },
        PreviewSettings { limit_factor: 0.5, ..good },
        PreviewSettings { peak_fade: 1.0, ..good },
        PreviewSettings { scale: bad_scale, ..good },
        PreviewSettings { step_ns: 5_000_000, ..good },
        PreviewSettings { kind: PredictorKind::ORACLE, ..good },
    ] {
        assert!(Previewer::new(bad, &models(), &with(weights)).is_err(), "{bad:?}");
    }
}

#[test]
fn predictor_names_lead_back_to_their_predictor() {
    for kind in PredictorKind::ALL {
        assert_eq!(PredictorKind::from_name(kind.name()), Some(kind));
    }
    assert_eq!(PredictorKind::from_name("crystal-ball"), None);
}

fn hostile_number() -> impl Strategy<Value = f64> {
    prop_oneof![
        6 => -0.01..0.01_f64,
        1 => any::<f64>(),
        1 => prop_oneof![Just(f64::NAN), Just(f64::INFINITY), Just(-f64::MAX), Just(f64::MIN_POSITIVE)],
    ]
}

fn motion() -> impl Strategy<Value = Motion> {
    prop_oneof![8 => Just(Motion::Continues), 1 => Just(Motion::Start), 1 => Just(Motion::Jump)]
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 512, failure_persistence: None, ..ProptestConfig::default() })]
    #[test]
    fn hostile_steps_and_weights_give_a_finite_preview_or_hold(
        persistence in -100.0..100.0_f64,
        bias in -100.0..100.0_f64,
        steps in proptest::collection::vec((0..3_u64, hostile_number(), hostile_number(), motion()), 1..100)
    ) {
        let mut weights = DybmWeights::persistent(STEP_NS, shape(), persistence);
        weights.parameters.bias = [bias, -bias];
        let mut previewer = previewer(weights);
        let mut index = 0;
        let mut out = [[0.0; 2]; 20];
        for (advance, x, y, motion) in steps {
            index += advance;
            let start = GridStep { index, position: [0.1, 0.2], contact: true, ..GridStep::default() };
            let step = GridStep { displacement: [x, y], motion, ..start };
            let learned = previewer.observe(&step);
            prop_assert!(learned.pen.x.iter().all(|x| x.is_finite()));
            for kind in PredictorKind::LIVE {
                let report = previewer.preview_of(kind, &mut out).unwrap();
                prop_assert!(out.as_flattened().iter().all(|p| p.is_finite()));
                prop_assert!(report.finite || out == [[0.1, 0.2]; 20]);
            }
        }
    }

    #[test]
    fn bare_predictors_never_panic(
        inputs in proptest::collection::vec((any::<f64>(), any::<f64>()), 0..40), limit in any::<f64>()
    ) {
        let mut dybm = Dybm::new(DybmWeights::persistent(STEP_NS, shape(), 0.9)).unwrap();
        let mut last = ConstantVelocity::default();
        let mut hold = Hold;
        let mut oracle = Oracle::new(u64::MAX - 3, vec![[1.0; 2]; 8].into_boxed_slice());
        let mut out = [[0.0; 2]; 16];
        for (x, y) in inputs {
            let all: [&mut dyn Predictor; 4] = [&mut dybm, &mut last, &mut hold, &mut oracle];
            for predictor in all {
                predictor.observe([x, y]);
                predictor.preview(&mut out);
                predictor.preview_within(limit, &mut out);
            }
        }
    }
}

#[test]
fn what_was_forgotten_is_in_no_preview() {
    let models = support::models_with_network();
    let fresh = Panel::new(&models, &models.initial_weights()).unwrap();
    let mut used = fresh.clone();
    (0..60).map(f64::from).for_each(|t| {
        used.observe(&PenStep::of([10.0 + 4.0 * (0.3 * t).sin(), 8.0 * (0.2 * t).cos()]));
    });
    let path = |panel: &Panel, kind| {
        let mut path = [[0.0; 2]; 12];
        panel.roll_out(kind, 100.0, 1e-4, [0.01, 0.02], &mut path);
        path
    };
    for kind in PredictorKind::BUILT_IN {
        let remembers = path(&used, kind) != path(&fresh, kind);
        assert_eq!(remembers, kind != PredictorKind::HOLD, "{kind:?}");
    }
    used.forget();
    let mut first = fresh.clone();
    for x in [[3.0, -2.0], [5.0, 1.0]] {
        for kind in PredictorKind::BUILT_IN {
            assert_eq!(path(&used, kind), path(&first, kind), "{kind:?}");
        }
        used.observe(&PenStep::of(x));
        first.observe(&PenStep::of(x));
    }
}

#[test]
fn a_reset_and_what_is_no_number_leave_nothing_of_the_pen() {
    let fresh = Dybm::new(DybmWeights::persistent(STEP_NS, shape(), 0.9)).unwrap();
    let empty: [fn(&mut Dybm); 2] = [Predictor::reset, |dybm| dybm.observe([f64::NAN, 1.0])];
    for empty in empty {
        let mut used = fresh;
        (0..20).for_each(|t| used.observe([f64::from(t), -3.0]));
        assert_ne!(used.state(), fresh.state());
        empty(&mut used);
        assert_eq!(used, fresh);
    }
}
