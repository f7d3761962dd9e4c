//! What a row of an export of events is about: PointerEvent of browsers, MotionEvent of Android, UITouch.

use super::number::number;

/// Which interface tells of it; of one motion that several tell, the last counts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum EventFamily {
    /// `mousemove`, which follows a touch or pointer too.
    Mouse,
    Touch,
    /// Words without a family.
    Word,
    /// `ACTION_MOVE` of Android, and its numbers.
    Motion,
    Pointer,
}

impl EventFamily {
    /// Its y grows downwards.
    pub(super) fn is_of_screen(self) -> bool {
        self != Self::Word
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum PenEvent {
    Down,
    /// Motion with the pen as before.
    Move,
    Up,
    /// Motion above the paper.
    Hover,
}

/// What the numbers of a column of events are about.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum EventColumn {
    /// Nothing that is known: only its words are.
    Words,
    /// As MotionEvent of Android numbers them.
    Motion,
    /// UITouch, and Touch of Unity.
    Phase,
    /// 0 and 1 are a pen that is up and down.
    State,
}

impl EventColumn {
    /// The event of a cell; `None`: it is not about a pen, or a plain state.
    pub(super) fn event(self, text: &str) -> Option<(EventFamily, PenEvent)> {
        let Some(number) = number(text) else { return pen_event(text) };
        if number.fract() != 0.0 || !(0.0..65_536.0).contains(&number) {
            return None;
        }
        match self {
            // The number of a finger stands in the upper byte.
            Self::Motion => Some((EventFamily::Motion, motion(number as u16 & 0xff)?)),
            Self::Phase => Some((EventFamily::Word, phase(number as u16)?)),
            Self::Words | Self::State => None,
        }
    }
}

/// `ACTION_DOWN` and its like.
fn motion(number: u16) -> Option<PenEvent> {
    Some(match number {
        0 | 5 => PenEvent::Down,
        1 | 3 | 6 | 10 => PenEvent::Up,
        2 => PenEvent::Move,
        7 | 9 => PenEvent::Hover,
        _ => return None,
    })
}

/// Began, moved, stationary, ended, cancelled; entered, moved in and left the region above the glass.
fn phase(number: u16) -> Option<PenEvent> {
    Some(match number {
        0 => PenEvent::Down,
        1 | 2 => PenEvent::Move,
        3 | 4 => PenEvent::Up,
        5..=7 => PenEvent::Hover,
        _ => return None,
    })
}

/// The event of a name; `None`: it is not about a pen.
pub(super) fn pen_event(text: &str) -> Option<(EventFamily, PenEvent)> {
    let word: String = text.chars().filter(|c| c.is_alphanumeric()).flat_map(char::to_lowercase).collect();
    let families = [
        ("pointer", EventFamily::Pointer),
        ("touchphase", EventFamily::Word),
        ("touch", EventFamily::Touch),
        ("mouse", EventFamily::Mouse),
        ("motioneventaction", EventFamily::Motion),
        ("actionpointer", EventFamily::Motion),
        ("action", EventFamily::Motion),
        ("stylus", EventFamily::Word),
        ("pen", EventFamily::Word),
        ("tip", EventFamily::Word),
    ];
    if word == "touch" || word == "touching" || word == "contact" {
        return Some((EventFamily::Word, PenEvent::Down));
    }
    let stripped =
        families.into_iter().find_map(|(prefix, family)| Some((word.strip_prefix(prefix)?, family)));
    let (kind, family) = stripped.unwrap_or((&word, EventFamily::Word));
    let event = match kind {
        "down" | "start" | "started" | "begin" | "began" | "press" | "pressed" => PenEvent::Down,
        "up" | "end" | "ended" | "release" | "released" | "cancel" | "cancelled" | "canceled" | "lift"
        | "lifted" | "lostcapture" | "hoverexit" => PenEvent::Up,
        // Over the border of an element, the pen as before.
        "over" | "enter" | "out" | "leave" => PenEvent::Move,
        "move" | "moved" | "drag" | "rawupdate" | "stationary" => PenEvent::Move,
        "hover" | "hovering" | "hovermove" | "hoverenter" => PenEvent::Hover,
        _ => return None,
    };
    Some((family, event))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn events_of_browsers_and_of_android_are_known() {
        for (text, wanted) in [
            ("pointerdown", Some((EventFamily::Pointer, PenEvent::Down))),
            ("pointerrawupdate", Some((EventFamily::Pointer, PenEvent::Move))),
            ("ACTION_POINTER_DOWN", Some((EventFamily::Motion, PenEvent::Down))),
            ("MotionEvent.ACTION_HOVER_MOVE", Some((EventFamily::Motion, PenEvent::Hover))),
            ("touchend", Some((EventFamily::Touch, PenEvent::Up))),
            ("pen_down", Some((EventFamily::Word, PenEvent::Down))),
            ("TouchPhase.Began", Some((EventFamily::Word, PenEvent::Down))),
            ("mousemove", Some((EventFamily::Mouse, PenEvent::Move))),
            ("keydown", None),
            ("wheel", None),
            ("", None),
        ] {
            assert_eq!(pen_event(text), wanted, "{text}");
        }
    }

    #[test]
    fn numbers_are_events_where_the_column_tells_whose() {
        let event = |column: EventColumn, text| column.event(text).map(|(_, event)| event);
        for (text, motion, phase) in [
            ("0", Some(PenEvent::Down), Some(PenEvent::Down)),
            ("1", Some(PenEvent::Up), Some(PenEvent::Move)),
            ("2.0", Some(PenEvent::Move), Some(PenEvent::Move)),
            ("3", Some(PenEvent::Up), Some(PenEvent::Up)),
            ("7", Some(PenEvent::Hover), Some(PenEvent::Hover)),
            ("261", Some(PenEvent::Down), None),
            ("0.5", None, None),
            ("-1", None, None),
        ] {
            assert_eq!(event(EventColumn::Motion, text), motion, "{text}");
            assert_eq!(event(EventColumn::Phase, text), phase, "{text}");
            assert_eq!(event(EventColumn::State, text), None, "{text}");
            assert_eq!(event(EventColumn::Words, text), None, "{text}");
        }
        assert_eq!(event(EventColumn::Phase, "ended"), Some(PenEvent::Up));
    }
}
