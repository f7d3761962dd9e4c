//! The sequences of prediction tables in the files of shards, and the set that all shards make up.

use serde::{Deserialize, Serialize};

use super::Shard;
use super::exact::{Digest, Exact};
use crate::prediction::lead_time::Entrant;
use crate::prediction::{CharacterSequence, Model, Set};

/// What is the same of a set in all shards of a run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SetRun {
    /// Name of the folder.
    pub set: String,
    pub split: String,
    /// Sequences that are scored.
    pub sequences: usize,
    /// Sequences that are learned from before.
    pub train: usize,
    pub cold: bool,
    pub data: String,
}

impl SetRun {
    #[must_use]
    pub fn of(set: &Set) -> Self {
        let mut digest = Digest::default();
        for sequence in set.scored.iter().chain(&set.train) {
            [&sequence.file, &sequence.writer, &sequence.label]
                .into_iter()
                .for_each(|text| digest.text(text));
            digest.numbers(device(sequence).chain(sequence.v.iter().flatten().copied()));
            digest.numbers(jumps(sequence).map(|t| t as f64));
        }
        Self {
            set: set.name.clone(),
            split: set.split.clone(),
            sequences: set.scored.len(),
            train: set.train.len(),
            cold: set.cold,
            data: digest.finish(),
        }
    }
}

/// Of the networks that models brought with them.
#[must_use]
pub fn networks(models: &[Model]) -> String {
    Digest::of(&models.iter().map(weights).collect::<Vec<_>>())
}

/// Of the networks and predictions that entrants brought with them.
#[must_use]
pub fn brought(entrants: &[Entrant]) -> String {
    let one = |entrant: &Entrant| match entrant {
        Entrant::Model(model) => Digest::of(&weights(model)),
        Entrant::File { predictions, .. } => Digest::of(predictions),
    };
    Digest::of(&entrants.iter().map(one).collect::<Vec<_>>())
}

fn weights(model: &Model) -> Option<&impl std::fmt::Debug> {
    model.own_network().map(|network| &network.weights)
}

/// A sequence that a shard scored.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct SequencePart {
    /// Place among the scored sequences of the set, from 0.
    place: usize,
    file: String,
    writer: String,
    segment: usize,
    label: String,
    /// Rate \[Hz\], then raw units per metre along x and y where they are known.
    device: Exact,
    rate_assumed: bool,
    /// Displacements \[raw units per sample\], x and y in turn.
    v: Exact,
    /// Steps that cross two strokes.
    jumps: Vec<usize>,
}

fn device(sequence: &CharacterSequence) -> impl Iterator<Item = f64> {
    std::iter::once(sequence.rate_hz).chain(sequence.units_per_m.into_iter().flatten())
}

fn jumps(sequence: &CharacterSequence) -> impl Iterator<Item = usize> {
    sequence.jump.iter().enumerate().filter(|(_, jump)| **jump).map(|(t, _)| t)
}

/// Which sequences of each set are the shard's.
#[must_use]
pub fn owned(sets: &[Set], shard: Shard) -> Vec<Vec<bool>> {
    let keys = |set: &Set| {
        let name = set.name.clone();
        let key = move |s: &CharacterSequence| (name.clone(), s.file.clone(), s.writer.clone());
        set.scored.iter().map(key).collect::<Vec<_>>()
    };
    let mut all = shard.owned(&sets.iter().flat_map(keys).collect::<Vec<_>>()).into_iter();
    sets.iter().map(|set| all.by_ref().take(set.scored.len()).collect()).collect()
}

/// The sequences of `set` that are owned.
pub(super) fn parts(set: &Set, owned: &[bool]) -> Vec<SequencePart> {
    let own = set.scored.iter().enumerate().zip(owned).filter(|(_, owned)| **owned);
    let part = |((place, s), _): ((usize, &CharacterSequence), &bool)| SequencePart {
        place,
        file: s.file.clone(),
        writer: s.writer.clone(),
        segment: s.segment,
        label: s.label.clone(),
        device: Exact(device(s).collect()),
        rate_assumed: s.rate_assumed,
        v: Exact(s.v.iter().flatten().copied().collect()),
        jumps: jumps(s).collect(),
    };
    own.map(part).collect()
}

impl SequencePart {
    fn sequence(self) -> Result<CharacterSequence, String> {
        let (rate_hz, units_per_m) = match self.device.0[..] {
            [rate_hz] => (rate_hz, None),
            [rate_hz, x, y] => (rate_hz, Some([x, y])),
            ref other => return Err(format!("{} numbers of a device, legal are 1 and 3", other.len())),
        };
        let (v, rest) = self.v.0.as_chunks::<2>();
        if !rest.is_empty() {
            return Err(format!("{} numbers for displacements of two", self.v.0.len()));
        }
        let mut jump = vec![false; v.len()];
        for t in self.jumps {
            let count = v.len();
            *jump.get_mut(t).ok_or_else(|| format!("step {t} of {count} steps"))? = true;
        }
        let (v, rate_assumed) = (v.to_vec(), self.rate_assumed);
        let Self { file, writer, segment, label, .. } = self;
        Ok(CharacterSequence { file, writer, segment, label, v, jump, rate_hz, rate_assumed, units_per_m })
    }
}

/// A set as its shards bring it, sequence by sequence.
#[derive(Debug)]
pub(super) struct GatheredSet {
    run: SetRun,
    slots: Vec<Option<CharacterSequence>>,
}

impl GatheredSet {
    /// Of `run`; `brought` is how many sequences the files have, so that a claim of more reserves nothing.
    pub(super) fn new(run: SetRun, brought: usize) -> Result<Self, String> {
        if run.sequences != brought {
            return Err(format!(
                "{brought} sequences of {:?} in all shards, the run has {}",
                run.set, run.sequences
            ));
        }
        let slots = vec![None; brought];
        Ok(Self { run, slots })
    }

    /// Puts the sequences of one shard in their places, and returns these.
    pub(super) fn take(&mut self, parts: Vec<SequencePart>) -> Result<Vec<usize>, String> {
        let mut places = Vec::with_capacity(parts.len());
        for part in parts {
            let (place, count) = (part.place, self.slots.len());
            match self.slots.get_mut(place) {
                Some(slot @ None) => *slot = Some(part.sequence()?),
                Some(Some(_)) => return Err(format!("sequence {place} is in another shard as well")),
                None => return Err(format!("sequence {place} of {count}")),
            }
            places.push(place);
        }
        Ok(places)
    }

    /// The set, once every shard was taken: as many as there are slots, each once, are all of them.
    pub(super) fn set(self) -> Set {
        Set {
            name: self.run.set,
            split: self.run.split,
            scored: self.slots.into_iter().flatten().collect(),
            train: Vec::new(),
            cold: self.run.cold,
            refused: Vec::new(),
            damaged: Vec::new(),
            remarks: Vec::new(),
        }
    }
}
