//! The services of an instance: their names, quality of service, creation by the daemon and opening by others.
//!
//! Contract: only the daemon creates; others open, and then verify type, layout hash and quality of service exactly,
//! because the middleware treats them as minimum and compares no layout. What does not match is refused.

use std::path::PathBuf;
use std::sync::Arc;

use iceoryx2::node::NodeCreationFailure;
use iceoryx2::prelude::{
    AttributeSet, AttributeVerifier, LogLevel, Node, NodeBuilder, NodeName, PortFactory, ServiceName,
    SignalHandlingMode, ipc, set_log_level,
};
use iceoryx2::service::builder::publish_subscribe::{
    PublishSubscribeCreateError, PublishSubscribeOpenError, PublishSubscribeOpenOrCreateError,
};
use iceoryx2::service::builder::request_response::{
    RequestResponseCreateError, RequestResponseOpenError, RequestResponseOpenOrCreateError,
};
use iceoryx2::service::port_factory::{publish_subscribe, request_response};

use crate::{
    ControlRequest, ControlResponse, Enable, Header, Instance, InstanceError, JointCommand, JointState,
    PenSample, Status, TickRecord, Validate, Wire,
};

/// Quality of service of a topic. Overflow is always on: the oldest message gives way.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Qos {
    /// Publishers at a time.
    pub publishers: usize,
    /// Subscribers at a time.
    pub subscribers: usize,
    /// Largest buffer of a subscriber [messages].
    pub buffer: usize,
    /// Messages a late subscriber gets.
    pub history: usize,
}

/// A message that travels by publish-subscribe.
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
    ($($type:ident: $service:literal, $publishers:literal, $subscribers:literal, $buffer:literal, $history:literal;)+) => {$(
        impl Message for $type {
            const SERVICE: &'static str = $service;
            const QOS: Qos =
                Qos { publishers: $publishers, subscribers: $subscribers, buffer: $buffer, history: $history };

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
    TickRecord:   "foretrace/telemetry",   1, 3, 256, 0;
    Status:       "foretrace/status",      1, 8,   4, 1;
    Enable:       "foretrace/enable",      1, 2,   4, 0;
}

/// Name of the request-response service.
pub const CONTROL_SERVICE: &str = "foretrace/control";
/// Operators that may be connected at a time.
pub const CONTROL_CLIENTS: usize = 4;
/// Requests one operator may have open.
pub const CONTROL_OPEN_REQUESTS: usize = 2;
/// Processes that may use one service at a time.
pub const MAX_PEERS: usize = 16;
/// Upper bound of the shared memory of one instance.
pub const SHARED_MEMORY_LIMIT_BYTES: u64 = 8 << 20;

const LAYOUT_KEY: &str = "foretrace.layout";

/// Why a service could not be created, opened or used.
#[derive(Debug, thiserror::Error)]
pub enum ServiceError {
    /// Nobody to talk to.
    #[error(
        "no daemon running for instance {number} (looked in {}): start it with `foretrace daemon{}`",
        root.display(), if *number == 0 { String::new() } else { format!(" --instance {number}") }
    )]
    NoDaemon {
        /// Number of the instance.
        number: u32,
        /// Where it was looked for.
        root: PathBuf,
    },
    /// The other side was built from other message definitions.
    #[error(
        "{service}: the running peers use another layout of {type_name} (theirs {theirs}, ours {ours:016x}): \
         use programs of one version of foretrace on all sides"
    )]
    WrongLayout {
        /// Name of the service.
        service: &'static str,
        /// Our type.
        type_name: &'static str,
        /// Their layout hash, or what is known of it.
        theirs: String,
        /// Our layout hash.
        ours: u64,
    },
    /// The other side was built with other limits.
    #[error(
        "{service}: the running peers have {what} {found}, we need exactly {expected}: \
         use programs of one version of foretrace on all sides"
    )]
    DifferentQos {
        /// Name of the service.
        service: &'static str,
        /// Which setting.
        what: &'static str,
        /// Theirs.
        found: String,
        /// Ours.
        expected: usize,
    },
    /// All places are taken.
    #[error("{service}: all {limit} places for {what} are taken: end one of them")]
    NoPlace {
        /// Name of the service.
        service: &'static str,
        /// Of which kind.
        what: &'static str,
        /// How many there are.
        limit: usize,
    },
    /// A subscriber may not ask for this.
    #[error("{service}: a buffer of {asked} messages was asked for, 1 to {limit} are possible")]
    BufferSize {
        /// Name of the service.
        service: &'static str,
        /// What was asked for.
        asked: usize,
        /// The largest possible.
        limit: usize,
    },
    /// Files of the service are damaged.
    #[error(
        "{service}: its files in {} are damaged: end all programs of this instance, then start the daemon, \
         which removes them", root.display()
    )]
    Damaged {
        /// Name of the service.
        service: &'static str,
        /// Where they are.
        root: PathBuf,
    },
    /// The system refuses access.
    #[error("{service}: no permission to use the shared memory: run as the same user as the daemon")]
    Permission {
        /// Name of the service.
        service: &'static str,
    },
    /// The instance itself cannot be used.
    #[error(transparent)]
    Instance(#[from] InstanceError),
    /// Anything else.
    #[error("{service}: the middleware failed: {detail}")]
    Middleware {
        /// Name of the service.
        service: &'static str,
        /// What it said.
        detail: String,
    },
}

/// A process's membership in an instance. May be sent to other threads; ports may not.
#[derive(Debug)]
pub struct Session {
    instance: Instance,
    node: Node<ipc::Service>,
}

impl Session {
    /// Join as the daemon, which holds the lock and has purged.
    ///
    /// *Errors*: `Permission`, `Middleware`, `Instance`.
    pub fn create(
        instance: &Instance,
        name: &str,
        _lock: &crate::InstanceLock,
    ) -> Result<Self, ServiceError> {
        Self::join(instance, name)
    }

    /// Join an instance whose daemon is up; leaves no trace if there is none.
    ///
    /// *Errors*: `NoDaemon`, `Permission`, `Middleware`, `Instance`.
    pub fn open(instance: &Instance, name: &str) -> Result<Self, ServiceError> {
        let no_daemon =
            || ServiceError::NoDaemon { number: instance.number(), root: instance.root().to_path_buf() };
        match instance.check_root() {
            Err(InstanceError::Io { source, .. }) if source.kind() == std::io::ErrorKind::NotFound => {
                return Err(no_daemon());
            }
            checked => checked?,
        }
        instance.daemon().ok_or_else(no_daemon)?;
        Self::join(instance, name)
    }

    /// The instance joined.
    pub fn instance(&self) -> &Instance {
        &self.instance
    }

    fn join(instance: &Instance, name: &str) -> Result<Self, ServiceError> {
        // Its messages mean nothing to our users; every failure comes back as an error that does.
        set_log_level(LogLevel::Fatal);
        let failed = |detail: String| ServiceError::Middleware { service: "foretrace", detail };
        let node = NodeBuilder::new()
            .name(&NodeName::new(name).map_err(|error| failed(error.to_string()))?)
            .config(instance.config())
            .signal_handling_mode(SignalHandlingMode::Disabled)
            .create::<ipc::Service>()
            .map_err(|error| match error {
                NodeCreationFailure::InsufficientPermissions => {
                    ServiceError::Permission { service: "foretrace" }
                }
                other => failed(other.to_string()),
            })?;
        Ok(Self { instance: instance.clone(), node })
    }

    fn no_daemon(&self) -> ServiceError {
        ServiceError::NoDaemon { number: self.instance.number(), root: self.instance.root().to_path_buf() }
    }

    fn damaged(&self, service: &'static str) -> ServiceError {
        ServiceError::Damaged { service, root: self.instance.root().to_path_buf() }
    }
}

/// A publish-subscribe service, created or opened. May be sent and shared between threads; makes ports.
#[derive(Debug, Clone)]
pub struct Topic<T: Message> {
    pub(crate) factory: Arc<publish_subscribe::PortFactory<ipc::Service, T, ()>>,
}

impl<T: Message> Topic<T> {
    /// Create it, or take over one that living peers kept; for the daemon.
    ///
    /// *Errors*: `WrongLayout`, `DifferentQos`, `Damaged`, `Permission`, `NoPlace`, `Middleware`.
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

    /// Open it; for everybody else.
    ///
    /// *Errors*: `NoDaemon`, `WrongLayout`, `DifferentQos`, `Damaged`, `Permission`, `NoPlace`, `Middleware`.
    pub fn open(session: &Session) -> Result<Self, ServiceError> {
        let factory = builder::<T>(session)?.open().map_err(|error| open_error::<T>(session, error))?;
        Self { factory: Arc::new(factory) }.verified()
    }

    /// Ports connected now: publishers and subscribers. A change means that the next send or receive connects, which
    /// costs allocations and tens of microseconds.
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

/// The request-response service, created or opened. May be sent and shared between threads; makes ports.
#[derive(Debug, Clone)]
pub struct ControlTopic {
    pub(crate) factory: request_response::PortFactory<ipc::Service, ControlRequest, (), ControlResponse, ()>,
}

/// Both sides' layouts in one hash.
const CONTROL_LAYOUT: u64 = ControlRequest::LAYOUT_HASH ^ ControlResponse::LAYOUT_HASH.rotate_left(1);

impl ControlTopic {
    /// Create it, or take over one that living peers kept; for the daemon.
    ///
    /// *Errors*: as [`Topic::create`].
    pub fn create(session: &Session) -> Result<Self, ServiceError> {
        let attributes = layout_required(CONTROL_SERVICE, CONTROL_LAYOUT)?;
        let factory = control_builder(session)?.open_or_create_with_attributes(&attributes).map_err(
            |error| match error {
                RequestResponseOpenOrCreateError::RequestResponseOpenError(error) => {
                    control_open_error(session, error)
                }
                RequestResponseOpenOrCreateError::RequestResponseCreateError(
                    RequestResponseCreateError::ServiceInCorruptedState
                    | RequestResponseCreateError::HangsInCreation,
                ) => session.damaged(CONTROL_SERVICE),
                RequestResponseOpenOrCreateError::RequestResponseCreateError(
                    RequestResponseCreateError::InsufficientPermissions,
                ) => ServiceError::Permission { service: CONTROL_SERVICE },
                other => ServiceError::Middleware { service: CONTROL_SERVICE, detail: other.to_string() },
            },
        )?;
        Self { factory }.verified()
    }

    /// Open it; for everybody else.
    ///
    /// *Errors*: as [`Topic::open`].
    pub fn open(session: &Session) -> Result<Self, ServiceError> {
        let factory = control_builder(session)?.open().map_err(|error| control_open_error(session, error))?;
        Self { factory }.verified()
    }

    fn verified(self) -> Result<Self, ServiceError> {
        verify_hash(CONTROL_SERVICE, "ControlRequest", CONTROL_LAYOUT, self.factory.attributes())?;
        let found = self.factory.static_config();
        verify_exactly(
            CONTROL_SERVICE,
            &[
                ("servers", found.max_servers(), 1),
                ("clients", found.max_clients(), CONTROL_CLIENTS),
                ("nodes", found.max_nodes(), MAX_PEERS),
                ("open requests", found.max_active_requests_per_client(), CONTROL_OPEN_REQUESTS),
                ("response buffer", found.max_response_buffer_size(), 1),
                ("fire and forget", usize::from(found.does_support_fire_and_forget_requests()), 0),
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
    /// Tick records, from the daemon.
    pub telemetry: Topic<TickRecord>,
    /// Status, from the daemon.
    pub status: Topic<Status>,
    /// Dead-man, to the daemon.
    pub enable: Topic<Enable>,
    /// Requests.
    pub control: ControlTopic,
}

impl Services {
    /// Create all of them; for the daemon.
    ///
    /// *Errors*: as [`Topic::create`].
    pub fn create(session: &Session) -> Result<Self, ServiceError> {
        Ok(Self {
            pen: Topic::create(session)?,
            joint_cmd: Topic::create(session)?,
            joint_state: Topic::create(session)?,
            telemetry: Topic::create(session)?,
            status: Topic::create(session)?,
            enable: Topic::create(session)?,
            control: ControlTopic::create(session)?,
        })
    }

    /// Open all of them; for everybody else.
    ///
    /// *Errors*: as [`Topic::open`].
    pub fn open(session: &Session) -> Result<Self, ServiceError> {
        Ok(Self {
            pen: Topic::open(session)?,
            joint_cmd: Topic::open(session)?,
            joint_state: Topic::open(session)?,
            telemetry: Topic::open(session)?,
            status: Topic::open(session)?,
            enable: Topic::open(session)?,
            control: ControlTopic::open(session)?,
        })
    }
}

fn service_name(name: &'static str) -> Result<ServiceName, ServiceError> {
    name.try_into().map_err(|error| ServiceError::Middleware { service: name, detail: format!("{error:?}") })
}

fn builder<T: Message>(
    session: &Session,
) -> Result<iceoryx2::service::builder::publish_subscribe::Builder<T, (), ipc::Service>, ServiceError> {
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

type ControlBuilder = iceoryx2::service::builder::request_response::Builder<
    ControlRequest,
    (),
    ControlResponse,
    (),
    ipc::Service,
>;

fn control_builder(session: &Session) -> Result<ControlBuilder, ServiceError> {
    Ok(session
        .node
        .service_builder(&service_name(CONTROL_SERVICE)?)
        .request_response::<ControlRequest, ControlResponse>()
        .max_servers(1)
        .max_clients(CONTROL_CLIENTS)
        .max_nodes(MAX_PEERS)
        .max_active_requests_per_client(CONTROL_OPEN_REQUESTS)
        .max_loaned_requests(1)
        .max_response_buffer_size(1)
        .max_borrowed_responses_per_pending_response(1)
        .enable_safe_overflow_for_requests(true)
        .enable_safe_overflow_for_responses(true)
        .enable_fire_and_forget_requests(false))
}

fn layout_required(service: &'static str, hash: u64) -> Result<AttributeVerifier, ServiceError> {
    let failed = |detail: String| ServiceError::Middleware { service, detail };
    let key = LAYOUT_KEY.try_into().map_err(|error| failed(format!("{error:?}")))?;
    let value = format!("{hash:016x}");
    let value = value.as_str().try_into().map_err(|error| failed(format!("{error:?}")))?;
    AttributeVerifier::new().require(&key, &value).map_err(|error| failed(error.to_string()))
}

fn verify_layout<T: Message>(service: &'static str, found: &AttributeSet) -> Result<(), ServiceError> {
    verify_hash(service, std::any::type_name::<T>(), T::LAYOUT_HASH, found)
}

fn verify_hash(
    service: &'static str,
    type_name: &'static str,
    ours: u64,
    found: &AttributeSet,
) -> Result<(), ServiceError> {
    let theirs = found
        .iter()
        .find(|attribute| attribute.key().to_string() == LAYOUT_KEY)
        .map(|attribute| attribute.value().to_string())
        .unwrap_or_else(|| "unknown".to_string());
    if theirs == format!("{ours:016x}") {
        Ok(())
    } else {
        Err(ServiceError::WrongLayout { service, type_name, theirs, ours })
    }
}

fn verify_exactly(
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
        E::ExceedsMaxNumberOfNodes => ServiceError::NoPlace { service, what: "processes", limit: MAX_PEERS },
        E::ServiceInCorruptedState | E::HangsInCreation => session.damaged(service),
        E::InsufficientPermissions => ServiceError::Permission { service },
        other => ServiceError::Middleware { service, detail: other.to_string() },
    }
}

fn control_open_error(session: &Session, error: RequestResponseOpenError) -> ServiceError {
    use RequestResponseOpenError as E;
    let service = CONTROL_SERVICE;
    match error {
        E::DoesNotExist | E::IsMarkedForDestruction => session.no_daemon(),
        E::IncompatibleRequestType
        | E::IncompatibleResponseType
        | E::IncompatibleMessagingPattern
        | E::IncompatibleAttributes => ServiceError::WrongLayout {
            service,
            type_name: "ControlRequest",
            theirs: "different".to_string(),
            ours: CONTROL_LAYOUT,
        },
        E::ExceedsMaxNumberOfNodes => ServiceError::NoPlace { service, what: "processes", limit: MAX_PEERS },
        E::ServiceInCorruptedState | E::HangsInCreation => session.damaged(service),
        E::InsufficientPermissions => ServiceError::Permission { service },
        other => ServiceError::Middleware { service, detail: other.to_string() },
    }
}
