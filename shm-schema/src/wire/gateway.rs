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

use super::pen::PenSample;

/// Version of the protocol.
pub const GATEWAY_VERSION: u16 = 1;

/// Bytes of one frame, its length field included.
pub const FRAME_BYTES: usize = 52;

/// Value of its length field: the bytes that follow.
pub const BODY_BYTES: u32 = (FRAME_BYTES - LENGTH_BYTES) as u32;

/// The gateway's line to a client that it admits.
pub const WELCOME: &str = "foretrace-gateway 1 ready";

/// Kind of a frame that carries a pen sample.
const KIND_SAMPLE: u16 = 1;
const LENGTH_BYTES: usize = 4;

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

crate::debug_as_display!(FrameError);

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
        put(&BODY_BYTES.to_le_bytes());
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

    /// Reads what follows the length of a frame.
    ///
    /// # Errors
    ///
    /// See [`FrameError`].
    pub fn decode(body: &[u8]) -> Result<Self, FrameError> {
        let Ok(body) = <&Body>::try_from(body) else {
            return Err(FrameError::Length(u32::try_from(body.len()).unwrap_or(u32::MAX)));
        };
        match u16_at(body, 0) {
            GATEWAY_VERSION => {}
            version => return Err(FrameError::Version(version)),
        }
        match u16_at(body, 2) {
            KIND_SAMPLE => {}
            kind => return Err(FrameError::Kind(kind)),
        }
        match u32_at(body, 8) {
            0 => {}
            reserved => return Err(FrameError::Reserved(reserved)),
        }
        Ok(Self(PenSample {
            flags: u32_at(body, 4),
            device_stamp_ns: u64_at(body, 12),
            x_m: f64::from_bits(u64_at(body, 20)),
            y_m: f64::from_bits(u64_at(body, 28)),
            pressure: f32::from_bits(u32_at(body, 36)),
            tilt_x_rad: f32::from_bits(u32_at(body, 40)),
            tilt_y_rad: f32::from_bits(u32_at(body, 44)),
            ..PenSample::default()
        }))
    }
}

type Body = [u8; BODY_BYTES as usize];

fn u16_at(body: &Body, at: usize) -> u16 {
    u16::from_le_bytes(std::array::from_fn(|i| body[at + i]))
}

fn u32_at(body: &Body, at: usize) -> u32 {
    u32::from_le_bytes(std::array::from_fn(|i| body[at + i]))
}

fn u64_at(body: &Body, at: usize) -> u64 {
    u64::from_le_bytes(std::array::from_fn(|i| body[at + i]))
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
        assert_eq!(Frame::decode(&bytes[LENGTH_BYTES..]), Ok(Frame(sample())));
    }

    #[test]
    fn each_part_of_the_envelope_is_refused_by_name() {
        let wrong = |at: usize, value: u8| {
            let mut bytes = Frame(sample()).encode();
            bytes[at] = value;
            Frame::decode(&bytes[LENGTH_BYTES..]).unwrap_err()
        };
        assert_eq!(Frame::decode(&[0; 47]), Err(FrameError::Length(47)));
        assert_eq!(wrong(4, 2), FrameError::Version(2));
        assert_eq!(wrong(6, 9), FrameError::Kind(9));
        assert_eq!(wrong(12, 1), FrameError::Reserved(1));
    }

    #[test]
    fn random_bytes_never_become_a_frame_by_accident_and_mutated_frames_differ_in_what_was_mutated() {
        // Miri takes a thousand times as long.
        const ROUNDS: usize = if cfg!(miri) { 200 } else { 200_000 };
        let mut dice = Dice(0x5eed);
        for _ in 0..ROUNDS {
            let bytes: Body = std::array::from_fn(|_| dice.next() as u8);
            assert!(Frame::decode(&bytes).is_err());
        }
        let good = Frame(sample()).encode();
        let mut accepted = 0;
        for _ in 0..ROUNDS {
            let mut bytes = good;
            for _ in 0..=dice.below(4) {
                bytes[LENGTH_BYTES + dice.below(BODY_BYTES as usize)] = dice.next() as u8;
            }
            if let Ok(frame) = Frame::decode(&bytes[LENGTH_BYTES..]) {
                accepted += 1;
                // Bit for bit, whatever the values: the next check finds a NaN.
                assert_eq!(frame.encode(), bytes);
            } else {
                assert_ne!((&bytes[4..8], &bytes[12..16]), (&good[4..8], &good[12..16]));
            }
        }
        assert!(accepted > ROUNDS / 4, "{accepted}");
    }

    #[test]
    fn every_field_of_the_body_is_read_from_its_own_offset() {
        let mut bytes = [0; BODY_BYTES as usize];
        let put =
            |bytes: &mut Body, at: usize, field: &[u8]| bytes[at..at + field.len()].copy_from_slice(field);
        put(&mut bytes, 0, &GATEWAY_VERSION.to_le_bytes());
        put(&mut bytes, 2, &KIND_SAMPLE.to_le_bytes());
        put(&mut bytes, 4, &0x0304_0506_u32.to_le_bytes());
        put(&mut bytes, 12, &0x1112_1314_1516_1718_u64.to_le_bytes());
        for (at, number) in [(20, 1.25_f64), (28, -2.5)] {
            put(&mut bytes, at, &number.to_le_bytes());
        }
        for (at, number) in [(36, 0.75_f32), (40, 0.5), (44, -0.125)] {
            put(&mut bytes, at, &number.to_le_bytes());
        }
        let Frame(sample) = Frame::decode(&bytes).unwrap();
        assert_eq!((sample.flags, sample.device_stamp_ns), (0x0304_0506, 0x1112_1314_1516_1718));
        assert_eq!((sample.x_m, sample.y_m, sample.pressure), (1.25, -2.5, 0.75));
        assert_eq!((sample.tilt_x_rad, sample.tilt_y_rad), (0.5, -0.125));
        assert_eq!(Frame::decode(&[0; 49]).unwrap_err().to_string(), "a frame of length 49, expected 48");
    }
}
