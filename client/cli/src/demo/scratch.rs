//! A private folder for one run of the demo: removed at the end, however the run ends.

use std::fs::DirBuilder;
use std::os::unix::fs::DirBuilderExt;
use std::path::{Path, PathBuf};

use foretrace_client::Instance;

use crate::failure::Failure;

/// The folder; dropping it removes it.
#[derive(Debug)]
pub(crate) struct Scratch(PathBuf);

impl Scratch {
    /// Below /tmp, because the paths of sockets have to be short; readable by this user alone.
    pub(crate) fn create() -> Result<Self, Failure> {
        let mut last = None;
        for attempt in 0..100 {
            let path = PathBuf::from(format!("/tmp/foretrace-demo-{}-{attempt}", std::process::id()));
            match DirBuilder::new().mode(0o700).create(&path) {
                Ok(()) => return Ok(Self(path)),
                Err(error) => last = Some(error),
            }
        }
        let why = last.map_or_else(String::new, |error| format!(": {error}"));
        Err(Failure::failed(format_args!("cannot make a folder below /tmp{why}"), "make /tmp writable"))
    }

    pub(crate) fn folder(&self) -> &Path {
        &self.0
    }

    pub(crate) fn file(&self, name: &str) -> PathBuf {
        self.0.join(name)
    }

    /// Root directory for the demo's instance.
    pub(crate) fn root(&self) -> PathBuf {
        self.0.join("root")
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

/// Dropped after all processes have ended, it removes what killed ones left in /dev/shm of a private
/// instance.
#[derive(Debug)]
pub(crate) struct PrivateFiles(pub(crate) Instance);

impl Drop for PrivateFiles {
    fn drop(&mut self) {
        let left = std::fs::read_dir("/dev/shm").into_iter().flatten().flatten();
        for entry in left.filter(|entry| entry.file_name().to_string_lossy().starts_with(self.0.prefix())) {
            let _ = std::fs::remove_file(entry.path());
        }
    }
}
