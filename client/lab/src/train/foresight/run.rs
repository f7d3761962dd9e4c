//! `foresight` from recorded handwriting, as a file that the loop loads.

use std::collections::BTreeSet;
use std::fmt::Display;
use std::ops::ControlFlow;
use std::sync::Arc;
use std::time::Instant;

use foretrace_config::models::ForesightModel;
use foretrace_failure::Failure;
use serde_json::json;

use super::corpus::{Writing, WrittenCharacter, writings};
use super::fit::{ForesightFit, ForesightPlan};
use super::model::weights_of;
use super::network::ForesightShape;
use super::score::LEADS_S;
use super::study::Study;
use crate::train::checkpoint_file::CheckpointFile;
use crate::train::corpus::hold_out;
use crate::train::course::{Course, TrainingOptions, TrainingReport, TrainingWatch, completed, fingerprint};
use crate::train::{Epoch, FitError, Schedule, Scores, TrainState};

/// Usual step of the grid \[ms\].
pub const STEP_MS: f64 = 10.0;
/// Usual passes over the writings.
pub const EPOCHS: usize = 40;
/// Usual peak of the learning rate.
pub const RATE: f64 = 6e-3;
/// Share of the training until that peak.
pub const WARM_UP: f64 = 0.15;
/// Usual examples per step of Adam.
const BATCH: usize = 256;
/// Share of the copies that are changed beyond size and phase.
const CHANGED: f64 = 0.3;
/// Longest gradient.
const LIMIT_NORM: f64 = 1.0;
/// Parts of an epoch that progress is counted in.
const PARTS: usize = 100;

/// The usual training, of so many epochs.
pub fn usual_plan(epochs: usize, seed: u64) -> ForesightPlan {
    ForesightPlan {
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

/// The training that is asked for.
#[derive(Debug, Clone)]
pub struct ForesightTraining {
    pub options: TrainingOptions,
    pub plan: ForesightPlan,
}

impl Course for ForesightFit {
    fn steps(&self) -> usize {
        PARTS
    }

    fn state(&self) -> &TrainState {
        self.state()
    }

    fn is_finished(&self) -> bool {
        self.is_finished()
    }

    fn epoch(&mut self, step: &dyn Fn(), interrupted: &dyn Fn() -> bool) -> Result<Epoch, FitError> {
        let mut shown = 0;
        self.epoch(|share| {
            while shown < PARTS && shown as f64 <= share * PARTS as f64 {
                step();
                shown += 1;
            }
            if interrupted() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        })
    }

    /// Squared error over that of standing still.
    fn words(scores: Scores) -> String {
        let [near, far] = LEADS_S.map(|lead_s| lead_s * 1e3);
        let (first, second) = (scores.mse, scores.within);
        format!("{first:.4} of standing still {near:.0} ms ahead, {second:.4} {far:.0} ms ahead")
    }
}

impl ForesightTraining {
    /// Trains it, and writes the model.
    ///
    /// # Errors
    ///
    /// The data or the checkpoint cannot be used, a file cannot be written, the training diverged, or
    /// somebody ended it.
    pub fn run(&self, watch: &TrainingWatch<'_>) -> Result<TrainingReport, Failure> {
        let (options, plan) = (&self.options, &self.plan);
        let data = ForesightData::load(options, plan.seed, watch.tell)?;
        let described = format!("{plan:?}\ndata {:x}", data.fingerprint());
        let checkpoint = CheckpointFile::beside(&options.out, described, options.resume)?;
        let count = ForesightShape { inputs: plan.study.inputs() }.count();
        let state = checkpoint.continued(count, watch.tell)?;
        (watch.tell)(&format!("lab: foresight, {count} parameters, {} threads", options.threads));
        (watch.tell)(&format!("lab: {}", data.title()));
        let parts = (data.train.clone(), data.held_out.clone());
        let mut fit = ForesightFit::new(plan.clone(), parts, options.threads, state);
        let begin = Instant::now();
        completed(&mut fit, plan.epochs, &checkpoint, watch)?;
        let report = self.finish(&data, &fit, begin.elapsed().as_secs_f64() / 60.0, &checkpoint)?;
        checkpoint.remove();
        Ok(report)
    }

    /// Model and result.
    fn finish(
        &self,
        data: &ForesightData,
        fit: &ForesightFit,
        minutes: f64,
        checkpoint: &CheckpointFile,
    ) -> Result<TrainingReport, Failure> {
        let Self { options, plan } = self;
        let (best, parameters) = fit.outcome();
        let (history, out) = (&fit.state().history, &options.out);
        let scores = history.get(best).and_then(|epoch| epoch.held_out);
        let weights = weights_of(&plan.study, parameters, plan.step_ns)
            .map_err(|error| Failure::failed(error, "lower --rate, or train more epochs"))?;
        let notes = [
            ("trained_by", format!("foretrace {} lab train --model foresight", env!("CARGO_PKG_VERSION"))),
            ("data", data.title()),
            ("seed", plan.seed.to_string()),
            ("epochs", format!("{}, parameters of epoch {}", history.len(), best + 1)),
            ("plan", format!("{plan:?}")),
        ];
        let held_out = scores.map(|scores| ("held_out_scores", ForesightFit::words(scores)));
        let notes = options.notes(&data.names, notes.into_iter().chain(held_out));
        let model = ForesightModel { file: out.display().to_string(), weights: Arc::new(weights), notes };
        model.save(out).map_err(|error| {
            let kept = checkpoint.file().display();
            let remedy =
                format_args!("make room; the training is saved in {kept}: --resume writes the model");
            Failure::failed(error, remedy)
        })?;
        let held_out =
            scores.map(|scores| format!("held out {} after epoch {}", ForesightFit::words(scores), best + 1));
        let mut lines: Vec<String> = held_out.into_iter().collect();
        lines.push(format!("trained  {minutes:.1} min\nmodel    {}", out.display()));
        let scores_json =
            |s: Scores| json!({ "loss": s.loss, "still_35_ms": s.mse, "still_55_ms": s.within });
        let epoch_json = |e: &Epoch| {
            let held_out = e.held_out.map(scores_json);
            json!({ "rate": e.rate, "train_loss": e.train_loss, "held_out": held_out })
        };
        let json = json!({
            "model": "foresight",
            "data": data.names,
            "step_ms": plan.step_ns as f64 * 1e-6,
            "best_epoch": best + 1,
            "held_out": scores.map(scores_json),
            "minutes": minutes,
            "epochs": history.iter().map(epoch_json).collect::<Vec<_>>(),
            "out": out.display().to_string(),
        });
        Ok(TrainingReport { lines, json })
    }
}

/// The writings of a training.
struct ForesightData {
    names: Vec<String>,
    train: Vec<Writing>,
    held_out: Vec<Writing>,
}

impl ForesightData {
    fn load(options: &TrainingOptions, seed: u64, tell: &dyn Fn(&str)) -> Result<Self, Failure> {
        let wrong = |error: &dyn Display| Failure::bad_input(error, "");
        let (mut names, mut all) = (Vec::new(), Vec::new());
        for folder in &options.data {
            let (name, writings, remarks) =
                writings(folder, &options.split, options.strict).map_err(|error| wrong(&error))?;
            remarks.iter().for_each(|remark| tell(&format!("lab: {remark}")));
            names.push(name);
            all.extend(writings);
        }
        if all.is_empty() {
            return Err(Failure::bad_input("no hand in the data", "give a set with characters (--data)"));
        }
        let (train, held_out) = if options.all_writers {
            (all, Vec::new())
        } else {
            hold_out(all, options.hold_out, seed).map_err(|error| wrong(&error))?
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

    fn fingerprint(&self) -> u64 {
        let all = self.train.iter().chain(&self.held_out).flat_map(|writing| &writing.sequences);
        fingerprint(all.flat_map(|WrittenCharacter { samples, .. }| {
            let numbers = samples.iter().flat_map(|s| [s.t_s, s.x_m, s.y_m, f64::from(u8::from(s.contact))]);
            numbers.map(f64::to_bits).chain([samples.len() as u64])
        }))
    }
}
