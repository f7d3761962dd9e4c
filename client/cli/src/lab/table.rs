//! Shared by the commands for prediction tables: loading a set, choosing and scoring models.

use std::path::Path;

use foretrace_lab::prediction::{Model, RegistryError, Scored, Set, runs, score, work};
use foretrace_lab::shards::{SetRun, Shard, TableRun, networks, owned, table_part};
use foretrace_sim::data::Split;

use super::progress::StepProgress;
use super::shards;
use crate::failure::Failure;
use crate::output::{JsonArgs, note};
use crate::units::UnitArgs;

/// Loads a set and reports the files left out; strict: a bad file is an error.
pub(super) fn load(
    folder: &Path,
    split: &Split,
    cold: bool,
    strict: bool,
    unit: &UnitArgs,
) -> Result<Set, Failure> {
    let set = Set::load_in(folder, split, cold, unit.units()).map_err(|error| {
        Failure::bad_input(error, "give a data-set folder (--data) and a part of it (--split)")
    })?;
    if let Some(first) = set.refused.iter().chain(&set.damaged).next().filter(|_| strict) {
        return Err(Failure::bad_input(first, "correct the file, or leave out --strict to skip it"));
    }
    for error in &set.refused {
        note!("lab: left out: {error}");
    }
    for remark in &set.remarks {
        note!("lab: {remark}");
    }
    if set.scored.is_empty() {
        let what = format_args!("{}: no character of this part has pen-down points", folder.display());
        return Err(Failure::bad_input(what, "give a set with handwriting in it"));
    }
    Ok(set)
}

/// The models of a comma-separated list.
pub(super) fn models(names: &str) -> Result<Vec<Model>, Failure> {
    Model::list(names).map_err(|error| unknown(&error))
}

/// A wrong or repeated name is a usage error; a bad file is bad input; another program is at fault itself.
pub(super) fn unknown(error: &RegistryError) -> Failure {
    match error {
        RegistryError::Unknown { .. } | RegistryError::Twice { .. } => Failure::usage(error, ""),
        RegistryError::Process { .. } => Failure::failed(error, ""),
        _ => Failure::bad_input(error, ""),
    }
}

/// Scores the models, with a progress bar on a terminal.
pub(super) fn scored(models: &[Model], set: &Set) -> Result<Scored, Failure> {
    let progress = StepProgress::of("lab", work(models, set));
    score(models, set, &|| progress.step()).map_err(|error| unknown(&error))
}

/// Scores the models on the shard's sequences, and writes what the merge needs.
pub(super) fn write_shard(
    json: &JsonArgs,
    command: &str,
    shard: Shard,
    models: &[Model],
    set: &Set,
    by_label: bool,
) -> Result<(), Failure> {
    let owned = owned(std::slice::from_ref(set), shard).concat();
    let progress = StepProgress::of("lab", work(models, set));
    let runs = runs(models, set, &owned, &|| progress.step()).map_err(|error| unknown(&error))?;
    drop(progress);
    let names = models.iter().map(Model::to_string).collect();
    let run = TableRun { set: SetRun::of(set), models: names, networks: networks(models), by_label };
    let counts = [owned.iter().filter(|own| **own).count(), owned.len()];
    shards::write(json, command, shard, run, table_part(set, &owned, &runs), counts)
}
