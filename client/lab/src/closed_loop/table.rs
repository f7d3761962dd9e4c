//! The benchmark's table, as lines of text.

use super::{BenchRow, Rival};

/// The table for people.
pub fn table_lines(rows: &[BenchRow]) -> Vec<String> {
    let mut lines = Vec::new();
    let wide = rows.iter().map(|row| row.predictor.chars().count()).max().unwrap_or(0).max(18);
    let optional = |value: Option<f64>, factor: f64, digits: usize| {
        value.map_or_else(|| "-".to_owned(), |value| format!("{:.digits$}", value * factor))
    };
    lines.push(format!(
        "{:<wide$} {:<8} {:>10} {:>8} {:>10} {:>10} {:>10} {:>8} {:>8} {:>9} {:>6} {:>9} {:>7} {:>8}",
        "predictor",
        "arm",
        "mse m²",
        "of hold",
        "median",
        "pen down",
        "leaps",
        "max mm",
        "lag ms",
        "rms jerk",
        "sat %",
        "illegal %",
        "worse %",
        "worst mm"
    ));
    for row in rows {
        let hold = rows.iter().find(|other| other.arm == row.arm && other.predictor == Rival::HOLD.name());
        lines.push(format!(
            "{:<wide$} {:<8} {:>10.3e} {:>8} {:>10.3e} {:>10.3e} {:>10} {:>8.1} {:>8.1} {:>9.1} {:>6.1} {:>9.1} \
             {:>7} {:>8}",
            row.predictor,
            row.arm,
            row.mse_m2,
            optional(hold.map(|hold| row.mse_m2 / hold.mse_m2), 1.0, 3),
            row.median_mse_m2,
            row.pen_down_mse_m2,
            row.leap_mse_m2.map_or_else(|| "-".to_owned(), |mse| format!("{mse:.2e}")),
            row.max_m * 1e3,
            row.lag_ms,
            row.rms_jerk,
            row.saturated_pct,
            row.illegal_pct,
            optional(row.worse_than_hold_pct, 1.0, 2),
            optional(row.worst_beyond_hold_m, 1e3, 2),
        ));
    }
    lines
}
