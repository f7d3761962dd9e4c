//! Inputs of every tick, and what a replay starts from: build of the law, settings, weights and its state,
//! in pieces.
//!
//! Contract: sends only while somebody listens. Whoever begins to listen to the pieces gets the law's build,
//! the settings in force, the newest sets of weights, and a state that the loop copies into memory prepared
//! here. Pieces go out a few per round, so that a reader which looks every few milliseconds loses none.

use std::collections::VecDeque;

use crossbeam::channel::Receiver;

use foretrace_control::pen::PenReading;
use foretrace_control::predict::{ExternalPreview, OnlineWeights};
use foretrace_control::state;
use foretrace_shm::layout::fnv1a;
use foretrace_shm::{PEN_PER_PART, PIECE_BYTES, Piece, PieceKind, Publisher, Thing, TickInput};

use crate::ports::PEN_PER_TICK;
use crate::rt::facts::TickFacts;
use crate::rt::tick::{IpcRings, STATE_BYTES};
use crate::wire;

/// Pieces sent in one round of 4 ms; a subscriber holds 64.
const PIECES_PER_ROUND: usize = 8;
/// Sets of weights that a new listener gets: more than can be on their way to the loop.
const SETS_KEPT: usize = 8;
/// Snapshots that wait to be sent at most.
const WAITING: usize = 64;
/// Least time between two states \[ns\]: listeners that come and go must not keep the loop copying.
const APART_NS: u64 = 100_000_000;

/// A snapshot on its way out.
#[derive(Debug)]
struct Parcel {
    snapshot: Thing,
    hash: u64,
    sent: usize,
}

#[derive(Debug)]
pub struct Inputs {
    daemon_id: u64,
    learner: Receiver<Box<OnlineWeights>>,
    settings: Thing,
    sets: VecDeque<Thing>,
    waiting: VecDeque<Parcel>,
    audience: u128,
    /// Somebody waits for a state.
    wanted: bool,
    /// The loop has memory for one.
    asked: bool,
    asked_ns: Option<u64>,
    failed: u64,
}

impl Inputs {
    /// Sends `settings` \[TOML\] and the sets that come from `learner`, as the daemon `daemon_id`.
    #[must_use]
    pub fn new(daemon_id: u64, settings: String, learner: Receiver<Box<OnlineWeights>>) -> Self {
        let settings =
            Thing { kind: PieceKind::Settings, number: 0, daemon_id, bytes: settings.into_bytes() };
        Self {
            daemon_id,
            learner,
            settings,
            sets: VecDeque::new(),
            waiting: VecDeque::new(),
            audience: 0,
            wanted: false,
            asked: false,
            asked_ns: None,
            failed: 0,
        }
    }

    /// Messages that could not be sent.
    #[must_use]
    pub const fn failed(&self) -> u64 {
        self.failed
    }

    /// Other settings are in force.
    pub fn settings(&mut self, text: String) {
        self.settings.number += 1;
        self.settings.bytes = text.into_bytes();
        if self.audience != 0 {
            self.send(self.settings.clone());
        }
    }

    /// Sends the input of one tick, with its pen samples from the ring.
    pub fn tick(&mut self, facts: &TickFacts, rings: &mut IpcRings, port: &mut Publisher<TickInput>) {
        let mut pen = [PenReading::default(); PEN_PER_TICK];
        let mut count = 0;
        // Samples of earlier ticks belong to records that found no room.
        while let Ok(seen) = rings.pen.peek()
            && seen.tick <= facts.tick
        {
            if let Ok(seen) = rings.pen.pop()
                && seen.tick == facts.tick
                && let Some(slot) = pen.get_mut(count)
            {
                *slot = seen.reading;
                count += 1;
            }
        }
        let preview = preview_of(facts.tick, rings);
        if port.subscribers() == 0 {
            return;
        }
        let mut given = facts.given;
        given.complete &= count == given.pen_samples as usize && given.preview == preview.is_some();
        if let Some(bytes) = preview.filter(|_| self.audience != 0).as_ref().and_then(state::bytes_of) {
            let (kind, number, daemon_id) = (PieceKind::Preview, facts.tick, self.daemon_id);
            self.send(Thing { kind, number, daemon_id, bytes });
        }
        let mut input = wire::tick_input(facts.tick, self.daemon_id, &given, &facts.output);
        let pen = pen.get(..count).unwrap_or_default();
        for part in 0..input.parts as usize {
            wire::pen_part(&mut input, part, pen.chunks(PEN_PER_PART).nth(part).unwrap_or_default());
            self.failed += u64::from(port.publish(facts.finished.0, input).is_err());
        }
    }

    /// Takes in weights and states, and sends the next pieces; `now` \[ns\].
    pub fn round(&mut self, now: u64, rings: &mut IpcRings, port: &mut Publisher<Piece>) {
        for weights in self.learner.try_iter().take(SETS_KEPT).collect::<Vec<_>>() {
            let Some(bytes) = state::bytes_of(weights.as_ref()) else { continue };
            let (number, daemon_id) = (weights.version, self.daemon_id);
            let set = Thing { kind: PieceKind::Weights, number, daemon_id, bytes };
            if self.audience != 0 {
                self.send(set.clone());
            }
            self.sets.push_back(set);
            if self.sets.len() > SETS_KEPT {
                self.sets.pop_front();
            }
        }
        let audience = port.audience();
        if audience != self.audience {
            self.audience = audience;
            if audience == 0 {
                self.waiting.clear();
                self.wanted = false;
            } else {
                // Connected before the first piece, so that none is sent to nobody.
                self.failed += u64::from(port.connect().is_err());
                let (kind, bytes) = (PieceKind::Law, crate::LAW_BUILD.as_bytes().to_vec());
                self.send(Thing { kind, number: 0, daemon_id: self.daemon_id, bytes });
                self.send(self.settings.clone());
                for set in self.sets.clone() {
                    self.send(set);
                }
                self.wanted = true;
            }
        }
        self.ask(now, rings);
        while let Ok(copy) = rings.states.pop() {
            self.asked = false;
            if let Some(bytes) = copy.length.and_then(|length| copy.bytes.get(..length)) {
                let (kind, daemon_id) = (PieceKind::State, self.daemon_id);
                self.send(Thing { kind, number: copy.tick, daemon_id, bytes: bytes.to_vec() });
            }
        }
        for _ in 0..PIECES_PER_ROUND {
            let Some(Parcel { snapshot, hash, sent }) = self.waiting.front_mut() else { break };
            let piece =
                Piece::of(snapshot.kind, snapshot.number, snapshot.daemon_id, &snapshot.bytes, *hash, *sent);
            self.failed += u64::from(port.publish(now, piece).is_err());
            *sent += PIECE_BYTES;
            if *sent >= snapshot.bytes.len() {
                self.waiting.pop_front();
            }
        }
    }

    /// Gives the loop memory for its state where one is wanted: one at a time, and seldom.
    fn ask(&mut self, now: u64, rings: &mut IpcRings) {
        let due = self.asked_ns.is_none_or(|before| now.saturating_sub(before) >= APART_NS);
        if self.wanted && !self.asked && due {
            // Written, so that the loop faults no page in.
            let room = vec![0xA5; STATE_BYTES].into_boxed_slice();
            self.asked = rings.blanks.push(room).is_ok();
            (self.wanted, self.asked_ns) = (!self.asked, Some(now));
        }
    }

    fn send(&mut self, snapshot: Thing) {
        if self.waiting.len() >= WAITING {
            self.failed += 1;
            return;
        }
        let hash = fnv1a(&snapshot.bytes);
        self.waiting.push_back(Parcel { snapshot, hash, sent: 0 });
    }
}

/// The preview of another process that `tick` was given; those of earlier ticks belong to records that found
/// no room.
fn preview_of(tick: u64, rings: &mut IpcRings) -> Option<ExternalPreview> {
    let mut found = None;
    while rings.previews.peek().is_ok_and(|seen| seen.tick <= tick) {
        found = rings.previews.pop().ok().filter(|seen| seen.tick == tick).map(|seen| seen.preview);
    }
    found
}
