//! Curves over a logarithmic axis, one chart per case: distributions of errors, error against jerk.
//!
//! Contract: both axes of a chart come from its own points; values that are not positive cannot be drawn on a
//! logarithmic axis and are left out.

use std::path::Path;

use plotters::coord::combinators::{BindKeyPoints, WithKeyPoints};
use plotters::coord::ranged1d::{AsRangedCoord, Ranged, ValueFormatter};
use plotters::prelude::*;

use super::PlotError;
use super::canvas::{Area, DrawResult, INK, Key, SERIES, axes, extent, head_px, picture, text, thinned};

const WIDTH_PX: u32 = 1200;
const PANEL_PX: u32 = 420;
const COLUMNS: usize = 2;
const POINTS_MAX: usize = 1200;

/// One curve.
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

/// One chart.
#[derive(Debug, Clone)]
pub struct LogPanel<'a> {
    /// Written above it.
    pub title: &'a str,
    /// Its curves.
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
    let fits = |&(x, y): &(f64, f64)| x > 0.0 && x.is_finite() && y.is_finite() && (y > 0.0 || !log_y);
    let drawn: Vec<_> =
        panels.iter().filter(|panel| panel.lines.iter().flat_map(|line| &line.points).any(fits)).collect();
    if drawn.is_empty() {
        return Err(PlotError::Empty { file: file.to_path_buf(), what: "no points" });
    }
    let mut names: Vec<&str> = Vec::new();
    for line in drawn.iter().flat_map(|panel| &panel.lines) {
        if !names.contains(&line.label) {
            names.push(line.label);
        }
    }
    let keys: Vec<_> =
        names.iter().zip(SERIES.iter().cycle()).map(|(name, colour)| Key::solid(name, *colour)).collect();
    let columns = COLUMNS.min(drawn.len());
    let rows = drawn.len().div_ceil(columns);
    let height = head_px(subtitle, &keys, WIDTH_PX) as u32 + PANEL_PX * rows as u32;
    picture(file, (WIDTH_PX, height), title, subtitle, &keys, |area| {
        for (panel, place) in drawn.iter().zip(area.split_evenly((rows, columns))) {
            let points = || panel.lines.iter().flat_map(|line| &line.points).filter(|point| fits(point));
            let x = around(extent(points().map(|point| point.0)));
            if log_y {
                let y = around(extent(points().map(|point| point.1)));
                draw(&place, panel, &keys, labels, x, logarithmic(y), &fits)?;
            } else {
                draw(&place, panel, &keys, labels, x, 0.0..100.0, &fits)?;
            }
        }
        Ok(())
    })
}

/// A little more than the values, by ratio.
fn around(range: Option<(f64, f64)>) -> std::ops::Range<f64> {
    let (low, high) = range.unwrap_or((1.0, 10.0));
    0.85 * low..1.18 * high
}

/// An axis that is labelled at 1, 2, 3 and 5 times powers of ten; over many decades at some of the powers.
fn logarithmic(range: std::ops::Range<f64>) -> WithKeyPoints<LogCoord<f64>> {
    let [low, high] = [range.start.log10().floor(), range.end.log10().ceil()].map(|decade| decade as i32);
    let parts: &[f64] = match high - low {
        ..=2 => &[1.0, 2.0, 3.0, 5.0],
        3..=4 => &[1.0, 2.0, 5.0],
        _ => &[1.0],
    };
    let decades = (low..=high).step_by(1 + (high - low) as usize / 8);
    let all = decades.flat_map(|decade| parts.iter().map(move |part| part * 10f64.powi(decade)));
    let ticks = all.filter(|tick| range.contains(tick)).collect();
    range.log_scale().with_key_points(ticks)
}

fn draw<Y>(
    area: &Area<'_>,
    panel: &LogPanel<'_>,
    keys: &[Key<'_>],
    labels: (&str, &str),
    x: std::ops::Range<f64>,
    y: Y,
    fits: &dyn Fn(&(f64, f64)) -> bool,
) -> DrawResult
where
    Y: AsRangedCoord<Value = f64>,
    Y::CoordDescType: Ranged<ValueType = f64> + ValueFormatter<f64>,
{
    area.draw(&Text::new(panel.title.to_owned(), (80, 2), text(&INK)))?;
    let mut chart = ChartBuilder::on(area)
        .margin_top(24)
        .margin_right(16)
        .x_label_area_size(48)
        .y_label_area_size(70)
        .build_cartesian_2d(logarithmic(x), y)?;
    axes(&mut chart, labels.0, labels.1)?;
    for line in &panel.lines {
        let key = keys.iter().find(|key| key.label == line.label).copied().unwrap_or(Key::solid("", INK));
        let shown: Vec<_> = line.points.iter().copied().filter(fits).collect();
        let stroke = Key { width_px: 2, opacity: if line.dots { 0.5 } else { 1.0 }, ..key }.stroke();
        if line.dots {
            chart.draw_series(shown.iter().map(|point| Circle::new(*point, 3, key.colour.filled())))?;
        }
        let marked = line.marked.and_then(|index| line.points.get(index)).filter(|point| fits(point));
        chart.draw_series(marked.map(|point| Circle::new(*point, 7, key.colour.filled())))?;
        // Curves of few points go back and forth in x: only long ones are thinned.
        let path = if shown.len() > POINTS_MAX { thinned(&shown, POINTS_MAX) } else { shown };
        chart.draw_series(std::iter::once(PathElement::new(path, stroke)))?;
    }
    Ok(())
}
