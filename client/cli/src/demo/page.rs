//! The report as one HTML page that needs no file beside it and no network: one picture per claim, explained
//! where it stands.
//!
//! Contract: every figure carries its place in the JSON (`data-of`), and is that number. Whatever is written
//! by others (names, paths, settings) is escaped.

use std::fmt::Write as _;

use foretrace_sim::plot::page::{Picture, STYLE, escaped};
use serde_json::Value;

use super::drawings::Drawings;
use super::figures::Figures;
use super::told::{Against, Told, arm, ghost, rows};
use super::verdict::Finding;

const PAGE_STYLE: &str = "\
:root{color-scheme:light dark;--ink:#1f2937;--muted:#5b6472;--paper:#fff;--soft:#f3f4f6;--good:#15806a;--bad:#b91c1c}\
@media screen and \
(prefers-color-scheme:dark){:root{--ink:#e6e8eb;--muted:#a3adba;--paper:#14171c;--soft:#1f242c;--good:#4cc9ae;--bad:#ff8078}}\
body{font:16px/1.5 system-ui,sans-serif;max-width:960px;margin:1.5em auto;padding:0 1em;color:var(--ink);background:var(--paper)}\
h1{font-size:1.5em;margin:0}h2{font-size:1.15em;margin:0 0 .2em}p{margin:.3em 0}.muted{color:var(--muted)}\
.fig{display:block;width:100%;height:auto;margin:.4em 0}section{margin:1.8em 0;break-inside:avoid}\
.tiles{display:flex;flex-wrap:wrap;gap:.6em;margin:1em 0}.tiles \
div{flex:1 1 10em;background:var(--soft);border-radius:6px;padding:.5em .8em}\
.tiles b{display:block;font-size:1.25em}.tiles span.muted{display:block;font-size:.9em}\
.told{border-left:4px solid var(--good);padding:.3em .8em;background:var(--soft)}.told.bad{border-color:var(--bad)}\
table{border-collapse:collapse;font-size:.92em}td{padding:.15em 1em .15em 0;vertical-align:top;overflow-wrap:anywhere}td:first-child{color:var(--muted)}\
@page{size:A4;margin:12mm}@media \
print{body{margin:0;padding:0;max-width:none;font-size:10.5pt}section{margin:1em 0}.tiles div{border:1px solid #ccc}tr{break-inside:avoid}}";

/// The page.
pub(crate) fn page(figures: &Figures, drawings: &Drawings, findings: &[Finding]) -> String {
    let (arm, ghost) = (arm(figures), ghost(figures));
    let mut page = format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n<title>foretrace \
         demo</title>\n\
         <style>{PAGE_STYLE}\n{STYLE}</style>\n</head>\n<body>\n"
    );
    head(&mut page, figures, findings);
    tiles(&mut page, figures, arm.as_ref(), ghost.as_ref());
    for claim in claims(figures, drawings, arm.as_ref(), ghost.as_ref()) {
        claim.write(&mut page);
    }
    page.push_str("<section>\n<h2>All figures</h2>\n<table>\n");
    // Writing to a String cannot fail.
    for (name, value) in rows(figures) {
        let _ = writeln!(page, "<tr><td>{}</td><td>{}</td></tr>", escaped(name), escaped(&value));
    }
    page.push_str(
        "</table>\n<p class=\"muted\">The learner keeps adapting the prediction while the loop runs. What it \
         has learned is \
         taken into use only where it foresaw recent motion better, and taken back where it did not. \
         The same figures for machines: report.json.</p>\n</section>\n</body>\n</html>\n",
    );
    page
}

fn head(page: &mut String, figures: &Figures, findings: &[Finding]) {
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
    for Finding { what, reason, remedy } in findings {
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

/// A figure with its place in the JSON, in `unit`, of which there are `factor` in the unit of the JSON.
fn number(told: &Told, factor: f64, digits: usize, unit: &str) -> String {
    let words = told.words(factor, digits, unit);
    if told.value.is_some_and(f64::is_finite) {
        format!("<span data-of=\"{}\">{words}</span>", told.at)
    } else {
        words
    }
}

fn mm(told: &Told) -> String {
    number(told, 1e3, 2, "mm")
}

fn largest(told: &Told) -> String {
    number(told, 1e3, 1, "mm")
}

fn ms(told: &Told) -> String {
    number(told, 1.0, 1, "ms")
}

fn count(at: &'static str, value: u64) -> String {
    number(&Told { at, value: Some(value as f64) }, 1.0, 0, "").replace(" </span>", "</span>")
}

fn micro(at: &'static str, us: f64) -> String {
    number(&Told { at, value: Some(us) }, 1.0, 1, "µs")
}

fn tiles(page: &mut String, figures: &Figures, arm: Option<&Against>, ghost: Option<&Against>) {
    let without = |words: &dyn Fn(&Against) -> String| {
        ghost
            .map_or_else(|| "not compared".to_owned(), |ghost| format!("{} without prediction", words(ghost)))
    };
    let unknown = || "not scored".to_owned();
    let looped = &figures.control_loop;
    let commands = figures.commands.get("count").and_then(Value::as_u64).unwrap_or(0);
    let tiles = [
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
    ];
    page.push_str("<div class=\"tiles\">\n");
    for (name, value, beside) in tiles {
        let _ = writeln!(page, "<div>{name}<b>{value}</b><span class=\"muted\">{beside}</span></div>");
    }
    page.push_str("</div>\n");
}

/// A claim, what it means, and the picture that shows it.
struct Claim<'a> {
    head: String,
    words: String,
    picture: Option<&'a Picture>,
}

impl Claim<'_> {
    fn write(&self, page: &mut String) {
        let Some(picture) = self.picture else { return };
        let _ = writeln!(
            page,
            "<section>\n<h2>{}</h2>\n<p>{}</p>\n{}</section>",
            self.head,
            self.words,
            picture.inline()
        );
    }
}

fn claims<'a>(
    figures: &Figures,
    drawings: &'a Drawings,
    arm: Option<&Against>,
    ghost: Option<&Against>,
) -> Vec<Claim<'a>> {
    let looped = &figures.control_loop;
    let without = |words: &dyn Fn(&Against) -> String| {
        ghost.map_or_else(String::new, |ghost| format!(", {} without prediction", words(ghost)))
    };
    let with = |words: &dyn Fn(&Against) -> String| arm.map_or_else(|| "not scored".to_owned(), words);
    let period_ms = 1e3 / looped.rate_hz;
    let heights = figures.envelope.as_ref().map_or_else(
        || "not measured".to_owned(),
        |envelope| {
            format!(
                "{} to {}",
                number(
                    &Told { at: "/envelope/height_min_m", value: Some(envelope.height_min_m) },
                    1e3,
                    1,
                    "mm"
                ),
                number(
                    &Told { at: "/envelope/height_max_m", value: Some(envelope.height_max_m) },
                    1e3,
                    1,
                    "mm"
                )
            )
        },
    );
    vec![
        Claim {
            head: "The arm writes what the pen writes".to_owned(),
            words: "The last round of writing, above by the arm, below by its ghost: the same loop with the \
                    same pen and arm, \
                    computed beside it, that never predicts and moves nothing. Both draw neat letters: a \
                    picture of shapes does not show that the ghost draws them late. The next two do."
                .to_owned(),
            picture: drawings.path.as_ref(),
        },
        Claim {
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
        Claim {
            head: format!("Lag: {}{}", with(&|one| ms(&one.lag_ms)), without(&|one| ms(&one.lag_ms))),
            words: "The liveliest strokes in slow motion: how far a curve lies to the right of the pen's is \
                    how late it comes. \
                    The figures are the shift in time that fits best over the whole run."
                .to_owned(),
            picture: drawings.lag.as_ref(),
        },
        Claim {
            head: format!(
                "Deadlines: {} of {} ticks ended too late",
                count("/loop/overruns", looped.overruns),
                count("/loop/ticks", looped.ticks)
            ),
            words: format!(
                "Every {period_ms:.0} ms the loop wakes up and computes one command, which must be sent \
                 before the next tick. 99 % of \
                 the ticks began within {} of their time and took {} or less.",
                micro("/loop/wakeup_us/p99", looped.wakeup_us.p99),
                micro("/loop/step_us/p99", looped.step_us.p99)
            ),
            picture: drawings.times.as_ref(),
        },
        Claim {
            head: format!(
                "Limits: {} commands broke one",
                count("/commands/limit_violations", figures.limit_violations())
            ),
            words:
                "The arm judged every command by itself. The bars show the largest speed and acceleration \
                    that any command \
                    asked of each joint; 100 is what is allowed. A bar at 100 means that the arm's strength \
                    was used in full."
                    .to_owned(),
            picture: drawings.limits.as_ref(),
        },
        Claim {
            head: format!("Height: {heights} over the paper"),
            words: "Where the tip of the pen on the arm was, from the measured joints. It touches the paper \
                    (0) while the hand \
                    writes and lifts in between; it must never press deeper than the red line."
                .to_owned(),
            picture: drawings.heights.as_ref(),
        },
    ]
}
