//! Figures 2 and 3 as text, JSON and pictures.

use std::fmt::Display;
use std::path::{Path, PathBuf};

use foretrace_control::predict::PredictorKind;
use foretrace_failure::Failure;
use foretrace_sim::plot::{Cell, letter_grid};
use serde_json::{Map, Value, json};

use super::{Fig2, Fig2Arm, Fig2Row, Fig3, Letter};
use crate::plot::{Rampup, trust_ramp};

impl Fig2 {
    /// The table for people.
    pub fn lines(&self) -> Vec<String> {
        let mut lines = vec![format!(
            "{:<20} {:<6} {:>12} {:>12} {:>10} {:>10} {:>8}",
            "predictor", "arm", "mse m²", "median m²", "max mm", "median mm", "lag ms"
        )];
        lines.extend(self.rows.iter().map(|row| {
            format!(
                "{:<20} {:<6} {:>12.3e} {:>12.3e} {:>10.2} {:>10.2} {:>8.1}",
                row.name(),
                row.arm.name(),
                row.mse_m2,
                row.median_mse_m2,
                row.max_m * 1e3,
                row.median_max_m * 1e3,
                row.lag_ms
            )
        }));
        lines
    }

    /// A typical one of `letters`, as every predictor writes it, as a picture in the folder `out`; none where
    /// it is not one of them.
    ///
    /// # Errors
    ///
    /// The folder or the picture cannot be written.
    pub fn draw(&self, out: &Path, letters: &[Letter], title: &str) -> Result<Option<PathBuf>, Failure> {
        let figure = self;
        let Some(letter) = letters.get(figure.typical) else { return Ok(None) };
        let drawn: Vec<_> = figure
            .rows
            .iter()
            .zip(&figure.typical_tools)
            .filter(|(_, tool)| !tool.is_empty())
            .map(|(row, tool)| (format!("{}, {}", row.name(), row.arm.name()), tool))
            .collect();
        let cells: Vec<Cell<'_>> =
            drawn.iter().map(|(label, tool)| Cell { label, pen: &letter.path.samples, tool }).collect();
        let subtitle =
            format!("{}; shown: a typical one ({:?}, writer {})", title, letter.label, letter.writer);
        std::fs::create_dir_all(out).map_err(failed)?;
        let file = out.join("fig2.svg");
        letter_grid(&file, "Figure 2: predictors", &subtitle, &cells).map_err(failed)?;
        Ok(Some(file))
    }
}

impl Fig3 {
    /// The median letter as a picture in the folder `out`; none without letters.
    ///
    /// # Errors
    ///
    /// The folder or the picture cannot be written.
    pub fn draw(&self, out: &Path, kind: PredictorKind, title: &str) -> Result<Option<PathBuf>, Failure> {
        let figure = self;
        let mut sorted: Vec<_> = figure.letters.iter().collect();
        sorted.sort_by(|a, b| a.max_jerk_ratio.total_cmp(&b.max_jerk_ratio));
        let Some(letter) = sorted.get(sorted.len() / 2) else { return Ok(None) };
        let data = Rampup {
            trust: &letter.trust,
            error_m: &letter.error_m,
            jerk_mps3: &letter.jerk_mps3,
            ramp: (30.0, 40.0),
        };
        let subtitle = format!("{}; {}; shown: the median one", title, kind.name());
        std::fs::create_dir_all(out).map_err(failed)?;
        let file = out.join("fig3.svg");
        trust_ramp(&file, "Figure 3: from feedback to prediction", &subtitle, data).map_err(failed)?;
        Ok(Some(file))
    }
}

/// `fig2.<predictor>`: the ideal arm; `fig2.<predictor>.ur5`: with the arm's lag.
pub fn fig2_json(figure: &Fig2, letters: usize) -> Value {
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

fn failed(error: impl Display) -> Failure {
    Failure::failed(error, "")
}
