//! The common look: palette, title block with legend, axes, and an SVG string that becomes a file.

use super::page::escaped;
use super::{PlotError, write_whole};
use plotters::coord::Shift;
use plotters::coord::ranged1d::{Ranged, ValueFormatter};
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use std::path::Path;

pub(super) type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;
pub(super) type DrawResult = Result<(), Box<dyn std::error::Error>>;

pub(super) const INK: RGBColor = RGBColor(0x1f, 0x29, 0x37);
pub(super) const MUTED: RGBColor = RGBColor(0x6b, 0x72, 0x80);
pub(super) const FAINT: RGBColor = RGBColor(0xe5, 0xe7, 0xeb);
pub(super) const PEN: RGBColor = RGBColor(0x1f, 0x3b, 0x73);
pub(super) const ROBOT: RGBColor = RGBColor(0xe4, 0x6c, 0x0a);
pub(super) const TRUST: RGBColor = RGBColor(0x1b, 0x9e, 0x77);
/// For further series; distinguishable also with colour-blind eyes.
pub(super) const SERIES: [RGBColor; 17] = [
    RGBColor(0x1f, 0x3b, 0x73),
    RGBColor(0xe4, 0x6c, 0x0a),
    RGBColor(0x1b, 0x9e, 0x77),
    RGBColor(0xb0, 0x3a, 0x8c),
    RGBColor(0x4c, 0x9b, 0xd6),
    RGBColor(0x8a, 0x6d, 0x1f),
    RGBColor(0xc0, 0x39, 0x2b),
    RGBColor(0x6b, 0x72, 0x80),
    RGBColor(0x7a, 0x5c, 0xc2),
    RGBColor(0x2f, 0x9e, 0x44),
    RGBColor(0xd9, 0x9a, 0x00),
    RGBColor(0x0b, 0x72, 0x85),
    RGBColor(0x11, 0x11, 0x11),
    RGBColor(0xf0, 0x8f, 0xa8),
    RGBColor(0x8c, 0xc6, 0x3f),
    RGBColor(0x6e, 0x1a, 0x1a),
    RGBColor(0x2e, 0xc4, 0xd6),
];

const TITLE_PX: i32 = 22;
const TEXT_PX: i32 = 14;
const MARGIN_PX: i32 = 24;
/// Average width of a letter over the height of the font; no font file is available to measure.
const LETTER_ASPECT: f64 = 0.56;

/// How a legend entry looks.
#[derive(Clone, Copy)]
pub(super) struct Key<'a> {
    pub(super) label: &'a str,
    pub(super) colour: RGBColor,
    pub(super) width_px: u32,
    pub(super) opacity: f64,
}

impl<'a> Key<'a> {
    pub(super) const fn solid(label: &'a str, colour: RGBColor) -> Self {
        Self { label, colour, width_px: 3, opacity: 1.0 }
    }

    pub(super) fn stroke(&self) -> ShapeStyle {
        self.colour.mix(self.opacity).stroke_width(self.width_px)
    }
}

/// Draws a picture of `size` pixels into `file`: title and legend on top, the rest by `draw`.
pub(super) fn picture(
    file: &Path,
    size: (u32, u32),
    title: &str,
    subtitle: &str,
    legend: &[Key<'_>],
    draw: impl FnOnce(&Area<'_>) -> DrawResult,
) -> Result<(), PlotError> {
    let mut svg = String::new();
    let drawn = (|| {
        let root = SVGBackend::with_string(&mut svg, size).into_drawing_area();
        root.fill(&WHITE)?;
        let (head, body) = root.split_vertically(head_px(subtitle, legend, size.0));
        title_block(&head, title, subtitle, legend, size.0)?;
        draw(&body.margin(0, MARGIN_PX / 2, MARGIN_PX / 2, MARGIN_PX))?;
        root.present()?;
        Ok::<(), Box<dyn std::error::Error>>(())
    })();
    drawn.map_err(|e| PlotError::Drawing { file: file.to_path_buf(), why: e.to_string() })?;
    write_whole(file, &described(svg, title, subtitle))
}

/// With title and subtitle also as elements of their own, for readers of the picture that do not look at it.
fn described(svg: String, title: &str, subtitle: &str) -> String {
    let (title, subtitle) = (escaped(title), escaped(subtitle));
    match svg.find(">\n") {
        Some(end) if svg.starts_with("<svg") => {
            let (head, body) = svg.split_at(end + 2);
            format!("{head}<title>{title}</title>\n<desc>{subtitle}</desc>\n{body}")
        }
        _ => svg,
    }
}

/// Height that the title block of a picture of this width takes \[px\].
pub(super) fn head_px(subtitle: &str, legend: &[Key<'_>], width: u32) -> i32 {
    let legend_px = legend_places(legend, width).last().map_or(0, |(_, row)| 26 * (row + 1));
    56 + if subtitle.is_empty() { 0 } else { 22 } + legend_px
}

/// x \[px\] and row of every legend entry; a row that is full is followed by another.
fn legend_places(legend: &[Key<'_>], width: u32) -> Vec<(i32, i32)> {
    let (mut x, mut row) = (MARGIN_PX, 0);
    let place = |key: &Key<'_>| {
        let wide = 34 + text_width(key.label);
        if x > MARGIN_PX && x + wide > width as i32 - MARGIN_PX {
            (x, row) = (MARGIN_PX, row + 1);
        }
        let at = (x, row);
        x += wide + 26;
        at
    };
    legend.iter().map(place).collect()
}

fn title_block(area: &Area<'_>, title: &str, subtitle: &str, legend: &[Key<'_>], width: u32) -> DrawResult {
    let font = ("sans-serif", TITLE_PX).into_font().style(FontStyle::Bold);
    area.draw(&Text::new(title.to_owned(), (MARGIN_PX, 18), font.color(&INK)))?;
    let mut y = 50;
    if !subtitle.is_empty() {
        area.draw(&Text::new(subtitle.to_owned(), (MARGIN_PX, y), text(&MUTED)))?;
        y += 22;
    }
    for (key, (x, row)) in legend.iter().zip(legend_places(legend, width)) {
        let y = y + 26 * row;
        area.draw(&PathElement::new(vec![(x, y + 8), (x + 26, y + 8)], key.stroke()))?;
        area.draw(&Text::new(key.label.to_owned(), (x + 34, y), text(&INK)))?;
    }
    Ok(())
}

/// The style of all small text.
pub(super) fn text(colour: &RGBColor) -> TextStyle<'static> {
    ("sans-serif", TEXT_PX).into_font().color(colour)
}

/// Small text hung up at the given side of its point.
pub(super) fn text_at(colour: &RGBColor, h: HPos, v: VPos) -> TextStyle<'static> {
    text(colour).pos(Pos::new(h, v))
}

pub(super) fn text_width(text: &str) -> i32 {
    (text.chars().count() as f64 * f64::from(TEXT_PX) * LETTER_ASPECT) as i32
}

/// Axes and grid in the common look.
pub(super) fn axes<X, Y>(
    chart: &mut ChartContext<'_, SVGBackend<'_>, Cartesian2d<X, Y>>,
    x_label: &str,
    y_label: &str,
) -> DrawResult
where
    X: Ranged<ValueType = f64> + ValueFormatter<f64>,
    Y: Ranged<ValueType = f64> + ValueFormatter<f64>,
{
    chart
        .configure_mesh()
        .light_line_style(TRANSPARENT)
        .bold_line_style(FAINT.stroke_width(1))
        .axis_style(MUTED.stroke_width(1))
        .label_style(text(&MUTED))
        .axis_desc_style(text(&INK))
        .x_desc(x_label)
        .y_desc(y_label)
        .x_label_formatter(&plain)
        .y_label_formatter(&plain)
        .draw()?;
    Ok(())
}

/// A number for an axis: no trailing zeros, no minus before zero.
pub(super) fn plain(value: &f64) -> String {
    let text = if value.abs() >= 1e5 || (*value != 0.0 && value.abs() < 1e-3) {
        format!("{value:.0e}")
    } else {
        let fixed = format!("{value:.4}");
        fixed.trim_end_matches('0').trim_end_matches('.').to_owned()
    };
    if text == "-0" { "0".to_owned() } else { text }
}

/// Smallest and largest finite value, `None` without any.
pub(super) fn extent(values: impl IntoIterator<Item = f64>) -> Option<(f64, f64)> {
    values.into_iter().filter(|v| v.is_finite()).fold(None, |range, v| {
        let (low, high) = range.unwrap_or((v, v));
        Some((low.min(v), high.max(v)))
    })
}

/// At most about `most` points that keep every peak and trough: the extremes of each bucket in order.
pub(super) fn thinned(points: &[(f64, f64)], most: usize) -> Vec<(f64, f64)> {
    let finite: Vec<(f64, f64)> =
        points.iter().copied().filter(|(x, y)| x.is_finite() && y.is_finite()).collect();
    if finite.len() <= most.max(4) {
        return finite;
    }
    let bucket = (2 * finite.len()).div_ceil(most.max(4));
    let mut kept = Vec::with_capacity(most + 2);
    for chunk in finite.chunks(bucket) {
        let low = chunk.iter().enumerate().min_by(|a, b| a.1.1.total_cmp(&b.1.1));
        let high = chunk.iter().enumerate().max_by(|a, b| a.1.1.total_cmp(&b.1.1));
        if let (Some((i, low)), Some((j, high))) = (low, high) {
            kept.extend(if i < j { [*low, *high] } else { [*high, *low] });
        }
    }
    kept
}
