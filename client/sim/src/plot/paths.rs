//! The pen and the tools that followed it, true to scale: large on a page, or many small ones beside each
//! other.

use std::path::Path;

use super::sheet::{AxisFrame, Hung, LEFT, Picture, RIGHT, Sheet, Shown, WIDTH, extent};
use super::{PlotError, empty};
use crate::metrics::{PEN_GAP_MAX_S, ToolSample};
use crate::path::PathSample;

/// Highest panel \[px\]: two of them, their legend and a caption fit a laptop's screen.
const PANEL_MAX: f64 = 250.0;

/// A tool that followed the pen.
#[derive(Debug, Clone, Copy)]
pub struct Traced<'a> {
    pub shown: Shown,
    /// Written above its panel.
    pub label: &'a str,
    /// Its clock is the pen's.
    pub tool: &'a [ToolSample],
}

/// One small picture of a grid.
#[derive(Debug, Clone, Copy)]
pub struct Cell<'a> {
    pub label: &'a str,
    /// The pen over the stretch of time of interest.
    pub pen: &'a [PathSample],
    /// The tool over the same stretch.
    pub tool: &'a [ToolSample],
}

/// The same stretch of writing once per tool, with one scale. `None` without anything to draw.
#[must_use]
pub fn paths(title: &str, about: &str, pen: &[PathSample], traced: &[Traced<'_>]) -> Option<Picture> {
    let pen_runs = Runs::of_pen(pen);
    let tools: Vec<Runs> = traced.iter().map(|one| Runs::of_tool(pen, one.tool, PEN_GAP_MAX_S)).collect();
    let [(left, right), (low, high)] = bounds(tools.iter().chain([&pen_runs]))?;
    let pad = (0.04 * (right - left).max(high - low)).max(1.0);
    let (span_x, span_y) = (right - left + 2.0 * pad, high - low + 2.0 * pad);
    // Wide writing is stacked, tall writing stands side by side.
    let columns = if span_x > 1.7 * span_y { 1 } else { traced.len().clamp(1, 3) };
    let panels = traced.len().max(1);
    let (gap, head) = (26.0, 24.0);
    let room = (WIDTH - LEFT - RIGHT - gap * (columns - 1) as f64) / columns as f64;
    let px_per_mm = (room / span_x).min(PANEL_MAX * if columns == 1 { 1.0 } else { 1.6 } / span_y);
    let height = px_per_mm * span_y;
    let half = room / px_per_mm / 2.0;
    let middle = (left + right) / 2.0;
    let mut sheet = Sheet::default();
    let mut entries = vec![("pen wide", "the pen, writing")];
    if !pen_runs.up.is_empty() {
        entries.push(("pen thin", "in the air"));
    }
    entries.extend(traced.iter().map(|one| (one.shown.class(), one.label)));
    let top = sheet.legend(&entries);
    let lines = panels.div_ceil(columns);
    for index in 0..panels {
        let (column, line) = (index % columns, index / columns);
        let frame = AxisFrame {
            at: (LEFT + column as f64 * (room + gap), top + head + line as f64 * (height + gap + head)),
            size: (room, height),
            x: (middle - half, middle + half),
            y: (low - pad, high + pad),
        };
        let label = traced.get(index).map_or("[mm]".to_owned(), |one| format!("{} [mm]", one.label));
        frame.axes(&mut sheet, (line + 1 == lines).then_some("[mm]"), &label);
        pen_runs.draw(&mut sheet, &frame, "pen", " wide");
        if let (Some(one), Some(runs)) = (traced.get(index), tools.get(index)) {
            runs.draw(&mut sheet, &frame, one.shown.class(), "");
        }
    }
    let total = top + lines as f64 * (height + head) + (lines - 1) as f64 * gap + 44.0;
    Some(sheet.done(title, about, total))
}

/// Draws many short stretches (letters) as a grid of small pictures with one common scale.
///
/// # Errors
/// [`PlotError`]: no cell with samples, or the file cannot be written.
pub fn letter_grid(file: &Path, title: &str, subtitle: &str, cells: &[Cell<'_>]) -> Result<(), PlotError> {
    let columns = (cells.len() as f64 * 1.5).sqrt().ceil().clamp(1.0, 12.0) as usize;
    let mut sheet = Sheet::default();
    let bottom =
        cells_below(&mut sheet, 0.0, cells, columns).ok_or_else(|| empty(file, "no cell with samples"))?;
    sheet.chart(file, title, subtitle, bottom)
}

/// Draws a legend and the cells that have samples from `top` downwards; where they end.
pub(super) fn cells_below(sheet: &mut Sheet, top: f64, cells: &[Cell<'_>], columns: usize) -> Option<f64> {
    let drawn: Vec<_> = cells
        .iter()
        .filter_map(|cell| {
            let (pen, tool) = (Runs::of_pen(cell.pen), Runs::of_tool(cell.pen, cell.tool, f64::INFINITY));
            let bounds = bounds([&pen, &tool])?;
            Some((cell.label, pen, tool, bounds))
        })
        .collect();
    let (_, span) = extent(drawn.iter().flat_map(|(.., bounds)| bounds.map(|(low, high)| high - low)))?;
    let legend = |class, label, any: fn(&Runs, &Runs) -> bool| {
        drawn.iter().any(|(_, pen, tool, _)| any(pen, tool)).then_some((class, label))
    };
    let entries = [
        legend("pen wide", "pen, down", |pen, _| !pen.down.is_empty()),
        legend("pen thin", "pen, hover", |pen, _| !pen.up.is_empty()),
        legend("arm", "robot, pen down", |_, tool| !tool.down.is_empty()),
        legend("arm thin", "robot, pen up", |_, tool| !tool.up.is_empty()),
    ];
    let mut legend = Sheet::default();
    let head = legend.legend(&entries.into_iter().flatten().collect::<Vec<_>>());
    sheet.put(legend, top);
    let columns = columns.min(drawn.len());
    let wide = (WIDTH - LEFT - RIGHT) / columns as f64;
    let side = wide.min(256.0);
    let half = 0.56 * span.max(1e-6);
    for (index, (label, pen, tool, [(left, right), (low, high)])) in drawn.iter().enumerate() {
        let (column, row) = (index % columns, index / columns);
        let corner = (LEFT + column as f64 * wide, top + head + row as f64 * side);
        sheet.rect("box", corner, (wide - 4.0, side - 4.0));
        sheet.text((corner.0 + 6.0, corner.1 + 15.0), "", Hung::Left, label);
        let (x, y) = ((left + right) / 2.0, (low + high) / 2.0);
        let frame = AxisFrame {
            at: (corner.0 + (wide - side) / 2.0 + 9.0, corner.1 + 18.0),
            size: (side - 22.0, side - 22.0),
            x: (x - half, x + half),
            y: (y - half, y + half),
        };
        pen.draw(sheet, &frame, "pen", " wide");
        tool.draw(sheet, &frame, "arm", "");
    }
    Some(top + head + drawn.len().div_ceil(columns) as f64 * side + 16.0)
}

type Polylines = Vec<Vec<(f64, f64)>>;

/// A path in mm, apart where the pen was down and where it was up.
struct Runs {
    down: Polylines,
    up: Polylines,
}

impl Runs {
    fn of_pen(pen: &[PathSample]) -> Self {
        Self::of(pen.iter().map(|s| (s.t_s, s.x_m, s.y_m, s.contact)), PEN_GAP_MAX_S)
    }

    /// A tool's path, apart where the pen was down at the same instant.
    fn of_tool(pen: &[PathSample], tool: &[ToolSample], gap_s: f64) -> Self {
        let mut newest = pen.iter().peekable();
        let mut down = pen.first().is_some_and(|s| s.contact);
        let rows = tool.iter().map(|s| {
            while let Some(sample) = newest.next_if(|p| p.t_s <= s.t_s) {
                down = sample.contact;
            }
            (s.t_s, s.x_m, s.y_m, down || pen.is_empty())
        });
        Self::of(rows, gap_s)
    }

    /// Rows (t \[s\], x \[m\], y \[m\], down) as runs of equal contact, broken at gaps; joined at their ends.
    fn of(rows: impl Iterator<Item = (f64, f64, f64, bool)>, gap_s: f64) -> Self {
        let mut all = Self { down: Vec::new(), up: Vec::new() };
        let mut last: Option<(f64, bool, (f64, f64))> = None;
        for (t, x, y, contact) in rows.filter(|r| r.1.is_finite() && r.2.is_finite()) {
            let point = (x * 1e3, y * 1e3);
            let runs = if contact { &mut all.down } else { &mut all.up };
            match (last, runs.last_mut()) {
                (Some((before, same, _)), Some(run)) if same == contact && t - before <= gap_s => {
                    run.push(point);
                }
                (Some((before, _, joint)), _) if t - before <= gap_s => runs.push(vec![joint, point]),
                _ => runs.push(vec![point]),
            }
            last = Some((t, contact, point));
        }
        all
    }

    /// What was in the air first and thin.
    fn draw(&self, sheet: &mut Sheet, frame: &AxisFrame, class: &str, down: &str) {
        for (runs, how) in [(&self.up, " thin"), (&self.down, down)] {
            for run in runs {
                sheet.line(&format!("line {class}{how}"), &frame.placed(run));
            }
        }
    }
}

/// Smallest and largest x and y.
fn bounds<'r>(all: impl IntoIterator<Item = &'r Runs>) -> Option<[(f64, f64); 2]> {
    let points: Vec<_> =
        all.into_iter().flat_map(|runs| [&runs.down, &runs.up]).flatten().flatten().copied().collect();
    Some([extent(points.iter().map(|p| p.0))?, extent(points.iter().map(|p| p.1))?])
}
