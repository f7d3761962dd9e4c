//! Lines over time or steps: one chart, stacked panels.

use super::PlotError;
use super::canvas::{Area, DrawResult, INK, Key, SERIES, TRUST, axes, extent, picture, thinned};
use plotters::prelude::*;
use std::ops::Range;
use std::path::Path;

const SIZE_PX: (u32, u32) = (1200, 520);
const POINTS_MAX: usize = 2400;

/// One line of a panel.
#[derive(Debug, Clone, Copy)]
pub struct Line<'a> {
    /// For the legend.
    pub label: &'a str,
    /// (x, y) with x rising; points that are not finite are left out.
    pub points: &'a [(f64, f64)],
    /// How it is drawn.
    pub mark: Mark,
}

/// How a line is drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Mark {
    /// A full line.
    Solid,
    /// A thin, light line for context.
    Thin,
    /// A line with a dot at every point; for few points.
    Dots,
}

/// One of several charts above each other with a common x axis.
#[derive(Debug, Clone, Copy)]
pub struct Panel<'a> {
    /// With its unit.
    pub y_label: &'a str,
    /// Fixed range of y; from the data when `None`.
    pub y_range: Option<(f64, f64)>,
    /// Lines of equal label have equal colour in all panels.
    pub lines: &'a [Line<'a>],
}

/// Draws lines into one chart.
///
/// # Errors
/// [`PlotError`]: no finite point, or the file cannot be written.
pub fn lines(
    file: &Path,
    title: &str,
    subtitle: &str,
    labels: (&str, &str),
    lines: &[Line<'_>],
) -> Result<(), PlotError> {
    panels(file, title, subtitle, labels.0, &[Panel { y_label: labels.1, y_range: None, lines }], None)
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
    panels: &[Panel<'_>],
    shade: Option<(f64, f64)>,
) -> Result<(), PlotError> {
    let x_range = x_range(file, panels)?;
    let coloured = coloured(panels.iter());
    // A panel with one line is named by its axis.
    let legend: &[Key<'_>] = if panels.iter().any(|p| p.lines.len() > 1) { &coloured } else { &[] };
    let height = if panels.len() == 1 { SIZE_PX.1 } else { 130 + 240 * panels.len() as u32 };
    picture(file, (SIZE_PX.0, height), title, subtitle, legend, |area| {
        let places = area.split_evenly((panels.len(), 1));
        let lowest = panels.len() - 1;
        for (index, (panel, place)) in panels.iter().zip(&places).enumerate() {
            let x_label = if index == lowest { x_label } else { "" };
            draw_panel(place, panel, &coloured, x_range.clone(), x_label, shade)?;
        }
        Ok(())
    })
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
    panels: &[Panel<'_>],
    curve: &Panel<'_>,
) -> Result<(), PlotError> {
    let above = x_range(file, panels)?;
    let below = x_range(file, std::slice::from_ref(curve))?;
    let coloured = coloured(panels.iter().chain([curve]));
    let rows = panels.len() + 1;
    picture(file, (SIZE_PX.0, 130 + 240 * rows as u32), title, subtitle, &coloured, |area| {
        let places = area.split_evenly((rows, 1));
        for (index, (panel, place)) in panels.iter().chain([curve]).zip(&places).enumerate() {
            let (range, label) = match index + 1 {
                row if row == rows => (below.clone(), x_labels.1),
                row if row == rows - 1 => (above.clone(), x_labels.0),
                _ => (above.clone(), ""),
            };
            draw_panel(place, panel, &coloured, range, label, None)?;
        }
        Ok(())
    })
}

/// From the first to the last finite point of all panels.
pub(super) fn x_range(file: &Path, panels: &[Panel<'_>]) -> Result<Range<f64>, PlotError> {
    let all = panels.iter().flat_map(|p| p.lines).flat_map(|l| l.points);
    let Some((first, last)) = extent(all.map(|p| p.0)) else {
        return Err(PlotError::Empty { file: file.to_path_buf(), what: "no points" });
    };
    Ok(if last > first { first..last } else { first - 0.5..first + 0.5 })
}

/// A colour for every label, in the order in which they come.
pub(super) fn coloured<'a>(panels: impl Iterator<Item = &'a Panel<'a>>) -> Vec<Key<'a>> {
    let mut names: Vec<&str> = Vec::new();
    for line in panels.flat_map(|p| p.lines) {
        if !names.contains(&line.label) {
            names.push(line.label);
        }
    }
    names.iter().zip(SERIES.iter().cycle()).map(|(name, colour)| Key::solid(name, *colour)).collect()
}

pub(super) fn draw_panel(
    area: &Area<'_>,
    panel: &Panel<'_>,
    keys: &[Key<'_>],
    x_range: Range<f64>,
    x_label: &str,
    shade: Option<(f64, f64)>,
) -> DrawResult {
    let (low, high) = panel.y_range.unwrap_or_else(|| {
        let values = panel.lines.iter().flat_map(|l| l.points).map(|p| p.1);
        let (low, high) = extent(values).unwrap_or((0.0, 1.0));
        // Quantities that cannot be negative are shown from zero.
        let low = if low >= 0.0 { 0.0 } else { low - 0.05 * (high - low) };
        (low, if high > low { high + 0.06 * (high - low) } else { low + 1.0 })
    });
    let mut chart = ChartBuilder::on(area)
        .margin_top(8)
        .x_label_area_size(if x_label.is_empty() { 24 } else { 48 })
        .y_label_area_size(70)
        .build_cartesian_2d(x_range, low..high)?;
    if let Some((from, to)) = shade {
        chart.draw_series(std::iter::once(Rectangle::new(
            [(from, low), (to, high)],
            TRUST.mix(0.10).filled(),
        )))?;
    }
    axes(&mut chart, x_label, panel.y_label)?;
    for line in panel.lines {
        let key = keys.iter().find(|k| k.label == line.label).copied().unwrap_or(Key::solid("", INK));
        let style = match line.mark {
            Mark::Solid | Mark::Dots => Key { width_px: 2, ..key },
            Mark::Thin => Key { width_px: 1, opacity: 0.5, ..key },
        };
        let points = thinned(line.points, POINTS_MAX);
        if line.mark == Mark::Dots {
            chart.draw_series(points.iter().map(|p| Circle::new(*p, 4, key.colour.filled())))?;
        }
        chart.draw_series(std::iter::once(PathElement::new(points, style.stroke())))?;
    }
    Ok(())
}
