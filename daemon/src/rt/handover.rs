//! Hand-over of whole sets of weights from the learner to the loop: the newest one, read in place.
//!
//! Contract: neither side waits. Each announced set is either the newest that the loop finds at some time, or
//! counted once as overtaken, on the side where a newer one overtook it; a set does not change while the loop
//! reads it. This file names nothing but the ring, so that `tests/loom` can run both through every
//! interleaving of two threads.

use rtrb::chunks::ReadChunk;
use rtrb::{Consumer, Producer, RingBuffer};

/// Both ends of a hand-over with room for `capacity` sets.
#[must_use]
pub fn handover<T>(capacity: usize) -> (Outbox<T>, Mailbox<T>) {
    let (ring_in, ring) = RingBuffer::new(capacity);
    (Outbox { ring: ring_in, due: false }, Mailbox { ring })
}

#[derive(Debug)]
pub struct Outbox<T> {
    ring: Producer<T>,
    due: bool,
}

impl<T> Outbox<T> {
    /// Announces a newer set; true if it overtakes one that had no room yet.
    pub const fn announce(&mut self) -> bool {
        std::mem::replace(&mut self.due, true)
    }

    /// Stores the newest set if one was announced and there is room; `newest` is called only then. Returns
    /// whether it was stored.
    pub fn put(&mut self, newest: impl FnOnce() -> T) -> bool {
        if !self.due || self.ring.slots() == 0 {
            return false;
        }
        self.due = self.ring.push(newest()).is_err();
        !self.due
    }
}

#[derive(Debug)]
pub struct Mailbox<T> {
    ring: Consumer<T>,
}

impl<T> Mailbox<T> {
    /// The waiting sets, if any; their slots are occupied until they are given back.
    pub fn look(&mut self) -> Option<Waiting<'_, T>> {
        let waiting = self.ring.slots();
        if waiting == 0 {
            return None;
        }
        self.ring.read_chunk(waiting).ok().map(Waiting)
    }
}

/// Sets in their slots.
#[derive(Debug)]
pub struct Waiting<'a, T>(ReadChunk<'a, T>);

impl<T> Waiting<'_, T> {
    /// The newest of them.
    #[must_use]
    pub fn newest(&self) -> Option<&T> {
        let (older, newer) = self.0.as_slices();
        newer.last().or_else(|| older.last())
    }

    /// Frees the slots; returns how many sets the newest overtook.
    pub fn give_back(self) -> u64 {
        let overtaken = self.0.len().saturating_sub(1) as u64;
        self.0.commit_all();
        overtaken
    }
}
