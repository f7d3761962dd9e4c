//! The pen and one or more tools that followed it, each beside the pen in a panel of its own, true to scale.

use super::sheet::{Frame, LEFT, LEGEND, Picture, RIGHT, Sheet, Shown, WIDTH};
use crate::metrics::{PEN_GAP_MAX_S, ToolSample};
use crate::path::PathSample;
use crate::plot::canvas::extent;
use crate::plot::overlay::{Polylines, split_runs};

/// Highest panel [px]: two of them, their legend and a caption fit a laptop's screen.
const PANEL_MAX: f64 = 250.0;

/// A tool that followed the pen.
#[derive(Debug, Clone, Copy)]
pub struct Traced<'a> {
    /// The series it belongs to.
    pub shown: Shown,
    /// Written above its panel.
    pub label: &'a str,
    /// Where it was; its clock is the pen's.
    pub tool: &'a [ToolSample],
}

/// The same stretch of writing once per tool, with one scale. `None` without anything to draw.
#[must_use]
pub fn paths(title: &str, about: &str, pen: &[PathSample], traced: &[Traced<'_>]) -> Option<Picture> {
    let rows = pen.iter().map(|s| (s.t_s, s.x_m, s.y_m, s.contact));
    let (pen_down, pen_up) = split_runs(rows, PEN_GAP_MAX_S);
    let tools: Vec<(Polylines, Polylines)> = traced.iter().map(|one| runs(pen, one.tool)).collect();
    let all = || {
        let tools = tools.iter().flat_map(|(down, up)| [down, up]);
        [&pen_down, &pen_up].into_iter().chain(tools).flatten().flatten()
    };
    let (left, right) = extent(all().map(|p| p.0))?;
    let (low, high) = extent(all().map(|p| p.1))?;
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
    if !pen_up.is_empty() {
        entries.push(("pen thin", "in the air"));
    }
    entries.extend(traced.iter().map(|one| (one.shown.class(), one.label)));
    sheet.legend(&entries);
    let lines = panels.div_ceil(columns);
    for index in 0..panels {
        let (column, line) = (index % columns, index / columns);
        let frame = Frame {
            at: (LEFT + column as f64 * (room + gap), LEGEND + head + line as f64 * (height + gap + head)),
            size: (room, height),
            x: (middle - half, middle + half),
            y: (low - pad, high + pad),
        };
        let label = traced.get(index).map_or("[mm]".to_owned(), |one| format!("{} [mm]", one.label));
        frame.axes(&mut sheet, (line + 1 == lines).then_some("[mm]"), &label);
        draw(&mut sheet, &frame, "line pen thin", &pen_up);
        draw(&mut sheet, &frame, "line pen wide", &pen_down);
        if let (Some(one), Some((down, up))) = (traced.get(index), tools.get(index)) {
            let class = one.shown.class();
            draw(&mut sheet, &frame, &format!("line {class} thin"), up);
            draw(&mut sheet, &frame, &format!("line {class}"), down);
        }
    }
    let total = LEGEND + lines as f64 * (height + head) + (lines - 1) as f64 * gap + 44.0;
    Some(sheet.done(title, about, total))
}

fn draw(sheet: &mut Sheet, frame: &Frame, class: &str, runs: &Polylines) {
    for run in runs {
        sheet.line(class, &frame.placed(run));
    }
}

/// A tool's path, apart where the pen was down at the same instant, in mm.
fn runs(pen: &[PathSample], tool: &[ToolSample]) -> (Polylines, Polylines) {
    let mut newest = pen.iter().peekable();
    let mut down = pen.first().is_some_and(|s| s.contact);
    let rows = tool.iter().map(|s| {
        while let Some(sample) = newest.next_if(|p| p.t_s <= s.t_s) {
            down = sample.contact;
        }
        (s.t_s, s.x_m, s.y_m, down || pen.is_empty())
    });
    split_runs(rows, PEN_GAP_MAX_S)
}
