//! `KeptHandle`: a handle that outlives the daemon, and why it could not be opened again.

use std::fmt::Display;

use foretrace_client::{DaemonChange, Foretrace, Lasting, ServiceError};

use super::failure::{FailureKind, LiveFailure};

pub struct KeptHandle<H> {
    lasting: Lasting<H>,
    /// Of the newest attempt to open it again, while it is not open.
    failure: Option<LiveFailure>,
}

impl<H> KeptHandle<H> {
    pub fn new(foretrace: Foretrace, handle: H) -> Self {
        Self { lasting: Lasting::new(foretrace, handle), failure: None }
    }

    /// None while it could not be opened again.
    pub fn handle(&mut self) -> Option<&mut H> {
        self.lasting.handle.as_mut()
    }

    /// Looks for a new daemon, a few times per second, and opens the handle again where there is one.
    pub fn look(&mut self, open: impl FnOnce(&Foretrace) -> Result<H, ServiceError>) -> DaemonChange {
        let (change, error) = self.lasting.look(open);
        if let Some(error) = error {
            self.failure = Some(error.into());
        } else if change == DaemonChange::Gone || self.lasting.handle.is_some() {
            self.failure = None;
        }
        change
    }

    /// The handle, or why there is none; `name` has no daemon if that is not known.
    pub fn open(&mut self, name: impl Display) -> Result<&mut H, LiveFailure> {
        let Some(handle) = &mut self.lasting.handle else {
            return Err(self.failure.clone().unwrap_or_else(|| {
                let text = format!("{name} has no daemon: start one, or wait for it, and try again");
                LiveFailure::new(FailureKind::NoDaemon, text)
            }));
        };
        Ok(handle)
    }

    /// Why nothing comes of it, where waiting does not help: another program has the place, or the daemon is
    /// of another version.
    pub fn lasting_failure(&self) -> Option<LiveFailure> {
        self.failure.clone().filter(LiveFailure::lasts)
    }
}
