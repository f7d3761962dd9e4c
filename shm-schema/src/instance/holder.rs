//! The places of which an instance has one, and who may hold them: kinds, names, signatures.
//!
//! Contract: names are for display; control characters and what is too long never leave here. A file that is
//! no signature names nobody.

use std::fmt;
use std::fs::File;
use std::io::{Read, Seek};
use std::path::Path;

use crate::wire::clock::monotonic_now_ns;

/// Longest name of a holder [bytes].
const NAME_BYTES: usize = 120;
/// Longest file that is read [bytes].
const FILE_BYTES: u64 = 512;

/// A place of which an instance has one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Place {
    /// Sending pen samples.
    Pen,
    /// Sending the dead-man signal.
    DeadMan,
    /// Sending previews of the pen.
    Predictor,
}

impl Place {
    pub(super) const fn file(self) -> &'static str {
        match self {
            Self::Pen => "pen.holder",
            Self::DeadMan => "dead-man.holder",
            Self::Predictor => "predictor.holder",
        }
    }
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Pen => "the pen",
            Self::DeadMan => "the dead-man switch",
            Self::Predictor => "the predictor's place",
        })
    }
}

/// What kind of thing holds a place.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum HolderKind {
    /// A pen tablet or pen display.
    Tablet,
    /// A mouse or a touchscreen in a pen's stead.
    Pointer,
    /// A button of an input device.
    Button,
    /// A page in a browser.
    Browser,
    /// A gateway for programs of other users.
    Gateway,
    /// A player of recordings or texts.
    Player,
    /// Any other program.
    Program,
}

impl HolderKind {
    pub(super) const ALL: [Self; 7] = [
        Self::Tablet,
        Self::Pointer,
        Self::Button,
        Self::Browser,
        Self::Gateway,
        Self::Player,
        Self::Program,
    ];

    /// The word for it.
    #[must_use]
    pub const fn label(self) -> &'static str {
        match self {
            Self::Tablet => "tablet",
            Self::Pointer => "pointer",
            Self::Button => "button",
            Self::Browser => "browser",
            Self::Gateway => "gateway",
            Self::Player => "player",
            Self::Program => "program",
        }
    }

    /// Whether it gets `place` from `holder` when it asks.
    #[must_use]
    pub const fn may_take(self, place: Place, holder: Self) -> bool {
        !matches!((place, self), (Place::DeadMan, Self::Browser)) || matches!(holder, Self::Browser)
    }
}

/// Who wants a place.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Claimant {
    kind: HolderKind,
    name: String,
}

impl Claimant {
    /// A claimant with a readable name, such as a device or an address. Control characters become `?`, and
    /// what is too long is cut.
    #[must_use]
    pub fn new(kind: HolderKind, name: &str) -> Self {
        let mut plain = String::new();
        for found in name.trim().chars() {
            let found = if found.is_control() { '?' } else { found };
            if plain.len() + found.len_utf8() > NAME_BYTES {
                break;
            }
            plain.push(found);
        }
        Self { kind, name: plain }
    }

    /// This program, by its file name.
    #[must_use]
    pub fn this_program() -> Self {
        let path = std::env::current_exe().unwrap_or_default();
        Self::new(HolderKind::Program, &path.file_name().unwrap_or_default().to_string_lossy())
    }

    /// Its kind.
    #[must_use]
    pub const fn kind(&self) -> HolderKind {
        self.kind
    }

    /// Its name.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    pub(super) fn signature(&self) -> String {
        format!("{} {} {}\n{}\n", self.kind.label(), std::process::id(), monotonic_now_ns(), self.name)
    }
}

impl fmt::Display for Claimant {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "the {} {}", self.kind.label(), self.name)
    }
}

/// Who holds a place, and since when. Shown as "the tablet /dev/input/event7 (process 812) since 12 s".
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Holder {
    /// The holder.
    pub who: Claimant,
    /// Its process.
    pub pid: u32,
    /// When it began, on the monotonic clock \[ns\].
    pub since_ns: u64,
}

impl Holder {
    pub(super) fn read(path: &Path) -> Option<Self> {
        Self::parse(&mut File::open(path).ok()?)
    }

    pub(super) fn parse(file: &mut File) -> Option<Self> {
        let mut text = String::new();
        file.rewind().ok()?;
        file.take(FILE_BYTES).read_to_string(&mut text).ok()?;
        let (first, name) = text.split_once('\n')?;
        let mut words = first.split(' ');
        let kind = words.next()?;
        let kind = HolderKind::ALL.into_iter().find(|known| known.label() == kind)?;
        let (pid, since_ns) = (words.next()?.parse().ok()?, words.next()?.parse().ok()?);
        Some(Self { who: Claimant::new(kind, name), pid, since_ns })
    }
}

impl fmt::Display for Holder {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let since = monotonic_now_ns().saturating_sub(self.since_ns) / 1_000_000_000;
        write!(f, "{} (process {}) since {since} s", self.who, self.pid)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_is_plain_and_of_bounded_length() {
        let named = Claimant::new(HolderKind::Browser, "a\u{1b}[2J\nb");
        assert_eq!(named.name(), "a?[2J?b");
        assert_eq!(Claimant::new(HolderKind::Tablet, &"ä".repeat(500)).name().len(), NAME_BYTES);
    }
}
