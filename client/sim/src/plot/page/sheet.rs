//! A sheet to draw on, a frame with axes, and the picture that comes of them.

use std::fmt::Write as _;
use std::path::Path;

use crate::plot::canvas::plain;
use crate::plot::{PlotError, write_whole};

/// Width of every picture \[px\]; the height follows from what is shown.
pub(super) const WIDTH: f64 = 960.0;
/// Room for the labels of the y axis, and to the right of a frame \[px\].
pub(super) const LEFT: f64 = 64.0;
pub(super) const RIGHT: f64 = 22.0;
/// Height of the legend \[px\].
pub(super) const LEGEND: f64 = 30.0;

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

/// The series of a line, which gives it its colour.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Shown {
    /// The pen.
    Pen,
    /// The arm's tool.
    Arm,
    /// The tool of the same loop without prediction.
    Ghost,
    /// Anything else.
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

/// A whole picture.
#[derive(Debug, Clone, PartialEq)]
pub struct Picture {
    title: String,
    about: String,
    height: f64,
    body: String,
}

impl Picture {
    /// What it shows.
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
        let paper =
            format!("<style>{STYLE}</style>\n<rect class=\"paper\" width=\"100%\" height=\"100%\"/>\n");
        self.element(" xmlns=\"http://www.w3.org/2000/svg\"", &paper)
    }

    /// Writes the file whole or not at all.
    ///
    /// # Errors
    /// [`PlotError::Writing`]: the file system refused.
    pub fn write(&self, file: &Path) -> Result<(), PlotError> {
        write_whole(file, &self.standalone())
    }

    fn element(&self, namespace: &str, first: &str) -> String {
        let (title, about) = (escaped(&self.title), escaped(&self.about));
        format!(
            "<svg{namespace} class=\"fig\" role=\"img\" viewBox=\"0 0 {WIDTH} \
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

    /// One row of legend.
    pub(super) fn legend(&mut self, entries: &[(&str, &str)]) {
        let mut x = LEFT;
        for (class, label) in entries {
            self.line(&format!("line {class}"), &[(x, 14.0), (x + 26.0, 14.0)]);
            self.text((x + 33.0, 18.0), "", Hung::Left, label);
            // No font is available to measure; the average letter is a little more than half as wide as high.
            x += 33.0 + 7.2 * label.chars().count() as f64 + 24.0;
        }
    }

    pub(super) fn done(self, title: &str, about: &str, height: f64) -> Picture {
        Picture { title: title.to_owned(), about: about.to_owned(), height, body: self.body }
    }
}

/// A rectangle of the sheet with linear axes.
#[derive(Clone, Copy)]
pub(super) struct Frame {
    /// Left and upper corner \[px\].
    pub(super) at: (f64, f64),
    /// \[px\]
    pub(super) size: (f64, f64),
    pub(super) x: (f64, f64),
    pub(super) y: (f64, f64),
}

impl Frame {
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
        for value in ticks(self.y, (height / 34.0).max(2.0)) {
            let y = self.py(value);
            sheet.line("grid", &[(left, y), (left + width, y)]);
            sheet.text((left - 7.0, y + 4.5), "", Hung::Right, &plain(&value));
        }
        for value in ticks(self.x, width / 90.0) {
            let x = self.px(value);
            sheet.line("grid", &[(x, top), (x, top + height)]);
            if x_label.is_some() {
                sheet.text((x, top + height + 17.0), "", Hung::Middle, &plain(&value));
            }
        }
        sheet.line("axis", &[(left, top), (left, top + height), (left + width, top + height)]);
        if let Some(label) = x_label {
            sheet.text((left + width, top + height + 34.0), "strong", Hung::Right, label);
        }
        sheet.text((left + 4.0, top - 7.0), "strong", Hung::Left, y_label);
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
