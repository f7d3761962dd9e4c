//! The table symbol by symbol: do curvy ones favour the LSTM.

use std::path::{Path, PathBuf};

use foretrace_failure::Failure;
use foretrace_sim::plot::{Named, scatter};

use super::{Correlation, LabelRow, MIN_SEQUENCES, Scored, Set, by_label, correlations, gains, table};

/// The model that the paper says gains on curvy symbols, and what stands in where it was not chosen.
const FAVOURED: [&str; 3] = ["lstm10", "lstm10-reference", "lstm32"];
/// Symbols shown at either end.
const ENDS: usize = 12;

/// The analysis by symbol.
pub struct SymbolAnalysis {
    pub rows: Vec<LabelRow>,
    pub correlations: Vec<Correlation>,
    /// The model whose gain is analysed, and the one it is compared with in the picture.
    pair: Option<(String, String)>,
}

impl SymbolAnalysis {
    pub fn of(set: &Set, scored: &Scored) -> Self {
        let rows = by_label(&set.scored, &scored.runs);
        let has = |name: &&str| scored.runs.iter().any(|run| run.model == *name);
        let favoured = FAVOURED.into_iter().find(has);
        let against = ["dybm", "dybm-offline", "constant-velocity"].into_iter().find(has);
        let correlations = favoured.map(|name| correlations(&rows, name)).unwrap_or_default();
        let pair = favoured.zip(against).map(|(a, b)| (a.to_owned(), b.to_owned()));
        Self { rows, correlations, pair }
    }

    /// The analysis for people.
    pub fn lines(&self) -> Vec<String> {
        let mut lines = Vec::new();
        lines.push(
            "\nBy symbol, most curvy first: smooth turning per glyph height [rad], MSE within strokes"
                .to_owned(),
        );
        let models: Vec<&String> =
            self.rows.first().map(|row| row.within.keys().collect()).unwrap_or_default();
        let heads: String = models.iter().map(|name| format!(" {:>18}", shortened(name))).collect();
        lines.push(format!("{:<8} {:>5} {:>9}{heads}", "symbol", "count", "curviness"));
        let counted: Vec<&LabelRow> = self.rows.iter().filter(|row| row.sequences >= MIN_SEQUENCES).collect();
        for (index, row) in counted.iter().enumerate() {
            if index == ENDS && counted.len() > 2 * ENDS {
                lines.push(format!("...      ({} more in the JSON)", self.rows.len() - 2 * ENDS));
            }
            if index >= ENDS && index + ENDS < counted.len() {
                continue;
            }
            let cells: String = row.within.values().map(|v| format!(" {:>18}", table::figure(*v))).collect();
            lines.push(format!(
                "{:<8} {:>5} {:>9}{cells}",
                row.label,
                row.sequences,
                table::fixed(row.curviness, 2)
            ));
        }
        for correlation in &self.correlations {
            let Correlation { favoured, against, spearman, labels } = correlation;
            lines.push(format!(
                "gain of {favoured} over {against}: rank correlation with curviness {} ({labels} symbols)",
                table::fixed(*spearman, 2)
            ));
        }
        lines
    }

    /// The gains as a picture in `folder`; none where there is no pair to compare, or nothing to show.
    ///
    /// # Errors
    ///
    /// The picture cannot be written.
    pub fn draw(&self, folder: &Path, set: &Set) -> Result<Option<PathBuf>, Failure> {
        let Some((favoured, against)) = &self.pair else { return Ok(None) };
        let points: Vec<Named<'_>> = gains(&self.rows, favoured, against)
            .filter(|(row, _)| row.sequences >= MIN_SEQUENCES)
            .filter_map(|(row, gain)| Some(Named { name: &row.label, point: (row.curviness?, gain) }))
            .collect();
        if points.is_empty() {
            return Ok(None);
        }
        let file = folder.join("table1-by-label.svg");
        let labels = (
            "curviness: smooth turning per glyph height [rad]",
            &*format!("ln(error of {against} / error of {favoured})"),
        );
        let title = format!("Above zero {favoured} wins, below {against}");
        scatter(&file, &title, &table::title(set), labels, &points)
            .map_err(|error| Failure::failed(error, ""))?;
        Ok(Some(file))
    }
}

fn shortened(name: &str) -> String {
    name.chars().take(18).collect()
}
