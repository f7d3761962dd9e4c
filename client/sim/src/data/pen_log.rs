//! foretrace's own recordings: the CSV of [`super::csv`] below a line that names version, unit, rate and
//! writer.
//!
//! ```text
//! # foretrace-pen version=1 unit=m rate_hz=200.000    writer=anna
//! t_s,x_m,y_m,contact
//! 0.000000,0.1000000,0.0500000,1
//! ```
//!
//! Contract: a recording appears under its name only when it is whole; until then it grows in `NAME.part`,
//! which is a readable recording itself and stays behind if the recorder is killed; the next one sets it
//! aside as `NAME.interrupted-N`. Existing files are never overwritten.

use super::csv::{HEADER, MARK, UNKNOWN, VERSION, row};
use crate::path::PathSample;
use foretrace_host::whole::begin;
use std::fs::File;
use std::io::{self, BufWriter, Seek as _, SeekFrom, Write as _};
use std::path::{Path, PathBuf};

/// Steps from which the rate is taken.
const STEPS_MAX: usize = 1_000_000;
/// Largest loss when the machine dies \[µs of the recording\].
const FLUSH_EVERY_US: i64 = 1_000_000;

/// Writes a recording, sample by sample.
#[derive(Debug)]
pub struct PenLog {
    file: BufWriter<File>,
    part: PathBuf,
    aside: Option<PathBuf>,
    target: PathBuf,
    writer: String,
    first_ns: Option<u64>,
    last_us: i64,
    flushed_us: i64,
    steps_us: Vec<u32>,
    samples: u64,
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PenLogSummary {
    pub samples: u64,
    /// One over the median step \[Hz\]; `None` with fewer than two samples, which make no recording.
    pub rate_hz: Option<f64>,
    /// From the first sample to the last \[s\].
    pub seconds: f64,
}

impl PenLog {
    /// Begins the recording `target`. `writer` is the writer's name: no blanks, or empty.
    ///
    /// # Errors
    /// Illegal writer; `target` exists already; a living process writes `target.part`; the folder cannot be
    /// written.
    pub fn create(target: &Path, writer: &str) -> io::Result<Self> {
        let aside = set_aside(target);
        let log = Self::begin(target, writer, |part| std::fs::rename(part, &aside))?;
        Ok(Self { aside: aside.exists().then_some(aside), ..log })
    }

    /// As [`PenLog::create`], for samples that stand in another file too: what an earlier try left is
    /// removed.
    ///
    /// # Errors
    /// As [`PenLog::create`].
    pub fn copy(target: &Path, writer: &str) -> io::Result<Self> {
        Self::begin(target, writer, |part| std::fs::remove_file(part))
    }

    fn begin(target: &Path, writer: &str, leftover: impl Fn(&Path) -> io::Result<()>) -> io::Result<Self> {
        if writer.chars().any(|c| c.is_whitespace() || c.is_control()) {
            let why = format!("writer {writer:?} has blanks; legal: one word");
            return Err(io::Error::new(io::ErrorKind::InvalidInput, why));
        }
        let mut part = target.as_os_str().to_owned();
        part.push(".part");
        let part = PathBuf::from(part);
        if target.symlink_metadata().is_ok() {
            return Err(exists(target, "choose another name"));
        }
        let file = begin(&part, leftover)
            .map_err(|error| io::Error::new(error.kind(), format!("{}: {error}", part.display())))?;
        let mut log = Self {
            file: BufWriter::new(file),
            part,
            aside: None,
            target: target.to_path_buf(),
            writer: writer.to_owned(),
            first_ns: None,
            last_us: -1,
            flushed_us: 0,
            steps_us: Vec::new(),
            samples: 0,
        };
        log.head(UNKNOWN)?;
        writeln!(log.file, "{HEADER}")?;
        log.file.flush()?;
        Ok(log)
    }

    /// The file that grows.
    #[must_use]
    pub fn part(&self) -> &Path {
        &self.part
    }

    /// Where what a killed recorder had left was set aside, if there was anything.
    #[must_use]
    pub fn aside(&self) -> Option<&Path> {
        self.aside.as_deref()
    }

    /// Adds a reading of the pen at `stamp_ns`; `false`: left out, because its stamp is not at least a
    /// microsecond after the last one or a number is not finite.
    ///
    /// # Errors
    /// Whatever the file system says; what was written before stays in [`PenLog::part`].
    pub fn push(&mut self, stamp_ns: u64, x_m: f64, y_m: f64, contact: bool) -> io::Result<bool> {
        let first_ns = *self.first_ns.get_or_insert(stamp_ns);
        let Some(after_us) = stamp_ns.checked_sub(first_ns).and_then(|ns| i64::try_from(ns / 1000).ok())
        else {
            return Ok(false);
        };
        if after_us <= self.last_us || !(x_m.is_finite() && y_m.is_finite()) {
            return Ok(false);
        }
        if self.last_us >= 0 && self.steps_us.len() < STEPS_MAX {
            self.steps_us.push(u32::try_from(after_us - self.last_us).unwrap_or(u32::MAX));
        }
        self.last_us = after_us;
        self.samples += 1;
        let sample = PathSample { t_s: after_us as f64 * 1e-6, x_m, y_m, contact };
        writeln!(self.file, "{}", row(&sample))?;
        if after_us - self.flushed_us >= FLUSH_EVERY_US {
            self.flushed_us = after_us;
            self.file.flush()?;
        }
        Ok(true)
    }

    /// Completes the recording: its rate is filled in and it gets its name. Fewer than two samples leave no
    /// file.
    ///
    /// # Errors
    /// Whatever the file system says; what was written before stays in [`PenLog::part`].
    pub fn finish(mut self) -> io::Result<PenLogSummary> {
        self.steps_us.sort_unstable();
        let median = self.steps_us.get(self.steps_us.len() / 2);
        let rate_hz = median.map(|us| 1e6 / f64::from(*us));
        let seconds = self.last_us.max(0) as f64 * 1e-6;
        let summary = PenLogSummary { samples: self.samples, rate_hz, seconds };
        self.file.flush()?;
        let Some(rate_hz) = rate_hz else {
            std::fs::remove_file(&self.part)?;
            return Ok(summary);
        };
        self.file.seek(SeekFrom::Start(0))?;
        self.head(&format!("{rate_hz:.3}"))?;
        self.file.flush()?;
        self.file.get_ref().sync_all()?;
        // `rename` would overwrite a file made meanwhile.
        if self.target.symlink_metadata().is_ok() {
            return Err(exists(&self.target, "the recording is beside it, in the .part file"));
        }
        std::fs::rename(&self.part, &self.target)?;
        Ok(summary)
    }

    /// The first line, as long with every rate.
    fn head(&mut self, rate: &str) -> io::Result<()> {
        let word = if self.writer.is_empty() { "-" } else { &self.writer };
        writeln!(self.file, "{MARK}version={VERSION} unit=m rate_hz={rate:<14} writer={word}")
    }
}

/// A free name beside `target` for what a killed recorder left of it.
fn set_aside(target: &Path) -> PathBuf {
    let stem = target.file_stem().unwrap_or_default().to_string_lossy();
    let extension = target.extension().map_or_else(String::new, |e| format!(".{}", e.to_string_lossy()));
    let aside = |number: u32| target.with_file_name(format!("{stem}.interrupted-{number}{extension}"));
    (1..).map(aside).find(|file| file.symlink_metadata().is_err()).unwrap_or_else(|| aside(0))
}

fn exists(path: &Path, remedy: &str) -> io::Error {
    io::Error::new(io::ErrorKind::AlreadyExists, format!("{} exists already; {remedy}", path.display()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::data::{load_csv, load_recording};

    fn logged(folder: &Path, samples: u32) -> PenLog {
        let mut log = PenLog::create(&folder.join("a.csv"), "anna").unwrap();
        for i in 0..samples {
            let pushed =
                log.push(7_000_000_000 + u64::from(i) * 5_000_000, 0.1, 0.002 * f64::from(i), i >= 10);
            assert!(pushed.unwrap());
        }
        log
    }

    #[test]
    fn what_was_recorded_loads_with_rate_writer_and_strokes() {
        let folder = tempfile::tempdir().unwrap();
        let mut log = logged(folder.path(), 100);
        // A stamp that stands still, one that goes back, and one that is not finite.
        assert!(!log.push(7_495_000_000, 0.0, 0.0, true).unwrap());
        assert!(!log.push(6_000_000_000, 0.0, 0.0, true).unwrap());
        assert!(!log.push(8_000_000_000, f64::NAN, 0.0, true).unwrap());
        assert!(log.push(8_000_000_000, 0.3, 0.0, true).unwrap());
        let summary = log.finish().unwrap();
        assert_eq!(summary, PenLogSummary { samples: 101, rate_hz: Some(200.0), seconds: 1.0 });
        let file = folder.path().join("a.csv");
        let text = std::fs::read_to_string(&file).unwrap();
        assert!(
            text.starts_with("# foretrace-pen version=1 unit=m rate_hz=200.000        writer=anna\n"),
            "{text}"
        );
        let r = load_recording(&file).unwrap();
        assert_eq!((r.rate_hz, r.rate_assumed, r.units_per_m), (200.0, false, Some([1.0; 2])));
        let [character] = &r.segments[..] else { panic!("{:?}", r.segments) };
        assert_eq!((character.writer.as_str(), character.label.as_str()), ("anna", ""));
        let parts: Vec<_> =
            character.components.iter().map(|c| (c.contact, c.points.len(), c.dt_before_s)).collect();
        assert_eq!(parts[..2], [(false, 10, None), (true, 90, None)]);
        assert!(matches!(parts[2], (true, 1, Some(gap)) if (gap - 0.505).abs() < 1e-9), "{parts:?}");
        assert_eq!(load_csv(&file).unwrap().samples.len(), 101);
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn what_a_killed_recorder_leaves_is_readable_and_never_written_over() {
        let folder = tempfile::tempdir().unwrap();
        let mut log = logged(folder.path(), 500);
        log.file.flush().unwrap();
        let part = folder.path().join("a.csv.part");
        assert_eq!(load_recording(&part).unwrap().rate_hz.round(), 200.0);
        let target = folder.path().join("a.csv");
        let error = PenLog::create(&target, "").unwrap_err().to_string();
        assert!(error.ends_with("a.csv.part: another process is writing it"), "{error}");
        let error = PenLog::create(&part, "").unwrap_err().to_string();
        assert!(error.ends_with("a.csv.part exists already; choose another name"), "{error}");
        let left = std::fs::read(&part).unwrap();
        // Killed: its lock is gone. What it left is set aside, each time under another name.
        drop(log);
        let aside = |number: u32| folder.path().join(format!("a.interrupted-{number}.csv"));
        assert_eq!(PenLog::create(&target, "").unwrap().aside(), Some(&*aside(1)));
        assert_eq!(std::fs::read(aside(1)).unwrap(), left);
        drop(PenLog::create(&target, "").unwrap());
        assert!(std::fs::read(aside(1)).unwrap() == left && aside(2).exists());
        drop(PenLog::copy(&target, "").unwrap());
        assert!(!aside(3).exists() && part.exists(), "a copy replaces what an earlier try left");
        let error = PenLog::create(&folder.path().join("b.csv"), "a b").unwrap_err().to_string();
        assert_eq!(error, "writer \"a b\" has blanks; legal: one word");
    }

    #[test]
    fn one_sample_is_no_recording() {
        let folder = tempfile::tempdir().unwrap();
        assert_eq!(logged(folder.path(), 1).finish().unwrap().rate_hz, None);
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    }
}
