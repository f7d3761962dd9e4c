//! The newest refusal of a kind of message, as on the wire.

use foretrace_control::pen::{PenRefusal, PenRejection};
use foretrace_control::units::Stamp;
use foretrace_shm as shm;
use foretrace_shm::{RejectReason, Rejection};

/// The newest refusal of one kind of message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Refused {
    /// Reason, field, value and bound.
    pub why: Rejection,
    /// When it was refused.
    pub at: Stamp,
}

/// The pen grid's refusal as on the wire; `None` if its sender cannot remedy it.
#[must_use]
pub fn pen_rejection(refusal: &PenRefusal) -> Option<Rejection> {
    let coordinate = if refusal.axis == Some(1) { "y_m" } else { "x_m" };
    let (reason, field) = match refusal.why {
        PenRejection::NonFinite => (RejectReason::NotFinite, coordinate),
        PenRejection::OutOfRange => (RejectReason::OutOfRange, coordinate),
        PenRejection::FromFuture => (RejectReason::FromTheFuture, "device_stamp_ns"),
        PenRejection::TimeBackwards => (RejectReason::TimeBackwards, "device_stamp_ns"),
        PenRejection::Repeat | PenRejection::Outlier => return None,
    };
    Some(Rejection::new(reason, field).because(refusal.value, refusal.bound))
}

/// As on the wire.
#[must_use]
pub fn refused(refused: Option<Refused>) -> shm::Refused {
    refused.map_or(shm::Refused::NONE, |Refused { why, at }| shm::Refused::of(&why, at.0))
}
