//! Sequences to train on: which writers, at which step, in which units.
//!
//! Sequences are those of the prediction tables ([`crate::prediction::sequences`]): pen-down displacements,
//! five zero steps at the end. Another step than the device's is made by adding up whole samples, once per
//! phase, where it is a multiple; else by interpolation. Absent: hover paths.

use std::collections::BTreeSet;

use foretrace_control::pen::{GridStep, Motion, SpeedScale, SpeedScaleSettings, TARGET_RMS};
use foretrace_sim::data::DataSet;
use rand::SeedableRng as _;
use rand::seq::SliceRandom as _;
use rand_pcg::Pcg64;

use super::resample;
use crate::prediction::{CharacterSequence, PADDING_STEPS};

/// Rates that differ by no more than this part are the same: devices' clocks and estimates from stamps are no
/// better.
const RATE_TOLERANCE: f64 = 0.01;

/// One recorded character as displacements per step, with what is known of its jumps.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Strokes {
    /// Displacements \[raw units per step\], T x 2.
    pub v: Vec<[f64; 2]>,
    /// Step t crosses two strokes; T long, or empty where nothing is known.
    pub jump: Vec<bool>,
}

impl Strokes {
    /// Nothing known of jumps.
    #[must_use]
    pub fn plain(v: Vec<[f64; 2]>) -> Self {
        Self { v, jump: Vec::new() }
    }

    /// Step `t` is known to cross two strokes.
    #[must_use]
    pub fn jumps(&self, t: usize) -> bool {
        self.jump.get(t).copied().unwrap_or(false)
    }

    /// Length of step `t`; 0 beyond the end.
    #[must_use]
    pub fn length(&self, t: usize) -> f64 {
        self.v.get(t).map_or(0.0, |[x, y]| x.hypot(*y))
    }

    /// The steps before the zeros at the end.
    #[must_use]
    pub fn moving(&self) -> usize {
        self.v.len().saturating_sub(PADDING_STEPS)
    }

    /// Ends in the tables' zero steps.
    pub(super) fn at_rest(mut v: Vec<[f64; 2]>, mut jump: Vec<bool>) -> Self {
        v.resize(v.len() + PADDING_STEPS, [0.0; 2]);
        jump.resize(v.len(), false);
        Self { v, jump }
    }
}

/// In which units networks are trained.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Units {
    /// The device's, per step, divided by their RMS: the paper's way, for one kind of device.
    Raw,
    /// Over the running speed scale of the loop, RMS about 10 for any device.
    Normalised,
}

/// A sequence and where it comes from.
#[derive(Debug, Clone, PartialEq)]
pub struct Item {
    pub strokes: Strokes,
    /// The writer, with the set's name in front.
    pub writer: String,
    /// Device samples per second.
    pub rate_hz: f64,
}

/// What cannot be trained on.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum CorpusError {
    /// Recordings of different rates and no common step asked for.
    #[error(
        "the recordings have different rates ({low} and {high} Hz); give the step to train at (--step-ms)"
    )]
    Rates {
        /// Lowest \[Hz\].
        low: f64,
        /// Highest \[Hz\].
        high: f64,
    },
    /// A step finer than the samples.
    #[error(
        "a step of {step_ms} ms is finer than the samples ({rate_hz} Hz); give at least {least_ms} ms \
         (--step-ms)"
    )]
    TooFine {
        /// As asked for \[ms\].
        step_ms: f64,
        /// Of the device \[Hz\].
        rate_hz: f64,
        /// Smallest legal step \[ms\].
        least_ms: f64,
    },
    /// Too few writers to hold some out.
    #[error(
        "{writers} writer(s) in the data, at least 2 are needed to hold one out; train on all with --final"
    )]
    Writers {
        /// How many there are.
        writers: usize,
    },
    /// No pen-down motion at all.
    #[error("no sequence with motion in the data; give a set with pen-down points (--data)")]
    Empty,
}

/// The items of a set, in its order; characters without pen-down points leave none.
#[must_use]
pub fn items(set: &DataSet) -> Vec<Item> {
    let of = |file, character: &foretrace_sim::data::Character| {
        let sequence = CharacterSequence::of(file, character)?;
        Some(Item {
            writer: format!("{}/{}", set.name, character.writer),
            rate_hz: sequence.rate_hz,
            strokes: Strokes { v: sequence.v, jump: sequence.jump },
        })
    };
    set.files
        .iter()
        .flat_map(|file| file.recording.segments.iter().filter_map(move |c| of(file, c)))
        .collect()
}

/// All items at one step; returns it \[ms\]. `None` takes the devices' own.
///
/// # Errors
/// [`CorpusError`]: nothing to train on, different rates without a step, or a step finer than the samples.
pub fn at_step(items: Vec<Item>, step_ms: Option<f64>) -> Result<(Vec<Item>, f64), CorpusError> {
    let rates = items.iter().map(|item| item.rate_hz);
    let (low, high) = rates.fold((f64::INFINITY, 0.0_f64), |(low, high), r| (low.min(r), high.max(r)));
    if !items.iter().any(|item| item.strokes.v.iter().any(|v| *v != [0.0; 2])) {
        return Err(CorpusError::Empty);
    }
    let Some(step_ms) = step_ms else {
        let same = high - low <= RATE_TOLERANCE * high;
        let [low, high] = [low, high].map(to_thousandths);
        return if same {
            Ok((items, to_thousandths(1e3 / high)))
        } else {
            Err(CorpusError::Rates { low, high })
        };
    };
    let mut changed = Vec::new();
    for item in items {
        let ratio = step_ms * 1e-3 * item.rate_hz;
        let whole = ratio.round();
        if ratio < 1.0 - RATE_TOLERANCE {
            let [rate_hz, least_ms] = [item.rate_hz, 1e3 / item.rate_hz].map(to_thousandths);
            return Err(CorpusError::TooFine { step_ms, rate_hz, least_ms });
        }
        let versions = if (ratio - whole).abs() <= RATE_TOLERANCE * ratio {
            (0..whole as usize)
                .map(|phase| resample::decimated(&item.strokes, whole as usize, phase))
                .collect()
        } else {
            vec![resample::resampled(&item.strokes, ratio, 0.0)]
        };
        let rate_hz = 1e3 / step_ms;
        changed.extend(versions.into_iter().map(|strokes| Item {
            strokes,
            rate_hz,
            writer: item.writer.clone(),
        }));
    }
    Ok((changed, step_ms))
}

/// Rates are often estimated from stamps; a model's step is compared to the nanosecond.
fn to_thousandths(x: f64) -> f64 {
    (x * 1e3).round() / 1e3
}

/// Something that somebody wrote.
pub trait Written {
    /// Who: names of different data sets differ.
    fn writer(&self) -> &str;
}

impl Written for Item {
    fn writer(&self) -> &str {
        &self.writer
    }
}

/// Parts the items by writer: (train, held out), `share` of the writers (at least one) held out as `seed`
/// draws them.
///
/// # Errors
/// [`CorpusError::Writers`] with a single writer.
pub fn hold_out<T: Written>(items: Vec<T>, share: f64, seed: u64) -> Result<(Vec<T>, Vec<T>), CorpusError> {
    let writers: BTreeSet<String> = items.iter().map(|item| item.writer().to_owned()).collect();
    let mut writers: Vec<String> = writers.into_iter().collect();
    if writers.len() < 2 {
        return Err(CorpusError::Writers { writers: writers.len() });
    }
    let count = ((writers.len() as f64 * share).round() as usize).clamp(1, writers.len() - 1);
    writers.shuffle(&mut Pcg64::seed_from_u64(seed));
    let held: BTreeSet<String> = writers.into_iter().take(count).collect();
    Ok(items.into_iter().partition(|item| !held.contains(item.writer())))
}

/// RMS per component of all displacements, jumps and rests included (as the reference networks were scaled).
#[must_use]
pub fn rms<'a>(strokes: impl IntoIterator<Item = &'a Strokes>) -> f64 {
    let (mut squares, mut count) = (0.0, 0.0);
    for [x, y] in strokes.into_iter().flat_map(|s| &s.v) {
        squares += x * x + y * y;
        count += 2.0;
    }
    if count > 0.0 { f64::sqrt(squares / count) } else { 0.0 }
}

/// Puts the items into the loop's normalised units: over the running speed scale, which hears each writer in
/// order.
///
/// The scale starts at the RMS of that writer's moving steps, as in a loop that has run for a while. Jumps do
/// not move it.
pub fn normalise(items: &mut [Item]) {
    let writers: BTreeSet<String> = items.iter().map(|item| item.writer.clone()).collect();
    for writer in writers {
        let own = || items.iter().filter(|item| item.writer == writer);
        let mut lengths: Vec<f64> = own()
            .flat_map(|item| {
                (0..item.strokes.v.len()).filter(|&t| !item.strokes.jumps(t)).map(|t| item.strokes.length(t))
            })
            .filter(|&length| length > 0.0)
            .collect();
        lengths.sort_by(f64::total_cmp);
        let Some(median) = lengths.get(lengths.len() / 2).copied() else { continue };
        let settings = SpeedScaleSettings {
            initial_m: median / (std::f64::consts::SQRT_2 * TARGET_RMS),
            min_m: median * 1e-6,
            max_m: median * 1e6,
            still_m: 0.0,
            ..SpeedScaleSettings::default()
        };
        let Ok(mut scale) = SpeedScale::new(settings) else { continue };
        for item in items.iter_mut().filter(|item| item.writer == writer) {
            for t in 0..item.strokes.v.len() {
                let motion = if item.strokes.jumps(t) { Motion::Jump } else { Motion::Continues };
                let displacement = item.strokes.v[t];
                scale.observe(&GridStep { displacement, motion, ..GridStep::default() });
                item.strokes.v[t] = scale.normalise(displacement);
            }
        }
    }
}
