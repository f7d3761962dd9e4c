//! `foretrace lab train`: a network from recorded handwriting, as a file that the tables and the loop load.
//!
//! Contract: the model appears at `--out` whole and only when it is finished. After every epoch a checkpoint
//! beside it (`OUT.checkpoint`) holds all that `--resume` needs to continue bit for bit; the finished model
//! removes it.

mod bench;
mod checkpoint;
mod foresight;
mod options;

use std::collections::BTreeMap;
use std::fmt::Display;
use std::ops::ControlFlow;
use std::path::Path;
use std::time::Instant;

use foretrace_config::models::DType;
use foretrace_control::pen::TARGET_RMS;
use foretrace_lab::train::corpus::{self, Item};
use foretrace_lab::train::{Fit, FitError, Setup, Strokes, Units, citation, curve, model};
use foretrace_sim::data::DataSet;
use serde_json::json;

use super::progress::Progress;
use crate::failure::{Cause, Failure};
use crate::interrupt::Interrupt;
use crate::output::{note, say};
use checkpoint::Checkpoint;
pub(in crate::lab) use foresight::usual as foresight_plan;
pub(crate) use options::TrainArgs;
pub(in crate::lab) use options::threads;
use options::{Choice, Model};

pub(super) fn run(args: &TrainArgs) -> Result<(), Failure> {
    args.json.claim()?;
    if args.bench {
        return bench::run(args);
    }
    let Some(out) = &args.out else { return Err(Failure::new(Cause::Usage, "no --out", "give --out FILE")) };
    if args.model == Model::Foresight {
        return foresight::run(args, out);
    }
    args.only_of_lstm()?;
    let interrupt = Interrupt::listen()?;
    let choice = args.choice()?;
    let data = Data::load(args)?;
    let checkpoint = Checkpoint::beside(out, data.plan(&choice), args.resume)?;
    let setup = Setup { network: choice.network, objective: choice.objective.clone(), scale: data.scale };
    let state = checkpoint.continued(setup.network.shape.count())?;
    data.announce(args, &choice);
    let parts = (data.train.clone(), data.held_out.clone());
    let mut fit = Fit::new(choice.plan.clone(), setup.clone(), parts, args.threads(), state);
    let begin = Instant::now();
    let earlier = fit.state().history.len();
    // Patience may end it sooner.
    let progress = Progress::of("lab train", choice.plan.epochs * fit.batches_per_epoch());
    progress.skip(earlier * fit.batches_per_epoch());
    while !fit.is_finished() {
        epoch(&mut fit, &interrupt, &choice, &progress)?;
        checkpoint.save(fit.state())?;
    }
    drop(progress);
    let made = fit.state().history.len() - earlier;
    let us_per_step = (made > 0)
        .then(|| begin.elapsed().as_secs_f64() * 1e6 / (made * fit.steps_per_epoch()).max(1) as f64);
    // Where that fails, --resume goes through it once more.
    finish(args, out, &choice, &data, &setup, &fit, us_per_step, checkpoint.file())?;
    checkpoint.remove();
    Ok(())
}

/// One epoch and its line.
fn epoch(fit: &mut Fit, interrupt: &Interrupt, choice: &Choice, progress: &Progress) -> Result<(), Failure> {
    let number = fit.state().history.len() + 1;
    let done = fit.epoch(|| {
        progress.step();
        if interrupt.is_set() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    });
    let done = done.map_err(|error| match error {
        FitError::Interrupted => {
            let what = format_args!("interrupted in epoch {number}").to_string();
            let remedy = if number > 1 { "continue from the epoch before with --resume" } else { "" };
            Failure::new(Cause::Interrupted, what, remedy)
        }
        FitError::Diverged { .. } => Failure::failed(error, ""),
    })?;
    let held_out = done.held_out.map_or_else(String::new, |s| {
        format!(", held out {:.5}, MSE {}, within strokes {}", s.loss, figure(s.mse), figure(s.within))
    });
    let (epochs, loss) = (choice.plan.epochs, done.train_loss);
    progress.note(format_args!("epoch {number:>3}/{epochs}: loss {loss:.5}{held_out}"));
    Ok(())
}

/// The sequences of a training.
struct Data {
    names: Vec<String>,
    train: Vec<Strokes>,
    held_out: Vec<Strokes>,
    writers: [usize; 2],
    step_ms: f64,
    /// Raw displacements are divided by this.
    scale: f64,
}

impl Data {
    fn load(args: &TrainArgs) -> Result<Self, Failure> {
        let wrong = |error: &dyn Display| Failure::bad_input(error, "");
        let mut items = Vec::new();
        let mut names = Vec::new();
        for folder in &args.data {
            let set = DataSet::load(folder, &args.split, args.strict).map_err(|error| wrong(&error))?;
            set.errors.iter().for_each(|error| note!("lab: {error}"));
            items.extend(corpus::items(&set));
            names.push(set.name);
        }
        let (mut items, step_ms) = corpus::at_step(items, args.step_ms).map_err(|error| wrong(&error))?;
        if args.units() == Units::Normalised {
            corpus::normalise(&mut items);
        }
        let (train, held_out) = if args.all_writers {
            (items, Vec::new())
        } else {
            corpus::hold_out(items, args.hold_out, args.seed).map_err(|error| wrong(&error))?
        };
        let writers = [&train, &held_out].map(|items| {
            items.iter().map(|item| &item.writer).collect::<std::collections::BTreeSet<_>>().len()
        });
        let strokes = |items: Vec<Item>| items.into_iter().map(|item| item.strokes).collect::<Vec<_>>();
        let (train, held_out) = (strokes(train), strokes(held_out));
        let scale = match args.units() {
            Units::Raw => corpus::rms(&train),
            Units::Normalised => TARGET_RMS,
        };
        if !(scale > 0.0) {
            return Err(wrong(&"the train writers never move; give another --seed, or --final"));
        }
        Ok(Self { names, train, held_out, writers, step_ms, scale })
    }

    fn steps(&self) -> usize {
        self.train.iter().map(|s| s.v.len()).sum()
    }

    /// One line on what is trained on.
    fn title(&self) -> String {
        let [train, held_out] = self.writers;
        let [sequences, held] = [self.train.len(), self.held_out.len()];
        format!(
            "{}: {sequences} sequences ({} steps of {} ms) of {train} writers, {held} of {held_out} writers \
             held out",
            self.names.join(", "),
            self.steps(),
            self.step_ms
        )
    }

    /// One line per thing that must be the same to continue.
    fn plan(&self, choice: &Choice) -> String {
        let Choice { network, objective, plan, .. } = choice;
        format!("{network:?}\n{objective:?}\n{plan:?}\nscale {}\ndata {:x}", self.scale, self.fingerprint())
    }

    fn announce(&self, args: &TrainArgs, choice: &Choice) {
        note!("lab: lstm{} by the {} recipe, {} threads", args.cells(), choice.recipe.name(), args.threads());
        note!("lab: {}", self.title());
    }

    /// Changes with every displacement (FNV-1a over their bits).
    fn fingerprint(&self) -> u64 {
        let mut hash = 0xcbf2_9ce4_8422_2325_u64;
        for strokes in self.train.iter().chain(&self.held_out) {
            for word in strokes.v.iter().flatten().map(|x| x.to_bits()).chain([strokes.v.len() as u64]) {
                hash = (hash ^ word).wrapping_mul(0x0100_0000_01b3);
            }
        }
        hash
    }
}

/// Model, curve and result.
#[expect(clippy::too_many_arguments, reason = "everything that a training ends with")]
fn finish(
    args: &TrainArgs,
    out: &Path,
    choice: &Choice,
    data: &Data,
    setup: &Setup,
    fit: &Fit,
    us_per_step: Option<f64>,
    checkpoint: &Path,
) -> Result<(), Failure> {
    let (best, parameters) = fit.outcome();
    let history = &fit.state().history;
    let scores = history.get(best).and_then(|epoch| epoch.held_out);
    let notes = notes(args, choice, data, history.len(), best, scores);
    let model = model(&out.display().to_string(), setup, parameters, data.step_ms, notes)
        .map_err(|error| Failure::failed(error, "lower --rate, or limit gradients (--limit-norm 1)"))?;
    model.save(out, DType::F32).map_err(|error| {
        let kept = checkpoint.display();
        Failure::failed(
            error,
            format_args!("make room; the whole training is saved in {kept}: --resume writes the model"),
        )
    })?;
    let picture = out.with_extension("svg");
    let title = format!("lstm{}, {} recipe, seed {}", args.cells(), choice.recipe.name(), args.seed);
    // From here on the model is saved, and every failure says so.
    curve(&picture, &title, &data.title(), history).map_err(|error| {
        let saved = out.display();
        Failure::failed(
            error,
            format_args!("the model is saved in {saved}: make room, and --resume draws the picture"),
        )
    })?;
    if let Some(s) = scores {
        let (mse, within) = (figure(s.mse), figure(s.within));
        say!("held out {:.5} after epoch {}: MSE {mse}, within strokes {within}", s.loss, best + 1);
    }
    if let Some(us) = us_per_step {
        say!("training {us:.3} us per step, scoring and checkpoints included");
    }
    say!("model    {}\npicture  {}", out.display(), picture.display());
    let scores_json = |s: foretrace_lab::train::Scores| {
        json!({ "loss": s.loss, "mse": s.mse,
        "within": s.within, "position": s.position })
    };
    let epochs: Vec<_> = history
        .iter()
        .map(|e| {
            json!({ "rate": e.rate, "train_loss": e.train_loss,
            "held_out": e.held_out.map(scores_json) })
        })
        .collect();
    args.json.write(&json!({
        "model": format!("lstm{}", args.cells()),
        "recipe": choice.recipe.name(),
        "data": data.names,
        "sequences": data.train.len(),
        "steps": data.steps(),
        "input_scale": data.scale,
        "step_ms": data.step_ms,
        "best_epoch": best + 1,
        "held_out": scores.map(scores_json),
        "us_per_step": us_per_step,
        "epochs": epochs,
        "out": out.display().to_string(),
    }))
}

/// Formats an error in the device's units, of any magnitude.
fn figure(error: f64) -> String {
    if error.abs() < 1e-2 { format!("{error:.3e}") } else { format!("{error:.3}") }
}

/// Where the model comes from, for its metadata.
fn notes(
    args: &TrainArgs,
    choice: &Choice,
    data: &Data,
    epochs: usize,
    best: usize,
    scores: Option<foretrace_lab::train::Scores>,
) -> BTreeMap<String, String> {
    let mut notes = BTreeMap::from([
        ("trained_by", format!("foretrace {} lab train", env!("CARGO_PKG_VERSION"))),
        ("data", data.names.join(", ")),
        ("split", args.split.to_string()),
        ("writers", format!("{} trained on, {} held out", data.writers[0], data.writers[1])),
        ("sequences", format!("{} trained on, {} held out", data.train.len(), data.held_out.len())),
        ("units", if args.units() == Units::Raw { "raw" } else { "normalised" }.to_owned()),
        ("seed", args.seed.to_string()),
        ("epochs", format!("{epochs}, parameters of epoch {}", best + 1)),
        ("recipe", choice.recipe.name().to_owned()),
        ("objective", format!("{:?}", choice.objective)),
        ("plan", format!("{:?}", choice.plan)),
    ]);
    if let Some(s) = scores {
        notes.insert(
            "held_out_scores",
            format!("loss {}, mse {}, within strokes {}", s.loss, s.mse, s.within),
        );
    }
    notes.extend(cited(args, &data.names).map(|text| ("citation", text)));
    notes.into_iter().map(|(key, text)| (key.to_owned(), text)).collect()
}

/// What the model's card cites: the user's words, else what the data sets `names` ask for.
fn cited(args: &TrainArgs, names: &[String]) -> Option<String> {
    let mut texts: Vec<&str> = match &args.citation {
        Some(text) => vec![text],
        None => names.iter().filter_map(|name| citation(name)).collect(),
    };
    texts.dedup();
    (!texts.is_empty()).then(|| texts.join("; "))
}
