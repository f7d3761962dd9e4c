//! Words on standard input while the tablet runs: clutch, scale, lock.

use std::sync::mpsc::{Receiver, sync_channel};

use foretrace_tablet::{MappedHand, PlaneAxis};

use super::options::{axis, scale};
use crate::failure::Failure;
use crate::output::note;
use crate::terminal::read_lines;

pub(super) const HELP: &str = "clutch (the hand moves, the arm stays; again to go on), scale FACTOR (while \
                               clutched), lock x, lock y, lock off";

#[derive(Debug, Clone, Copy, PartialEq)]
enum TypedCommand {
    Clutch,
    Scale(f64),
    Lock(Option<PlaneAxis>),
}

impl TypedCommand {
    fn parse(line: &str) -> Result<Self, String> {
        let mut parts = line.split_whitespace();
        match (parts.next(), parts.next(), parts.next()) {
            (Some("clutch" | "c"), None, None) => Ok(Self::Clutch),
            (Some("scale"), Some(factor), None) => scale(factor).map(Self::Scale),
            (Some("lock"), Some("off"), None) => Ok(Self::Lock(None)),
            (Some("lock"), Some(name), None) => axis(name).map(|axis| Self::Lock(Some(axis))),
            _ => Err(HELP.to_owned()),
        }
    }
}

/// Lines that were typed, read by a thread of their own.
pub(super) struct Words {
    lines: Receiver<String>,
    clutched: bool,
}

impl Words {
    /// Begins to read. The thread ends with its input.
    pub(super) fn listen() -> Result<Self, Failure> {
        let (sender, lines) = sync_channel(16);
        read_lines("tablet-words", move |line| sender.send(line.to_owned()).is_ok())?;
        Ok(Self { lines, clutched: false })
    }

    /// Whether the clutch was asked for by a word.
    pub(super) const fn clutched(&self) -> bool {
        self.clutched
    }

    /// Does what was typed.
    pub(super) fn carry_out(&mut self, hand: &mut MappedHand) {
        while let Ok(line) = self.lines.try_recv() {
            match TypedCommand::parse(&line) {
                Ok(TypedCommand::Clutch) => self.clutched = !self.clutched,
                Ok(TypedCommand::Scale(factor)) => match hand.set_scale(factor) {
                    Ok(()) => note!("tablet: scale {factor}, from when the clutch is let go"),
                    Err(foretrace_tablet::NotClutched) => {
                        note!("tablet: the scale changes only while the clutch is held: type clutch first");
                    }
                },
                Ok(TypedCommand::Lock(axis)) => hand.lock(axis),
                Err(known) => note!("tablet: {:?} is none of: {known}", line.trim()),
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_are_understood_and_others_are_told_which_there_are() {
        assert_eq!(TypedCommand::parse(" clutch \n"), Ok(TypedCommand::Clutch));
        assert_eq!(TypedCommand::parse("scale 0.5"), Ok(TypedCommand::Scale(0.5)));
        assert_eq!(TypedCommand::parse("lock y"), Ok(TypedCommand::Lock(Some(PlaneAxis::Y))));
        assert_eq!(TypedCommand::parse("lock off"), Ok(TypedCommand::Lock(None)));
        for wrong in ["", "scale", "scale 0", "lock z", "clutch now please", "\u{1b}[2J"] {
            assert!(TypedCommand::parse(wrong).is_err(), "{wrong}");
        }
    }
}
