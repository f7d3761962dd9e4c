//! How long things took, beside the time there was: one histogram per quantity, both axes logarithmic.

use super::histogram::{Distribution, counted, microseconds};
use super::sheet::{AxisFrame, Hung, LEFT, Picture, RIGHT, Sheet, WIDTH, extent};

/// Bars per factor of ten.
const BARS_PER_DECADE: f64 = 20.0;
/// Shorter durations count as this: nanoseconds need not be resolved \[µs\].
const SHORTEST_US: f64 = 0.1;
const PANEL: f64 = 96.0;
/// Room above a panel: its name, and a row of percentiles.
const HEAD: f64 = 44.0;

/// Draws the distributions under each other; percentiles stand in a row of words, so that they cannot
/// overlap.
///
/// `deadline_us`: the time there is \[µs\]. `None` without a value.
#[must_use]
pub fn durations(
    title: &str,
    about: &str,
    distributions: &[Distribution],
    deadline_us: f64,
) -> Option<Picture> {
    let filled: Vec<&Distribution> =
        distributions.iter().filter(|d| d.counts_us.iter().any(counted)).collect();
    let values = filled.iter().flat_map(|d| &d.counts_us).filter(|c| counted(c)).map(|c| shown(c.0));
    let (low, high) = extent(values)?;
    let high = if deadline_us.is_finite() { high.max(deadline_us * 1.2) } else { high };
    let first = low.log10().floor();
    let last = high.log10().ceil().max(first + 1.0);
    let mut sheet = Sheet::default();
    let mut top = 0.0;
    for distribution in &filled {
        top += HEAD;
        panel(&mut sheet, distribution, deadline_us, (first, last), top);
        top += PANEL + 24.0;
    }
    Some(sheet.done(title, about, top + 6.0))
}

fn shown(value_us: f64) -> f64 {
    value_us.max(SHORTEST_US)
}

fn panel(sheet: &mut Sheet, distribution: &Distribution, deadline_us: f64, x: (f64, f64), top: f64) {
    let (first, last) = x;
    let bars = ((last - first) * BARS_PER_DECADE).round().max(1.0) as usize;
    let mut heights = vec![0_u64; bars];
    for (value, count) in distribution.counts_us.iter().filter(|c| counted(c)) {
        let bar = ((shown(*value).log10() - first) * BARS_PER_DECADE) as usize;
        if let Some(height) = heights.get_mut(bar.min(bars - 1)) {
            *height += count;
        }
    }
    let tallest = heights.iter().copied().max().unwrap_or(1) as f64;
    let decades = tallest.log10().ceil().max(1.0);
    let frame =
        AxisFrame { at: (LEFT, top), size: (WIDTH - LEFT - RIGHT, PANEL), x, y: (-0.3, decades + 0.1) };
    let bottom = top + PANEL;
    let counts = (0..=decades as i32).map(|decade| (f64::from(decade), format!("{:.0}", 10f64.powi(decade))));
    frame.grid_y(sheet, counts);
    let times =
        (first as i32..=last as i32).map(|decade| (f64::from(decade), microseconds(10f64.powi(decade))));
    frame.grid_x(sheet, times);
    for (bar, height) in heights.iter().enumerate().filter(|(_, height)| **height > 0) {
        let left = frame.px(first + bar as f64 / BARS_PER_DECADE);
        let right = frame.px(first + (bar + 1) as f64 / BARS_PER_DECADE);
        let y = frame.py((*height as f64).log10());
        sheet.rect("arm-bar", (left + 0.5, y), (right - left - 1.0, bottom - y));
    }
    frame.outline(sheet);
    if deadline_us > 0.0 && deadline_us.is_finite() {
        let x = frame.px(deadline_us.log10());
        sheet.line("bound", &[(x, top - 4.0), (x, bottom)]);
        let words = format!("deadline {}", microseconds(deadline_us));
        sheet.text((x + 5.0, top + 11.0), "bound", Hung::Left, &words);
    }
    sheet.text((LEFT + 4.0, top - 26.0), "strong", Hung::Left, &distribution.label);
    let quantile = |share| distribution.quantile_us(share).map_or_else(String::new, microseconds);
    let words = format!(
        "number of ticks · half within {} · 99 % within {} · 99.9 % within {} · longest {}",
        quantile(0.5),
        quantile(0.99),
        quantile(0.999),
        quantile(1.0)
    );
    sheet.text((LEFT + 4.0, top - 8.0), "", Hung::Left, &words);
}
