//! Errors of the client library, as threads without the interpreter carry them, and the exception of each.

use foretrace_client::wire::Rejection;
use foretrace_client::{
    DeadManError, FeedError, GatewayError, InstanceError, JointStateError, PreviewSendError, RequestError,
    ServiceError, StopError,
};
use pyo3::prelude::*;

use crate::problem::{Invalid, NoAnswer, NoDaemon, OtherVersion, Problem, Refused, Taken};

/// Which exception it becomes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FailureKind {
    Other,
    Refused,
    NoDaemon,
    OtherVersion,
    Taken,
    Invalid,
    NoAnswer,
}

/// Why a call fails.
#[derive(Debug, Clone)]
pub struct LiveFailure {
    kind: FailureKind,
    text: String,
    /// Status, detail and value of a request that the daemon refused.
    refusal: Option<(i32, u32, f64)>,
}

impl LiveFailure {
    pub fn new(kind: FailureKind, text: impl Into<String>) -> Self {
        Self { kind, text: text.into(), refusal: None }
    }

    /// Whether it stays until another program ends or is replaced.
    pub fn lasts(&self) -> bool {
        matches!(self.kind, FailureKind::Taken | FailureKind::OtherVersion)
    }

    pub fn invalid(text: impl Into<String>) -> Self {
        Self::new(FailureKind::Invalid, text)
    }
}

impl From<LiveFailure> for PyErr {
    fn from(failure: LiveFailure) -> Self {
        let LiveFailure { kind, text, refusal } = failure;
        let error = match kind {
            FailureKind::Other => Problem::new_err(text),
            FailureKind::Refused => Refused::new_err(text),
            FailureKind::NoDaemon => NoDaemon::new_err(text),
            FailureKind::OtherVersion => OtherVersion::new_err(text),
            FailureKind::Taken => Taken::new_err(text),
            FailureKind::Invalid => Invalid::new_err(text),
            FailureKind::NoAnswer => NoAnswer::new_err(text),
        };
        let Some((status, detail, value)) = refusal else { return error };
        Python::attach(|py| {
            let instance = error.value(py);
            let set = instance
                .setattr("status", status)
                .and_then(|()| instance.setattr("detail", detail))
                .and_then(|()| instance.setattr("value", value));
            match set {
                Ok(()) => error,
                Err(other) => other,
            }
        })
    }
}

impl From<ServiceError> for LiveFailure {
    fn from(error: ServiceError) -> Self {
        let kind = match &error {
            ServiceError::NoDaemon { .. } => FailureKind::NoDaemon,
            ServiceError::WrongLayout { .. } | ServiceError::DifferentQos { .. } => {
                let text = format!("{error}; this package is foretrace {}", env!("CARGO_PKG_VERSION"));
                return Self::new(FailureKind::OtherVersion, text);
            }
            ServiceError::NoSlot { .. } | ServiceError::NoOperatorSlot { .. } | ServiceError::Place(_) => {
                FailureKind::Taken
            }
            ServiceError::BufferSize { .. } => FailureKind::Invalid,
            _ => FailureKind::Other,
        };
        Self::new(kind, error.to_string())
    }
}

impl From<InstanceError> for LiveFailure {
    fn from(error: InstanceError) -> Self {
        Self::new(FailureKind::Other, error.to_string())
    }
}

impl From<Rejection> for LiveFailure {
    fn from(error: Rejection) -> Self {
        Self::invalid(error.to_string())
    }
}

impl From<FeedError> for LiveFailure {
    fn from(error: FeedError) -> Self {
        let kind = match error {
            FeedError::Invalid(_) => FailureKind::Invalid,
            FeedError::NotSent(_) => FailureKind::Other,
            FeedError::HandedOver => FailureKind::Taken,
        };
        Self::new(kind, error.to_string())
    }
}

impl From<PreviewSendError> for LiveFailure {
    fn from(error: PreviewSendError) -> Self {
        let kind = match error {
            PreviewSendError::Positions { .. }
            | PreviewSendError::Radii { .. }
            | PreviewSendError::NotFinite { .. }
            | PreviewSendError::Invalid(_) => FailureKind::Invalid,
            PreviewSendError::NotSent(_) => FailureKind::Other,
            PreviewSendError::HandedOver => FailureKind::Taken,
        };
        Self::new(kind, error.to_string())
    }
}

impl From<DeadManError> for LiveFailure {
    fn from(error: DeadManError) -> Self {
        let kind = match error {
            DeadManError::NotSent(_) => FailureKind::Other,
            DeadManError::HandedOver => FailureKind::Taken,
        };
        Self::new(kind, error.to_string())
    }
}

impl From<JointStateError> for LiveFailure {
    fn from(error: JointStateError) -> Self {
        let kind = match error {
            JointStateError::Invalid(_) => FailureKind::Invalid,
            JointStateError::NotSent(_) => FailureKind::Other,
        };
        Self::new(kind, error.to_string())
    }
}

impl From<GatewayError> for LiveFailure {
    fn from(error: GatewayError) -> Self {
        let kind = match &error {
            GatewayError::Unreachable { .. } | GatewayError::Gone(_) => FailureKind::NoDaemon,
            GatewayError::Refused(_) => FailureKind::Refused,
            GatewayError::Invalid(_) => FailureKind::Invalid,
        };
        Self::new(kind, error.to_string())
    }
}

impl From<RequestError> for LiveFailure {
    fn from(error: RequestError) -> Self {
        let kind = match &error {
            RequestError::Invalid(_) => FailureKind::Invalid,
            RequestError::NoAnswer(_) => FailureKind::NoAnswer,
            RequestError::NotConnected(_) => FailureKind::Taken,
            RequestError::Refused { status, detail, value, .. } => {
                let refusal = Some((i32::from(*status), *detail, *value));
                return Self { refusal, ..Self::new(FailureKind::Refused, error.to_string()) };
            }
        };
        Self::new(kind, error.to_string())
    }
}

impl From<StopError> for LiveFailure {
    fn from(error: StopError) -> Self {
        let kind = match &error {
            StopError::NoDaemon { .. } => FailureKind::NoDaemon,
            StopError::Instance(_) => FailureKind::Other,
            _ => FailureKind::NoAnswer,
        };
        let text = match &error {
            StopError::NoDaemon { .. } => error.to_string(),
            _ => format!("{error}; use the arm's own stop button"),
        };
        Self::new(kind, text)
    }
}
