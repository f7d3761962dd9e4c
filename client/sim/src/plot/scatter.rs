//! Named points in a plane, for example one per symbol.

use super::PlotError;
use super::canvas::{INK, MUTED, PEN, axes, extent, picture, text_at};
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, VPos};
use std::path::Path;

const SIZE_PX: (u32, u32) = (1200, 620);

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
    let shown: Vec<&Named<'_>> =
        points.iter().filter(|p| p.point.0.is_finite() && p.point.1.is_finite()).collect();
    let padded = |values: Vec<f64>| {
        extent(values).map(|(low, high)| {
            let margin = 0.06 * (high - low).max(1e-6);
            low - margin..high + margin
        })
    };
    let (Some(x_range), Some(y_range)) = (
        padded(shown.iter().map(|p| p.point.0).collect()),
        padded(shown.iter().map(|p| p.point.1).chain((!shown.is_empty()).then_some(0.0)).collect()),
    ) else {
        return Err(PlotError::Empty { file: file.to_path_buf(), what: "no points" });
    };
    picture(file, SIZE_PX, title, subtitle, &[], |area| {
        let ends = vec![(x_range.start, 0.0), (x_range.end, 0.0)];
        let mut chart = ChartBuilder::on(area)
            .x_label_area_size(48)
            .y_label_area_size(70)
            .build_cartesian_2d(x_range, y_range)?;
        axes(&mut chart, labels.0, labels.1)?;
        chart.draw_series(std::iter::once(PathElement::new(ends, MUTED.stroke_width(2))))?;
        let style = text_at(&INK, HPos::Left, VPos::Center);
        chart.draw_series(shown.iter().map(|p| {
            EmptyElement::at(p.point)
                + Circle::new((0, 0), 3, PEN.mix(0.6).filled())
                + Text::new(p.name.to_owned(), (6, 0), style.clone())
        }))?;
        Ok(())
    })
}
