//! Stamps in order, the rhythm that they give, and the grid.

use super::*;

fn cadence(steps_ms: &[f64], stated_hz: Option<f64>) -> Cadence {
    Cadence::of(steps_ms.iter().map(|ms| ms * 1e-3).collect(), stated_hz).unwrap()
}

#[test]
fn steps_within_ten_microseconds_are_even_and_a_gap_is_no_step() {
    let even = cadence(&[5.0, 5.009, 4.991, 5.0, 300.0], None);
    assert_eq!((even.rate_hz, even.even), (1.0 / (5.0 * 1e-3), true));
    assert!(!cadence(&[5.0, 5.02, 5.0], None).even);
    // A stated rate holds where it fits, and not where the stamps tell otherwise.
    assert_eq!(cadence(&[7.5, 7.5], Some(133.0)).rate_hz, 133.0);
    assert_eq!(cadence(&[8.0, 8.0], Some(100.0)).rate_hz, 125.0);
    assert_eq!(Cadence::of(vec![0.0, -1.0], None), None);
}

#[test]
fn an_uneven_rate_is_the_mean_and_lost_samples_do_not_lower_it() {
    assert!((cadence(&[8.0, 24.0, 8.0, 24.0], None).rate_hz - 62.5).abs() < 1e-6);
    let lossy: Vec<f64> = (0..50).map(|k| if k % 10 == 3 { 10.0 } else { 5.0 }).collect();
    assert!((cadence(&lossy, None).rate_hz - 200.0).abs() < 1e-6);
    // Whole milliseconds of a device of 133 Hz.
    let whole: Vec<f64> =
        (0..300).map(|k| ((k + 1) as f64 * 7.52).floor() - (k as f64 * 7.52).floor()).collect();
    assert!((cadence(&whole, None).rate_hz - 132.98).abs() < 0.1);
    // Finer than the loop's grid can be, and coarser.
    assert_eq!(cadence(&[0.1, 0.2, 0.1], None).rate_hz, 1000.0);
    // Bursts of events with the frames of a screen between them.
    let bursts = [[1.0, 1.2, 0.8, 13.0]; 3].concat();
    let bursts = cadence(&[bursts, vec![700.0]].concat(), None);
    assert!((bursts.rate_hz - 250.0).abs() < 1e-6 && bursts.gap_s == 0.05, "{bursts:?}");
}

#[test]
fn even_steps_stay_even_however_often_the_pen_is_lifted() {
    let dots = cadence(&[5.0, 5.0, 5.0, 5.0, 5.0, 30.0].repeat(60), None);
    assert_eq!((dots.rate_hz, dots.even, dots.gap_s), (200.0, true, 0.02));
}

#[test]
fn stamps_that_leap_ahead_of_what_follows_are_found() {
    let rising = |from: usize, to: usize| (from..to).map(|k| k as f64);
    let spike: Vec<f64> = rising(0, 5).chain([900.0, 901.0]).chain(rising(5, 40)).collect();
    assert_eq!(leaps_ahead(&spike), [5, 6]);
    let first: Vec<f64> = [1e9].into_iter().chain(rising(0, 5)).collect();
    assert_eq!(leaps_ahead(&first), [0]);
    // One that steps back itself; two recordings, the second shorter or longer.
    for (first, second) in [(20, 10), (10, 20)] {
        let two: Vec<f64> = rising(0, first).chain(rising(0, second)).collect();
        assert_eq!(leaps_ahead(&two), [0; 0], "{first} {second}");
    }
    assert_eq!(leaps_ahead(&[0.0, 5.0, 10.0, 7.0, 15.0]), [0; 0]);
    assert_eq!(leaps_ahead(&[0.0, 5.0, 5.0, 6.0]), [0; 0]);
}

#[test]
fn rows_that_repeat_a_sample_are_no_coarse_clock() {
    let judged = |places: [f64; 6]| {
        let mut judge = StampJudge::default();
        let mut last = [0.0; 2];
        for (x, t_s) in places.into_iter().zip([0.0, 0.0, 0.0, 1.0, 1.0, 1.0]) {
            last = match judge.judge(t_s) {
                StampVerdict::Merge(share) => judge.merge(last, [x, 0.0], share),
                _ => [x, 0.0],
            };
        }
        judge.coarse()
    };
    assert_eq!(judged([1.0, 1.0, 1.0, 2.0, 2.0, 2.0]), None);
    let coarse = judged([1.0, 2.0, 3.0, 4.0, 5.0, 6.0]).unwrap();
    assert!(coarse.starts_with("4 of 6 samples have the stamp of the one before"), "{coarse}");
}

#[test]
fn equal_stamps_are_merged_and_steps_back_left_out() {
    let mut judge = StampJudge::default();
    let verdicts = [0.0, 1.0, 1.0, 1.0, 0.5, 2.0].map(|t_s| judge.judge(t_s));
    let share = |n: f64| StampVerdict::Merge(1.0 / n);
    let next = StampVerdict::Next;
    assert_eq!(verdicts, [next, next, share(2.0), share(3.0), StampVerdict::Backwards, next]);
    let [equal, back] = &judge.remarks().unwrap()[..] else { panic!("two remarks") };
    assert_eq!((equal.count, back.count), (2, 1));
    let mut judge = StampJudge::default();
    let _ = [9.0, 1.0, 2.0, 3.0].map(|t_s| judge.judge(t_s));
    assert!(judge.remarks().unwrap_err().starts_with("3 of 4 stamps step back"));
    assert_eq!(merged(merged([0.0, 3.0], [3.0, 3.0], 0.5), [6.0, 0.0], 1.0 / 3.0), [3.0, 2.0]);
}

#[test]
fn a_line_drawn_at_uneven_times_has_even_steps_on_the_grid() {
    let stamps_s: Vec<f64> = (0..40)
        .scan(0.0, |t, k| {
            let now = *t;
            *t += if k % 3 == 0 { 0.012 } else { 0.004 };
            Some(now + 1.7e9)
        })
        .collect();
    let points: Vec<[f64; 2]> = stamps_s.iter().map(|t| [3e6 * (t - 1.7e9), -50.0 * (t - 1.7e9)]).collect();
    let even = on_grid(&points, &stamps_s, 200.0);
    assert_eq!(even.len(), ((stamps_s[39] - stamps_s[0]) / 0.005) as usize + 1);
    for (k, [x, y]) in even.iter().enumerate() {
        // Stamps of today's seconds are right to a quarter of a microsecond.
        assert!((x - 15e3 * k as f64).abs() < 2.0 && (y + 0.25 * k as f64).abs() < 1e-4, "{k}: {x} {y}");
    }
    assert_eq!(on_grid(&[[1.0, 2.0]], &[5.0], 200.0), [[1.0, 2.0]]);
}

#[cfg(feature = "formats")]
mod strokes {
    use super::*;

    /// Points on a line, stamped as the lists say.
    fn strokes(stamps_s: &[Vec<f64>]) -> Vec<Character> {
        let component = |stamps_s: &Vec<f64>| Component {
            contact: true,
            points: (0..stamps_s.len()).map(|k| [k as f64, 0.0]).collect(),
            stamps_s: stamps_s.clone(),
            ..Component::default()
        };
        vec![Character { components: stamps_s.iter().map(component).collect(), ..Character::default() }]
    }

    fn points(characters: &[Character]) -> Vec<usize> {
        characters.iter().flat_map(|c| &c.components).map(|c| c.points.len()).collect()
    }

    #[test]
    fn points_stay_where_their_stamps_are_no_clock_and_a_rate_is_stated() {
        let whole_seconds: Vec<f64> = (0..400).map(|k| f64::from(k / 200)).collect();
        let falling: Vec<f64> = (0..9).map(|k| -f64::from(k)).collect();
        for stamps_s in [
            vec![vec![0.0; 5], vec![0.0; 3]],
            vec![vec![1.0; 5], vec![4.0; 3]],
            vec![whole_seconds],
            vec![falling],
        ] {
            let mut characters = strokes(&stamps_s);
            let (cadence, told) = settle(&mut characters, Some(200.0)).unwrap().unwrap();
            assert_eq!((cadence.rate_hz, cadence.even), (200.0, true));
            assert_eq!(points(&characters), stamps_s.iter().map(Vec::len).collect::<Vec<_>>());
            assert!(
                characters[0].components.iter().all(|c| c.stamps_s.is_empty() && c.dt_before_s.is_none())
            );
            let [told] = &told[..] else { panic!("{told:?}") };
            assert!(told.what.contains("the rate that the file states counts"), "{told}");
        }
    }

    #[test]
    fn without_a_stated_rate_stamps_that_are_no_clock_are_refused_or_leave_the_points() {
        let mut still = strokes(&[vec![0.0; 5], vec![0.0; 3]]);
        assert_eq!(settle(&mut still, None).unwrap(), None);
        assert_eq!(points(&still), [5, 3]);
        let coarse: Vec<f64> = (0..400).map(|k| f64::from(k / 200)).collect();
        let why = settle(&mut strokes(&[coarse]), None).unwrap_err();
        assert!(why.starts_with("398 of 400 samples have the stamp of the one before"), "{why}");
        let falling = (0..9).map(|k| -f64::from(k)).collect();
        assert!(settle(&mut strokes(&[falling]), None).unwrap_err().starts_with("8 of 9 stamps step back"));
    }

    #[test]
    fn a_stamp_far_ahead_costs_its_own_point_only() {
        let mut stamps_s: Vec<f64> = (0..40).map(|k| f64::from(k) * 0.005).collect();
        stamps_s[7] = 1000.0;
        let mut characters = strokes(&[stamps_s]);
        let (_, told) = settle(&mut characters, None).unwrap().unwrap();
        assert_eq!(points(&characters), [39]);
        let [told] = &told[..] else { panic!("{told:?}") };
        assert!(told.count == 1 && told.what.contains("far ahead"), "{told}");
    }
}
