//! Charts: whole SVG or a refusal, axes with labels, quantiles that count weights.

use super::*;
use crate::metrics::ToolSample;
use crate::path::PathSample;

fn pen() -> Vec<PathSample> {
    (0..400)
        .map(|i| {
            let t_s = f64::from(i) * 0.005;
            PathSample { t_s, x_m: 0.05 * t_s, y_m: 0.02 * (8.0 * t_s).sin(), contact: i % 100 < 70 }
        })
        .collect()
}

fn tool() -> Vec<ToolSample> {
    pen().iter().map(|s| ToolSample { t_s: s.t_s + 0.03, x_m: s.x_m, y_m: s.y_m + 0.001 }).collect()
}

#[test]
fn every_picture_is_whole_svg_with_its_title_and_leaves_no_other_file() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let points: Vec<(f64, f64)> = (0..100).map(|i| (f64::from(i), f64::from(i % 13))).collect();
    let cell = Cell { label: "K", pen: &pen(), tool: &tool() };
    let line = Line { label: "a", points: &points, mark: Mark::Dots };
    letter_grid(&at("0.svg"), "Title & co", "sub", &[cell, cell, cell]).unwrap();
    panels(
        &at("1.svg"),
        "Title & co",
        "",
        "x",
        &[ChartPanel { y_label: "y", y_range: None, lines: &[line] }],
        None,
    )
    .unwrap();
    let bars = Bars { label: "mse", values: vec![Some(2.0), None, Some(1.0)], digits: 2, best: Best::Lowest };
    bar_table(&at("2.svg"), "Title & co", "", &["a", "b", "c"], &[bars]).unwrap();
    let named = [Named { name: "<K>", point: (1.0, -0.5) }, Named { name: "O", point: (2.0, 0.5) }];
    scatter(&at("3.svg"), "Title & co", "", ("x", "y"), &named).unwrap();
    let panel = ChartPanel { y_label: "y", y_range: None, lines: &[line] };
    panels_and_curve(&at("4.svg"), "Title & co", "", ("t", "s"), &[panel, panel], &panel).unwrap();
    panels_and_cells(&at("5.svg"), "Title & co", "", "t", &[panel], &[cell, cell, cell, cell, cell]).unwrap();
    for i in 0..6 {
        let svg = std::fs::read_to_string(at(&format!("{i}.svg"))).unwrap();
        assert!(svg.starts_with("<svg") && svg.trim_end().ends_with("</svg>"), "{i}");
        assert!(svg.contains("<title>Title &amp; co</title>") && svg.contains("<desc>"), "{i}");
        assert!(!svg.contains("NaN") && !svg.contains("inf"), "{i}");
    }
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 6);
}

#[test]
fn hostile_data_draws_or_is_refused_but_never_panics() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("x.svg");
    let odd = [f64::NAN, f64::INFINITY, -f64::INFINITY, 0.0, 0.0, 1e-300, -1e12];
    let points: Vec<(f64, f64)> = odd.iter().map(|&v| (v, v)).collect();
    for count in 0..=odd.len() {
        let line = Line { label: "", points: &points[..count], mark: Mark::Solid };
        let panel = ChartPanel { y_label: "", y_range: None, lines: &[line] };
        let _ = panels(&file, "", "", "", &[panel], None);
        let _ = panels_and_curve(&file, "", "", ("", ""), &[panel], &panel);
        let tool: Vec<_> =
            points[..count].iter().map(|p| ToolSample { t_s: p.0, x_m: p.0, y_m: p.1 }).collect();
        let cell = Cell { label: "", pen: &[], tool: &tool };
        let _ = panels_and_cells(&file, "", "", "", &[panel], &[cell]);
        let values = odd[..count].iter().map(|v| Some(*v)).collect();
        let bars = Bars { label: "", values, digits: 3, best: Best::Highest };
        let _ = bar_table(&file, "", "", &[""; 7][..count], &[bars]);
        let named: Vec<Named<'_>> = points[..count].iter().map(|p| Named { name: "", point: *p }).collect();
        let _ = scatter(&file, "", "", ("", ""), &named);
        let line = LogLine { label: "", points: points[..count].to_vec(), dots: true, marked: Some(count) };
        let panel = LogPanel { title: "", lines: vec![line] };
        for log_y in [false, true] {
            let _ = log_panels(&file, "", "", ("", ""), log_y, std::slice::from_ref(&panel));
        }
    }
    assert!(matches!(panels(&file, "", "", "", &[], None), Err(PlotError::Empty { .. })));
    assert!(matches!(bar_table(&file, "", "", &[], &[]), Err(PlotError::Empty { .. })));
    assert!(matches!(scatter(&file, "", "", ("", ""), &[]), Err(PlotError::Empty { .. })));
    let nowhere = folder.path().join("no/such/folder.svg");
    let line = Line { label: "a", points: &[(0.0, 1.0)], mark: Mark::Solid };
    let panel = ChartPanel { y_label: "", y_range: None, lines: &[line] };
    let unwritten = panels(&nowhere, "", "", "", &[panel], None);
    assert!(matches!(unwritten, Err(PlotError::Writing { .. })), "{unwritten:?}");
}

#[test]
fn a_logarithmic_axis_of_a_decade_is_labelled_more_than_once() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("x.svg");
    let labelled = |points: Vec<(f64, f64)>| {
        let line = LogLine { label: "a", points, dots: true, marked: None };
        log_panels(&file, "t", "", ("x", "y"), true, &[LogPanel { title: "p", lines: vec![line] }]).unwrap();
        let svg = std::fs::read_to_string(&file).unwrap();
        move |label: &str| svg.contains(&format!(">{label}</text>"))
    };
    // No label of the one axis can be taken for one of the other.
    let decade = labelled(vec![(1500.0, 2.1), (6000.0, 19.0)]);
    assert!(["3", "5", "10", "20", "2000", "3000", "5000"].map(decade).iter().all(|there| *there));
    let many = labelled(vec![(1500.0, 1e-9), (6000.0, 5e2)]);
    assert!(["1e-8", "1e-6", "100"].map(&many).iter().all(|there| *there) && !many("1e-7") && !many("5"));
}

#[test]
fn quantiles_count_weights() {
    let d = Distribution { label: String::new(), counts_us: vec![(9.0, 1), (1.0, 98), (4.0, 1)] };
    let got = [0.0, 0.5, 0.98, 0.99, 1.0].map(|q| d.quantile_us(q).unwrap());
    assert_eq!(got, [1.0, 1.0, 1.0, 4.0, 9.0]);
    assert_eq!(Distribution::from_values_us("", []).quantile_us(0.5), None);
}
