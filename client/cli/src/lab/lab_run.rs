//! A run of the lab that draws pictures: its folder, and run.json, which tells how to repeat it.

use std::cell::RefCell;
use std::path::{Path, PathBuf};
use std::time::{Instant, SystemTime};

use foretrace_config::Config;
use foretrace_lab::sets::{FolderSum, Sha256};
use serde::Serialize;

use super::write_text;
use crate::failure::Failure;
use crate::output::JsonArgs;
use crate::run_folder::{new_run_folder, rfc3339};

/// Where runs get folders of their own.
const BELOW: &str = "foretrace-lab";

/// A run, from its beginning.
#[derive(Debug)]
pub(super) struct LabRun {
    name: String,
    data: Vec<PathBuf>,
    began: (SystemTime, Instant),
    /// Made when something is written, so that a run without a result leaves nothing.
    folder: RefCell<Option<PathBuf>>,
}

/// Beside the pictures: what was run, and on what. Keys are stable.
#[derive(Debug, Serialize)]
struct RunRecord {
    command: Vec<String>,
    version: &'static str,
    optimised_build: bool,
    /// RFC 3339, UTC.
    started: String,
    seconds: f64,
    /// Of the settings as `foretrace config show` prints them; none where the command has no settings.
    settings_sha256: Option<String>,
    data: Vec<FolderSum>,
}

impl LabRun {
    /// Judges where results go: `out`, or a new folder named after the command, the sets and the time.
    pub(super) fn begin(
        command: &str,
        data: &[&Path],
        out: Option<&Path>,
        json: &JsonArgs,
    ) -> Result<Self, Failure> {
        match out {
            Some(out) => json.claim_beside(out)?,
            None => json.claim()?,
        }
        Ok(Self::new(command, data, out))
    }

    /// The same for the merge of shards, which may draw nothing.
    pub(super) fn begin_merge(out: Option<&Path>, json: &JsonArgs) -> Result<Self, Failure> {
        match out {
            Some(out) => json.claim_in(out)?,
            None => json.claim()?,
        }
        Ok(Self::new("merge", &[], out))
    }

    fn new(command: &str, data: &[&Path], out: Option<&Path>) -> Self {
        let data: Vec<PathBuf> = data.iter().map(|folder| (*folder).to_owned()).collect();
        let words = std::iter::once(command.to_owned()).chain(data.iter().map(|folder| set_name(folder)));
        let name = words.collect::<Vec<_>>().join("-").chars().take(100).collect();
        let folder = RefCell::new(out.map(Path::to_owned));
        Self { name, data, began: (SystemTime::now(), Instant::now()), folder }
    }

    /// The folder for pictures.
    pub(super) fn folder(&self) -> Result<PathBuf, Failure> {
        let mut folder = self.folder.borrow_mut();
        match &*folder {
            Some(folder) => Ok(folder.clone()),
            None => {
                let new = new_run_folder(Path::new(BELOW), &self.name, self.began.0)?;
                Ok(folder.insert(new).clone())
            }
        }
    }

    /// Writes run.json beside the pictures, after them.
    pub(super) fn finish(&self, settings: Option<&Config>) -> Result<(), Failure> {
        let sums = self.data.iter().map(|folder| {
            FolderSum::of(folder).map_err(|error| {
                Failure::failed(
                    format_args!("{} cannot be summed up: {error}", folder.display()),
                    "leave the recordings as they are while the lab runs",
                )
            })
        });
        let record = RunRecord {
            command: std::env::args_os().map(|word| word.to_string_lossy().into_owned()).collect(),
            version: crate::version::program(),
            optimised_build: !cfg!(debug_assertions),
            started: rfc3339(self.began.0),
            seconds: self.began.1.elapsed().as_secs_f64(),
            settings_sha256: settings.map(|config| Sha256::of(config.render().as_bytes())),
            data: sums.collect::<Result<_, _>>()?,
        };
        let text = serde_json::to_string_pretty(&record)
            .map_err(|error| Failure::failed(format_args!("run.json cannot be written: {error}"), ""))?;
        let file = self.folder()?.join("run.json");
        write_text(&file, &(text + "\n"))?;
        Ok(())
    }
}

/// The last name of a path, which `.` has too.
fn set_name(folder: &Path) -> String {
    let named = folder.file_name().map(|name| name.to_string_lossy().into_owned());
    let absolute = || Some(folder.canonicalize().ok()?.file_name()?.to_string_lossy().into_owned());
    let name = named.or_else(absolute).unwrap_or_default();
    name.chars().map(|c| if c.is_alphanumeric() || "-_.".contains(c) { c } else { '_' }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_run_is_named_after_its_command_and_sets() {
        let sets = [Path::new("data/unipen-tos"), Path::new("my set/")];
        let run = LabRun::begin("leadtime", &sets, None, &JsonArgs::default()).unwrap();
        assert_eq!(run.name, "leadtime-unipen-tos-my_set");
        let here = set_name(Path::new("."));
        assert!(!here.is_empty() && here != ".", "{here}");
    }
}
