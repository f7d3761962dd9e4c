//! The table of predictions as text, JSON and picture.

use std::path::{Path, PathBuf};

use foretrace_failure::Failure;
use foretrace_sim::plot::{Bars, Best, bar_table};
use serde_json::{Value, json};

use super::{ByLead, Row, Scored, Set};

/// What was scored, in one line.
pub fn title(set: &Set) -> String {
    let steps: usize = set.scored.iter().map(|s| s.v.len().saturating_sub(1)).sum();
    let part = if set.split == "all" { String::new() } else { format!(" ({})", set.split) };
    format!("{}{part}: {} sequences, {steps} steps", set.name, set.scored.len())
}

/// The table, then the notes on single rows.
pub fn lines(set: &Set, scored: &Scored) -> Vec<String> {
    let mut lines = Vec::new();
    let wide = width(scored.rows.iter().map(|row| row.model.as_str()));
    lines.push(format!("{}\n", title(set)));
    lines.push(format!(
        "{:<wide$} {:>8} {:>8} {:>8} {:>6} {:>7}  {:<31} {:<31} {:>7} {:>7} {:>8}",
        "model",
        "MSE",
        "within",
        "median",
        "PS-B",
        "PS-LSTM",
        "velocity @1 2 5 10",
        "position @1 2 5 10",
        "mm @10",
        "µs/step",
        "s/epoch"
    ));
    for row in &scored.rows {
        lines.push(format!(
            "{:<wide$} {:>8} {:>8} {:>8} {:>6} {:>7}  {:<31} {:<31} {:>7} {:>7} {:>8}",
            row.model,
            figure(row.mse),
            figure(row.within),
            figure(row.median),
            fixed(row.ps_b, 1),
            fixed(row.ps_lstm, 1),
            by_lead(&row.vel_mse),
            by_lead(&row.pos_mse),
            fixed(row.rms_mm_10, 3),
            fixed(row.us_per_step, 2),
            fixed(row.train_s_per_epoch, 3)
        ));
    }
    lines.push(
        "\nErrors in raw units² per sample, mean over components. PS-B, PS-LSTM: sequences [%] below \
         constant velocity"
            .to_owned(),
    );
    lines.push(
        "and below lstm10-reference. mm: RMS of the 2-D position error after 10 steps, windows without a \
         jump."
            .to_owned(),
    );
    for (model, note) in notes(scored) {
        lines.push(format!("{model}: {note}"));
    }
    lines
}

/// Rows and everything needed to read them.
pub fn json(set: &Set, scored: &Scored) -> Value {
    let notes: serde_json::Map<String, Value> =
        notes(scored).map(|(model, note)| (model.to_owned(), Value::from(note))).collect();
    json!({
        "set": set.name,
        "split": set.split,
        "sequences": set.scored.len(),
        "steps": set.scored.iter().map(|s| s.v.len().saturating_sub(1)).sum::<usize>(),
        "cold": set.cold,
        "rows": scored.rows,
        "notes": notes,
    })
}

/// Notes on single models, including the references.
fn notes(scored: &Scored) -> impl Iterator<Item = (&str, &str)> {
    scored.runs.iter().filter_map(|run| Some((run.model.as_str(), run.note.as_deref()?)))
}

/// The table as bars in `folder`/`name`.
///
/// # Errors
///
/// The folder or the picture cannot be written.
pub fn draw(folder: &Path, name: &str, title: &str, set: &Set, rows: &[Row]) -> Result<PathBuf, Failure> {
    let file = folder.join(name);
    let names: Vec<&str> = rows.iter().map(|row| row.model.as_str()).collect();
    let column = |label, of: fn(&Row) -> Option<f64>, digits, best| Bars {
        label,
        values: rows.iter().map(of).collect(),
        digits,
        best,
    };
    let mut columns = vec![
        column("MSE, raw units²", |r| r.mse, 2, Best::Lowest),
        column("within strokes", |r| r.within, 2, Best::Lowest),
        column("PS-B, %", |r| r.ps_b, 1, Best::Highest),
        column("PS-LSTM, %", |r| r.ps_lstm, 1, Best::Highest),
        column("RMS after 10 steps, mm", |r| r.rms_mm_10, 3, Best::Lowest),
    ];
    columns.retain(|column| column.values.iter().any(Option::is_some));
    std::fs::create_dir_all(folder)
        .map_err(|error| Failure::failed(format_args!("cannot make {}: {error}", folder.display()), ""))?;
    bar_table(&file, title, &self::title(set), &names, &columns)
        .map_err(|error| Failure::failed(error, ""))?;
    Ok(file)
}

/// Width of the column of names.
pub(crate) fn width<'a>(names: impl Iterator<Item = &'a str>) -> usize {
    names.map(|name| name.chars().count()).max().unwrap_or(0).max(20)
}

/// A number with four figures or more, `-` where unknown.
pub(crate) fn figure(value: Option<f64>) -> String {
    match value {
        None => "-".to_owned(),
        Some(v) if !v.is_finite() => "diverged".to_owned(),
        Some(v) if v.abs() >= 1e7 => format!("{v:.2e}"),
        Some(v) if v.abs() >= 1000.0 => format!("{v:.0}"),
        Some(v) if v.abs() >= 10.0 => format!("{v:.3}"),
        Some(v) if v.abs() >= 0.1 || v == 0.0 => format!("{v:.4}"),
        Some(v) => format!("{v:.2e}"),
    }
}

/// A number with fixed digits, `-` where unknown.
pub(crate) fn fixed(value: Option<f64>, digits: usize) -> String {
    value.map_or_else(|| "-".to_owned(), |v| format!("{v:.digits$}"))
}

fn by_lead(values: &ByLead) -> String {
    let short = |v: &Option<f64>| match v {
        Some(v) if v.abs() >= 100.0 && v.abs() < 1e7 => format!("{v:.0}"),
        Some(v) if v.abs() >= 1.0 && v.abs() < 100.0 => format!("{v:.2}"),
        other => figure(*other),
    };
    values.values().map(short).collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use super::{figure, fixed};

    #[test]
    fn numbers_keep_the_figures_that_matter() {
        let shown = [120.0701, 5.2581, 0.014_238, 8968.4, 0.0, 3.2e9, f64::INFINITY].map(|v| figure(Some(v)));
        assert_eq!(shown, ["120.070", "5.2581", "1.42e-2", "8968", "0.0000", "3.20e9", "diverged"]);
        assert_eq!((figure(None), fixed(None, 2)), ("-".to_owned(), "-".to_owned()));
    }
}
