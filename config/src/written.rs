//! A settings file as written: TOML parsed into nodes that remember where they stand.
//!
//! Contract: only the syntax is checked here. Every value, also inside an array, keeps its source, line and
//! text, so that later checks can point at it. No panic on any input.

use std::collections::BTreeSet;
use std::fmt;
use std::sync::Arc;

use toml::Spanned;
use toml::de::{DeTable, DeValue};

use crate::files::shortened_path;
use crate::problem::{Problem, ProblemKind, ValueFlaw};

/// Where a value comes from.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum SettingOrigin {
    /// A line of a settings file, counted from 1; line 0 is the file as a whole.
    File {
        /// Path as the user gave it.
        path: Arc<str>,
        /// Line, from 1.
        line: usize,
    },
    /// A line of an embedded preset.
    Preset {
        /// Name of the preset.
        name: Arc<str>,
        /// Line, from 1.
        line: usize,
    },
    /// The built-in default of the key.
    Default,
    /// Given by the caller (a command line option) on top of the file.
    Override,
}

impl fmt::Display for SettingOrigin {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::File { path, line: 0 } => write!(f, "{path}"),
            Self::File { path, line } => write!(f, "{path}:{line}"),
            Self::Preset { name, line: 0 } => write!(f, "preset {name}"),
            Self::Preset { name, line } => write!(f, "preset {name}:{line}"),
            Self::Default => f.write_str("default"),
            Self::Override => f.write_str("command line"),
        }
    }
}

/// One value as written.
#[derive(Debug, Clone)]
pub(crate) struct Node {
    pub(crate) raw: Raw,
    pub(crate) origin: SettingOrigin,
    /// The text in the file, on one line, shortened.
    pub(crate) text: String,
}

impl Node {
    /// The problem that this value of `key` is.
    pub(crate) fn flawed(&self, key: &str, flaw: ValueFlaw) -> Problem {
        let (key, value) = (key.to_owned(), self.text.clone());
        Problem::new(&self.origin, ProblemKind::Value { key, value, flaw })
    }
}

/// The kinds of values that TOML knows, as far as settings use them.
#[derive(Debug, Clone)]
pub(crate) enum Raw {
    Text(String),
    Whole(i64),
    Real(f64),
    Flag(bool),
    List(Vec<Node>),
    Table(Vec<(String, Node)>),
    /// A kind that no key takes, in words.
    Other(&'static str),
}

impl Raw {
    /// The kind in words, for an error text.
    pub(crate) fn kind(&self) -> &'static str {
        match self {
            Self::Text(_) => "text",
            Self::Whole(_) => "a whole number",
            Self::Real(_) => "a number",
            Self::Flag(_) => "true/false",
            Self::List(_) => "a list",
            Self::Table(_) => "a section",
            Self::Other(what) => what,
        }
    }
}

/// Largest number of lines with syntax errors that are reported one by one: an open bracket makes all that
/// follow wrong.
const SYNTAX_ERRORS: usize = 8;

/// Parses TOML `text` into the entries of its root table; `origin` is the source as a whole (line 0).
///
/// # Errors
///
/// Every syntax error that the parser can recover from is pushed to `problems`; what could be read
/// is still returned, so that the settings in it are judged in the same go.
pub(crate) fn parse(text: &str, origin: &SettingOrigin, problems: &mut Vec<Problem>) -> Vec<(String, Node)> {
    let lines = Lines::new(text);
    let (root, errors) = DeTable::parse_recoverable(text);
    let mut reported: BTreeSet<usize> = BTreeSet::new();
    let mut next = None;
    for error in &errors {
        let line = error.span().map_or(0, |span| lines.line(span.start));
        // The parser repeats itself at every level of nesting, and where a bracket is missing on every line
        // that follows.
        if !reported.insert(line) {
            continue;
        }
        if reported.len() <= SYNTAX_ERRORS {
            let what = error.message().split_whitespace().collect::<Vec<_>>().join(" ");
            problems.push(Problem::new(&at_line(origin, line), ProblemKind::Syntax(what)));
        } else {
            next = next.or(Some(line));
        }
    }
    if let Some(line) = next {
        let what = format!(
            "from here on {} more lines cannot be read, probably because of those above",
            reported.len() - SYNTAX_ERRORS
        );
        problems.push(Problem::new(&at_line(origin, line), ProblemKind::Syntax(what)));
    }
    // A broken line leaves half-read values: checking them would hide the cause among its consequences.
    if errors.is_empty() { entries(root.get_ref(), &lines, origin) } else { Vec::new() }
}

fn entries(table: &DeTable<'_>, lines: &Lines<'_>, origin: &SettingOrigin) -> Vec<(String, Node)> {
    let mut all: Vec<(usize, String, Node)> = table
        .iter()
        .map(|(key, value)| {
            (key.span().start, key.get_ref().to_string(), node(key.span().start, value, lines, origin))
        })
        .collect();
    all.sort_by_key(|entry| entry.0);
    all.into_iter().map(|(_, key, node)| (key, node)).collect()
}

fn node(start: usize, value: &Spanned<DeValue<'_>>, lines: &Lines<'_>, origin: &SettingOrigin) -> Node {
    let raw = match value.get_ref() {
        DeValue::String(text) => Raw::Text(text.to_string()),
        DeValue::Integer(number) => i64::from_str_radix(number.as_str(), number.radix())
            .map_or(Raw::Other("a whole number beyond 64 bits"), Raw::Whole),
        DeValue::Float(number) => number.as_str().parse().map_or(Raw::Other("a number"), Raw::Real),
        DeValue::Boolean(flag) => Raw::Flag(*flag),
        DeValue::Datetime(_) => Raw::Other("a date"),
        DeValue::Array(list) => {
            Raw::List(list.iter().map(|element| node(element.span().start, element, lines, origin)).collect())
        }
        DeValue::Table(table) => Raw::Table(entries(table, lines, origin)),
    };
    Node { raw, origin: at_line(origin, lines.line(start)), text: lines.shortened(value.span()) }
}

fn at_line(origin: &SettingOrigin, line: usize) -> SettingOrigin {
    match origin {
        SettingOrigin::File { path, .. } => SettingOrigin::File { path: path.clone(), line },
        SettingOrigin::Preset { name, .. } => SettingOrigin::Preset { name: name.clone(), line },
        SettingOrigin::Default => SettingOrigin::Default,
        SettingOrigin::Override => SettingOrigin::Override,
    }
}

/// Byte offsets to line numbers.
struct Lines<'a> {
    text: &'a str,
    starts: Vec<usize>,
}

impl<'a> Lines<'a> {
    fn new(text: &'a str) -> Self {
        let starts = std::iter::once(0).chain(text.match_indices('\n').map(|(i, _)| i + 1)).collect();
        Self { text, starts }
    }

    fn line(&self, offset: usize) -> usize {
        self.starts.partition_point(|&start| start <= offset)
    }

    fn shortened(&self, span: std::ops::Range<usize>) -> String {
        const LONGEST: usize = 60;
        let written = self.text.get(span).unwrap_or_default();
        let flat = written.split_whitespace().collect::<Vec<_>>().join(" ");
        if flat.chars().count() <= LONGEST {
            flat
        } else if flat.starts_with(['"', '\'']) && flat.contains('/') {
            // The end of a path tells more than its beginning.
            shortened_path(&flat, LONGEST)
        } else {
            flat.chars().take(LONGEST - 3).chain("...".chars()).collect()
        }
    }
}
