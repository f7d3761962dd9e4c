//! Recorded hands to train on, hover included, and changed copies of them.

use std::path::Path;

use foretrace_config::Config;
use foretrace_sim::data::{DataSet, SetError, Split, median_glyph_height};
use foretrace_sim::path::{Lift, PathError, PathSample};
use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64;

use crate::closed_loop::{BenchArm, hands};
use crate::train::corpus::Written;

/// What one writer wrote in one file.
#[derive(Debug, Clone)]
pub struct Writing {
    pub writer: String,
    /// Device samples per second.
    pub rate_hz: f64,
    /// The characters, in order.
    pub sequences: Vec<WrittenCharacter>,
}

/// A character as recorded, or a changed copy.
#[derive(Debug, Clone, PartialEq)]
pub struct WrittenCharacter {
    pub label: String,
    pub samples: Vec<PathSample>,
    /// Samples that a jump leads to: the pen was not seen before them.
    pub leaps: Vec<usize>,
}

/// A set that cannot be trained on.
#[derive(Debug, thiserror::Error)]
pub enum WritingError {
    /// Its files.
    #[error(transparent)]
    Set(#[from] SetError),
    /// No ink of any height.
    #[error("{0}: no character has ink of positive height; give a set of positions or velocities")]
    NoInk(String),
    /// Its paths.
    #[error(transparent)]
    Path(#[from] PathError),
    /// The preset.
    #[error("the preset cannot be read: {0}")]
    Preset(String),
}

/// The hands of a part of a set, a median character 0.1 m high; also the files left out, each with why.
///
/// # Errors
/// [`WritingError`].
pub fn writings(
    folder: &Path,
    split: &Split,
    strict: bool,
) -> Result<(String, Vec<Writing>, Vec<String>), WritingError> {
    let config = Config::preset("ur5").map_err(|error| WritingError::Preset(error.to_string()))?;
    let set = DataSet::load(folder, split, strict)?;
    let height =
        median_glyph_height(set.characters()).ok_or_else(|| WritingError::NoInk(set.name.clone()))?;
    let (hands, left_out) = hands(&set, height, BenchArm::Ideal, &config, Lift::Leap)?;
    let mut remarks: Vec<String> = set.errors.iter().map(ToString::to_string).collect();
    remarks.extend(set.remarks());
    if left_out > 0 {
        remarks.push(format!("{}: {left_out} characters do not fit or have one sample", set.name));
    }
    let sequence = |sequence: crate::closed_loop::Sequence| WrittenCharacter {
        label: sequence.label,
        samples: sequence.path.samples,
        leaps: sequence.path.leaps,
    };
    let writing = |hand: crate::closed_loop::Hand| Writing {
        writer: format!("{}/{}", set.name, hand.writer),
        rate_hz: hand.sequences.first().map_or(0.0, |sequence| sequence.path.rate_hz),
        sequences: hand.sequences.into_iter().map(sequence).collect(),
    };
    let writings = hands.into_iter().map(writing).collect();
    Ok((set.name, writings, remarks))
}

impl Written for Writing {
    fn writer(&self) -> &str {
        &self.writer
    }
}

/// How a copy of a hand's samples is changed: other devices, other hands.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Distortion {
    /// x and y from x and y.
    matrix: [[f64; 2]; 2],
    /// Duration over that of the recording.
    time: f64,
    /// Period of another device \[s\]; 0: that of the recording.
    period_s: f64,
    /// Pitch of the device's grid \[m\]; 0: none.
    pitch_m: f64,
    /// First sample after a grid point \[s\].
    pub phase_s: f64,
}

impl Distortion {
    pub const NONE: Self =
        Self { matrix: [[1.0, 0.0], [0.0, 1.0]], time: 1.0, period_s: 0.0, pitch_m: 0.0, phase_s: 0.0 };

    /// Drawn from `seed`, for a grid of `step_s` \[s\]: most copies are those of the hand itself, in another
    /// size and phase; a share of `changed` is turned, sheared, mirrored, stretched in time, and seen by
    /// slower and coarser tablets. Half of the copies have samples on grid points, as tablets whose driver
    /// stamps in whole milliseconds; `period_s` \[s\] is that of the recording.
    #[must_use]
    pub fn drawn(seed: u64, step_s: f64, period_s: f64, changed: f64) -> Self {
        let mut rng = Pcg64::seed_from_u64(seed);
        let mut between = |low: f64, high: f64| rng.random_range(low..high);
        let size = (between(-1.4, 0.2)).exp();
        let phase_s = between(0.0, step_s);
        let own = between(0.0, 1.0) >= changed;
        let kinds = [0; 5].map(|_| between(0.0, 1.0));
        let phase_s = if kinds[4] < 0.5 { phase_s - phase_s % period_s } else { phase_s };
        let angle = if kinds[0] < 0.15 { between(-180.0, 180.0) } else { between(-12.0, 12.0) };
        let shear = between(-0.2, 0.2);
        let aspect = between(-0.15, 0.15).exp();
        let mirror = if kinds[1] < 0.1 { -1.0 } else { 1.0 };
        let time = between(-0.3, 0.3).exp();
        let period_s = if kinds[2] < 0.3 { 1.0 / between(75.0, 190.0) } else { 0.0 };
        let pitch = if kinds[3] < 0.4 { between(-7.0, -3.7).exp() } else { 0.0 };
        if own {
            return Self { matrix: [[size, 0.0], [0.0, size]], phase_s, ..Self::NONE };
        }
        let (s, c) = angle.to_radians().sin_cos();
        let (wide, high) = (size * aspect * mirror, size / aspect);
        // Mirrored and sheared first, then turned.
        let matrix = [[c * wide, c * shear * high - s * high], [s * wide, s * shear * high + c * high]];
        Self { matrix, time, period_s, pitch_m: 0.1 * size * pitch, phase_s }
    }

    /// The changed copy of `sequence`.
    #[must_use]
    pub fn apply(&self, sequence: &WrittenCharacter) -> WrittenCharacter {
        let [[xx, xy], [yx, yy]] = self.matrix;
        let first_s = sequence.samples.first().map_or(0.0, |sample| sample.t_s);
        let moved = sequence.samples.iter().map(|sample| PathSample {
            t_s: (sample.t_s - first_s) * self.time,
            x_m: xx * sample.x_m + xy * sample.y_m,
            y_m: yx * sample.x_m + yy * sample.y_m,
            contact: sample.contact,
        });
        let samples = moved.collect();
        let mut copy = WrittenCharacter { samples, ..sequence.clone() };
        if self.period_s > 0.0 {
            copy = slower(&copy, self.period_s);
        }
        if self.pitch_m > 0.0 {
            for sample in &mut copy.samples {
                sample.x_m = (sample.x_m / self.pitch_m).round() * self.pitch_m;
                sample.y_m = (sample.y_m / self.pitch_m).round() * self.pitch_m;
            }
        }
        copy
    }
}

/// As a device of another period would have seen it: on straight lines between neighbouring samples, and
/// nothing where nothing was seen.
fn slower(sequence: &WrittenCharacter, period_s: f64) -> WrittenCharacter {
    /// Samples further apart than this many periods are a gap.
    const GAP: f64 = 2.5;
    let WrittenCharacter { label, samples, leaps } = sequence;
    let mut copy = WrittenCharacter { label: label.clone(), samples: Vec::new(), leaps: Vec::new() };
    let Some(first) = samples.first() else { return copy };
    copy.samples.push(*first);
    let mut next_s = first.t_s + period_s;
    let mut leapt = false;
    for (index, (a, b)) in samples.iter().zip(samples.iter().skip(1)).enumerate() {
        let span_s = b.t_s - a.t_s;
        let leaps = leaps.contains(&(index + 1));
        leapt |= leaps;
        while next_s <= b.t_s {
            let part = (next_s - a.t_s) / span_s;
            let (x, y) = (b.x_m - a.x_m, b.y_m - a.y_m);
            // Between the samples of a jump only its end was seen.
            if span_s <= GAP * period_s && (!leaps || part >= 1.0) {
                if std::mem::take(&mut leapt) {
                    copy.leaps.push(copy.samples.len());
                }
                copy.samples.push(PathSample {
                    t_s: next_s,
                    x_m: a.x_m + part * x,
                    y_m: a.y_m + part * y,
                    contact: if part < 1.0 { a.contact && b.contact } else { b.contact },
                });
            }
            next_s += period_s;
        }
    }
    copy
}
