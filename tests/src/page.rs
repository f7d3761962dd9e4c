//! The demo's report as a browser sees it: every tag, every figure with its place in the JSON, nothing from
//! outside.
//!
//! Contract: reads the HTML strictly, as XML but for the void elements that HTML knows; malformed HTML is a
//! panic with its place.

use std::path::Path;

use serde_json::Value;

const VOID: [&str; 3] = ["meta", "br", "input"];

/// The contents of the page.
#[derive(Debug, Default)]
pub struct Page {
    /// Text of every `<desc>`: the pictures' figures.
    pub pictures: Vec<String>,
    /// Place in the JSON, and the text of the figure.
    pub figures: Vec<(String, String)>,
    /// Text of the box that tells what went wrong.
    pub alert: Option<String>,
    /// Which of the pictures have a curve of the arm and one of the ghost.
    pub beside: Vec<bool>,
    /// The frames of the replay, if it has one.
    pub moved: Option<Value>,
}

/// An element that is open.
struct Open {
    name: String,
    attributes: String,
    text: String,
}

impl Page {
    /// Reads and judges a page.
    ///
    /// # Panics
    /// It is not well formed, or needs something that is not in it.
    #[must_use]
    pub fn read(file: &Path) -> Self {
        let html = std::fs::read_to_string(file).unwrap();
        let mut rest = html.strip_prefix("<!DOCTYPE html>\n").expect("a doctype");
        let (mut page, mut open) = (Self::default(), Vec::<Open>::new());
        while let Some((text, from)) = rest.split_once('<') {
            assert!(
                !text.contains('>') || open.last().is_some_and(|o| o.name == "style"),
                "bare > in {text}"
            );
            if let Some(inner) = open.last_mut() {
                inner.text.push_str(&plain(text));
            } else {
                assert!(text.trim().is_empty(), "text outside of every element: {text}");
            }
            let (tag, mut after) = from.split_once('>').expect("a tag that ends");
            if tag.starts_with("script") {
                // What stands in it is no HTML.
                let (script, end) = after.split_at(after.find("</script>").expect("a script that ends"));
                page.run(tag, script);
                after = end;
            }
            rest = after;
            page.take(tag, &mut open);
        }
        assert!(open.is_empty() && rest.trim().is_empty(), "open at the end: {}", open.len());
        assert!(
            !html.contains("://") && !html.contains("@import") && !html.contains("url("),
            "needs the network"
        );
        assert!(!html.contains("NaN"), "a figure that is not a number");
        page
    }

    /// Of the scripts there may be one with the frames and one that shows them, and neither asks for more.
    fn run(&mut self, tag: &str, script: &str) {
        for outside in
            ["fetch(", "XMLHttpRequest", "WebSocket", "EventSource", "import", "sendBeacon", "eval("]
        {
            assert!(!script.contains(outside), "a script with {outside}");
        }
        if tag.contains("application/json") {
            let frames = serde_json::from_str(script).expect("frames as JSON");
            assert!(self.moved.replace(frames).is_none(), "two replays");
        }
    }

    fn take(&mut self, tag: &str, open: &mut Vec<Open>) {
        if let Some(name) = tag.strip_prefix('/') {
            let closed = open.pop().unwrap_or_else(|| panic!("</{name}> closes nothing"));
            assert_eq!(closed.name, name, "closed out of order");
            self.close(&closed);
            if let Some(outer) = open.last_mut() {
                outer.text.push_str(&closed.text);
            }
            return;
        }
        let (name, attributes) = tag.split_once(' ').unwrap_or((tag, ""));
        assert!(attributes.matches('"').count().is_multiple_of(2), "quotes in <{tag}>");
        for outside in ["src=", "href=", "srcset=", "data=", "action="] {
            assert!(!format!(" {attributes}").contains(&format!(" {outside}")), "<{tag}> needs another file");
        }
        assert!(!["link", "img", "iframe", "object"].contains(&name), "<{tag}>");
        if name == "svg" {
            self.beside.push(false);
        }
        let series = |of: &str| attributes.contains(&format!("class=\"line {of}\""));
        if name == "polyline" && (series("arm") || series("ghost")) {
            let inside = open.iter_mut().rev().find(|element| element.name == "svg").expect("in a picture");
            let mark = if series("arm") { " has-arm" } else { " has-ghost" };
            inside.attributes.push_str(mark);
            let both = inside.attributes.contains("has-arm") && inside.attributes.contains("has-ghost");
            *self.beside.last_mut().expect("a picture") |= both;
        }
        if !attributes.ends_with('/') && !VOID.contains(&name) {
            open.push(Open { name: name.to_owned(), attributes: attributes.to_owned(), text: String::new() });
        }
    }

    fn close(&mut self, closed: &Open) {
        match closed.name.as_str() {
            "desc" => self.pictures.push(closed.text.clone()),
            "span" => {
                if let Some(at) = closed.attributes.strip_prefix("data-of=\"") {
                    self.figures.push((at.trim_end_matches('"').to_owned(), closed.text.clone()));
                }
            }
            "div" if closed.attributes.contains("role=\"alert\"") => self.alert = Some(closed.text.clone()),
            _ => {}
        }
    }

    /// Every figure is the JSON's, but for its unit and rounding.
    ///
    /// # Panics
    /// One is not, or there is none.
    pub fn agrees_with(&self, report: &Value) {
        assert!(self.figures.len() >= 10, "{:?}", self.figures);
        for (at, told) in &self.figures {
            let value = report.pointer(at).and_then(Value::as_f64);
            let value = value.unwrap_or_else(|| panic!("{at} is no number in {report}"));
            let (number, unit) = told.split_once(' ').unwrap_or((told, ""));
            let factor = if at.ends_with("_m") && unit == "mm" { 1e3 } else { 1.0 };
            let digits = number.split_once('.').map_or(0, |(_, digits)| digits.len());
            let half = 0.501 * 0.1_f64.powi(i32::try_from(digits).unwrap());
            let number: f64 = number.parse().unwrap_or_else(|_| panic!("{told} is no number"));
            assert!((number - value * factor).abs() <= half, "{told} stands for {at} = {value}");
        }
    }
}

fn plain(text: &str) -> String {
    text.replace("&lt;", "<").replace("&gt;", ">").replace("&quot;", "\"").replace("&amp;", "&")
}
