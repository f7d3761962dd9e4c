//! `Piece`: part of something that is larger than a message: the settings in force, a set of weights, the
//! state of the law, and its build.
//!
//! Contract: the pieces of one thing have its kind, number, size and hash in common and come in order of
//! their offsets. [`Assembly`] puts them together again; it trusts no length, has a bound on its memory, and
//! hands out nothing whose hash is wrong.

use std::fmt;

use iceoryx2::prelude::ZeroCopySend;

use super::check::{Rejection, Validate, known};
use super::header::Header;
use super::layout::{fnv1a, wire};
use super::vocabulary::{RejectReason, UnknownValue, wire_enum};

/// Bytes that one piece carries at most.
pub const PIECE_BYTES: usize = 4096;

/// Bytes of the largest thing that may be sent in pieces.
pub const LARGEST_THING_BYTES: u64 = 4 << 20;

wire_enum! {
    /// What a piece belongs to.
    pub enum PieceKind: u32 {
        /// The settings in force, as TOML; its number counts changes.
        Settings = 0 => "settings",
        /// A set of weights; its number is the version of the set.
        Weights = 1 => "weights",
        /// The state of the law; its number is the tick after which it was taken.
        State = 2 => "state",
        /// The build of the control law, as text; its number is 0.
        Law = 3 => "law",
        /// A preview of another process, as the law took it; its number is that of the tick.
        Preview = 4 => "preview",
    }
}

wire! {
    /// Part of a larger thing.
    "foretrace.PieceV1"
    pub struct Piece {
        /// Stamp: when it was sent.
        pub header: Header,
        /// The start of the daemon, as in `Status`.
        pub daemon_id: u64,
        /// See [`PieceKind`].
        pub number: u64,
        /// Size of the whole thing \[bytes\].
        pub total: u64,
        /// Where this piece begins in it \[bytes\].
        pub offset: u64,
        /// FNV-1a of the whole thing.
        pub hash: u64,
        /// [`PieceKind`].
        pub kind: u32,
        /// Bytes in this piece.
        pub length: u32,
        /// The bytes, zero after `length`.
        pub bytes: [u8; PIECE_BYTES],
    }
}

impl Validate for Piece {
    fn validate(&self) -> Result<(), Rejection> {
        known::<_, PieceKind>("kind", self.kind)?;
        let range = |field, value: u64, most: u64| {
            if value <= most {
                return Ok(());
            }
            Err(Rejection::new(RejectReason::OutOfRange, field).because(value as f64, most as f64))
        };
        range("length", self.length.into(), PIECE_BYTES as u64)?;
        range("total", self.total, LARGEST_THING_BYTES)?;
        range("offset", self.offset, self.total)?;
        range("length", self.length.into(), self.total - self.offset)
    }
}

impl Piece {
    /// The piece of `thing` that begins at `offset`.
    #[must_use]
    pub fn of(kind: PieceKind, number: u64, daemon_id: u64, thing: &[u8], hash: u64, offset: usize) -> Self {
        let rest = thing.get(offset..).unwrap_or_default();
        let part = rest.get(..PIECE_BYTES).unwrap_or(rest);
        let mut bytes = [0; PIECE_BYTES];
        if let Some(room) = bytes.get_mut(..part.len()) {
            room.copy_from_slice(part);
        }
        Self {
            daemon_id,
            number,
            total: thing.len() as u64,
            offset: offset as u64,
            hash,
            kind: kind.into(),
            length: part.len() as u32,
            bytes,
            ..Self::default()
        }
    }

    /// Whether both belong to one thing.
    fn is_of_one_with(&self, other: &Self) -> bool {
        let thing = |piece: &Self| (piece.daemon_id, piece.number, piece.total, piece.hash, piece.kind);
        thing(self) == thing(other)
    }

    fn content(&self) -> &[u8] {
        self.bytes.get(..self.length as usize).unwrap_or_default()
    }
}

/// A whole thing.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Thing {
    /// What it is.
    pub kind: PieceKind,
    /// Its number.
    pub number: u64,
    /// The daemon that sent it.
    pub daemon_id: u64,
    /// Its bytes.
    pub bytes: Vec<u8>,
}

/// Puts pieces together, one thing at a time.
#[derive(Debug, Default)]
pub struct Assembly {
    begun: Option<Piece>,
    bytes: Vec<u8>,
    /// The newest useless piece: what follows it is of a thing that is counted already.
    spoiled: Option<Piece>,
    /// Something has come since listening began.
    heard: bool,
    broken: u64,
}

impl Assembly {
    /// Adds a validated piece; returns the thing that it completes.
    pub fn add(&mut self, piece: &Piece) -> Option<Thing> {
        let heard = std::mem::replace(&mut self.heard, true);
        if piece.offset == 0 {
            self.broken += u64::from(self.begun.is_some());
            (self.begun, self.spoiled) = (Some(*piece), None);
            self.bytes.clear();
        } else if self.begun.is_none_or(|first| !first.is_of_one_with(piece))
            || self.bytes.len() as u64 != piece.offset
        {
            let begun = self.begun.take();
            let other = begun.is_some_and(|first| !first.is_of_one_with(piece));
            let counted =
                self.spoiled.is_some_and(|last| last.is_of_one_with(piece) && last.offset < piece.offset);
            // Whoever begins to listen in the middle of a thing lost nothing: all of it comes again.
            let new = heard && !counted;
            self.broken += u64::from(begun.is_some()) + u64::from(new && (begun.is_none() || other));
            self.spoiled = Some(*piece);
            return None;
        }
        self.bytes.extend_from_slice(piece.content());
        if (self.bytes.len() as u64) < piece.total {
            return None;
        }
        self.begun = None;
        let bytes = std::mem::take(&mut self.bytes);
        let kind = PieceKind::try_from(piece.kind).ok().filter(|_| fnv1a(&bytes) == piece.hash);
        self.broken += u64::from(kind.is_none());
        Some(Thing { kind: kind?, number: piece.number, daemon_id: piece.daemon_id, bytes })
    }

    /// The listener begins again; what it has counted stays.
    pub fn restart(&mut self) {
        *self = Self { broken: self.broken, ..Self::default() };
    }

    /// Things of which a piece was lost or wrong.
    #[must_use]
    pub fn broken(&self) -> u64 {
        self.broken
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pieces(thing: &[u8]) -> Vec<Piece> {
        let starts = (0..thing.len().max(1)).step_by(PIECE_BYTES);
        starts.map(|at| Piece::of(PieceKind::State, 7, 1, thing, fnv1a(thing), at)).collect()
    }

    #[test]
    fn a_thing_of_any_length_arrives_whole() {
        for length in [0, 1, PIECE_BYTES - 1, PIECE_BYTES, PIECE_BYTES + 1, 5 * PIECE_BYTES + 3] {
            let thing: Vec<u8> = (0..length).map(|i| (i * 7) as u8).collect();
            let mut assembly = Assembly::default();
            let mut got = None;
            for piece in pieces(&thing) {
                assert_eq!(piece.validate(), Ok(()));
                assert!(got.is_none(), "complete too early");
                got = assembly.add(&piece);
            }
            assert_eq!(got.unwrap().bytes, thing);
            assert_eq!(assembly.broken(), 0);
        }
    }

    #[test]
    fn a_lost_or_changed_piece_spoils_its_thing_only() {
        let thing = vec![3_u8; 3 * PIECE_BYTES];
        let whole = pieces(&thing);
        let mut assembly = Assembly::default();
        assert_eq!(assembly.add(&whole[0]), None);
        assert_eq!(assembly.add(&whole[2]), None);
        assert_eq!(assembly.broken(), 1);
        let mut forged = whole.clone();
        forged[1].bytes[5] = 9;
        assert!(forged.iter().all(|piece| assembly.add(piece).is_none()));
        assert_eq!(assembly.broken(), 2);
        assert_eq!(whole.iter().filter_map(|piece| assembly.add(piece)).count(), 1);
    }

    #[test]
    fn a_lost_first_piece_is_counted_once_and_what_was_under_way_before_is_not() {
        let of = |number, byte: u8| {
            let whole = pieces(&[byte; 3 * PIECE_BYTES]);
            whole.into_iter().map(|piece| Piece { number, ..piece }).collect::<Vec<_>>()
        };
        let (a, b) = (of(1, 1), of(2, 2));
        let mut assembly = Assembly::default();
        let mut add = |pieces: &[Piece]| {
            let whole = pieces.iter().filter_map(|piece| assembly.add(piece)).count();
            (whole, assembly.broken())
        };
        assert_eq!(add(&a[1..]), (0, 0), "listening began in the middle of it");
        assert_eq!(add(&b[1..]), (0, 1), "the first piece is lost");
        assert_eq!(add(&b), (1, 1));
        assert_eq!(add(&b[1..]), (0, 2), "the same once more, and again without its first piece");
        assert_eq!(add(&b[1..]), (0, 3));
        assert_eq!(add(&[a[0], b[1], b[2]]), (0, 5), "the end of one and the beginning of the next");
        assert_eq!(add(&a), (1, 5));
        assembly.restart();
        assert!(assembly.add(&a[2]).is_none() && assembly.broken() == 5);
    }

    #[test]
    fn sizes_that_lie_are_refused_by_name() {
        let good = pieces(&[1; 100])[0];
        let cases = [
            (Piece { length: PIECE_BYTES as u32 + 1, ..good }, "length"),
            (Piece { total: LARGEST_THING_BYTES + 1, ..good }, "total"),
            (Piece { offset: 101, ..good }, "offset"),
            (Piece { offset: 1, ..good }, "length"),
        ];
        for (piece, field) in cases {
            let refused = piece.validate().unwrap_err();
            assert_eq!((refused.reason, refused.field), (RejectReason::OutOfRange, field));
        }
    }

    #[test]
    fn sizes_at_their_bounds_are_legal() {
        let good = pieces(&[1; 100])[0];
        let legal = [
            Piece { total: LARGEST_THING_BYTES, ..good },
            Piece { offset: 100, length: 0, ..good },
            Piece { total: LARGEST_THING_BYTES, length: PIECE_BYTES as u32, ..good },
        ];
        assert!(legal.iter().all(|piece| piece.validate() == Ok(())));
        let refused = Piece { offset: 101, ..good }.validate().unwrap_err();
        assert_eq!((refused.value, refused.bound), (101.0, 100.0));
        let middle = Piece::of(PieceKind::Weights, 4, 9, &[5; PIECE_BYTES + 7], 3, PIECE_BYTES);
        let described = (middle.daemon_id, middle.number, middle.hash, middle.kind);
        assert_eq!((described, middle.length, middle.offset), ((9, 4, 3, 1), 7, PIECE_BYTES as u64));
        assert_eq!((middle.content(), middle.bytes[7]), (&[5; 7][..], 0));
    }

    #[test]
    fn pieces_of_another_daemon_number_size_hash_or_kind_belong_to_another_thing() {
        let whole = pieces(&[3; 2 * PIECE_BYTES]);
        let second = whole[1];
        for other in [
            Piece { daemon_id: 2, ..second },
            Piece { number: 8, ..second },
            Piece { total: second.total + 1, ..second },
            Piece { hash: 1, ..second },
            Piece { kind: PieceKind::Weights.into(), ..second },
        ] {
            let mut assembly = Assembly::default();
            assert!(assembly.add(&whole[0]).is_none() && assembly.add(&other).is_none());
            assert!(assembly.broken() > 0 && assembly.add(&second).is_none());
        }
        let mut assembly = Assembly::default();
        assert!(assembly.add(&whole[0]).is_none());
        let thing = assembly.add(&second).unwrap();
        assert_eq!((thing.kind, thing.number, thing.daemon_id), (PieceKind::State, 7, 1));
    }
}
