//! From `--instance` and `--root` to an attachment, and from the client's errors to exit codes.

use std::time::{Duration, Instant};

use foretrace_client::{Attachment, Foretrace, Instance, ServiceError};
use foretrace_config::Settings;

use crate::failure::{Cause, Failure};
use crate::settings::InstanceArgs;

/// How often a program that stays looks whether its daemon is still there.
const LOOK_EVERY: Duration = Duration::from_millis(250);

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

/// Translates an error of a service into a message with a remedy.
pub(crate) fn unattached(error: ServiceError) -> Failure {
    let cause = match error {
        ServiceError::NoDaemon { .. } => Cause::NoDaemon,
        _ => Cause::Failed,
    };
    Failure::new(cause, error, "")
}

/// What a source has to say, for people.
pub(crate) fn news(news: foretrace_live::source::News) -> String {
    use foretrace_live::source::News as Told;
    match news {
        Told::Gone => "the daemon is gone; waiting for another".to_owned(),
        Told::Back => "a daemon took over".to_owned(),
        Told::Renewed => "a new daemon is there".to_owned(),
        Told::Elsewhere => "the relay is gone; listening goes on without it".to_owned(),
        Told::Deaf(error) => format!("not all comes, and it is tried again: {error}"),
    }
}

/// Watches the daemon for programs that outlive it.
#[derive(Debug)]
pub(crate) struct Lookout {
    next: Instant,
    away: bool,
    /// New handles could not be made yet.
    again: bool,
}

/// What changed since the last look.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum News {
    /// Nothing.
    None,
    /// The daemon is gone.
    Gone,
    /// A daemon is back, and the handles work on.
    Back,
    /// A daemon is back, and all handles must be recreated.
    Renewed,
}

impl Lookout {
    pub(crate) fn new() -> Self {
        Self { next: Instant::now() + LOOK_EVERY, away: false, again: false }
    }

    /// The new handles could not be made: the next look reports it again.
    pub(crate) fn again(&mut self) {
        self.again = true;
    }

    /// Looks, at most four times per second; re-attaches where that is needed and possible.
    pub(crate) fn look(&mut self, foretrace: &mut Foretrace) -> News {
        let now = Instant::now();
        if now < self.next {
            return News::None;
        }
        self.next = now + LOOK_EVERY;
        match foretrace.reattach_if_needed() {
            Ok(found) if found == Attachment::Renewed || self.again => {
                (self.away, self.again) = (false, false);
                News::Renewed
            }
            Ok(found) => {
                let back = self.away || found == Attachment::TakenOver;
                self.away = false;
                if back { News::Back } else { News::None }
            }
            // The obstacle may be transient: keep looking.
            Err(_) if self.away => News::None,
            Err(_) => {
                self.away = true;
                News::Gone
            }
        }
    }
}
