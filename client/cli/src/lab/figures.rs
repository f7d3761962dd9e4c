//! Figures 2 and 3: run, table, pictures, JSON.

use std::fmt::Display;
use std::path::Path;

use foretrace_lab::experiments::{Fig2, Fig2Arm, Fig2Row, Fig3, PREDICTORS, fig2, fig3};
use foretrace_lab::plot::{Cell, Rampup, letter_grid, trust_ramp};
use serde_json::{Map, Value, json};

use super::{LabArgs, Progress, Session};
use crate::failure::Failure;
use crate::output::say;

/// Predictors times arms: the rows that finish one by one.
const FIG2_ROWS: usize = 2 * PREDICTORS.len();

impl Session {
    pub(super) fn fig2(&self, args: &LabArgs) -> Result<(), Failure> {
        let progress = Progress::of(FIG2_ROWS);
        let figure = fig2(&self.config, &self.letters, || progress.step()).map_err(failed)?;
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
                row.predictor.name(),
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

    pub(super) fn fig3(&self, args: &LabArgs) -> Result<(), Failure> {
        let progress = Progress::of(self.letters.len());
        let figure = fig3(&self.config, &self.letters, || progress.step()).map_err(failed)?;
        drop(progress);
        say!("{}\n", self.title);
        say!("letters long enough      {}", figure.letters.len());
        say!("jerk in the ramp         {:.3} of the largest outside (median)", figure.max_jerk_ratio);
        say!("step of the error        {:.3} of the largest outside (median)", figure.irregularity);
        say!("ramps unnoticed          {:.0} %", figure.unnoticed * 100.0);
        self.draw_fig3(&figure, &args.out)?;
        args.json.write(&json!({
            "fig3": {
                "max_jerk_ratio": figure.max_jerk_ratio,
                "irregularity": figure.irregularity,
                "unnoticed": figure.unnoticed,
                "letters": figure.letters.len(),
            }
        }))
    }

    fn draw_fig2(&self, figure: &Fig2, out: &Path) -> Result<(), Failure> {
        let Some(letter) = self.letters.get(figure.typical) else { return Ok(()) };
        let labels: Vec<String> =
            figure.rows.iter().map(|row| format!("{}, {}", row.predictor.name(), arm(row.arm))).collect();
        let cells: Vec<Cell<'_>> = labels
            .iter()
            .zip(&figure.typical_runs)
            .map(|(label, run)| Cell { label, pen: &letter.path.samples, tool: &run.tool })
            .collect();
        let subtitle =
            format!("{}; shown: a typical one ({:?}, writer {})", self.title, letter.label, letter.writer);
        std::fs::create_dir_all(out).map_err(failed)?;
        letter_grid(&out.join("fig2.svg"), "Figure 2: who predicts", &subtitle, &cells).map_err(failed)?;
        say!("\npicture  {}", out.join("fig2.svg").display());
        Ok(())
    }

    fn draw_fig3(&self, figure: &Fig3, out: &Path) -> Result<(), Failure> {
        let mut sorted: Vec<_> = figure.letters.iter().collect();
        sorted.sort_by(|a, b| a.max_jerk_ratio.total_cmp(&b.max_jerk_ratio));
        let Some(letter) = sorted.get(sorted.len() / 2) else { return Ok(()) };
        let data = Rampup {
            trust: &letter.trust,
            error_m: &letter.error_m,
            jerk_mps3: &letter.jerk_mps3,
            ramp: (30.0, 40.0),
        };
        let subtitle = format!("{}; shown: the median one", self.title);
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
            figure.rows.iter().find(|other| other.arm == Fig2Arm::Ur5 && other.predictor == row.predictor);
        if let Some(lagging) = lagging {
            entry["ur5"] = numbers(lagging);
        }
        predictors.insert(row.predictor.name().to_owned(), entry);
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

fn arm(arm: Fig2Arm) -> &'static str {
    match arm {
        Fig2Arm::Ideal => "ideal",
        Fig2Arm::Ur5 => "ur5",
    }
}

fn failed(error: impl Display) -> Failure {
    Failure::failed(error, "")
}
