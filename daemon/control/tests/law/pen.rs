//! The pen grid: interpolation worked by hand, jumps and glitches, hostile streams, the speed scale.

use foretrace_control::pen::{
    GridStep, Motion, PenReading, PenRejection, PenSettings, PenTracker, Receipt, STEP_QUEUE_CAPACITY,
    SpeedScale, SpeedScaleSettings, TARGET_RMS,
};
use foretrace_control::units::Stamp;
use proptest::prelude::*;
use rand::SeedableRng as _;
use rand_pcg::Pcg64;

const MS: u64 = 1_000_000;

fn tracker() -> PenTracker {
    PenTracker::new(PenSettings::default()).unwrap()
}

fn reading(ms: f64, x: f64, y: f64) -> PenReading {
    PenReading::new(Stamp((ms * 1e6) as u64), [x, y], true)
}

fn feed(tracker: &mut PenTracker, reading: PenReading) -> Receipt {
    tracker.ingest(reading.stamp, &reading)
}

fn drain(tracker: &mut PenTracker) -> Vec<GridStep> {
    std::iter::from_fn(|| tracker.next_step()).collect()
}

#[test]
fn grid_points_are_absolute_and_interpolated_on_stamps() {
    let mut pen = tracker();
    // Samples at 1004, 1007, 1012, 1033 ms; grid points at 1010, 1020, 1030 ms are indices 101, 102, 103.
    for (ms, x) in [(1004.0, 0.0), (1007.0, 0.003), (1012.0, 0.008), (1033.0, 0.050)] {
        assert_eq!(feed(&mut pen, reading(ms, x, 1.0 - x)), Receipt::Accepted);
    }
    let steps = drain(&mut pen);
    assert_eq!(steps.iter().map(|s| s.index).collect::<Vec<_>>(), [101, 102, 103]);
    // 0.003 + 3/5·0.005; then 0.008 + 8/21·0.042 and 0.008 + 18/21·0.042.
    for (step, x) in steps.iter().zip([0.006, 0.024, 0.044]) {
        assert!((step.position[0] - x).abs() < 1e-15, "{step:?}");
        assert!((step.position[1] - (1.0 - x)).abs() < 1e-15, "{step:?}");
    }
    assert_eq!(steps[0].motion, Motion::Start);
    assert_eq!(steps[0].displacement, [0.0; 2]);
    assert_eq!(steps[1].motion, Motion::Continues);
    assert!((steps[1].displacement[0] - 0.018).abs() < 1e-15);
}

#[test]
fn a_grid_point_closes_with_the_sample_on_it_and_not_before() {
    let mut pen = tracker();
    feed(&mut pen, reading(995.0, 0.0, 0.0));
    feed(&mut pen, reading(999.999, 0.01, 0.0));
    assert_eq!(pen.waiting(), 0);
    feed(&mut pen, reading(1000.0, 0.01, 0.0));
    let step = pen.next_step().unwrap();
    assert_eq!((step.index, step.position), (100, [0.01, 0.0]));
    // A first sample exactly on the grid closes its own point.
    let mut pen = tracker();
    feed(&mut pen, reading(1000.0, 0.25, 0.0));
    assert_eq!(pen.next_step().unwrap().position, [0.25, 0.0]);
}

#[test]
fn later_samples_never_change_an_earlier_grid_point() {
    let path = |tail: f64| {
        let mut pen = tracker();
        for i in 0..20 {
            let x = if i < 15 { 0.001 * f64::from(i) } else { tail };
            feed(&mut pen, reading(1000.0 + 4.0 * f64::from(i), x, 0.0));
        }
        drain(&mut pen)
    };
    let (one, other) = (path(0.015), path(0.020));
    let same = one.iter().zip(&other).take_while(|(a, b)| a == b).count();
    // Samples differ from 1060 ms on; the points up to 1050 ms are closed by samples up to 1052 ms.
    assert_eq!(same, 6);
}

#[test]
fn a_long_gap_restarts_the_grid_without_inventing_steps() {
    let mut pen = tracker();
    feed(&mut pen, reading(1000.0, 0.0, 0.0));
    feed(&mut pen, reading(1010.0, 0.001, 0.0));
    feed(&mut pen, reading(600_000_000.0, 0.3, 0.3));
    feed(&mut pen, reading(600_000_010.0, 0.301, 0.3));
    let steps = drain(&mut pen);
    let motions: Vec<_> = steps.iter().map(|s| s.motion).collect();
    assert_eq!(motions, [Motion::Start, Motion::Continues, Motion::Start, Motion::Continues]);
    assert_eq!(steps[2].displacement, [0.0; 2]);
    assert_eq!(pen.counters().restarts, 2);
}

#[test]
fn a_grid_that_begins_on_a_sample_has_its_index_and_place() {
    let mut pen = tracker();
    let begin = PenReading { contact: false, ..reading(1230.0, 0.02, -0.01) };
    assert_eq!(feed(&mut pen, begin), Receipt::Accepted);
    let first = GridStep { index: 123, position: [0.02, -0.01], contact: false, ..GridStep::default() };
    assert_eq!(drain(&mut pen), [GridStep { motion: Motion::Start, ..first }]);
}

#[test]
fn the_time_since_the_pen_touched_or_left_the_paper_is_on_the_grid() {
    let mut pen = tracker();
    // Down for 30 ms, hovering for 40 ms, down again; a gap, and a jump.
    let contact = |step: u32| !(4..8).contains(&step);
    for step in 0..12_u32 {
        let at = reading(f64::from(step) * 10.0 + 1000.0, 0.001 * f64::from(step), 0.0);
        assert_eq!(feed(&mut pen, PenReading { contact: contact(step), ..at }), Receipt::Accepted);
    }
    let seen: Vec<_> = drain(&mut pen).iter().map(|s| (s.contact, s.contact_steps)).collect();
    let expected: Vec<_> =
        (0..12_u32).map(|step| (contact(step), if step < 4 { step } else { step % 4 })).collect();
    assert_eq!(seen, expected);
    // A gap begins anew, and so does a jump that two samples confirm.
    feed(&mut pen, reading(1500.0, 0.0, 0.0));
    feed(&mut pen, reading(1510.0, 0.001, 0.0));
    feed(&mut pen, reading(1520.0, 0.5, 0.0));
    feed(&mut pen, reading(1530.0, 0.501, 0.0));
    feed(&mut pen, reading(1540.0, 0.502, 0.0));
    let seen: Vec<_> = drain(&mut pen).iter().map(|s| (s.motion, s.contact_steps)).collect();
    let jump = seen.iter().rposition(|(motion, _)| *motion == Motion::Jump).unwrap();
    assert_eq!(seen[0], (Motion::Start, 0));
    assert_eq!(seen[1], (Motion::Continues, 1));
    assert_eq!(seen[jump].1, 0, "{seen:?}");
    assert_eq!(seen.last(), Some(&(Motion::Continues, (seen.len() - 1 - jump) as u32)), "{seen:?}");
}

#[test]
fn a_single_glitch_costs_nothing_but_its_own_sample() {
    let mut with = tracker();
    let mut without = tracker();
    for i in 0..40 {
        let sample = reading(1000.0 + 5.0 * f64::from(i), 0.001 * f64::from(i), 0.0);
        feed(&mut with, sample);
        feed(&mut without, sample);
        if i == 20 {
            let glitch = reading(1000.0 + 5.0 * f64::from(i) + 2.0, 0.9, -0.9);
            assert_eq!(feed(&mut with, glitch), Receipt::Rejected(PenRejection::Outlier));
        }
    }
    assert_eq!(drain(&mut with), drain(&mut without));
    assert_eq!((with.counters().outliers, with.counters().jumps), (1, 0));
}

/// The first sample of a jump is refused, so that the second one is twice as long after the last accepted
/// one.
#[test]
fn a_jump_that_could_be_motion_by_its_second_sample_is_a_jump() {
    let gate_mps = PenSettings::default().max_speed_mps;
    for jump_m in [0.021, 0.025, 0.03, 0.035, 0.039] {
        assert!((1.0..2.0).contains(&(jump_m / (0.005 * gate_mps))));
        let mut pen = tracker();
        let there = |i: i32| if i < 21 { 0.0 } else { jump_m };
        let sample = |i: i32| reading(1000.0 + 5.0 * f64::from(i), 0.001 * f64::from(i) - there(i), there(i));
        let receipts: Vec<_> = (0..40).map(|i| feed(&mut pen, sample(i))).collect();
        let refused = receipts.iter().filter(|receipt| **receipt != Receipt::Accepted).count();
        assert_eq!((refused, pen.counters().outliers, pen.counters().jumps), (1, 1, 1), "{jump_m}");
        let farthest = drain(&mut pen)
            .iter()
            .filter(|step| step.motion == Motion::Continues)
            .map(|step| step.displacement[0].hypot(step.displacement[1]))
            .fold(0.0, f64::max);
        assert!((farthest - 0.002).abs() < 1e-9, "{jump_m}: {farthest} m in a step");
    }
}

#[test]
fn a_fast_pen_with_one_stamp_too_early_does_not_jump() {
    for speed_mps in [1.7, 2.0, 3.0, 3.9] {
        for early_ms in [3.0, 4.0, 4.9] {
            let mut pen = tracker();
            let mut refused = 0;
            for i in 0..40 {
                let true_ms = 5.0 * f64::from(i);
                let stamp_ms = 1000.0 + true_ms - if i == 20 { early_ms } else { 0.0 };
                let sample = reading(stamp_ms, 0.001 * speed_mps * true_ms - 0.4, 0.0);
                refused += u32::from(feed(&mut pen, sample) != Receipt::Accepted);
            }
            // Otherwise the case was not tested.
            assert_eq!(refused, 1, "{speed_mps} m/s, {early_ms} ms");
            assert_eq!(pen.counters().jumps, 0, "{speed_mps} m/s, {early_ms} ms");
        }
    }
}

#[test]
fn a_real_jump_is_followed_after_one_sample_and_is_not_motion() {
    let mut pen = tracker();
    for i in 0..10 {
        feed(&mut pen, reading(1000.0 + 5.0 * f64::from(i), 0.0, 0.0));
    }
    drain(&mut pen);
    let elsewhere = |i: i32| reading(1000.0 + 5.0 * f64::from(i), 0.5, 0.001 * f64::from(i));
    assert_eq!(feed(&mut pen, elsewhere(10)), Receipt::Rejected(PenRejection::Outlier));
    for i in 11..20 {
        assert_eq!(feed(&mut pen, elsewhere(i)), Receipt::Accepted);
    }
    let steps = drain(&mut pen);
    // The jump spans 1045 to 1055 ms: the point at 1050 and, for its part after 1050, the one at 1060 are no
    // motion.
    let motions: Vec<_> = steps.iter().map(|s| (s.index, s.motion)).collect();
    assert_eq!(motions[..3], [(105, Motion::Jump), (106, Motion::Jump), (107, Motion::Continues)]);
    assert!(steps.iter().filter(|s| s.motion == Motion::Continues).all(|s| s.displacement[0].abs() < 1e-12));
    assert_eq!(pen.counters().jumps, 1);
}

#[test]
fn microsecond_bursts_are_not_taken_for_speed() {
    let mut pen = tracker();
    feed(&mut pen, reading(1000.0, 0.0, 0.0));
    assert_eq!(feed(&mut pen, reading(1000.001, 0.0002, 0.0)), Receipt::Accepted);
}

#[test]
fn contact_between_pen_down_and_pen_up_samples_is_no_contact() {
    let mut pen = tracker();
    for (ms, contact) in [(1005.0, true), (1015.0, false), (1030.0, true)] {
        feed(&mut pen, PenReading { contact, ..reading(ms, 0.0, 0.0) });
    }
    let contacts: Vec<_> = drain(&mut pen).iter().map(|s| s.contact).collect();
    assert_eq!(contacts, [false, false, true]);
}

#[test]
fn each_fault_has_its_own_name_and_counter() {
    use PenRejection::{FromFuture, NonFinite, OutOfRange, Repeat, TimeBackwards};
    let mut pen = tracker();
    let now = Stamp(1000 * MS);
    let at = |stamp: u64, x: f64| PenReading::new(Stamp(stamp), [x, 0.0], true);
    assert_eq!(pen.ingest(now, &at(1000 * MS, 0.0)), Receipt::Accepted);
    for (bad, why) in [
        (at(1001 * MS, f64::NAN), NonFinite),
        (at(1001 * MS, f64::NEG_INFINITY), NonFinite),
        (at(1001 * MS, 1e300), OutOfRange),
        (at(1021 * MS, 0.0), FromFuture),
        (at(u64::MAX, 0.0), FromFuture),
        (at(1000 * MS, 0.1), Repeat),
        (at(999 * MS, 0.0), TimeBackwards),
        (at(0, 0.0), TimeBackwards),
    ] {
        assert_eq!(pen.ingest(now, &bad), Receipt::Rejected(why));
    }
    let counters = pen.counters();
    assert_eq!((counters.received, counters.accepted, counters.rejected()), (9, 1, 8));
    assert_eq!(pen.newest().unwrap().position, [0.0, 0.0]);
    assert_eq!(pen.age_ns(Stamp(1007 * MS)), Some(7 * MS));
    assert_eq!(pen.age_ns(Stamp(0)), Some(0));
}

#[test]
fn steps_nobody_pulls_are_counted_and_what_follows_them_starts_anew() {
    let mut pen = tracker();
    let total = STEP_QUEUE_CAPACITY as u64 + 10;
    for i in 0..total {
        feed(&mut pen, reading(1000.0 + 10.0 * i as f64, 0.001 * i as f64, 0.0));
    }
    let steps = drain(&mut pen);
    assert_eq!(steps.len(), STEP_QUEUE_CAPACITY);
    assert_eq!(pen.counters().overwritten, 10);
    assert_eq!((steps[0].index, steps[0].motion, steps[0].displacement), (110, Motion::Start, [0.0; 2]));
    assert!(steps[1..].iter().all(|s| s.motion == Motion::Continues));
}

#[test]
fn settings_out_of_bounds_are_refused() {
    let good = PenSettings::default();
    for bad in [
        PenSettings { step_ns: 0, ..good },
        PenSettings { max_gap_ns: 0, ..good },
        PenSettings { max_gap_ns: u64::MAX, ..good },
        PenSettings { max_future_ns: u64::MAX, ..good },
        PenSettings { max_speed_mps: f64::NAN, ..good },
        PenSettings { max_speed_mps: 0.0, ..good },
        PenSettings { min_interval_ns: 0, ..good },
        PenSettings { position_min_m: [0.0, 2.0], ..good },
        PenSettings { position_max_m: [f64::INFINITY, 1.0], ..good },
    ] {
        assert!(PenTracker::new(bad).is_err(), "{bad:?}");
    }
}

fn hostile_number() -> impl Strategy<Value = f64> {
    prop_oneof![
        6 => -0.2..0.2_f64,
        1 => any::<f64>(),
        1 => prop_oneof![Just(f64::NAN), Just(f64::INFINITY), Just(-f64::INFINITY), Just(f64::MAX),
            Just(-0.0)],
    ]
}

/// (advance of the clock, offset of the stamp against it) \[ns\].
fn hostile_times() -> impl Strategy<Value = (u64, i64)> {
    (
        prop_oneof![8 => 0..8 * MS, 1 => 0..500 * MS, 1 => any::<u64>()],
        prop_oneof![8 => -(6 * MS as i64)..0, 1 => -(200 * MS as i64)..(40 * MS as i64), 1 => any::<i64>()],
    )
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 512, failure_persistence: None, ..ProptestConfig::default() })]
    #[test]
    fn hostile_streams_leave_a_sound_grid_and_counters_that_add_up(
        stream in proptest::collection::vec((hostile_times(), hostile_number(), hostile_number(),
            any::<bool>(), any::<bool>()), 1..400)
    ) {
        let mut pen = tracker();
        let mut now = 1000 * MS;
        let mut newest_index = None;
        for ((advance, offset), x, y, contact, pull) in stream {
            now = now.saturating_add(advance);
            let stamp = Stamp(now.saturating_add_signed(offset));
            pen.ingest(Stamp(now), &PenReading::new(stamp, [x, y], contact));
            let counters = pen.counters();
            prop_assert_eq!(counters.received, counters.accepted + counters.rejected());
            prop_assert!(pen.waiting() <= STEP_QUEUE_CAPACITY);
            if pull {
                while let Some(step) = pen.next_step() {
                    prop_assert!(step.position.iter().all(|p| p.abs() <= 1.0));
                    prop_assert!(step.displacement.iter().all(|d| d.is_finite()));
                    // Indices rise; ordinary motion means the very next one, and no more than the gate
                    // allows.
                    prop_assert!(newest_index.is_none_or(|newest| step.index > newest));
                    if step.motion == Motion::Continues {
                        prop_assert_eq!(Some(step.index), newest_index.map(|newest: u64| newest + 1));
                    }
                    newest_index = Some(step.index);
                }
            }
        }
    }

    #[test]
    fn normalised_motion_does_not_depend_on_the_unit_of_length(
        path in proptest::collection::vec((-1.0..1.0_f64, -1.0..1.0_f64), 1..300), shift in -6..7_i32
    ) {
        // Powers of two keep the arithmetic exact, so the streams must agree to the last bit.
        let unit = 2.0_f64.powi(shift);
        let settings = SpeedScaleSettings::default();
        let scaled = SpeedScaleSettings {
            initial_m: settings.initial_m * unit,
            min_m: settings.min_m * unit,
            max_m: settings.max_m * unit,
            still_m: settings.still_m * unit,
            ..settings
        };
        let (mut one, mut other) = (SpeedScale::new(settings).unwrap(), SpeedScale::new(scaled).unwrap());
        for (index, (x, y)) in path.into_iter().enumerate() {
            let displacement = [x * 1e-3, y * 1e-3];
            let step = GridStep {
                index: index as u64, position: [0.0; 2], displacement, motion: Motion::Continues,
                    contact: true,
                ..GridStep::default()
            };
            let in_other = displacement.map(|d| d * unit);
            one.observe(&step);
            other.observe(&GridStep { displacement: in_other, ..step });
            prop_assert_eq!(one.normalise(displacement), other.normalise(in_other));
        }
    }
}

#[test]
fn a_step_tells_its_first_half_and_the_sample_beyond_it() {
    let mut rng = Pcg64::seed_from_u64(3);
    let mut stamps = vec![1_003_000_000_u64];
    for _ in 0..300 {
        // From several samples per step to several steps per sample.
        stamps.push(stamps.last().unwrap() + rng.random_range(1_000_000..30_000_000));
    }
    let at = |stamp: u64| {
        let t = (stamp - 1_000_000_000) as f64 * 1e-9;
        [0.02 * (3.0 * t).sin(), 0.02 * (5.0 * t).cos()]
    };
    // Where a reader of the samples would draw the pen.
    let drawn = |stamp: u64| {
        let after = stamps.partition_point(|other| *other < stamp);
        let (from, to) = (stamps[after - 1], stamps[after]);
        let part = (stamp - from) as f64 / (to - from) as f64;
        let (a, b) = (at(from), at(to));
        [0, 1].map(|axis| a[axis] + part * (b[axis] - a[axis]))
    };
    let near = |a: [f64; 2], b: [f64; 2]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-12);
    let mut pen = PenTracker::new(PenSettings::default()).unwrap();
    let mut steps = 0;
    for stamp in &stamps {
        let reading = PenReading::new(Stamp(*stamp), at(*stamp), true);
        assert_eq!(feed(&mut pen, reading), Receipt::Accepted);
        let closed = drain(&mut pen);
        for (place, step) in closed.iter().enumerate() {
            let end = step.index * 10 * MS;
            let newest = place + 1 == closed.len();
            let [ahead_ns, x, y] = [(stamp - end) as f64, at(*stamp)[0], at(*stamp)[1]];
            let beyond = [x - step.position[0], y - step.position[1]];
            let (wanted, wanted_ns) = if newest { (beyond, ahead_ns) } else { ([0.0; 2], 0.0) };
            assert!(near(step.ahead, wanted) && step.ahead_ns as f64 == wanted_ns, "{step:?}");
            if step.motion == Motion::Start {
                assert_eq!(step.half, [0.0; 2]);
                continue;
            }
            let (before, middle) = (drawn(end - 10 * MS), drawn(end - 5 * MS));
            assert!(near(step.half, [middle[0] - before[0], middle[1] - before[1]]), "{step:?}");
            steps += 1;
        }
    }
    assert!(steps > 300);
}

fn moving(index: u64, amplitude: f64) -> GridStep {
    let phase = index as f64 * 0.7;
    let displacement = [amplitude * phase.cos(), amplitude * (1.3 * phase).sin()];
    GridStep {
        index,
        position: [0.0; 2],
        displacement,
        motion: Motion::Continues,
        contact: true,
        ..GridStep::default()
    }
}

fn settled(scale: &mut SpeedScale, amplitude: f64, steps: u64) -> f64 {
    let (mut sum, mut count) = (0.0, 0.0);
    for index in 0..steps {
        let step = moving(index, amplitude);
        scale.observe(&step);
        if index > steps / 2 {
            let [x, y] = scale.normalise(step.displacement);
            sum += x * x + y * y;
            count += 2.0;
        }
    }
    f64::sqrt(sum / count)
}

#[test]
fn scale_brings_any_speed_to_the_target_rms() {
    // Amplitudes from 20 µm to 20 mm per step, from the same initial value: a thousandfold range.
    for amplitude in [2e-5, 2e-4, 2e-3, 2e-2] {
        let mut scale = SpeedScale::new(SpeedScaleSettings::default()).unwrap();
        let rms = settled(&mut scale, amplitude, 12_000);
        assert!((0.8 * TARGET_RMS..1.3 * TARGET_RMS).contains(&rms), "{amplitude} m gives RMS {rms}");
    }
}

#[test]
fn pauses_and_jumps_leave_the_scale_alone() {
    let mut scale = SpeedScale::new(SpeedScaleSettings::default()).unwrap();
    settled(&mut scale, 1e-3, 1000);
    let before = scale.metres_per_unit();
    for index in 0..100_000 {
        scale.observe(&GridStep { displacement: [0.0; 2], ..moving(index, 0.0) });
        scale.observe(&GridStep { displacement: [1e-6, 0.0], ..moving(index, 0.0) });
        scale.observe(&GridStep { motion: Motion::Jump, ..moving(index, 0.5) });
        scale.observe(&GridStep { displacement: [f64::NAN, f64::INFINITY], ..moving(index, 0.0) });
    }
    assert_eq!(scale.metres_per_unit(), before);
    // One large step of ordinary motion: less than 2 %.
    scale.observe(&moving(0, 0.04));
    assert!((scale.metres_per_unit() / before - 1.0).abs() < 0.02);
}

#[test]
fn scale_settings_out_of_bounds_are_refused() {
    let good = SpeedScaleSettings::default();
    for bad in [
        SpeedScaleSettings { initial_m: 0.0, ..good },
        SpeedScaleSettings { initial_m: f64::NAN, ..good },
        SpeedScaleSettings { min_m: 1.0, ..good },
        SpeedScaleSettings { max_m: f64::INFINITY, ..good },
        SpeedScaleSettings { memory_steps: 0.0, ..good },
        SpeedScaleSettings { max_change: f64::NAN, ..good },
    ] {
        assert!(SpeedScale::new(bad).is_err(), "{bad:?}");
    }
}
