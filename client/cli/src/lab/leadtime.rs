//! `foretrace lab leadtime`: ranks predictors by error against look-ahead time.

use std::path::{Path, PathBuf};

use foretrace_lab::prediction::lead_time::{
    Board, BoardError, Entrant, LeadRow, Predictions, Standing, compare, export,
};
use foretrace_lab::prediction::{Model, Set};
use foretrace_sim::data::{DataSet, Split};
use foretrace_sim::plot::{Line, Mark, Panel, panels};
use serde_json::json;

use super::progress::Progress;
use super::table;
use crate::failure::Failure;
use crate::output::{JsonArgs, note, say};

/// Look-ahead times in the text [ms].
const SHOWN_MS: [u32; 5] = [10, 20, 50, 100, 200];

#[derive(Debug, clap::Args)]
pub(crate) struct LeadtimeArgs {
    /// Data-set folders
    #[arg(long, value_name = "DIR", value_delimiter = ',', required = true)]
    data: Vec<PathBuf>,

    /// Stop at a bad file instead of leaving it out
    #[arg(long)]
    strict: bool,

    /// Models, comma-separated; also lstm:FILE.safetensors and file:PREDICTIONS.csv [default: all]
    #[arg(long, value_name = "NAMES")]
    models: Option<String>,

    /// Part of the sets: a word of split.tsv, or all [default: test if there is one, else all]
    #[arg(long, value_name = "WORD")]
    split: Option<Split>,

    /// Write each set's points and targets as CSV to DIR and stop, for predictors that run elsewhere
    #[arg(long, value_name = "DIR")]
    export_targets: Option<PathBuf>,

    /// Folder for the picture
    #[arg(long, value_name = "DIR", default_value = "foretrace-lab")]
    out: PathBuf,

    #[command(flatten)]
    json: JsonArgs,
}

pub(super) fn run(args: &LeadtimeArgs) -> Result<(), Failure> {
    args.json.claim_beside(&args.out)?;
    let entrants = entrants(args.models.as_deref())?;
    let exports = args.export_targets.as_deref();
    let mut sets = Vec::new();
    for folder in &args.data {
        let split = match &args.split {
            Some(split) => split.clone(),
            None => usual_split(folder)?,
        };
        sets.push(table::load(folder, &split, exports.is_some(), args.strict)?);
    }
    if let Some(twice) =
        sets.iter().enumerate().find(|(i, set)| sets.iter().take(*i).any(|s| s.name == set.name))
    {
        let what = format_args!("--data names two sets called {:?}", twice.1.name);
        return Err(Failure::usage(what, "name each set once, or rename one of the folders"));
    }
    match exports {
        Some(folder) => export_all(folder, &sets),
        None => compare_all(args, &entrants, &sets),
    }
}

fn entrants(names: Option<&str>) -> Result<Vec<Entrant>, Failure> {
    let Some(names) = names else { return Ok(Model::all().into_iter().map(Entrant::Model).collect()) };
    let mut entrants: Vec<Entrant> = Vec::new();
    for name in names.split(',').map(str::trim) {
        let entrant = match name.strip_prefix("file:") {
            Some(file) => {
                let predictions =
                    Predictions::load(Path::new(file)).map_err(|error| Failure::bad_input(error, ""))?;
                Entrant::File { name: name.to_owned(), predictions }
            }
            None => Entrant::Model(Model::named(name).map_err(|error| table::unknown(&error))?),
        };
        if entrants.iter().any(|e| e.name() == name) {
            return Err(Failure::usage(
                format_args!("model {name:?} is named twice"),
                "name each model once",
            ));
        }
        entrants.push(entrant);
    }
    Ok(entrants)
}

fn usual_split(folder: &Path) -> Result<Split, Failure> {
    let words = DataSet::splits(folder)
        .map_err(|error| Failure::bad_input(error, "give data-set folders (--data)"))?;
    Ok(if words.iter().any(|word| word == "test") { Split::test() } else { Split::All })
}

fn export_all(folder: &Path, sets: &[Set]) -> Result<(), Failure> {
    for set in sets {
        let files = export(folder, &set.name, &set.scored).map_err(|error| {
            Failure::failed(
                format_args!("cannot write to {}: {error}", folder.display()),
                "give a writable folder",
            )
        })?;
        for file in files {
            say!("{}", file.display());
        }
    }
    Ok(())
}

fn compare_all(args: &LeadtimeArgs, entrants: &[Entrant], sets: &[Set]) -> Result<(), Failure> {
    let progress = Progress::of("lab leadtime", entrants.len() * sets.len());
    let (boards, standings) = compare(entrants, sets, &|| progress.step()).map_err(|error| match error {
        BoardError::Predictions(_) => Failure::bad_input(error, ""),
        other => Failure::bad_input(other, "choose other models (--models)"),
    })?;
    drop(progress);
    for board in &boards {
        print(board);
    }
    print_standings(&standings, boards.len());
    draw(args, &boards)?;
    args.json.write(&json!({ "sets": boards, "standings": standings }))
}

fn title(board: &Board) -> String {
    let rates: Vec<String> = board.rates_hz.iter().map(f64::to_string).collect();
    let assumed = if board.rate_assumed { ", assumed" } else { "" };
    format!("{} ({}), {} Hz{assumed}, {} instants", board.set, board.split, rates.join("/"), board.instants)
}

fn print(board: &Board) {
    let unit = if board.unit == "mm" { "mm" } else { "raw units" };
    say!("{}", title(board));
    say!(
        "RMS of the 2-D position error [{unit}]; at 100 ms also along and across the motion, the mean lag, \
         and the bands\n"
    );
    let wide = table::width(board.models.iter().map(|lane| lane.model.as_str()));
    let heads: String = SHOWN_MS.iter().map(|ms| format!(" {:>9}", format!("{ms} ms"))).collect();
    say!(
        "{:<wide$}{heads}   {:>8} {:>8} {:>8} {:>6} {:>6} {:>8}",
        "model",
        "along",
        "cross",
        "mean",
        "in 50%",
        "in 90%",
        "radius"
    );
    for lane in &board.models {
        let at = |ms: u32| lane.leads.iter().find(|row| row.lead_ms == ms);
        let cells: String = SHOWN_MS
            .iter()
            .map(|ms| format!(" {:>9}", table::figure(at(*ms).and_then(|row| row.rms))))
            .collect();
        let of = |field: fn(&LeadRow) -> Option<f64>| at(100).and_then(field);
        say!(
            "{:<wide$}{cells}   {:>8} {:>8} {:>8} {:>6} {:>6} {:>8}",
            lane.model,
            table::figure(of(|r| r.along_rms)),
            table::figure(of(|r| r.cross_rms)),
            table::figure(of(|r| r.along_mean)),
            table::fixed(of(|r| r.coverage_50), 1),
            table::fixed(of(|r| r.coverage_90), 1),
            table::figure(of(|r| r.radius_90))
        );
    }
    for lane in &board.models {
        if let Some(text) = &lane.note {
            say!("{}: {text}", lane.model);
        }
    }
    say!("");
}

fn print_standings(standings: &[Standing], sets: usize) {
    say!("Over all sets and look-ahead times: RMS over that of a pen that stands still, geometric mean");
    let wide = table::width(standings.iter().map(|s| s.model.as_str()));
    for (index, standing) in standings.iter().enumerate() {
        let some = if standing.sets < sets {
            format!("  ({} of {sets} sets)", standing.sets)
        } else {
            String::new()
        };
        say!(
            "{:>3}  {:<wide$} {:>7}{some}",
            index + 1,
            standing.model,
            table::fixed(standing.rms_over_zero, 4)
        );
    }
    if standings.iter().any(|s| s.sets < sets) {
        note!("lab: standings over different sets do not compare");
    }
}

/// A model's name and its (look-ahead time, error).
type Drawn<'a> = (&'a str, Vec<(f64, f64)>);

/// One panel per set, one line per model.
fn draw(args: &LeadtimeArgs, boards: &[Board]) -> Result<(), Failure> {
    let file = args.out.join("leadtime.svg");
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
    let stacked: Vec<Panel<'_>> = lines
        .iter()
        .zip(labels.iter().zip(ranges))
        .map(|(lines, (y_label, y_range))| Panel { y_label, y_range, lines })
        .collect();
    let subtitle = boards.iter().map(title).collect::<Vec<_>>().join("; ");
    std::fs::create_dir_all(&args.out)
        .map_err(|error| Failure::failed(format_args!("cannot make {}: {error}", args.out.display()), ""))?;
    panels(
        &file,
        "RMS position error against look-ahead time",
        &subtitle,
        "look-ahead time [ms]",
        &stacked,
        None,
    )
    .map_err(|error| Failure::failed(error, ""))?;
    say!("\npicture  {}", file.display());
    Ok(())
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
