//! The gateway's protocol, version 1: pen samples from programs of other users over a Unix stream socket.
//!
//! Client to gateway: frames of [`FRAME_BYTES`] bytes, all numbers little-endian:
//!
//! | offset | type | field |
//! |---|---|---|
//! | 0 | u32 | length of what follows: 48 |
//! | 4 | u16 | version: 1 |
//! | 6 | u16 | kind: 1, a pen sample |
//! | 8 | u32 | flags, [`pen_flags`](crate::pen_flags) |
//! | 12 | u32 | reserved: 0 |
//! | 16 | u64 | device stamp \[ns\], CLOCK_MONOTONIC of this host |
//! | 24 | f64 | x \[m\] |
//! | 32 | f64 | y \[m\] |
//! | 40 | f32 | pressure, 0 to 1; negative: unknown |
//! | 44 | f32 | tilt towards x from the plane's normal \[rad\] |
//! | 48 | f32 | tilt towards y \[rad\] |
//!
//! Gateway to client: lines of text. One at once: [`WELCOME`], or `foretrace-gateway 1 refused: REASON`
//! before it closes. One before it ends a connection, also after the client has shut down its sending side:
//! `foretrace-gateway 1 closed: REASON`. Nothing in between: single samples are refused silently and counted.
//!
//! Contract: [`Frame::decode`] is pure, allocates nothing and is total for every bit pattern. It checks the
//! envelope only; `PenSample::validate` checks the sample, and the gateway its stamp.

use crate::PenSample;

/// Version of the protocol.
pub const GATEWAY_VERSION: u16 = 1;

/// Bytes of one frame, its length field included.
pub const FRAME_BYTES: usize = 52;

/// The gateway's line to a client that it admits.
pub const WELCOME: &str = "foretrace-gateway 1 ready";

/// Kind of a frame that carries a pen sample.
const KIND_SAMPLE: u16 = 1;
const LENGTH_BYTES: usize = 4;
const BODY_BYTES: usize = FRAME_BYTES - LENGTH_BYTES;

/// Why a frame is malformed; the rest of the stream cannot be trusted either.
#[derive(Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum FrameError {
    /// Another length than version 1 has.
    #[error("a frame of length {0}, expected {BODY_BYTES}")]
    Length(u32),
    /// Another version.
    #[error("protocol version {0}, expected {GATEWAY_VERSION}")]
    Version(u16),
    /// A kind that version 1 does not have.
    #[error("a frame of kind {0}, expected {KIND_SAMPLE}")]
    Kind(u16),
    /// The reserved field is in use.
    #[error("{0:#x} in the reserved field, expected 0")]
    Reserved(u32),
}

/// A frame with a pen sample; its publisher fills in the sample's header.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Frame(pub PenSample);

impl Frame {
    /// The bytes that go over the socket.
    #[must_use]
    pub fn encode(&self) -> [u8; FRAME_BYTES] {
        let sample = &self.0;
        let mut bytes = [0; FRAME_BYTES];
        let mut at = 0;
        let mut put = |field: &[u8]| {
            bytes[at..at + field.len()].copy_from_slice(field);
            at += field.len();
        };
        put(&(BODY_BYTES as u32).to_le_bytes());
        put(&GATEWAY_VERSION.to_le_bytes());
        put(&KIND_SAMPLE.to_le_bytes());
        put(&sample.flags.to_le_bytes());
        put(&0_u32.to_le_bytes());
        put(&sample.device_stamp_ns.to_le_bytes());
        put(&sample.x_m.to_le_bytes());
        put(&sample.y_m.to_le_bytes());
        put(&sample.pressure.to_le_bytes());
        put(&sample.tilt_x_rad.to_le_bytes());
        put(&sample.tilt_y_rad.to_le_bytes());
        bytes
    }

    /// Reads a whole frame.
    ///
    /// # Errors
    ///
    /// See [`FrameError`].
    pub fn decode(bytes: &[u8; FRAME_BYTES]) -> Result<Self, FrameError> {
        Self::check_length(u32_at(bytes, 0))?;
        match u16_at(bytes, 4) {
            GATEWAY_VERSION => {}
            version => return Err(FrameError::Version(version)),
        }
        match u16_at(bytes, 6) {
            KIND_SAMPLE => {}
            kind => return Err(FrameError::Kind(kind)),
        }
        match u32_at(bytes, 12) {
            0 => {}
            reserved => return Err(FrameError::Reserved(reserved)),
        }
        Ok(Self(PenSample {
            flags: u32_at(bytes, 8),
            device_stamp_ns: u64_at(bytes, 16),
            x_m: f64::from_bits(u64_at(bytes, 24)),
            y_m: f64::from_bits(u64_at(bytes, 32)),
            pressure: f32::from_bits(u32_at(bytes, 40)),
            tilt_x_rad: f32::from_bits(u32_at(bytes, 44)),
            tilt_y_rad: f32::from_bits(u32_at(bytes, 48)),
            ..PenSample::default()
        }))
    }

    /// Checks a frame by its length field alone, so that a wrong one is refused at once.
    ///
    /// # Errors
    ///
    /// `Length`.
    pub const fn check_length(length: u32) -> Result<(), FrameError> {
        if length as usize == BODY_BYTES { Ok(()) } else { Err(FrameError::Length(length)) }
    }
}

/// Cuts a stream of bytes into frames; holds one frame at most.
#[derive(Debug, Clone)]
pub struct FrameReader {
    bytes: [u8; FRAME_BYTES],
    filled: usize,
}

impl Default for FrameReader {
    fn default() -> Self {
        Self { bytes: [0; FRAME_BYTES], filled: 0 }
    }
}

impl FrameReader {
    /// Takes bytes from the front of `input` until a frame is whole; `None` when `input` is used up before.
    ///
    /// # Errors
    ///
    /// See [`FrameError`]; the stream cannot be read on then.
    pub fn next(&mut self, input: &mut &[u8]) -> Result<Option<Frame>, FrameError> {
        let taken = input.len().min(FRAME_BYTES - self.filled);
        let (front, rest) = input.split_at(taken);
        self.bytes[self.filled..self.filled + taken].copy_from_slice(front);
        self.filled += taken;
        *input = rest;
        if self.filled >= LENGTH_BYTES {
            Frame::check_length(u32_at(&self.bytes, 0))?;
        }
        if self.filled < FRAME_BYTES {
            return Ok(None);
        }
        self.filled = 0;
        Frame::decode(&self.bytes).map(Some)
    }

    /// Bytes of a frame that is not whole yet.
    #[must_use]
    pub const fn pending(&self) -> usize {
        self.filled
    }
}

fn u16_at(bytes: &[u8; FRAME_BYTES], at: usize) -> u16 {
    u16::from_le_bytes(std::array::from_fn(|i| bytes[at + i]))
}

fn u32_at(bytes: &[u8; FRAME_BYTES], at: usize) -> u32 {
    u32::from_le_bytes(std::array::from_fn(|i| bytes[at + i]))
}

fn u64_at(bytes: &[u8; FRAME_BYTES], at: usize) -> u64 {
    u64::from_le_bytes(std::array::from_fn(|i| bytes[at + i]))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample() -> PenSample {
        PenSample {
            device_stamp_ns: 0x0102_0304_0506_0708,
            x_m: 0.125,
            y_m: -0.25,
            pressure: 0.5,
            tilt_x_rad: 0.1,
            tilt_y_rad: -0.2,
            flags: 3,
            ..Default::default()
        }
    }

    /// xorshift64*: the same bytes in every run.
    struct Dice(u64);

    impl Dice {
        fn next(&mut self) -> u64 {
            self.0 ^= self.0 >> 12;
            self.0 ^= self.0 << 25;
            self.0 ^= self.0 >> 27;
            self.0.wrapping_mul(0x2545_f491_4f6c_dd1d)
        }

        fn below(&mut self, limit: usize) -> usize {
            (self.next() >> 33) as usize % limit
        }
    }

    #[test]
    fn the_layout_is_the_documented_one_and_comes_back_whole() {
        let bytes = Frame(sample()).encode();
        assert_eq!(bytes[..16], [48, 0, 0, 0, 1, 0, 1, 0, 3, 0, 0, 0, 0, 0, 0, 0]);
        assert_eq!(bytes[16..24], [8, 7, 6, 5, 4, 3, 2, 1]);
        assert_eq!(bytes[24..32], 0.125_f64.to_le_bytes());
        assert_eq!(bytes[48..52], (-0.2_f32).to_le_bytes());
        assert_eq!(Frame::decode(&bytes), Ok(Frame(sample())));
    }

    #[test]
    fn each_part_of_the_envelope_is_refused_by_name() {
        let wrong = |at: usize, value: u8| {
            let mut bytes = Frame(sample()).encode();
            bytes[at] = value;
            Frame::decode(&bytes).unwrap_err()
        };
        assert_eq!(wrong(0, 47), FrameError::Length(47));
        assert_eq!(wrong(4, 2), FrameError::Version(2));
        assert_eq!(wrong(6, 9), FrameError::Kind(9));
        assert_eq!(wrong(12, 1), FrameError::Reserved(1));
    }

    #[test]
    fn a_stream_in_any_pieces_gives_the_same_frames() {
        let mut dice = Dice(7);
        let sent: Vec<Frame> =
            (0..200).map(|n| Frame(PenSample { device_stamp_ns: n, ..sample() })).collect();
        let bytes: Vec<u8> = sent.iter().flat_map(Frame::encode).collect();
        for _ in 0..50 {
            let (mut reader, mut got, mut rest) = (FrameReader::default(), Vec::new(), bytes.as_slice());
            while !rest.is_empty() {
                let (mut piece, later) = rest.split_at((1 + dice.below(130)).min(rest.len()));
                rest = later;
                while let Some(frame) = reader.next(&mut piece).unwrap() {
                    got.push(frame);
                }
                assert!(piece.is_empty() && reader.pending() < FRAME_BYTES);
            }
            assert_eq!(got, sent);
            assert_eq!(reader.pending(), 0);
        }
    }

    #[test]
    fn a_wrong_length_is_noticed_before_the_rest_has_come() {
        let mut reader = FrameReader::default();
        assert_eq!(reader.next(&mut [0xff_u8; 3].as_slice()), Ok(None));
        assert_eq!(reader.next(&mut [0xff_u8].as_slice()), Err(FrameError::Length(u32::MAX)));
    }

    #[test]
    fn random_bytes_never_become_a_frame_by_accident_and_mutated_frames_differ_in_what_was_mutated() {
        let mut dice = Dice(0x5eed);
        for _ in 0..200_000 {
            let bytes: [u8; FRAME_BYTES] = std::array::from_fn(|_| dice.next() as u8);
            assert!(Frame::decode(&bytes).is_err());
        }
        let good = Frame(sample()).encode();
        let mut accepted = 0;
        for _ in 0..200_000 {
            let mut bytes = good;
            for _ in 0..=dice.below(4) {
                bytes[dice.below(FRAME_BYTES)] = dice.next() as u8;
            }
            if let Ok(frame) = Frame::decode(&bytes) {
                accepted += 1;
                // Bit for bit, whatever the values: the next check finds a NaN.
                assert_eq!(frame.encode(), bytes);
            } else {
                assert_ne!((&bytes[..8], &bytes[12..16]), (&good[..8], &good[12..16]));
            }
        }
        assert!(accepted > 50_000, "{accepted}");
    }

    #[test]
    fn a_reader_fed_with_random_bytes_stops_at_the_first_four() {
        let mut dice = Dice(99);
        for _ in 0..10_000 {
            let bytes: Vec<u8> = (0..dice.below(300)).map(|_| dice.next() as u8).collect();
            let mut input = bytes.as_slice();
            let first = FrameReader::default().next(&mut input);
            assert_eq!(first.is_err(), bytes.len() >= LENGTH_BYTES, "{bytes:?}");
        }
    }
}
