//! `foretrace lab evaluate`: any model on any set, also from devices without training data.

use std::path::PathBuf;

use foretrace_lab::prediction::{self, Model, Scored, Set};
use foretrace_sim::data::Split;

use super::shards::ShardArgs;
use super::table;
use crate::failure::Failure;
use crate::output::{JsonArgs, say_lines};
use crate::units::UnitArgs;

#[derive(Debug, clap::Args)]
pub(crate) struct EvaluateArgs {
    /// Data-set folder
    #[arg(long, value_name = "DIR")]
    data: PathBuf,

    #[command(flatten)]
    unit: UnitArgs,

    /// Stop at a bad file instead of leaving it out
    #[arg(long)]
    strict: bool,

    /// Models, comma-separated; also lstm:FILE.safetensors, and external:COMMAND, a predictor of your own in
    /// another program (a comma ends a name): docs/extend/process.md [default: all; with --cold all that need
    /// no training]
    #[arg(long, value_name = "NAMES")]
    models: Option<String>,

    /// Part of the set to score: a word of its split.tsv, or all
    ///
    /// Models that learn online are trained on the part `train` first. They start cold if the set has no such
    /// part, or if it is scored itself (train, all).
    #[arg(long, value_name = "WORD", default_value = "all")]
    split: Split,

    /// Use no training passes and no trained weights: models learn only while they are scored
    #[arg(long)]
    cold: bool,

    #[command(flatten)]
    shard: ShardArgs,

    #[command(flatten)]
    json: JsonArgs,
}

/// As shards of it are named.
pub(super) const NAME: &str = "evaluate";

pub(super) fn run(args: &EvaluateArgs) -> Result<(), Failure> {
    args.json.claim()?;
    let models = match &args.models {
        Some(names) => table::models(names)?,
        None => Model::all().into_iter().filter(|m| !(args.cold && m.needs_training())).collect(),
    };
    if let Some(model) = models.iter().find(|m| args.cold && m.needs_training()) {
        let what = format_args!(
            "--cold and model {model} exclude each other: it has trained weights or learns offline"
        );
        let cold: Vec<String> =
            Model::all().iter().filter(|m| !m.needs_training()).map(Model::to_string).collect();
        return Err(Failure::usage(
            what,
            format_args!("leave --cold out, or choose from {}", cold.join(", ")),
        ));
    }
    let set = table::load(&args.data, &args.split, args.cold, args.strict, &args.unit)?;
    if let Some(shard) = args.shard.shard {
        return table::write_shard(&args.json, NAME, shard, &models, &set, false);
    }
    show(&set, &table::scored(&models, &set)?, &args.json)
}

/// Prints the table, and writes the JSON.
pub(super) fn show(set: &Set, scored: &Scored, json: &JsonArgs) -> Result<(), Failure> {
    say_lines(prediction::table::lines(set, scored));
    json.write(&prediction::table::json(set, scored))
}
