//! Recorded handwriting as it comes from files, and sets of such files with their splits.
//!
//! Contract: points are positions in the device's own units, y upwards, in the order of writing, repeats
//! included and finite; every error of a file is reported with file, line and reason. [`crate::path`] scales
//! into the writing plane. Each module uses only those before it: files and lines, one loader per format of
//! foretrace's own, the formats, sets.

mod file;
mod foreign;
mod decode;
mod remark;
mod stamps;
mod csv;
mod pen_log;
mod mcap_chunk;
mod mcap_record;
mod mcap_records;
mod mcap_pen;
mod hint;
mod format;
mod split;
mod set;

pub(crate) use csv::read_csv;
pub use csv::{CsvUnits, load_csv, write_csv};
pub(crate) use decode::decoded;
pub use file::FileError;
pub use foreign::folder_for_file;
#[cfg(feature = "formats")]
pub(crate) use foreign::foreign;
pub use format::{Format, load_recording, load_recording_in, parse_recording};
pub use mcap_pen::{PenSeen, PenTable};
pub use mcap_record::parse_mcap_record;
pub use mcap_records::{McapEnd, McapRecords};
pub use pen_log::{PenLog, PenLogSummary};
pub use remark::{Remark, remarks};
pub use set::{DataSet, SetError, SetFile};
pub use split::Split;
#[cfg(feature = "formats")]
pub(crate) use stamps::{Cadence, settle};

use std::borrow::Cow;
use std::path::PathBuf;

/// Foreign text for a message: its first `most` characters.
#[must_use]
pub fn shortened(text: &str, most: usize) -> String {
    let cut = text.chars().take(most).collect();
    if text.chars().nth(most).is_some() { format!("{cut}…") } else { cut }
}

/// A step in time of more periods than this is a gap, in formats whose samples carry stamps.
pub(crate) const GAP_PERIODS: f64 = 4.0;

/// One file of ink: its characters in file order.
#[derive(Debug, Clone, PartialEq)]
pub struct Recording {
    /// The file it was read from.
    pub source: PathBuf,
    /// Sampling rate of the device \[Hz\].
    pub rate_hz: f64,
    /// The file does not state the rate; the format's usual one was taken.
    pub rate_assumed: bool,
    /// Where and why the file ends early, and what to do: what comes before its damage was read.
    pub damage: Option<String>,
    /// Device units per metre along x and y, where the file states both.
    pub units_per_m: Option<[f64; 2]>,
    /// The quantity that was recorded.
    pub quantity: Quantity,
    /// The characters, in file order.
    pub segments: Vec<Character>,
    /// What of the file was not taken as it stands.
    pub remarks: Vec<Remark>,
}

/// What a file holds per sample. Points are positions in either case.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Quantity {
    Position,
    /// Velocities, summed up here from (0, 0) with unit time step: differences of neighbouring points are the
    /// published numbers (to rounding), so T velocities make T + 1 points.
    Velocity,
}

#[derive(Debug, Clone, Default, PartialEq)]
pub struct Character {
    /// What was written; may be longer than one `char`; empty where the file has no label.
    pub label: String,
    /// The writer, unique within a set; empty if unknown. A split table's word goes before the file's.
    pub writer: String,
    /// The n-th character of its file, from 0.
    pub segment_index: usize,
    /// Strokes and hover paths in the order of writing.
    pub components: Vec<Component>,
}

/// A run of points with the pen on or above the surface, without a gap.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Component {
    /// The pen touched the surface.
    pub contact: bool,
    /// Positions in device units, y upwards; repeated points are kept.
    pub points: Vec<[f64; 2]>,
    /// When the pen was at each of the points, rising, on a clock of the recording \[s\]. Empty: the points
    /// are one over the rate apart.
    pub stamps_s: Vec<f64>,
    /// Recorded time without samples between the previous component and this one \[s\].
    pub dt_before_s: Option<f64>,
    /// The stroke of the previous component goes on behind a gap: the pen was not lifted.
    pub continues: bool,
}

impl Recording {
    /// Gives points without stamps those of its rate, for a place among recordings of another rate: each
    /// character begins one period after 0, and goes on across its gaps.
    pub fn stamp(&mut self) {
        for character in &mut self.segments {
            let mut now_s = 0.0;
            for component in character.components.iter_mut() {
                if let Some(gap_s) = component.dt_before_s {
                    now_s += gap_s - 1.0 / self.rate_hz;
                }
                let missing = component.points.len() - component.stamps_s.len();
                for _ in 0..missing {
                    now_s += 1.0 / self.rate_hz;
                    component.stamps_s.push(now_s);
                }
                now_s = component.stamps_s.last().copied().unwrap_or(now_s);
            }
        }
    }
}

impl Component {
    /// The points one over `rate_hz` apart: as they are where they have no stamps, else on the grid that the
    /// loop lays over the samples of a live pen, beginning at the first point.
    #[must_use]
    pub fn even_points(&self, rate_hz: f64) -> Cow<'_, [[f64; 2]]> {
        if self.stamps_s.is_empty() {
            return Cow::Borrowed(&self.points);
        }
        Cow::Owned(stamps::on_grid(&self.points, &self.stamps_s, rate_hz))
    }

    /// A place holder of the format (`0 0`, once), not a position of the pen.
    #[must_use]
    pub fn is_dummy(&self) -> bool {
        matches!(self.points.as_slice(), [[x, y]] if *x == 0.0 && *y == 0.0)
    }
}

impl Character {
    /// Lower left and upper right corner of the ink (dummies left out), or `None` without ink.
    #[must_use]
    pub fn ink_bounds(&self) -> Option<[[f64; 2]; 2]> {
        let ink = self.components.iter().filter(|c| c.contact && !c.is_dummy()).flat_map(|c| &c.points);
        ink.fold(None, |bounds, &[x, y]| {
            let [[left, low], [right, high]] = bounds.unwrap_or([[x, y], [x, y]]);
            Some([[left.min(x), low.min(y)], [right.max(x), high.max(y)]])
        })
    }
}

/// Median ink height of the characters \[device units\]; `None` when no character has ink of positive height.
#[must_use]
pub fn median_glyph_height<'a>(characters: impl IntoIterator<Item = &'a Character>) -> Option<f64> {
    let mut heights: Vec<f64> = characters
        .into_iter()
        .filter_map(|c| c.ink_bounds().map(|[low, high]| high[1] - low[1]))
        .filter(|&h| h > 0.0)
        .collect();
    heights.sort_by(f64::total_cmp);
    heights.get(heights.len() / 2).copied()
}
