//! CSV pen paths: header `t_s,x_m,y_m,contact`, one sample per line.
//!
//! Columns may stand in any order; others are refused, so that a misspelt name cannot go unnoticed. `contact`
//! is 0, 1, false or true. Empty lines and lines starting with `#` are skipped, but for the head of
//! foretrace's own recordings (`super::PenLog`). Times rise strictly.

use super::csv_lines::{CsvHead, HEADER, read_head, row};
use super::file::{FileError, read_limited};
use super::foreign::foreign;
use super::{Character, Component, GAP_PERIODS, Quantity, Recording};
use crate::path::{PathSample, PenPath};
use std::io::{self, Write};
use std::path::Path;

const COLUMNS: [&str; 4] = ["t_s", "x_m", "y_m", "contact"];
pub(super) const RATE_HZ: std::ops::RangeInclusive<f64> = 1e-3..=1e6;
const TIME_MAX_S: f64 = 1e7;
pub(super) const POSITION_MAX_M: f64 = 100.0;

/// Reads a CSV path as it is: no scaling, no recentring. Its rate is one over the median step.
///
/// # Errors
/// [`FileError`] naming line, field, value and legal range.
pub fn load_csv(path: &Path) -> Result<PenPath, FileError> {
    let bytes = read_limited(path)?;
    if bytes.starts_with(mcap::MAGIC) {
        let why = "it is an MCAP recording, not CSV; give it a name that ends in .mcap";
        return Err(FileError::whole(path, why));
    }
    if let Some(why) = foreign(&bytes, bytes.len() as u64) {
        return Err(FileError::whole(path, why));
    }
    parse_csv(text(&bytes, path)?, path)
}

fn text<'b>(bytes: &'b [u8], path: &Path) -> Result<&'b str, FileError> {
    std::str::from_utf8(bytes).map_err(|e| FileError::whole(path, format!("not UTF-8 text: {e}")))
}

/// Reads the bytes of a CSV path as a recording: one character without a label, a component per change of
/// contact and per gap.
///
/// # Errors
///
/// As [`load_csv`].
pub(super) fn parse_csv_recording(bytes: &[u8], path: &Path) -> Result<Recording, FileError> {
    let text = text(bytes, path)?;
    let pen = parse_csv(text, path)?;
    let head = head(text, path)?.unwrap_or_default();
    let rate_hz = head.rate_hz.unwrap_or(pen.rate_hz);
    Ok(recording_of(&pen, rate_hz, head.writer, path))
}

/// `pen` as one character without a label, a component per change of contact and per gap.
pub(super) fn recording_of(pen: &PenPath, rate_hz: f64, writer: String, path: &Path) -> Recording {
    let gap_s = GAP_PERIODS / rate_hz;
    let mut components: Vec<Component> = Vec::new();
    let mut last: Option<PathSample> = None;
    for sample in &pen.samples {
        let point = [sample.x_m, sample.y_m];
        let elapsed_s = last.map(|last| sample.t_s - last.t_s).filter(|elapsed| *elapsed > gap_s);
        match components.last_mut() {
            Some(open) if elapsed_s.is_none() && open.contact == sample.contact => open.points.push(point),
            _ => components.push(Component {
                contact: sample.contact,
                points: vec![point],
                dt_before_s: elapsed_s,
            }),
        }
        last = Some(*sample);
    }
    Recording {
        source: path.to_path_buf(),
        rate_hz,
        rate_assumed: false,
        notes: Vec::new(),
        units_per_m: Some([1.0; 2]),
        quantity: Quantity::Position,
        segments: vec![Character { components, writer, ..Character::default() }],
    }
}

/// Whether the text begins as this format does.
pub(super) fn begins_csv(text: &str) -> bool {
    content_lines(text).next().is_some_and(|(_, line)| column_order(line).is_some())
}

/// Writes `path` in the form that [`load_csv`] reads; the file appears whole or not at all.
///
/// # Errors
/// Whatever the file system says.
pub fn write_csv(file: &Path, path: &PenPath) -> io::Result<()> {
    let mut text = format!("{HEADER}\n");
    for sample in &path.samples {
        text.push_str(&row(sample));
        text.push('\n');
    }
    crate::whole::write(file, |out| out.write_all(text.as_bytes()))
}

fn head(text: &str, file: &Path) -> Result<Option<CsvHead>, FileError> {
    read_head(text).map_err(|(field, value, legal)| bad_field(file, 1, field, &value, legal))
}

fn bad_field(file: &Path, line: usize, field: &str, value: &str, legal: &str) -> FileError {
    let value: String = value.chars().take(40).collect();
    FileError::at(file, line, &format!("{field} is {value:?}; legal: {legal}"))
}

fn parse_csv(text: &str, file: &Path) -> Result<PenPath, FileError> {
    head(text, file)?;
    let mut lines = content_lines(text);
    let (line, header) = lines.next().unwrap_or((1, ""));
    let order = column_order(header).ok_or_else(|| {
        let found: String = header.chars().take(80).collect();
        FileError::at(file, line, &format!("expected the header {HEADER} (any order), found {found:?}"))
    })?;
    let mut samples: Vec<PathSample> = Vec::new();
    for (line, text) in lines {
        let cells: Vec<&str> = text.split(',').map(str::trim).collect();
        let fields = order.map(|i| cells.get(i).copied());
        let ([Some(t), Some(x), Some(y), Some(contact)], true) = (fields, cells.len() == COLUMNS.len())
        else {
            return Err(FileError::at(file, line, &format!("expected 4 fields, found {}", cells.len())));
        };
        let bad = |field, value: &str, legal: String| bad_field(file, line, field, value, &legal);
        let earliest = samples.last().map(|s| s.t_s);
        let t_s =
            number(t, TIME_MAX_S).filter(|t| earliest.is_none_or(|e| *t > e)).ok_or_else(
                || match earliest {
                    Some(e) => bad("t_s", t, format!("a number in ({e}, {TIME_MAX_S}], times rise strictly")),
                    None => bad("t_s", t, format!("a number in [-{TIME_MAX_S}, {TIME_MAX_S}]")),
                },
            )?;
        let position = |field, text: &str| {
            number(text, POSITION_MAX_M)
                .ok_or_else(|| bad(field, text, format!("a number in [-{POSITION_MAX_M}, {POSITION_MAX_M}]")))
        };
        let contact = match contact {
            "1" | "true" => true,
            "0" | "false" => false,
            other => return Err(bad("contact", other, "0, 1, false, true".to_owned())),
        };
        samples.push(PathSample { t_s, x_m: position("x_m", x)?, y_m: position("y_m", y)?, contact });
    }
    if samples.len() < 2 {
        return Err(FileError::whole(file, format!("{} samples; a path needs at least 2", samples.len())));
    }
    let path = PenPath::from_samples(samples);
    if !RATE_HZ.contains(&path.rate_hz) {
        let why = format!(
            "the median step in time gives a rate of {} Hz; legal: 0.001 to 1000000 (is t_s in seconds?)",
            path.rate_hz
        );
        return Err(FileError::whole(file, why));
    }
    Ok(path)
}

fn content_lines(text: &str) -> impl Iterator<Item = (usize, &str)> {
    let lines = text.trim_start_matches('\u{feff}').lines().enumerate();
    lines.map(|(i, l)| (i + 1, l.trim())).filter(|(_, l)| !l.is_empty() && !l.starts_with('#'))
}

fn column_order(header: &str) -> Option<[usize; 4]> {
    let names: Vec<&str> = header.split(',').map(str::trim).collect();
    let [t, x, y, c] = COLUMNS.map(|c| names.iter().position(|n| *n == c));
    (names.len() == COLUMNS.len()).then_some([t?, x?, y?, c?])
}

fn number(text: &str, limit: f64) -> Option<f64> {
    text.parse::<f64>().ok().filter(|v| v.abs() <= limit)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn parse(text: &str) -> Result<PenPath, FileError> {
        parse_csv(text, Path::new("pen.csv"))
    }

    #[test]
    fn columns_may_stand_in_any_order() {
        let path = parse("x_m, t_s,contact,y_m\n0.1,0,1,0.2\n\n# note\n0.3,0.005,false,0.4\n").unwrap();
        assert_eq!(path.samples[0], PathSample { t_s: 0.0, x_m: 0.1, y_m: 0.2, contact: true });
        assert_eq!(path.samples[1], PathSample { t_s: 0.005, x_m: 0.3, y_m: 0.4, contact: false });
        assert!((path.rate_hz - 200.0).abs() < 1e-9);
    }

    #[test]
    fn a_bad_field_is_named_with_line_value_and_range() {
        let head = "t_s,x_m,y_m,contact\n0,0,0,1\n";
        for (row, field) in [
            ("0,0,0,1", "t_s"),
            ("NaN,0,0,1", "t_s"),
            ("1,inf,0,1", "x_m"),
            ("1,0,abc,1", "y_m"),
            ("1,0,0,yes", "contact"),
        ] {
            let error = parse(&format!("{head}{row}\n")).unwrap_err().to_string();
            assert!(error.starts_with(&format!("pen.csv:3: {field} is ")), "{error}");
        }
        let slow = parse("t_s,x_m,y_m,contact\n0,0,0,1\n5000,0,0,1\n").unwrap_err().to_string();
        assert!(
            slow.starts_with("pen.csv: the median step in time gives a rate of 0.0002 Hz; legal: 0.001 to")
        );
        let refused = |text: &str| parse(text).unwrap_err().to_string();
        assert!(refused("t,x,y,c\n").starts_with("pen.csv:1: expected the header t_s,x_m,y_m,contact"));
        assert_eq!(refused(&format!("{head}1,2,3\n")), "pen.csv:3: expected 4 fields, found 3");
        assert_eq!(refused(head), "pen.csv: 1 samples; a path needs at least 2");
    }

    #[test]
    fn what_is_written_reads_back() {
        let samples = (0..50)
            .map(|i| {
                let t = f64::from(i) * 0.005;
                PathSample { t_s: t, x_m: 0.01 * t.sin(), y_m: -0.02 * t, contact: i % 7 != 0 }
            })
            .collect();
        let path = PenPath::from_samples(samples);
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("a.csv");
        write_csv(&file, &path).unwrap();
        let back = load_csv(&file).unwrap();
        for (a, b) in path.samples.iter().zip(&back.samples) {
            // Half a unit of the last digit written.
            assert!((a.t_s - b.t_s).abs() <= 5.1e-7 && (a.x_m - b.x_m).abs() <= 5.1e-8, "{a:?} {b:?}");
            assert_eq!(a.contact, b.contact);
        }
    }

    proptest! {
        #[test]
        fn no_text_makes_the_reader_panic(text in "(t_s,x_m,y_m,contact\n)?[0-9.,eE\\-\nnaif#\u{e9} \
                                        ]{0,200}") {
            let _ = parse(&text);
        }
    }
}
