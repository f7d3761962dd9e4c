//! Pictures of the benchmark: distributions of errors, letters, error against jerk.

use std::fmt::Display;
use std::path::{Path, PathBuf};

use foretrace_failure::Failure;
use foretrace_sim::metrics::ToolSample;
use foretrace_sim::plot::{Cell, LogLine, LogPanel, letter_grid, log_panels};

use super::{BenchArm, Benchmark, Hand, MethodOutcome, ParetoPoint, Rival, SequenceScore};

/// Share of the sequences \[%\] against their RMS error \[mm\]: a curve per method, a chart per arm.
///
/// # Errors
///
/// The picture cannot be written.
pub fn distributions(out: &Path, title: &str, outcomes: &[MethodOutcome]) -> Result<PathBuf, Failure> {
    let curve = |outcome: &MethodOutcome| {
        let mut rms: Vec<f64> = outcome.scores.iter().flatten().map(rms_mm).collect();
        rms.sort_by(f64::total_cmp);
        let share = |below: usize| 100.0 * (below + 1) as f64 / rms.len() as f64;
        rms.iter().enumerate().map(|(below, rms)| (*rms, share(below))).collect()
    };
    let panels: Vec<_> = distinct(outcomes.iter().map(|outcome| outcome.arm))
        .into_iter()
        .map(|arm| LogPanel {
            title: arm.name(),
            lines: outcomes
                .iter()
                .filter(|outcome| outcome.arm == arm)
                .map(|outcome| LogLine {
                    label: outcome.rival.name(),
                    points: curve(outcome),
                    dots: false,
                    marked: None,
                })
                .collect(),
        })
        .collect();
    let file = out.join("closed-loop-errors.svg");
    let labels = ("RMS error of a sequence [mm]", "sequences below [%]");
    log_panels(&file, "Errors in closed loop", title, labels, false, &panels).map_err(failed)?;
    Ok(file)
}

/// The best, the median and the worst sequence of `mixture` on each arm, also as `hold` writes them.
///
/// # Errors
///
/// A picture cannot be written, or a sequence not be run again.
pub fn letters(
    out: &Path,
    title: &str,
    benchmark: &Benchmark<'_>,
    outcomes: &[MethodOutcome],
) -> Result<Vec<PathBuf>, Failure> {
    let mut files = Vec::new();
    for (arm, hands) in &benchmark.arms {
        let of = |rival| outcomes.iter().find(|outcome| outcome.arm == *arm && outcome.rival == rival);
        let (Some(mixture), Some(hold)) = (of(Rival::AS_SHIPPED), of(Rival::HOLD)) else { continue };
        let numbered: Vec<(&Hand, usize)> =
            hands.iter().flat_map(|hand| (0..hand.sequences.len()).map(move |index| (hand, index))).collect();
        let scored = numbered.iter().zip(&mixture.scores).zip(&hold.scores);
        let mut ranked: Vec<_> = scored
            .filter_map(|((one, mixture), hold)| Some((*one, mixture.as_ref()?, hold.as_ref()?)))
            .collect();
        ranked.sort_by(|a, b| a.1.mse_m2.total_cmp(&b.1.mse_m2));
        let Some(last) = ranked.len().checked_sub(1) else { continue };
        let chosen = [("best", 0), ("median", last / 2), ("worst", last)];
        let asked: Vec<_> = [Rival::AS_SHIPPED, Rival::HOLD]
            .into_iter()
            .flat_map(|rival| chosen.map(|(name, rank)| (rival, name, ranked.get(rank))))
            .filter_map(|(rival, name, one)| Some((rival, name, one?)))
            .collect();
        let wanted: Vec<_> =
            asked.iter().map(|(rival, _, ((hand, index), ..))| (*rival, *hand, *index)).collect();
        let runs = benchmark.replay_all(*arm, &wanted).map_err(failed)?;
        let mut shown = Vec::new();
        for ((rival, name, ((hand, index), mixture, hold)), run) in asked.into_iter().zip(runs) {
            let Some(sequence) = hand.sequences.get(*index) else { continue };
            let ends = sequence.path.samples.first().zip(sequence.path.samples.last());
            let (Some(run), Some((first, end))) = (run, ends) else { continue };
            let within = |tool: &&ToolSample| (first.t_s..=end.t_s).contains(&tool.t_s);
            let tool: Vec<_> = run.tool.iter().filter(within).copied().collect();
            let mm = rms_mm(if rival == Rival::AS_SHIPPED { mixture } else { hold });
            let which = if sequence.label.is_empty() {
                name.to_owned()
            } else {
                format!("{name} {:?}", sequence.label)
            };
            let label = format!("{which}, {}: {mm:.2} mm", rival.name());
            shown.push((label, &sequence.path.samples, tool));
        }
        let cells: Vec<_> = shown.iter().map(|(label, pen, tool)| Cell { label, pen, tool }).collect();
        let file = out.join(format!("closed-loop-letters-{}.svg", arm.name()));
        let heading =
            format!("Best, median and worst of the mixture on {}, and as hold writes them", arm.name());
        letter_grid(&file, &heading, title, &cells).map_err(failed)?;
        files.push(file);
    }
    Ok(files)
}

/// Error against jerk, a chart for each arm, a curve for each method; large dots: as shipped.
///
/// # Errors
///
/// The picture cannot be written.
pub fn pareto(out: &Path, title: &str, points: &[ParetoPoint]) -> Result<PathBuf, Failure> {
    let line = |arm: &str, method: &'static str| {
        let mut swept: Vec<_> =
            points.iter().filter(|point| point.arm == arm && point.method == method).collect();
        swept.sort_by(|a, b| a.rms_jerk.total_cmp(&b.rms_jerk));
        LogLine {
            label: method,
            points: swept.iter().map(|point| (point.rms_jerk, point.rms_m * 1e3)).collect(),
            dots: true,
            marked: swept.iter().position(|point| point.default),
        }
    };
    let mut panels = Vec::new();
    for arm in BenchArm::ALL.map(BenchArm::name) {
        let methods = distinct(points.iter().filter(|point| point.arm == arm).map(|point| point.method));
        if !methods.is_empty() {
            let lines = methods.into_iter().map(|method| line(arm, method)).collect();
            panels.push(LogPanel { title: arm, lines });
        }
    }
    let file = out.join("closed-loop-pareto.svg");
    let labels = ("RMS jerk of the tool [m/s³]", "RMS error [mm]");
    let subtitle = format!("{title}; every method over its own tuning, large dots as shipped");
    log_panels(&file, "Error against jerk", &subtitle, labels, true, &panels).map_err(failed)?;
    Ok(file)
}

fn rms_mm(score: &SequenceScore) -> f64 {
    1e3 * score.mse_m2.sqrt()
}

/// Every value once, in the order in which they come.
fn distinct<T: PartialEq>(all: impl Iterator<Item = T>) -> Vec<T> {
    let mut found = Vec::new();
    for one in all {
        if !found.contains(&one) {
            found.push(one);
        }
    }
    found
}

fn failed(error: impl Display) -> Failure {
    Failure::failed(error, "")
}
