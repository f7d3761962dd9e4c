//! The report folder: pictures, report.json, and one page as Markdown and as HTML.

use std::fmt::Write as _;
use std::path::Path;

use foretrace_client::Stage;
use foretrace_lab::plot::{Distribution, PlotError, error_over_time, histograms, path_overlay};

use super::evidence::Evidence;
use super::figures::{Figures, Scored};
use crate::failure::Failure;

/// File and caption.
type Picture = (&'static str, &'static str);

const PICTURES: [Picture; 3] = [
    ("path.svg", "The pen and the arm's tool over each other"),
    ("error.svg", "Distance between tool and pen at the same instant, and the trust in the prediction"),
    ("times.svg", "Wake-up latency and the cost of a tick and its stages"),
];

/// Makes sure that `folder` is there and can be written.
pub(crate) fn prepare(folder: &Path) -> Result<(), Failure> {
    let refused = |error: std::io::Error| {
        Failure::bad_input(
            format_args!("cannot write the report into {}: {error}", folder.display()),
            "give a writable folder with --out",
        )
    };
    std::fs::create_dir_all(folder).map_err(refused)?;
    let probe = folder.join(".writable");
    std::fs::write(&probe, []).and_then(|()| std::fs::remove_file(&probe)).map_err(refused)
}

/// Writes everything into `folder`, which is made if needed.
///
/// `turn_s`: one repetition of the pen's path [s]; the overlay shows the last one.
pub(crate) fn write(
    folder: &Path,
    figures: &Figures,
    evidence: &Evidence,
    scored: Option<&Scored>,
    turn_s: f64,
) -> Result<(), Failure> {
    let unwritable = |error: &dyn std::fmt::Display| {
        Failure::failed(format_args!("cannot write the report: {error}"), "give a writable folder with --out")
    };
    std::fs::create_dir_all(folder).map_err(|error| unwritable(&error))?;
    let whole = Scored::whole(evidence);
    let drawn = pictures(folder, figures, evidence, scored.unwrap_or(&whole), turn_s)
        .map_err(|error| unwritable(&error))?;
    let mut json = serde_json::to_string_pretty(figures).map_err(|error| unwritable(&error))?;
    json.push('\n');
    for (name, text) in [
        ("report.json", json),
        ("report.md", markdown(figures, &drawn)),
        ("report.html", html(figures, &drawn)),
    ] {
        std::fs::write(folder.join(name), text).map_err(|error| unwritable(&error))?;
    }
    Ok(())
}

/// Those that there is something to draw in; a run that was stopped at once may have none.
fn pictures(
    folder: &Path,
    figures: &Figures,
    evidence: &Evidence,
    scored: &Scored,
    turn_s: f64,
) -> Result<Vec<Picture>, PlotError> {
    let mut drawn = Vec::new();
    let mut keep = |picture: Picture, outcome: Result<(), PlotError>| match outcome {
        Err(PlotError::Empty { .. }) => Ok(()),
        other => other.map(|()| drawn.push(picture)),
    };
    let [path, error, times] = PICTURES.map(|(name, _)| folder.join(name));
    let last_s = scored.errors.last().map_or(0.0, |error| error.t_s);
    let from_s = last_s - turn_s;
    let pen: Vec<_> =
        evidence.pen.iter().filter(|sample| (from_s..=last_s).contains(&sample.t_s)).copied().collect();
    let tool: Vec<_> =
        scored.tool.iter().filter(|sample| (from_s..=last_s).contains(&sample.t_s)).copied().collect();
    let score = figures.tracking.as_ref().map_or_else(
        || "not scored".to_owned(),
        |score| format!("rms {:.2} mm, {:.1} ms behind", score.rmse_m * 1e3, score.lag_ms),
    );
    let subtitle = format!("{}, predictor {}: {score}", figures.setting.pen, figures.setting.predictor);
    let [of_path, of_error, of_times] = PICTURES;
    keep(of_path, path_overlay(&path, "Pen and robot", &subtitle, &pen, &tool))?;
    let trust: Vec<(f64, f64)> = evidence.ticks.iter().map(|tick| (tick.t_s, tick.trust)).collect();
    keep(of_error, error_over_time(&error, "Tracking error", &subtitle, &scored.errors, &trust))?;
    let shown = [Stage::Wakeup, Stage::Step, Stage::Predict, Stage::Mpc, Stage::Ik];
    let distributions: Vec<Distribution> = shown
        .iter()
        .map(|stage| {
            let us = evidence.ticks.iter().map(|tick| f64::from(tick.stage_ns(*stage)) * 1e-3);
            Distribution::from_values_us(stage.label(), us)
        })
        .collect();
    let subtitle = format!(
        "{:.0} Hz, {} ticks, {} overruns",
        figures.control_loop.rate_hz, figures.control_loop.ticks, figures.control_loop.overruns
    );
    keep(of_times, histograms(&times, "What a tick costs", &subtitle, &distributions))?;
    Ok(drawn)
}

fn headline(figures: &Figures) -> String {
    let setting = &figures.setting;
    format!(
        "{} for {:.0} s, predictor {}, settings {}",
        setting.pen, setting.seconds, setting.predictor, setting.settings
    )
}

fn markdown(figures: &Figures, drawn: &[Picture]) -> String {
    let mut page = format!("# foretrace demo\n\n{}\n\n| | |\n|---|---|\n", headline(figures));
    // Writing to a String cannot fail.
    for (name, value) in figures.rows() {
        let _ = writeln!(page, "| {name} | {value} |");
    }
    for (file, caption) in drawn {
        let _ = write!(page, "\n![{caption}]({file})\n\n{caption}.\n");
    }
    page
}

fn html(figures: &Figures, drawn: &[Picture]) -> String {
    let mut page = String::from(
        "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><title>foretrace demo</title>\n<style>\
         body{font:16px/1.5 system-ui,sans-serif;max-width:1000px;margin:2em auto;padding:0 1em;color:#222}\
         img{width:100%}td{padding:.15em 1em .15em 0;vertical-align:top}td:first-child{color:#777}\
         figure{margin:2em 0}figcaption{color:#777}</style></head>\n<body><h1>foretrace demo</h1>\n",
    );
    let _ = writeln!(page, "<p>{}</p>\n<table>", escaped(&headline(figures)));
    for (name, value) in figures.rows() {
        let _ = writeln!(page, "<tr><td>{name}</td><td>{}</td></tr>", escaped(&value));
    }
    page.push_str("</table>\n");
    for (file, caption) in drawn {
        let _ = writeln!(
            page,
            "<figure><img src=\"{file}\" alt=\"{caption}\"><figcaption>{caption}.</figcaption></figure>"
        );
    }
    page.push_str("</body></html>\n");
    page
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}
