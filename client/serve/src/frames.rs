//! Frames on a stream of bytes: the length of what follows (u32, little-endian), then that.
//!
//! Contract: any bytes give frames or an end, within bounded memory. A length that no frame of the protocol
//! has ends the stream at once, before the rest has come.

use std::io::Read;
use std::ops::RangeInclusive;

use crate::http::waits;

/// Bytes of the length.
const LENGTH_BYTES: usize = 4;
/// Bytes of one read at most.
const CHUNK_BYTES: usize = 1 << 16;

/// Why a stream gives no frames any more.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Over {
    /// The peer ended it.
    Ended,
    /// The connection broke by itself.
    Broken,
    /// A frame of this length, which the protocol does not have.
    Length(u32),
}

/// What came and was not taken yet.
#[derive(Debug)]
pub struct FrameBuffer {
    bytes: Vec<u8>,
    taken: usize,
    lengths: RangeInclusive<u32>,
}

impl FrameBuffer {
    /// Of frames with these lengths.
    #[must_use]
    pub const fn new(lengths: RangeInclusive<u32>) -> Self {
        Self { bytes: Vec::new(), taken: 0, lengths }
    }

    /// Takes in what has come on a stream that does not wait, about `most` bytes, so that a loop of many
    /// peers goes on.
    ///
    /// # Errors
    ///
    /// `Ended`, `Broken`: nothing more comes, but what came before can still be taken.
    pub fn fill(&mut self, stream: &mut impl Read, most: usize) -> Result<(), Over> {
        let mut came = 0;
        while came < most {
            match self.read_once(stream, CHUNK_BYTES)? {
                0 => break,
                count => came += count,
            }
        }
        Ok(())
    }

    /// Takes in what one read of `stream` gives, `most` bytes or 64 KiB at most; 0: there was nothing.
    ///
    /// # Errors
    ///
    /// As [`FrameBuffer::fill`].
    pub fn read_once(&mut self, stream: &mut impl Read, most: usize) -> Result<usize, Over> {
        self.bytes.drain(..self.taken);
        self.taken = 0;
        let mut room = [0; CHUNK_BYTES];
        let most = most.min(CHUNK_BYTES);
        match stream.read(room.get_mut(..most).unwrap_or_default()) {
            Ok(0) => Err(Over::Ended),
            Ok(count) => {
                self.bytes.extend_from_slice(room.get(..count).unwrap_or_default());
                Ok(count)
            }
            Err(error) if waits(&error) => Ok(0),
            Err(_) => Err(Over::Broken),
        }
    }

    /// The next whole frame, without its length.
    ///
    /// # Errors
    ///
    /// `Length`.
    pub fn next_frame(&mut self) -> Result<Option<&[u8]>, Over> {
        let rest = self.bytes.get(self.taken..).unwrap_or_default();
        let Some((length, rest)) = rest.split_first_chunk::<LENGTH_BYTES>() else { return Ok(None) };
        let length = u32::from_le_bytes(*length);
        if !self.lengths.contains(&length) {
            return Err(Over::Length(length));
        }
        if rest.len() < length as usize {
            return Ok(None);
        }
        let begin = self.taken + LENGTH_BYTES;
        self.taken = begin + length as usize;
        Ok(self.bytes.get(begin..self.taken))
    }

    /// Bytes that came and are no whole frame yet, or were not taken.
    #[must_use]
    pub fn pending(&self) -> usize {
        self.bytes.len() - self.taken
    }
}

/// A frame of the parts of `body`.
#[must_use]
pub fn framed(body: &[&[u8]]) -> Vec<u8> {
    let length: usize = body.iter().map(|part| part.len()).sum();
    let mut bytes = Vec::with_capacity(LENGTH_BYTES + length);
    bytes.extend_from_slice(&u32::try_from(length).unwrap_or(u32::MAX).to_le_bytes());
    body.iter().for_each(|part| bytes.extend_from_slice(part));
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    /// xorshift64*: the same numbers in every run.
    struct Dice(u64);

    impl Dice {
        fn below(&mut self, limit: usize) -> usize {
            self.0 ^= self.0 >> 12;
            self.0 ^= self.0 << 25;
            self.0 ^= self.0 >> 27;
            (self.0.wrapping_mul(0x2545_f491_4f6c_dd1d) >> 33) as usize % limit
        }
    }

    #[test]
    fn a_stream_in_any_pieces_gives_the_same_frames() {
        let mut dice = Dice(7);
        let sent: Vec<Vec<u8>> = (0..200_u8).map(|number| vec![number; 1 + dice.below(60)]).collect();
        let bytes: Vec<u8> = sent.iter().flat_map(|body| framed(&[&body[..1], &body[1..]])).collect();
        for _ in 0..50 {
            let (mut frames, mut got, mut rest) = (FrameBuffer::new(1..=60), Vec::new(), bytes.as_slice());
            while !rest.is_empty() {
                let (piece, later) = rest.split_at((1 + dice.below(130)).min(rest.len()));
                rest = later;
                frames.read_once(&mut &piece[..], 4096).unwrap();
                while let Some(body) = frames.next_frame().unwrap() {
                    got.push(body.to_vec());
                }
                assert!(frames.pending() < 64);
            }
            assert_eq!((got, frames.pending()), (sent.clone(), 0));
        }
    }

    #[test]
    fn a_wrong_length_is_noticed_before_the_rest_has_come_and_an_end_after_what_came_before() {
        let mut frames = FrameBuffer::new(48..=48);
        frames.read_once(&mut &[47, 0, 0][..], 4096).unwrap();
        assert_eq!(frames.next_frame(), Ok(None));
        frames.read_once(&mut &[0][..], 4096).unwrap();
        assert_eq!(frames.next_frame(), Err(Over::Length(47)));
        let mut frames = FrameBuffer::new(0..=8);
        assert_eq!(frames.fill(&mut framed(&[&[1, 2]]).as_slice(), 1000), Err(Over::Ended));
        assert_eq!(frames.next_frame(), Ok(Some(&[1, 2][..])));
        assert_eq!(frames.pending(), 0);
    }

    #[test]
    fn no_more_is_taken_in_than_asked_for_and_one_read() {
        let mut frames = FrameBuffer::new(0..=8);
        frames.fill(&mut std::io::repeat(0), 3 * CHUNK_BYTES - 1).unwrap();
        assert_eq!(frames.pending(), 3 * CHUNK_BYTES);
    }

    #[test]
    fn random_bytes_end_at_the_first_length() {
        let mut dice = Dice(99);
        for _ in 0..10_000 {
            let bytes: Vec<u8> = (0..1 + dice.below(300)).map(|_| dice.below(256) as u8).collect();
            let mut frames = FrameBuffer::new(48..=48);
            frames.read_once(&mut bytes.as_slice(), 4096).unwrap();
            assert_eq!(frames.next_frame().is_err(), bytes.len() >= LENGTH_BYTES, "{bytes:?}");
        }
    }
}
