//! Curves over time, in panels above each other with one time axis.

use super::sheet::{Frame, Hung, LEFT, LEGEND, Picture, RIGHT, Sheet, Shown, WIDTH};
use crate::plot::canvas::{extent, thinned};

/// Points per curve: more than pixels, so that every peak is kept.
const POINTS_MAX: usize = 2400;

/// One curve.
#[derive(Debug, Clone, Copy)]
pub struct Curve<'a> {
    /// The series it belongs to.
    pub shown: Shown,
    /// For the legend; curves of equal label have one entry.
    pub label: &'a str,
    /// Drawn wide and pale, as what others are compared with.
    pub wide: bool,
    /// (x, y) with x rising; where it has a gap there is a point that is not finite.
    pub points: &'a [(f64, f64)],
}

/// A value that must not be crossed.
#[derive(Debug, Clone, Copy)]
pub struct Bound<'a> {
    /// Where it lies.
    pub at: f64,
    /// Written beside it.
    pub label: &'a str,
}

/// One of the panels.
#[derive(Debug, Clone, Copy)]
pub struct CurvePanel<'a> {
    /// What it shows, with its unit.
    pub label: &'a str,
    /// \[px\]
    pub height: f64,
    /// Fixed range of y; from curves and bounds when `None`.
    pub y: Option<(f64, f64)>,
    /// Its curves.
    pub curves: &'a [Curve<'a>],
    /// Its bounds.
    pub bounds: &'a [Bound<'a>],
}

/// Draws panels over one x axis; `shaded`: stretches of x with a grey ground. `None` without a finite point.
#[must_use]
pub fn curves(
    title: &str,
    about: &str,
    x_label: &str,
    panels: &[CurvePanel<'_>],
    shaded: (&str, &[(f64, f64)]),
) -> Option<Picture> {
    let all = || panels.iter().flat_map(|panel| panel.curves).flat_map(|curve| curve.points);
    let finite = |(x, y): &&(f64, f64)| x.is_finite() && y.is_finite();
    let (first, last) = extent(all().filter(finite).map(|p| p.0))?;
    let x = if last > first { (first, last) } else { (first - 0.5, first + 0.5) };
    let mut sheet = Sheet::default();
    let classes: Vec<(String, &str)> = legend(panels);
    let mut entries: Vec<(&str, &str)> =
        classes.iter().map(|(class, label)| (class.as_str(), *label)).collect();
    if !shaded.1.is_empty() {
        entries.push(("shade-key", shaded.0));
    }
    sheet.legend(&entries);
    if let Some(index) = entries.iter().position(|(class, _)| *class == "shade-key") {
        // The legend's own places: a block instead of a line.
        let before: f64 = entries[..index].iter().map(|(_, l)| 57.0 + 7.2 * l.chars().count() as f64).sum();
        sheet.rect("shade", (LEFT + before, 6.0), (26.0, 15.0));
    }
    let mut top = LEGEND;
    for (index, panel) in panels.iter().enumerate() {
        top += if index == 0 { 22.0 } else { 34.0 };
        let frame = Frame {
            at: (LEFT, top),
            size: (WIDTH - LEFT - RIGHT, panel.height),
            x,
            y: panel.y.unwrap_or_else(|| range(panel)),
        };
        for (from, to) in shaded.1 {
            let (left, right) = (frame.px(from.max(x.0)), frame.px(to.min(x.1)));
            sheet.rect("shade", (left, top), (right - left, panel.height));
        }
        frame.axes(&mut sheet, (index + 1 == panels.len()).then_some(x_label), panel.label);
        for bound in panel.bounds {
            let y = frame.py(bound.at);
            sheet.line("bound", &[(LEFT, y), (WIDTH - RIGHT, y)]);
            sheet.text((WIDTH - RIGHT - 4.0, y - 5.0), "bound", Hung::Right, bound.label);
        }
        for curve in panel.curves {
            let width = if curve.wide { " wide" } else { "" };
            let class = format!("line {}{width}", curve.shown.class());
            for run in curve.points.split(|p| !(p.0.is_finite() && p.1.is_finite())) {
                let most = (POINTS_MAX * run.len()).div_ceil(curve.points.len().max(1));
                sheet.line(&class, &frame.placed(&thinned(run, most)));
            }
        }
        top += panel.height;
    }
    Some(sheet.done(title, about, top + 44.0))
}

fn legend<'a>(panels: &[CurvePanel<'a>]) -> Vec<(String, &'a str)> {
    let mut entries: Vec<(String, &str)> = Vec::new();
    for curve in panels.iter().flat_map(|panel| panel.curves) {
        if !entries.iter().any(|(_, label)| *label == curve.label) {
            let width = if curve.wide { " wide" } else { "" };
            entries.push((format!("{}{width}", curve.shown.class()), curve.label));
        }
    }
    entries
}

/// From zero, where nothing is negative, to a little more than the largest; bounds are inside.
fn range(panel: &CurvePanel<'_>) -> (f64, f64) {
    let values = panel.curves.iter().flat_map(|curve| curve.points).map(|p| p.1);
    let values = values.chain(panel.bounds.iter().map(|bound| bound.at));
    let (low, high) = extent(values).unwrap_or((0.0, 1.0));
    let span = if high > low { high - low } else { 1.0 };
    (if low >= 0.0 { 0.0 } else { low - 0.08 * span }, high + 0.12 * span)
}
