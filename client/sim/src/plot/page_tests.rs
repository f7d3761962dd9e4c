//! Pictures of a page: well formed, with their figures, and never a panic.

use super::*;
use crate::metrics::ToolSample;
use crate::path::PathSample;

fn pen() -> Vec<PathSample> {
    let at = |i: i32| {
        let t_s = f64::from(i) * 0.005;
        PathSample { t_s, x_m: 0.05 * t_s, y_m: 0.02 * (8.0 * t_s).sin(), contact: i % 100 < 70 }
    };
    (0..400).map(at).collect()
}

fn tool() -> Vec<ToolSample> {
    pen().iter().map(|s| ToolSample { t_s: s.t_s, x_m: s.x_m, y_m: s.y_m + 0.001 }).collect()
}

fn all(values: &[f64]) -> Vec<Option<Picture>> {
    let points: Vec<(f64, f64)> = values.iter().map(|v| (*v, *v)).collect();
    let samples: Vec<PathSample> =
        values.iter().map(|&v| PathSample { t_s: v, x_m: v, y_m: v, contact: v > 0.0 }).collect();
    let tool: Vec<ToolSample> = values.iter().map(|&v| ToolSample { t_s: v, x_m: v, y_m: -v }).collect();
    let traced = Traced { shown: Shown::Ghost, label: "<ghost>", tool: &tool };
    let curve = PageCurve { shown: Shown::Arm, label: "a & b", wide: true, points: &points };
    let bounds = [Bound { at: 1.0, label: "1 > 0" }];
    let panel = CurvePanel { label: "y [mm]", height: 90.0, y: None, curves: &[curve], bounds: &bounds };
    let distribution = Distribution::from_values_us("wake-up", values.iter().copied());
    vec![
        paths("Title & co", "1.5 mm", &samples, &[traced, traced]),
        curves("Title & co", "1.5 mm", "s", &[panel, panel], ("down", &[(0.0, 1.0)])),
        durations("Title & co", "1.5 mm", &[distribution], 2000.0),
        shares("Title & co", "1.5 mm", &[Shares { label: "speed", of_limit: values }]),
    ]
}

/// Reads every event, so that a tag that is not closed or a bare `&` is found.
fn well_formed(svg: &str) {
    let mut reader = quick_xml::Reader::from_str(svg);
    reader.config_mut().check_end_names = true;
    let mut open = 0;
    loop {
        match reader.read_event().unwrap_or_else(|error| panic!("{error} in {svg}")) {
            quick_xml::events::Event::Start(_) => open += 1,
            quick_xml::events::Event::End(_) => open -= 1,
            quick_xml::events::Event::Eof => break,
            _ => {}
        }
    }
    assert_eq!(open, 0, "{svg}");
}

#[test]
fn pictures_are_well_formed_carry_their_figures_and_name_nothing_outside() {
    let mut drawn = all(&(1..400).map(f64::from).collect::<Vec<_>>());
    let traced = Traced { shown: Shown::Arm, label: "arm", tool: &tool() };
    drawn.push(paths("Title & co", "1.5 mm", &pen(), &[traced, traced]));
    for picture in drawn {
        let picture = picture.unwrap();
        for svg in [picture.inline(), picture.standalone()] {
            well_formed(&svg);
            assert!(svg.contains("<title>Title &amp; co</title>") && svg.contains("<desc>1.5 mm</desc>"));
            assert!(!svg.contains("NaN") && !svg.contains("inf") && !svg.contains("href"), "{svg}");
        }
        assert!(!picture.inline().contains("http"));
    }
}

#[test]
fn hostile_data_draws_or_is_nothing_but_never_panics() {
    let odd = [f64::NAN, f64::INFINITY, -f64::INFINITY, 0.0, 0.0, 1e-300, -1e12, 1e300];
    for count in 0..=odd.len() {
        for picture in all(&odd[..count]).into_iter().flatten() {
            well_formed(&picture.standalone());
            assert!(!picture.inline().contains("NaN"), "{}", picture.inline());
        }
    }
    assert!(all(&[]).iter().all(Option::is_none));
    let named = paths("\u{1b}[31m", "a\u{7}b", &pen(), &[]).unwrap().standalone();
    assert!(!named.contains('\u{1b}') && !named.contains('\u{7}'));
}

#[test]
fn ticks_are_round_and_few() {
    let ticks = super::sheet::ticks;
    assert_eq!(ticks((0.0, 10.0), 5.0), [0.0, 2.0, 4.0, 6.0, 8.0, 10.0]);
    assert_eq!(ticks((-0.3, 1.1), 3.0), [0.0, 0.5, 1.0]);
    assert!(ticks((1.0, 1.0), 5.0).is_empty() && ticks((f64::NAN, 1.0), 5.0).is_empty());
    assert!(ticks((-1e300, 1e300), 9.0).len() <= 64);
}
