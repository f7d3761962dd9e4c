//! Pen and robot path over each other, many small ones beside each other: pen down thick, hover thin, one
//! scale.

use super::PlotError;
use super::canvas::{Area, DrawResult, INK, Key, MUTED, PEN, ROBOT, extent, picture, text_at};
use crate::metrics::{PEN_GAP_MAX_S, ToolSample};
use crate::path::PathSample;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, VPos};
use std::path::Path;

const WIDTH_PX: u32 = 1200;
/// Points nearer than this to the one drawn before are not drawn \[px\].
const NEAR_PX: f64 = 0.35;

const PEN_DOWN: Key<'_> = Key { label: "pen, down", colour: PEN, width_px: 6, opacity: 0.30 };
const PEN_HOVER: Key<'_> = Key { label: "pen, hover", colour: PEN, width_px: 1, opacity: 0.35 };
const TOOL_DOWN: Key<'_> = Key { label: "robot, pen down", colour: ROBOT, width_px: 2, opacity: 1.0 };
const TOOL_HOVER: Key<'_> = Key { label: "robot, pen up", colour: ROBOT, width_px: 1, opacity: 0.35 };

/// One small picture of a grid.
#[derive(Debug, Clone, Copy)]
pub struct Cell<'a> {
    /// Written above it.
    pub label: &'a str,
    /// The pen over the stretch of time of interest.
    pub pen: &'a [PathSample],
    /// The tool over the same stretch.
    pub tool: &'a [ToolSample],
}

/// Draws many short stretches (letters) as a grid of small pictures with one common scale.
///
/// # Errors
/// [`PlotError`]: no cell with samples, or the file cannot be written.
pub fn letter_grid(file: &Path, title: &str, subtitle: &str, cells: &[Cell<'_>]) -> Result<(), PlotError> {
    let drawable: Vec<(&Cell<'_>, Runs, [[f64; 2]; 2])> = cells
        .iter()
        .filter_map(|c| {
            let runs = Runs::new(c.pen, c.tool);
            let bounds = runs.bounds()?;
            Some((c, runs, bounds))
        })
        .collect();
    let span = extent(drawable.iter().flat_map(|(_, _, [a, b])| [b[0] - a[0], b[1] - a[1]]));
    let Some((_, span)) = span else {
        return Err(PlotError::Empty { file: file.to_path_buf(), what: "no cell with samples" });
    };
    let columns = (drawable.len() as f64 * 1.5).sqrt().ceil().clamp(1.0, 12.0) as usize;
    let rows = drawable.len().div_ceil(columns);
    let cell_px = (WIDTH_PX / columns as u32).min(320);
    let legend = drawable.first().map(|(_, runs, _)| runs.legend()).unwrap_or_default();
    let head = super::canvas::head_px(subtitle, &legend, WIDTH_PX) as u32;
    let size = (WIDTH_PX, head + rows as u32 * cell_px + 24);
    let half = span.max(1e-6) * 0.56;
    picture(file, size, title, subtitle, &legend, |area| {
        for ((cell, runs, [low, high]), place) in drawable.iter().zip(area.split_evenly((rows, columns))) {
            small_picture(&place, cell.label, runs, [low, high], half)?;
        }
        Ok(())
    })
}

pub(super) fn small_picture(
    area: &Area<'_>,
    label: &str,
    runs: &Runs,
    [low, high]: [&[f64; 2]; 2],
    half: f64,
) -> DrawResult {
    let (width, height) = area.dim_in_pixel();
    area.draw(&Text::new(label.to_owned(), (6, 4), text_at(&MUTED, HPos::Left, VPos::Top)))?;
    let side = width.min(height).saturating_sub(18);
    let square = area.clone().shrink((((width - side) / 2) as i32, 18), (side, side));
    let (cx, cy) = ((low[0] + high[0]) / 2.0, (low[1] + high[1]) / 2.0);
    let mut chart =
        ChartBuilder::on(&square).build_cartesian_2d(cx - half..cx + half, cy - half..cy + half)?;
    for (key, run) in runs.drawn(2.0 * half / f64::from(side.max(1)) * NEAR_PX) {
        chart.draw_series(std::iter::once(PathElement::new(run, key.stroke())))?;
    }
    area.draw(&Rectangle::new(
        [(0, 0), (width as i32 - 4, height as i32 - 4)],
        INK.mix(0.08).stroke_width(1),
    ))?;
    Ok(())
}

/// Stretches of one kind, in millimetres, in the order in which they are painted.
pub(super) struct Runs {
    pen_hover: Polylines,
    pen_down: Polylines,
    tool_hover: Polylines,
    tool_down: Polylines,
}

impl Runs {
    pub(super) fn new(pen: &[PathSample], tool: &[ToolSample]) -> Self {
        let pen_rows = pen.iter().map(|s| (s.t_s, s.x_m, s.y_m, s.contact));
        let (pen_down, pen_hover) = split_runs(pen_rows, PEN_GAP_MAX_S);
        let mut newest = pen.iter().peekable();
        let mut down = pen.first().is_some_and(|s| s.contact);
        let tool_rows = tool.iter().map(|s| {
            while let Some(sample) = newest.next_if(|p| p.t_s <= s.t_s) {
                down = sample.contact;
            }
            (s.t_s, s.x_m, s.y_m, down || pen.is_empty())
        });
        let (tool_down, tool_hover) = split_runs(tool_rows, f64::INFINITY);
        Self { pen_hover, pen_down, tool_hover, tool_down }
    }

    fn all(&self) -> [(Key<'static>, &Polylines); 4] {
        [
            (PEN_DOWN, &self.pen_down),
            (PEN_HOVER, &self.pen_hover),
            (TOOL_DOWN, &self.tool_down),
            (TOOL_HOVER, &self.tool_hover),
        ]
    }

    pub(super) fn legend(&self) -> Vec<Key<'static>> {
        self.all().into_iter().filter(|(_, runs)| !runs.is_empty()).map(|(key, _)| key).collect()
    }

    pub(super) fn bounds(&self) -> Option<[[f64; 2]; 2]> {
        let points = || self.all().into_iter().flat_map(|(_, runs)| runs.iter().flatten());
        let (left, right) = extent(points().map(|p| p.0))?;
        let (low, high) = extent(points().map(|p| p.1))?;
        Some([[left, low], [right, high]])
    }

    /// Thin lines first, without indistinguishable points.
    fn drawn(&self, near: f64) -> Vec<(Key<'static>, Vec<(f64, f64)>)> {
        let mut order = self.all();
        order.swap(0, 1);
        order.swap(2, 3);
        order.into_iter().flat_map(|(key, runs)| runs.iter().map(move |r| (key, apart(r, near)))).collect()
    }
}

pub(super) type Polylines = Vec<Vec<(f64, f64)>>;

/// Splits rows (t \[s\], x \[m\], y \[m\], down) into runs of equal contact, broken at gaps; joined at their
/// ends.
pub(super) fn split_runs(
    rows: impl Iterator<Item = (f64, f64, f64, bool)>,
    gap_s: f64,
) -> (Polylines, Polylines) {
    let (mut down, mut up): (Polylines, Polylines) = (Vec::new(), Vec::new());
    let mut last: Option<(f64, bool, (f64, f64))> = None;
    for (t, x, y, contact) in rows.filter(|r| r.1.is_finite() && r.2.is_finite()) {
        let point = (x * 1e3, y * 1e3);
        let runs = if contact { &mut down } else { &mut up };
        match (last, runs.last_mut()) {
            (Some((before, same, _)), Some(run)) if same == contact && t - before <= gap_s => run.push(point),
            (Some((before, _, joint)), _) if t - before <= gap_s => runs.push(vec![joint, point]),
            _ => runs.push(vec![point]),
        }
        last = Some((t, contact, point));
    }
    (down, up)
}

fn apart(run: &[(f64, f64)], near: f64) -> Vec<(f64, f64)> {
    let mut kept: Vec<(f64, f64)> = Vec::new();
    for &(x, y) in run {
        if kept.last().is_none_or(|k| (k.0 - x).hypot(k.1 - y) >= near) {
            kept.push((x, y));
        }
    }
    if let (Some(&end), Some(last)) = (run.last(), kept.last())
        && *last != end
    {
        kept.push(end);
    }
    kept
}
