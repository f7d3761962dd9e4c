//! Both ends of the request-response service. Not for the real-time thread: a round trip allocates.
//!
//! Contract: the server answers malformed requests itself and counts them; every answer carries the token of
//! its request. The client waits for a bounded time only.

use std::time::{Duration, Instant};

use iceoryx2::active_request::ActiveRequest;
use iceoryx2::prelude::{BackpressureStrategy, CallbackProgression, ipc};
use iceoryx2::service::port_factory::PortFactory as _;
use iceoryx2::service::port_factory::client::ClientCreateError;
use iceoryx2::service::port_factory::server::ServerCreateError;

use super::control_topic::{CONTROL_CLIENTS, CONTROL_OPEN_REQUESTS, CONTROL_SERVICE, ControlTopic};
use super::session::ServiceError;
use crate::wire::check::{Rejection, Rejections, Validate};
use crate::wire::clock::{host_boot_id, monotonic_now_ns};
use crate::wire::control::{ControlRequest, ControlResponse};
use crate::wire::layout::Wire;
use crate::wire::vocabulary::{ControlOp, ControlStatus, RejectReason};

/// Interval at which a waiting client checks for the answer.
const POLL: Duration = Duration::from_micros(500);

/// Answers requests.
#[derive(Debug)]
pub struct ControlServer {
    port: iceoryx2::port::server::Server<ipc::Service, ControlRequest, (), ControlResponse, ()>,
    boot_id: u64,
    daemon_id: u64,
    rejections: Rejections,
}

/// A valid request waiting for its answer. If it is dropped without one, the client waits until its timeout.
#[derive(Debug)]
pub struct Call {
    /// The request.
    pub request: ControlRequest,
    open: ActiveRequest<ipc::Service, ControlRequest, (), ControlResponse, ()>,
    boot_id: u64,
    daemon_id: u64,
}

/// Sends requests.
#[derive(Debug)]
pub struct ControlClient {
    port: iceoryx2::port::client::Client<ipc::Service, ControlRequest, (), ControlResponse, ()>,
    boot_id: u64,
    token: u64,
}

/// Why a request got no usable answer.
#[derive(Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum AskError {
    /// The daemon is gone.
    #[error("no daemon answers requests: is it running?")]
    NoServer,
    /// The daemon is running, but does not answer.
    #[error("the daemon did not answer within {} ms", .0.as_millis())]
    Timeout(Duration),
    /// The answer is malformed.
    #[error("the daemon's answer is malformed: {0}")]
    BadAnswer(Rejection),
    /// The middleware failed.
    #[error("the middleware failed to deliver the request")]
    Middleware,
}

crate::debug_as_display!(AskError);

impl ControlTopic {
    /// The server, to be used in the calling thread. `daemon_id` is part of every answer.
    ///
    /// # Errors
    ///
    /// `NoSlot` if another one exists, `Middleware`.
    pub fn server(&self, daemon_id: u64) -> Result<ControlServer, ServiceError> {
        let port = self
            .factory
            .server_builder()
            .max_loaned_responses_per_request(1)
            .backpressure_strategy(BackpressureStrategy::DiscardData)
            .create()
            .map_err(|error| match error {
                ServerCreateError::ExceedsMaxSupportedServers => ServiceError::NoSlot {
                    service: CONTROL_SERVICE,
                    what: "servers",
                    limit: 1,
                    pids: Vec::new(),
                },
                other => ServiceError::Middleware { service: CONTROL_SERVICE, detail: other.to_string() },
            })?;
        Ok(ControlServer { port, boot_id: host_boot_id(), daemon_id, rejections: Rejections::ZERO })
    }

    /// A client, to be used in the calling thread.
    ///
    /// # Errors
    ///
    /// `NoSlot`, `Middleware`.
    pub fn client(&self) -> Result<ControlClient, ServiceError> {
        let port = self
            .factory
            .client_builder()
            .backpressure_strategy(BackpressureStrategy::DiscardData)
            .create()
            .map_err(|error| match error {
                ClientCreateError::ExceedsMaxSupportedClients => {
                    ServiceError::NoOperatorSlot { limit: CONTROL_CLIENTS, pids: self.operators() }
                }
                other => ServiceError::Middleware { service: CONTROL_SERVICE, detail: other.to_string() },
            })?;
        // Tokens of one process never repeat; the clock keeps those of different processes apart.
        Ok(ControlClient { port, boot_id: host_boot_id(), token: monotonic_now_ns() })
    }
}

impl ControlTopic {
    /// Processes that hold a slot for operators, ascending, once per slot.
    #[must_use]
    pub fn operators(&self) -> Vec<u32> {
        let mut pids = Vec::with_capacity(CONTROL_CLIENTS);
        self.factory.dynamic_config().list_clients(|client| {
            pids.push(client.node_id.pid().value() as u32);
            CallbackProgression::Continue
        });
        pids.sort_unstable();
        pids
    }
}

impl ControlServer {
    /// The next valid request; malformed and foreign ones are answered here and counted.
    pub fn take(&mut self) -> Option<Call> {
        for _ in 0..CONTROL_CLIENTS * CONTROL_OPEN_REQUESTS {
            let open = self.port.receive().ok()??;
            let call = Call { request: *open, open, boot_id: self.boot_id, daemon_id: self.daemon_id };
            let foreign = Rejection::new(RejectReason::ForeignBoot, "boot_id");
            let checked =
                if call.request.boot_id == self.boot_id { call.request.validate() } else { Err(foreign) };
            let Err(rejection) = checked else {
                // The client has given up, or is gone. A stop is valid all the same.
                let stops = [ControlOp::Disarm, ControlOp::Stop].map(u32::from).contains(&call.request.op);
                if stops || call.open.is_connected() {
                    return Some(call);
                }
                continue;
            };
            self.rejections.count(rejection);
            let status =
                if rejection == foreign { ControlStatus::ForeignBoot } else { ControlStatus::Invalid };
            call.answer(status, 0.0, 0, &rejection.to_string());
        }
        None
    }

    /// Malformed requests by reason.
    pub fn rejections(&self) -> &Rejections {
        &self.rejections
    }
}

impl Call {
    /// Sends the answer. Returns whether the client was still there.
    pub fn answer(self, status: ControlStatus, value: f64, detail: u32, message: &str) -> bool {
        let mut response = ControlResponse::to(&self.request, status, message);
        response.boot_id = self.boot_id;
        response.daemon_id = self.daemon_id;
        response.value = value;
        response.detail = detail;
        self.open.send_copy(response).is_ok()
    }
}

impl ControlClient {
    /// Sends `request` (token and boot id are filled in) and waits for its answer. A request whose `sent_ns`
    /// is 0 is dated as it is sent; another one keeps its date, so that a stop since then outranks it.
    ///
    /// # Errors
    ///
    /// See [`AskError`]. A refusal by the daemon is an answer, not an error.
    pub fn ask(
        &mut self,
        mut request: ControlRequest,
        timeout: Duration,
    ) -> Result<ControlResponse, AskError> {
        self.token = self.token.wrapping_add(1);
        request.token = self.token;
        request.boot_id = self.boot_id;
        let deadline = Instant::now() + timeout;
        let decided_ns = (request.sent_ns != 0).then_some(request.sent_ns);
        // A request that reached no server may be sent again; one that reached a server may not.
        let pending = loop {
            request.sent_ns = decided_ns.unwrap_or_else(monotonic_now_ns);
            let pending = self.port.send_copy(request).map_err(|_| AskError::Middleware)?;
            if pending.number_of_server_connections() > 0 {
                break pending;
            }
            if Instant::now() >= deadline {
                return Err(AskError::NoServer);
            }
            drop(pending);
            std::thread::sleep(POLL);
        };
        loop {
            // Checked before the answer: a server that has answered lets go at once.
            let connected = pending.is_connected();
            match pending.receive() {
                Ok(Some(response)) => {
                    let response = *response;
                    if response.token == request.token {
                        return response.validate().map(|()| response).map_err(AskError::BadAnswer);
                    }
                }
                Ok(None) if !connected => return Err(AskError::NoServer),
                Ok(None) if Instant::now() >= deadline => return Err(AskError::Timeout(timeout)),
                Ok(None) => std::thread::sleep(POLL),
                Err(_) => return Err(AskError::Middleware),
            }
        }
    }
}
