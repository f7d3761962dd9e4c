//! `foretrace lab table1`: the paper's Table 1 with further columns, and its analysis by symbol.

use std::path::PathBuf;

use foretrace_lab::prediction::table as tables;
use foretrace_lab::prediction::{
    Model, RetrainError, Scored, Set, SymbolAnalysis, TRAINABLE, order, retrain, retrain_epochs,
};
use foretrace_sim::data::Split;
use serde_json::json;

use super::lab_run::{LabRun, SettingsSums};
use super::progress::StepProgress;
use super::say_picture;
use super::shards::ShardArgs;
use super::table;
use crate::failure::Failure;
use crate::output::{JsonArgs, note, say, say_lines};
use crate::units::UnitArgs;

/// Where this table differs from the paper's.
const FOOTER: &str = "
Differences from the paper (Agravante et al. 2018, Table 1). Its numbers, on LaViola's symbols, which cannot \
be had any
more: constant velocity MSE 3.0875; LSTM 3.7132 (PS-B 67); DyBM offline 3.2483 (PS-B 39, PS-LSTM 31), online \
2.7151
(79, 39), online with ESN 2.2715 (90, 42). Data, writers, units and tuning differ here, so errors compare \
within a table
only. On unipen-ced two of its findings do not come out: the LSTM is not worse than constant velocity in \
MSE, and plain
online DyBM is not below it in four sequences of five. The pooled MSE is mostly jumps between strokes, which \
nobody can
foresee from pen-down points: judge by within, PS-B, PS-LSTM and mm. PS-LSTM moves by 2 to 7 points with the \
seed of the
LSTM, so it is always against the same trained network. Times are of this machine and build.";

#[derive(Debug, clap::Args)]
pub(crate) struct Table1Args {
    /// Data-set folder with a train and a test part
    #[arg(long, value_name = "DIR")]
    data: PathBuf,

    #[command(flatten)]
    unit: UnitArgs,

    /// Stop at a bad file instead of leaving it out
    #[arg(long)]
    strict: bool,

    /// Models, comma-separated; also lstm:FILE.safetensors, and external:COMMAND, a predictor of your own in
    /// another program (a comma ends a name): docs/extend/process.md [default: all]
    #[arg(long, value_name = "NAMES")]
    models: Option<String>,

    /// Also compare the models symbol by symbol: do curvy ones favour the LSTM
    #[arg(long)]
    by_label: bool,

    /// Train lstm10 (the paper's recipe) and lstm32 (the robust one) on the train part, instead of their
    /// shipped weights
    #[arg(long)]
    train: bool,

    /// Folder for the pictures and run.json, which tells how to repeat the run [default: a new one,
    /// foretrace-lab/table1-SET-DATE]
    #[arg(long, value_name = "DIR", conflicts_with = "shard")]
    out: Option<PathBuf>,

    #[command(flatten)]
    shard: ShardArgs,

    #[command(flatten)]
    json: JsonArgs,
}

/// As shards of it are named.
pub(super) const NAME: &str = "table1";

pub(super) fn run(args: &Table1Args) -> Result<(), Failure> {
    let lab_run = LabRun::begin(NAME, &[&args.data], args.out.as_deref(), &args.json)?;
    let names = names(args);
    let shipped: Vec<&str> =
        names.iter().map(String::as_str).filter(|name| cells_to_train(args, name).is_none()).collect();
    if let Some(twice) =
        names.iter().enumerate().find(|(index, name)| names.iter().take(*index).any(|n| n == *name))
    {
        return Err(Failure::usage(
            format_args!("model {:?} is named twice", twice.1),
            "name each model once",
        ));
    }
    // Wrong names are reported before anything is loaded or trained.
    let mut models = if shipped.is_empty() { Vec::new() } else { table::models(&shipped.join(","))? };
    if args.shard.shard.is_none() {
        lab_run.try_folder()?;
    }
    let set = table::load(&args.data, &Split::test(), false, args.strict, &args.unit)?;
    for (index, name) in names.iter().enumerate() {
        if let Some(cells) = cells_to_train(args, name) {
            models.insert(index.min(models.len()), trained(name, cells, &set)?);
        }
    }
    if let Some(shard) = args.shard.shard {
        return table::write_shard(&args.json, NAME, shard, &models, &set, args.by_label);
    }
    show(&set, &table::scored(&models, &set)?, args.by_label, &lab_run, &args.json)
}

/// The result, with pictures in `out`.
pub(super) fn show(
    set: &Set,
    scored: &Scored,
    by_label: bool,
    lab_run: &LabRun,
    to: &JsonArgs,
) -> Result<(), Failure> {
    say_lines(tables::lines(set, scored));
    let mut json = tables::json(set, scored);
    let symbols = by_label.then(|| SymbolAnalysis::of(set, scored));
    if let Some(symbols) = &symbols {
        say_lines(symbols.lines());
        json["by_label"] = json!({ "labels": symbols.rows, "correlations": symbols.correlations });
    }
    say!("{FOOTER}");
    let out = lab_run.keep(to, &json)?;
    let file = tables::draw(&out, "table1.svg", "Table 1: predicting the pen", set, &scored.rows)?;
    say!("");
    say_picture(&file);
    if let Some(file) = symbols.map(|symbols| symbols.draw(&out, set)).transpose()?.flatten() {
        say_picture(&file);
    }
    lab_run.finish(SettingsSums::default())
}

/// The models asked for, in order.
fn names(args: &Table1Args) -> Vec<String> {
    if let Some(names) = &args.models {
        return names.split(',').map(|name| name.trim().to_owned()).collect();
    }
    order()
        .into_iter()
        .filter(|name| cells_to_train(args, name).is_some() || Model::named(name).is_ok())
        .map(str::to_owned)
        .collect()
}

/// Cells of a network that is to be trained.
fn cells_to_train(args: &Table1Args, name: &str) -> Option<usize> {
    TRAINABLE.into_iter().find(|(known, _)| args.train && *known == name).map(|(_, cells)| cells)
}

fn trained(name: &str, cells: usize, set: &Set) -> Result<Model, Failure> {
    note!("lab: training {name} on {} sequences, {} epochs", set.train.len(), retrain_epochs(cells));
    let progress = StepProgress::of("lab table1, training", retrain_epochs(cells));
    let trained = retrain(name, cells, set, &|| progress.step()).map_err(|error| match error {
        RetrainError::Empty { .. } => Failure::bad_input(error, ""),
        other => Failure::failed(other, ""),
    })?;
    Ok(Model::retrained(name, &trained))
}
