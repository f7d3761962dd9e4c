//! The answers to what-if questions as a picture: error over time, and the worst stroke of the recording.

use std::path::Path;

use foretrace_sim::plot::{Cell, ChartPanel, Line, Mark, PlotError, panels_and_cells};

use crate::what_if::WhatIfReport;

/// Draws `answer` about the recording called `name` into `file`.
///
/// # Errors
///
/// The file cannot be written, or the pen never writes.
pub fn draw(file: &Path, name: &str, answer: &WhatIfReport) -> Result<(), PlotError> {
    let names = || answer.rows.iter().map(|row| row.name.as_str());
    let (top, cut) = top(answer.curves.iter().flat_map(|curve| &curve.error_mm).map(|point| point.1));
    let below = |points: &[(f64, f64)]| points.iter().map(|(t, mm)| (*t, mm.min(top))).collect::<Vec<_>>();
    let points: Vec<_> = answer.curves.iter().map(|curve| below(&curve.error_mm)).collect();
    let lines: Vec<_> =
        names().zip(&points).map(|(label, points)| Line { label, points, mark: Mark::Solid }).collect();
    let labels: Vec<_> = names()
        .zip(&answer.curves)
        .map(|(name, curve)| format!("{name}: {:.2} mm rms", curve.stroke_mm))
        .collect();
    let cells = labels.iter().zip(&answer.curves);
    let cells: Vec<_> =
        cells.map(|(label, curve)| Cell { label, pen: &answer.stroke, tool: &curve.tool }).collect();
    let y_label = format!("error, rms over {:.1} s [mm]", answer.stretch_s);
    let at_s = answer.rows.first().map_or(0.0, |row| row.worst_stroke_at_s);
    let subtitle = format!(
        "Distance of tool and pen while it writes, {:.0} s{}. Below: the stroke that was worst as recorded, at \
         {at_s:.1} s. The modelled arm is {:.2} mm rms from the recorded one.",
        answer.seconds,
        cut.map_or_else(String::new, |most| format!(", peaks of up to {most:.0} mm cut off")),
        answer.arm_misfit_mm
    );
    let panel = ChartPanel { y_label: &y_label, y_range: Some((0.0, top)), lines: &lines };
    panels_and_cells(file, &format!("What if: {name}"), &subtitle, "time [s]", &[panel], &cells)
}

/// The top of the axis for `values` \[mm\], and the largest of them if it is above.
fn top(values: impl Iterator<Item = f64>) -> (f64, Option<f64>) {
    let mut values: Vec<f64> = values.filter(|value| value.is_finite()).collect();
    values.sort_by(f64::total_cmp);
    let most = values.last().copied().unwrap_or(1.0);
    let usual = values.get(values.len() * 98 / 100).copied().unwrap_or(most);
    // A pen that leaps costs a moment that would make a flat line of all others.
    if most > 3.0 * usual && usual > 0.0 { (2.0 * usual, Some(most)) } else { (1.06 * most.max(1e-3), None) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_peak_does_not_flatten_the_rest_and_is_reported() {
        let quiet = || (0..200).map(|k| 1.0 + 0.001 * f64::from(k));
        assert_eq!(top(quiet()).1, None);
        let (axis, cut) = top(quiet().chain([283.0]));
        assert!(axis > 2.0 && axis < 3.0 && cut == Some(283.0), "{axis} {cut:?}");
        assert!(top([].into_iter()).0 > 0.0 && top([0.0].into_iter()).0 > 0.0);
    }
}
