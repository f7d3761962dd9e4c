//! Refusing what must not enter: checks of single fields, the reasons of refusal, and counters per reason.
//!
//! Contract: pure, no allocation, total for every bit pattern. A refusal names its reason and the field.

use iceoryx2::prelude::ZeroCopySend;

use crate::layout::wire;
use crate::{REJECT_REASONS, RejectReason, UnknownValue, Wire};

/// One refusal.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("{field}: {}", reason.label())]
pub struct Rejection {
    /// Why.
    pub reason: RejectReason,
    /// Which field.
    pub field: &'static str,
}

wire! {
    /// Refusals by reason, indexed by [`RejectReason`].
    "foretrace.RejectionsV1"
    pub struct Rejections {
        /// One counter per reason.
        pub by_reason: [u64; REJECT_REASONS],
    }
}

impl Rejections {
    /// Count one refusal.
    pub fn count(&mut self, rejection: Rejection) {
        if let Some(counter) = self.by_reason.get_mut(rejection.reason as usize) {
            *counter = counter.saturating_add(1);
        }
    }

    /// How often for this reason.
    pub fn of(&self, reason: RejectReason) -> u64 {
        self.by_reason.get(reason as usize).copied().unwrap_or(0)
    }

    /// All refusals.
    pub fn total(&self) -> u64 {
        self.by_reason.iter().fold(0, |sum, n| sum.saturating_add(*n))
    }
}

/// A message body that can say whether its numbers make sense.
pub trait Validate: Wire {
    /// Check every field but the header.
    ///
    /// *Errors*: the first field that is not finite, out of range, or holds an unknown enum or flag.
    fn validate(&self) -> Result<(), Rejection>;
}

pub(crate) fn within(field: &'static str, values: &[f64], limit: f64) -> Result<(), Rejection> {
    for value in values {
        if !value.is_finite() {
            return Err(Rejection { reason: RejectReason::NotFinite, field });
        }
        if value.abs() > limit {
            return Err(Rejection { reason: RejectReason::OutOfRange, field });
        }
    }
    Ok(())
}

pub(crate) fn flags(field: &'static str, mask: u32, known: u32) -> Result<(), Rejection> {
    if mask & !known == 0 { Ok(()) } else { Err(Rejection { reason: RejectReason::UnknownFlags, field }) }
}

pub(crate) fn known<N, E>(field: &'static str, value: N) -> Result<E, Rejection>
where
    E: TryFrom<N, Error = UnknownValue>,
{
    E::try_from(value).map_err(|_| Rejection { reason: RejectReason::UnknownEnum, field })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reasons_index_their_own_counter() {
        let mut counts = Rejections::ZERO;
        for (index, &reason) in RejectReason::ALL.iter().enumerate() {
            counts.count(Rejection { reason, field: "x" });
            assert_eq!(counts.by_reason[index], 1);
            assert_eq!(counts.of(reason), 1);
        }
        assert_eq!(counts.total(), REJECT_REASONS as u64);
    }

    #[test]
    fn nan_is_not_finite_rather_than_out_of_range() {
        assert_eq!(within("x", &[0.0, f64::NAN], 1.0).unwrap_err().reason, RejectReason::NotFinite);
        assert_eq!(within("x", &[-1.1], 1.0).unwrap_err().reason, RejectReason::OutOfRange);
        assert_eq!(within("x", &[-1.0, 1.0], 1.0), Ok(()));
    }
}
