//! Handles that outlive the daemon, for programs that stay.

use std::time::{Duration, Instant};

use crate::{Attachment, Foretrace};

/// How often a program that stays looks whether its daemon is still there.
const LOOK_EVERY: Duration = Duration::from_millis(250);

/// What became of the daemon since the last look.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DaemonChange {
    /// Nothing, or it was too early to look again.
    None,
    /// The daemon is gone.
    Gone,
    /// A daemon is back, and the handles work on.
    Back,
    /// A daemon is back, and all handles must be made again.
    Renewed,
}

/// Watches the daemon for programs that outlive it.
#[derive(Debug)]
pub struct Lookout {
    next: Instant,
    away: bool,
    /// New handles could not be made yet.
    again: bool,
}

impl Default for Lookout {
    fn default() -> Self {
        Self { next: Instant::now() + LOOK_EVERY, away: false, again: false }
    }
}

impl Lookout {
    /// The new handles could not be made: the next look reports it again.
    pub fn again(&mut self) {
        self.again = true;
    }

    /// Looks, at most four times per second; re-attaches where that is needed and possible.
    pub fn look(&mut self, foretrace: &mut Foretrace) -> DaemonChange {
        let now = Instant::now();
        if now < self.next {
            return DaemonChange::None;
        }
        self.next = now + LOOK_EVERY;
        match foretrace.reattach_if_needed() {
            Ok(found) if found == Attachment::Renewed || self.again => {
                (self.away, self.again) = (false, false);
                DaemonChange::Renewed
            }
            Ok(found) => {
                let back = self.away || found == Attachment::TakenOver;
                self.away = false;
                if back { DaemonChange::Back } else { DaemonChange::None }
            }
            // The obstacle may be transient: keep looking.
            Err(_) if self.away => DaemonChange::None,
            Err(_) => {
                self.away = true;
                DaemonChange::Gone
            }
        }
    }
}

/// A handle, and the attachment that makes it again after every daemon that made its services anew.
#[derive(Debug)]
pub struct Lasting<H> {
    foretrace: Foretrace,
    lookout: Lookout,
    /// None while it could not be made.
    pub handle: Option<H>,
}

impl<H> Lasting<H> {
    /// A handle that `foretrace` has made.
    pub fn new(foretrace: Foretrace, handle: H) -> Self {
        Self { foretrace, lookout: Lookout::default(), handle: Some(handle) }
    }

    /// Looks, a few times per second, whether the daemon is gone, back or another; makes the handle again by
    /// `open` where that is needed, as [`Lasting::open_again`].
    pub fn look<E>(&mut self, open: impl FnOnce(&Foretrace) -> Result<H, E>) -> (DaemonChange, Option<E>) {
        let change = self.lookout.look(&mut self.foretrace);
        let error = if change == DaemonChange::Renewed { self.open_again(open) } else { None };
        (change, error)
    }

    /// Makes the handle again by `open`. The error says why it could not; then the next look tries again.
    pub fn open_again<E>(&mut self, open: impl FnOnce(&Foretrace) -> Result<H, E>) -> Option<E> {
        // The old handle holds the slot that the new one needs.
        self.handle = None;
        match open(&self.foretrace) {
            Ok(handle) => {
                self.handle = Some(handle);
                None
            }
            Err(error) => {
                self.lookout.again();
                Some(error)
            }
        }
    }
}

impl DaemonChange {
    /// In words; `meanwhile` is what the program does without a daemon. None where nothing changed.
    pub fn words(self, meanwhile: &str) -> Option<String> {
        match self {
            Self::None => None,
            Self::Gone => Some(format!("the daemon is gone; {meanwhile}")),
            Self::Back => Some("a daemon took over".to_owned()),
            Self::Renewed => Some("a new daemon is there".to_owned()),
        }
    }
}
