//! `foretrace lab leadtime`: ranks predictors by error against look-ahead time.

use std::path::{Path, PathBuf};

use foretrace_lab::prediction::lead_time::{
    Board, BoardError, Entrant, Predictions, Standing, compare, draw, export, predict_all, standing_lines,
};
use foretrace_lab::prediction::{Model, RegistryError, Set};
use foretrace_lab::shards::{LeadRun, SetRun, Shard, brought, lead_part, owned};
use foretrace_sim::data::{DataSet, Split};
use serde_json::json;

use super::lab_run::{LabRun, SettingsSums};
use super::progress::StepProgress;
use super::shards::ShardArgs;
use super::{say_picture, shards, table};
use crate::failure::Failure;
use crate::output::{JsonArgs, note, say, say_lines};
use crate::units::UnitArgs;

#[derive(Debug, clap::Args)]
pub(crate) struct LeadtimeArgs {
    /// Data-set folders
    #[arg(long, value_name = "DIR", value_delimiter = ',', required = true)]
    data: Vec<PathBuf>,

    #[command(flatten)]
    unit: UnitArgs,

    /// Stop at a bad file instead of leaving it out
    #[arg(long)]
    strict: bool,

    /// Models, comma-separated; also lstm:FILE.safetensors, file:PREDICTIONS.csv, and external:COMMAND, a
    /// predictor of your own in another program (a comma ends a name): docs/extend/process.md [default: all]
    #[arg(long, value_name = "NAMES")]
    models: Option<String>,

    /// Part of the sets: a word of split.tsv, or all [default: test if there is one, else all]
    #[arg(long, value_name = "WORD")]
    split: Option<Split>,

    /// Write each set's points and targets as CSV to DIR and stop, for predictors that run elsewhere
    #[arg(long, value_name = "DIR", conflicts_with = "shard")]
    export_targets: Option<PathBuf>,

    /// Add every model's scores of every sequence to the JSON, for paired comparisons
    #[arg(long, requires = "json", conflicts_with = "export_targets")]
    each: bool,

    /// Folder for the picture and run.json, which tells how to repeat the run [default: a new one,
    /// foretrace-lab/leadtime-SET-DATE]
    #[arg(long, value_name = "DIR", conflicts_with = "shard")]
    out: Option<PathBuf>,

    #[command(flatten)]
    shard: ShardArgs,

    #[command(flatten)]
    json: JsonArgs,
}

/// As shards of it are named.
pub(super) const NAME: &str = "leadtime";

pub(super) fn run(args: &LeadtimeArgs) -> Result<(), Failure> {
    let data: Vec<&Path> = args.data.iter().map(PathBuf::as_path).collect();
    let lab_run = LabRun::begin(NAME, &data, args.out.as_deref(), &args.json)?;
    let entrants = entrants(args.models.as_deref())?;
    let exports = args.export_targets.as_deref();
    if exports.is_none() && args.shard.shard.is_none() {
        lab_run.try_folder()?;
    }
    let mut sets = Vec::new();
    for folder in &args.data {
        let split = match &args.split {
            Some(split) => split.clone(),
            None => usual_split(folder)?,
        };
        sets.push(table::load(folder, &split, exports.is_some(), args.strict, &args.unit)?);
    }
    if let Some(twice) =
        sets.iter().enumerate().find(|(i, set)| sets.iter().take(*i).any(|s| s.name == set.name))
    {
        let what = format_args!("--data names two sets called {:?}", twice.1.name);
        return Err(Failure::usage(what, "name each set once, or rename one of the folders"));
    }
    match (exports, args.shard.shard) {
        (Some(folder), _) => export_all(folder, &sets),
        (None, Some(shard)) => write_shard(args, shard, &entrants, &sets),
        (None, None) => compare_all(args, &entrants, &sets, &lab_run),
    }
}

fn entrants(names: Option<&str>) -> Result<Vec<Entrant>, Failure> {
    let Some(names) = names else { return Ok(Model::all().into_iter().map(Entrant::Model).collect()) };
    let mut entrants: Vec<Entrant> = Vec::new();
    for name in names.split(',').map(str::trim) {
        let entrant = match name.strip_prefix("file:") {
            Some(file) => {
                let predictions =
                    Predictions::load(Path::new(file)).map_err(|error| Failure::bad_input(error, ""))?;
                Entrant::File { name: name.to_owned(), predictions }
            }
            None => Entrant::Model(Model::named(name).map_err(|error| table::unknown(&error))?),
        };
        if entrants.iter().any(|e| e.name() == name) {
            return Err(Failure::usage(
                format_args!("model {name:?} is named twice"),
                "name each model once",
            ));
        }
        entrants.push(entrant);
    }
    Ok(entrants)
}

fn usual_split(folder: &Path) -> Result<Split, Failure> {
    let words = DataSet::splits(folder)
        .map_err(|error| Failure::bad_input(error, "give data-set folders (--data)"))?;
    Ok(if words.iter().any(|word| word == "test") { Split::test() } else { Split::All })
}

fn export_all(folder: &Path, sets: &[Set]) -> Result<(), Failure> {
    for set in sets {
        let files = export(folder, &set.name, &set.scored).map_err(|error| {
            Failure::failed(
                format_args!("cannot write to {}: {error}", folder.display()),
                "give a writable folder",
            )
        })?;
        for file in files {
            say!("{}", file.display());
        }
    }
    Ok(())
}

fn compare_all(
    args: &LeadtimeArgs,
    entrants: &[Entrant],
    sets: &[Set],
    lab_run: &LabRun,
) -> Result<(), Failure> {
    let progress = StepProgress::of("lab leadtime", entrants.len() * sets.len());
    let (boards, standings) = compare(entrants, sets, &|| progress.step()).map_err(refused)?;
    drop(progress);
    show(&boards, &standings, args.each, lab_run, &args.json)
}

/// Predicts for the shard's sequences, and writes what the merge needs.
fn write_shard(args: &LeadtimeArgs, shard: Shard, entrants: &[Entrant], sets: &[Set]) -> Result<(), Failure> {
    let owned = owned(sets, shard);
    let progress = StepProgress::of("lab leadtime", entrants.len() * sets.len());
    let predicted = predict_all(entrants, sets, &owned, &|| progress.step()).map_err(refused)?;
    drop(progress);
    let run = LeadRun {
        sets: sets.iter().map(SetRun::of).collect(),
        models: entrants.iter().map(|entrant| entrant.name().to_owned()).collect(),
        networks: brought(entrants),
        each: args.each,
    };
    let all = || owned.iter().flatten();
    let counts = [all().filter(|own| **own).count(), all().count()];
    shards::write(&args.json, NAME, shard, run, lead_part(sets, &owned, &predicted), counts)
}

fn refused(error: BoardError) -> Failure {
    match error {
        BoardError::Predictions(_) => Failure::bad_input(error, ""),
        BoardError::Model(RegistryError::Process { .. }) => Failure::failed(error, ""),
        other => Failure::bad_input(other, "choose other models (--models)"),
    }
}

/// The result, with the picture in `out`, and every sequence where that was asked for.
pub(super) fn show(
    boards: &[Board],
    standings: &[Standing],
    each: bool,
    lab_run: &LabRun,
    json: &JsonArgs,
) -> Result<(), Failure> {
    if let Some(board) = boards.iter().find(|board| board.instants == 0) {
        let what = format_args!("{}: no stroke is long enough for a prediction to be judged", board.set);
        return Err(Failure::bad_input(what, "give longer recordings, or leave the set out (--data)"));
    }
    boards.iter().for_each(|board| say_lines(board.lines()));
    say_lines(standing_lines(standings, boards.len()));
    if standings.iter().any(|standing| standing.sets < boards.len()) {
        note!("lab: standings over different sets do not compare");
    }
    let mut result = json!({ "sets": boards, "standings": standings });
    if each {
        result["sequences"] = json!(boards.iter().flat_map(Board::each).collect::<Vec<_>>());
    }
    let file = draw(&lab_run.keep(json, &result)?, boards)?;
    say!("");
    say_picture(&file);
    lab_run.finish(SettingsSums::default())
}
