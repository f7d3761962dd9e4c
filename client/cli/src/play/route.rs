//! The two outputs of a player: shared memory, or the gateway of another user.

use std::path::Path;
use std::time::Duration;

use foretrace_client::{
    Claimant, FeedError, GatewayError, GatewayFeed, Instance, Lasting, PenFeed, PenReading, Place,
};

use crate::attach::{attach_within, follow, unattached};
use crate::failure::{Cause, Failure};
use crate::take_over::{TakeOver, handed_over};

pub(super) enum PenRoute {
    /// The shared memory of this user; outlives the daemon.
    Shared(Box<Lasting<PenFeed>>, Claimant),
    /// The socket of a gateway.
    Gateway(GatewayFeed),
}

/// The outcome of a reading.
pub(super) enum SendOutcome {
    Heard,
    Unheard,
    Failed(String),
}

impl PenRoute {
    pub(super) fn shared(
        instance: &Instance,
        wait: Duration,
        who: Claimant,
        take_over: TakeOver,
    ) -> Result<Self, Failure> {
        let foretrace = attach_within(instance, wait)?;
        let feed = take_over.pen(&foretrace, &who).map_err(unattached)?;
        Ok(Self::Shared(Box::new(Lasting::new(foretrace, feed)), who))
    }

    pub(super) fn gateway(path: &Path) -> Result<Self, Failure> {
        GatewayFeed::connect(path).map(Self::Gateway).map_err(|error| {
            let cause = match error {
                GatewayError::Refused(_) => Cause::Refused,
                _ => Cause::Failed,
            };
            Failure::new(cause, error, "")
        })
    }

    /// Sends one reading.
    ///
    /// # Errors
    ///
    /// The gateway ended the connection, or somebody took the pen over.
    pub(super) fn send(&mut self, reading: PenReading) -> Result<SendOutcome, Failure> {
        Ok(match self {
            Self::Shared(lasting, _) => match lasting.handle.as_mut().map(|feed| feed.send(reading)) {
                Some(Ok(true)) => SendOutcome::Heard,
                Some(Ok(false)) | None => SendOutcome::Unheard,
                Some(Err(FeedError::HandedOver)) => {
                    return Err(handed_over(
                        Place::Pen,
                        lasting.handle.as_mut().and_then(PenFeed::handed_to),
                    ));
                }
                Some(Err(error)) => SendOutcome::Failed(error.to_string()),
            },
            Self::Gateway(feed) => match feed.send(reading) {
                Ok(()) => SendOutcome::Heard,
                Err(GatewayError::Invalid(error)) => SendOutcome::Failed(error.to_string()),
                Err(error) => return Err(Failure::failed(error, "play again")),
            },
        })
    }

    /// Checks whether the daemon is still up.
    pub(super) fn look(&mut self) {
        if let Self::Shared(lasting, who) = self {
            follow("play", "playing on", lasting, |foretrace| foretrace.pen_feed_as(who));
        }
    }

    /// Ends the connection; returns the gateway's last line.
    pub(super) fn finish(self) -> Option<String> {
        match self {
            Self::Shared(..) => None,
            Self::Gateway(feed) => {
                Some(feed.finish().unwrap_or_else(|error| format!("no last word of the gateway: {error}")))
            }
        }
    }
}
