//! Lines over time or steps: the error with trust on a second axis, stacked panels, the trust ramp.

use super::PlotError;
use super::canvas::{
    Area, DrawResult, FAINT, INK, Key, MUTED, ROBOT, SERIES, TRUST, axes, extent, picture, plain, text,
    thinned,
};
use crate::metrics::ErrorSample;
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

/// What happened around a ramp of trust, per grid step.
#[derive(Debug, Clone, Copy)]
pub struct Rampup<'a> {
    /// (step, trust in [0, 1]).
    pub trust: &'a [(f64, f64)],
    /// (step, error [m]).
    pub error_m: &'a [(f64, f64)],
    /// (step, size of the jerk [m/s³]).
    pub jerk_mps3: &'a [(f64, f64)],
    /// First and last step of the ramp.
    pub ramp: (f64, f64),
}

/// Draws the tracking error in millimetres over time (light while the pen hovers), trust on the right-hand axis.
///
/// `trust`: (t [s], α in [0, 1]) of the same clock; may be empty. Time starts at 0 in the picture.
///
/// # Errors
/// [`PlotError`]: no errors to draw, or the file cannot be written.
pub fn error_over_time(
    file: &Path,
    title: &str,
    subtitle: &str,
    errors: &[ErrorSample],
    trust: &[(f64, f64)],
) -> Result<(), PlotError> {
    let start = errors.first().map_or(0.0, |e| e.t_s);
    let rows: Vec<(f64, f64, bool)> = errors
        .iter()
        .map(|e| (e.t_s - start, e.error_m * 1e3, e.contact))
        .filter(|r| r.0.is_finite() && r.1.is_finite())
        .collect();
    let (Some((_, end)), Some((_, largest))) =
        (extent(rows.iter().map(|r| r.0)), extent(rows.iter().map(|r| r.1)))
    else {
        return Err(PlotError::Empty { file: file.to_path_buf(), what: "no tracking errors" });
    };
    let down = Key::solid("error, pen down", ROBOT);
    let hover = Key { label: "error, pen up", colour: ROBOT, width_px: 1, opacity: 0.45 };
    let alpha = Key { label: "trust (right axis)", colour: TRUST, width_px: 2, opacity: 0.9 };
    let legend: Vec<Key<'_>> = if trust.is_empty() { vec![down, hover] } else { vec![down, hover, alpha] };
    let trust: Vec<(f64, f64)> = trust
        .iter()
        .map(|(t, a)| (t - start, *a))
        .filter(|(t, a)| (0.0..=end).contains(t) && a.is_finite())
        .collect();
    picture(file, SIZE_PX, title, subtitle, &legend, |area| {
        let mut chart = ChartBuilder::on(area)
            .x_label_area_size(48)
            .y_label_area_size(62)
            .right_y_label_area_size(62)
            .build_cartesian_2d(0.0..end.max(1e-3), 0.0..(largest * 1.08).max(1e-3))?
            .set_secondary_coord(0.0..end.max(1e-3), 0.0..1.08);
        chart
            .configure_mesh()
            .light_line_style(TRANSPARENT)
            .bold_line_style(FAINT.stroke_width(1))
            .axis_style(MUTED.stroke_width(1))
            .label_style(text(&MUTED))
            .axis_desc_style(text(&INK))
            .x_desc("time [s]")
            .y_desc("distance between robot and pen [mm]")
            .x_label_formatter(&plain)
            .y_label_formatter(&plain)
            .draw()?;
        if !trust.is_empty() {
            chart
                .configure_secondary_axes()
                .axis_style(MUTED.stroke_width(1))
                .label_style(text(&TRUST))
                .axis_desc_style(text(&TRUST))
                .y_desc("trust α")
                .y_label_formatter(&plain)
                .draw()?;
            let fill = AreaSeries::new(steps(&trust), 0.0, TRUST.mix(0.07));
            chart.draw_secondary_series(fill)?;
            let edge = PathElement::new(steps(&trust), alpha.stroke());
            chart.draw_secondary_series(std::iter::once(edge))?;
        }
        for (contact, run) in contact_runs(&rows) {
            let key = if contact { Key { width_px: 2, ..down } } else { hover };
            chart.draw_series(std::iter::once(PathElement::new(run, key.stroke())))?;
        }
        Ok(())
    })
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

/// Draws charts above each other with a common x axis, and below them `curve` with an x axis of its own; `x_labels` for
/// both.
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
fn x_range(file: &Path, panels: &[Panel<'_>]) -> Result<Range<f64>, PlotError> {
    let all = panels.iter().flat_map(|p| p.lines).flat_map(|l| l.points);
    let Some((first, last)) = extent(all.map(|p| p.0)) else {
        return Err(PlotError::Empty { file: file.to_path_buf(), what: "no points" });
    };
    Ok(if last > first { first..last } else { first - 0.5..first + 0.5 })
}

/// A colour for every label, in the order in which they come.
fn coloured<'a>(panels: impl Iterator<Item = &'a Panel<'a>>) -> Vec<Key<'a>> {
    let mut names: Vec<&str> = Vec::new();
    for line in panels.flat_map(|p| p.lines) {
        if !names.contains(&line.label) {
            names.push(line.label);
        }
    }
    names.iter().zip(SERIES.iter().cycle()).map(|(name, colour)| Key::solid(name, *colour)).collect()
}

/// Draws a ramp of trust with the error and the jerk around it, the ramp shaded.
///
/// # Errors
/// [`PlotError`]: no finite point, or the file cannot be written.
pub fn trust_ramp(file: &Path, title: &str, subtitle: &str, data: Rampup<'_>) -> Result<(), PlotError> {
    let error_mm: Vec<(f64, f64)> = data.error_m.iter().map(|(s, e)| (*s, e * 1e3)).collect();
    let line = |label, points| [Line { label, points, mark: Mark::Solid }];
    let (error, jerk, trust) =
        (line("error", &error_mm[..]), line("jerk", data.jerk_mps3), line("trust", data.trust));
    let stacked = [
        Panel { y_label: "error [mm]", y_range: None, lines: &error },
        Panel { y_label: "jerk [m/s³]", y_range: None, lines: &jerk },
        Panel { y_label: "trust α", y_range: Some((0.0, 1.05)), lines: &trust },
    ];
    panels(file, title, subtitle, "step", &stacked, Some(data.ramp))
}

fn draw_panel(
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

/// A value that holds until the next one, as a line with corners.
fn steps(points: &[(f64, f64)]) -> Vec<(f64, f64)> {
    let mut cornered: Vec<(f64, f64)> = Vec::new();
    let mut before: Option<(f64, f64)> = None;
    for (index, &(x, y)) in points.iter().enumerate() {
        if before.is_some_and(|b| b.1 == y) && index + 1 < points.len() {
            continue;
        }
        cornered.extend(before.map(|b| (x, b.1)));
        cornered.push((x, y));
        before = Some((x, y));
    }
    cornered
}

/// Runs of equal contact, thinned together to what a picture can show, joined at their ends.
fn contact_runs(rows: &[(f64, f64, bool)]) -> Vec<(bool, Vec<(f64, f64)>)> {
    let mut runs: Vec<(bool, Vec<(f64, f64)>)> = Vec::new();
    for &(t, e, contact) in rows {
        let joint = runs.last().and_then(|r| r.1.last().copied());
        match runs.last_mut() {
            Some((same, run)) if *same == contact => run.push((t, e)),
            _ => runs.push((contact, joint.into_iter().chain([(t, e)]).collect())),
        }
    }
    let share = |count: usize| (POINTS_MAX * 2 * count / rows.len().max(1)).max(8);
    runs.into_iter().map(|(contact, run)| (contact, thinned(&run, share(run.len())))).collect()
}
