//! Curves over a logarithmic axis, one chart per case: distributions of errors, error against jerk.
//!
//! Contract: both axes of a chart come from its own points; values that are not positive cannot be drawn on a
//! logarithmic axis and are left out.

use std::path::Path;

use super::sheet::{AxisFrame, Hung, LEFT, RIGHT, Sheet, WIDTH, extent, plain, series, thinned, ticks};
use super::{PlotError, empty};

const COLUMNS: usize = 2;
/// Height of a chart with its axis and title, and of the chart alone \[px\].
const PANEL: f64 = 370.0;
const CHART: f64 = 290.0;
const POINTS_MAX: usize = 1200;

#[derive(Debug, Clone)]
pub struct LogLine<'a> {
    /// For the legend; equal labels have equal colours.
    pub label: &'a str,
    /// (x, y) in the order in which they are joined.
    pub points: Vec<(f64, f64)>,
    /// A dot at every point.
    pub dots: bool,
    /// The point with this index gets a larger dot.
    pub marked: Option<usize>,
}

#[derive(Debug, Clone)]
pub struct LogPanel<'a> {
    pub title: &'a str,
    pub lines: Vec<LogLine<'a>>,
}

/// Draws charts side by side, x logarithmic; y logarithmic too, or from 0 to 100.
///
/// # Errors
/// [`PlotError`]: no point that can be drawn, or the file cannot be written.
pub fn log_panels(
    file: &Path,
    title: &str,
    subtitle: &str,
    labels: (&str, &str),
    log_y: bool,
    panels: &[LogPanel<'_>],
) -> Result<(), PlotError> {
    let fits = |(x, y): &(f64, f64)| *x > 0.0 && x.is_finite() && y.is_finite() && (*y > 0.0 || !log_y);
    let placed = |(x, y): &(f64, f64)| (x.log10(), if log_y { y.log10() } else { *y });
    let drawn: Vec<_> =
        panels.iter().filter(|panel| panel.lines.iter().flat_map(|line| &line.points).any(fits)).collect();
    if drawn.is_empty() {
        return Err(empty(file, "no points"));
    }
    let mut names: Vec<&str> = Vec::new();
    for line in drawn.iter().flat_map(|panel| &panel.lines) {
        if !names.contains(&line.label) {
            names.push(line.label);
        }
    }
    let mut sheet = Sheet::default();
    let legend: Vec<_> = names.iter().enumerate().map(|(index, name)| (series(index), *name)).collect();
    let head = sheet.legend(&legend);
    let columns = COLUMNS.min(drawn.len());
    let wide = (WIDTH - RIGHT) / columns as f64;
    for (index, panel) in drawn.iter().enumerate() {
        let points =
            || panel.lines.iter().flat_map(|line| &line.points).filter(|point| fits(point)).map(placed);
        let y_range = if log_y { around(extent(points().map(|p| p.1))) } else { (0.0, 100.0) };
        let top = head + 44.0 + (index / columns) as f64 * PANEL;
        let frame = AxisFrame {
            at: (LEFT + (index % columns) as f64 * wide, top),
            size: (wide - LEFT, CHART),
            x: around(extent(points().map(|p| p.0))),
            y: y_range,
        };
        let (left, right, bottom) = (frame.at.0, frame.at.0 + frame.size.0, top + CHART);
        frame.grid_x(&mut sheet, logarithmic(frame.x));
        if log_y {
            frame.grid_y(&mut sheet, logarithmic(y_range));
        } else {
            frame.grid_y(&mut sheet, ticks(y_range, 8.0).into_iter().map(|value| (value, plain(value))));
        }
        frame.outline(&mut sheet);
        sheet.text((left + 4.0, top - 24.0), "strong", Hung::Left, panel.title);
        sheet.text((left + 4.0, top - 7.0), "", Hung::Left, labels.1);
        sheet.text((right, bottom + 34.0), "", Hung::Right, labels.0);
        for line in &panel.lines {
            let class = legend.iter().find(|(_, name)| *name == line.label).map_or("s0", |(class, _)| class);
            let shown: Vec<_> = line.points.iter().filter(|point| fits(point)).map(placed).collect();
            let at = |point: &(f64, f64)| (frame.px(point.0), frame.py(point.1));
            for point in shown.iter().filter(|_| line.dots) {
                sheet.dot(class, at(point), 3.0);
            }
            let marked = line.marked.and_then(|index| line.points.get(index)).filter(|point| fits(point));
            if let Some(point) = marked {
                sheet.dot(class, at(&placed(point)), 7.0);
            }
            // Curves of few points go back and forth in x: only long ones are thinned.
            let pale = if line.dots { " pale" } else { "" };
            sheet.line(&format!("line {class}{pale}"), &frame.placed(&thinned(&shown, POINTS_MAX)));
        }
    }
    let rows = drawn.len().div_ceil(columns);
    sheet.chart(file, title, subtitle, head + rows as f64 * PANEL)
}

/// A little more than the values, which are decades.
fn around(range: Option<(f64, f64)>) -> (f64, f64) {
    let (low, high) = range.unwrap_or((0.0, 1.0));
    (low + 0.85_f64.log10(), high + 1.18_f64.log10())
}

/// 1, 2, 3 and 5 times powers of ten inside a range of decades; over many decades some of the powers.
fn logarithmic((from, to): (f64, f64)) -> Vec<(f64, String)> {
    let [low, high] = [from.floor(), to.ceil()].map(|decade| decade as i32);
    let parts: &[f64] = match high - low {
        ..=2 => &[1.0, 2.0, 3.0, 5.0],
        3..=4 => &[1.0, 2.0, 5.0],
        _ => &[1.0],
    };
    let decades = (low..=high).step_by(1 + (high - low) as usize / 8);
    let all = decades.flat_map(|decade| parts.iter().map(move |part| part * 10f64.powi(decade)));
    all.map(|tick| (tick.log10(), plain(tick))).filter(|(at, _)| (from..=to).contains(at)).collect()
}
