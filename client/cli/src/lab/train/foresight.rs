//! `foretrace lab train --model foresight`: the network that sees contact, direction and time.
//!
//! Contract: as for the LSTMs: the model appears at `--out` whole and only when it is finished, and after
//! every epoch a checkpoint beside it holds all that `--resume` needs to continue bit for bit.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Display;
use std::ops::ControlFlow;
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use foretrace_config::models::ForesightModel;
use foretrace_lab::train::foresight::{
    Context, Fit, LEADS_S, Plan, Sequence, Study, Without, Writing, hold_out, weights_of, writings,
};
use foretrace_lab::train::{Epoch, FitError, Schedule, Scores};
use serde_json::json;

use super::checkpoint::Checkpoint;
use super::{TrainArgs, cited};
use crate::failure::{Cause, Failure};
use crate::interrupt::Interrupt;
use crate::lab::progress::Progress;
use crate::output::{note, say};

/// Usual step of the grid \[ms\].
const STEP_MS: f64 = 10.0;
/// Usual passes over the writings.
const EPOCHS: usize = 40;
/// Usual examples per step of Adam.
const BATCH: usize = 256;
/// Usual peak of the learning rate, and the share of the training until it.
const RATE: f64 = 6e-3;
const WARM_UP: f64 = 0.15;
/// Share of the copies that are changed beyond size and phase.
const CHANGED: f64 = 0.3;
/// Longest gradient.
const LIMIT_NORM: f64 = 1.0;
/// Parts of an epoch that progress is counted in.
const PARTS: usize = 100;

pub(super) fn run(args: &TrainArgs, out: &Path) -> Result<(), Failure> {
    args.only_of_foresight()?;
    let interrupt = Interrupt::listen()?;
    let data = Data::load(args)?;
    let plan = plan(args)?;
    let described = format!("{plan:?}\ndata {:x}", data.fingerprint());
    let checkpoint = Checkpoint::beside(out, described, args.resume)?;
    let count = foretrace_lab::train::foresight::Shape { inputs: plan.study.inputs() }.count();
    let state = checkpoint.continued(count)?;
    note!("lab: foresight, {count} parameters, {} threads", args.threads());
    note!("lab: {}", data.title());
    let parts = (data.train.clone(), data.held_out.clone());
    let mut fit = Fit::new(plan.clone(), parts, args.threads(), state);
    let begin = Instant::now();
    let earlier = fit.state().history.len();
    let progress = Progress::of("lab train", plan.epochs * PARTS);
    progress.skip(earlier * PARTS);
    while !fit.is_finished() {
        epoch(&mut fit, &interrupt, plan.epochs, &progress)?;
        checkpoint.save(fit.state())?;
    }
    drop(progress);
    let minutes = begin.elapsed().as_secs_f64() / 60.0;
    finish(args, out, &plan, &data, &fit, minutes, &checkpoint)?;
    checkpoint.remove();
    Ok(())
}

fn plan(args: &TrainArgs) -> Result<Plan, Failure> {
    let step_ms = args.step_ms.unwrap_or(STEP_MS);
    if !(4.0..=20.0).contains(&step_ms) {
        let what = format!("a step of {step_ms} ms is outside of what the network's history covers");
        return Err(Failure::usage(what, "give --step-ms from 4 to 20"));
    }
    let usual = usual(args.epochs.map_or(EPOCHS, |n| n as usize), args.seed);
    Ok(Plan {
        schedule: Schedule::OneCycle { peak: args.rate.unwrap_or(RATE), warm_up: WARM_UP },
        batch: args.batch.map_or(usual.batch, |n| n as usize),
        step_ns: (step_ms * 1e6).round() as u64,
        study: Study { without: args.without.unwrap_or_default(), context: Context::Short },
        ..usual
    })
}

/// The usual training, of so many epochs.
pub(in crate::lab) fn usual(epochs: usize, seed: u64) -> Plan {
    Plan {
        schedule: Schedule::OneCycle { peak: RATE, warm_up: WARM_UP },
        epochs,
        batch: BATCH,
        seed,
        step_ns: (STEP_MS * 1e6) as u64,
        study: Study::default(),
        changed: CHANGED,
        limit_norm: LIMIT_NORM,
    }
}

/// One epoch and its line.
fn epoch(fit: &mut Fit, interrupt: &Interrupt, epochs: usize, progress: &Progress) -> Result<(), Failure> {
    let number = fit.state().history.len() + 1;
    let mut shown = 0;
    let done = fit.epoch(|share| {
        while shown < PARTS && shown as f64 <= share * PARTS as f64 {
            progress.step();
            shown += 1;
        }
        if interrupt.is_set() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    });
    let Epoch { train_loss, held_out, .. } = done.map_err(|error| match error {
        FitError::Interrupted => {
            let what = format_args!("interrupted in epoch {number}").to_string();
            let remedy = if number > 1 { "continue from the epoch before with --resume" } else { "" };
            Failure::new(Cause::Interrupted, what, remedy)
        }
        FitError::Diverged { .. } => Failure::failed(error, ""),
    })?;
    let held_out = held_out.map_or_else(String::new, |s| format!(", held out {}", shares(s)));
    progress.note(format_args!("epoch {number:>3}/{epochs}: loss {train_loss:.5}{held_out}"));
    Ok(())
}

/// Squared error over that of standing still, as text.
fn shares(scores: Scores) -> String {
    let [near, far] = LEADS_S.map(|lead_s| lead_s * 1e3);
    let (first, second) = (scores.mse, scores.within);
    format!("{first:.4} of standing still {near:.0} ms ahead, {second:.4} {far:.0} ms ahead")
}

/// The writings of a training.
struct Data {
    names: Vec<String>,
    train: Vec<Writing>,
    held_out: Vec<Writing>,
}

impl Data {
    fn load(args: &TrainArgs) -> Result<Self, Failure> {
        let wrong = |error: &dyn Display| Failure::bad_input(error, "");
        let (mut names, mut all) = (Vec::new(), Vec::new());
        for folder in &args.data {
            let (name, writings, remarks) =
                writings(folder, &args.split, args.strict).map_err(|error| wrong(&error))?;
            remarks.iter().for_each(|remark| note!("lab: {remark}"));
            names.push(name);
            all.extend(writings);
        }
        if all.is_empty() {
            return Err(Failure::bad_input("no hand in the data", "give a set with characters (--data)"));
        }
        let (train, held_out) = if args.all_writers {
            (all, Vec::new())
        } else {
            hold_out(all, args.hold_out, args.seed).map_err(|error| wrong(&error))?
        };
        Ok(Self { names, train, held_out })
    }

    /// One line on what is trained on.
    fn title(&self) -> String {
        let of = |writings: &[Writing]| {
            let writers: BTreeSet<&str> = writings.iter().map(|w| w.writer.as_str()).collect();
            (writers.len(), writings.iter().map(|w| w.sequences.len()).sum::<usize>())
        };
        let ((writers, sequences), (held, _)) = (of(&self.train), of(&self.held_out));
        let names = self.names.join(", ");
        format!("{names}: {sequences} characters of {writers} writers, {held} writers held out")
    }

    /// Changes with every sample (FNV-1a over their bits).
    fn fingerprint(&self) -> u64 {
        let mut hash = 0xcbf2_9ce4_8422_2325_u64;
        for Sequence { samples, .. } in self.train.iter().chain(&self.held_out).flat_map(|w| &w.sequences) {
            let words = samples.iter().flat_map(|s| [s.t_s, s.x_m, s.y_m, f64::from(u8::from(s.contact))]);
            for word in words.map(f64::to_bits).chain([samples.len() as u64]) {
                hash = (hash ^ word).wrapping_mul(0x0100_0000_01b3);
            }
        }
        hash
    }
}

/// Model and result.
fn finish(
    args: &TrainArgs,
    out: &Path,
    plan: &Plan,
    data: &Data,
    fit: &Fit,
    minutes: f64,
    checkpoint: &Checkpoint,
) -> Result<(), Failure> {
    let (best, parameters) = fit.outcome();
    let history = &fit.state().history;
    let scores = history.get(best).and_then(|epoch| epoch.held_out);
    let weights = weights_of(&plan.study, parameters, plan.step_ns)
        .map_err(|error| Failure::failed(error, "lower --rate, or train more epochs"))?;
    let notes = notes(args, plan, data, history.len(), best, scores);
    let model = ForesightModel { file: out.display().to_string(), weights: Arc::new(weights), notes };
    model.save(out).map_err(|error| {
        let kept = checkpoint.file().display();
        let remedy = format_args!("make room; the training is saved in {kept}: --resume writes the model");
        Failure::failed(error, remedy)
    })?;
    if let Some(scores) = scores {
        say!("held out {} after epoch {}", shares(scores), best + 1);
    }
    say!("trained  {minutes:.1} min\nmodel    {}", out.display());
    let scores_json = |s: Scores| json!({ "loss": s.loss, "still_35_ms": s.mse, "still_55_ms": s.within });
    let epochs: Vec<_> = history
        .iter()
        .map(|e| {
            let held_out = e.held_out.map(scores_json);
            json!({ "rate": e.rate, "train_loss": e.train_loss, "held_out": held_out })
        })
        .collect();
    args.json.write(&json!({
        "model": "foresight",
        "data": data.names,
        "step_ms": plan.step_ns as f64 * 1e-6,
        "best_epoch": best + 1,
        "held_out": scores.map(scores_json),
        "minutes": minutes,
        "epochs": epochs,
        "out": out.display().to_string(),
    }))
}

/// Where the model comes from, for its metadata.
fn notes(
    args: &TrainArgs,
    plan: &Plan,
    data: &Data,
    epochs: usize,
    best: usize,
    scores: Option<Scores>,
) -> BTreeMap<String, String> {
    let mut notes = BTreeMap::from([
        ("trained_by", format!("foretrace {} lab train --model foresight", env!("CARGO_PKG_VERSION"))),
        ("data", data.title()),
        ("split", args.split.to_string()),
        ("seed", args.seed.to_string()),
        ("epochs", format!("{epochs}, parameters of epoch {}", best + 1)),
        ("plan", format!("{plan:?}")),
    ]);
    if let Some(scores) = scores {
        notes.insert("held_out_scores", shares(scores));
    }
    notes.extend(cited(args, &data.names).map(|text| ("citation", text)));
    notes.into_iter().map(|(key, text)| (key.to_owned(), text)).collect()
}

/// What an ablation leaves out: `contact`, `direction`, `time`, comma-separated.
pub(super) fn without(text: &str) -> Result<Without, String> {
    let mut without = Without::default();
    for part in text.split(',').map(str::trim) {
        match part {
            "contact" => without.contact = true,
            "direction" => without.direction = true,
            "time" => without.time = true,
            _ => return Err("contact, direction or time, comma-separated".to_owned()),
        }
    }
    Ok(without)
}
