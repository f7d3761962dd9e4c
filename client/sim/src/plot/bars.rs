//! A table as bars: one row per model, one column of bars per measure.

use std::path::Path;

use super::sheet::{Hung, RIGHT, Sheet, WIDTH, text_width};
use super::{PlotError, empty};

const ROW: f64 = 26.0;
const HEAD: f64 = 32.0;
const GAP: f64 = 24.0;

/// One measure of all rows.
#[derive(Debug, Clone)]
pub struct Bars<'a> {
    /// Its name with unit.
    pub label: &'a str,
    /// One value per row; what is unknown, negative or not finite gets no bar.
    pub values: Vec<Option<f64>>,
    /// Digits after the point.
    pub digits: usize,
    /// Which end is good: the best bar is marked.
    pub best: Best,
}

/// Which values of a measure are good.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Best {
    Lowest,
    Highest,
}

/// Draws a table of bars; `rows` are the names on the left.
///
/// # Errors
/// [`PlotError`]: no value to draw, or the file cannot be written.
pub fn bar_table(
    file: &Path,
    title: &str,
    subtitle: &str,
    rows: &[&str],
    columns: &[Bars<'_>],
) -> Result<(), PlotError> {
    if rows.is_empty() || !columns.iter().any(|c| c.values.iter().flatten().any(|v| drawable(*v))) {
        return Err(empty(file, "no values"));
    }
    let names = 40.0 + rows.iter().map(|name| text_width(name)).fold(0.0, f64::max);
    let mut sheet = Sheet::default();
    for (index, name) in rows.iter().enumerate() {
        sheet.text((names - 12.0, row_top(index) + 17.5), "strong", Hung::Right, name);
    }
    let width = (WIDTH - RIGHT - names) / columns.len().max(1) as f64;
    for (index, column) in columns.iter().enumerate() {
        draw_column(&mut sheet, column, names + width * index as f64, width - GAP);
    }
    sheet.chart(file, title, subtitle, row_top(rows.len()) + 16.0)
}

fn draw_column(sheet: &mut Sheet, column: &Bars<'_>, left: f64, width: f64) {
    sheet.text((left, HEAD - 10.0), "", Hung::Left, column.label);
    let known = || column.values.iter().flatten().copied().filter(|v| drawable(*v));
    let best = match column.best {
        Best::Lowest => known().fold(f64::INFINITY, f64::min),
        Best::Highest => known().fold(0.0, f64::max),
    };
    let words = |value: f64| format!("{value:.*}", column.digits);
    let text = 8.0 + known().map(|v| text_width(&words(v))).fold(0.0, f64::max);
    let (room, largest) = ((width - text).max(1.0), known().fold(0.0, f64::max));
    for (index, value) in column.values.iter().enumerate() {
        let (top, height) = (row_top(index) + 4.0, ROW - 8.0);
        let Some(value) = value.filter(|v| drawable(*v)) else {
            sheet.text((left, top + 13.5), "", Hung::Left, "–");
            continue;
        };
        let share = if largest > 0.0 { value / largest } else { 0.0 };
        let (bar, class) = if value == best { ("calm-bar", "strong") } else { ("pen-bar", "") };
        sheet.rect("shade", (left, top), (room, height));
        sheet.rect(bar, (left, top), ((room * share).max(1.0), height));
        sheet.text((left + room + 6.0, top + 13.5), class, Hung::Left, &words(value));
    }
}

fn row_top(index: usize) -> f64 {
    HEAD + ROW * index as f64
}

fn drawable(value: f64) -> bool {
    value.is_finite() && value >= 0.0
}
