//! Which peers have a slot: so many in all, fewer from other machines, fewer still from one of them.
//!
//! Contract: never waits. Where no slot is free, the peer that has been asking for longest gives way to the
//! newcomer, after a moment of its own; one that has asked keeps its slot until it is answered.

use std::io;
use std::net::{IpAddr, Ipv6Addr, Shutdown, TcpStream};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// A peer has at least this long to ask before it gives way.
pub const MOMENT: Duration = Duration::from_millis(50);

/// Most peers at a time.
#[derive(Debug, Clone, Copy)]
pub struct PeerLimits {
    pub all: usize,
    /// Of those, from other machines.
    pub remote: usize,
    /// Of those, from one other machine.
    pub of_one: usize,
    pub local: usize,
}

/// Why there is no slot for a peer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Full {
    /// All slots are taken by peers that have asked.
    All,
    /// All slots of its machine are taken by peers that have asked.
    OfOne,
    /// A peer gives way after this time.
    Wait(Duration),
    /// It is gone already, or has no address.
    Gone,
}

impl Full {
    /// The reason as words to count by.
    #[must_use]
    pub const fn label(self) -> &'static str {
        match self {
            Self::All | Self::Wait(_) => "too many connections",
            Self::OfOne => "too many connections of one machine",
            Self::Gone => "gone before it was served",
        }
    }
}

/// The slots of one server.
#[derive(Debug)]
pub struct Peers {
    limits: PeerLimits,
    inside: Mutex<SlotTable>,
}

#[derive(Debug, Default)]
struct SlotTable {
    /// In the order in which they came.
    peers: Vec<Peer>,
    next: u64,
    gave_way: u64,
}

#[derive(Debug)]
struct Peer {
    number: u64,
    machine: IpAddr,
    since: Instant,
    /// Its connection, while it still asks.
    asking: Option<TcpStream>,
}

/// A slot that one peer has; free again when it is dropped.
#[derive(Debug)]
pub struct Slot {
    peers: Arc<Peers>,
    number: u64,
}

impl Peers {
    #[must_use]
    pub fn new(limits: PeerLimits) -> Arc<Self> {
        Arc::new(Self { limits, inside: Mutex::default() })
    }

    fn inside(&self) -> MutexGuard<'_, SlotTable> {
        self.inside.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// A slot for `peer`, if need be that of one who still asks.
    ///
    /// # Errors
    ///
    /// See [`Full`].
    pub fn enter(self: &Arc<Self>, peer: &TcpStream) -> Result<Slot, Full> {
        let known = peer.peer_addr().and_then(|address| Ok((machine(address.ip()), peer.try_clone()?)));
        let (machine, line) = known.map_err(|_| Full::Gone)?;
        let mut inside = self.inside();
        while let Some((full, of)) = inside.full(&self.limits, machine) {
            inside.give_way(full, of)?;
        }
        let number = inside.next;
        inside.next += 1;
        inside.peers.push(Peer { number, machine, since: Instant::now(), asking: Some(line) });
        Ok(Slot { peers: self.clone(), number })
    }

    /// Peers that gave way so far.
    #[must_use]
    pub fn gave_way(&self) -> u64 {
        self.inside().gave_way
    }
}

/// Lets a connection that was just accepted wait for bytes, and for bytes to be taken, for so long at most.
///
/// # Errors
///
/// The connection is gone.
pub fn bound_waits(stream: &TcpStream, read: Duration, write: Duration) -> io::Result<()> {
    stream.set_nonblocking(false)?;
    stream.set_read_timeout(Some(read))?;
    stream.set_write_timeout(Some(write))
}

/// Which peers a newcomer competes with.
type Rivals = fn(own: IpAddr, other: IpAddr) -> bool;

impl SlotTable {
    /// The limit that a newcomer from `machine` would break, and whose slots it concerns.
    fn full(&self, limits: &PeerLimits, machine: IpAddr) -> Option<(Full, (IpAddr, Rivals))> {
        let count = |rivals: Rivals| self.peers.iter().filter(|peer| rivals(machine, peer.machine)).count();
        let anybody: Rivals = |_, _| true;
        let remote: Rivals = |_, other| !other.is_loopback();
        let same: Rivals = |own, other| own == other;
        let of_one = if machine.is_loopback() { limits.local } else { limits.of_one };
        let broken = [
            (Full::OfOne, same, of_one),
            (Full::All, remote, if machine.is_loopback() { usize::MAX } else { limits.remote }),
            (Full::All, anybody, limits.all),
        ];
        let (full, rivals, _) = broken.into_iter().find(|(_, rivals, most)| count(*rivals) >= *most)?;
        // A page of this machine gives way to nobody from outside.
        let rivals = if machine.is_loopback() || full == Full::OfOne { rivals } else { remote };
        Some((full, (machine, rivals)))
    }

    /// Ends the rival that has been asking for longest.
    fn give_way(&mut self, full: Full, (machine, rivals): (IpAddr, Rivals)) -> Result<(), Full> {
        let asks = |peer: &Peer| peer.asking.is_some() && rivals(machine, peer.machine);
        let oldest = self.peers.iter().position(asks).ok_or(full)?;
        let wait = self.peers.get(oldest).map_or(MOMENT, |peer| MOMENT.saturating_sub(peer.since.elapsed()));
        if !wait.is_zero() {
            return Err(Full::Wait(wait));
        }
        if let Some(line) = self.peers.remove(oldest).asking {
            // Its thread reads what has come, then the end; it may be gone already.
            let _ = line.shutdown(Shutdown::Read);
        }
        self.gave_way += 1;
        Ok(())
    }
}

impl Slot {
    /// The peer has asked: it keeps its slot until this is dropped.
    ///
    /// # Errors
    ///
    /// It gave way before, in words to count by.
    pub fn asked(&self) -> Result<(), &'static str> {
        let mut inside = self.peers.inside();
        let peer = inside.peers.iter_mut().find(|peer| peer.number == self.number).ok_or("gave way")?;
        peer.asking = None;
        Ok(())
    }
}

impl Drop for Slot {
    fn drop(&mut self) {
        self.peers.inside().peers.retain(|peer| peer.number != self.number);
    }
}

/// The address that stands for the whole machine of a peer: with IPv6 it may have as many as it likes below
/// one prefix of 64 bits (RFC 4291, section 2.5.4).
fn machine(peer: IpAddr) -> IpAddr {
    match peer.to_canonical() {
        IpAddr::V6(address) if !address.is_loopback() => {
            IpAddr::V6(Ipv6Addr::from_bits(address.to_bits() & !u128::from(u64::MAX)))
        }
        address => address,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::net::TcpListener;

    const LIMITS: PeerLimits = PeerLimits { all: 32, remote: 24, of_one: 12, local: 32 };

    impl Peers {
        /// Peers from `address` that have asked, until there is no slot.
        fn fill(self: &Arc<Self>, address: &str) -> Vec<Slot> {
            let machine = machine(address.parse().unwrap());
            let mut slots = Vec::new();
            let mut inside = self.inside();
            while inside.full(&self.limits, machine).is_none() {
                let number = inside.next;
                inside.next += 1;
                inside.peers.push(Peer { number, machine, since: Instant::now(), asking: None });
                slots.push(Slot { peers: self.clone(), number });
            }
            slots
        }

        fn refuses(&self, address: &str) -> Full {
            self.inside().full(&self.limits, machine(address.parse().unwrap())).unwrap().0
        }
    }

    #[test]
    fn one_machine_leaves_slots_for_others_and_all_others_leave_some_for_this_one() {
        let peers = Peers::new(LIMITS);
        let first = peers.fill("192.168.7.2");
        assert_eq!(first.len(), LIMITS.of_one);
        assert_eq!(peers.refuses("192.168.7.2"), Full::OfOne);
        let second = peers.fill("::ffff:192.168.7.3");
        assert_eq!(first.len() + second.len(), LIMITS.remote);
        assert_eq!(peers.refuses("192.168.7.4"), Full::All);
        let own = peers.fill("127.0.0.1");
        assert_eq!(own.len(), LIMITS.all - LIMITS.remote);
        drop(first);
        assert_eq!(peers.fill("192.168.7.4").len(), LIMITS.of_one);
        drop((second, own));
        assert_eq!(peers.fill("::1").len(), LIMITS.all);
        assert!(peers.inside().peers.is_empty());
    }

    #[test]
    fn addresses_below_one_prefix_are_one_machine() {
        let peers = Peers::new(LIMITS);
        let some = peers.fill("2001:db8::1");
        assert_eq!(peers.fill("2001:db8::77").len(), 0);
        assert_eq!(peers.fill("2001:db8:0:1::77").len(), LIMITS.remote - some.len());
    }

    #[test]
    fn one_that_has_asked_keeps_its_slot_and_one_that_only_asks_gives_way_after_its_moment() {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let few = 16;
        let peers = Peers::new(PeerLimits { all: 48, remote: 48, of_one: few, local: few });
        let line = || {
            let peer = TcpStream::connect(listener.local_addr().unwrap()).unwrap();
            let _other = listener.accept().unwrap();
            peer
        };
        let enter = || {
            let peer = line();
            loop {
                match peers.enter(&peer) {
                    Err(Full::Wait(wait)) => std::thread::sleep(wait),
                    done => return done,
                }
            }
        };
        let slots: Vec<_> = (0..few).map(|_| enter().unwrap()).collect();
        assert!(matches!(peers.enter(&line()), Err(Full::Wait(wait)) if wait <= MOMENT));
        slots[0].asked().unwrap();
        let next = enter().unwrap();
        let numbers: Vec<u64> = peers.inside().peers.iter().map(|peer| peer.number).collect();
        assert_eq!(numbers, [&[0][..], &(2..=few as u64).collect::<Vec<_>>()].concat());
        assert_eq!(slots[1].asked(), Err("gave way"));
        slots.iter().chain([&next]).for_each(|slot| _ = slot.asked());
        assert_eq!(enter().unwrap_err(), Full::OfOne);
        drop((slots, next));
        assert!(peers.inside().peers.is_empty());
        assert_eq!(peers.gave_way(), 1);
    }

    #[test]
    fn a_peer_of_this_machine_gives_way_to_nobody_from_outside() {
        let peers = Peers::new(LIMITS);
        let own = peers.fill("127.0.0.1");
        let mut inside = peers.inside();
        let (full, rivals) = inside.full(&LIMITS, "192.168.7.2".parse().unwrap()).unwrap();
        assert_eq!(full, Full::All);
        for peer in &mut inside.peers {
            // As if all of them still asked.
            peer.asking = Some(
                TcpStream::connect(TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap()).unwrap(),
            );
            peer.since -= MOMENT;
        }
        assert_eq!(inside.give_way(full, rivals), Err(Full::All));
        drop(inside);
        drop(own);
    }
}
