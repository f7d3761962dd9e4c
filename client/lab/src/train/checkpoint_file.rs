//! The checkpoint beside a model under training.

use std::path::{Path, PathBuf};

use foretrace_failure::Failure;

use super::checkpoint;
use super::fit::TrainState;

/// Where a training goes on from.
pub(crate) struct CheckpointFile {
    file: PathBuf,
    out: PathBuf,
    plan: String,
    resume: bool,
}

impl CheckpointFile {
    /// Of the training described by `plan`, beside the model that it will become.
    pub(crate) fn beside(out: &Path, plan: String, resume: bool) -> Result<Self, Failure> {
        let folder = out.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
        if out.file_name().is_none() || out.is_dir() || !folder.is_dir() {
            let what = format!("{} is not a file in a folder that exists", out.display());
            return Err(Failure::bad_input(what, "give --out FILE.safetensors in an existing folder"));
        }
        let mut name = out.file_name().unwrap_or_default().to_os_string();
        name.push(".checkpoint");
        Ok(Self { file: out.with_file_name(name), out: out.to_owned(), plan, resume })
    }

    /// The state to go on from, if asked for; the training has `count` parameters.
    pub(crate) fn continued(&self, count: usize, tell: &dyn Fn(&str)) -> Result<Option<TrainState>, Failure> {
        let there = self.file.exists();
        if !self.resume {
            if there {
                tell(&format!("lab: {} of an earlier training will be overwritten", self.file.display()));
            }
            return Ok(None);
        }
        if !there && self.out.exists() {
            let what = format!("{} is finished, there is nothing to continue", self.out.display());
            return Err(Failure::bad_input(what, "train anew without --resume"));
        }
        if !there {
            tell(&format!("lab: no {} yet, starting from the beginning", self.file.display()));
            return Ok(None);
        }
        let state =
            checkpoint::load(&self.file, &self.plan, count).map_err(|error| Failure::bad_input(error, ""))?;
        tell(&format!("lab: continuing after epoch {}", state.history.len()));
        Ok(Some(state))
    }

    /// Writes `state` whole.
    pub(crate) fn save(&self, state: &TrainState) -> Result<(), Failure> {
        checkpoint::save(&self.file, &self.plan, state).map_err(|error| {
            let epochs = state.history.len().saturating_sub(1);
            let remedy = "make room, or give --out in a writable folder";
            if epochs > 0 && self.file.exists() {
                let kept = self.file.display();
                let remedy = format!(
                    "{remedy}; the first {epochs} epochs are saved in {kept}: --resume goes on from there"
                );
                return Failure::failed(error, remedy);
            }
            Failure::failed(error, remedy)
        })
    }

    /// Where it stands.
    pub(crate) fn file(&self) -> &Path {
        &self.file
    }

    /// The model is there.
    pub(crate) fn remove(&self) {
        // A left-over is only untidy: the model is there.
        let _ = std::fs::remove_file(&self.file);
    }
}
