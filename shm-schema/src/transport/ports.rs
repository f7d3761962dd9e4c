//! Publisher and subscriber of one message type, suitable for the real-time thread.
//!
//! Contract: after the ports have connected, neither `publish` nor `take` allocates, blocks or loops without
//! bound. A message is copied out once and the copy is checked: header first, then every field. Ports stay in
//! the thread that made them.

use iceoryx2::port::publisher::PublisherCreateError;
use iceoryx2::port::subscriber::SubscriberCreateError;
use iceoryx2::port::update_connections::UpdateConnections;
use iceoryx2::port::{LoanError, SendError};
use iceoryx2::prelude::{BackpressureStrategy, CallbackProgression, PortFactory, ipc};

use super::session::ServiceError;
use super::topic::{Message, Topic};
use crate::wire::check::{Rejection, Rejections};
use crate::wire::clock::{host_boot_id, monotonic_now_ns};
use crate::wire::header::{Header, HeaderBounds, HeaderCheck};
use crate::wire::layout::Wire;

/// Why a message was not sent.
#[derive(Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum PublishError {
    /// No free slot in the publisher's segment.
    #[error("no shared memory left for the message")]
    NoMemory,
    /// A subscriber could not be connected; the others got the message or will get the next.
    #[error("a subscriber could not be connected")]
    Connection,
    /// Another error of the middleware.
    #[error("the middleware failed to deliver")]
    Middleware,
}

crate::debug_as_display!(PublishError);

/// Sends messages of one type.
#[derive(Debug)]
pub struct Publisher<T: Message> {
    topic: Topic<T>,
    port: iceoryx2::port::publisher::Publisher<ipc::Service, T, ()>,
    sequence: u64,
    boot_id: u64,
}

impl<T: Message> Topic<T> {
    /// A publisher, to be used in the calling thread.
    ///
    /// # Errors
    ///
    /// `NoSlot` if another one exists, `Middleware`.
    pub fn publisher(&self) -> Result<Publisher<T>, ServiceError> {
        let port = self
            .factory
            .publisher_builder()
            .max_loaned_samples(1)
            .backpressure_strategy(BackpressureStrategy::DiscardData)
            .create()
            .map_err(|error| match error {
                PublisherCreateError::ExceedsMaxSupportedPublishers => ServiceError::NoSlot {
                    service: T::SERVICE,
                    what: "publisher",
                    limit: T::QOS.publishers,
                    pids: self.publishers(),
                },
                other => ServiceError::Middleware { service: T::SERVICE, detail: other.to_string() },
            })?;
        Ok(Publisher { topic: self.clone(), port, sequence: 0, boot_id: host_boot_id() })
    }

    /// A subscriber with up to `buffer` unread messages, to be used in the calling thread. Of earlier
    /// messages it gets only the topic's history.
    ///
    /// # Errors
    ///
    /// `NoSlot`, `BufferSize`, `Middleware`.
    pub fn subscriber(&self, buffer: usize, bounds: HeaderBounds) -> Result<Subscriber<T>, ServiceError> {
        if buffer == 0 || buffer > T::QOS.buffer {
            return Err(ServiceError::BufferSize {
                service: T::SERVICE,
                asked: buffer,
                limit: T::QOS.buffer,
            });
        }
        let port =
            self.factory.subscriber_builder().buffer_size(buffer).create().map_err(|error| match error {
                SubscriberCreateError::ExceedsMaxSupportedSubscribers => ServiceError::NoSlot {
                    service: T::SERVICE,
                    what: "subscriber",
                    limit: T::QOS.subscribers,
                    pids: self.subscribers(),
                },
                other => ServiceError::Middleware { service: T::SERVICE, detail: other.to_string() },
            })?;
        Ok(Subscriber {
            topic: self.clone(),
            port,
            buffer,
            check: HeaderCheck::new(host_boot_id(), bounds),
            rejections: Rejections::ZERO,
            newest_refused: None,
            received: 0,
            failures: 0,
        })
    }
}

impl<T: Message> Topic<T> {
    /// Processes that hold a slot of subscribers, ascending, once per slot.
    #[must_use]
    pub fn subscribers(&self) -> Vec<u32> {
        let mut pids = Vec::with_capacity(T::QOS.subscribers);
        self.factory.dynamic_config().list_subscribers(|peer| {
            pids.push(peer.node_id.pid().value() as u32);
            CallbackProgression::Continue
        });
        pids.sort_unstable();
        pids
    }

    /// Processes that publish now.
    fn publishers(&self) -> Vec<u32> {
        let mut pids = Vec::with_capacity(T::QOS.publishers);
        self.factory.dynamic_config().list_publishers(|peer| {
            pids.push(peer.node_id.pid().value() as u32);
            CallbackProgression::Continue
        });
        pids.sort_unstable();
        pids
    }
}

impl<T: Message> Publisher<T> {
    /// Sends `message` under `stamp_ns`; the header is filled in. Returns how many subscribers it reached.
    ///
    /// # Errors
    ///
    /// See [`PublishError`]; the sequence number is used up, so that receivers see the gap.
    pub fn publish(&mut self, stamp_ns: u64, mut message: T) -> Result<usize, PublishError> {
        self.sequence = self.sequence.wrapping_add(1);
        *message.header_mut() = Header { sequence: self.sequence, stamp_ns, boot_id: self.boot_id };
        let loan = self.port.loan_uninit().map_err(publish_error)?;
        loan.write_payload(message).send().map_err(publish_error)
    }

    /// Connects to new subscribers now instead of at the next message.
    ///
    /// # Errors
    ///
    /// `Connection`.
    pub fn connect(&self) -> Result<(), PublishError> {
        self.port.update_connections().map_err(|_| PublishError::Connection)
    }

    /// Present number of subscribers. A change between two calls explains allocations in between.
    pub fn subscribers(&self) -> usize {
        self.topic.connections().1
    }

    /// A number that changes whenever a subscriber comes or goes. Lists them: not for the real-time thread.
    pub fn audience(&self) -> u128 {
        let mut sum = 0_u128;
        self.topic.factory.dynamic_config().list_subscribers(|peer| {
            sum = sum.wrapping_add(peer.subscriber_id.value().wrapping_mul(0x9e37_79b9_7f4a_7c15));
            CallbackProgression::Continue
        });
        sum
    }

    /// Sequence number of the last message; 0: none.
    pub fn sequence(&self) -> u64 {
        self.sequence
    }
}

fn publish_error(error: impl Into<SendError>) -> PublishError {
    match error.into() {
        SendError::LoanError(LoanError::OutOfMemory | LoanError::ExceedsMaxLoans) => PublishError::NoMemory,
        SendError::ConnectionError(_) => PublishError::Connection,
        _ => PublishError::Middleware,
    }
}

/// Receives messages of one type.
#[derive(Debug)]
pub struct Subscriber<T: Message> {
    topic: Topic<T>,
    port: iceoryx2::port::subscriber::Subscriber<ipc::Service, T, ()>,
    buffer: usize,
    check: HeaderCheck,
    rejections: Rejections,
    newest_refused: Option<(Rejection, u64)>,
    received: u64,
    failures: u64,
}

impl<T: Message> Subscriber<T> {
    /// Takes the oldest unread message; `None` if there is none. A refused one is counted and returned as
    /// error. Its age is judged by the clock after it was taken: a receiver that is held up before does not
    /// find it in the future.
    ///
    /// An error of the middleware counts as none, see [`Subscriber::failures`].
    pub fn take(&mut self) -> Option<Result<T, Rejection>> {
        let message = match self.port.receive() {
            Ok(Some(sample)) => *sample,
            Ok(None) => return None,
            Err(_) => {
                self.failures = self.failures.saturating_add(1);
                return None;
            }
        };
        let now_ns = monotonic_now_ns();
        // The header first, so that a refused body does not also look like a dropped message.
        match self.check.admit(message.header(), now_ns).and_then(|()| message.validate()) {
            Ok(()) => {
                self.received = self.received.saturating_add(1);
                Some(Ok(message))
            }
            Err(rejection) => {
                self.rejections.count(rejection);
                self.newest_refused = Some((rejection, now_ns));
                Some(Err(rejection))
            }
        }
    }

    /// Passes every unread message to `use_message`, oldest first; refused ones are only counted. At most one
    /// buffer full per call. Returns how many were passed.
    pub fn drain(&mut self, mut use_message: impl FnMut(T)) -> usize {
        let mut given = 0;
        for _ in 0..self.buffer {
            match self.take() {
                Some(Ok(message)) => {
                    given += 1;
                    use_message(message);
                }
                Some(Err(_)) => {}
                None => break,
            }
        }
        given
    }

    /// The newest valid unread message; all older ones are consumed.
    pub fn latest(&mut self) -> Option<T> {
        let mut newest = None;
        self.drain(|message| newest = Some(message));
        newest
    }

    /// Messages accepted so far.
    pub fn received(&self) -> u64 {
        self.received
    }

    /// Messages missing in the sender's sequence so far: overwritten before they were read, or never sent.
    pub fn dropped(&self) -> u64 {
        self.check.dropped()
    }

    /// How often a new sender took over.
    pub fn restarts(&self) -> u64 {
        self.check.restarts()
    }

    /// Refused messages by reason.
    pub fn rejections(&self) -> &Rejections {
        &self.rejections
    }

    /// The newest refusal, and its time \[ns\].
    pub fn newest_refused(&self) -> Option<(Rejection, u64)> {
        self.newest_refused
    }

    /// Errors of the middleware while receiving.
    pub fn failures(&self) -> u64 {
        self.failures
    }

    /// Present number of publishers. A change between two calls explains allocations in between.
    pub fn publishers(&self) -> usize {
        self.topic.connections().0
    }
}
