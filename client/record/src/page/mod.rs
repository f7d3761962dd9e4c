//! A run as one HTML page that needs no file beside it and no network: first the run itself, in true time,
//! then one picture per claim, explained where it stands.
//!
//! Contract: what others wrote (names, paths, settings) is escaped; a script is given numbers only. Absent:
//! what is told of a run, which is the matter of `foretrace demo` and, for recordings, of `recording`.

mod run;
mod drawings;
mod moving;
mod recording;

use std::fmt::Write as _;

use foretrace_sim::plot::{Picture, STYLE, escaped};

pub use drawings::{View, times};
pub use moving::{DeskGeometry, ReplayFrames};
pub use recording::of_recording;
pub use run::{GhostComparison, GhostSample, Late, LateTicks, RunTraces, approached, tool_at};

const PAGE_STYLE: &str = include_str!("page.css");
/// Nothing is asked of a network, whatever a page holds.
const POLICY: &str = "default-src 'none'; style-src 'unsafe-inline'; script-src 'unsafe-inline'";

/// The whole page; `body` is HTML.
#[must_use]
pub fn whole(title: &str, body: &str) -> String {
    format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
         <meta http-equiv=\"Content-Security-Policy\" content=\"{POLICY}\">\n<title>{}</title>\n\
         <style>{PAGE_STYLE}\n{STYLE}</style>\n</head>\n<body>\n{body}</body>\n</html>\n",
        escaped(title)
    )
}

/// Name, figure and what stands beside it (HTML), side by side.
#[must_use]
pub fn tiles(tiles: &[(&str, String, String)]) -> String {
    let mut html = "<div class=\"tiles\">\n".to_owned();
    for (name, value, beside) in tiles {
        // Writing to a String cannot fail.
        let _ = writeln!(html, "<div>{name}<b>{value}</b><span class=\"muted\">{beside}</span></div>");
    }
    html.push_str("</div>\n");
    html
}

/// A claim, what it means (both HTML), and the picture that shows it; nothing without a picture.
#[must_use]
pub fn claim(head: &str, words: &str, picture: Option<&Picture>) -> String {
    picture.map_or_else(String::new, |picture| {
        format!("<section>\n<h2>{head}</h2>\n<p>{words}</p>\n{}</section>\n", picture.inline())
    })
}

/// A table of names and values, which are escaped here.
#[must_use]
pub fn table<N: AsRef<str>>(rows: impl Iterator<Item = (N, String)>) -> String {
    let mut html = "<table>\n".to_owned();
    for (name, value) in rows {
        let _ = writeln!(html, "<tr><td>{}</td><td>{}</td></tr>", escaped(name.as_ref()), escaped(&value));
    }
    html.push_str("</table>\n");
    html
}

/// How many ticks of those that ended late were woken late, and how many worked too long, in words; empty
/// without any.
#[must_use]
pub fn late_words(woken: u64, worked: u64) -> String {
    match (woken, worked) {
        (0, 0) => String::new(),
        (woken, 0) => format!("{woken} because the kernel woke the loop late, none by their own work"),
        (0, worked) => format!("{worked} because their own work took long, none by a late wake-up"),
        (woken, worked) => format!(
            "{woken} because the kernel woke the loop late, {worked} because their own work took long"
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_others_wrote_stays_text() {
        let name = "</title><script>alert(1)</script>&\"";
        let page = whole(name, &table([(name, name.to_owned())].into_iter()));
        assert!(!page.contains("<script>") && page.matches("&lt;script&gt;alert(1)").count() == 3, "{page}");
        assert!(page.contains("&amp;&quot;"));
    }

    #[test]
    fn a_page_asks_for_nothing_from_outside() {
        let page = whole("run", "");
        for outside in ["://", "@import", "url(", "src=", "href="] {
            assert!(!page.contains(outside) && !include_str!("moving.js").contains(outside), "{outside}");
        }
        assert!(page.contains("default-src 'none'"));
        // What would end the element that holds the script.
        assert!(!include_str!("moving.js").contains("</"));
    }

    #[test]
    fn late_ticks_are_reported_by_their_cause() {
        assert_eq!(late_words(0, 0), "");
        assert_eq!(
            late_words(3, 1),
            "3 because the kernel woke the loop late, 1 because their own work took long"
        );
    }
}
