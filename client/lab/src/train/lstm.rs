//! An LSTM from recorded handwriting, as a file that the tables and the loop load.

use std::collections::BTreeSet;
use std::fmt::Display;
use std::ops::ControlFlow;
use std::time::Instant;

use foretrace_config::models::DType;
use foretrace_control::pen::TARGET_RMS;
use foretrace_failure::Failure;
use foretrace_sim::data::DataSet;
use serde_json::json;

use super::checkpoint_file::CheckpointFile;
use super::corpus::{self, Item, Strokes, Units};
use super::course::{Course, TrainingOptions, TrainingReport, TrainingWatch, completed, fingerprint};
use super::curve::curve;
use super::engine::{Scores, Setup};
use super::fit::{Epoch, Fit, FitError, TrainPlan, TrainState};
use super::loss::Objective;
use super::model::model;
use super::parameters::LstmNetwork;
use super::recipe::Recipe;

/// The LSTM that is asked for: a recipe, and what differs from it.
#[derive(Debug, Clone)]
pub struct LstmTraining {
    pub options: TrainingOptions,
    pub cells: usize,
    pub recipe: Recipe,
    pub network: LstmNetwork,
    pub objective: Objective,
    pub plan: TrainPlan,
    pub units: Units,
    /// Step to train at; usually the device's own \[ms\].
    pub step_ms: Option<f64>,
}

impl Course for Fit {
    fn steps(&self) -> usize {
        self.batches_per_epoch()
    }

    fn state(&self) -> &TrainState {
        self.state()
    }

    fn is_finished(&self) -> bool {
        self.is_finished()
    }

    fn epoch(&mut self, step: &dyn Fn(), interrupted: &dyn Fn() -> bool) -> Result<Epoch, FitError> {
        self.epoch(|| {
            step();
            if interrupted() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        })
    }

    fn words(Scores { loss, mse, within, .. }: Scores) -> String {
        format!("{loss:.5}, MSE {}, within strokes {}", figure(mse), figure(within))
    }
}

impl LstmTraining {
    /// Trains it, and writes the model with its loss curve beside it.
    ///
    /// # Errors
    ///
    /// The data or the checkpoint cannot be used, a file cannot be written, the training diverged, or
    /// somebody ended it.
    pub fn run(&self, watch: &TrainingWatch<'_>) -> Result<TrainingReport, Failure> {
        let data = LstmData::load(self, watch.tell)?;
        let checkpoint = CheckpointFile::beside(&self.options.out, data.plan(self), self.options.resume)?;
        let (network, objective) = (self.network, self.objective.clone());
        let setup = Setup { network, objective, scale: data.scale };
        let state = checkpoint.continued(setup.network.shape.count(), watch.tell)?;
        let threads = self.options.threads;
        (watch.tell)(&format!(
            "lab: lstm{} by the {} recipe, {threads} threads",
            self.cells,
            self.recipe.name()
        ));
        (watch.tell)(&format!("lab: {}", data.title()));
        let parts = (data.train.clone(), data.held_out.clone());
        let mut fit = Fit::new(self.plan.clone(), setup.clone(), parts, threads, state);
        let (begin, earlier) = (Instant::now(), fit.state().history.len());
        completed(&mut fit, self.plan.epochs, &checkpoint, watch)?;
        let steps = (fit.state().history.len() - earlier) * fit.steps_per_epoch();
        let us_per_step = (steps > 0).then(|| begin.elapsed().as_secs_f64() * 1e6 / steps as f64);
        // Where that fails, --resume goes through it once more.
        let report = self.finish(&data, &setup, &fit, us_per_step, &checkpoint)?;
        checkpoint.remove();
        Ok(report)
    }

    /// Model, curve and result.
    fn finish(
        &self,
        data: &LstmData,
        setup: &Setup,
        fit: &Fit,
        us_per_step: Option<f64>,
        checkpoint: &CheckpointFile,
    ) -> Result<TrainingReport, Failure> {
        let (best, parameters) = fit.outcome();
        let (history, out) = (&fit.state().history, &self.options.out);
        let scores = history.get(best).and_then(|epoch| epoch.held_out);
        let [writers, held_writers] = data.writers;
        let held_out_scores = scores.map(|s| {
            let text = format!("loss {}, mse {}, within strokes {}", s.loss, s.mse, s.within);
            ("held_out_scores", text)
        });
        let notes = [
            ("trained_by", format!("foretrace {} lab train", env!("CARGO_PKG_VERSION"))),
            ("data", data.names.join(", ")),
            ("writers", format!("{writers} trained on, {held_writers} held out")),
            ("sequences", format!("{} trained on, {} held out", data.train.len(), data.held_out.len())),
            ("units", if self.units == Units::Raw { "raw" } else { "normalised" }.to_owned()),
            ("seed", self.plan.seed.to_string()),
            ("epochs", format!("{}, parameters of epoch {}", history.len(), best + 1)),
            ("recipe", self.recipe.name().to_owned()),
            ("objective", format!("{:?}", self.objective)),
            ("plan", format!("{:?}", self.plan)),
        ];
        let notes = self.options.notes(&data.names, notes.into_iter().chain(held_out_scores));
        let model = model(&out.display().to_string(), setup, parameters, data.step_ms, notes)
            .map_err(|error| Failure::failed(error, "lower --rate, or limit gradients (--limit-norm 1)"))?;
        model.save(out, DType::F32).map_err(|error| {
            let kept = checkpoint.file().display();
            let remedy = "make room; the whole training is saved in";
            Failure::failed(error, format_args!("{remedy} {kept}: --resume writes the model"))
        })?;
        let picture = out.with_extension("svg");
        let seed = self.plan.seed;
        let title = format!("lstm{}, {} recipe, seed {seed}", self.cells, self.recipe.name());
        // From here on the model is saved, and every failure says so.
        curve(&picture, &title, &data.title(), history).map_err(|error| {
            let saved = out.display();
            let remedy = format!("the model is saved in {saved}: make room, and --resume draws the picture");
            Failure::failed(error, remedy)
        })?;
        let mut lines = Vec::new();
        if let Some(Scores { loss, mse, within, .. }) = scores {
            let (mse, within) = (figure(mse), figure(within));
            let best = best + 1;
            lines.push(format!("held out {loss:.5} after epoch {best}: MSE {mse}, within strokes {within}"));
        }
        lines.extend(
            us_per_step.map(|us| format!("training {us:.3} us per step, scoring and checkpoints included")),
        );
        lines.push(format!("model    {}\npicture  {}", out.display(), picture.display()));
        let scores_json =
            |s: Scores| json!({ "loss": s.loss, "mse": s.mse, "within": s.within, "position": s.position });
        let epoch_json = |e: &Epoch| {
            let held_out = e.held_out.map(scores_json);
            json!({ "rate": e.rate, "train_loss": e.train_loss, "held_out": held_out })
        };
        let json = json!({
            "model": format!("lstm{}", self.cells),
            "recipe": self.recipe.name(),
            "data": data.names,
            "sequences": data.train.len(),
            "steps": data.steps(),
            "input_scale": data.scale,
            "step_ms": data.step_ms,
            "best_epoch": best + 1,
            "held_out": scores.map(scores_json),
            "us_per_step": us_per_step,
            "epochs": history.iter().map(epoch_json).collect::<Vec<_>>(),
            "out": out.display().to_string(),
        });
        Ok(TrainingReport { lines, json })
    }
}

/// The sequences of a training.
struct LstmData {
    names: Vec<String>,
    train: Vec<Strokes>,
    held_out: Vec<Strokes>,
    writers: [usize; 2],
    step_ms: f64,
    /// Raw displacements are divided by this.
    scale: f64,
}

impl LstmData {
    fn load(training: &LstmTraining, tell: &dyn Fn(&str)) -> Result<Self, Failure> {
        let wrong = |error: &dyn Display| Failure::bad_input(error, "");
        let options = &training.options;
        let (mut items, mut names) = (Vec::new(), Vec::new());
        for folder in &options.data {
            let set = DataSet::load(folder, &options.split, options.strict).map_err(|error| wrong(&error))?;
            set.errors.iter().for_each(|error| tell(&format!("lab: {error}")));
            set.remarks().iter().for_each(|remark| tell(&format!("lab: {remark}")));
            items.extend(corpus::items(&set));
            names.push(set.name);
        }
        let (mut items, step_ms) = corpus::at_step(items, training.step_ms).map_err(|error| wrong(&error))?;
        if training.units == Units::Normalised {
            corpus::normalise(&mut items);
        }
        let (train, held_out) = if options.all_writers {
            (items, Vec::new())
        } else {
            corpus::hold_out(items, options.hold_out, training.plan.seed).map_err(|error| wrong(&error))?
        };
        let writers = [&train, &held_out]
            .map(|items| items.iter().map(|item| &item.writer).collect::<BTreeSet<_>>().len());
        let strokes = |items: Vec<Item>| items.into_iter().map(|item| item.strokes).collect::<Vec<_>>();
        let (train, held_out) = (strokes(train), strokes(held_out));
        let scale = match training.units {
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
        let ([train, held_out], held) = (self.writers, self.held_out.len());
        format!(
            "{}: {} sequences ({} steps of {} ms) of {train} writers, {held} of {held_out} writers held out",
            self.names.join(", "),
            self.train.len(),
            self.steps(),
            self.step_ms
        )
    }

    /// One line for each property that must be the same to continue.
    fn plan(&self, training: &LstmTraining) -> String {
        let LstmTraining { network, objective, plan, .. } = training;
        let all = self.train.iter().chain(&self.held_out);
        let words = all.flat_map(|strokes| {
            strokes.v.iter().flatten().map(|x| x.to_bits()).chain([strokes.v.len() as u64])
        });
        let (scale, data) = (self.scale, fingerprint(words));
        format!("{network:?}\n{objective:?}\n{plan:?}\nscale {scale}\ndata {data:x}")
    }
}

/// Formats an error in the device's units, of any magnitude.
fn figure(error: f64) -> String {
    if error.abs() < 1e-2 { format!("{error:.3e}") } else { format!("{error:.3}") }
}
