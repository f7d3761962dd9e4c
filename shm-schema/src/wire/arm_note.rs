//! `ArmNote`: why an arm's process does not let the arm follow, in its own words, with what to do about it.
//!
//! Contract: sent when it changes, and once a second while it is in force, for a daemon that comes later.
//! Which one is in force says its number in every joint state, so that no tick carries text. Total
//! for every bit pattern: foreign bytes become text without control characters.

use std::fmt::Write as _;

use iceoryx2::prelude::ZeroCopySend;

use super::check::{Rejection, Validate};
use super::header::Header;
use super::layout::wire;
use super::vocabulary::RejectReason;

/// Bytes of each text, padded with NUL.
pub const NOTE_BYTES: usize = 192;
/// Ends a text that was cut.
const CUT: &str = "…";

wire! {
    /// What an arm's process says of its arm.
    "foretrace.ArmNoteV1"
    pub struct ArmNote {
        /// Stamp: when it was sent.
        pub header: Header,
        /// When it came into force, on this host's clock \[ns\].
        pub since_ns: u64,
        /// Its number, as in [`crate::JointState::note`]; not 0.
        pub number: u32,
        /// Zero.
        pub reserved: u32,
        /// What happened.
        pub words: NoteWords,
    }
}

wire! {
    /// What happened, and what to do about it: UTF-8, padded with NUL.
    "foretrace.NoteWordsV1"
    pub struct NoteWords {
        /// What happened; all NUL: none.
        pub text: [u8; NOTE_BYTES],
        /// What to do about it.
        pub to_do: [u8; NOTE_BYTES],
    }
}

impl NoteWords {
    /// `text` and `to_do`, each cut after [`NOTE_BYTES`].
    #[must_use]
    pub fn new(text: &str, to_do: &str) -> Self {
        Self { text: packed(text), to_do: packed(to_do) }
    }

    /// What happened; `None`: none.
    #[must_use]
    pub fn text(&self) -> Option<String> {
        Some(unpacked(&self.text)).filter(|text| !text.is_empty())
    }

    /// What to do about it; `None`: none.
    #[must_use]
    pub fn to_do(&self) -> Option<String> {
        Some(unpacked(&self.to_do)).filter(|text| !text.is_empty())
    }
}

impl Validate for ArmNote {
    fn validate(&self) -> Result<(), Rejection> {
        let ahead_ns = self.since_ns.saturating_sub(self.header.stamp_ns);
        let future =
            || Rejection::new(RejectReason::FromTheFuture, "since_ns").because(ahead_ns as f64 * 1e-9, 0.0);
        if ahead_ns == 0 { Ok(()) } else { Err(future()) }
    }
}

fn packed(text: &str) -> [u8; NOTE_BYTES] {
    let mut bytes = [0; NOTE_BYTES];
    let fits = |most: usize| {
        let ends = text.char_indices().map(|(at, char)| at + char.len_utf8());
        ends.take_while(|end| *end <= most).last().unwrap_or(0)
    };
    let (end, tail) =
        if text.len() <= NOTE_BYTES { (text.len(), "") } else { (fits(NOTE_BYTES - CUT.len()), CUT) };
    let kept = text.as_bytes().iter().take(end).chain(tail.as_bytes());
    bytes.iter_mut().zip(kept).for_each(|(slot, byte)| *slot = *byte);
    bytes
}

fn unpacked(bytes: &[u8; NOTE_BYTES]) -> String {
    let end = bytes.iter().position(|byte| *byte == 0).unwrap_or(NOTE_BYTES);
    let text = String::from_utf8_lossy(bytes.get(..end).unwrap_or_default());
    text.chars().fold(String::new(), |mut shown, char| {
        if is_plain(char) {
            shown.push(char);
        } else {
            // Writing to a String cannot fail.
            let _ = write!(shown, "{}", char.escape_unicode());
        }
        shown
    })
}

/// Neither a control character nor one that turns the direction of a line.
fn is_plain(char: char) -> bool {
    !char.is_control()
        && !matches!(char, '\u{200e}' | '\u{200f}' | '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}')
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_come_back_as_they_were_given_or_cut_between_characters() {
        let words = NoteWords::new("the speed slider is at 50 %", "");
        assert_eq!(words.text().as_deref(), Some("the speed slider is at 50 %"));
        assert_eq!(words.to_do(), None);
        for text in ["é".repeat(96), "é".repeat(97), "a".repeat(192), "a".repeat(193), "a€".repeat(60)] {
            let back = NoteWords::new(&text, "").text().unwrap();
            match back.strip_suffix(CUT) {
                Some(kept) => assert!(text.starts_with(kept) && text.len() > NOTE_BYTES && kept.len() > 180),
                None => assert_eq!(back, text),
            }
        }
        assert_eq!(NoteWords::default().text(), None);
    }

    #[test]
    fn a_note_came_into_force_before_it_was_sent() {
        let mut note = ArmNote { since_ns: 5, ..ArmNote::default() };
        assert_eq!(note.validate().unwrap_err().reason, RejectReason::FromTheFuture);
        note.header.stamp_ns = 5;
        assert_eq!(note.validate(), Ok(()));
    }

    #[test]
    fn foreign_bytes_reach_no_terminal() {
        let hostile = NoteWords { text: [0xff; NOTE_BYTES], to_do: [0x1b; NOTE_BYTES] };
        assert_eq!(hostile.text().unwrap().chars().count(), NOTE_BYTES);
        assert!(hostile.to_do().unwrap().starts_with("\\u{1b}"));
        let turned = NoteWords::new("a\u{202e}b\nc", "");
        assert_eq!(turned.text().as_deref(), Some("a\\u{202e}b\\u{a}c"));
    }

    #[test]
    fn refusals_of_a_note_say_by_how_much_it_is_early() {
        let note = ArmNote { since_ns: 1_500_000_000, ..ArmNote::default() };
        let refused = note.validate().unwrap_err();
        assert!((refused.value - 1.5).abs() < 1e-9 && refused.field == "since_ns", "{refused}");
        assert_eq!(NoteWords::new("a", "b").to_do().as_deref(), Some("b"));
    }

    #[test]
    fn a_text_is_cut_as_late_as_it_can_be() {
        for (text, kept) in [("a".repeat(192), 192), ("a".repeat(193), 189), ("é".repeat(97), 188)] {
            let back = NoteWords::new(&text, "").text().unwrap();
            assert_eq!(back.trim_end_matches(CUT).len(), kept);
        }
    }
}
