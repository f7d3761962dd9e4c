//! The line between an arm's process and the arm's controller, in words and as JSON.

use foretrace_client::wire::{ArmLine, arm_flags};
use serde_json::{Value, json};

/// `round trip 16 ms   0 late cycles   0 commands lost`; none where the arm has no such line.
pub(crate) fn words(line: &ArmLine) -> Option<String> {
    let bold = if without_dead_man(line) { "   WITHOUT A DEAD-MAN" } else { "" };
    let ArmLine { round_trip_ns, late_cycles, lost_commands, .. } = *line;
    let counted = format!("{late_cycles} late cycles   {lost_commands} commands lost");
    match round_trip_ns {
        0 if late_cycles == 0 && lost_commands == 0 => (!bold.is_empty()).then(|| bold.trim().to_owned()),
        0 => Some(format!("{counted}{bold}")),
        _ => Some(format!("round trip {:.0} ms   {counted}{bold}", round_trip_ns as f64 * 1e-6)),
    }
}

/// The same under stable keys; null where it is not known.
pub(crate) fn json(line: &ArmLine) -> Value {
    json!({
        "round_trip_ms": (line.round_trip_ns != 0).then_some(line.round_trip_ns as f64 * 1e-6),
        "late_cycles": line.late_cycles,
        "lost_commands": line.lost_commands,
        "without_dead_man": without_dead_man(line),
    })
}

fn without_dead_man(line: &ArmLine) -> bool {
    line.flags & arm_flags::WITHOUT_DEAD_MAN != 0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_arm_without_a_line_has_no_words_but_a_missing_dead_man_always_has() {
        assert_eq!(words(&ArmLine::default()), None);
        let flags = arm_flags::WITHOUT_DEAD_MAN;
        assert_eq!(words(&ArmLine { flags, ..ArmLine::default() }).as_deref(), Some("WITHOUT A DEAD-MAN"));
        let line = ArmLine { round_trip_ns: 16_000_000, late_cycles: 2, flags, ..ArmLine::default() };
        assert_eq!(
            words(&line).as_deref(),
            Some("round trip 16 ms   2 late cycles   0 commands lost   WITHOUT A DEAD-MAN")
        );
        assert_eq!(json(&line)["round_trip_ms"], 16.0);
        assert_eq!(json(&ArmLine::default())["round_trip_ms"], Value::Null);
    }
}
