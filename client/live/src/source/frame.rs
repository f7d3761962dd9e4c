//! What a relay and its listeners say to each other on a Unix socket.
//!
//! Contract: a frame is a length (`foretrace_serve::frames`), then a kind (u32) and a body; numbers are
//! little-endian. Messages are those of shared memory, byte for byte; the greeting names their layouts, so
//! that two versions never misread each other. Any bytes give frames or an end.

use std::os::unix::net::UnixStream;
use std::sync::Arc;

use foretrace_serve::frames::{self, FrameBuffer, Over};
use foretrace_shm::{
    LARGEST_THING_BYTES, Status, Thing, TickInput, TickRecord, Validate, Wire, host_boot_id,
};

use super::{SourceMessage, Wants};
use foretrace_record::topics::{thing_bytes, thing_of};

/// Longest frame of a relay \[bytes\]: a thing with its kind and numbers.
const LONGEST: u32 = LARGEST_THING_BYTES as u32 + 64;
/// Longest frame of a listener \[bytes\].
const LONGEST_OF_LISTENER: u32 = 16;
/// Bytes of a kind.
const KIND: u32 = 4;
/// Bytes that one look reads at most, so that a loop of many peers goes on.
const AT_ONCE: usize = 8 << 20;
const MAGIC: u64 = u64::from_le_bytes(*b"ftRELAY2");

pub(crate) mod kind {
    /// First frame of a relay: what it is, and which layouts it sends.
    pub(crate) const HELLO: u32 = 1;
    pub(crate) const INPUT: u32 = 2;
    pub(crate) const TICK: u32 = 3;
    pub(crate) const STATUS: u32 = 4;
    pub(crate) const THING: u32 = 5;
    /// What never reached this listener, without what the sequence numbers of ticks and inputs show.
    pub(crate) const COUNTS: u32 = 6;
    /// First frame of a listener: what it wants.
    pub(crate) const WANTS: u32 = 7;
    /// A listener asks for settings, weights and a state once more.
    pub(crate) const AGAIN: u32 = 8;
}

/// Refused messages and broken things, as a relay counts them for a listener.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct LossCounts {
    pub(crate) refused: u64,
    pub(crate) broken: u64,
}

/// A frame of `kind`.
pub(crate) fn framed(kind: u32, body: &[u8]) -> Arc<[u8]> {
    frames::framed(&[&kind.to_le_bytes(), body]).into()
}

fn words(words: &[u64]) -> Vec<u8> {
    words.iter().flat_map(|word| word.to_le_bytes()).collect()
}

/// The body of a greeting.
pub(crate) fn hello() -> Vec<u8> {
    words(&[MAGIC, host_boot_id(), TickInput::LAYOUT_HASH, TickRecord::LAYOUT_HASH, Status::LAYOUT_HASH])
}

/// The frame of a message.
pub(crate) fn frame_of(heard: &SourceMessage) -> (u32, Arc<[u8]>) {
    let mut body = Vec::new();
    let kind = match heard {
        SourceMessage::Input(input) => {
            input.put(&mut body);
            kind::INPUT
        }
        SourceMessage::Tick(record) => {
            record.put(&mut body);
            kind::TICK
        }
        SourceMessage::Status(status) => {
            status.put(&mut body);
            kind::STATUS
        }
        SourceMessage::Thing(thing) => {
            body = thing_bytes(thing);
            kind::THING
        }
    };
    (kind, framed(kind, &body))
}

pub(crate) fn counts_frame(counts: LossCounts) -> Arc<[u8]> {
    framed(kind::COUNTS, &words(&[counts.refused, counts.broken]))
}

pub(crate) fn wants_frame(wants: Wants) -> Arc<[u8]> {
    framed(kind::WANTS, &[u8::from(wants.ticks), u8::from(wants.inputs)])
}

/// What a relay says.
#[derive(Debug)]
pub(crate) enum RelayMessage {
    Heard(SourceMessage),
    Counts(LossCounts),
    /// A message that is not a legal one.
    Refused,
}

/// The content of a relay's frame; `None`: no frame of a relay.
pub(crate) fn said(kind: u32, mut body: &[u8]) -> Option<RelayMessage> {
    fn message<T: Wire + Validate>(
        mut body: &[u8],
        heard: impl FnOnce(Box<T>) -> SourceMessage,
    ) -> Option<RelayMessage> {
        let message = T::get(&mut body).filter(|_| body.is_empty())?;
        Some(if message.validate().is_ok() {
            RelayMessage::Heard(heard(Box::new(message)))
        } else {
            RelayMessage::Refused
        })
    }
    match kind {
        kind::INPUT => message(body, SourceMessage::Input),
        kind::TICK => message(body, SourceMessage::Tick),
        kind::STATUS => message(body, SourceMessage::Status),
        kind::THING => thing_of(body).map(|thing: Thing| RelayMessage::Heard(SourceMessage::Thing(thing))),
        kind::COUNTS => {
            let (refused, broken) = (u64::get(&mut body)?, u64::get(&mut body)?);
            Some(RelayMessage::Counts(LossCounts { refused, broken }))
        }
        _ => None,
    }
}

/// What a listener says.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum ListenerMessage {
    Wants(Wants),
    Again,
}

/// The content of a listener's frame; `None`: no frame of a listener.
pub(crate) fn asked(kind: u32, body: &[u8]) -> Option<ListenerMessage> {
    match (kind, body) {
        (kind::WANTS, [ticks @ (0 | 1), inputs @ (0 | 1)]) => {
            Some(ListenerMessage::Wants(Wants { ticks: *ticks == 1, inputs: *inputs == 1 }))
        }
        (kind::AGAIN, []) => Some(ListenerMessage::Again),
        _ => None,
    }
}

/// What came and was not taken yet.
#[derive(Debug)]
pub(crate) struct FrameInbox {
    frames: FrameBuffer,
    at_once: usize,
}

impl FrameInbox {
    /// Of frames of a relay.
    pub(crate) const fn of_relay() -> Self {
        Self { frames: FrameBuffer::new(KIND..=LONGEST), at_once: AT_ONCE }
    }

    /// Of frames of a listener, which are short.
    pub(crate) const fn of_listener() -> Self {
        Self { frames: FrameBuffer::new(KIND..=LONGEST_OF_LISTENER), at_once: 1024 }
    }

    /// Takes in what has come, without waiting.
    pub(crate) fn fill(&mut self, stream: &mut UnixStream) -> Result<(), Over> {
        self.frames.fill(stream, self.at_once)
    }

    /// The next whole frame: kind and body.
    pub(crate) fn next_frame(&mut self) -> Result<Option<(u32, &[u8])>, Over> {
        let frame = self.frames.next_frame()?;
        Ok(frame.and_then(|mut frame| u32::get(&mut frame).map(|kind| (kind, frame))))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use foretrace_shm::PieceKind;
    use std::io::Write as _;

    /// Where the body of a frame begins.
    const BODY: usize = 8;

    #[test]
    fn every_message_comes_back_from_its_frame_and_forged_ones_are_refused() {
        let mut input = TickInput { tick: 7, ..TickInput::default() };
        input.header.sequence = 3;
        let thing = Thing { kind: PieceKind::Weights, number: 3, daemon_id: 9, bytes: vec![1, 2] };
        for heard in [
            SourceMessage::Input(Box::new(input)),
            SourceMessage::Tick(Box::default()),
            SourceMessage::Status(Box::default()),
            SourceMessage::Thing(thing),
        ] {
            let (kind, frame) = frame_of(&heard);
            match said(kind, &frame[BODY..]) {
                Some(RelayMessage::Heard(came)) => assert_eq!(format!("{came:?}"), format!("{heard:?}")),
                other => panic!("{heard:?} came as {other:?}"),
            }
            assert!(said(kind, &frame[BODY..frame.len() - 1]).is_none() || kind == kind::THING);
        }
        let forged = TickInput { mode: 99, ..TickInput::default() };
        let (kind, frame) = frame_of(&SourceMessage::Input(Box::new(forged)));
        assert!(matches!(said(kind, &frame[BODY..]), Some(RelayMessage::Refused)));
        assert!(said(99, &[]).is_none());
        assert_eq!(asked(kind::WANTS, &[1, 2]), None);
        assert_eq!(asked(kind::AGAIN, &[]), Some(ListenerMessage::Again));
    }

    #[test]
    fn any_bytes_give_frames_or_an_end_within_bounded_memory() {
        let cases: u32 = std::env::var("FORETRACE_FUZZ_CASES")
            .map_or(2_000, |text| text.parse::<u32>().expect("a whole number") / 25);
        // xorshift64*: the same bytes in every run.
        let mut state = 0x0000_5e1a_0001_u64;
        let mut dice = || {
            state ^= state >> 12;
            state ^= state << 25;
            state ^= state >> 27;
            state.wrapping_mul(0x2545_f491_4f6c_dd1d)
        };
        let good: Vec<u8> = [
            frame_of(&SourceMessage::Tick(Box::default())).1,
            counts_frame(LossCounts::default()),
            frame_of(&SourceMessage::Input(Box::default())).1,
        ]
        .concat();
        let (mut whole, mut ended) = (0, 0);
        for _ in 0..cases {
            let mut bytes = good.clone();
            for _ in 0..=dice() >> 62 {
                let at = (dice() >> 33) as usize % bytes.len();
                bytes[at] = (dice() >> 56) as u8;
            }
            let (mut to, mut from) = UnixStream::pair().unwrap();
            from.set_nonblocking(true).unwrap();
            to.write_all(&bytes).unwrap();
            drop(to);
            let mut inbox = FrameInbox::of_relay();
            let over = inbox.fill(&mut from);
            assert_eq!(over, Err(Over::Ended), "the other end is gone");
            loop {
                match inbox.next_frame() {
                    Ok(Some((kind, body))) => whole += u32::from(said(kind, body).is_some()),
                    Ok(None) => break,
                    Err(_) => {
                        ended += 1;
                        break;
                    }
                }
            }
        }
        assert!(whole > cases && ended > 0, "{whole} {ended}");
    }
}
