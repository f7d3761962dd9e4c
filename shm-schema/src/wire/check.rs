//! Validation of messages: checks of single fields, the reasons of refusal, and counters per reason.
//!
//! Contract: pure, no allocation, total for every bit pattern. A refusal names its reason, the field, the
//! value found and the bound it broke, so that the sender can be fixed.

use std::fmt;

use iceoryx2::prelude::ZeroCopySend;

use super::layout::{Wire, wire};
use super::pen::PEN_POSITION_LIMIT_M;
use super::vocabulary::{REJECT_REASONS, RejectReason, UnknownValue};

/// One refusal. Two are equal if reason and field are: the evidence differs from message to message.
#[derive(Clone, Copy, thiserror::Error)]
pub struct Rejection {
    /// The reason.
    pub reason: RejectReason,
    /// The field.
    pub field: &'static str,
    /// The element, if the field is an array.
    pub index: Option<u8>,
    /// The value found, in the field's unit; for stamps the distance from the expected value \[s\].
    pub value: f64,
    /// The bound that was broken, in the same unit; NaN if there is none.
    pub bound: f64,
}

crate::debug_as_display!(Rejection);

impl PartialEq for Rejection {
    fn eq(&self, other: &Self) -> bool {
        (self.reason, self.field) == (other.reason, other.field)
    }
}

impl Eq for Rejection {}

impl Rejection {
    /// A refusal without evidence.
    #[must_use]
    pub const fn new(reason: RejectReason, field: &'static str) -> Self {
        Self { reason, field, index: None, value: f64::NAN, bound: f64::NAN }
    }

    /// The same with the value found and the bound it broke.
    #[must_use]
    pub const fn because(self, value: f64, bound: f64) -> Self {
        Self { value, bound, ..self }
    }

    /// The same, of one element of an array.
    #[must_use]
    pub const fn at(self, index: u8) -> Self {
        Self { index: Some(index), ..self }
    }
}

/// Unit of a field, by its name; empty if it has none.
fn unit(field: &str) -> &'static str {
    match field {
        "q" | "tilt_x_rad" | "tilt_y_rad" => " rad",
        "qd" => " rad/s",
        "x_m" | "y_m" => " m",
        _ => "",
    }
}

/// The likely cause of a value far out of range.
fn guess(field: &str, value: f64) -> &'static str {
    match field {
        "q" if value.abs() <= 720.0 => ": degrees?",
        "qd" if value.abs() <= 3600.0 => ": degrees per second?",
        "x_m" | "y_m" => ": millimetres or pixels?",
        "pressure" => ": it goes from 0 to 1",
        _ => "",
    }
}

/// A stamp this far ahead is from another clock, not early \[s\].
const ANOTHER_CLOCK_S: f64 = 3600.0;

impl fmt::Display for Rejection {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { reason, field, index, value, bound } = *self;
        f.write_str(field)?;
        if let Some(index) = index {
            write!(f, "[{index}]")?;
        }
        match reason {
            _ if field == "command_tick" => {
                write!(f, " = {value:.0} names no command of this daemon, whose newest is {bound:.0}")
            }
            _ if field == "pen_sequence" => {
                write!(f, " = {value:.0} is not the pen sample of that command, which is {bound:.0}")
            }
            _ if field == "command_accepted_ns" => {
                write!(f, " lies {value:.6} s before that command was sent: stamp by CLOCK_MONOTONIC")
            }
            _ if field == "predictor" => {
                write!(f, " is not a name: 1 to 27 lower-case letters, digits and hyphens")
            }
            RejectReason::NotFinite => write!(f, " = {value}: it must be a finite number"),
            RejectReason::OutOfRange if bound.is_nan() => write!(f, " is out of range"),
            // The device's own edge, which is one-sided.
            RejectReason::OutOfRange
                if matches!(field, "x_m" | "y_m") && bound.abs() < PEN_POSITION_LIMIT_M =>
            {
                let guess = guess(field, value);
                write!(
                    f,
                    " = {value:.4} m, beyond the edge of the device at {bound:.4} m (pen.bounds_m){guess}"
                )
            }
            RejectReason::OutOfRange => {
                let unit = unit(field);
                write!(f, " = {value:.4}{unit}, legal ±{bound:.4}{unit}{}", guess(field, value))
            }
            RejectReason::UnknownEnum if !value.is_nan() => write!(f, " = {value} is not a known value"),
            RejectReason::FromTheFuture if value.is_nan() => write!(f, " lies in the future"),
            RejectReason::FromTheFuture if field == "sent_ns" => write!(
                f,
                " lies {value:.3} s in the future, allowed {bound:.3} s: date an order by CLOCK_MONOTONIC, when \
                 it was decided"
            ),
            RejectReason::FromTheFuture if value > ANOTHER_CLOCK_S => write!(
                f,
                " lies {value:.0} s in the future: the time of day? Stamp by CLOCK_MONOTONIC \
                 (`monotonic_now_ns()`)"
            ),
            RejectReason::FromTheFuture => write!(
                f,
                " lies {value:.3} s in the future, allowed {bound:.3} s: stamp by CLOCK_MONOTONIC, when it \
                 was measured"
            ),
            RejectReason::TooOld if !value.is_nan() => write!(
                f,
                " is {value:.3} s old, allowed {bound:.3} s: stamp by CLOCK_MONOTONIC, when it was measured"
            ),
            RejectReason::TimeBackwards if !value.is_nan() => {
                write!(f, " lies {value:.6} s before the message before it: send in the order of stamps")
            }
            RejectReason::Replayed => write!(f, " was seen already: replayed, or two senders"),
            RejectReason::ForeignBoot => write!(f, " is of another boot of this machine: restart the sender"),
            _ => write!(f, ": {}", reason.label()),
        }
    }
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
    /// Counts one refusal.
    pub fn count(&mut self, rejection: Rejection) {
        if let Some(counter) = self.by_reason.get_mut(rejection.reason as usize) {
            *counter = counter.saturating_add(1);
        }
    }

    /// Count for this reason.
    pub fn of(&self, reason: RejectReason) -> u64 {
        self.by_reason.get(reason as usize).copied().unwrap_or(0)
    }

    /// All refusals.
    pub fn total(&self) -> u64 {
        self.by_reason.iter().fold(0, |sum, n| sum.saturating_add(*n))
    }
}

/// A message body that can be validated.
pub trait Validate: Wire {
    /// Checks every field but the header.
    ///
    /// # Errors
    ///
    /// The first field that is non-finite, out of range, or holds an unknown enum or flag.
    fn validate(&self) -> Result<(), Rejection>;
}

/// Checks one number.
pub(crate) fn number(field: &'static str, value: f64, limit: f64) -> Result<(), Rejection> {
    if !value.is_finite() {
        return Err(Rejection::new(RejectReason::NotFinite, field).because(value, limit));
    }
    if value.abs() > limit {
        return Err(Rejection::new(RejectReason::OutOfRange, field).because(value, limit));
    }
    Ok(())
}

/// Checks every number of an array.
pub(crate) fn within(field: &'static str, values: &[f64], limit: f64) -> Result<(), Rejection> {
    for (index, value) in (0_u8..).zip(values) {
        number(field, *value, limit).map_err(|rejection| rejection.at(index))?;
    }
    Ok(())
}

pub(crate) fn flags(field: &'static str, mask: u32, known: u32) -> Result<(), Rejection> {
    if mask & !known == 0 { Ok(()) } else { Err(Rejection::new(RejectReason::UnknownFlags, field)) }
}

pub(crate) fn known<N, E>(field: &'static str, value: N) -> Result<E, Rejection>
where
    E: TryFrom<N, Error = UnknownValue>,
{
    E::try_from(value).map_err(|UnknownValue { value, .. }| {
        Rejection::new(RejectReason::UnknownEnum, field).because(value as f64, f64::NAN)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reasons_index_their_own_counter() {
        let mut counts = Rejections::ZERO;
        for (index, &reason) in RejectReason::ALL.iter().enumerate() {
            counts.count(Rejection::new(reason, "x"));
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

    #[test]
    fn words_name_field_value_bound_and_what_it_most_likely_is() {
        let told = |rejection: Rejection| rejection.to_string();
        let degrees = within("q", &[0.0, 0.0, 57.3], 12.6).unwrap_err();
        assert_eq!(told(degrees), "q[2] = 57.3000 rad, legal ±12.6000 rad: degrees?");
        let nan = within("qd", &[f64::NAN], 100.0).unwrap_err();
        assert_eq!(told(nan), "qd[0] = NaN: it must be a finite number");
        let future = Rejection::new(RejectReason::FromTheFuture, "stamp_ns");
        assert!(
            told(future.because(0.41, 0.02))
                .starts_with("stamp_ns lies 0.410 s in the future, allowed 0.020 s")
        );
        assert!(told(future.because(1.7e9, 0.02)).contains("the time of day?"));
        for reason in RejectReason::ALL {
            let words = told(Rejection::new(*reason, "stamp_ns"));
            assert!(words.starts_with("stamp_ns") && words.len() > "stamp_ns".len() + 5, "{words}");
        }
    }
}
