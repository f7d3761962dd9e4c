//! `foretrace lab inputs`: what each kind of input, more context, and each training set are worth to the
//! network `foresight`.

use std::ops::ControlFlow;
use std::path::PathBuf;

use foretrace_lab::train::foresight::{
    ForesightPlan, ForesightTrial, InputRow, Writing, input_csv, input_json, input_lines, judge, train,
    usual_plan, writings,
};
use foretrace_sim::data::Split;
use serde_json::json;

use super::progress::StepProgress;
use super::train::threads;
use super::write_text;
use crate::failure::Failure;
use crate::output::{JsonArgs, note, say, say_lines};

/// Parts of a training that progress is counted in.
const PARTS: usize = 100;

#[derive(Debug, clap::Args)]
pub(crate) struct InputsArgs {
    /// Data-set folder to train on; may be given several times
    #[arg(long, value_name = "DIR", required = true)]
    data: Vec<PathBuf>,

    /// Part of the sets to train on: a word of their split.tsv, or all
    #[arg(long, value_name = "WORD", default_value = "train")]
    split: Split,

    /// Data-set folder to judge on; may be given several times [default: those trained on]
    #[arg(long, value_name = "DIR")]
    judge: Vec<PathBuf>,

    /// Part of the sets to judge on
    #[arg(long, value_name = "WORD", default_value = "test")]
    judge_split: Split,

    /// Passes over the writings per training
    #[arg(long, value_name = "N", default_value_t = 6)]
    #[arg(value_parser = clap::value_parser!(u32).range(1..=1000))]
    epochs: u32,

    /// Seed of the initial weights, order and changed copies
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,

    /// Threads; the result is the same with any number [default: the machine's]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=256))]
    threads: Option<u32>,

    /// Table to write, CSV
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,

    /// Stop at a bad file instead of leaving it out
    #[arg(long)]
    strict: bool,

    #[command(flatten)]
    json: JsonArgs,
}

pub(super) fn run(args: &InputsArgs) -> Result<(), Failure> {
    args.json.claim()?;
    let sets = |folders: &[PathBuf], split: &Split| -> Result<Vec<(String, Vec<Writing>)>, Failure> {
        let load = |folder: &PathBuf| {
            let (name, writings, remarks) =
                writings(folder, split, args.strict).map_err(|error| Failure::bad_input(error, ""))?;
            remarks.iter().for_each(|remark| note!("lab: {remark}"));
            Ok((name, writings))
        };
        folders.iter().map(load).collect()
    };
    let trained = sets(&args.data, &args.split)?;
    let judged = sets(if args.judge.is_empty() { &args.data } else { &args.judge }, &args.judge_split)?;
    let names: Vec<String> = trained.iter().map(|(name, _)| name.clone()).collect();
    let all: Vec<Writing> = trained.into_iter().flat_map(|(_, writings)| writings).collect();
    let trials = ForesightTrial::all(&names);
    let threads = threads(args.threads);
    let progress = StepProgress::of("lab inputs", trials.len() * PARTS);
    let mut rows = Vec::new();
    for trial in &trials {
        let plan = ForesightPlan { study: trial.study, ..usual_plan(args.epochs as usize, args.seed) };
        let mut shown = 0;
        let watch = |share: f64| {
            while shown < PARTS && shown as f64 <= share * PARTS as f64 {
                progress.step();
                shown += 1;
            }
            ControlFlow::Continue(())
        };
        let parameters =
            train(&plan, trial.of(&all), threads, watch).map_err(|error| Failure::failed(error, ""))?;
        let trained_on = trial.left_out.as_ref().map_or("all".to_owned(), |set| format!("all but {set}"));
        for (set, writings) in &judged {
            for judgement in judge(&plan, &parameters, writings, threads) {
                let (inputs, trained_on, set) = (trial.inputs(), trained_on.clone(), set.clone());
                rows.push(InputRow { inputs, trained_on, set, judgement });
            }
        }
    }
    drop(progress);
    say_lines(input_lines(&rows));
    if let Some(file) = &args.out {
        write_text(file, &input_csv(&rows))?;
        say!("table    {}", file.display());
    }
    let rows = input_json(&rows);
    args.json.write(&json!({ "epochs": args.epochs, "seed": args.seed, "rows": rows }))
}
