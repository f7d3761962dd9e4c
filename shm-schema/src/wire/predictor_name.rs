//! `PredictorName`: a predictor's name as text, so that a message can carry one that its reader does not
//! know.
//!
//! Contract: lower-case letters, digits and hyphens, then NUL to the end, at least one; all NUL: none. Total
//! for every bit pattern: the bytes of a foreign writer are a name, none, or refused, and never reach a
//! terminal or a log unchecked.

use std::fmt;

use iceoryx2::prelude::ZeroCopySend;

use super::check::Rejection;
use super::layout::wire;
use super::vocabulary::RejectReason;

/// Bytes of a name with its NUL; with a `u32` beside it a multiple of eight.
pub const PREDICTOR_NAME_BYTES: usize = 28;

wire! {
    /// A predictor's name, or none.
    "foretrace.PredictorNameV1"
    pub struct PredictorName {
        /// ASCII, padded with NUL.
        pub bytes: [u8; PREDICTOR_NAME_BYTES],
    }
}

impl PredictorName {
    /// No name.
    pub const NONE: Self = Self { bytes: [0; PREDICTOR_NAME_BYTES] };

    /// `text` as a name; `None` if it is empty, longer than 27 bytes, or has other characters than lower-case
    /// letters, digits and hyphens.
    #[must_use]
    pub fn new(text: &str) -> Option<Self> {
        let mut name = Self::NONE;
        name.bytes.get_mut(..text.len())?.copy_from_slice(text.as_bytes());
        (name.text() == Some(text) && !text.is_empty()).then_some(name)
    }

    /// The name; `None` if there is none, or an illegal one.
    #[must_use]
    pub fn as_str(&self) -> Option<&str> {
        self.text().filter(|text| !text.is_empty())
    }

    /// The bytes as text, possibly empty.
    fn text(&self) -> Option<&str> {
        let end = self.bytes.iter().position(|byte| *byte == 0)?;
        let (text, padding) = self.bytes.split_at_checked(end)?;
        let legal = |byte: &u8| matches!(byte, b'a'..=b'z' | b'0'..=b'9' | b'-');
        (text.iter().all(legal) && padding.iter().all(|byte| *byte == 0))
            .then(|| std::str::from_utf8(text).ok())
            .flatten()
    }

    /// Checks the bytes; no name is legal.
    pub(super) fn check(&self, field: &'static str) -> Result<(), Rejection> {
        self.text().map(|_| ()).ok_or(Rejection::new(RejectReason::UnknownEnum, field))
    }

    /// Checks that there is a name.
    pub(super) fn check_named(&self, field: &'static str) -> Result<(), Rejection> {
        self.as_str().map(|_| ()).ok_or(Rejection::new(RejectReason::UnknownEnum, field))
    }
}

/// The name, known or not; `unknown` if there is none.
impl fmt::Display for PredictorName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.as_str().unwrap_or("unknown"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_come_back_as_they_were_given() {
        for text in ["hold", "ar-rls", "x", "a-predictor-of-27-bytes-000"] {
            let name = PredictorName::new(text).unwrap();
            assert_eq!((name.as_str(), name.to_string()), (Some(text), text.to_owned()));
            assert_eq!(name.check_named("predictor"), Ok(()));
        }
    }

    #[test]
    fn what_is_no_name_is_not_made_one() {
        for text in ["", "Hold", "a b", "a\0b", "é", "\u{1b}[2J", "a-predictor-of-28-bytes-0000"] {
            assert_eq!(PredictorName::new(text), None, "{text:?}");
        }
    }

    #[test]
    fn bytes_of_a_foreign_writer_are_a_name_or_refused() {
        let mut bytes = PredictorName::NONE.bytes;
        bytes[..4].copy_from_slice(b"hold");
        assert_eq!(PredictorName { bytes }.as_str(), Some("hold"));
        // Behind the end, before it, in place of it, and without an end.
        let spoilt = [(5, b'x'), (0, 0), (4, 0xff), (4, 0x1b)].map(|(at, byte)| {
            let mut bytes = bytes;
            bytes[at] = byte;
            bytes
        });
        for bytes in spoilt.into_iter().chain([[b'a'; PREDICTOR_NAME_BYTES]]) {
            let name = PredictorName { bytes };
            assert_eq!((name.as_str(), name.to_string()), (None, "unknown".to_owned()));
            assert_eq!(name.check("predictor").unwrap_err().field, "predictor");
        }
        assert_eq!(PredictorName::NONE.check("predictor"), Ok(()));
        assert!(PredictorName::NONE.check_named("predictor").is_err());
    }

    #[test]
    fn names_pad_like_text() {
        let name = PredictorName::new("hold").unwrap();
        assert_eq!(format!("[{name:>6}|{:<8}]", PredictorName::NONE), "[  hold|unknown ]");
    }
}
