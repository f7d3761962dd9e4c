//! The answers to what-if questions as a picture: error over time, and the worst stroke of the recording.

use std::path::Path;

use foretrace_sim::plot::{Cell, Line, Mark, Panel, PlotError, panels_and_cells};

use crate::what_if::Answer;

/// Draws `answer` about the recording called `name` into `file`.
///
/// # Errors
///
/// The file cannot be written, or the pen never writes.
pub fn draw(file: &Path, name: &str, answer: &Answer) -> Result<(), PlotError> {
    let pairs = || answer.rows.iter().zip(&answer.curves);
    let line = |(row, curve)| {
        let (row, curve): (&crate::score::Score, &crate::score::Curve) = (row, curve);
        Line { label: row.name.as_str(), points: &curve.error_mm, mark: Mark::Solid }
    };
    let lines: Vec<_> = pairs().map(line).collect();
    let labels: Vec<_> =
        pairs().map(|(row, curve)| format!("{}: {:.2} mm rms", row.name, curve.stroke_mm)).collect();
    let cells = labels.iter().zip(&answer.curves);
    let cells: Vec<_> =
        cells.map(|(label, curve)| Cell { label, pen: &answer.stroke, tool: &curve.tool }).collect();
    let y_label = format!("error, rms over {:.1} s [mm]", answer.stretch_s);
    let at_s = answer.rows.first().map_or(0.0, |row| row.worst_stroke_at_s);
    let subtitle = format!(
        "Distance of tool and pen while it writes, {:.0} s; below, the stroke that was worst as recorded, at \
         {at_s:.1} s. The modelled arm is {:.2} mm rms from the recorded one.",
        answer.seconds, answer.arm_misfit_mm
    );
    let panel = Panel { y_label: &y_label, y_range: None, lines: &lines };
    panels_and_cells(file, &format!("What if: {name}"), &subtitle, "time [s]", &[panel], &cells)
}
