//! Rows of a bench's JSON: every place with a `p50`, named by the way to it.

use std::collections::BTreeMap;

use foretrace_failure::Failure;
use serde_json::Value;

use super::child::cut;

/// What one program measured in one round.
#[derive(Debug, Default)]
pub(super) struct BenchCell {
    /// Medians by row \[µs\].
    rows: BTreeMap<String, f64>,
    quick_build: bool,
}

impl BenchCell {
    /// Adds what a process printed; `place` says which. Steps of its plans and instances per row.
    pub(super) fn take_in(&mut self, printed: &str, place: &str) -> Result<[u64; 2], Failure> {
        let wrong = |why: &str| {
            let what = format!("{place}: it printed no result of a bench ({why}): {:?}", cut(printed.trim()));
            Failure::bad_input(what, "compare with a foretrace whose `bench --json -` prints one")
        };
        let report: Value = serde_json::from_str(printed).map_err(|error| wrong(&error.to_string()))?;
        let number =
            |key: &str| report.get(key).and_then(Value::as_u64).ok_or_else(|| wrong(&format!("no {key}")));
        let problem = [number("horizon")?, number("samples")?];
        let optimised = report.get("optimised_build").and_then(Value::as_bool);
        self.quick_build |= !optimised.ok_or_else(|| wrong("no optimised_build"))?;
        let before = self.rows.len();
        collect("", &report, &mut self.rows);
        if self.rows.len() == before {
            return Err(wrong("no row with a p50"));
        }
        Ok(problem)
    }

    pub(super) const fn rows(&self) -> &BTreeMap<String, f64> {
        &self.rows
    }

    pub(super) const fn optimised(&self) -> bool {
        !self.quick_build
    }
}

/// Adds every row below `value`. A median that is no positive number is none: nothing of that kind occurred.
fn collect(name: &str, value: &Value, rows: &mut BTreeMap<String, f64>) {
    let below = |key: &str| if name.is_empty() { key.to_owned() } else { format!("{name}.{key}") };
    match value {
        Value::Object(entries) => {
            let median = entries.get("p50").and_then(Value::as_f64);
            rows.extend(median.filter(|median| *median > 0.0).map(|median| (name.to_owned(), median)));
            entries.iter().for_each(|(key, value)| collect(&below(key), value, rows));
        }
        Value::Array(entries) => {
            for (index, entry) in entries.iter().enumerate() {
                let word = |key: &str| entry.get(key).and_then(Value::as_str).map(str::to_owned);
                let label = word("predictor").or_else(|| word("name")).unwrap_or_else(|| index.to_string());
                let label = match entry.get("steps").and_then(Value::as_u64) {
                    Some(0) => format!("{label}, learn"),
                    Some(steps) => format!("{label}, {steps} steps"),
                    None => label,
                };
                collect(&below(&label), entry, rows);
            }
        }
        _ => {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn taken(text: &str) -> Result<(BenchCell, [u64; 2]), Failure> {
        let mut cell = BenchCell::default();
        cell.take_in(text, "p, round 1, part plan").map(|problem| (cell, problem))
    }

    #[test]
    fn every_median_is_a_row_named_by_the_way_to_it() {
        let (cell, problem) = taken(
            r#"{"horizon": 20, "samples": 50, "optimised_build": true, "clock_us": 0.02,
            "ik_us": {"exact": {"p50": 1.5, "p99": 2}, "clarabel": {"p50": 20, "p99": 30}},
            "step_by_predictor_us": [{"predictor": "dybm", "any": {"p50": 3, "p99": 4}, "new_weights": {"p50": null, "p99": null}}],
            "predictors_us": [{"name": "lstm32", "steps": 10, "p50": 5, "p99": 6}, {"name": "dybm", "steps": 0, "p50": 7, "p99": 8}]}"#,
        )
        .unwrap();
        let rows: Vec<(&str, f64)> = cell.rows().iter().map(|(name, us)| (name.as_str(), *us)).collect();
        assert_eq!(
            rows,
            [
                ("ik_us.clarabel", 20.0),
                ("ik_us.exact", 1.5),
                ("predictors_us.dybm, learn", 7.0),
                ("predictors_us.lstm32, 10 steps", 5.0),
                ("step_by_predictor_us.dybm.any", 3.0),
            ]
        );
        assert_eq!((problem, cell.optimised()), ([20, 50], true));
    }

    #[test]
    fn anything_else_is_refused_with_the_place_and_what_was_printed() {
        let cases = [
            ("", "EOF"),
            ("hello", "expected value"),
            ("[]", "no horizon"),
            (r#"{"horizon": 20}"#, "no samples"),
            (r#"{"horizon": 20, "samples": 50}"#, "no optimised_build"),
            (r#"{"horizon": 20, "samples": 50, "optimised_build": true}"#, "no row"),
            (r#"{"horizon": 20, "samples": 50, "optimised_build": true, "ik_us": {"p50": 0}}"#, "no row"),
        ];
        for (text, why) in cases {
            let told = taken(text).unwrap_err().to_string();
            assert!(told.starts_with("p, round 1, part plan: ") && told.contains(why), "{told}");
        }
    }
}
