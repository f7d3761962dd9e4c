//! Named points in a plane, for example one per symbol.

use std::path::Path;

use super::sheet::{AxisFrame, Hung, LEFT, RIGHT, Sheet, WIDTH, extent};
use super::{PlotError, empty};

/// A point with its name.
#[derive(Debug, Clone, Copy)]
pub struct Named<'a> {
    /// Written where it lies.
    pub name: &'a str,
    /// (x, y); left out if not finite.
    pub point: (f64, f64),
}

/// Draws names at their points and a line at y = 0.
///
/// # Errors
/// [`PlotError`]: no finite point, or the file cannot be written.
pub fn scatter(
    file: &Path,
    title: &str,
    subtitle: &str,
    labels: (&str, &str),
    points: &[Named<'_>],
) -> Result<(), PlotError> {
    let finite = |p: &&Named<'_>| p.point.0.is_finite() && p.point.1.is_finite();
    let shown: Vec<&Named<'_>> = points.iter().filter(finite).collect();
    let padded = |values: &mut dyn Iterator<Item = f64>| {
        extent(values).map(|(low, high)| {
            let margin = 0.06 * (high - low).max(1e-6);
            (low - margin, high + margin)
        })
    };
    let x = padded(&mut shown.iter().map(|p| p.point.0)).ok_or_else(|| empty(file, "no points"))?;
    let y =
        padded(&mut shown.iter().map(|p| p.point.1).chain([0.0])).ok_or_else(|| empty(file, "no points"))?;
    let frame = AxisFrame { at: (LEFT, 22.0), size: (WIDTH - LEFT - RIGHT, 460.0), x, y };
    let mut sheet = Sheet::default();
    frame.axes(&mut sheet, Some(labels.0), labels.1);
    let zero = frame.py(0.0);
    sheet.line("axis", &[(LEFT, zero), (WIDTH - RIGHT, zero)]);
    for Named { name, point } in shown {
        let (x, y) = (frame.px(point.0), frame.py(point.1));
        sheet.dot("s0", (x, y), 3.0);
        sheet.text((x + 6.0, y + 4.5), "strong", Hung::Left, name);
    }
    sheet.chart(file, title, subtitle, 526.0)
}
