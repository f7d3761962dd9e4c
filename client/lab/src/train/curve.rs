//! The loss curve of a training as a picture.

use std::path::Path;

use foretrace_sim::plot::{ChartPanel, Line, Mark, PlotError, panels};

use super::fit::Epoch;

/// Draws loss and held-out errors over the epochs.
///
/// # Errors
/// [`PlotError`]: no epoch yet, or the file cannot be written.
pub fn curve(file: &Path, title: &str, subtitle: &str, history: &[Epoch]) -> Result<(), PlotError> {
    let over_epochs = |value: &dyn Fn(&Epoch) -> Option<f64>| -> Vec<(f64, f64)> {
        history.iter().enumerate().filter_map(|(i, e)| value(e).map(|y| ((i + 1) as f64, y))).collect()
    };
    let train = over_epochs(&|e| Some(e.train_loss));
    let held_out = over_epochs(&|e| e.held_out.map(|s| s.loss));
    let within = over_epochs(&|e| e.held_out.map(|s| s.within));
    let mark = if history.len() > 1 { Mark::Solid } else { Mark::Dots };
    let line = |label, points| Line { label, points, mark };
    let losses = [line("train", &train), line("held-out writers", &held_out)];
    let errors = [line("held-out writers", &within)];
    let shown = if held_out.is_empty() { &losses[..1] } else { &losses[..] };
    let mut charts = vec![ChartPanel { y_label: "loss", y_range: None, lines: shown }];
    if !within.is_empty() {
        charts.push(ChartPanel { y_label: "within-stroke MSE", y_range: None, lines: &errors });
    }
    panels(file, title, subtitle, "epoch", &charts, None)
}
