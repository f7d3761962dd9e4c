//! Claims about the baselines on motions with a known answer.

use super::otg::OtgWay;
use super::*;

const PERIOD_S: f64 = 0.002;
const DEAD_S: f64 = 0.030;

fn settings(kind: BaselineKind) -> BaselineSettings {
    BaselineSettings::new(kind, PERIOD_S, DEAD_S, Limits::OFF, 0.1)
}

/// The plain filter: no cap on the prediction, no rules, nothing behind it.
fn plain_kalman() -> BaselineSettings {
    let rules_off = KalmanKnobs {
        horizon_max_s: f64::INFINITY,
        turn_rule: false,
        reversal_rule: false,
        ..KalmanKnobs::CHROMIUM
    };
    BaselineSettings { kalman: rules_off, ..settings(BaselineKind::Kalman) }
}

/// Pen samples every 5 ms from t = 0 on the motion `pen`.
fn sampled(seconds: f64, pen: impl Fn(f64) -> [f64; 2]) -> Vec<PathSample> {
    (0..(seconds / 0.005) as u32)
        .map(|i| {
            let t_s = f64::from(i) * 0.005;
            let [x_m, y_m] = pen(t_s);
            PathSample { t_s, x_m, y_m, contact: true }
        })
        .collect()
}

/// Runs `way` over `pen`; each target with the instant for which it was made, the end of its period.
fn run(way: &mut dyn Baseline, pen: &[PathSample]) -> Vec<(f64, [f64; 2])> {
    let arrivals: Vec<f64> = pen.iter().map(|sample| sample.t_s).collect();
    run_arriving(way, pen, &arrivals)
}

/// The same with the instants at which the samples arrive, whatever their stamps say.
fn run_arriving(way: &mut dyn Baseline, pen: &[PathSample], arrivals: &[f64]) -> Vec<(f64, [f64; 2])> {
    let end_s = arrivals.last().unwrap() + 0.2;
    let mut heard = 0;
    (0..(end_s / PERIOD_S) as u32)
        .filter_map(|k| {
            let now_s = f64::from(k) * PERIOD_S;
            let until = arrivals.partition_point(|arrival_s| *arrival_s <= now_s);
            let arrived = &pen[heard..until];
            heard = until;
            way.target(now_s, arrived).map(|target| (now_s + PERIOD_S, target))
        })
        .collect()
}

/// Targets made for instants in `span`.
fn within(targets: &[(f64, [f64; 2])], span: std::ops::Range<f64>) -> Vec<(f64, [f64; 2])> {
    targets.iter().filter(|(t_s, _)| span.contains(t_s)).copied().collect()
}

fn line(t_s: f64) -> [f64; 2] {
    [0.2 * t_s, -0.1 * t_s]
}

#[test]
fn names_are_read_back_and_unknown_ones_name_all_ways() {
    for kind in BaselineKind::ALL {
        assert_eq!(kind.name().parse(), Ok(kind));
    }
    let error = "ruckig".parse::<BaselineKind>().unwrap_err().to_string();
    assert!(BaselineKind::ALL.iter().all(|kind| error.contains(kind.name())), "{error}");
}

#[test]
fn every_point_of_every_sweep_can_be_built_and_one_is_the_default() {
    for kind in BaselineKind::ALL {
        let settings = settings(kind);
        let points = sweep(kind, &settings);
        assert!((6..=10).contains(&points.len()), "{kind}: {}", points.len());
        assert_eq!(points.iter().filter(|(_, point)| *point == settings).count(), 1, "{kind}");
        for (name, point) in &points {
            assert!(build(kind, point).is_ok(), "{kind} {name}");
        }
    }
}

#[test]
fn a_number_out_of_range_is_refused_by_name_value_and_range() {
    let mut bad = settings(BaselineKind::Kalman);
    bad.kalman.process_mps2 = f64::NAN;
    let error = build(BaselineKind::Kalman, &bad).map(|_| ()).unwrap_err().to_string();
    assert!(error.contains("kalman: kalman.process_mps2 is NaN; legal:"), "{error}");
    // The others ignore it.
    assert!(build(BaselineKind::Otg, &bad).is_ok());
    bad.period_s = 0.0;
    assert!(build(BaselineKind::Otg, &bad).is_err());
}

#[test]
fn nothing_is_aimed_at_before_the_first_sample() {
    for kind in BaselineKind::ALL {
        let mut way = build(kind, &settings(kind)).unwrap();
        assert_eq!(way.target(0.0, &[]), None, "{kind}");
        let sample = PathSample { t_s: 0.001, x_m: 0.01, y_m: 0.02, contact: true };
        let target = way.target(0.002, &[sample]).unwrap();
        assert!((target[0] - 0.01).hypot(target[1] - 0.02) < 1e-12, "{kind}: {target:?}");
    }
}

#[test]
fn predicting_ways_are_on_the_pen_a_dead_time_ahead_in_constant_velocity() {
    for kind in [BaselineKind::Otg, BaselineKind::Kalman] {
        let mut settings = plain_kalman();
        settings.otg = OtgKnobs { intercept: true, horizon_max_s: f64::INFINITY, ..settings.otg };
        let targets = run(&mut *build(kind, &settings).unwrap(), &sampled(2.0, line));
        for (t_s, target) in within(&targets, 1.5..1.99) {
            let pen = line(t_s + DEAD_S);
            let error = (target[0] - pen[0]).hypot(target[1] - pen[1]);
            assert!(error < 2e-6, "{kind} at {t_s}: {error}");
        }
    }
}

#[test]
fn generator_that_does_not_intercept_arrives_late_at_a_moving_pen() {
    let limits = Limits { velocity_mps: 1.0, acceleration_mps2: 10.0, jerk_mps3: 1000.0 };
    let error_after_half_a_second = |intercept: bool| {
        let mut settings = BaselineSettings { limits, ..settings(BaselineKind::Otg) };
        settings.otg = OtgKnobs { intercept, horizon_max_s: f64::INFINITY, ..settings.otg };
        let targets = run(&mut *build(BaselineKind::Otg, &settings).unwrap(), &sampled(2.0, line));
        let (t_s, target) = within(&targets, 0.499..0.5011)[0];
        (target[0] - line(t_s + DEAD_S)[0]).abs()
    };
    let [late, met] = [false, true].map(error_after_half_a_second);
    assert!(late > 1e-4 && met < 1e-9, "{late:e} {met:e}");
}

#[test]
fn kalman_is_exact_in_constant_acceleration_once_converged() {
    let pen = |t: f64| [0.3 * t - 0.5 * t * t, 0.1 + 0.4 * t * t];
    let targets = run(&mut *build(BaselineKind::Kalman, &plain_kalman()).unwrap(), &sampled(2.0, pen));
    for (t_s, target) in within(&targets, 1.0..1.99) {
        let pen = pen(t_s + DEAD_S);
        let error = (target[0] - pen[0]).hypot(target[1] - pen[1]);
        assert!(error < 1e-7, "{t_s}: {error}");
    }
}

#[test]
fn kalman_does_not_care_for_the_unit_of_length() {
    let pen = |t: f64| [0.01 * (9.0 * t).sin(), 0.01 * (7.0 * t).cos()];
    let large = sampled(1.0, |t| pen(t).map(|x| 8.0 * x));
    let small = plain_kalman();
    let scaled = small.for_height(0.8);
    let small = run(&mut *build(BaselineKind::Kalman, &small).unwrap(), &sampled(1.0, pen));
    let large = run(&mut *build(BaselineKind::Kalman, &scaled).unwrap(), &large);
    for ((_, a), (_, b)) in small.iter().zip(&large) {
        assert!((8.0 * a[0] - b[0]).hypot(8.0 * a[1] - b[1]) < 1e-9);
    }
}

#[test]
fn reversal_rule_draws_no_prediction_that_turns_back() {
    // Brakes hard: 30 ms ahead it would run backwards.
    let pen = |t: f64| [1.0 * t - 2.0 * t * t, 0.0];
    let samples: Vec<_> = sampled(0.2501, pen);
    let without = plain_kalman();
    let mut with = without;
    with.kalman.reversal_rule = true;
    let last = |settings: &BaselineSettings| {
        let targets = run(&mut *build(BaselineKind::Kalman, settings).unwrap(), &samples);
        within(&targets, 0.2479..0.2481)[0].1[0]
    };
    let newest = samples.last().unwrap().x_m;
    assert_eq!(last(&with), newest);
    assert!(last(&without) < newest - 1e-4);
}

#[test]
fn one_euro_lags_in_constant_velocity_by_its_time_constant() {
    let knobs = OneEuroKnobs { min_cutoff_hz: 2.0, beta_hz_per_mps: 0.0, speed_cutoff_hz: 1.0 };
    let settings =
        BaselineSettings { one_euro: knobs, feed: Feed::Samples, ..settings(BaselineKind::ServojGello) };
    let targets = run(&mut *build(BaselineKind::ServojGello, &settings).unwrap(), &sampled(3.0, line));
    let tau_s = 1.0 / (std::f64::consts::TAU * 2.0);
    // Right behind a sample: the one at 2.5 s arrives in the period that begins there.
    let (_, target) = within(&targets, 2.5019..2.5021)[0];
    assert!((target[0] - line(2.5 - tau_s)[0]).abs() < 1e-9, "{target:?}");
}

#[test]
fn one_euro_opens_with_speed_to_the_lag_its_equations_give() {
    let knobs = OneEuroKnobs { min_cutoff_hz: 1.0, beta_hz_per_mps: 20.0, speed_cutoff_hz: 1.0 };
    let mut filter = OneEuro::new(knobs);
    let (te, v) = (0.005, 0.3);
    let mut last = 0.0;
    for k in 0..4000 {
        last = v * f64::from(k) * te - filter.step(te, [v * f64::from(k) * te, 0.0])[0];
    }
    // In the steady state lag e = τv and, by the appendix, speed (e + vTe)/Te; τ = 1/(2π(fmin + β·speed)).
    let speed = (last + v * te) / te;
    let tau = 1.0 / (std::f64::consts::TAU * (1.0 + 20.0 * speed));
    assert!((last - tau * v).abs() < 1e-9, "{last} {}", tau * v);
    assert!(last < 0.1 * v / std::f64::consts::TAU);
}

#[test]
fn one_euro_at_rest_converges_and_weakens_noise() {
    let knobs = OneEuroKnobs { min_cutoff_hz: 1.0, beta_hz_per_mps: 0.0, speed_cutoff_hz: 1.0 };
    let mut filter = OneEuro::new(knobs);
    filter.step(0.005, [0.01, 0.0]);
    let mut farthest = 0.0_f64;
    for k in 0..4000 {
        let jitter = if k % 2 == 0 { 1e-4 } else { -1e-4 };
        let [x, _] = filter.step(0.005, [0.02 + jitter, 0.0]);
        if k > 2000 {
            farthest = farthest.max((x - 0.02).abs());
        }
    }
    // α = 0.0305 at 1 Hz and 200 Hz; an alternating input passes with gain α/(2−α).
    assert!(farthest < 1.7e-6, "{farthest}");
}

#[test]
fn soft_servo_lags_by_its_look_ahead_and_does_not_overshoot() {
    for look_ahead_s in [0.03, 0.1, 0.2] {
        let knobs = ServoKnobs { look_ahead_s, gain: 300.0 };
        let mut servo = SoftServo::new(PERIOD_S, knobs);
        let mut x = 0.0;
        for k in 0..2000 {
            x = servo.step([0.5 * f64::from(k) * PERIOD_S, 0.0])[0];
        }
        assert!((0.5 * (1999.0 * PERIOD_S - look_ahead_s) - x).abs() < 1e-9, "{look_ahead_s}: {x}");
        let mut servo = SoftServo::new(PERIOD_S, knobs);
        servo.step([0.0; 2]);
        let highest = (0..2000).map(|_| servo.step([0.01, 0.0])[0]).fold(0.0, f64::max);
        assert!(highest <= 0.01 + 1e-12 && highest > 0.01 - 1e-9, "{highest}");
        assert_eq!(servo.step([f64::NAN, f64::INFINITY]).map(f64::is_finite), [true; 2]);
    }
}

#[test]
fn generator_never_exceeds_its_limits_and_arrives() {
    let limits = Limits { velocity_mps: 0.5, acceleration_mps2: 5.0, jerk_mps3: 200.0 };
    let mut settings = BaselineSettings { limits, ..settings(BaselineKind::Otg) };
    settings.otg = OtgKnobs { target_acceleration: true, acceleration_share: 1.0, ..settings.otg };
    let mut way = OtgWay::new(&settings);
    // A jump of 0.1 m, a fast circle that the limits cannot follow, a dart, then rest.
    let pen = |t: f64| match t {
        t if t < 0.3 => [0.0, 0.0],
        t if t < 1.0 => [0.1, 0.0],
        t if t < 2.0 => [0.1 * (30.0 * t).cos(), 0.1 * (30.0 * t).sin()],
        t if t < 2.2 => [3.0 * (t - 2.0), -0.1],
        _ => [0.07, 0.03],
    };
    let samples = sampled(5.0, pen);
    let mut rest = &samples[..];
    let mut before = way.state();
    for k in 0..2500 {
        let now_s = f64::from(k) * PERIOD_S;
        let due = rest.iter().take_while(|sample| sample.t_s <= now_s).count();
        let (arrived, later) = rest.split_at(due);
        rest = later;
        way.target(now_s, arrived);
        let state = way.state();
        if k > 0 {
            for (now, before) in state.iter().zip(&before) {
                assert!(now.velocity.abs() <= 0.5 + 1e-9, "{now_s}: {now:?}");
                assert!(now.acceleration.abs() <= 5.0 + 1e-9, "{now_s}: {now:?}");
                let jerk = (now.acceleration - before.acceleration) / PERIOD_S;
                assert!(jerk.abs() <= 200.0 + 1e-6, "{now_s}: {jerk}");
                assert!((now.position - before.position).abs() <= 0.5 * PERIOD_S + 1e-9);
            }
        }
        before = state;
    }
    let [x, y] = way.state();
    assert!((x.position - 0.07).abs() < 1e-6 && (y.position - 0.03).abs() < 1e-6, "{x:?} {y:?}");
    assert!(x.velocity.abs() < 1e-6 && y.velocity.abs() < 1e-6);
    assert!(way.failures() <= 50, "{} of 2500 periods without a plan", way.failures());
}

#[test]
fn rubbish_and_gaps_leave_every_target_finite_and_the_way_recovers() {
    for kind in BaselineKind::ALL {
        let mut samples = sampled(3.0, |t| [0.03 * (8.0 * t).sin(), 0.02 * (5.0 * t).cos()]);
        samples.retain(|s| !(1.0..1.3).contains(&s.t_s));
        let stop = *samples.last().unwrap();
        samples.extend((1..200).map(|i| PathSample { t_s: stop.t_s + f64::from(i) * 0.005, ..stop }));
        let arrivals: Vec<f64> = samples.iter().map(|sample| sample.t_s).collect();
        for (k, bad) in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY].into_iter().cycle().take(60).enumerate()
        {
            samples[k * 5 + 3].x_m = bad;
        }
        samples[40].t_s = f64::NAN;
        samples[41].t_s = 1e9;
        samples[50].t_s = -3.0;
        let mut way = build(kind, &settings(kind)).unwrap();
        let targets = run_arriving(&mut *way, &samples, &arrivals);
        assert!(targets.len() > 1900, "{kind}");
        for (t_s, target) in &targets {
            // The pen stays within 4 cm; a prediction over 50 ms at its speed adds a few more.
            assert!(target.iter().all(|x| x.abs() < 0.2), "{kind} at {t_s}: {target:?}");
        }
        let (_, last) = targets.last().unwrap();
        assert!((last[0] - stop.x_m).hypot(last[1] - stop.y_m) < 1e-3, "{kind}: {last:?}");
    }
}

#[test]
fn same_pen_gives_the_same_targets_bit_for_bit() {
    let samples = sampled(1.0, |t| [0.03 * (8.0 * t).sin(), 0.02 * (5.0 * t * t).cos()]);
    for kind in BaselineKind::ALL {
        let runs = [0, 1].map(|_| run(&mut *build(kind, &settings(kind)).unwrap(), &samples));
        assert_eq!(runs[0], runs[1], "{kind}");
    }
}
