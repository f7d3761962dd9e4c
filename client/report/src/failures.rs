//! Errors of the client library as failures, with their causes and remedies.

use foretrace_client::wire::ControlStatus;
use foretrace_client::{RequestError, ServiceError};
use foretrace_failure::{Cause, Failure};

/// What to do where a controller does not answer as it should.
pub const DOCTOR: &str = "`foretrace doctor --robot HOST` looks at every port and says what to do";

/// The failure that a service's error means.
pub fn unattached(error: ServiceError) -> Failure {
    let cause = match error {
        ServiceError::NoDaemon { .. } => Cause::NoDaemon,
        _ => Cause::Failed,
    };
    Failure::new(cause, error, "")
}

/// The failure that a request's error means.
pub fn refused(error: &RequestError) -> Failure {
    match error {
        RequestError::Refused { .. } => Failure::new(Cause::Refused, error, "see `foretrace status`"),
        RequestError::Invalid(_) => Failure::usage(error, ""),
        RequestError::NoAnswer(_) | RequestError::NotConnected(_) => Failure::failed(error, ""),
    }
}

/// A refusal to arm that may be transient: the arm has not reported yet.
pub fn may_pass(error: &RequestError) -> bool {
    match error {
        RequestError::NoAnswer(_) | RequestError::NotConnected(_) => true,
        other => matches!(
            other.refusal(),
            Some(
                ControlStatus::NoJointState
                    | ControlStatus::JointStateStale
                    | ControlStatus::RobotNotReady
                    | ControlStatus::Busy
            )
        ),
    }
}
