//! The sequences of a set, hand by hand, as stamped paths on the benchmark's paper.

use foretrace_config::Config;
use foretrace_sim::data::DataSet;
use foretrace_sim::path::{Anchor, Ink, Layout, Lift, PathError, PathSample, PenPath, Placement};
use foretrace_sim::writer::{WriterError, text_path};

use super::BenchArm;

/// Time after a jump that is scored apart \[s\]: what a hand would have needed, and the arm needs, to get
/// there.
pub const LEAP_S: f64 = 0.15;

/// One character to be written.
#[derive(Debug, Clone)]
pub struct Sequence {
    pub label: String,
    pub path: PenPath,
    /// After a jump, per sample of the path.
    pub behind_leap: Vec<bool>,
}

/// What one writer wrote in one file.
#[derive(Debug, Clone)]
pub struct Hand {
    pub file: String,
    /// The writer, as the file names them.
    pub writer: String,
    /// Their characters in order.
    pub sequences: Vec<Sequence>,
}

/// The characters of `set` on the paper of `arm`, one scale for all: `median_height` \[device units\] becomes
/// the arm's glyph height. Also how many characters are left out because they do not fit or have no more than
/// one sample.
///
/// # Errors
/// A height, rate or size that is not positive.
pub fn hands(
    set: &DataSet,
    median_height: f64,
    arm: BenchArm,
    config: &Config,
    lift: Lift,
) -> Result<(Vec<Hand>, usize), PathError> {
    let placement = Placement {
        centre_m: arm.centre_m(config),
        size_m: arm.paper_m(config),
        glyph_height_m: arm.glyph_height_m(),
        layout: Layout::Centre,
        anchor: Anchor::Middle,
        lift,
    };
    let (mut hands, mut left_out) = (Vec::<Hand>::new(), 0);
    for file in &set.files {
        let rate_hz = file.recording.rate_hz;
        let before = hands.len();
        for character in &file.recording.segments {
            let ink = Ink { characters: std::slice::from_ref(character), rate_hz, median_height };
            match PenPath::from_ink(ink, &placement) {
                Ok((path, skipped)) if skipped.is_empty() && path.samples.len() > 1 => {
                    let behind_leap = behind_leap(&path);
                    let sequence = Sequence { label: character.label.clone(), path, behind_leap };
                    let same = |hand: &&mut Hand| hand.writer == character.writer;
                    match hands.iter_mut().skip(before).find(same) {
                        Some(hand) => hand.sequences.push(sequence),
                        None => hands.push(Hand {
                            file: file.file.clone(),
                            writer: character.writer.clone(),
                            sequences: vec![sequence],
                        }),
                    }
                }
                Ok(_) | Err(PathError::Nothing { .. }) => left_out += 1,
                Err(error) => return Err(error),
            }
        }
    }
    Ok((hands, left_out))
}

/// `text` in the built-in writer's hand `style`, one line in the middle of the paper of `arm`: a hand of one
/// sequence.
///
/// # Errors
/// A character that the writer does not know, a text that does not fit.
pub fn hand_of_text(text: &str, style: u64, arm: BenchArm, config: &Config) -> Result<Hand, WriterError> {
    let placement = Placement {
        centre_m: arm.centre_m(config),
        size_m: arm.paper_m(config),
        glyph_height_m: arm.glyph_height_m(),
        layout: Layout::Line,
        anchor: Anchor::Baseline,
        lift: Lift::Travel,
    };
    let mut path = text_path(text, style, WRITER_HZ, &placement)?;
    // A line begins at the left border: move the finished text to the middle.
    if let Some([[left, _], [right, _]]) = path.bounds_m() {
        let shift = placement.centre_m[0] - 0.5 * (left + right);
        path.samples.iter_mut().for_each(|sample| sample.x_m += shift);
    }
    let behind_leap = behind_leap(&path);
    let sequence = Sequence { label: text.to_owned(), path, behind_leap };
    let writer = format!("built-in {style}");
    Ok(Hand { file: format!("glyphs:{text}"), writer, sequences: vec![sequence] })
}

/// Rate of the built-in writer's tablet \[Hz\].
const WRITER_HZ: f64 = 200.0;

impl Sequence {
    /// The path with `contact` set where `keep` is true: the samples that [`foretrace_sim::metrics`] scores.
    pub(super) fn scored(&self, keep: impl Fn(&PathSample, bool) -> bool) -> Vec<PathSample> {
        let samples = self.path.samples.iter().zip(&self.behind_leap);
        samples.map(|(sample, behind)| PathSample { contact: keep(sample, *behind), ..*sample }).collect()
    }

    /// It has a jump.
    pub(super) fn leaps(&self) -> bool {
        self.behind_leap.contains(&true)
    }
}

fn behind_leap(path: &PenPath) -> Vec<bool> {
    let mut leaps = path.leaps.iter().copied().peekable();
    let mut since = f64::NEG_INFINITY;
    let samples = path.samples.iter().enumerate();
    samples
        .map(|(index, sample)| {
            if leaps.next_if_eq(&index).is_some() {
                since = sample.t_s;
            }
            sample.t_s - since <= LEAP_S
        })
        .collect()
}
