//! From `--instance` and `--root` to an attachment, and following a daemon that goes and comes back.

use std::time::Duration;

use foretrace_client::{Foretrace, Instance, Lasting, ServiceError};
use foretrace_config::Settings;
pub(crate) use foretrace_report::failures::unattached;

use crate::failure::Failure;
use crate::output::note;
use crate::settings::InstanceArgs;

impl InstanceArgs {
    /// The instance that is meant.
    pub(crate) fn instance(&self) -> Result<Instance, Failure> {
        let number = self.instance.unwrap_or(0);
        // A root that was given has been judged on the command line, or with the settings.
        match &self.root {
            Some(root) => Instance::at(number, root),
            None => Instance::new(number),
        }
        .map_err(|error| Failure::bad_input(error, ""))
    }

    /// Attaches to its daemon, which must be up.
    pub(crate) fn attach(&self) -> Result<Foretrace, Failure> {
        attach_within(&self.instance()?, Duration::ZERO)
    }
}

/// The instance that the settings name.
pub(crate) fn instance_of(settings: &Settings) -> Result<Instance, Failure> {
    let number = Some(settings.instance.number);
    InstanceArgs { instance: number, root: settings.instance.root_dir.as_ref().map(Into::into) }.instance()
}

/// Attaches, waiting up to `wait` for the daemon.
pub(crate) fn attach_within(instance: &Instance, wait: Duration) -> Result<Foretrace, Failure> {
    Foretrace::attach_within(instance, wait).map_err(unattached)
}

/// Follows the daemon that `lasting` is attached to, and reports in the name of `who` what became of it;
/// `meanwhile` is what the program does without one.
pub(crate) fn follow<H>(
    who: &str,
    meanwhile: &str,
    lasting: &mut Lasting<H>,
    open: impl FnOnce(&Foretrace) -> Result<H, ServiceError>,
) {
    let (change, error) = lasting.look(open);
    if let Some(error) = error {
        note!("foretrace: {error}");
    }
    if let Some(words) = change.words(meanwhile) {
        note!("{who}: {words}");
    }
}
