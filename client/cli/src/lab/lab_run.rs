//! A run of the lab that draws pictures: its folder, and run.json, which tells how to repeat it.

use std::cell::RefCell;
use std::path::{Path, PathBuf};
use std::time::{Instant, SystemTime};

use foretrace_config::Config;
use foretrace_host::calendar::UtcMoment;
use foretrace_host::sha256::Sha256;
use foretrace_lab::sets::FolderSum;
use serde::Serialize;

use super::write_text;
use crate::failure::Failure;
use crate::output::{JsonArgs, note};
use crate::run_folder::{new_run_folder, try_folder};

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
    /// Where the command line's relative paths begin.
    cwd: Option<PathBuf>,
    version: &'static str,
    optimised_build: bool,
    /// RFC 3339, UTC.
    started: String,
    seconds: f64,
    /// Of the settings as `foretrace config show` prints them; none where the command has no settings.
    settings_sha256: Option<String>,
    /// Of their values alone, without where files lie: the merge of a run's shards has the same.
    settings_values_sha256: Option<String>,
    /// What was read: folders of recordings, or files of shards.
    data: Vec<DataSum>,
}

/// A [`FolderSum`], or nothing but the name of what could not be summed up.
#[derive(Debug, Serialize)]
struct DataSum {
    folder: PathBuf,
    files: Option<usize>,
    sha256: Option<String>,
}

impl DataSum {
    /// The result is there by now: what became of its data costs a note, not the result.
    fn of(folder: &Path) -> Self {
        match FolderSum::of(folder) {
            Ok(FolderSum { folder, files, sha256 }) => {
                Self { folder, files: Some(files), sha256: Some(sha256) }
            }
            Err(error) => {
                note!("lab: {} has no sum in run.json: it cannot be read: {error}", folder.display());
                Self { folder: folder.to_owned(), files: None, sha256: None }
            }
        }
    }
}

/// Sums of the settings, as far as a run has them.
#[derive(Debug, Default)]
pub(super) struct SettingsSums {
    shown: Option<String>,
    values: Option<String>,
}

impl SettingsSums {
    pub(super) fn of(config: &Config) -> Self {
        let values = Self::of_values(&config.meaning());
        Self { shown: Some(Sha256::of(config.render().as_bytes())), ..values }
    }

    /// Of what shards keep: the settings in force without where they lie.
    pub(super) fn of_values(meaning: &str) -> Self {
        Self { shown: None, values: Some(Sha256::of(meaning.as_bytes())) }
    }
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
    pub(super) fn begin_merge(
        files: &[PathBuf],
        out: Option<&Path>,
        json: &JsonArgs,
    ) -> Result<Self, Failure> {
        match out {
            Some(out) => json.claim_in(out)?,
            None => json.claim()?,
        }
        Ok(Self { data: files.to_vec(), ..Self::new("merge", &[], out) })
    }

    fn new(command: &str, data: &[&Path], out: Option<&Path>) -> Self {
        let data: Vec<PathBuf> = data.iter().map(|folder| (*folder).to_owned()).collect();
        let words = std::iter::once(command.to_owned()).chain(data.iter().map(|folder| set_name(folder)));
        let name = words.collect::<Vec<_>>().join("-").chars().take(100).collect();
        let folder = RefCell::new(out.map(Path::to_owned));
        Self { name, data, began: (SystemTime::now(), Instant::now()), folder }
    }

    /// Refuses a place for pictures that cannot be written: before the work, not after hours of it.
    pub(super) fn try_folder(&self) -> Result<(), Failure> {
        try_folder(self.folder.borrow().as_deref().unwrap_or(Path::new(BELOW)), self.began.0)
    }

    /// Writes the result, whatever becomes of pictures; returns the folder for these.
    pub(super) fn keep<T: Serialize>(&self, json: &JsonArgs, result: &T) -> Result<PathBuf, Failure> {
        // The result may be meant for that folder.
        let folder = self.folder();
        json.write(result)?;
        folder
    }

    /// The folder for pictures, which is there.
    fn folder(&self) -> Result<PathBuf, Failure> {
        let mut folder = self.folder.borrow_mut();
        match &*folder {
            Some(folder) => match std::fs::create_dir_all(folder) {
                Ok(()) => Ok(folder.clone()),
                Err(error) => {
                    let what = format!("the folder {} cannot be made: {error}", folder.display());
                    Err(Failure::bad_input(what, "give a folder that you may write to (--out DIR)"))
                }
            },
            None => {
                let new = new_run_folder(Path::new(BELOW), &self.name, self.began.0)?;
                Ok(folder.insert(new).clone())
            }
        }
    }

    /// Writes run.json beside the pictures, after them.
    pub(super) fn finish(&self, settings: SettingsSums) -> Result<(), Failure> {
        let record = RunRecord {
            command: std::env::args_os().map(|word| word.to_string_lossy().into_owned()).collect(),
            cwd: std::env::current_dir().ok(),
            version: crate::version::program(),
            optimised_build: !cfg!(debug_assertions),
            started: UtcMoment::of(self.began.0).rfc3339(),
            seconds: self.began.1.elapsed().as_secs_f64(),
            settings_sha256: settings.shown,
            settings_values_sha256: settings.values,
            data: self.data.iter().map(|folder| DataSum::of(folder)).collect(),
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

    #[test]
    fn data_that_went_away_cost_a_sum_and_not_the_run() {
        let folder = tempfile::tempdir().unwrap();
        let (out, gone) = (folder.path().join("out"), folder.path().join("gone"));
        let there = folder.path().join("there");
        std::fs::write(&there, "1").unwrap();
        let run = LabRun::begin("leadtime", &[&gone, &there], Some(&out), &JsonArgs::default()).unwrap();
        run.finish(SettingsSums::of_values("a = 1\n")).unwrap();
        let text = std::fs::read_to_string(out.join("run.json")).unwrap();
        let record: serde_json::Value = serde_json::from_str(&text).unwrap();
        assert!(record["data"][0]["files"].is_null() && record["data"][0]["sha256"].is_null(), "{text}");
        assert_eq!((&record["data"][1]["files"], record["data"][1]["sha256"].is_string()), (&1.into(), true));
        assert!(record["settings_sha256"].is_null() && record["settings_values_sha256"].is_string());
        assert!(record["cwd"].is_string(), "{text}");
    }

    #[test]
    fn a_place_that_cannot_be_written_is_refused_and_trying_leaves_nothing() {
        let below = tempfile::tempdir().unwrap();
        let begin = |out: &Path| LabRun::begin("law", &[], Some(out), &JsonArgs::default()).unwrap();
        let deep = below.path().join("a/b");
        begin(&deep).try_folder().unwrap();
        begin(below.path()).try_folder().unwrap();
        assert_eq!(std::fs::read_dir(below.path()).unwrap().count(), 0);
        let file = below.path().join("file");
        std::fs::write(&file, "").unwrap();
        let told = begin(&file.join("out")).try_folder().unwrap_err().to_string();
        assert!(told.contains("file") && told.contains("--out DIR"), "{told}");
    }
}
