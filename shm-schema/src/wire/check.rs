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
        let text = |rejection: Rejection| rejection.to_string();
        let degrees = within("q", &[0.0, 0.0, 57.3], 12.6).unwrap_err();
        assert_eq!(text(degrees), "q[2] = 57.3000 rad, legal ±12.6000 rad: degrees?");
        let nan = within("qd", &[f64::NAN], 100.0).unwrap_err();
        assert_eq!(text(nan), "qd[0] = NaN: it must be a finite number");
        let future = Rejection::new(RejectReason::FromTheFuture, "stamp_ns");
        assert!(
            text(future.because(0.41, 0.02))
                .starts_with("stamp_ns lies 0.410 s in the future, allowed 0.020 s")
        );
        assert!(text(future.because(1.7e9, 0.02)).contains("the time of day?"));
        for reason in RejectReason::ALL {
            let words = text(Rejection::new(*reason, "stamp_ns"));
            assert!(words.starts_with("stamp_ns") && words.len() > "stamp_ns".len() + 5, "{words}");
        }
    }

    /// The text of a refusal of `field` with this evidence.
    fn words(reason: RejectReason, field: &'static str, value: f64, bound: f64) -> String {
        Rejection::new(reason, field).because(value, bound).to_string()
    }

    #[test]
    fn guesses_end_where_degrees_do() {
        let out = |field, value| words(RejectReason::OutOfRange, field, value, 12.0);
        for (field, value, wanted) in [
            ("q", 720.0, "q = 720.0000 rad, legal ±12.0000 rad: degrees?"),
            ("q", -721.0, "q = -721.0000 rad, legal ±12.0000 rad"),
            ("qd", -3600.0, "qd = -3600.0000 rad/s, legal ±12.0000 rad/s: degrees per second?"),
            ("qd", 3601.0, "qd = 3601.0000 rad/s, legal ±12.0000 rad/s"),
            ("x_m", 152.0, "x_m = 152.0000 m, legal ±12.0000 m: millimetres or pixels?"),
            ("y_m", -152.0, "y_m = -152.0000 m, legal ±12.0000 m: millimetres or pixels?"),
            ("pressure", 40.0, "pressure = 40.0000, legal ±12.0000: it goes from 0 to 1"),
            ("tilt_x_rad", 40.0, "tilt_x_rad = 40.0000 rad, legal ±12.0000 rad"),
            ("tilt_y_rad", 40.0, "tilt_y_rad = 40.0000 rad, legal ±12.0000 rad"),
            ("effort", 40.0, "effort = 40.0000, legal ±12.0000"),
        ] {
            assert_eq!(out(field, value), wanted);
        }
    }

    #[test]
    fn the_edge_of_a_device_is_one_sided_and_that_of_the_wire_is_not() {
        let out = |bound| words(RejectReason::OutOfRange, "y_m", 11.0, bound);
        assert!(
            out(-0.2).contains("beyond the edge of the device at -0.2000 m (pen.bounds_m)"),
            "{}",
            out(-0.2)
        );
        assert!(out(PEN_POSITION_LIMIT_M).contains("legal ±10.0000 m"));
        assert_eq!(words(RejectReason::OutOfRange, "q", 1.0, f64::NAN), "q is out of range");
        assert!(words(RejectReason::OutOfRange, "q", 1.0, 0.5).contains("legal ±0.5000 rad"));
    }

    #[test]
    fn echoes_and_names_are_explained_in_words_of_their_own() {
        for (field, wanted) in [
            ("command_tick", " = 7 names no command of this daemon, whose newest is 5"),
            ("pen_sequence", " = 7 is not the pen sample of that command, which is 5"),
            ("command_accepted_ns", " lies 7.000000 s before that command was sent"),
            ("predictor", " is not a name: 1 to 27 lower-case letters"),
        ] {
            let text = words(RejectReason::OutOfRange, field, 7.0, 5.0);
            assert!(text.starts_with(&format!("{field}{wanted}")), "{text}");
        }
    }

    #[test]
    fn stamps_say_by_how_much_and_values_without_evidence_only_why() {
        let stamp = |reason, value| words(reason, "stamp_ns", value, 0.5);
        assert!(stamp(RejectReason::FromTheFuture, ANOTHER_CLOCK_S).contains("allowed 0.500 s"));
        assert!(stamp(RejectReason::FromTheFuture, ANOTHER_CLOCK_S + 1.0).contains("the time of day?"));
        assert_eq!(stamp(RejectReason::FromTheFuture, f64::NAN), "stamp_ns lies in the future");
        assert!(words(RejectReason::FromTheFuture, "sent_ns", 7e3, 0.1).contains("7000.000 s in the future"));
        assert!(stamp(RejectReason::TooOld, 2.0).starts_with("stamp_ns is 2.000 s old, allowed 0.500 s"));
        assert_eq!(stamp(RejectReason::TooOld, f64::NAN), "stamp_ns: too old");
        assert!(
            stamp(RejectReason::TimeBackwards, 2.0).contains("lies 2.000000 s before the message before")
        );
        assert_eq!(stamp(RejectReason::TimeBackwards, f64::NAN), "stamp_ns: time backwards");
        assert!(stamp(RejectReason::Replayed, 2.0).ends_with("was seen already: replayed, or two senders"));
        assert!(stamp(RejectReason::ForeignBoot, 2.0).contains("is of another boot of this machine"));
        assert_eq!(words(RejectReason::UnknownEnum, "mode", 9.0, 0.0), "mode = 9 is not a known value");
        assert_eq!(words(RejectReason::UnknownEnum, "mode", f64::NAN, 0.0), "mode: unknown enum");
    }

    #[test]
    fn refusals_are_equal_by_reason_and_field_whatever_the_evidence() {
        let refused = Rejection::new(RejectReason::TooOld, "stamp_ns");
        assert_eq!(refused, refused.because(1.0, 2.0).at(3));
        assert_ne!(refused, Rejection::new(RejectReason::TooOld, "sent_ns"));
        assert_ne!(refused, Rejection::new(RejectReason::Replayed, "stamp_ns"));
    }

    #[test]
    fn counts_add_up_and_stay_at_the_largest() {
        let mut counts = Rejections::ZERO;
        let refused = Rejection::new(RejectReason::TooOld, "stamp_ns");
        (0..3).for_each(|_| counts.count(refused));
        counts.count(Rejection::new(RejectReason::Replayed, "sequence"));
        assert_eq!((counts.of(RejectReason::TooOld), counts.of(RejectReason::NotFinite)), (3, 0));
        assert_eq!(counts.total(), 4);
        counts.by_reason[RejectReason::TooOld as usize] = u64::MAX;
        counts.count(refused);
        assert_eq!((counts.of(RejectReason::TooOld), counts.total()), (u64::MAX, u64::MAX));
    }

    #[test]
    fn masks_may_have_known_bits_only_and_unknown_numbers_are_quoted() {
        for (mask, ok) in [(0, true), (0b100, true), (0b101, true), (0b010, false), (0b111, false)] {
            assert_eq!(flags("flags", mask, 0b101).is_ok(), ok, "{mask:b}");
        }
        let mode: Result<crate::Mode, Rejection> = known("mode", 99_u32);
        let refused = mode.unwrap_err();
        assert_eq!((refused.reason, refused.field, refused.value), (RejectReason::UnknownEnum, "mode", 99.0));
        assert_eq!(known::<u32, crate::Mode>("mode", 2), Ok(crate::Mode::Following));
        assert_eq!(number("x", 2.0, 1.0).unwrap_err().bound, 1.0);
    }
}
