//! `ControlRequest` and `ControlResponse`: requests of operators and the daemon's answers.

use iceoryx2::prelude::ZeroCopySend;
use std::fmt;

use super::check::{Rejection, Validate, known, number};
use super::layout::wire;
use super::predictor_name::PredictorName;
use super::vocabulary::{ControlOp, ControlStatus, RejectReason};

/// Bytes of the text in a response.
pub const MESSAGE_BYTES: usize = 160;

/// How far ahead of the clock an order may be dated \[ns\]: that of a page is measured to some milliseconds.
pub const ORDER_AHEAD_NS: u64 = 100_000_000;

wire! {
    /// One request.
    "foretrace.ControlRequestV3"
    pub struct ControlRequest {
        /// Chosen by the client, returned in the response.
        pub token: u64,
        /// When it was sent, on the monotonic clock \[ns\]: a request to arm does not undo a stop that came
        /// after it.
        pub sent_ns: u64,
        /// The client's `host_boot_id()`.
        pub boot_id: u64,
        /// For `SetTrust`: α in \[0, 1\]; else 0.
        pub value: f64,
        /// [`ControlOp`].
        pub op: u32,
        /// For `SwitchPredictor`: its name; else none.
        pub predictor: PredictorName,
    }
}

wire! {
    /// One answer.
    "foretrace.ControlResponseV1"
    pub struct ControlResponse {
        /// The request's token.
        pub token: u64,
        /// The daemon's `host_boot_id()`.
        pub boot_id: u64,
        /// The daemon's `daemon_id`, as in its status.
        pub daemon_id: u64,
        /// A number of the answer: trust α for most, the invalid value for refusals.
        pub value: f64,
        /// [`ControlStatus`].
        pub status: i32,
        /// A number of the answer: the [`crate::Mode`] for `Ok`, joint or line for refusals.
        pub detail: u32,
        /// Bytes of `message` in use.
        pub message_len: u32,
        /// Zero.
        pub reserved: u32,
        /// Readable text, UTF-8.
        pub message: [u8; MESSAGE_BYTES],
    }
}

impl ControlRequest {
    /// A request without parameters.
    pub fn new(token: u64, boot_id: u64, op: ControlOp) -> Self {
        Self { token, boot_id, op: op.into(), predictor: PredictorName::NONE, value: 0.0, sent_ns: 0 }
    }

    /// Checks at `now_ns` that an order is not dated ahead by more than [`ORDER_AHEAD_NS`]: dated after a
    /// stop that comes meanwhile, it would outrank it. What ends motion counts whatever its date.
    ///
    /// # Errors
    ///
    /// `FromTheFuture`.
    pub fn check_date(&self, now_ns: u64) -> Result<(), Rejection> {
        let ahead_ns = self.sent_ns.saturating_sub(now_ns);
        let dateless = [ControlOp::Stop, ControlOp::Disarm, ControlOp::Query].map(u32::from);
        if ahead_ns <= ORDER_AHEAD_NS || dateless.contains(&self.op) {
            return Ok(());
        }
        Err(Rejection::new(RejectReason::FromTheFuture, "sent_ns")
            .because(ahead_ns as f64 * 1e-9, ORDER_AHEAD_NS as f64 * 1e-9))
    }
}

impl ControlResponse {
    /// An answer to `request`; `message` is cut at a character border if it does not fit.
    pub fn to(request: &ControlRequest, status: ControlStatus, message: &str) -> Self {
        let mut response = Self { token: request.token, status: status.into(), ..Self::default() };
        let len = (0..=message.len().min(MESSAGE_BYTES))
            .rev()
            .find(|&end| message.is_char_boundary(end))
            .unwrap_or(0);
        if let (Some(slot), Some(text)) = (response.message.get_mut(..len), message.as_bytes().get(..len)) {
            slot.copy_from_slice(text);
            response.message_len = len as u32;
        }
        response
    }

    /// The text; bytes that are not UTF-8 are replaced.
    pub fn text(&self) -> String {
        let len = (self.message_len as usize).min(MESSAGE_BYTES);
        String::from_utf8_lossy(self.message.get(..len).unwrap_or_default()).into_owned()
    }

    /// The status; an unknown number counts as an internal error.
    pub fn outcome(&self) -> ControlStatus {
        ControlStatus::try_from(self.status).unwrap_or(ControlStatus::Internal)
    }

    /// Whether the request was carried out or accepted.
    pub fn is_success(&self) -> bool {
        self.status >= 0 && ControlStatus::try_from(self.status).is_ok()
    }
}

impl fmt::Display for ControlResponse {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.outcome())?;
        if self.message_len > 0 { write!(f, ": {}", self.text()) } else { Ok(()) }
    }
}

impl Validate for ControlRequest {
    fn validate(&self) -> Result<(), Rejection> {
        let op = known::<_, ControlOp>("op", self.op)?;
        number("value", self.value, 1e6)?;
        match op {
            // Compared directly: a difference would round the smallest negative numbers to legal ones.
            ControlOp::SetTrust if !(0.0..=1.0).contains(&self.value) => {
                Err(Rejection::new(RejectReason::OutOfRange, "value"))
            }
            ControlOp::SwitchPredictor => self.predictor.check_named("predictor"),
            _ => self.predictor.check("predictor"),
        }
    }
}

impl Validate for ControlResponse {
    fn validate(&self) -> Result<(), Rejection> {
        known::<_, ControlStatus>("status", self.status)?;
        number("message_len", f64::from(self.message_len), MESSAGE_BYTES as f64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn request(op: ControlOp) -> ControlRequest {
        ControlRequest::new(1, 2, op)
    }

    #[test]
    fn trust_outside_zero_to_one_is_refused() {
        for (value, ok) in
            [(0.0, true), (1.0, true), (-0.01, false), (1.01, false), (-5e-324, false), (f64::NAN, false)]
        {
            let request = ControlRequest { value, ..request(ControlOp::SetTrust) };
            assert_eq!(request.validate().is_ok(), ok, "{value}");
        }
    }

    #[test]
    fn orders_dated_ahead_are_refused_with_amount_and_bound_and_stops_never() {
        let now = 7_000_000_000;
        for op in ControlOp::ALL {
            let ends = [ControlOp::Stop, ControlOp::Disarm, ControlOp::Query].contains(op);
            for (sent_ns, ok) in [
                (0, true),
                (now, true),
                (now + ORDER_AHEAD_NS, true),
                (now + ORDER_AHEAD_NS + 1, ends),
                (now + 5_000_000_000, ends),
                (u64::MAX, ends),
            ] {
                let checked = ControlRequest { sent_ns, ..request(*op) }.check_date(now);
                assert_eq!(checked.is_ok(), ok, "{op} {sent_ns}");
            }
        }
        let early = ControlRequest { sent_ns: now + 5_000_000_000, ..request(ControlOp::Arm) };
        let words = early.check_date(now).unwrap_err().to_string();
        assert!(words.contains("5.000 s in the future, allowed 0.100 s"), "{words}");
        assert!(words.len() <= MESSAGE_BYTES, "{words}");
    }

    #[test]
    fn unknown_operations_and_what_is_no_name_are_refused() {
        let unknown = ControlRequest { op: 10, ..request(ControlOp::Query) };
        assert_eq!(unknown.validate(), Err(Rejection::new(RejectReason::UnknownEnum, "op")));
        let unnamed = request(ControlOp::SwitchPredictor);
        assert_eq!(unnamed.validate().unwrap_err().field, "predictor");
        // Whether the predictor exists is for the daemon to say.
        let named = ControlRequest { predictor: PredictorName::new("my-own").unwrap(), ..unnamed };
        assert_eq!(named.validate(), Ok(()));
        let noise =
            ControlRequest { predictor: PredictorName { bytes: [0xff; 28] }, ..request(ControlOp::Arm) };
        assert_eq!(noise.validate().unwrap_err().field, "predictor");
    }

    #[test]
    fn a_long_message_is_cut_at_a_character_border() {
        let long = "é".repeat(MESSAGE_BYTES);
        let response = ControlResponse::to(&request(ControlOp::Arm), ControlStatus::WrongMode, &long[..]);
        assert_eq!(response.text(), "é".repeat(MESSAGE_BYTES / 2));
        let odd = format!("a{long}");
        let response = ControlResponse::to(&request(ControlOp::Arm), ControlStatus::WrongMode, &odd);
        assert_eq!(response.message_len as usize, MESSAGE_BYTES - 1);
    }

    #[test]
    fn foreign_text_and_lengths_cannot_hurt() {
        let response =
            ControlResponse { message: [0xff; MESSAGE_BYTES], message_len: u32::MAX, ..Default::default() };
        assert_eq!(response.text().chars().count(), MESSAGE_BYTES);
        assert!(response.validate().is_err());
        assert_eq!(ControlResponse { status: 9, ..Default::default() }.outcome(), ControlStatus::Internal);
    }

    #[test]
    fn only_known_statuses_from_zero_up_are_success() {
        for (status, success) in [(0, true), (1, true), (2, false), (-1, false), (-21, false), (-99, false)] {
            assert_eq!(ControlResponse { status, ..Default::default() }.is_success(), success, "{status}");
        }
    }

    #[test]
    fn an_answer_shows_its_status_and_its_text_if_there_is_one() {
        let request = ControlRequest { token: 7, ..request(ControlOp::Arm) };
        let answer = ControlResponse::to(&request, ControlStatus::Busy, "wait");
        assert_eq!(
            (answer.token, answer.outcome(), answer.text()),
            (7, ControlStatus::Busy, "wait".to_owned())
        );
        assert_eq!(answer.to_string(), "busy: wait");
        assert_eq!(ControlResponse::to(&request, ControlStatus::Ok, "").to_string(), "ok");
    }

    #[test]
    fn numbers_of_requests_and_answers_are_bounded() {
        for (value, ok) in [(1e6, true), (-1e6, true), (1.1e6, false), (f64::INFINITY, false)] {
            assert_eq!(
                ControlRequest { value, ..request(ControlOp::Query) }.validate().is_ok(),
                ok,
                "{value}"
            );
        }
        for (message_len, status, ok) in [(160, 0, true), (161, 0, false), (0, 2, false), (0, -21, true)] {
            let answer = ControlResponse { message_len, status, ..Default::default() };
            assert_eq!(answer.validate().is_ok(), ok, "{message_len} {status}");
        }
    }
}
