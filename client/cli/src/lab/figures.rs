//! Figures 2 and 3: run, table, pictures, JSON.

use std::fmt::Display;
use std::path::PathBuf;

use foretrace_control::predict::{Needs, PredictorKind};
use foretrace_lab::experiments::{LawEntrant, fig2, fig2_entrant, fig2_json, fig2_names, fig3};
use serde_json::json;

use super::lab_run::SettingsSums;
use super::progress::StepProgress;
use super::{Experiment, LabArgs, say_picture};
use crate::failure::Failure;
use crate::output::{note, say, say_lines};

#[derive(Debug, clap::Args)]
pub(crate) struct Fig2Args {
    #[command(flatten)]
    pub(super) lab: LabArgs,

    /// Predictors, comma-separated: hold (trust 0), mixture (automatic trust); all others with trust 1
    /// [default: all]
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    predictors: Vec<String>,
}

#[derive(Debug, clap::Args)]
pub(crate) struct Fig3Args {
    #[command(flatten)]
    pub(super) lab: LabArgs,

    /// Predictor that the ramp of trust switches to
    #[arg(long, value_name = "NAME", default_value = PredictorKind::MIXTURE.name())]
    predictor: String,
}

impl Experiment {
    pub(super) fn fig2(&self, args: &Fig2Args) -> Result<(), Failure> {
        let entrants = self.entrants(&args.predictors)?;
        let args = &args.lab;
        let progress = StepProgress::of("lab fig2", 2 * entrants.len());
        let figure = fig2(&self.config, &self.letters, &entrants, || progress.step()).map_err(failed)?;
        drop(progress);
        say!("{}\n", self.title);
        say_lines(figure.lines());
        let out = self.run.keep(&args.json, &fig2_json(&figure, self.letters.len()))?;
        say_drawn(figure.draw(&out, &self.letters, &self.title)?);
        self.run.finish(SettingsSums::of(&self.config))
    }

    pub(super) fn fig3(&self, args: &Fig3Args) -> Result<(), Failure> {
        // What another process predicts is nothing that this one can draw.
        let own = || PredictorKind::ALL.into_iter().filter(|kind| kind.needs() != Needs::Process);
        let kind = own().find(|kind| kind.name() == args.predictor).ok_or_else(|| {
            let known = own().map(PredictorKind::name).collect::<Vec<_>>().join(", ");
            unknown(&args.predictor, &known, "--predictor")
        })?;
        self.needs_network(kind)?;
        let args = &args.lab;
        let progress = StepProgress::of("lab fig3", self.letters.len());
        let figure = fig3(&self.config, &self.letters, kind, || progress.step()).map_err(failed)?;
        drop(progress);
        say!("{}\n", self.title);
        say!("predictor                {}", kind.name());
        say!("letters long enough      {}", figure.letters.len());
        say!("jerk in the ramp         {:.3} of the largest outside (median)", figure.max_jerk_ratio);
        say!("step of the error        {:.3} of the largest outside (median)", figure.irregularity);
        say!("ramps unnoticed          {:.0} %", figure.unnoticed * 100.0);
        let result = json!({
            "fig3": {
                "predictor": kind.name(),
                "max_jerk_ratio": figure.max_jerk_ratio,
                "irregularity": figure.irregularity,
                "unnoticed": figure.unnoticed,
                "letters": figure.letters.len(),
            }
        });
        say_drawn(figure.draw(&self.run.keep(&args.json, &result)?, kind, &self.title)?);
        self.run.finish(SettingsSums::of(&self.config))
    }

    /// The named ones; without names, all that the settings have a network for.
    fn entrants(&self, names: &[String]) -> Result<Vec<LawEntrant>, Failure> {
        let has = |entrant: &LawEntrant| self.config.models().has(entrant.predictor());
        if names.is_empty() {
            if !has(&LawEntrant::Believed(PredictorKind::LSTM)) {
                note!("lab: no network for lstm at this pen.step_ms (predictor.lstm): left out");
            }
            return Ok(LawEntrant::all().filter(has).collect());
        }
        let mut entrants: Vec<LawEntrant> = Vec::new();
        for name in names {
            let entrant = fig2_entrant(name.trim())
                .ok_or_else(|| unknown(name.trim(), &fig2_names(), "--predictors"))?;
            self.needs_network(entrant.predictor())?;
            if !entrants.contains(&entrant) {
                entrants.push(entrant);
            }
        }
        Ok(entrants)
    }

    fn needs_network(&self, kind: PredictorKind) -> Result<(), Failure> {
        if self.config.models().has(kind) {
            return Ok(());
        }
        Err(Failure::bad_input(
            format_args!(
                "{} has no network for pen.step_ms = {}",
                kind.name(),
                self.config.settings().pen.step_ms
            ),
            "name one that was trained for this step (--set predictor.lstm=FILE.safetensors), or another \
             predictor",
        ))
    }
}

fn say_drawn(file: Option<PathBuf>) {
    if let Some(file) = file {
        say!("");
        say_picture(&file);
    }
}

fn unknown(name: &str, known: &str, option: &str) -> Failure {
    Failure::usage(
        format_args!("no predictor is called {name:?}; there are {known}{}", PredictorKind::renamed(name)),
        format_args!("choose from them ({option})"),
    )
}

fn failed(error: impl Display) -> Failure {
    Failure::failed(error, "")
}
