//! The figures of the lab's experiments on the shared data sets, without times.

use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::Value;

use crate::file::Figure;

/// Each set with its experiments.
const SETS: [(&str, &[&str]); 4] = [
    ("unipen-tos", &["table1", "fig2", "closed-loop"]),
    ("unipen-ced", &["closed-loop"]),
    ("pendigits-orig", &["closed-loop"]),
    ("character-trajectories", &["closed-loop"]),
];

/// The sets that are present.
pub(crate) fn sets(shared: &Path) -> Vec<(PathBuf, &'static [&'static str])> {
    let all = SETS.iter().map(|(name, experiments)| (shared.join("data").join(name), *experiments));
    all.filter(|(path, _)| path.is_dir()).collect()
}

/// The figures of one set by this program.
pub(crate) fn of((set, experiments): &(PathBuf, &[&str])) -> Result<Vec<Figure>, String> {
    let program = std::env::current_exe().map_err(|error| error.to_string())?;
    let scratch = std::env::temp_dir().join(format!("golden-{}", std::process::id()));
    let mut figures = Vec::new();
    for experiment in *experiments {
        let mut command = Command::new(&program);
        command.args(["lab", experiment, "--data"]).arg(set).args(["--json", "-", "--out"]).arg(&scratch);
        if *experiment == "closed-loop" {
            command.args(["--limit", "2", "--predictors", "hold,mixture,dybm", "--arms", "ur5,slow"]);
        }
        let output = command.output().map_err(|error| format!("{}: {error}", program.display()))?;
        if !output.status.success() {
            return Err(format!("lab {experiment}: {}", String::from_utf8_lossy(&output.stderr)));
        }
        let value: Value = serde_json::from_slice(&output.stdout).map_err(|error| error.to_string())?;
        let name = set.file_name().unwrap_or_default().to_string_lossy();
        flatten(&format!("{name}/{experiment}"), &value, &mut figures);
    }
    let _ = std::fs::remove_dir_all(scratch);
    Ok(figures)
}

fn flatten(place: &str, value: &Value, into: &mut Vec<Figure>) {
    match value {
        Value::Number(number) => {
            let bits = number.as_f64().unwrap_or(f64::NAN).to_bits();
            into.push(Figure { place: place.to_owned(), bits });
        }
        Value::Array(list) => {
            list.iter().enumerate().for_each(|(i, value)| flatten(&format!("{place}/{i}"), value, into));
        }
        Value::Object(map) => {
            let lasting =
                map.iter().filter(|(key, _)| !key.starts_with("us_") && !key.starts_with("train_s"));
            lasting.for_each(|(key, value)| flatten(&format!("{place}/{key}"), value, into));
        }
        _ => {}
    }
}
