//! Charts above each other with a common x axis, and small pictures of pen and robot below them.

use super::PlotError;
use super::canvas::{Key, picture};
use super::overlay::{Cell, Runs, small_picture};
use super::panels::{Panel, coloured, draw_panel, x_range};
use std::path::Path;

const WIDTH_PX: u32 = 1200;
const PANEL_PX: u32 = 300;
const CELL_PX: u32 = 290;
/// Small pictures beside each other at most.
const COLUMNS: usize = 4;

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
    panels: &[Panel<'_>],
    cells: &[Cell<'_>],
) -> Result<(), PlotError> {
    let range = x_range(file, panels)?;
    let runs: Vec<_> = cells.iter().map(|cell| (cell.label, Runs::new(cell.pen, cell.tool))).collect();
    let drawable: Vec<_> =
        runs.iter().filter_map(|(label, runs)| Some((*label, runs, runs.bounds()?))).collect();
    let spans = drawable.iter().flat_map(|(_, _, [low, high])| [high[0] - low[0], high[1] - low[1]]);
    let Some(span) = spans.max_by(f64::total_cmp) else {
        return Err(PlotError::Empty { file: file.to_path_buf(), what: "no cell with samples" });
    };
    let half = span.max(1e-6) * 0.56;
    let lines = coloured(panels.iter());
    let strokes = drawable.first().map(|(_, runs, _)| runs.legend()).unwrap_or_default();
    let legend: Vec<Key<'_>> = lines.iter().copied().chain(strokes).collect();
    let columns = drawable.len().clamp(1, COLUMNS);
    let rows = drawable.len().div_ceil(columns);
    let head = super::canvas::head_px(subtitle, &legend, WIDTH_PX) as u32;
    let above = PANEL_PX * panels.len() as u32;
    let height = head + above + CELL_PX * rows as u32 + 48;
    picture(file, (WIDTH_PX, height), title, subtitle, &legend, |area| {
        let (charts, small) = area.split_vertically(above);
        let lowest = panels.len().saturating_sub(1);
        for (index, (panel, place)) in panels.iter().zip(charts.split_evenly((panels.len(), 1))).enumerate() {
            let x_label = if index == lowest { x_label } else { "" };
            draw_panel(&place, panel, &lines, range.clone(), x_label, None)?;
        }
        let small = small.margin(16, 0, 0, 0);
        for ((label, runs, [low, high]), place) in drawable.iter().zip(small.split_evenly((rows, columns))) {
            small_picture(&place, label, runs, [low, high], half)?;
        }
        Ok(())
    })
}
