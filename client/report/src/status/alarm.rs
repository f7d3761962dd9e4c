//! `--alarm 'pen_to_command.p99_us>5000'`: a bound on a figure of the status, which ends the program when it
//! is broken.
//!
//! Contract: the figure is named as in `status --json`, with dots between keys. A figure that does not exist
//! is refused at start; an unknown value (null) breaks no bound.

use std::fmt;

use serde_json::Value;

/// How a figure is compared.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Relation {
    Above,
    AtLeast,
    Below,
    AtMost,
}

/// Longer words first, so that `>=` is not taken for `>`.
const RELATIONS: [(&str, Relation); 4] =
    [(">=", Relation::AtLeast), ("<=", Relation::AtMost), (">", Relation::Above), ("<", Relation::Below)];

#[derive(Debug, Clone, PartialEq)]
pub struct Alarm {
    text: String,
    path: Vec<String>,
    relation: Relation,
    bound: f64,
}

impl fmt::Display for Alarm {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.text)
    }
}

/// `FIGURE>NUMBER`, also `<`, `>=`, `<=`.
pub fn parse(text: &str) -> Result<Alarm, String> {
    let wrong = || "FIGURE>NUMBER with >, <, >= or <=, for example pen_to_command.p99_us>5000".to_owned();
    let (word, relation, at) = RELATIONS
        .iter()
        .find_map(|(word, relation)| text.find(word).map(|at| (*word, *relation, at)))
        .ok_or_else(wrong)?;
    let (figure, bound) = (text[..at].trim(), text[at + word.len()..].trim());
    let bound: f64 = bound.parse().map_err(|_| wrong())?;
    if figure.is_empty() || !bound.is_finite() {
        return Err(wrong());
    }
    let path: Vec<String> = figure.split('.').map(str::to_owned).collect();
    Ok(Alarm { text: format!("{figure}{word}{bound}"), path, relation, bound })
}

impl Alarm {
    /// Whether the status has such a figure at all.
    ///
    /// # Errors
    /// The keys that there are where the path ends.
    pub fn check(&self, status: &Value) -> Result<(), String> {
        let mut at = status;
        for key in &self.path {
            let Some(next) = member(at, key) else {
                let known = at.as_object().map(|keys| keys.keys().cloned().collect::<Vec<_>>().join(", "));
                let there = known.unwrap_or_else(|| "nothing".to_owned());
                return Err(format!("--alarm {self}: the status has no {key:?} there; it has {there}"));
            };
            at = next;
        }
        if at.is_object() {
            let keys = at.as_object().map(|keys| keys.keys().cloned().collect::<Vec<_>>().join(", "));
            return Err(format!("--alarm {self}: name one of {}", keys.unwrap_or_default()));
        }
        if at.is_number() || at.is_null() {
            return Ok(());
        }
        Err(format!("--alarm {self}: that is not a number"))
    }

    /// The figure, where it breaks the bound.
    pub fn broken_by(&self, status: &Value) -> Option<f64> {
        let figure = self.path.iter().try_fold(status, |at, key| member(at, key))?.as_f64()?;
        let broken = match self.relation {
            Relation::Above => figure > self.bound,
            Relation::AtLeast => figure >= self.bound,
            Relation::Below => figure < self.bound,
            Relation::AtMost => figure <= self.bound,
        };
        broken.then_some(figure)
    }
}

/// A member of an object, or an element of a list.
fn member<'a>(value: &'a Value, key: &str) -> Option<&'a Value> {
    value.get(key).or_else(|| value.get(key.parse::<usize>().ok()?))
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn a_bound_is_broken_on_its_own_side_only_and_never_by_what_is_not_known() {
        let status =
            json!({ "pen_to_command": { "p99_us": 5000.0, "max_us": null }, "mode": "idle", "list": [3] });
        let broken = |text: &str| parse(text).unwrap().broken_by(&status);
        assert_eq!(broken("pen_to_command.p99_us>4999"), Some(5000.0));
        assert_eq!(broken("pen_to_command.p99_us>5000"), None);
        assert_eq!(broken("pen_to_command.p99_us >= 5e3"), Some(5000.0));
        assert_eq!(broken("pen_to_command.p99_us<5000"), None);
        assert_eq!(broken("pen_to_command.p99_us<=5000"), Some(5000.0));
        assert_eq!(broken("pen_to_command.max_us>0"), None);
        assert_eq!(broken("list.0>2"), Some(3.0));
    }

    #[test]
    fn wrong_words_and_figures_that_are_not_there_are_refused_with_what_there_is() {
        for text in ["", "p99", "a>", ">3", "a>b", "a>nan", "a>inf"] {
            assert!(parse(text).unwrap_err().contains("FIGURE>NUMBER"), "{text}");
        }
        let status = json!({ "loop": { "overruns": 1, "rate_hz": null }, "mode": "idle" });
        let check = |text: &str| parse(text).unwrap().check(&status);
        assert_eq!(check("loop.overruns>3"), Ok(()));
        assert_eq!(check("loop.rate_hz<400"), Ok(()));
        assert!(check("loop.late>3").unwrap_err().contains("it has overruns, rate_hz"));
        assert!(check("loop>3").unwrap_err().contains("name one of overruns, rate_hz"));
        assert!(check("mode>3").unwrap_err().contains("not a number"));
    }
}
