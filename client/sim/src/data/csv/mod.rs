//! CSV pen paths: foretrace's own `t_s,x_m,y_m,contact`, and exports of tablets, browsers and phones.
//!
//! Columns are found by their names, in any order and unit ([`names`]); what is not needed is named and left
//! out. Times are in order: equal stamps are merged, those that step back or leap ahead of what follows left
//! out, all counted. A clock that counts from 1970 begins at the first sample.

mod record;
mod number;
mod lines;
mod events;
mod units;
mod names;
mod table;
mod clock;
mod reading;
mod pointers;
mod touch;
mod samples;

use super::file::{FileError, read_limited};
use super::hint::what_it_is;
use super::stamps::Cadence;
use super::{Character, Component, GAP_PERIODS, Quantity, Recording, Remark, decoded};
use crate::path::{PathSample, PenPath};
use lines::{CsvHead, read_head};
pub(super) use lines::{HEADER, MARK, UNKNOWN, VERSION, row};
use std::io::{self, Write};
use std::path::Path;
pub use units::CsvUnits;

pub(super) const RATE_HZ: std::ops::RangeInclusive<f64> = 1e-3..=1e6;
/// Slowest uneven steps \[s\]: the loop's pen grid has no slower ones.
const UNEVEN_STEP_MAX_S: f64 = 1.0;
pub(super) const POSITION_MAX_M: f64 = samples::POSITION_MAX_M;

/// A file as samples.
#[derive(Debug)]
pub(crate) struct CsvPen {
    /// In metres where `metric`, else in the file's own unit.
    pub(crate) path: PenPath,
    pub(crate) metric: bool,
    pub(crate) remarks: Vec<Remark>,
    head: CsvHead,
}

/// Reads a CSV path as it is: no scaling, no recentring. Its rate is one over the median step.
///
/// # Errors
/// [`FileError`] naming line, field, value and legal range; a file that does not tell its unit of length.
pub fn load_csv(path: &Path) -> Result<PenPath, FileError> {
    let pen = read_csv(path, CsvUnits::default())?;
    if !pen.metric {
        return Err(FileError::whole(path, "x and y name no unit of length; name them x_m, x_mm, ..."));
    }
    Ok(pen.path)
}

/// Reads a CSV of any unit.
///
/// # Errors
/// As [`load_csv`].
pub(crate) fn read_csv(path: &Path, units: CsvUnits) -> Result<CsvPen, FileError> {
    let bytes = read_limited(path)?;
    if bytes.starts_with(mcap::MAGIC) {
        let why = "it is an MCAP recording, not CSV; give it a name that ends in .mcap";
        return Err(FileError::whole(path, why));
    }
    let text = decoded(&bytes);
    if !has_csv_header(&text)
        && let Some(what) = what_it_is(&bytes)
    {
        return Err(FileError::whole(path, format!("not CSV: {what}")));
    }
    parse_csv(&text, path, units)
}

/// Reads the bytes of a CSV path as a recording: one character without a label, a component per change of
/// contact and per gap.
///
/// # Errors
///
/// As [`load_csv`], whatever its unit.
pub(super) fn parse_csv_recording(
    bytes: &[u8],
    path: &Path,
    units: CsvUnits,
) -> Result<Recording, FileError> {
    let CsvPen { path: pen, metric, remarks, head } = parse_csv(&decoded(bytes), path, units)?;
    let rate_hz = head.rate_hz.unwrap_or(pen.rate_hz);
    let recording = recording_at(&pen, rate_hz, head.rate_hz, head.writer, path);
    Ok(Recording { units_per_m: recording.units_per_m.filter(|_| metric), remarks, ..recording })
}

/// `pen`, of a file that states no rate, as one character without a label, a component per change of contact
/// and per gap, with its stamps where they are uneven; `rate_hz` where they are even.
pub(super) fn recording_of(pen: &PenPath, rate_hz: f64, writer: String, path: &Path) -> Recording {
    recording_at(pen, rate_hz, None, writer, path)
}

/// The same of a file that may state a rate.
fn recording_at(
    pen: &PenPath,
    rate_hz: f64,
    stated_hz: Option<f64>,
    writer: String,
    path: &Path,
) -> Recording {
    let steps = pen.samples.iter().zip(pen.samples.iter().skip(1)).map(|(a, b)| b.t_s - a.t_s).collect();
    let cadence = Cadence::of(steps, stated_hz).filter(|cadence| !cadence.even);
    let gap_s = cadence.map_or(GAP_PERIODS / rate_hz, |cadence| cadence.gap_s);
    let mut components: Vec<Component> = Vec::new();
    let mut last: Option<PathSample> = None;
    for sample in &pen.samples {
        let point = [sample.x_m, sample.y_m];
        let stamp_s = cadence.is_some().then_some(sample.t_s);
        let elapsed_s = last.map(|last| sample.t_s - last.t_s).filter(|elapsed| *elapsed > gap_s);
        match components.last_mut() {
            Some(open) if elapsed_s.is_none() && open.contact == sample.contact => {
                open.points.push(point);
                open.stamps_s.extend(stamp_s);
            }
            _ => components.push(Component {
                contact: sample.contact,
                points: vec![point],
                stamps_s: stamp_s.into_iter().collect(),
                dt_before_s: elapsed_s,
                continues: false,
            }),
        }
        last = Some(*sample);
    }
    Recording {
        source: path.to_path_buf(),
        rate_hz: cadence.map_or(rate_hz, |cadence| cadence.rate_hz),
        rate_assumed: false,
        damage: None,
        units_per_m: Some([1.0; 2]),
        quantity: Quantity::Position,
        segments: vec![Character { components, writer, ..Character::default() }],
        remarks: Vec::new(),
    }
}

/// Whether the text begins as this format does.
pub(super) fn begins_csv(text: &str) -> bool {
    table::begins(text)
}

/// Whether any of the first lines is a header of this format.
pub(super) fn has_csv_header(text: &str) -> bool {
    table::has_header(text)
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
    foretrace_host::whole::write(file, |out| out.write_all(text.as_bytes()))
}

fn parse_csv(text: &str, file: &Path, units: CsvUnits) -> Result<CsvPen, FileError> {
    let at = |(line, why): (usize, String)| FileError::at(file, line, &why);
    let head = read_head(text).map_err(|(field, value, legal)| {
        let value = super::shortened(&value, 40);
        FileError::at(file, 1, &format!("{field} is {value:?}; legal: {legal}"))
    })?;
    let header = table::find_header(text).map_err(at)?;
    let samples::CsvSamples { samples, metric, remarks } = samples::samples(&header, units).map_err(at)?;
    if samples.len() < 2 {
        let count = format!("{} samples; a path needs at least 2", samples.len());
        let why = remarks.iter().fold(count, |why, remark| format!("{why}; {remark}"));
        return Err(FileError::whole(file, why));
    }
    let path = PenPath::from_samples(samples);
    let steps = path.samples.windows(2).map(|w| w[1].t_s - w[0].t_s).collect();
    let slow = |cadence: &Cadence| !cadence.even && path.rate_hz * UNEVEN_STEP_MAX_S < 1.0;
    if !RATE_HZ.contains(&path.rate_hz) || Cadence::of(steps, None).as_ref().is_some_and(slow) {
        let why = format!(
            "the median step in time gives a rate of {} Hz; legal: 0.001 to 1000000, from 1 where steps are \
             uneven (is the unit of time right?)",
            path.rate_hz
        );
        return Err(FileError::whole(file, why));
    }
    Ok(CsvPen { path, metric, remarks, head: head.unwrap_or_default() })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn parse(text: &str) -> Result<PenPath, FileError> {
        parse_csv(text, Path::new("pen.csv"), CsvUnits::default()).map(|pen| pen.path)
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
        for (row, field) in
            [("NaN,0,0,1", "t_s"), ("1,inf,0,1", "x_m"), ("1,0,abc,1", "y_m"), ("1,0,0,maybe", "contact")]
        {
            let error = parse(&format!("{head}{row}\n")).unwrap_err().to_string();
            assert!(error.starts_with(&format!("pen.csv:3: {field} is ")), "{error}");
        }
        let slow = parse("t_s,x_m,y_m,contact\n0,0,0,1\n5000,0,0,1\n").unwrap_err().to_string();
        assert!(
            slow.starts_with("pen.csv: the median step in time gives a rate of 0.0002 Hz; legal: 0.001 to")
        );
        let refused = |text: &str| parse(text).unwrap_err().to_string();
        assert!(refused("t,x,c\n").starts_with("pen.csv:1: expected a header like t_s,x_m,y_m,contact"));
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

    #[test]
    fn an_uneven_pen_without_a_stated_rate_has_the_mean_one() {
        let sample = |k: u32| PathSample {
            t_s: (f64::from(k) * 7.52).floor() * 1e-3,
            x_m: 1e-4 * f64::from(k),
            y_m: 0.0,
            contact: true,
        };
        let pen = PenPath::from_samples((0..400).map(sample).collect());
        let recording = recording_of(&pen, pen.rate_hz, String::new(), Path::new("a.mcap"));
        assert!(
            (pen.rate_hz - 125.0).abs() < 1e-6 && (recording.rate_hz - 132.98).abs() < 0.1,
            "{recording:?}"
        );
    }

    proptest! {
        #[test]
        fn no_text_makes_the_reader_panic(text in "(t_s,x_m,y_m,contact\n)?[0-9.,eE\\-\nnaif#\u{e9} \
                                        ]{0,200}") {
            let _ = parse(&text);
        }
    }
}
