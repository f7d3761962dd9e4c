//! What programs in other languages are told of the wire: which messages, enumerations and flags, and how
//! their names and documentation read there.
//!
//! Contract: made from the tables of `wire!`, `wire_enum!` and `wire_flags!` alone.

use super::control::ControlResponse;
use super::flags::{arm_flags, command_flags, guard_mask, health, missing_rights, pen_flags, preview_flags};
use super::joints::{JointCommand, JointState};
use super::layout::{Wire, WireShape, fnv1a};
use super::pen::PenSample;
use super::pen_step::{PenMotion, PenPreview, PenStep};
use super::refused::RejectField;
use super::robot_mode::{RobotMode, SafetyMode};
use super::status::{GhostState, PreviewRefusal, Status};
use super::stop_detail::StopCause;
use super::tick_record::TickRecord;
use super::vocabulary::{
    ControlOp, ControlStatus, EffortUnit, FaultReason, Mode, RejectReason, Rung, SolverPath, Stage,
    TrustReason,
};

/// Name in the source, number, and label of a variant.
pub(super) type WireVariant = (String, i64, &'static str);

/// The messages that a program in another language meets.
pub(super) const MESSAGES: [WireShape; 8] = [
    PenSample::SHAPE,
    JointCommand::SHAPE,
    JointState::SHAPE,
    TickRecord::SHAPE,
    Status::SHAPE,
    ControlResponse::SHAPE,
    PenStep::SHAPE,
    PenPreview::SHAPE,
];

/// One number for the layout of [`MESSAGES`].
pub(super) const LAYOUT_HASH: u64 = {
    let hashes = [
        PenSample::LAYOUT_HASH,
        JointCommand::LAYOUT_HASH,
        JointState::LAYOUT_HASH,
        TickRecord::LAYOUT_HASH,
        Status::LAYOUT_HASH,
        ControlResponse::LAYOUT_HASH,
        PenStep::LAYOUT_HASH,
        PenPreview::LAYOUT_HASH,
    ];
    let mut bytes = [0; 64];
    let mut i = 0;
    while i < bytes.len() {
        bytes[i] = hashes[i / 8].to_le_bytes()[i % 8];
        i += 1;
    }
    fnv1a(&bytes)
};

/// Every enumeration of [`MESSAGES`] and requests, by its name in the source.
pub(super) fn enumerations() -> Vec<(&'static str, Vec<WireVariant>)> {
    macro_rules! of {
        ($($kind:ident)+) => {vec![$({
            let variants = $kind::ALL
                .iter()
                .map(|variant| (format!("{variant:?}"), *variant as i64, variant.label()))
                .collect();
            (stringify!($kind), variants)
        }),+]};
    }
    of! {
        Mode Rung TrustReason SolverPath FaultReason StopCause SafetyMode RobotMode EffortUnit ControlOp
        ControlStatus Stage RejectReason RejectField GhostState PenMotion PreviewRefusal
    }
}

/// Every flag word, by its name in the source, with its bits.
pub(super) fn flag_words() -> Vec<(&'static str, &'static [(&'static str, u32)])> {
    macro_rules! of {
        ($($word:ident)+) => {vec![$((stringify!($word), $word::NAMES)),+]};
    }
    of!(pen_flags command_flags arm_flags guard_mask health missing_rights preview_flags)
}

/// `FooBar2` as `foo_bar2`.
pub(super) fn snake(name: &str) -> String {
    let mut words = String::new();
    for letter in name.chars() {
        if letter.is_uppercase() && !words.is_empty() {
            words.push('_');
        }
        words.extend(letter.to_lowercase());
    }
    words
}

/// `FooBar2` as `FOO_BAR2`.
pub(super) fn screaming(name: &str) -> String {
    snake(name).to_uppercase()
}

/// The lines of documentation in attributes as `stringify!` writes them, which breaks lines where it likes.
pub(super) fn doc_lines(attributes: &str) -> Vec<String> {
    let mut lines = Vec::new();
    let mut rest = attributes;
    while let Some((_, after)) = rest.split_once("doc =") {
        let Some((before, body)) = after.split_once('"') else { break };
        let (text, left) = if before.trim_start().starts_with('r') {
            let closing = format!("\"{}", "#".repeat(before.matches('#').count()));
            let (text, left) = body.split_once(closing.as_str()).unwrap_or((body, ""));
            (text.to_owned(), left)
        } else {
            unescaped(body)
        };
        lines.push(text.trim().to_owned());
        rest = left;
    }
    lines
}

/// A literal up to its closing quote, and what follows it.
fn unescaped(body: &str) -> (String, &str) {
    let (mut text, mut letters) = (String::new(), body.char_indices());
    while let Some((at, letter)) = letters.next() {
        match letter {
            '"' => return (text, body.get(at + 1..).unwrap_or_default()),
            '\\' => match letters.next() {
                Some((_, 'n' | 't' | 'r')) => text.push(' '),
                Some((_, escaped)) => text.push(escaped),
                None => {}
            },
            _ => text.push(letter),
        }
    }
    (text, "")
}

/// The documentation in attributes as `stringify!` writes them, without the marks of rustdoc.
pub(super) fn documentation(attributes: &str) -> String {
    doc_lines(attributes)
        .join(" ")
        .replace("\\[", "\u{1}")
        .replace("\\]", "\u{2}")
        .replace("mod@", "")
        .replace(['[', ']', '`'], "")
        .replace('\u{1}', "[")
        .replace('\u{2}', "]")
        .replace("::", ".")
        .replace("*/", "* /")
        .trim()
        .to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_rust_become_names_of_others() {
        assert_eq!(snake("JointCommand"), "joint_command");
        assert_eq!(screaming("PreviousPlan"), "PREVIOUS_PLAN");
        assert_eq!(
            documentation(
                "doc = r\" Position \\[m\\] of [`mod@health`].\"\ndoc = \" Two */ lines.\"\nallow(x)\n"
            ),
            "Position [m] of health. Two * / lines."
        );
        // As long lines are broken, raw with a quote inside, and escaped.
        assert_eq!(
            documentation(
                "doc =\nr\" Many words.\"\ndoc =\n    r#\" Says \"so\", doc = x.\"#\nallow(x)\ndoc = \" a \\\"b\\\" \\\\[s\\\\]\"\n"
            ),
            "Many words. Says \"so\", doc = x. a \"b\" [s]"
        );
        assert_eq!(documentation("allow(x)\n"), "");
    }
}
