//! What a row of an export of events is about: PointerEvent of browsers, MotionEvent of Android.

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

/// The event of a name or of a number of Android; `None`: it is not about a pen.
pub(super) fn pen_event(text: &str) -> Option<(EventFamily, PenEvent)> {
    let word: String = text.chars().filter(|c| c.is_alphanumeric()).flat_map(char::to_lowercase).collect();
    let families = [
        ("pointer", EventFamily::Pointer),
        ("touch", EventFamily::Touch),
        ("mouse", EventFamily::Mouse),
        ("motioneventaction", EventFamily::Motion),
        ("actionpointer", EventFamily::Motion),
        ("action", EventFamily::Motion),
        ("stylus", EventFamily::Word),
        ("pen", EventFamily::Word),
    ];
    if word == "touch" || word == "touching" || word == "contact" {
        return Some((EventFamily::Word, PenEvent::Down));
    }
    let stripped =
        families.into_iter().find_map(|(prefix, family)| Some((word.strip_prefix(prefix)?, family)));
    let number = word.parse::<u8>().is_ok();
    let plain = if number { EventFamily::Motion } else { EventFamily::Word };
    let (kind, family) = stripped.unwrap_or((&word, plain));
    let event = match kind {
        "down" | "start" | "started" | "begin" | "began" | "press" | "0" | "5" => PenEvent::Down,
        "up" | "end" | "ended" | "release" | "cancel" | "cancelled" | "canceled" | "lift" | "lostcapture"
        | "1" | "3" | "6" | "hoverexit" | "10" => PenEvent::Up,
        // Over the border of an element, the pen as before.
        "over" | "enter" | "out" | "leave" => PenEvent::Move,
        "move" | "moved" | "drag" | "rawupdate" | "stationary" | "2" => PenEvent::Move,
        "hover" | "hovermove" | "hoverenter" | "7" | "9" => PenEvent::Hover,
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
            ("2", Some((EventFamily::Motion, PenEvent::Move))),
            ("touchend", Some((EventFamily::Touch, PenEvent::Up))),
            ("pen_down", Some((EventFamily::Word, PenEvent::Down))),
            ("mousemove", Some((EventFamily::Mouse, PenEvent::Move))),
            ("keydown", None),
            ("wheel", None),
            ("", None),
        ] {
            assert_eq!(pen_event(text), wanted, "{text}");
        }
    }
}
