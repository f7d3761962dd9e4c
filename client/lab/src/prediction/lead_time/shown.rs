//! Boards and standings as text, and as a picture.

use std::path::{Path, PathBuf};

use foretrace_failure::Failure;
use foretrace_sim::plot::{ChartPanel, Line, Mark, panels};

use super::{Board, LeadRow, Standing};
use crate::prediction::table;

/// Look-ahead times in the text \[ms\].
const SHOWN_MS: [u32; 5] = [10, 20, 50, 100, 200];

impl Board {
    fn title(&self) -> String {
        let board = self;
        let rates: Vec<String> = board.rates_hz.iter().map(f64::to_string).collect();
        let assumed = if board.rate_assumed { ", assumed" } else { "" };
        format!(
            "{} ({}), {} Hz{assumed}, {} instants",
            board.set,
            board.split,
            rates.join("/"),
            board.instants
        )
    }

    /// The side effects of every model, and the interval of its error.
    fn side_effect_lines(&self, wide: usize) -> Vec<String> {
        let unit = if self.unit == "mm" { "mm" } else { "raw units" };
        let writers = match self.writers {
            1 => "one writer: no interval".to_owned(),
            count => format!("RMS over {count} writers, 95 %"),
        };
        let mut lines = vec![format!(
            "\nSide effects at 100 ms, mean and 95th percentile [{unit}; direction in degrees]; {writers}\n"
        )];
        let heads = ["late", "ahead", "direction", "jitter", "error"];
        let heads: String = heads.iter().map(|head| format!(" {head:>9} {:>9}", "95 %")).collect();
        lines.push(format!("{:<wide$}{heads}   RMS", "model"));
        for lane in &self.models {
            let Some(row) = lane.leads.iter().find(|row| row.lead_ms == 100) else { continue };
            let cells = [row.lateness, row.over_anticipation, row.wrong_direction_deg, row.jitter, row.error];
            let cells = cells
                .iter()
                .map(|spread| format!(" {:>9} {:>9}", table::figure(spread.mean), table::figure(spread.p95)));
            let cells: String = cells.collect();
            let rms = table::figure(row.rms);
            let ends = row.rms_interval.map_or_else(String::new, |[low, high]| {
                format!(" ({} to {})", table::figure(Some(low)), table::figure(Some(high)))
            });
            lines.push(format!("{:<wide$}{cells}   {rms}{ends}", lane.model));
        }
        lines
    }

    /// The board for people.
    pub fn lines(&self) -> Vec<String> {
        let (board, mut lines) = (self, Vec::new());
        let unit = if board.unit == "mm" { "mm" } else { "raw units" };
        lines.push(board.title());
        lines.push(format!(
        "RMS of the 2-D position error [{unit}]; at 100 ms also along and across the motion, the mean lag, \
         and the bands\n"
    ));
        let wide = table::width(board.models.iter().map(|lane| lane.model.as_str()));
        let heads: String = SHOWN_MS.iter().map(|ms| format!(" {:>9}", format!("{ms} ms"))).collect();
        lines.push(format!(
            "{:<wide$}{heads}   {:>8} {:>8} {:>8} {:>6} {:>6} {:>8}",
            "model", "along", "cross", "mean", "in 50%", "in 90%", "radius"
        ));
        for lane in &board.models {
            let at = |ms: u32| lane.leads.iter().find(|row| row.lead_ms == ms);
            let cells: String = SHOWN_MS
                .iter()
                .map(|ms| format!(" {:>9}", table::figure(at(*ms).and_then(|row| row.rms))))
                .collect();
            let of = |field: fn(&LeadRow) -> Option<f64>| at(100).and_then(field);
            lines.push(format!(
                "{:<wide$}{cells}   {:>8} {:>8} {:>8} {:>6} {:>6} {:>8}",
                lane.model,
                table::figure(of(|r| r.along_rms)),
                table::figure(of(|r| r.cross_rms)),
                table::figure(of(|r| r.along_mean)),
                table::fixed(of(|r| r.coverage_50), 1),
                table::fixed(of(|r| r.coverage_90), 1),
                table::figure(of(|r| r.radius_90))
            ));
        }
        lines.extend(board.side_effect_lines(wide));
        for lane in &board.models {
            if let Some(text) = &lane.note {
                lines.push(format!("{}: {text}", lane.model));
            }
        }
        lines.push("".to_owned());
        lines
    }
}

/// An interval behind a figure, nothing without one.
fn between(interval: Option<[f64; 2]>, digits: usize) -> String {
    let ends = |[low, high]: [f64; 2]| format!("  ({low:.digits$} to {high:.digits$})");
    interval.map_or_else(String::new, ends)
}

/// The standings over so many sets for people.
pub fn standing_lines(standings: &[Standing], sets: usize) -> Vec<String> {
    let mut lines = Vec::new();
    let intervals = standings.iter().any(|standing| standing.rms_over_zero_interval.is_some());
    let over_writers = if intervals { ", 95 % over writers" } else { "" };
    lines.push(format!(
        "Over all sets and look-ahead times: RMS over that of a pen that stands still, geometric \
         mean{over_writers}"
    ));
    let wide = table::width(standings.iter().map(|s| s.model.as_str()));
    for (index, standing) in standings.iter().enumerate() {
        let some = if standing.sets < sets {
            format!("  ({} of {sets} sets)", standing.sets)
        } else {
            String::new()
        };
        lines.push(format!(
            "{:>3}  {:<wide$} {:>7}{}{some}",
            index + 1,
            standing.model,
            table::fixed(standing.rms_over_zero, 4),
            between(standing.rms_over_zero_interval, 4),
        ));
    }
    lines
}

/// A model's name and its (look-ahead time, error).
type Drawn<'a> = (&'a str, Vec<(f64, f64)>);

/// One panel per set, one line per model, as a picture in the folder `out`.
///
/// # Errors
///
/// The folder or the picture cannot be written.
pub fn draw(out: &Path, boards: &[Board]) -> Result<PathBuf, Failure> {
    let file = out.join("leadtime.svg");
    let drawn: Vec<Vec<Drawn<'_>>> = boards
        .iter()
        .map(|board| {
            let points = |rows: &[LeadRow]| {
                rows.iter().filter_map(|row| Some((f64::from(row.lead_ms), row.rms?))).collect()
            };
            let mut lanes: Vec<Drawn<'_>> =
                board.models.iter().map(|lane| (lane.model.as_str(), points(&lane.leads))).collect();
            let ceiling = ceiling(&lanes);
            lanes.iter_mut().for_each(|lane| cut(&mut lane.1, ceiling));
            lanes
        })
        .collect();
    let lines: Vec<Vec<Line<'_>>> = drawn
        .iter()
        .map(|lanes| lanes.iter().map(|(label, points)| Line { label, points, mark: Mark::Solid }).collect())
        .collect();
    let ranges: Vec<_> = drawn.iter().map(|lanes| Some((0.0, ceiling(lanes)))).collect();
    let labels: Vec<String> = boards.iter().map(|b| format!("{} [{}]", b.set, b.unit)).collect();
    let stacked: Vec<ChartPanel<'_>> = lines
        .iter()
        .zip(labels.iter().zip(ranges))
        .map(|(lines, (y_label, y_range))| ChartPanel { y_label, y_range, lines })
        .collect();
    let subtitle = boards.iter().map(Board::title).collect::<Vec<_>>().join("; ");
    std::fs::create_dir_all(out)
        .map_err(|error| Failure::failed(format_args!("cannot make {}: {error}", out.display()), ""))?;
    panels(
        &file,
        "RMS position error against look-ahead time",
        &subtitle,
        "look-ahead time [ms]",
        &stacked,
        None,
    )
    .map_err(|error| Failure::failed(error, ""))?;
    Ok(file)
}

/// Upper end of a panel: a diverging model would compress all others.
fn ceiling(lanes: &[Drawn<'_>]) -> f64 {
    let last = lanes.iter().filter_map(|(_, points)| Some(points.last()?.1)).filter(|y| y.is_finite());
    let lowest = last.fold(f64::INFINITY, f64::min);
    if lowest.is_finite() && lowest > 0.0 { 1.35 * lowest } else { 1.0 }
}

/// Leaves out what lies above `ceiling`, to the point where the line crosses it.
fn cut(points: &mut Vec<(f64, f64)>, ceiling: f64) {
    let Some(over) = points.iter().position(|p| !(p.1 <= ceiling)) else { return };
    let crossing = match (over.checked_sub(1).and_then(|before| points.get(before)), points.get(over)) {
        (Some((x0, y0)), Some((x1, y1))) if y1.is_finite() => {
            Some((x0 + (x1 - x0) * (ceiling - y0) / (y1 - y0), ceiling))
        }
        _ => None,
    };
    points.truncate(over);
    points.extend(crossing);
}

#[cfg(test)]
mod tests {
    use super::{ceiling, cut};

    #[test]
    fn lines_that_run_away_end_at_the_ceiling() {
        let lanes = [("a", vec![(10.0, 1.0), (20.0, 2.0)]), ("b", vec![(10.0, 1.7), (20.0, 3.7)])];
        assert!((ceiling(&lanes) - 2.7).abs() < 1e-12);
        let mut line = lanes[1].1.clone();
        cut(&mut line, 2.7);
        assert_eq!(line, [(10.0, 1.7), (15.0, 2.7)]);
        let mut line = lanes[0].1.clone();
        cut(&mut line, 2.7);
        assert_eq!(line, lanes[0].1);
    }
}
