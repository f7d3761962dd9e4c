//! Pen paths: ink, lifts and gaps, recorded or synthesised.

use super::*;
use crate::data::{Character, Component};
use proptest::prelude::*;

const RATE_HZ: f64 = 200.0;

fn component(contact: bool, dt_before_s: Option<f64>, points: &[[f64; 2]]) -> Component {
    Component { contact, points: points.to_vec(), dt_before_s, ..Component::default() }
}

fn character(label: &str, components: Vec<Component>) -> Character {
    Character { label: label.to_owned(), components, ..Character::default() }
}

/// A character 100 units high, so that one unit becomes 0.3 mm at the default glyph height.
fn bar(x: f64) -> Component {
    let points: Vec<[f64; 2]> = (0..=50).map(|i| [x, f64::from(2 * i)]).collect();
    component(true, None, &points)
}

fn place(characters: &[Character], placement: &Placement) -> (PenPath, Vec<String>) {
    PenPath::from_ink(Ink { characters, rate_hz: RATE_HZ, median_height: 100.0 }, placement).unwrap()
}

#[test]
fn ink_is_scaled_to_the_glyph_height_and_centred() {
    let placement = Placement { centre_m: [0.4, -0.1], ..Placement::default() };
    let (path, _) = place(&[character("l", vec![bar(700.0)])], &placement);
    let [[left, low], [right, high]] = path.bounds_m().unwrap();
    for (got, wanted) in [(left, 0.4), (right, 0.4), (low, -0.115), (high, -0.085)] {
        assert!((got - wanted).abs() < 1e-12, "{got} {wanted}");
    }
    assert_eq!(path.spans, [LabelSpan { label: "l".to_owned(), samples: 0..51 }]);
    assert!((path.duration_s() - 50.0 / RATE_HZ).abs() < 1e-12);
}

#[test]
fn an_unrecorded_lift_becomes_a_hover_of_at_least_three_tenths() {
    let (path, _) = place(&[character("=", vec![bar(0.0), bar(60.0)])], &Placement::default());
    let hover: Vec<&PathSample> = path.samples.iter().filter(|s| !s.contact).collect();
    let (first, last) = (hover[0].t_s, hover[hover.len() - 1].t_s);
    assert!(last - first + 2.0 / RATE_HZ >= 0.3);
    assert!(hover.windows(2).all(|w| (w[1].t_s - w[0].t_s - 1.0 / RATE_HZ).abs() < 1e-9));
    assert_eq!((path.inserted_travels, path.gaps), (1, 0));
    // The pen neither jumps nor stops abruptly where the synthetic motion joins the recorded one.
    let steps: Vec<f64> =
        path.samples.windows(2).map(|w| (w[1].x_m - w[0].x_m).hypot(w[1].y_m - w[0].y_m)).collect();
    assert!(steps.windows(2).all(|s| (s[1] - s[0]).abs() < 0.0003), "{steps:?}");
}

#[test]
fn a_recorded_hover_and_its_repeated_points_stay() {
    let hover = component(false, None, &[[0.0, 100.0], [0.0, 100.0], [5.0, 90.0]]);
    let (path, _) = place(&[character("x", vec![bar(0.0), hover, bar(8.0)])], &Placement::default());
    assert_eq!((path.samples.len(), path.inserted_travels, path.gaps), (51 + 3 + 51, 0, 0));
    assert_eq!(path.samples[51], PathSample { t_s: path.samples[51].t_s, ..path.samples[52] });
}

#[test]
fn a_recorded_gap_is_time_without_samples() {
    let hover = component(false, Some(0.11), &[[0.0, 100.0], [2.0, 100.0]]);
    let (path, _) = place(&[character("x", vec![bar(0.0), hover])], &Placement::default());
    assert!((path.samples[51].t_s - path.samples[50].t_s - 0.11).abs() < 1e-12);
    assert_eq!((path.inserted_travels, path.gaps), (0, 1));
}

#[test]
fn a_gap_between_strokes_without_a_hover_becomes_a_travel_that_lasts_as_long() {
    let late = Component { dt_before_s: Some(1.5), ..bar(20.0) };
    let (path, _) = place(&[character("x", vec![bar(0.0), late])], &Placement::default());
    let [before, after] = [50, path.samples.len() - 51].map(|i| path.samples[i].t_s);
    assert!((after - before - 1.5).abs() < 1e-9, "{}", after - before);
    assert_eq!((path.inserted_travels, path.gaps), (1, 0));
}

#[test]
fn overflowed_gaps_are_shortened() {
    let hover = component(false, Some(1.9e6), &[[0.0, 100.0]]);
    let (path, _) = place(&[character("x", vec![bar(0.0), hover])], &Placement::default());
    assert!(path.duration_s() < 11.0);
}

#[test]
fn dummies_and_hovers_out_of_reach_are_left_out() {
    let dummy = component(false, None, &[[0.0, 0.0]]);
    let far = component(false, None, &[[1e5, 1e5], [1e5, 1e5]]);
    let (path, _) = place(&[character("x", vec![dummy, far, bar(500.0), bar(520.0)])], &Placement::default());
    assert!(path.bounds_m().unwrap()[1][0] < 0.15);
    assert_eq!(path.inserted_travels, 1);
}

#[test]
fn ink_that_does_not_fit_is_skipped_and_named() {
    let tall = component(true, None, &[[0.0, 0.0], [0.0, 5000.0]]);
    let characters = [character("|", vec![tall]), character("l", vec![bar(0.0)])];
    let (path, skipped) = place(&characters, &Placement::default());
    assert_eq!((path.spans.len(), skipped.len()), (1, 1));
    assert!(skipped[0].contains("\"|\"") && skipped[0].contains("1500 mm"), "{skipped:?}");
    let ink = Ink { characters: &characters[..1], rate_hz: RATE_HZ, median_height: 100.0 };
    let error = PenPath::from_ink(ink, &Placement::default()).unwrap_err().to_string();
    assert!(error.contains("1 skipped") && error.contains("0.3 x 0.2 m"), "{error}");
    let ink = Ink { rate_hz: f64::NAN, ..ink };
    assert!(matches!(PenPath::from_ink(ink, &Placement::default()), Err(PathError::NotPositive { .. })));
}

#[test]
fn a_line_goes_on_at_the_left_when_it_is_full() {
    let characters: Vec<Character> = (0..40).map(|_| character("l", vec![bar(3.0)])).collect();
    let placement = Placement { layout: Layout::Line, ..Placement::default() };
    let (path, _) = place(&characters, &placement);
    let starts: Vec<f64> = path.spans.iter().map(|s| path.samples[s.samples.start].x_m).collect();
    assert!((starts[0] + 0.15).abs() < 1e-12 && starts[1] > starts[0]);
    assert!(starts.windows(2).filter(|w| w[1] < w[0]).all(|w| (w[1] + 0.15).abs() < 1e-12));
    assert!(starts.iter().all(|x| x.abs() <= 0.15 + 1e-12));
}

#[test]
fn a_closed_path_cycles_without_a_leap_and_with_rising_times() {
    let path = place(&[character("=", vec![bar(0.0), bar(60.0)])], &Placement::default()).0.closed();
    let samples: Vec<PathSample> = path.cycle().take(3 * path.samples.len()).collect();
    for w in samples.windows(2) {
        assert!((w[1].t_s - w[0].t_s - 1.0 / RATE_HZ).abs() < 1e-9, "{w:?}");
        assert!((w[1].x_m - w[0].x_m).hypot(w[1].y_m - w[0].y_m) < 0.002, "{w:?}");
    }
    assert_eq!(PenPath::from_samples(Vec::new()).cycle().next(), None);
}

#[test]
fn twice_the_speed_is_half_the_time() {
    let (path, _) = place(&[character("l", vec![bar(0.0)])], &Placement::default());
    let fast = path.clone().time_scaled(2.0);
    assert!((fast.duration_s() * 2.0 - path.duration_s()).abs() < 1e-12);
    assert!((fast.rate_hz - 2.0 * RATE_HZ).abs() < 1e-12);
    assert_eq!(path.clone().time_scaled(f64::NAN), path);
}

proptest! {
    #[test]
    fn any_ink_becomes_a_finite_path_with_rising_times(
        strokes in prop::collection::vec(
            (any::<bool>(), prop::option::of(0.0..5.0f64), prop::collection::vec([-300.0..300.0f64,
                -300.0..300.0f64], 1..20)),
            0..6,
        ),
        line: bool,
    ) {
        let components: Vec<Component> = strokes.iter().map(|(c, dt, p)| component(*c, *dt, p)).collect();
        let characters = [character("a", components.clone()), character(" ", vec![]), character("b",
            components)];
        let layout = if line { Layout::Line } else { Layout::Centre };
        let ink = Ink { characters: &characters, rate_hz: RATE_HZ, median_height: 100.0 };
        if let Ok((path, _)) = PenPath::from_ink(ink, &Placement { layout, ..Placement::default() }) {
            prop_assert!(path.samples.windows(2).all(|w| w[1].t_s > w[0].t_s));
            prop_assert!(path.samples.iter().all(|s| s.x_m.abs() < 0.2 && s.y_m.abs() < 0.15));
            prop_assert!(path.spans.iter().all(|s| s.samples.start < s.samples.end
                && s.samples.end <= path.samples.len()));
        }
    }
}
