//! The request-response service: its name, quality of service, creation by the daemon and opening by
//! operators.
//!
//! Contract: as `topic`, for one server and a few clients.

use iceoryx2::prelude::{PortFactory, ipc};
use iceoryx2::service::builder::request_response::{
    Builder, RequestResponseCreateError, RequestResponseOpenError, RequestResponseOpenOrCreateError,
};
use iceoryx2::service::port_factory::request_response;

use super::session::{ServiceError, Session};
use super::topic::{MAX_PEERS, layout_required, service_name, verify_exactly, verify_hash};
use crate::wire::control::{ControlRequest, ControlResponse};
use crate::wire::layout::Wire;

/// Name of the request-response service.
pub const CONTROL_SERVICE: &str = "foretrace/control";
/// Operators that may be connected at the same time.
pub const CONTROL_CLIENTS: usize = 4;
/// Requests one operator may have open.
pub const CONTROL_OPEN_REQUESTS: usize = 2;
/// The request-response service, created or opened. May be sent and shared between threads; makes ports.
#[derive(Debug, Clone)]
pub struct ControlTopic {
    pub(crate) factory: request_response::PortFactory<ipc::Service, ControlRequest, (), ControlResponse, ()>,
}

/// Both sides' layouts in one hash.
const CONTROL_LAYOUT: u64 = ControlRequest::LAYOUT_HASH ^ ControlResponse::LAYOUT_HASH.rotate_left(1);

impl ControlTopic {
    /// Creates it, or takes over one that living peers kept; for the daemon.
    ///
    /// # Errors
    ///
    /// As [`crate::Topic::create`].
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

    /// Opens it; for all other processes.
    ///
    /// # Errors
    ///
    /// As [`crate::Topic::open`].
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
                ("fire and forget", usize::from(found.does_support_fire_and_forget_requests()), 1),
            ],
        )?;
        Ok(self)
    }
}

type ControlBuilder = Builder<ControlRequest, (), ControlResponse, (), ipc::Service>;

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
        // Without it 0.9.3 never releases clients that have left, and panics in the server at the 133rd;
        // requests of clients that are gone are skipped by the server instead.
        .enable_fire_and_forget_requests(true))
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
        E::ExceedsMaxNumberOfNodes => {
            ServiceError::NoSlot { service, what: "process", limit: MAX_PEERS, pids: Vec::new() }
        }
        E::ServiceInCorruptedState | E::HangsInCreation => session.damaged(service),
        E::InsufficientPermissions => ServiceError::Permission { service },
        other => ServiceError::Middleware { service, detail: other.to_string() },
    }
}
