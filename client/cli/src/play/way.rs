//! The two outputs of a player: shared memory, or the gateway of another user.

use std::path::Path;
use std::time::Duration;

use foretrace_client::{
    Claimant, FeedError, Foretrace, GatewayError, GatewayFeed, Instance, PenFeed, PenReading, Place,
};

use crate::attach::{Lookout, News, attach_within, unattached};
use crate::failure::{Cause, Failure};
use crate::output::note;
use crate::place::{TakeOver, handed_over};

/// Where readings go.
pub(super) enum Way {
    /// The shared memory of this user; outlives the daemon.
    Shared { foretrace: Box<Foretrace>, feed: Option<PenFeed>, lookout: Lookout, who: Claimant },
    /// The socket of a gateway.
    Gateway(GatewayFeed),
}

/// The outcome of a reading.
pub(super) enum Sent {
    Heard,
    Unheard,
    Failed(String),
}

impl Way {
    pub(super) fn shared(
        instance: &Instance,
        wait: Duration,
        who: Claimant,
        take_over: TakeOver,
    ) -> Result<Self, Failure> {
        let foretrace = Box::new(attach_within(instance, wait)?);
        let feed = take_over.pen(&foretrace, &who).map_err(unattached)?;
        Ok(Self::Shared { foretrace, feed: Some(feed), lookout: Lookout::new(), who })
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
    pub(super) fn send(&mut self, reading: PenReading) -> Result<Sent, Failure> {
        Ok(match self {
            Self::Shared { feed, .. } => match feed.as_mut().map(|feed| feed.send(reading)) {
                Some(Ok(true)) => Sent::Heard,
                Some(Ok(false)) | None => Sent::Unheard,
                Some(Err(FeedError::HandedOver)) => {
                    return Err(handed_over(Place::Pen, feed.as_mut().and_then(PenFeed::handed_to)));
                }
                Some(Err(error)) => Sent::Failed(error.to_string()),
            },
            Self::Gateway(feed) => match feed.send(reading) {
                Ok(()) => Sent::Heard,
                Err(GatewayError::Invalid(error)) => Sent::Failed(error.to_string()),
                Err(error) => return Err(Failure::failed(error, "play again")),
            },
        })
    }

    /// Checks whether the daemon is still up.
    pub(super) fn look(&mut self) {
        let Self::Shared { foretrace, feed, lookout, who } = self else { return };
        match lookout.look(foretrace) {
            News::None => {}
            News::Gone => note!("play: the daemon is gone; playing on"),
            News::Back => note!("play: a daemon took over"),
            News::Renewed => {
                // The old feed holds the place that the new one needs.
                *feed = None;
                match foretrace.pen_feed_as(who) {
                    Ok(new) => *feed = Some(new),
                    Err(error) => {
                        note!("{}", unattached(error));
                        lookout.again();
                    }
                }
                note!("play: a new daemon is there");
            }
        }
    }

    /// Ends the connection; returns the gateway's last line.
    pub(super) fn finish(self) -> Option<String> {
        match self {
            Self::Shared { .. } => None,
            Self::Gateway(feed) => {
                Some(feed.finish().unwrap_or_else(|error| format!("no last word of the gateway: {error}")))
            }
        }
    }
}
