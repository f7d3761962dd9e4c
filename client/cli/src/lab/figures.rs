//! Figures 2 and 3: run, table, pictures, JSON.

use std::fmt::Display;
use std::path::Path;

use foretrace_control::predict::PredictorKind;
use foretrace_lab::experiments::{
    Fig2, Fig2Arm, Fig2Row, Fig3, LawEntrant, fig2, fig2_entrant, fig2_names, fig3,
};
use foretrace_lab::plot::{Rampup, trust_ramp};
use foretrace_sim::plot::{Cell, letter_grid};
use serde_json::{Map, Value, json};

use super::progress::Progress;
use super::{LabArgs, Session};
use crate::failure::Failure;
use crate::output::{note, say};

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

impl Session {
    pub(super) fn fig2(&self, args: &Fig2Args) -> Result<(), Failure> {
        let entrants = self.entrants(&args.predictors)?;
        let args = &args.lab;
        let progress = Progress::of("lab fig2", 2 * entrants.len());
        let figure = fig2(&self.config, &self.letters, &entrants, || progress.step()).map_err(failed)?;
        drop(progress);
        say!("{}\n", self.title);
        say!(
            "{:<20} {:<6} {:>12} {:>12} {:>10} {:>10} {:>8}",
            "predictor",
            "arm",
            "mse m²",
            "median m²",
            "max mm",
            "median mm",
            "lag ms"
        );
        for row in &figure.rows {
            say!(
                "{:<20} {:<6} {:>12.3e} {:>12.3e} {:>10.2} {:>10.2} {:>8.1}",
                row.name(),
                arm(row.arm),
                row.mse_m2,
                row.median_mse_m2,
                row.max_m * 1e3,
                row.median_max_m * 1e3,
                row.lag_ms
            );
        }
        self.draw_fig2(&figure, &args.out)?;
        args.json.write(&fig2_json(&figure, self.letters.len()))
    }

    pub(super) fn fig3(&self, args: &Fig3Args) -> Result<(), Failure> {
        let kind = PredictorKind::from_name(&args.predictor).ok_or_else(|| {
            let known = PredictorKind::ALL.map(PredictorKind::name).join(", ");
            unknown(&args.predictor, &known, "--predictor")
        })?;
        self.needs_network(kind)?;
        let args = &args.lab;
        let progress = Progress::of("lab fig3", self.letters.len());
        let figure = fig3(&self.config, &self.letters, kind, || progress.step()).map_err(failed)?;
        drop(progress);
        say!("{}\n", self.title);
        say!("predictor                {}", kind.name());
        say!("letters long enough      {}", figure.letters.len());
        say!("jerk in the ramp         {:.3} of the largest outside (median)", figure.max_jerk_ratio);
        say!("step of the error        {:.3} of the largest outside (median)", figure.irregularity);
        say!("ramps unnoticed          {:.0} %", figure.unnoticed * 100.0);
        self.draw_fig3(&figure, kind, &args.out)?;
        args.json.write(&json!({
            "fig3": {
                "predictor": kind.name(),
                "max_jerk_ratio": figure.max_jerk_ratio,
                "irregularity": figure.irregularity,
                "unnoticed": figure.unnoticed,
                "letters": figure.letters.len(),
            }
        }))
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

    fn draw_fig2(&self, figure: &Fig2, out: &Path) -> Result<(), Failure> {
        let Some(letter) = self.letters.get(figure.typical) else { return Ok(()) };
        let drawn: Vec<_> = figure
            .rows
            .iter()
            .zip(&figure.typical_tools)
            .filter(|(_, tool)| !tool.is_empty())
            .map(|(row, tool)| (format!("{}, {}", row.name(), arm(row.arm)), tool))
            .collect();
        let cells: Vec<Cell<'_>> =
            drawn.iter().map(|(label, tool)| Cell { label, pen: &letter.path.samples, tool }).collect();
        let subtitle =
            format!("{}; shown: a typical one ({:?}, writer {})", self.title, letter.label, letter.writer);
        std::fs::create_dir_all(out).map_err(failed)?;
        letter_grid(&out.join("fig2.svg"), "Figure 2: predictors", &subtitle, &cells).map_err(failed)?;
        say!("\npicture  {}", out.join("fig2.svg").display());
        Ok(())
    }

    fn draw_fig3(&self, figure: &Fig3, kind: PredictorKind, out: &Path) -> Result<(), Failure> {
        let mut sorted: Vec<_> = figure.letters.iter().collect();
        sorted.sort_by(|a, b| a.max_jerk_ratio.total_cmp(&b.max_jerk_ratio));
        let Some(letter) = sorted.get(sorted.len() / 2) else { return Ok(()) };
        let data = Rampup {
            trust: &letter.trust,
            error_m: &letter.error_m,
            jerk_mps3: &letter.jerk_mps3,
            ramp: (30.0, 40.0),
        };
        let subtitle = format!("{}; {}; shown: the median one", self.title, kind.name());
        std::fs::create_dir_all(out).map_err(failed)?;
        trust_ramp(&out.join("fig3.svg"), "Figure 3: from feedback to prediction", &subtitle, data)
            .map_err(failed)?;
        say!("\npicture  {}", out.join("fig3.svg").display());
        Ok(())
    }
}

/// `fig2.<predictor>`: the ideal arm; `fig2.<predictor>.ur5`: with the arm's lag.
fn fig2_json(figure: &Fig2, letters: usize) -> Value {
    let mut predictors: Map<String, Value> = Map::new();
    for row in figure.rows.iter().filter(|row| row.arm == Fig2Arm::Ideal) {
        let mut entry = numbers(row);
        let lagging =
            figure.rows.iter().find(|other| other.arm == Fig2Arm::Ur5 && other.entrant == row.entrant);
        if let Some(lagging) = lagging {
            entry["ur5"] = numbers(lagging);
        }
        predictors.insert(row.name().to_owned(), entry);
    }
    json!({ "fig2": predictors, "letters": letters })
}

fn numbers(row: &Fig2Row) -> Value {
    json!({
        "mse_m2": row.mse_m2,
        "max_m": row.max_m,
        "median_mse_m2": row.median_mse_m2,
        "median_max_m": row.median_max_m,
        "lag_ms": row.lag_ms,
    })
}

fn unknown(name: &str, known: &str, option: &str) -> Failure {
    Failure::usage(
        format_args!("no predictor is called {name:?}; there are {known}{}", PredictorKind::renamed(name)),
        format_args!("choose from them ({option})"),
    )
}

fn arm(arm: Fig2Arm) -> &'static str {
    match arm {
        Fig2Arm::Ideal => "ideal",
        Fig2Arm::Ur5 => "ur5",
    }
}

fn failed(error: impl Display) -> Failure {
    Failure::failed(error, "")
}
