//! `foretrace lab inputs`: what each kind of input, more context, and each training set are worth to the
//! network `foresight`.

use std::io::Write as _;
use std::ops::ControlFlow;
use std::path::PathBuf;

use foretrace_lab::train::foresight::{Judgement, Plan, Trial, Writing, judge, train, writings};
use foretrace_sim::data::Split;
use serde_json::json;

use super::progress::Progress;
use super::train::{foresight_plan, threads};
use crate::failure::Failure;
use crate::output::{JsonArgs, note, say};

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

/// A line of the table.
struct Row {
    inputs: String,
    trained_on: String,
    set: String,
    judgement: Judgement,
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
    let trials = Trial::all(&names);
    let threads = threads(args.threads);
    let progress = Progress::of("lab inputs", trials.len() * PARTS);
    let mut rows = Vec::new();
    for trial in &trials {
        let plan = Plan { study: trial.study, ..foresight_plan(args.epochs as usize, args.seed) };
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
                rows.push(Row { inputs, trained_on, set, judgement });
            }
        }
    }
    drop(progress);
    print(&rows);
    if let Some(file) = &args.out {
        let text = csv(&rows);
        foretrace_sim::whole::write(file, |out| out.write_all(text.as_bytes())).map_err(|error| {
            let what = format!("{} cannot be written: {error}", file.display());
            Failure::failed(what, "choose a file in an existing folder with room that you may write to")
        })?;
        say!("table    {}", file.display());
    }
    let rows: Vec<_> = rows
        .iter()
        .map(|Row { inputs, trained_on, set, judgement }| {
            let Judgement { lead_s, share, low, high, writers } = judgement;
            json!({ "inputs": inputs, "trained_on": trained_on, "set": set, "lead_ms": lead_s * 1e3,
                "of_standing_still": share, "low": low, "high": high, "writers": writers })
        })
        .collect();
    args.json.write(&json!({ "epochs": args.epochs, "seed": args.seed, "rows": rows }))
}

fn print(rows: &[Row]) {
    say!("squared error over that of standing still [95 % over writers]");
    for Row { inputs, trained_on, set, judgement } in rows {
        let Judgement { lead_s, share, low, high, .. } = judgement;
        let ms = lead_s * 1e3;
        say!(
            "{set:24} {ms:3.0} ms  {share:.3} [{low:.3} {high:.3}]  inputs: {inputs}; trained on {trained_on}"
        );
    }
}

fn csv(rows: &[Row]) -> String {
    let mut text = "inputs,trained_on,set,lead_ms,of_standing_still,low,high,writers\n".to_owned();
    for Row { inputs, trained_on, set, judgement } in rows {
        let Judgement { lead_s, share, low, high, writers } = judgement;
        let ms = (lead_s * 1e3).round();
        text += &format!("{inputs},{trained_on},{set},{ms},{share:.4},{low:.4},{high:.4},{writers}\n");
    }
    text
}
