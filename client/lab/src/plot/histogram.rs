//! How long things took: one histogram per quantity, both axes logarithmic, percentiles marked.

use super::PlotError;
use super::canvas::{Area, DrawResult, INK, MUTED, ROBOT, SERIES, extent, picture, text, text_at};
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, VPos};
use std::path::Path;

const WIDTH_PX: u32 = 1200;
const PANEL_PX: u32 = 190;
/// Bars per factor of ten.
const BARS_PER_DECADE: f64 = 24.0;

/// Counted values of one quantity, as an HDR histogram's recorded values give them.
#[derive(Debug, Clone)]
pub struct Distribution {
    /// What was measured.
    pub label: String,
    /// (value in µs, how often); any order.
    pub counts_us: Vec<(f64, u64)>,
}

impl Distribution {
    /// From single values in µs.
    #[must_use]
    pub fn from_values_us(label: impl Into<String>, values_us: impl IntoIterator<Item = f64>) -> Self {
        Self { label: label.into(), counts_us: values_us.into_iter().map(|v| (v, 1)).collect() }
    }

    /// Smallest value in µs that at least `share` of all values do not exceed; `None` without values.
    #[must_use]
    pub fn quantile_us(&self, share: f64) -> Option<f64> {
        let mut sorted: Vec<(f64, u64)> = self.counts_us.iter().copied().filter(counted).collect();
        sorted.sort_by(|a, b| a.0.total_cmp(&b.0));
        let total: u64 = sorted.iter().map(|c| c.1).sum();
        let rank = ((share.clamp(0.0, 1.0) * total as f64).ceil() as u64).max(1);
        let mut seen = 0;
        sorted.iter().find_map(|(value, count)| {
            seen += count;
            (seen >= rank).then_some(*value)
        })
    }
}

/// Draws histograms under each other on one time axis, with p50, p99, p99.9 and the maximum marked.
///
/// # Errors
/// [`PlotError`]: no distribution has a value, or the file cannot be written.
pub fn histograms(
    file: &Path,
    title: &str,
    subtitle: &str,
    distributions: &[Distribution],
) -> Result<(), PlotError> {
    let filled: Vec<&Distribution> =
        distributions.iter().filter(|d| d.counts_us.iter().any(counted)).collect();
    let values = filled.iter().flat_map(|d| &d.counts_us).filter(|c| counted(c)).map(|c| shown(c.0));
    let Some((low, high)) = extent(values) else {
        return Err(PlotError::Empty { file: file.to_path_buf(), what: "no values counted" });
    };
    let first = low.log10().floor();
    let last = high.log10().ceil().max(first + 1.0);
    let size = (WIDTH_PX, 110 + PANEL_PX * filled.len() as u32);
    picture(file, size, title, subtitle, &[], |area| {
        let places = area.split_evenly((filled.len(), 1));
        for (index, (distribution, place)) in filled.iter().zip(&places).enumerate() {
            let colour = SERIES.get(index % 2 * 4).copied().unwrap_or(INK);
            draw_panel(place, distribution, (first, last), colour, index + 1 == filled.len())?;
        }
        Ok(())
    })
}

fn counted(count: &(f64, u64)) -> bool {
    count.0.is_finite() && count.0 >= 0.0 && count.1 > 0
}

/// Nothing takes no time: what a clock rounds to zero is shown at its resolution, 1 ns.
fn shown(value_us: f64) -> f64 {
    value_us.max(1e-3)
}

fn draw_panel(
    area: &Area<'_>,
    distribution: &Distribution,
    (first, last): (f64, f64),
    colour: RGBColor,
    lowest: bool,
) -> DrawResult {
    let bars = ((last - first) * BARS_PER_DECADE).round().max(1.0) as usize;
    let mut heights = vec![0_u64; bars];
    for (value, count) in distribution.counts_us.iter().filter(|c| counted(c)) {
        let bar = ((shown(*value).log10() - first) * BARS_PER_DECADE) as usize;
        if let Some(height) = heights.get_mut(bar.min(bars - 1)) {
            *height += count;
        }
    }
    let total: u64 = heights.iter().sum();
    let tallest = heights.iter().copied().max().unwrap_or(1) as f64;
    // Room above the tallest bar for the names of the percentiles.
    let (bottom, top) = (0.6, (tallest * 5.0).max(20.0));
    let mut chart = ChartBuilder::on(area)
        .margin_top(30)
        .x_label_area_size(if lowest { 46 } else { 22 })
        .y_label_area_size(70)
        .build_cartesian_2d(first..last, (bottom..top).log_scale())?;
    chart
        .configure_mesh()
        .light_line_style(TRANSPARENT)
        .bold_line_style(super::canvas::FAINT.stroke_width(1))
        .axis_style(MUTED.stroke_width(1))
        .label_style(text(&MUTED))
        .axis_desc_style(text(&INK))
        .x_labels((last - first) as usize + 1)
        .y_labels(5)
        .x_desc(if lowest { "time" } else { "" })
        .y_desc("count")
        .x_label_formatter(&|decade| microseconds(10f64.powf(*decade)))
        .y_label_formatter(&|count| if *count >= 1.0 { format!("{count:.0}") } else { String::new() })
        .draw()?;
    chart.draw_series(heights.iter().enumerate().filter(|(_, h)| **h > 0).map(|(bar, height)| {
        let left = first + bar as f64 / BARS_PER_DECADE;
        let right = left + 0.92 / BARS_PER_DECADE;
        Rectangle::new([(left, bottom), (right, *height as f64)], colour.mix(0.75).filled())
    }))?;
    let mut summary = format!("{} · {total} values", distribution.label);
    let mut labelled = f64::NEG_INFINITY;
    for (name, share) in [("p50", 0.5), ("p99", 0.99), ("p99.9", 0.999), ("max", 1.0)] {
        let Some(value) = distribution.quantile_us(share) else { continue };
        let x = shown(value).log10();
        chart.draw_series(std::iter::once(PathElement::new(
            vec![(x, bottom), (x, top)],
            ROBOT.mix(0.8).stroke_width(1),
        )))?;
        summary.push_str(&format!(" · {name} {}", microseconds(value)));
        if (x - labelled) / (last - first) > 0.05 {
            let place = text_at(&ROBOT, HPos::Left, VPos::Top);
            chart.draw_series(std::iter::once(Text::new(format!(" {name}"), (x, top), place)))?;
            labelled = x;
        }
    }
    area.draw(&Text::new(summary, (70, 8), text_at(&INK, HPos::Left, VPos::Top)))?;
    Ok(())
}

/// Three figures and the unit that fits.
fn microseconds(value_us: f64) -> String {
    let (value, unit) = match value_us {
        v if v < 1.0 => (v * 1e3, "ns"),
        v if v < 1e3 => (v, "µs"),
        v if v < 1e6 => (v * 1e-3, "ms"),
        v => (v * 1e-6, "s"),
    };
    let digits = if value < 9.995 { 2 } else { usize::from(value < 99.95) };
    let text = format!("{value:.digits$}");
    let text = if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.') } else { &text };
    format!("{text} {unit}")
}
