//! The report as one HTML page (`foretrace_record::page`): the run in true time, then one picture per claim,
//! explained where it stands.
//!
//! Contract: every figure carries its path in the JSON (`data-of`), and is that number. Whatever is written
//! by others (names, paths, settings) is escaped.

use std::fmt::Write as _;

use foretrace_record::page::{self, claim, table, whole};
use foretrace_sim::plot::{Picture, escaped};
use serde_json::Value;

use super::drawings::Drawings;
use super::figures::RunFigures;
use super::table::{Against, ReportedFigure, arm, at, ghost, late, rows};
use super::verdict::RunFinding;

pub(super) fn page(figures: &RunFigures, drawings: &Drawings, findings: &[RunFinding]) -> String {
    let (arm, ghost) = (arm(figures), ghost(figures));
    let mut body = String::new();
    head(&mut body, figures, findings);
    if let Some(moving) = &drawings.moving {
        body.push_str(&moving.section());
    }
    body.push_str(&tiles(figures, arm.as_ref(), ghost.as_ref()));
    for PageClaim { head, words, picture } in claims(figures, drawings, arm.as_ref(), ghost.as_ref()) {
        body.push_str(&claim(&head, &words, picture));
    }
    body.push_str("<section>\n<h2>All figures</h2>\n");
    body.push_str(&table(rows(figures).into_iter()));
    body.push_str(
        "<p class=\"muted\">The learner keeps adapting the prediction while the loop runs. What it has \
         learned is taken into use only where it foresaw recent motion better, and taken back where it did \
         not. The same figures for machines: report.json. To write with your own hand: cargo \
         console.</p>\n</section>\n",
    );
    whole("foretrace demo", &body)
}

fn head(page: &mut String, figures: &RunFigures, findings: &[RunFinding]) {
    let setting = &figures.setting;
    let _ = writeln!(
        page,
        "<h1>foretrace demo</h1>\n<p>A simulated arm {} <b>{}</b>, written by a simulated hand, for {:.0} s. \
         <span class=\"muted\">Predictor {}, settings {}{}.</span></p>",
        if figures.control_loop.stops.is_empty() { "followed" } else { "was to follow" },
        escaped(&setting.pen),
        setting.seconds,
        escaped(setting.predictor),
        escaped(&setting.settings),
        if setting.optimised_build {
            ""
        } else {
            "; built for a quick start, slower than the released program"
        }
    );
    if findings.is_empty() {
        page.push_str(
            "<div class=\"told\"><p>The run went as it should: no limit was broken and nothing stopped the \
             arm.</p></div>\n",
        );
        return;
    }
    page.push_str("<div class=\"told bad\" role=\"alert\">\n");
    for RunFinding { what, reason, remedy } in findings {
        let _ = writeln!(page, "<p><b>{}.</b></p>", escaped(&capital(what)));
        for (name, line) in [("What fired", reason), ("What to do", remedy)] {
            if !line.is_empty() {
                let _ = writeln!(page, "<p>{name}: {}</p>", escaped(line));
            }
        }
    }
    page.push_str("<p class=\"muted\">The report goes as far as the run did.</p>\n</div>\n");
}

fn capital(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or_else(String::new, |first| first.to_uppercase().chain(letters).collect())
}

/// A figure with its path in the JSON, in `unit`, of which there are `factor` in the unit of the JSON.
fn number(figure: &ReportedFigure, factor: f64, digits: usize, unit: &str) -> String {
    let words = figure.words(factor, digits, unit);
    if figure.value.is_some_and(f64::is_finite) {
        format!("<span data-of=\"{}\">{words}</span>", figure.at)
    } else {
        words
    }
}

fn mm(figure: &ReportedFigure) -> String {
    number(figure, 1e3, 2, "mm")
}

fn largest(figure: &ReportedFigure) -> String {
    number(figure, 1e3, 1, "mm")
}

fn ms(figure: &ReportedFigure) -> String {
    number(figure, 1.0, 1, "ms")
}

fn count(path: &'static str, value: u64) -> String {
    number(&at(path, Some(value as f64)), 1.0, 0, "").replace(" </span>", "</span>")
}

fn micro(path: &'static str, us: f64) -> String {
    number(&at(path, Some(us)), 1.0, 1, "µs")
}

fn tiles(figures: &RunFigures, arm: Option<&Against>, ghost: Option<&Against>) -> String {
    let without = |words: &dyn Fn(&Against) -> String| {
        ghost
            .map_or_else(|| "not compared".to_owned(), |ghost| format!("{} without prediction", words(ghost)))
    };
    let unknown = || "not scored".to_owned();
    let looped = &figures.control_loop;
    let commands = figures.commands.get("count").and_then(Value::as_u64).unwrap_or(0);
    page::tiles(&[
        ("error (rms)", arm.map_or_else(unknown, |arm| mm(&arm.rms_m)), without(&|one| mm(&one.rms_m))),
        ("lag", arm.map_or_else(unknown, |arm| ms(&arm.lag_ms)), without(&|one| ms(&one.lag_ms))),
        (
            "ticks too late",
            count("/loop/overruns", looped.overruns),
            format!("of {}", count("/loop/ticks", looped.ticks)),
        ),
        (
            "limits broken",
            count("/commands/limit_violations", figures.limit_violations()),
            format!("in {} commands", count("/commands/count", commands)),
        ),
    ])
}

/// A claim, what it means, and the picture that shows it.
struct PageClaim<'a> {
    head: String,
    words: String,
    picture: Option<&'a Picture>,
}

fn claims<'a>(
    figures: &RunFigures,
    drawings: &'a Drawings,
    arm: Option<&Against>,
    ghost: Option<&Against>,
) -> Vec<PageClaim<'a>> {
    let looped = &figures.control_loop;
    let without = |words: &dyn Fn(&Against) -> String| {
        ghost.map_or_else(String::new, |ghost| format!(", {} without prediction", words(ghost)))
    };
    let with = |words: &dyn Fn(&Against) -> String| arm.map_or_else(|| "not scored".to_owned(), words);
    let period_ms = 1e3 / looped.rate_hz;
    let heights = figures.envelope.as_ref().map_or_else(
        || "not measured".to_owned(),
        |envelope| {
            let low = at("/envelope/height_min_m", Some(envelope.height_min_m));
            let high = at("/envelope/height_max_m", Some(envelope.height_max_m));
            format!("{} to {}", largest(&low), largest(&high))
        },
    );
    vec![
        PageClaim {
            head: format!("Lag: {}{}", with(&|one| ms(&one.lag_ms)), without(&|one| ms(&one.lag_ms))),
            words: "The liveliest strokes in slow motion: how far a curve lies to the right of the pen's is \
                    how late it comes. \
                    The figures are the shift in time that fits best over the whole run."
                .to_owned(),
            picture: drawings.lag.as_ref(),
        },
        PageClaim {
            head: format!("Error: {}{}", with(&|one| mm(&one.rms_m)), without(&|one| mm(&one.rms_m))),
            words: format!(
                "How far the arm's tool is from the pen at the same instant while the pen writes (root mean \
                 square; at most \
                 {}{}). Trust says how much of the prediction the arm acts on: 1 is all of it, 0 none, as \
                 the ghost.",
                with(&|one| largest(&one.max_m)),
                without(&|one| largest(&one.max_m))
            ),
            picture: drawings.error.as_ref(),
        },
        PageClaim {
            head: format!(
                "Deadlines: {} of {} ticks ended too late",
                count("/loop/overruns", looped.overruns),
                count("/loop/ticks", looped.ticks)
            ),
            words: format!(
                "Every {period_ms:.0} ms the loop wakes up and computes one command, which must be sent \
                 before the next tick. 99 % of the ticks began within {} of their time and took {} or \
                 less.{}",
                micro("/loop/wakeup_us/p99", looped.wakeup_us.p99),
                micro("/loop/step_us/p99", looped.step_us.p99),
                late(figures).map_or_else(String::new, |words| format!(" Late were {words}."))
            ),
            picture: drawings.times.as_ref(),
        },
        PageClaim {
            head: format!(
                "Limits: {} commands broke one",
                count("/commands/limit_violations", figures.limit_violations())
            ),
            words:
                "The arm judged every command by itself. The bars show the largest speed and acceleration \
                    that any command \
                    asked of each joint; 100 is what is allowed. A bar at 100 is intended: where the hand \
                    turns sharply, the plan uses all of the strength that it is allowed, and no more."
                    .to_owned(),
            picture: drawings.limits.as_ref(),
        },
        PageClaim {
            head: format!("Height: {heights} over the paper"),
            words: "Where the tip of the pen on the arm was, from the measured joints. It touches the paper \
                    (0) while the hand \
                    writes and lifts in between; it must never press deeper than the red line."
                .to_owned(),
            picture: drawings.heights.as_ref(),
        },
    ]
}
