//! The publish-subscribe services of an instance: their names, quality of service, creation by the daemon and
//! opening by others.
//!
//! Contract: only the daemon creates; others open, and then verify type, layout hash and quality of service
//! exactly, because the middleware treats them as minimum and compares no layout. Any difference is refused.

use std::sync::Arc;

use iceoryx2::prelude::{AttributeSet, AttributeVerifier, PortFactory, ServiceName, ipc};
use iceoryx2::service::builder::publish_subscribe::{
    Builder, PublishSubscribeCreateError, PublishSubscribeOpenError, PublishSubscribeOpenOrCreateError,
};
use iceoryx2::service::port_factory::publish_subscribe;

use super::control_topic::ControlTopic;
use super::session::{ServiceError, Session};
use crate::wire::arm_note::ArmNote;
use crate::wire::check::Validate;
use crate::wire::header::Header;
use crate::wire::joints::{Enable, JointCommand, JointState};
use crate::wire::pen::PenSample;
use crate::wire::pen_step::{PenPreview, PenStep};
use crate::wire::piece::Piece;
use crate::wire::status::Status;
use crate::wire::tick_input::TickInput;
use crate::wire::tick_record::TickRecord;

/// Quality of service of a topic. Overflow is always on: the oldest message is overwritten.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Qos {
    /// Publishers at a time.
    pub publishers: usize,
    /// Subscribers at a time.
    pub subscribers: usize,
    /// Largest buffer of a subscriber \[messages\].
    pub buffer: usize,
    /// Messages that a late subscriber gets.
    pub history: usize,
}

/// A message sent by publish-subscribe.
pub trait Message: Validate {
    /// Name of its service.
    const SERVICE: &'static str;
    /// Quality of its service.
    const QOS: Qos;
    /// Its header.
    fn header(&self) -> &Header;
    /// Its header, to be filled by the publisher.
    fn header_mut(&mut self) -> &mut Header;
}

macro_rules! message {
    ($($type:ident: $service:literal, $publishers:literal, $subscribers:literal, $buffer:literal,
        $history:literal;)+) => {$(
        impl Message for $type {
            const SERVICE: &'static str = $service;
            const QOS: Qos =
                Qos { publishers: $publishers, subscribers: $subscribers, buffer: $buffer,
                    history: $history };

            fn header(&self) -> &Header {
                &self.header
            }

            fn header_mut(&mut self) -> &mut Header {
                &mut self.header
            }
        }
    )+};
}
message! {
    //             service              pubs subs buffer history
    PenSample:    "foretrace/pen",         1, 4, 256, 0;
    JointCommand: "foretrace/joint_cmd",   1, 4, 256, 0;
    JointState:   "foretrace/joint_state", 1, 4, 256, 0;
    ArmNote:      "foretrace/arm_note",    1, 2,   4, 1;
    TickRecord:   "foretrace/telemetry",   1, 3, 256, 0;
    Status:       "foretrace/status",      1, 8,   4, 1;
    Enable:       "foretrace/enable",      1, 2,   4, 0;
    TickInput:    "foretrace/inputs",      1, 2, 256, 0;
    Piece:        "foretrace/pieces",      1, 2,  64, 0;
    PenStep:      "foretrace/pen_step",    1, 4,  64, 0;
    PenPreview:   "foretrace/preview",     1, 2,   8, 0;
}

/// Processes that may use one service at the same time.
pub const MAX_PEERS: usize = 16;
/// Upper bound of the shared memory of one instance.
pub const SHARED_MEMORY_LIMIT_BYTES: u64 = 8 << 20;

const LAYOUT_KEY: &str = "foretrace.layout";

/// A publish-subscribe service, created or opened. May be sent and shared between threads; makes ports.
#[derive(Debug, Clone)]
pub struct Topic<T: Message> {
    pub(crate) factory: Arc<publish_subscribe::PortFactory<ipc::Service, T, ()>>,
}

impl<T: Message> Topic<T> {
    /// Creates it, or takes over one that living peers kept; for the daemon.
    ///
    /// # Errors
    ///
    /// `WrongLayout`, `DifferentQos`, `Damaged`, `Permission`, `NoSlot`, `Middleware`.
    pub fn create(session: &Session) -> Result<Self, ServiceError> {
        let attributes = layout_required(T::SERVICE, T::LAYOUT_HASH)?;
        let factory = builder::<T>(session)?.open_or_create_with_attributes(&attributes).map_err(
            |error| match error {
                PublishSubscribeOpenOrCreateError::PublishSubscribeOpenError(error) => {
                    open_error::<T>(session, error)
                }
                PublishSubscribeOpenOrCreateError::PublishSubscribeCreateError(
                    PublishSubscribeCreateError::ServiceInCorruptedState
                    | PublishSubscribeCreateError::HangsInCreation,
                ) => session.damaged(T::SERVICE),
                PublishSubscribeOpenOrCreateError::PublishSubscribeCreateError(
                    PublishSubscribeCreateError::InsufficientPermissions,
                ) => ServiceError::Permission { service: T::SERVICE },
                other => ServiceError::Middleware { service: T::SERVICE, detail: other.to_string() },
            },
        )?;
        Self { factory: Arc::new(factory) }.verified()
    }

    /// Opens it; for all other processes.
    ///
    /// # Errors
    ///
    /// `NoDaemon`, `WrongLayout`, `DifferentQos`, `Damaged`, `Permission`, `NoSlot`, `Middleware`.
    pub fn open(session: &Session) -> Result<Self, ServiceError> {
        let factory = builder::<T>(session)?.open().map_err(|error| open_error::<T>(session, error))?;
        Self { factory: Arc::new(factory) }.verified()
    }

    /// Ports connected now: publishers and subscribers. A change means that the next send or receive
    /// connects, which costs allocations and tens of microseconds.
    pub fn connections(&self) -> (usize, usize) {
        let now = self.factory.dynamic_config();
        (now.number_of_publishers(), now.number_of_subscribers())
    }

    fn verified(self) -> Result<Self, ServiceError> {
        verify_layout::<T>(T::SERVICE, self.factory.attributes())?;
        let found = self.factory.static_config();
        verify_exactly(
            T::SERVICE,
            &[
                ("publishers", found.max_publishers(), T::QOS.publishers),
                ("subscribers", found.max_subscribers(), T::QOS.subscribers),
                ("nodes", found.max_nodes(), MAX_PEERS),
                ("buffer size", found.subscriber_max_buffer_size(), T::QOS.buffer),
                ("borrowed samples", found.subscriber_max_borrowed_samples(), 1),
                ("history", found.history_size(), T::QOS.history),
                ("safe overflow", usize::from(found.has_safe_overflow()), 1),
            ],
        )?;
        Ok(self)
    }
}

/// All services of an instance.
#[derive(Debug, Clone)]
pub struct Services {
    /// Pen samples, to the daemon.
    pub pen: Topic<PenSample>,
    /// Joint commands, from the daemon.
    pub joint_cmd: Topic<JointCommand>,
    /// Joint states, to the daemon.
    pub joint_state: Topic<JointState>,
    /// What the arm's process says of its arm, to the daemon.
    pub arm_note: Topic<ArmNote>,
    /// Tick records, from the daemon.
    pub telemetry: Topic<TickRecord>,
    /// Status, from the daemon.
    pub status: Topic<Status>,
    /// Dead-man, to the daemon.
    pub enable: Topic<Enable>,
    /// Inputs of every tick, from the daemon.
    pub inputs: Topic<TickInput>,
    /// Settings, weights and states in pieces, from the daemon.
    pub pieces: Topic<Piece>,
    /// Closed steps of the pen's grid, from the daemon.
    pub pen_step: Topic<PenStep>,
    /// Previews of another process, to the daemon.
    pub preview: Topic<PenPreview>,
    /// Requests.
    pub control: ControlTopic,
}

impl Services {
    /// Creates all of them; for the daemon.
    ///
    /// # Errors
    ///
    /// As [`Topic::create`].
    pub fn create(session: &Session) -> Result<Self, ServiceError> {
        Ok(Self {
            pen: Topic::create(session)?,
            joint_cmd: Topic::create(session)?,
            joint_state: Topic::create(session)?,
            arm_note: Topic::create(session)?,
            telemetry: Topic::create(session)?,
            status: Topic::create(session)?,
            enable: Topic::create(session)?,
            inputs: Topic::create(session)?,
            pieces: Topic::create(session)?,
            pen_step: Topic::create(session)?,
            preview: Topic::create(session)?,
            control: ControlTopic::create(session)?,
        })
    }

    /// Opens all of them; for all other processes.
    ///
    /// # Errors
    ///
    /// As [`Topic::open`].
    pub fn open(session: &Session) -> Result<Self, ServiceError> {
        Ok(Self {
            pen: Topic::open(session)?,
            joint_cmd: Topic::open(session)?,
            joint_state: Topic::open(session)?,
            arm_note: Topic::open(session)?,
            telemetry: Topic::open(session)?,
            status: Topic::open(session)?,
            enable: Topic::open(session)?,
            inputs: Topic::open(session)?,
            pieces: Topic::open(session)?,
            pen_step: Topic::open(session)?,
            preview: Topic::open(session)?,
            control: ControlTopic::open(session)?,
        })
    }

    /// Whether these are the services of `other`, not new ones with the same names.
    pub fn are_same_as(&self, other: &Self) -> bool {
        self.pen.factory.unique_service_id() == other.pen.factory.unique_service_id()
    }
}

pub(crate) fn service_name(name: &'static str) -> Result<ServiceName, ServiceError> {
    name.try_into().map_err(|error| ServiceError::Middleware { service: name, detail: format!("{error:?}") })
}

fn builder<T: Message>(session: &Session) -> Result<Builder<T, (), ipc::Service>, ServiceError> {
    Ok(session
        .node
        .service_builder(&service_name(T::SERVICE)?)
        .publish_subscribe::<T>()
        .max_publishers(T::QOS.publishers)
        .max_subscribers(T::QOS.subscribers)
        .max_nodes(MAX_PEERS)
        .subscriber_max_buffer_size(T::QOS.buffer)
        .subscriber_max_borrowed_samples(1)
        .history_size(T::QOS.history)
        .enable_safe_overflow(true))
}

pub(crate) fn layout_required(service: &'static str, hash: u64) -> Result<AttributeVerifier, ServiceError> {
    let failed = |detail: String| ServiceError::Middleware { service, detail };
    let key = LAYOUT_KEY.try_into().map_err(|error| failed(format!("{error:?}")))?;
    let value = format!("{hash:016x}");
    let value = value.as_str().try_into().map_err(|error| failed(format!("{error:?}")))?;
    AttributeVerifier::new().require(&key, &value).map_err(|error| failed(error.to_string()))
}

fn verify_layout<T: Message>(service: &'static str, found: &AttributeSet) -> Result<(), ServiceError> {
    verify_hash(service, std::any::type_name::<T>(), T::LAYOUT_HASH, found)
}

pub(crate) fn verify_hash(
    service: &'static str,
    type_name: &'static str,
    ours: u64,
    found: &AttributeSet,
) -> Result<(), ServiceError> {
    let theirs = found
        .iter()
        .find(|attribute| attribute.key() == LAYOUT_KEY)
        .map(|attribute| attribute.value().to_string())
        .unwrap_or_else(|| "unknown".to_string());
    if theirs == format!("{ours:016x}") {
        Ok(())
    } else {
        Err(ServiceError::WrongLayout { service, type_name, theirs, ours })
    }
}

pub(crate) fn verify_exactly(
    service: &'static str,
    settings: &[(&'static str, usize, usize)],
) -> Result<(), ServiceError> {
    match settings.iter().find(|(_, found, expected)| found != expected) {
        None => Ok(()),
        Some(&(what, found, expected)) => {
            Err(ServiceError::DifferentQos { service, what, found: found.to_string(), expected })
        }
    }
}

fn open_error<T: Message>(session: &Session, error: PublishSubscribeOpenError) -> ServiceError {
    use PublishSubscribeOpenError as E;
    let service = T::SERVICE;
    let fewer =
        |what, expected| ServiceError::DifferentQos { service, what, found: "fewer".to_string(), expected };
    match error {
        E::DoesNotExist | E::IsMarkedForDestruction => session.no_daemon(),
        E::IncompatibleTypes | E::IncompatibleMessagingPattern | E::IncompatibleAttributes => {
            let type_name = std::any::type_name::<T>();
            ServiceError::WrongLayout {
                service,
                type_name,
                theirs: "different".to_string(),
                ours: T::LAYOUT_HASH,
            }
        }
        E::DoesNotSupportRequestedAmountOfPublishers => fewer("publishers", T::QOS.publishers),
        E::DoesNotSupportRequestedAmountOfSubscribers => fewer("subscribers", T::QOS.subscribers),
        E::DoesNotSupportRequestedAmountOfNodes => fewer("nodes", MAX_PEERS),
        E::DoesNotSupportRequestedMinBufferSize => fewer("buffer size", T::QOS.buffer),
        E::DoesNotSupportRequestedMinHistorySize => fewer("history", T::QOS.history),
        E::DoesNotSupportRequestedMinSubscriberBorrowedSamples => fewer("borrowed samples", 1),
        E::IncompatibleOverflowBehavior => fewer("safe overflow", 1),
        E::ExceedsMaxNumberOfNodes => {
            ServiceError::NoSlot { service, what: "process", limit: MAX_PEERS, pids: Vec::new() }
        }
        E::ServiceInCorruptedState | E::HangsInCreation => session.damaged(service),
        E::InsufficientPermissions => ServiceError::Permission { service },
        other => ServiceError::Middleware { service, detail: other.to_string() },
    }
}
