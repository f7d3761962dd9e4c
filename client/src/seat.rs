//! A publisher of which an instance has one, with the claim on its role.

use std::sync::Arc;

use foretrace_shm::{Claim, Holder, Message, Publisher, ServiceError, Topic};

use crate::attach::Leaving;

/// The publisher, until somebody asked for its role.
#[derive(Debug)]
pub(crate) struct Seat<T: Message> {
    // In the order in which they must be dropped: the role is free when its publisher is gone.
    held: Option<(Publisher<T>, Claim)>,
    handed_to: Option<Holder>,
    sent: u64,
    _leaving: Arc<Leaving>,
}

impl<T: Message> Seat<T> {
    pub(crate) fn take(claim: Claim, topic: &Topic<T>, leaving: Arc<Leaving>) -> Result<Self, ServiceError> {
        let publisher = topic.publisher()?;
        Ok(Self { held: Some((publisher, claim)), handed_to: None, sent: 0, _leaving: leaving })
    }

    /// The publisher; none once the role was handed over.
    pub(crate) fn publisher(&mut self) -> Option<&mut Publisher<T>> {
        self.held.as_mut().map(|(publisher, _)| publisher)
    }

    /// Who asks for the role at `now_ns`; looks at most ten times per second.
    pub(crate) fn asked(&mut self, now_ns: u64) -> Option<Holder> {
        self.held.as_mut().and_then(|(_, claim)| claim.asked(now_ns))
    }

    /// Drops the publisher, so that `asker` gets the role.
    pub(crate) fn hand_to(&mut self, asker: Holder) {
        self.sent = self.sent();
        self.held = None;
        self.handed_to = Some(asker);
    }

    pub(crate) fn give_way_if_asked(&mut self, now_ns: u64) {
        if let Some(asker) = self.asked(now_ns) {
            self.hand_to(asker);
        }
    }

    pub(crate) fn handed_to(&self) -> Option<&Holder> {
        self.handed_to.as_ref()
    }

    /// Messages sent so far.
    pub(crate) fn sent(&self) -> u64 {
        self.held.as_ref().map_or(self.sent, |(publisher, _)| publisher.sequence())
    }
}
