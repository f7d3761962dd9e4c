//! The options of `foretrace lab train`, combined with a recipe.

use std::path::{Path, PathBuf};

use foretrace_lab::train::foresight::{self, Context, ForesightTraining, Study, Without, usual_plan};
use foretrace_lab::train::{
    Augment, LstmTraining, Padding, Penalty, Recipe, Schedule, TrainPlan, TrainingOptions, Units,
};
use foretrace_sim::data::Split;

use crate::failure::Failure;
use crate::output::JsonArgs;
use crate::values;

#[derive(Debug, clap::Args)]
// So that a negative number gets the message with the legal range.
#[command(allow_negative_numbers = true)]
pub(crate) struct TrainArgs {
    /// Network to train: lstm10, lstm32 or lstm64, with as many cells; or foresight, the expert of the
    /// mixture that sees contact, direction and time
    #[arg(long, value_name = "NAME", default_value = "lstm10", value_parser = model)]
    pub(super) model: TrainedModel,

    /// Data-set folder; may be given several times
    #[arg(long, value_name = "DIR", required_unless_present = "bench")]
    pub(super) data: Vec<PathBuf>,

    /// Stop at a bad file instead of leaving it out
    #[arg(long)]
    pub(super) strict: bool,

    /// Part of the sets to train on: a word of their split.tsv, or all
    #[arg(long, value_name = "WORD", default_value = "train")]
    pub(super) split: Split,

    /// Safetensors file to write; the loss curve stands beside it as .svg
    #[arg(long, value_name = "FILE", required_unless_present = "bench")]
    pub(super) out: Option<PathBuf>,

    /// Recipe that sets the defaults: paper (MSE, padding counted, Adam 1e-3), robust (inputs cut, residual
    /// output, Huber loss, one-cycle Adam) or mixture (what the predictor `mixture` reads: 24 leads,
    /// normalised, changed copies; for lstm64) [default: paper for lstm10, else robust]
    #[arg(long, value_name = "NAME", value_parser = recipe)]
    pub(super) recipe: Option<Recipe>,

    /// Passes over the train sequences [default: 40; robust: 60, 40 or 30 by size; foresight: 40]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100_000))]
    pub(super) epochs: Option<u32>,

    /// Sequences per step of Adam, with foresight grid steps [default: 16; robust: 32; foresight: 256]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=65_536))]
    pub(super) batch: Option<u32>,

    /// Learning rate, with one-cycle its peak [default: 1e-3; robust: 1e-2; foresight: 6e-3]
    #[arg(long, value_name = "RATE", value_parser = values::number(1e-8..=1.0, "1e-8 to 1"))]
    pub(super) rate: Option<f64>,

    /// Seed of the initial weights, order, held-out writers and augmentation
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub(super) seed: u64,

    /// Threads; the result is the same with any number [default: the machine's]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=256))]
    pub(super) threads: Option<u32>,

    /// Step to train at [ms]: whole multiples of the device's step use every phase of its samples [default:
    /// its own; foresight: 10]
    #[arg(long, value_name = "MS", value_parser = crate::values::positive)]
    pub(super) step_ms: Option<f64>,

    /// raw: the device's units over their RMS; normalised: over the loop's running speed scale, for any
    /// device [default: raw; mixture: normalised]
    #[arg(long, value_name = "raw|normalised", value_parser = units)]
    pub(super) units: Option<Units>,

    /// Steps predicted directly; 1 is rolled out by feeding predictions back [default: 1; mixture: 24]
    #[arg(long, value_name = "K", value_parser = clap::value_parser!(u32).range(1..=64))]
    pub(super) leads: Option<u32>,

    /// Clip inputs to this many RMS per component, or none
    #[arg(long, value_name = "RMS|none", value_parser = positive_or_none)]
    pub(super) clip: Option<Maybe>,

    /// Add the output to the newest input (residual)
    #[arg(long, value_name = "true|false", action = clap::ArgAction::Set)]
    pub(super) residual: Option<bool>,

    /// Use the Huber loss with its corner at this many RMS, or none for squared errors
    #[arg(long, value_name = "RMS|none", value_parser = positive_or_none)]
    pub(super) huber: Option<Maybe>,

    /// Treat the zeros that pad a batch: counted in the loss, or masked
    #[arg(long, value_name = "counted|masked", value_parser = padding)]
    pub(super) padding: Option<Padding>,

    /// Exclude steps between strokes and steps longer than this many RMS from the targets, with all leads
    /// beyond them
    #[arg(long, value_name = "RMS", value_parser = crate::values::positive)]
    pub(super) gate: Option<f64>,

    /// Reset the state before inputs longer than this many RMS
    #[arg(long, value_name = "RMS", value_parser = crate::values::positive)]
    pub(super) reset_at_jump: Option<f64>,

    /// Clip the gradient's norm to this
    #[arg(long, value_name = "NORM", value_parser = crate::values::positive)]
    pub(super) limit_norm: Option<f64>,

    /// Augment the sequences in each epoch: scale=0.5..2, time=0.7..1.4, decimate=0.5, smooth=0.2, rotate=10,
    /// shear=0.1, noise=0.02, grid=0.2, comma-separated [default: none; mixture:
    /// scale=0.7..1.4,time=0.8..1.25,rotate=10,shear=0.15]
    #[arg(long, value_name = "LIST")]
    pub(super) augment: Option<Augment>,

    /// Leave inputs of foresight out: contact, direction, time, comma-separated
    #[arg(long, value_name = "LIST", value_parser = without)]
    pub(super) without: Option<Without>,

    /// Share of the writers held out to choose the best epoch
    #[arg(long, value_name = "SHARE", default_value_t = 0.15, value_parser = values::number(0.01..=0.9, "0.01 to 0.9"))]
    pub(super) hold_out: f64,

    /// Stop after this many epochs without a better held-out loss [default: 10; never with one-cycle]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub(super) patience: Option<u32>,

    /// Train on all writers for all epochs, with none held out
    #[arg(long = "final", conflicts_with = "patience")]
    pub(super) all_writers: bool,

    /// Continue an interrupted training with the same options and data
    #[arg(long)]
    pub(super) resume: bool,

    /// How to cite the data, for the model's metadata [default: known for the published sets]
    #[arg(long, value_name = "TEXT")]
    pub(super) citation: Option<String>,

    /// Only measure the time per step of the paper's recipe on one thread, on --data or on synthetic strokes
    #[arg(long, conflicts_with_all = ["out", "resume"])]
    pub(super) bench: bool,

    /// With --bench: write everything that another implementation needs to repeat the work
    #[arg(long, value_name = "FILE", requires = "bench")]
    pub(super) exchange: Option<PathBuf>,

    #[command(flatten)]
    pub(super) json: JsonArgs,
}

/// The networks that can be trained.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum TrainedModel {
    /// With as many cells.
    Lstm(usize),
    /// The expert that sees contact, direction and time.
    Foresight,
}

/// A number or `none`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Maybe(Option<f64>);

impl TrainArgs {
    /// Cells of the LSTM.
    pub(super) fn cells(&self) -> usize {
        match self.model {
            TrainedModel::Lstm(cells) => cells,
            TrainedModel::Foresight => 0,
        }
    }

    /// No option is given that only `foresight` has.
    fn only_of_lstm(&self) -> Result<(), Failure> {
        match self.without {
            Some(_) => Err(Failure::usage("--without is an option of foresight", "give --model foresight")),
            None => Ok(()),
        }
    }

    /// No option is given that only the LSTMs have.
    fn only_of_foresight(&self) -> Result<(), Failure> {
        let given = [
            ("--recipe", self.recipe.is_some()),
            ("--units", self.units.is_some()),
            ("--leads", self.leads.is_some()),
            ("--clip", self.clip.is_some()),
            ("--residual", self.residual.is_some()),
            ("--huber", self.huber.is_some()),
            ("--padding", self.padding.is_some()),
            ("--gate", self.gate.is_some()),
            ("--reset-at-jump", self.reset_at_jump.is_some()),
            ("--limit-norm", self.limit_norm.is_some()),
            ("--augment", self.augment.is_some()),
            ("--patience", self.patience.is_some()),
        ];
        let given: Vec<_> = given.iter().filter(|(_, is)| *is).map(|(name, _)| *name).collect();
        if given.is_empty() {
            return Ok(());
        }
        let what = format!("foresight has no {}", given.join(", "));
        Err(Failure::usage(what, "leave it out, or give --model lstm10, lstm32 or lstm64"))
    }

    fn training(&self, out: &Path) -> TrainingOptions {
        TrainingOptions {
            data: self.data.clone(),
            split: self.split.clone(),
            strict: self.strict,
            hold_out: self.hold_out,
            all_writers: self.all_writers,
            citation: self.citation.clone(),
            threads: threads(self.threads),
            resume: self.resume,
            out: out.to_owned(),
        }
    }

    /// The training of `foresight`.
    pub(super) fn foresight(&self, out: &Path) -> Result<ForesightTraining, Failure> {
        self.only_of_foresight()?;
        let step_ms = self.step_ms.unwrap_or(foresight::STEP_MS);
        if !(4.0..=20.0).contains(&step_ms) {
            let what = format!("a step of {step_ms} ms is outside of what the network's history covers");
            return Err(Failure::usage(what, "give --step-ms from 4 to 20"));
        }
        let usual = usual_plan(self.epochs.map_or(foresight::EPOCHS, |n| n as usize), self.seed);
        let (peak, warm_up) = (self.rate.unwrap_or(foresight::RATE), foresight::WARM_UP);
        let plan = foresight::ForesightPlan {
            schedule: Schedule::OneCycle { peak, warm_up },
            batch: self.batch.map_or(usual.batch, |n| n as usize),
            step_ns: (step_ms * 1e6).round() as u64,
            study: Study { without: self.without.unwrap_or_default(), context: Context::Short },
            ..usual
        };
        Ok(ForesightTraining { options: self.training(out), plan })
    }

    /// The training of an LSTM: recipe and options put together.
    pub(super) fn lstm(&self, out: &Path) -> Result<LstmTraining, Failure> {
        self.only_of_lstm()?;
        let recipe = self.recipe();
        let leads = self.leads.map_or(recipe.leads(), |k| k as usize);
        let augment = self.augment.unwrap_or(recipe.augment());
        let mut network = recipe.network(self.cells(), leads);
        if let Some(Maybe(clip)) = self.clip {
            network.clip = clip;
        }
        network.residual = self.residual.unwrap_or(network.residual);
        network.reset_beyond = self.reset_at_jump.or(network.reset_beyond);
        let mut objective = recipe.objective(leads);
        if let Some(Maybe(delta)) = self.huber {
            objective.penalty = delta.map_or(Penalty::Squared, |delta| Penalty::Huber { delta });
        }
        objective.padding = self.padding.unwrap_or(objective.padding);
        objective.gate = self.gate.or(objective.gate);
        if objective.padding == Padding::Counted && !augment.is_off() {
            return Err(Failure::usage(
                "--augment changes the lengths of sequences, and the padding that is counted with them",
                "give --padding masked as well",
            ));
        }
        let schedule = recipe.schedule(self.rate);
        let patient = matches!(schedule, Schedule::Constant { .. }).then_some(10);
        let plan = TrainPlan {
            schedule,
            epochs: self.epochs.map_or(recipe.epochs(self.cells()), |n| n as usize),
            batch: self.batch.map_or(recipe.batch(), |n| n as usize),
            seed: self.seed,
            limit_norm: self.limit_norm.or(recipe.limit_norm()),
            augment,
            keep_speed: self.units() == Units::Normalised,
            patience: self.patience.map(|n| n as usize).or(patient).filter(|_| !self.all_writers),
        };
        let (options, cells, units) = (self.training(out), self.cells(), self.units());
        let step_ms = self.step_ms;
        Ok(LstmTraining { options, cells, recipe, network, objective, plan, units, step_ms })
    }

    fn recipe(&self) -> Recipe {
        let usual = if self.cells() == 10 { Recipe::Paper } else { Recipe::Robust };
        self.recipe.unwrap_or(usual)
    }

    fn units(&self) -> Units {
        self.units.unwrap_or(self.recipe().units())
    }
}

/// As asked for, else the machine's.
pub(in crate::lab) fn threads(asked: Option<u32>) -> usize {
    let machine = || std::thread::available_parallelism().map_or(1, usize::from);
    asked.map_or_else(machine, |n| n as usize)
}

fn model(text: &str) -> Result<TrainedModel, String> {
    match text {
        "lstm10" => Ok(TrainedModel::Lstm(10)),
        "lstm32" => Ok(TrainedModel::Lstm(32)),
        "lstm64" => Ok(TrainedModel::Lstm(64)),
        "foresight" => Ok(TrainedModel::Foresight),
        _ if text.starts_with("dybm") => Err(
            "lstm10, lstm32, lstm64 or foresight; DyBM models learn online and are trained inside lab table1"
                .to_owned(),
        ),
        _ => Err("lstm10, lstm32, lstm64 or foresight".to_owned()),
    }
}

fn recipe(text: &str) -> Result<Recipe, String> {
    Recipe::ALL.into_iter().find(|r| r.name() == text).ok_or_else(|| "paper, robust or mixture".to_owned())
}

fn units(text: &str) -> Result<Units, String> {
    values::word([("raw", Units::Raw), ("normalised", Units::Normalised)], "raw or normalised")(text)
}

fn padding(text: &str) -> Result<Padding, String> {
    values::word([("counted", Padding::Counted), ("masked", Padding::Masked)], "counted or masked")(text)
}

fn positive_or_none(text: &str) -> Result<Maybe, String> {
    if text == "none" {
        return Ok(Maybe(None));
    }
    crate::values::positive(text).map(|x| Maybe(Some(x))).map_err(|legal| format!("{legal}, or none"))
}

/// What an ablation leaves out: `contact`, `direction`, `time`, comma-separated.
fn without(text: &str) -> Result<Without, String> {
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
