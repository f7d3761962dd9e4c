//! What a recorder, a viewer or a metrics process listens to: a running daemon, by way of a relay or of
//! shared memory.
//!
//! Shared memory has room for few listeners, because each costs the loop's publishers a copy and a buffer:
//! two for inputs, three for tick records, eight for the status. One process, `foretrace relay`, takes one
//! place of each and hands everything on over a Unix socket in the run directory, to as many as ask. A
//! process of its own, because then recorders, viewers and metrics begin, end and crash without each other,
//! and each stays the plain program it is without a relay; over a socket, because a listener that hangs then
//! costs its own queue only.
//!
//! Contract: a source uses a relay if one answers, and a slot in shared memory else. It follows the daemon
//! and changes its way when the relay ends, without the caller. It never blocks. What did not reach the
//! caller is counted: gaps in the sequences of inputs and ticks whatever the way, things that broke, messages
//! that were refused.

pub(crate) mod frame;
mod memory;
pub(crate) mod remote;

use std::time::{Duration, Instant};

use foretrace_client::{DaemonMark, Instance, ServiceError, monotonic_now_ns};
use foretrace_shm::{Header, HeaderBounds, HeaderCheck, Status, Thing, TickInput, TickRecord, host_boot_id};

use crate::LiveError;
use memory::MemorySource;
use remote::Remote;

/// How often a source looks whether daemon and relay are still there.
const LOOK_EVERY: Duration = Duration::from_millis(250);

/// What to listen to, beside the status.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Wants {
    pub ticks: bool,
    /// Inputs of ticks, and settings, weights and states.
    pub inputs: bool,
}

impl Wants {
    pub const ALL: Self = Self { ticks: true, inputs: true };
    pub const TICKS: Self = Self { ticks: true, inputs: false };
    pub const STATUS: Self = Self { ticks: false, inputs: false };
}

#[derive(Debug)]
pub enum SourceMessage {
    /// What a tick was given.
    Input(Box<TickInput>),
    /// What a tick did.
    Tick(Box<TickRecord>),
    Status(Box<Status>),
    /// Settings, weights or a state.
    Thing(Thing),
}

#[derive(Debug)]
pub enum SourceNews {
    /// The daemon is gone.
    Gone,
    /// A daemon is back; listening went on.
    Back,
    /// Another daemon is there: what it sends begins with settings, weights and a state.
    Renewed,
    /// The relay ended; listening goes on elsewhere, from settings, weights and a state on.
    Elsewhere,
    /// Something does not come, for this reason; it is tried again and again.
    Deaf(LiveError),
}

/// What did not reach the caller, since the source was opened.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Lost {
    /// Inputs missing in their sequence.
    pub inputs: u64,
    /// Tick records missing in their sequence.
    pub ticks: u64,
    /// Things of which a piece was lost, or that found no room in a relay's queue.
    pub things: u64,
    pub refused: u64,
}

#[derive(Debug)]
enum SourceRoute {
    Memory(Box<MemorySource>),
    Relay(Remote),
}

/// One stream of numbered messages, whatever the way.
#[derive(Debug)]
struct NumberedStream {
    check: HeaderCheck,
    before: u64,
    refused: u64,
}

impl NumberedStream {
    fn new() -> Self {
        Self { check: HeaderCheck::new(host_boot_id(), HeaderBounds::DEFAULT), before: 0, refused: 0 }
    }

    /// Whether the message is the next one, or a later one. `whole`: a new sender is heard from its first
    /// message on, and what is missing before is lost.
    fn admits(&mut self, header: &Header, whole: bool) -> bool {
        let known = (self.check.dropped(), self.check.restarts());
        let admitted = self.check.admit(header, monotonic_now_ns()).is_ok();
        self.refused += u64::from(!admitted);
        if self.check.restarts() != known.1 && !whole {
            self.before = self.before.wrapping_sub(self.check.dropped() - known.0);
        }
        admitted
    }

    /// Another sender, heard from somewhere on.
    fn begin_anew(&mut self) {
        self.before = self.lost();
        self.check = HeaderCheck::new(host_boot_id(), HeaderBounds::DEFAULT);
    }

    fn lost(&self) -> u64 {
        self.before.wrapping_add(self.check.dropped())
    }
}

#[derive(Debug)]
pub struct LiveSource {
    instance: Instance,
    wants: Wants,
    way: SourceRoute,
    /// Never through a relay: the relay's own.
    direct: bool,
    daemon: DaemonMark,
    away: bool,
    no_route: bool,
    /// The last start could not be asked for.
    start_failed: bool,
    next_look: Instant,
    inputs: NumberedStream,
    ticks: NumberedStream,
    /// Things and refusals of ways that were left.
    before: (u64, u64),
}

impl LiveSource {
    /// Begins to listen to the daemon of `instance`, which must be up.
    ///
    /// # Errors
    ///
    /// No daemon; no relay, and no slot in shared memory.
    pub fn open(instance: &Instance, wants: Wants) -> Result<Self, LiveError> {
        Self::opened(instance, wants, false)
    }

    /// The same in shared memory, relay or not.
    pub(crate) fn open_direct(instance: &Instance, wants: Wants) -> Result<Self, LiveError> {
        Self::opened(instance, wants, true)
    }

    fn opened(instance: &Instance, wants: Wants, direct: bool) -> Result<Self, LiveError> {
        let daemon = instance.daemon().ok_or_else(|| ServiceError::no_daemon(instance))?;
        Ok(Self {
            instance: instance.clone(),
            wants,
            way: way(instance, wants, direct)?,
            direct,
            daemon,
            away: false,
            no_route: false,
            start_failed: false,
            next_look: Instant::now() + LOOK_EVERY,
            inputs: NumberedStream::new(),
            ticks: NumberedStream::new(),
            before: (0, 0),
        })
    }

    #[must_use]
    pub const fn instance(&self) -> &Instance {
        &self.instance
    }

    /// The daemon that was up when this began, or the newest one since.
    #[must_use]
    pub const fn daemon(&self) -> DaemonMark {
        self.daemon
    }

    /// Whether it listens to a relay now.
    #[must_use]
    pub const fn is_relayed(&self) -> bool {
        matches!(self.way, SourceRoute::Relay(_))
    }

    /// Passes on what has come, in order of each kind; returns what changed. Call this every few
    /// milliseconds: 256 ticks are kept unread.
    pub fn hear(&mut self, mut use_heard: impl FnMut(SourceMessage)) -> Option<SourceNews> {
        let Self { way, inputs, ticks, .. } = self;
        let whole = matches!(way, SourceRoute::Memory(_));
        let mut pass = |heard: SourceMessage| {
            let admitted = match &heard {
                SourceMessage::Input(input) => inputs.admits(&input.header, whole),
                SourceMessage::Tick(record) => ticks.admits(&record.header, whole),
                SourceMessage::Status(_) | SourceMessage::Thing(_) => true,
            };
            if admitted {
                use_heard(heard);
            }
        };
        match way {
            SourceRoute::Memory(memory) => memory.hear(&mut pass),
            SourceRoute::Relay(remote) => remote.hear(&mut pass),
        }
        if Instant::now() < self.next_look {
            return None;
        }
        self.next_look = Instant::now() + LOOK_EVERY;
        self.look()
    }

    fn look(&mut self) -> Option<SourceNews> {
        let found = self.instance.daemon();
        match &mut self.way {
            SourceRoute::Relay(remote) if remote.is_over() => self.leave_relay(),
            SourceRoute::Relay(_) => {
                let Some(found) = found else {
                    return (!std::mem::replace(&mut self.away, true)).then_some(SourceNews::Gone);
                };
                let other = std::mem::replace(&mut self.daemon, found) != found;
                let back = std::mem::take(&mut self.away);
                if other { Some(SourceNews::Renewed) } else { back.then_some(SourceNews::Back) }
            }
            SourceRoute::Memory(memory) => {
                let news = memory.look();
                if matches!(news, Some(SourceNews::Renewed)) {
                    self.inputs.begin_anew();
                    self.ticks.begin_anew();
                }
                self.daemon = found.unwrap_or(self.daemon);
                news
            }
        }
    }

    /// The relay is gone: another one, or a slot of its own.
    fn leave_relay(&mut self) -> Option<SourceNews> {
        match way(&self.instance, self.wants, self.direct) {
            Ok(new) => {
                let lost = self.lost();
                let refused = lost.refused - self.inputs.refused - self.ticks.refused;
                (self.before, self.way) = ((lost.things, refused), new);
                (self.no_route, self.away) = (false, false);
                Some(SourceNews::Elsewhere)
            }
            Err(LiveError::Service(ServiceError::NoDaemon { .. })) => {
                (!std::mem::replace(&mut self.away, true)).then_some(SourceNews::Gone)
            }
            Err(error) => (!std::mem::replace(&mut self.no_route, true)).then_some(SourceNews::Deaf(error)),
        }
    }

    /// Asks for settings, weights and a state once more, without a gap in the inputs.
    ///
    /// # Errors
    ///
    /// Another reader has taken the slot meanwhile: snapshots do not come until this succeeds. With what is
    /// to be reported, once for failures in a row.
    pub fn start_again(&mut self) -> Result<(), Option<SourceNews>> {
        let asked = match &mut self.way {
            SourceRoute::Memory(memory) => memory.start_again(),
            SourceRoute::Relay(remote) => {
                remote.start_again();
                Ok(())
            }
        };
        let reported = std::mem::replace(&mut self.start_failed, asked.is_err());
        asked.map_err(|error| (!reported).then_some(SourceNews::Deaf(error)))
    }

    /// What did not reach the caller so far.
    #[must_use]
    pub fn lost(&self) -> Lost {
        let (things, refused) = match &self.way {
            SourceRoute::Memory(memory) => (memory.broken(), memory.refused()),
            SourceRoute::Relay(remote) => (remote.counts().broken, remote.counts().refused),
        };
        Lost {
            inputs: self.inputs.lost(),
            ticks: self.ticks.lost(),
            things: self.before.0 + things,
            refused: self.before.1 + refused + self.inputs.refused + self.ticks.refused,
        }
    }
}

/// A relay if there is one, or shared memory.
fn way(instance: &Instance, wants: Wants, direct: bool) -> Result<SourceRoute, LiveError> {
    if !direct && let Some(remote) = Remote::connect(instance, wants) {
        return Ok(SourceRoute::Relay(remote));
    }
    match MemorySource::open(instance, wants) {
        Ok(memory) => Ok(SourceRoute::Memory(Box::new(memory))),
        Err(LiveError::Service(error @ ServiceError::NoSlot { .. })) => {
            Err(LiveError::NoPlace { error, direct })
        }
        Err(error) => Err(error),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn header(sequence: u64, stamp_ns: u64) -> Header {
        Header { sequence, stamp_ns, boot_id: host_boot_id() }
    }

    #[test]
    fn gaps_are_counted_across_ways_and_what_a_new_sender_sent_before_is_not() {
        let now = monotonic_now_ns();
        let mut ticks = NumberedStream::new();
        for sequence in [5, 6, 9] {
            assert!(ticks.admits(&header(sequence, now + sequence), false));
        }
        assert_eq!(ticks.lost(), 2);
        assert!(!ticks.admits(&header(9, now + 9), false), "twice");
        // A relay begins to listen to another daemon at its 40th message.
        assert!(!ticks.admits(&header(40, now + 5), true), "older than the newest");
        assert!(ticks.admits(&header(4, now + 50), false));
        assert_eq!(ticks.lost(), 2);
        assert!(ticks.admits(&header(6, now + 60), false));
        assert_eq!((ticks.lost(), ticks.refused), (3, 2));
        assert!(ticks.admits(&header(3, now + 70), true));
        assert_eq!(ticks.lost(), 5, "a place that stays open hears from the first message on");
    }
}
