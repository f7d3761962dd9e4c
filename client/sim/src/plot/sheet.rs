//! A sheet to draw on, a frame with axes, and the picture that comes of them.

use std::fmt::Write as _;
use std::io::Write as _;
use std::path::Path;

use super::PlotError;

/// Width of every picture \[px\]; the height follows from what is shown.
pub(super) const WIDTH: f64 = 960.0;
/// Room for the labels of the y axis, and to the right of a frame \[px\].
pub(super) const LEFT: f64 = 64.0;
pub(super) const RIGHT: f64 = 22.0;
/// Height of a legend of one row, and of each further row \[px\].
const LEGEND: f64 = 30.0;
const LEGEND_ROW: f64 = 22.0;
/// Letters of a line of text below a title.
const LINE_LETTERS: usize = 124;

/// The colours and fonts of all pictures. A page that shows pictures inline has it once; a file has its own.
pub const STYLE: &str = "\
.fig{--paper:#fff;--ink:#1f2937;--muted:#5b6472;--grid:#e5e7eb;--pen:#8d99ae;--arm:#d9620a;--ghost:#6a4fc9;--calm:#15806a;--bad:#b91c1c}\
@media screen and \
(prefers-color-scheme:dark){.fig{--paper:#14171c;--ink:#e6e8eb;--muted:#a3adba;--grid:#2b313a;--pen:#7f8ba0;--arm:#ff9d4d;--ghost:#ab97ff;--calm:#4cc9ae;--bad:#ff8078}}\
.fig text{font:13px system-ui,sans-serif;fill:var(--muted)}.fig .strong{fill:var(--ink);font-weight:600}\
.fig .paper{fill:var(--paper)}.fig .grid{stroke:var(--grid);fill:none}.fig \
.axis{stroke:var(--muted);fill:none}\
.fig .line{fill:none;stroke-linejoin:round;stroke-linecap:round;stroke-width:1.6}\
.fig .wide{stroke-width:5;stroke-opacity:.55}.fig .thin{stroke-width:1;stroke-opacity:.35}\
.fig .pen{stroke:var(--pen)}.fig .arm{stroke:var(--arm)}.fig .ghost{stroke:var(--ghost)}.fig \
.calm{stroke:var(--calm)}\
.fig .bound{stroke:var(--bad);stroke-dasharray:6 4;fill:none}.fig text.bound{stroke:none;fill:var(--bad)}\
.fig .arm-bar{fill:var(--arm)}.fig .calm-bar{fill:var(--calm)}.fig .shade{fill:var(--pen);fill-opacity:.16}";

/// Charts are always on white, pen and arm as strong as the further series.
const CHART: &str = "\
.fig.chart{--paper:#fff;--ink:#1f2937;--muted:#6b7280;--grid:#e5e7eb;\
--pen:#1f3b73;--arm:#e46c0a;--calm:#1b9e77}\
.chart .title{font-size:20px;font-weight:700;fill:var(--ink)}.chart .pen-bar{fill:var(--pen);fill-opacity:.8}\
.chart .wide{stroke-width:6;stroke-opacity:.3}.chart .pale{stroke-opacity:.5}\
.chart .dot{fill:currentColor;stroke:none}.chart .box{fill:none;stroke:var(--grid)}";

/// For further series; distinguishable also with colour-blind eyes.
const SERIES: [(&str, &str); 17] = [
    ("s0", "#1f3b73"),
    ("s1", "#e46c0a"),
    ("s2", "#1b9e77"),
    ("s3", "#b03a8c"),
    ("s4", "#4c9bd6"),
    ("s5", "#8a6d1f"),
    ("s6", "#c0392b"),
    ("s7", "#6b7280"),
    ("s8", "#7a5cc2"),
    ("s9", "#2f9e44"),
    ("s10", "#d99a00"),
    ("s11", "#0b7285"),
    ("s12", "#111111"),
    ("s13", "#f08fa8"),
    ("s14", "#8cc63f"),
    ("s15", "#6e1a1a"),
    ("s16", "#2ec4d6"),
];

/// The class of the n-th series of a chart.
pub(super) fn series(index: usize) -> &'static str {
    SERIES.get(index % SERIES.len()).map_or("s0", |(class, _)| class)
}

fn chart_style() -> String {
    let colour =
        |(class, colour): &(&str, &str)| format!(".chart .{class}{{stroke:{colour};color:{colour}}}");
    SERIES.iter().map(colour).chain([CHART.to_owned()]).collect()
}

/// The series of a line, which gives it its colour.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Shown {
    Pen,
    Arm,
    /// The tool of the same loop without prediction.
    Ghost,
    Other,
}

impl Shown {
    pub(super) const fn class(self) -> &'static str {
        match self {
            Self::Pen => "pen",
            Self::Arm => "arm",
            Self::Ghost => "ghost",
            Self::Other => "calm",
        }
    }
}

#[derive(Debug, Clone, PartialEq)]
pub struct Picture {
    title: String,
    about: String,
    height: f64,
    body: String,
    chart: bool,
}

impl Picture {
    #[must_use]
    pub fn title(&self) -> &str {
        &self.title
    }

    /// Its figures in words.
    #[must_use]
    pub fn about(&self) -> &str {
        &self.about
    }

    /// An `<svg>` element for a page that has [`STYLE`].
    #[must_use]
    pub fn inline(&self) -> String {
        self.element("", "")
    }

    /// A file of its own.
    #[must_use]
    pub fn standalone(&self) -> String {
        let chart = if self.chart { chart_style() } else { String::new() };
        let paper = format!(
            "<style>{STYLE}{chart}</style>\n<rect class=\"paper\" width=\"100%\" height=\"100%\"/>\n"
        );
        self.element(" xmlns=\"http://www.w3.org/2000/svg\"", &paper)
    }

    /// Writes the file whole or not at all.
    ///
    /// # Errors
    /// [`PlotError::Writing`]: the file system refused.
    pub fn write(&self, file: &Path) -> Result<(), PlotError> {
        let written = foretrace_host::whole::write(file, |out| out.write_all(self.standalone().as_bytes()));
        written.map_err(|e| PlotError::Writing { file: file.to_path_buf(), why: e.to_string() })
    }

    fn element(&self, namespace: &str, first: &str) -> String {
        let (title, about) = (escaped(&self.title), escaped(&self.about));
        let chart = if self.chart { " chart" } else { "" };
        format!(
            "<svg{namespace} class=\"fig{chart}\" role=\"img\" viewBox=\"0 0 {WIDTH} \
             {:.0}\">\n<title>{title}</title>\n\
             <desc>{about}</desc>\n{first}{}</svg>\n",
            self.height, self.body
        )
    }
}

/// Text as it may stand in HTML, XML and in quoted attributes.
#[must_use]
pub fn escaped(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for letter in text.chars() {
        match letter {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            // XML cannot represent most control characters, and a terminal would act on them.
            control if control.is_control() && control != '\n' => out.push('\u{fffd}'),
            other => out.push(other),
        }
    }
    out
}

/// Where a text is hung up.
#[derive(Clone, Copy)]
pub(super) enum Hung {
    Left,
    Middle,
    Right,
}

impl Hung {
    const fn anchor(self) -> &'static str {
        match self {
            Self::Left => "start",
            Self::Middle => "middle",
            Self::Right => "end",
        }
    }
}

/// What is drawn so far; y grows downwards \[px\].
#[derive(Default)]
pub(super) struct Sheet {
    body: String,
}

// Writing to a String cannot fail.
impl Sheet {
    pub(super) fn text(&mut self, (x, y): (f64, f64), class: &str, hung: Hung, text: &str) {
        let (anchor, text) = (hung.anchor(), escaped(text));
        let _ = writeln!(
            self.body,
            "<text x=\"{x:.1}\" y=\"{y:.1}\" class=\"{class}\" text-anchor=\"{anchor}\">{text}</text>"
        );
    }

    pub(super) fn line(&mut self, class: &str, points: &[(f64, f64)]) {
        if points.is_empty() {
            return;
        }
        let _ = write!(self.body, "<polyline class=\"{class}\" points=\"");
        for (x, y) in points {
            let _ = write!(self.body, "{x:.1},{y:.1} ");
        }
        self.body.push_str("\"/>\n");
    }

    pub(super) fn rect(&mut self, class: &str, (x, y): (f64, f64), (width, height): (f64, f64)) {
        let _ = writeln!(
            self.body,
            "<rect class=\"{class}\" x=\"{x:.1}\" y=\"{y:.1}\" width=\"{:.1}\" height=\"{:.1}\"/>",
            width.max(0.0),
            height.max(0.0)
        );
    }

    pub(super) fn dot(&mut self, class: &str, (x, y): (f64, f64), radius: f64) {
        let _ =
            writeln!(self.body, "<circle class=\"dot {class}\" cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"{radius}\"/>");
    }

    /// Names by class, in rows; the height that they take \[px\]. Areas have a block, others a line.
    pub(super) fn legend(&mut self, entries: &[(&str, &str)]) -> f64 {
        let (mut x, mut row) = (LEFT, 0.0);
        for (class, label) in entries {
            let wide = 33.0 + text_width(label);
            if x > LEFT && x + wide > WIDTH - RIGHT {
                (x, row) = (LEFT, row + LEGEND_ROW);
            }
            if *class == "shade" || class.ends_with("-bar") {
                self.rect(class, (x, row + 7.0), (26.0, 13.0));
            } else {
                self.line(&format!("line {class}"), &[(x, row + 14.0), (x + 26.0, row + 14.0)]);
            }
            self.text((x + 33.0, row + 18.0), "", Hung::Left, label);
            x += wide + 24.0;
        }
        LEGEND + row
    }

    /// Adds what another sheet has, moved down.
    pub(super) fn put(&mut self, other: Self, down: f64) {
        let _ = write!(self.body, "<g transform=\"translate(0 {down})\">\n{}</g>\n", other.body);
    }

    pub(super) fn done(self, title: &str, about: &str, height: f64) -> Picture {
        Picture { title: title.to_owned(), about: about.to_owned(), height, body: self.body, chart: false }
    }

    /// A chart with title and subtitle above, written into `file`.
    pub(super) fn chart(
        self,
        file: &Path,
        title: &str,
        subtitle: &str,
        height: f64,
    ) -> Result<(), PlotError> {
        let mut sheet = Self::default();
        sheet.text((LEFT, 30.0), "title", Hung::Left, title);
        let mut head = 44.0;
        for line in lines_of(subtitle) {
            head += 18.0;
            sheet.text((LEFT, head - 8.0), "", Hung::Left, &line);
        }
        sheet.put(self, head);
        Picture { chart: true, ..sheet.done(title, subtitle, height + head) }.write(file)
    }
}

/// Average width of a text \[px\]: no font is available to measure, a letter is a little more than half as
/// wide as high.
pub(super) fn text_width(text: &str) -> f64 {
    7.2 * text.chars().count() as f64
}

fn lines_of(text: &str) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for word in text.split_whitespace() {
        match lines.last_mut() {
            Some(line) if line.chars().count() + word.chars().count() < LINE_LETTERS => {
                line.push(' ');
                line.push_str(word);
            }
            _ => lines.push(word.to_owned()),
        }
    }
    lines
}

/// A rectangle of the sheet with linear axes.
#[derive(Clone, Copy)]
pub(super) struct AxisFrame {
    /// Left and upper corner \[px\].
    pub(super) at: (f64, f64),
    /// \[px\]
    pub(super) size: (f64, f64),
    pub(super) x: (f64, f64),
    pub(super) y: (f64, f64),
}

impl AxisFrame {
    pub(super) fn px(&self, x: f64) -> f64 {
        let share = (x - self.x.0) / (self.x.1 - self.x.0);
        self.at.0 + share.clamp(-1.0, 2.0) * self.size.0
    }

    pub(super) fn py(&self, y: f64) -> f64 {
        let share = (y - self.y.0) / (self.y.1 - self.y.0);
        self.at.1 + (1.0 - share.clamp(-1.0, 2.0)) * self.size.1
    }

    /// Points in sheet coordinates, without indistinguishable ones.
    pub(super) fn placed(&self, points: &[(f64, f64)]) -> Vec<(f64, f64)> {
        let mut placed: Vec<(f64, f64)> = Vec::new();
        for (x, y) in points.iter().filter(|(x, y)| x.is_finite() && y.is_finite()) {
            let at = (self.px(*x), self.py(*y));
            if placed.last().is_none_or(|last| (last.0 - at.0).hypot(last.1 - at.1) >= 0.3) {
                placed.push(at);
            }
        }
        placed
    }

    /// Grid, axis and numbers; labels of the x axis only where `x_label` is given.
    pub(super) fn axes(&self, sheet: &mut Sheet, x_label: Option<&str>, y_label: &str) {
        let ((left, top), (width, height)) = (self.at, self.size);
        let numbered = |values: Vec<f64>| values.into_iter().map(|value| (value, plain(value)));
        self.grid_y(sheet, numbered(ticks(self.y, (height / 34.0).max(2.0))));
        let values = numbered(ticks(self.x, width / 90.0));
        self.grid_x(sheet, values.map(|(value, text)| (value, x_label.map_or(String::new(), |_| text))));
        self.outline(sheet);
        if let Some(label) = x_label {
            sheet.text((left + width, top + height + 34.0), "strong", Hung::Right, label);
        }
        sheet.text((left + 4.0, top - 7.0), "strong", Hung::Left, y_label);
    }

    /// Lines across at these values of y, each with its text.
    pub(super) fn grid_y(&self, sheet: &mut Sheet, ticks: impl IntoIterator<Item = (f64, String)>) {
        for (value, text) in ticks {
            let y = self.py(value);
            sheet.line("grid", &[(self.at.0, y), (self.at.0 + self.size.0, y)]);
            sheet.text((self.at.0 - 7.0, y + 4.5), "", Hung::Right, &text);
        }
    }

    /// Lines upwards at these values of x, each with its text, if any.
    pub(super) fn grid_x(&self, sheet: &mut Sheet, ticks: impl IntoIterator<Item = (f64, String)>) {
        let bottom = self.at.1 + self.size.1;
        for (value, text) in ticks {
            let x = self.px(value);
            sheet.line("grid", &[(x, self.at.1), (x, bottom)]);
            if !text.is_empty() {
                sheet.text((x, bottom + 17.0), "", Hung::Middle, &text);
            }
        }
    }

    /// The two axes as lines.
    pub(super) fn outline(&self, sheet: &mut Sheet) {
        let ((left, top), (width, height)) = (self.at, self.size);
        sheet.line("axis", &[(left, top), (left, top + height), (left + width, top + height)]);
    }
}

/// Round numbers in a range, about `count` of them.
pub(super) fn ticks((low, high): (f64, f64), count: f64) -> Vec<f64> {
    let rough = (high - low) / count.max(1.0);
    if !(rough > 0.0 && rough.is_finite()) {
        return Vec::new();
    }
    let power = 10f64.powf(rough.log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0].map(|factor| factor * power).into_iter().find(|step| *step >= rough);
    let step = step.unwrap_or(10.0 * power);
    let (first, last) = ((low / step - 1e-9).ceil(), (high / step + 1e-9).floor());
    // 64 is more than any picture has room for.
    (0..64).map(|k| first + f64::from(k)).take_while(|k| *k <= last).map(|k| k * step).collect()
}

/// A number for an axis: no trailing zeros, no minus before zero.
pub(super) fn plain(value: f64) -> String {
    let text = if value.abs() >= 1e5 || (value != 0.0 && value.abs() < 1e-3) {
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
    if points.len() <= most.max(4) {
        return points.to_vec();
    }
    let mut kept = Vec::with_capacity(most + 2);
    for chunk in points.chunks((2 * points.len()).div_ceil(most.max(4))) {
        let low = chunk.iter().enumerate().min_by(|a, b| a.1.1.total_cmp(&b.1.1));
        let high = chunk.iter().enumerate().max_by(|a, b| a.1.1.total_cmp(&b.1.1));
        if let (Some((i, low)), Some((j, high))) = (low, high) {
            kept.extend(if i < j { [*low, *high] } else { [*high, *low] });
        }
    }
    kept
}
