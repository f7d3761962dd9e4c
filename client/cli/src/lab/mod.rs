//! `foretrace lab`: train, rank and benchmark predictors, and the paper's experiments, with the daemon's own
//! control law.

mod closed_loop;
mod figures;
mod inputs;
mod lab_run;
mod law;
mod table;
mod table1;
mod train;
mod evaluate;
mod fetch;
mod generate;
mod leadtime;
mod merge;
mod pictures;
mod progress;
mod shards;

use std::io::Write as _;
use std::path::{Path, PathBuf};

use foretrace_config::Config;
use foretrace_lab::experiments::{Labels, Letter, letters};
use foretrace_sim::data::{DataSet, Split};
use foretrace_sim::path::{Anchor, Layout, Placement};
use foretrace_sim::source::Workspace;

use crate::failure::Failure;
use crate::interrupt::ends_at_once;
use crate::output::{JsonArgs, note, say};
use crate::settings::SettingsArgs;
use crate::units::UnitArgs;

/// `foretrace lab ...`
#[derive(Debug, clap::Subcommand)]
pub(crate) enum LabCommand {
    /// Make figure 2 of the paper: feedback only, prediction and perfect foresight on letters of a data set
    ///
    /// The control law writes every letter of the test writers with each predictor, on an ideal arm and on
    /// the simulated UR5. Errors are between tool and pen at the same instant, pen down. The picture shows
    /// hold, constant-velocity, dybm, mixture and oracle, or all of --predictors if it names at most five.
    Fig2(figures::Fig2Args),
    /// Make figure 3 of the paper: switch from feedback to prediction in steps 30 to 40 of a letter
    ///
    /// Ratios compare the ramp with the rest of the same letter: the largest jerk, and the largest step of
    /// the error.
    Fig3(figures::Fig3Args),
    /// Benchmark in closed loop: every sequence of a set, predictors with trust against baselines, on four
    /// simulated arms
    ///
    /// Errors are between tool and pen at the same instant, hover included. `ideal` and `delay30` have no
    /// motion limits and letters of 0.1 m; `ur5` and `slow` are simulated UR5s with all limits and letters of
    /// 0.03 m.
    ClosedLoop(Box<closed_loop::ClosedLoopArgs>),
    /// Measure what half and double of each number of the law do to the error
    ///
    /// Prints a table in Markdown: the change of the mean squared error over all sets and arms, and the cells
    /// with the least and the most.
    Law(law::LawArgs),
    /// Make table 1 of the paper: every predictor one to ten steps ahead, on the test writers of a data set
    ///
    /// Models that learn online pass over the train writers first (DyBM three times). PS-B and PS-LSTM are
    /// the shares of sequences with a smaller error than constant velocity and than the reference LSTM(10).
    Table1(table1::Table1Args),
    /// Score any predictor on any part of any data set, also without a train part
    Evaluate(evaluate::EvaluateArgs),
    /// Rank predictors by error against look-ahead time, 10 to 200 ms, on devices of any rate
    ///
    /// Your own predictors take part as an LSTM (lstm:FILE.safetensors), as a program (external:COMMAND), or
    /// as predictions (file:PREDICTIONS.csv) for the targets that --export-targets writes.
    Leadtime(leadtime::LeadtimeArgs),
    /// Put the shards of a run together: the same table, JSON and pictures as without --shard
    ///
    /// Refuses files of different runs, the same shard twice, and missing shards. Times are those of the
    /// machines that computed the shards. docs/extend/shards.md has recipes.
    Merge(merge::MergeArgs),
    /// Train a network on recorded handwriting
    ///
    /// A share of the train writers is held out to choose the best epoch (--final trains on all). The same
    /// seed, data and options give the same file. An interrupted training continues with --resume.
    Train(train::TrainArgs),
    /// Measure what each kind of input is worth to the network foresight
    ///
    /// Trains it with all inputs, with each kind left out, with more context up to being told the letter, and
    /// with each set left out of the training, and judges every network on other writers.
    Inputs(inputs::InputsArgs),
    /// Tell where the published sets are, or check one that was downloaded and write its split.tsv
    ///
    /// Downloads nothing. Names source, licence and the lines that make the set's folder of the archive.
    Fetch(fetch::FetchArgs),
    /// Write a small set in the hands of the built-in writer, so that every command here runs without
    /// recordings
    ///
    /// The same options give the same bytes. Its figures say nothing about people.
    Generate(generate::GenerateArgs),
    /// Make every picture of README and docs again
    ///
    /// Runs the demo for its pictures; pictures of recordings need --recordings, the folder of the data sets.
    /// Names each picture that cannot be made, with the command that makes it. Prints each picture's figures.
    Pictures(pictures::PicturesArgs),
}

#[derive(Debug, clap::Args)]
pub(crate) struct LabArgs {
    /// Data-set folder
    #[arg(long, value_name = "DIR")]
    data: PathBuf,

    /// Part of the set: a word of its split.tsv, or all
    #[arg(long, value_name = "WORD", default_value = "test")]
    split: Split,

    #[command(flatten)]
    unit: UnitArgs,

    /// Stop at a bad file instead of leaving it out
    #[arg(long)]
    strict: bool,

    /// Letters with this label, or all
    #[arg(long, value_name = "LABEL|all", default_value = "K")]
    label: String,

    /// At most this many letters, in the order of the set
    #[arg(long, value_name = "N", value_parser = count)]
    limit: Option<usize>,

    /// Height of a median letter in the pen's plane [m]
    #[arg(long, value_name = "M", default_value_t = 0.03, value_parser = crate::values::positive)]
    height: f64,

    /// Folder for the pictures and run.json, which tells how to repeat the run [default: a new one,
    /// foretrace-lab/COMMAND-SET-DATE]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,

    #[command(flatten)]
    settings: SettingsArgs,

    #[command(flatten)]
    json: JsonArgs,
}

pub(crate) fn run(command: &LabCommand) -> Result<(), Failure> {
    // Training handles the signal itself and saves its state.
    if !matches!(command, LabCommand::Train(_)) {
        ends_at_once()?;
    }
    match command {
        LabCommand::Fig2(args) => Experiment::prepare("fig2", &args.lab)?.fig2(args),
        LabCommand::Fig3(args) => Experiment::prepare("fig3", &args.lab)?.fig3(args),
        LabCommand::ClosedLoop(args) => closed_loop::run(args),
        LabCommand::Law(args) => law::run(args),
        LabCommand::Table1(args) => table1::run(args),
        LabCommand::Evaluate(args) => evaluate::run(args),
        LabCommand::Leadtime(args) => leadtime::run(args),
        LabCommand::Merge(args) => merge::run(args),
        LabCommand::Train(args) => train::run(args),
        LabCommand::Inputs(args) => inputs::run(args),
        LabCommand::Fetch(args) => fetch::run(args),
        LabCommand::Generate(args) => generate::run(args),
        LabCommand::Pictures(args) => pictures::run(args),
    }
}

/// Says which picture was made.
fn say_picture(file: &Path) {
    say!("picture  {}", file.display());
}

/// Writes a text whole, or not at all.
fn write_text(file: &Path, text: &str) -> Result<(), Failure> {
    foretrace_host::whole::write(file, |out| out.write_all(text.as_bytes())).map_err(|error| {
        let what = format!("{} cannot be written: {error}", file.display());
        Failure::failed(what, "choose a file in an existing folder with room that you may write to")
    })
}

/// How many of something, at least one.
fn count(text: &str) -> Result<usize, String> {
    let count = text.parse().ok().filter(|count| *count >= 1);
    count.ok_or_else(|| "a whole number from 1; leave the option out for all of them".to_owned())
}

/// Settings and letters of an experiment.
struct Experiment {
    config: Config,
    letters: Vec<Letter>,
    /// Name of the set and what was chosen from it.
    title: String,
    run: lab_run::LabRun,
}

impl Experiment {
    fn prepare(command: &str, args: &LabArgs) -> Result<Self, Failure> {
        let run = lab_run::LabRun::begin(command, &[&args.data], args.out.as_deref(), &args.json)?;
        run.try_folder()?;
        let config = args.settings.load()?;
        let wrong = |error: &dyn std::fmt::Display| {
            Failure::bad_input(error, "give a data-set folder (--data) and a label in it (--label)")
        };
        let set = DataSet::load_in(&args.data, &args.split, args.strict, args.unit.units())
            .map_err(|error| wrong(&error))?;
        for error in &set.errors {
            note!("lab: {error}");
        }
        for remark in set.remarks() {
            note!("lab: {remark}");
        }
        let labels = match args.label.as_str() {
            "all" => Labels::All,
            label => Labels::One(label.to_owned()),
        };
        let workspace = Workspace::of(config.settings());
        let placement: Placement = workspace.placement(args.height, Layout::Centre, Anchor::Middle);
        let (mut letters, skipped) = letters(&set, &labels, &placement).map_err(|error| wrong(&error))?;
        if skipped > 0 {
            note!("lab: {skipped} letters do not fit the workspace and are left out");
        }
        letters.truncate(args.limit.unwrap_or(usize::MAX));
        let title = match &args.split {
            Split::All => format!("{} letters {:?} of {}", letters.len(), args.label, set.name),
            part => format!("{} letters {:?} of {}, {part} part", letters.len(), args.label, set.name),
        };
        note!("lab: {title}");
        Ok(Self { config, letters, title, run })
    }
}

#[cfg(test)]
mod tests {
    use super::count;

    #[test]
    fn none_of_something_is_not_a_count() {
        assert_eq!(count("3"), Ok(3));
        for wrong in ["0", "-1", "nan", "", "1e9"] {
            assert!(count(wrong).unwrap_err().contains("from 1"), "{wrong}");
        }
    }
}
