//! Curves over one x axis, in panels above each other: for pages, and as charts of a report.

use std::path::Path;

use super::paths::{Cell, cells_below};
use super::sheet::{AxisFrame, Hung, LEFT, Picture, RIGHT, Sheet, Shown, WIDTH, extent, series, thinned};
use super::{PlotError, empty};

/// Points per curve: more than pixels, so that every peak is kept.
const POINTS_MAX: usize = 2400;

/// A curve on a page.
#[derive(Debug, Clone, Copy)]
pub struct PageCurve<'a> {
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
    pub at: f64,
    pub label: &'a str,
}

/// One of the panels of a page's picture.
#[derive(Debug, Clone, Copy)]
pub struct CurvePanel<'a> {
    /// What it shows, with its unit.
    pub label: &'a str,
    /// \[px\]
    pub height: f64,
    /// Fixed range of y; from curves and bounds when `None`.
    pub y: Option<(f64, f64)>,
    pub curves: &'a [PageCurve<'a>],
    pub bounds: &'a [Bound<'a>],
}

/// A line of a chart.
#[derive(Debug, Clone, Copy)]
pub struct Line<'a> {
    /// For the legend; lines of equal label have equal colour in all panels.
    pub label: &'a str,
    /// (x, y) with x rising; points that are not finite are left out.
    pub points: &'a [(f64, f64)],
    pub mark: Mark,
}

/// How a line is drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Mark {
    Solid,
    /// Thin and light, for context.
    Thin,
    /// With a dot at every point; for few points.
    Dots,
}

/// One of several charts above each other with a common x axis.
#[derive(Debug, Clone, Copy)]
pub struct ChartPanel<'a> {
    pub y_label: &'a str,
    /// Fixed range of y; from the data when `None`.
    pub y_range: Option<(f64, f64)>,
    pub lines: &'a [Line<'a>],
}

/// A line as it is drawn.
struct DrawnLine<'a> {
    class: String,
    label: &'a str,
    dots: bool,
    points: &'a [(f64, f64)],
}

/// A panel as it is drawn.
struct DrawnPanel<'a> {
    label: &'a str,
    height: f64,
    y: Option<(f64, f64)>,
    lines: Vec<DrawnLine<'a>>,
    bounds: &'a [Bound<'a>],
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
    let of_page = |curve: &PageCurve<'_>| {
        let wide = if curve.wide { " wide" } else { "" };
        format!("{}{wide}", curve.shown.class())
    };
    let drawn: Vec<_> = panels
        .iter()
        .map(|panel| DrawnPanel {
            label: panel.label,
            height: panel.height,
            y: panel.y,
            lines: panel
                .curves
                .iter()
                .map(|c| DrawnLine { class: of_page(c), label: c.label, dots: false, points: c.points })
                .collect(),
            bounds: panel.bounds,
        })
        .collect();
    let mut sheet = Sheet::default();
    let shade = (!shaded.1.is_empty()).then_some(("shade", shaded.0));
    let top = sheet.legend(&legend(&drawn).into_iter().chain(shade).collect::<Vec<_>>());
    let bottom = stack(&mut sheet, top, &drawn, x_label, shaded.1)?;
    Some(sheet.done(title, about, bottom))
}

/// Draws charts above each other with a common x axis; `shade` marks a stretch of x in all of them.
///
/// # Errors
/// [`PlotError`]: no finite point, or the file cannot be written.
pub fn panels(
    file: &Path,
    title: &str,
    subtitle: &str,
    x_label: &str,
    panels: &[ChartPanel<'_>],
    shade: Option<(f64, f64)>,
) -> Result<(), PlotError> {
    let drawn = of_charts(panels, if panels.len() == 1 { 340.0 } else { 170.0 });
    let mut sheet = Sheet::default();
    // A panel with one line is named by its axis.
    let named = panels.iter().any(|panel| panel.lines.len() > 1);
    let top = sheet.legend(&if named { legend(&drawn) } else { Vec::new() });
    let bottom =
        stack(&mut sheet, top, &drawn, x_label, shade.as_slice()).ok_or_else(|| empty(file, "no points"))?;
    sheet.chart(file, title, subtitle, bottom)
}

/// Draws charts above each other with a common x axis, and below them `curve` with an x axis of its own;
/// `x_labels` for both.
///
/// # Errors
/// [`PlotError`]: no finite point in either, or the file cannot be written.
pub fn panels_and_curve(
    file: &Path,
    title: &str,
    subtitle: &str,
    x_labels: (&str, &str),
    panels: &[ChartPanel<'_>],
    curve: &ChartPanel<'_>,
) -> Result<(), PlotError> {
    let all: Vec<_> = panels.iter().chain([curve]).copied().collect();
    let drawn = of_charts(&all, 170.0);
    let (above, below) = drawn.split_at(panels.len());
    let mut sheet = Sheet::default();
    let top = sheet.legend(&legend(&drawn));
    let middle = stack(&mut sheet, top, above, x_labels.0, &[]).ok_or_else(|| empty(file, "no points"))?;
    let bottom = stack(&mut sheet, middle, below, x_labels.1, &[]).ok_or_else(|| empty(file, "no points"))?;
    sheet.chart(file, title, subtitle, bottom)
}

/// Draws charts above each other, and below them every cell with samples as a small picture; the cells have
/// one scale.
///
/// # Errors
/// [`PlotError`]: no finite point, no cell with samples, or the file cannot be written.
pub fn panels_and_cells(
    file: &Path,
    title: &str,
    subtitle: &str,
    x_label: &str,
    panels: &[ChartPanel<'_>],
    cells: &[Cell<'_>],
) -> Result<(), PlotError> {
    let drawn = of_charts(panels, 230.0);
    let mut sheet = Sheet::default();
    let top = sheet.legend(&legend(&drawn));
    let middle = stack(&mut sheet, top, &drawn, x_label, &[]).ok_or_else(|| empty(file, "no points"))?;
    let bottom =
        cells_below(&mut sheet, middle, cells, 4).ok_or_else(|| empty(file, "no cell with samples"))?;
    sheet.chart(file, title, subtitle, bottom)
}

/// Lines of equal label have one colour.
fn of_charts<'a>(panels: &[ChartPanel<'a>], height: f64) -> Vec<DrawnPanel<'a>> {
    let mut names: Vec<&str> = Vec::new();
    for line in panels.iter().flat_map(|panel| panel.lines) {
        if !names.contains(&line.label) {
            names.push(line.label);
        }
    }
    let drawn = |line: &Line<'a>| {
        let index = names.iter().position(|name| *name == line.label).unwrap_or(0);
        let thin = if line.mark == Mark::Thin { " thin pale" } else { "" };
        DrawnLine {
            class: format!("{}{thin}", series(index)),
            label: line.label,
            dots: line.mark == Mark::Dots,
            points: line.points,
        }
    };
    let panel = |panel: &ChartPanel<'a>| DrawnPanel {
        label: panel.y_label,
        height,
        y: panel.y_range,
        lines: panel.lines.iter().map(drawn).collect(),
        bounds: &[],
    };
    panels.iter().map(panel).collect()
}

/// Draws panels from `top` downwards over one x axis; where they end, or `None` without a finite point.
fn stack(
    sheet: &mut Sheet,
    mut top: f64,
    panels: &[DrawnPanel<'_>],
    x_label: &str,
    shaded: &[(f64, f64)],
) -> Option<f64> {
    let all = panels.iter().flat_map(|panel| &panel.lines).flat_map(|line| line.points);
    let (first, last) = extent(all.filter(|point| is_finite(point)).map(|point| point.0))?;
    let x = if last > first { (first, last) } else { (first - 0.5, first + 0.5) };
    for (index, panel) in panels.iter().enumerate() {
        top += if index == 0 { 22.0 } else { 34.0 };
        let frame = AxisFrame {
            at: (LEFT, top),
            size: (WIDTH - LEFT - RIGHT, panel.height),
            x,
            y: panel.y.unwrap_or_else(|| range(panel)),
        };
        for (from, to) in shaded {
            let (left, right) = (frame.px(from.max(x.0)), frame.px(to.min(x.1)));
            sheet.rect("shade", (left, top), (right - left, panel.height));
        }
        frame.axes(sheet, (index + 1 == panels.len()).then_some(x_label), panel.label);
        for bound in panel.bounds {
            let y = frame.py(bound.at);
            sheet.line("bound", &[(LEFT, y), (WIDTH - RIGHT, y)]);
            sheet.text((WIDTH - RIGHT - 4.0, y - 5.0), "bound", Hung::Right, bound.label);
        }
        for line in &panel.lines {
            let class = format!("line {}", line.class);
            for run in line.points.split(|point| !is_finite(point)) {
                let most = (POINTS_MAX * run.len()).div_ceil(line.points.len().max(1));
                sheet.line(&class, &frame.placed(&thinned(run, most)));
                for point in run.iter().filter(|_| line.dots) {
                    sheet.dot(&line.class, (frame.px(point.0), frame.py(point.1)), 3.5);
                }
            }
        }
        top += panel.height;
    }
    Some(top + 44.0)
}

fn is_finite(point: &(f64, f64)) -> bool {
    point.0.is_finite() && point.1.is_finite()
}

fn legend<'d>(panels: &'d [DrawnPanel<'_>]) -> Vec<(&'d str, &'d str)> {
    let mut entries: Vec<(&str, &str)> = Vec::new();
    for line in panels.iter().flat_map(|panel| &panel.lines) {
        if !entries.iter().any(|(_, label)| *label == line.label) {
            entries.push((&line.class, line.label));
        }
    }
    entries
}

/// From zero, where nothing is negative, to a little more than the largest; bounds are inside.
fn range(panel: &DrawnPanel<'_>) -> (f64, f64) {
    let values = panel.lines.iter().flat_map(|line| line.points).map(|p| p.1);
    let values = values.chain(panel.bounds.iter().map(|bound| bound.at));
    let (low, high) = extent(values).unwrap_or((0.0, 1.0));
    let span = if high > low { high - low } else { 1.0 };
    (if low >= 0.0 { 0.0 } else { low - 0.08 * span }, high + 0.12 * span)
}
