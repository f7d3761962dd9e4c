//! [`EachCharacter`]: one model on one sequence, for paired comparisons.

use serde::Serialize;

use super::LEADS_MS;
use super::board::Board;
use super::tally::LeadSums;
use crate::prediction::CharacterSequence;
use crate::prediction::score::Mean;

/// Values by look-ahead time, 10, 20 … 200 ms; `null` where the sequence has no targets.
type ByLookAhead = [Option<f64>; LEADS_MS.len()];

/// Which sequence of a set.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CharacterName {
    pub file: String,
    pub writer: String,
    /// Which character of the file, from 0.
    pub segment: usize,
    pub label: String,
}

/// What one model did on one sequence; lengths in the unit of the board.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct EachCharacter<'a> {
    pub set: &'a str,
    pub model: &'a str,
    #[serde(flatten)]
    pub name: &'a CharacterName,
    /// How many by look-ahead time, 10, 20 … 200 ms.
    pub targets: [u64; LEADS_MS.len()],
    /// RMS of the 2-D position error.
    pub rms: ByLookAhead,
    /// This and the rest: means over the targets.
    pub lateness: ByLookAhead,
    pub over_anticipation: ByLookAhead,
    /// \[degrees\]
    pub wrong_direction_deg: ByLookAhead,
    pub jitter: ByLookAhead,
}

impl CharacterName {
    /// The name of `sequence`.
    #[must_use]
    pub fn of(sequence: &CharacterSequence) -> Self {
        let CharacterSequence { file, writer, segment, label, .. } = sequence;
        Self { file: file.clone(), writer: writer.clone(), segment: *segment, label: label.clone() }
    }
}

impl Board {
    /// Every model on every sequence with targets, model after model.
    pub fn each(&self) -> impl Iterator<Item = EachCharacter<'_>> {
        self.models.iter().flat_map(move |lane| {
            let name = |sequence: &usize| self.characters.get(*sequence);
            let scored = lane.sequences.iter().filter_map(move |(of, leads)| Some((name(of)?, leads)));
            scored.map(move |(name, leads)| {
                let mean = |of: fn(&LeadSums) -> &Mean| leads.each_ref().map(|sums| of(sums).get());
                EachCharacter {
                    set: &self.set,
                    model: &lane.model,
                    name,
                    targets: leads.each_ref().map(|sums| sums.square.count),
                    rms: mean(|sums| &sums.square).map(|square| square.map(f64::sqrt)),
                    lateness: mean(|sums| &sums.lateness),
                    over_anticipation: mean(|sums| &sums.over_anticipation),
                    wrong_direction_deg: mean(|sums| &sums.wrong_direction_deg),
                    jitter: mean(|sums| &sums.jitter),
                }
            })
        })
    }
}
