//! Characters as the prediction tables see them: displacements per sample between pen-down points, of uneven
//! stamps on the pen grid of the loop.
//!
//! v[t] = p[t+1] − p[t] over the pen-down points of all strokes concatenated, in raw units per sample; a step
//! across two strokes stays in as one large step (`jump`); five zero steps follow. Repeated points and
//! dummies are kept, pen events and hover paths are dropped. Characters without pen-down points make no
//! sequence.

use foretrace_sim::data::{Character, DataSet, SetFile};

/// Zero steps appended to each sequence: the pen at rest.
pub const PADDING_STEPS: usize = 5;

/// One character as a sequence of displacements.
#[derive(Debug, Clone, PartialEq)]
pub struct CharacterSequence {
    /// File as the set's `split.tsv` writes it.
    pub file: String,
    /// Who wrote it, as the set names them; empty if unknown.
    pub writer: String,
    /// The n-th character of that file, from 0.
    pub segment: usize,
    pub label: String,
    /// Displacements \[raw units per sample\], T x 2, the appended zeros included.
    pub v: Vec<[f64; 2]>,
    /// Step t crosses two strokes; T long.
    pub jump: Vec<bool>,
    /// Sampling rate of the device \[Hz\].
    pub rate_hz: f64,
    /// The rate is an assumption, not stated by the set.
    pub rate_assumed: bool,
    /// Raw units per metre along x and y, where known.
    pub units_per_m: Option<[f64; 2]>,
}

impl CharacterSequence {
    /// The sequence of one character of `file`, or `None` without pen-down points.
    #[must_use]
    pub fn of(file: &SetFile, character: &Character) -> Option<Self> {
        let mut v: Vec<[f64; 2]> = Vec::new();
        let mut jump = Vec::new();
        let mut last: Option<[f64; 2]> = None;
        for component in character.components.iter().filter(|c| c.contact) {
            for (index, &[x, y]) in component.even_points(file.recording.rate_hz).iter().enumerate() {
                if let Some([x0, y0]) = last {
                    v.push([x - x0, y - y0]);
                    jump.push(index == 0);
                }
                last = Some([x, y]);
            }
        }
        last?;
        v.resize(v.len() + PADDING_STEPS, [0.0; 2]);
        jump.resize(v.len(), false);
        Some(Self {
            file: file.file.clone(),
            writer: character.writer.clone(),
            segment: character.segment_index,
            label: character.label.clone(),
            v,
            jump,
            rate_hz: file.recording.rate_hz,
            rate_assumed: file.recording.rate_assumed,
            units_per_m: file.recording.units_per_m,
        })
    }

    /// Step `t` counts in within-stroke errors: neither a jump nor right after one.
    #[must_use]
    pub fn within_stroke(&self, t: usize) -> bool {
        let jumps = |t: usize| self.jump.get(t).copied().unwrap_or(false);
        !(jumps(t) || t > 0 && jumps(t - 1))
    }
}

/// The sequences of a set, in the order of its table and files.
#[must_use]
pub fn sequences(set: &DataSet) -> Vec<CharacterSequence> {
    set.files
        .iter()
        .flat_map(|file| file.recording.segments.iter().filter_map(move |c| CharacterSequence::of(file, c)))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use foretrace_sim::data::{Component, Quantity, Recording};

    fn set(components: Vec<Component>) -> DataSet {
        let character =
            Character { label: "x".to_owned(), segment_index: 3, components, ..Character::default() };
        let recording = Recording {
            source: "a.dat".into(),
            rate_hz: 200.0,
            rate_assumed: false,
            damage: None,
            units_per_m: Some([50_000.0; 2]),
            quantity: Quantity::Position,
            segments: vec![character],
            remarks: Vec::new(),
        };
        let file = SetFile { file: "data/a.dat".to_owned(), word: None, recording };
        DataSet { name: "set".to_owned(), files: vec![file], errors: Vec::new(), damaged: Vec::new() }
    }

    fn stroke(contact: bool, points: &[[f64; 2]]) -> Component {
        Component { contact, points: points.to_vec(), ..Component::default() }
    }

    #[test]
    fn strokes_join_by_one_jump_and_end_in_five_zero_steps() {
        let set = set(vec![
            stroke(true, &[[1.0, 1.0], [2.0, 3.0], [2.0, 3.0]]),
            stroke(false, &[[50.0, 50.0]]),
            stroke(true, &[[10.0, 0.0], [11.0, 0.0]]),
        ]);
        let [sequence] = &sequences(&set)[..] else { panic!("one sequence") };
        assert_eq!(sequence.v[..4], [[1.0, 2.0], [0.0, 0.0], [8.0, -3.0], [1.0, 0.0]]);
        assert_eq!(sequence.v[4..], [[0.0; 2]; PADDING_STEPS]);
        assert_eq!(sequence.jump, [false, false, true, false, false, false, false, false, false]);
        let within: Vec<bool> = (0..5).map(|t| sequence.within_stroke(t)).collect();
        assert_eq!(within, [true, true, false, false, true]);
        assert_eq!((sequence.segment, sequence.label.as_str()), (3, "x"));
    }

    #[test]
    fn strokes_of_uneven_stamps_have_the_steps_of_even_ones() {
        let line = |stamps_s: &[f64]| Component {
            contact: true,
            points: stamps_s.iter().map(|t| [100.0 * t, 0.0]).collect(),
            stamps_s: stamps_s.to_vec(),
            ..Component::default()
        };
        let set = set(vec![line(&[0.0, 0.002, 0.011, 0.013, 0.021]), line(&[0.5, 0.508, 0.51])]);
        let [sequence] = &sequences(&set)[..] else { panic!("one sequence") };
        let moving: Vec<f64> = sequence.v.iter().take(7).map(|[x, _]| *x).collect();
        let wanted = [0.5, 0.5, 0.5, 0.5, 48.0, 0.5, 0.5];
        assert!(moving.iter().zip(wanted).all(|(x, w)| (x - w).abs() < 1e-9), "{moving:?}");
        assert_eq!(sequence.jump[..7], [false, false, false, false, true, false, false]);
    }

    #[test]
    fn hover_alone_makes_no_sequence_and_one_point_makes_five_zeros() {
        assert_eq!(sequences(&set(vec![stroke(false, &[[1.0, 1.0]])])), []);
        let dots = sequences(&set(vec![stroke(true, &[[7.0, 7.0]])]));
        assert_eq!(dots[0].v, [[0.0; 2]; PADDING_STEPS]);
    }
}
