//! A table as bars: one row per model, one column of bars per measure.

use super::PlotError;
use super::canvas::{Area, DrawResult, FAINT, INK, MUTED, PEN, TRUST, picture, text, text_at, text_width};
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, VPos};
use std::path::Path;

const WIDTH_PX: u32 = 1200;
const ROW_PX: i32 = 30;
const HEAD_PX: i32 = 44;
const GAP_PX: i32 = 26;

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
    /// Errors.
    Lowest,
    /// Shares won.
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
        return Err(PlotError::Empty { file: file.to_path_buf(), what: "no values" });
    }
    let names_px = 40 + rows.iter().map(|name| text_width(name)).max().unwrap_or(0);
    let size = (WIDTH_PX, (110 + HEAD_PX + ROW_PX * rows.len() as i32) as u32);
    picture(file, size, title, subtitle, &[], |area| {
        for (index, name) in rows.iter().enumerate() {
            let middle = row_top(index) + ROW_PX / 2;
            let style = text_at(&INK, HPos::Right, VPos::Center);
            area.draw(&Text::new((*name).to_owned(), (names_px - 12, middle), style))?;
        }
        let width = (WIDTH_PX as i32 - names_px - GAP_PX) / columns.len().max(1) as i32;
        for (index, column) in columns.iter().enumerate() {
            draw_column(area, column, names_px + width * index as i32, width - GAP_PX)?;
        }
        Ok(())
    })
}

fn draw_column(area: &Area<'_>, column: &Bars<'_>, left: i32, width: i32) -> DrawResult {
    area.draw(&Text::new(column.label.to_owned(), (left, HEAD_PX / 2), text(&MUTED)))?;
    let known = || column.values.iter().flatten().copied().filter(|v| drawable(*v));
    let best = match column.best {
        Best::Lowest => known().fold(f64::INFINITY, f64::min),
        Best::Highest => known().fold(0.0, f64::max),
    };
    let text_px = 8 + known().map(|v| text_width(&format!("{v:.*}", column.digits))).max().unwrap_or(0);
    let (room, largest) = (f64::from((width - text_px).max(1)), known().fold(0.0, f64::max));
    for (index, value) in column.values.iter().enumerate() {
        let (top, bottom) = (row_top(index) + 5, row_top(index) + ROW_PX - 5);
        let Some(value) = value.filter(|v| drawable(*v)) else {
            area.draw(&Text::new("–", (left, top), text(&MUTED)))?;
            continue;
        };
        let share = if largest > 0.0 { value / largest } else { 0.0 };
        let right = left + (room * share) as i32;
        let (colour, ink) = if value == best { (TRUST, INK) } else { (PEN, MUTED) };
        area.draw(&Rectangle::new([(left, top), (left + room as i32, bottom)], FAINT.mix(0.5).filled()))?;
        area.draw(&Rectangle::new([(left, top), (right.max(left + 1), bottom)], colour.mix(0.8).filled()))?;
        let place = (left + room as i32 + 6, (top + bottom) / 2);
        let style = text_at(&ink, HPos::Left, VPos::Center);
        area.draw(&Text::new(format!("{value:.*}", column.digits), place, style))?;
    }
    Ok(())
}

fn row_top(index: usize) -> i32 {
    HEAD_PX + ROW_PX * index as i32
}

fn drawable(value: f64) -> bool {
    value.is_finite() && value >= 0.0
}
