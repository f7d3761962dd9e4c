//! Words on standard input while the tablet runs: clutch, scale, lock.

use std::io::BufRead;
use std::sync::mpsc::{Receiver, sync_channel};

use foretrace_tablet::{Hand, PlaneAxis};

use super::options::{axis, scale};
use crate::output::note;

/// What they are.
pub(super) const HELP: &str = "clutch (the hand moves, the arm stays; again to go on), scale FACTOR (while \
                               clutched), lock x, lock y, lock off";
/// Longest line that is read [bytes].
const LINE_BYTES: u64 = 256;

/// One of them.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Word {
    Clutch,
    Scale(f64),
    Lock(Option<PlaneAxis>),
}

impl Word {
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
    pub(super) fn listen() -> std::io::Result<Self> {
        let (sender, lines) = sync_channel(16);
        std::thread::Builder::new().name("tablet-words".to_owned()).spawn(move || {
            let mut input = std::io::stdin().lock();
            loop {
                let mut bytes = Vec::new();
                let mut line = std::io::Read::take(&mut input, LINE_BYTES);
                match line.read_until(b'\n', &mut bytes) {
                    Ok(0) | Err(_) => return,
                    Ok(_) => {}
                }
                if sender.send(String::from_utf8_lossy(&bytes).into_owned()).is_err() {
                    return;
                }
            }
        })?;
        Ok(Self { lines, clutched: false })
    }

    /// Whether the clutch was asked for by a word.
    pub(super) const fn clutched(&self) -> bool {
        self.clutched
    }

    /// Does what was typed.
    pub(super) fn carry_out(&mut self, hand: &mut Hand) {
        while let Ok(line) = self.lines.try_recv() {
            match Word::parse(&line) {
                Ok(Word::Clutch) => self.clutched = !self.clutched,
                Ok(Word::Scale(factor)) => match hand.set_scale(factor) {
                    Ok(()) => note!("tablet: scale {factor}, from when the clutch is let go"),
                    Err(foretrace_tablet::NotClutched) => {
                        note!("tablet: the scale changes only while the clutch is held: type clutch first");
                    }
                },
                Ok(Word::Lock(axis)) => hand.lock(axis),
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
        assert_eq!(Word::parse(" clutch \n"), Ok(Word::Clutch));
        assert_eq!(Word::parse("scale 0.5"), Ok(Word::Scale(0.5)));
        assert_eq!(Word::parse("lock y"), Ok(Word::Lock(Some(PlaneAxis::Y))));
        assert_eq!(Word::parse("lock off"), Ok(Word::Lock(None)));
        for wrong in ["", "scale", "scale 0", "lock z", "clutch now please", "\u{1b}[2J"] {
            assert!(Word::parse(wrong).is_err(), "{wrong}");
        }
    }
}
