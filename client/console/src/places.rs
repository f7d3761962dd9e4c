//! Who has a place: so many connections in all, fewer from other machines, and fewer still from one of them.
//!
//! One who fills all places that a machine in the network may have leaves some for others, and for a page of
//! this machine that wants to stop the arm.

use std::net::IpAddr;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use foretrace_client::metered::machine;

/// Most connections at a time.
const ALL: usize = 32;
/// Of those, most from other machines.
const OTHERS: usize = 24;
/// Of those, most from one machine. A browser opens six at a time for each page.
const ONE: usize = 12;

/// The places of a console.
#[derive(Debug, Default)]
pub(crate) struct Places {
    taken: Mutex<Vec<IpAddr>>,
}

/// A place that one connection has; free again when it is dropped.
#[derive(Debug)]
pub(crate) struct Place {
    places: Arc<Places>,
    machine: IpAddr,
}

impl Places {
    /// A place for a connection from `peer`, if there is one for it.
    ///
    /// # Errors
    ///
    /// Why there is none.
    pub(crate) fn enter(self: &Arc<Self>, peer: IpAddr) -> Result<Place, &'static str> {
        let machine = machine(peer);
        let mut taken = self.taken();
        let others = taken.iter().filter(|taken| !taken.is_loopback()).count();
        let own = taken.iter().filter(|taken| **taken == machine).count();
        if taken.len() >= ALL || !machine.is_loopback() && others >= OTHERS {
            return Err("too many connections");
        }
        if !machine.is_loopback() && own >= ONE {
            return Err("too many connections of one machine");
        }
        taken.push(machine);
        Ok(Place { places: self.clone(), machine })
    }

    fn taken(&self) -> MutexGuard<'_, Vec<IpAddr>> {
        self.taken.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        let mut taken = self.places.taken();
        if let Some(at) = taken.iter().position(|taken| *taken == self.machine) {
            taken.swap_remove(at);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fill(places: &Arc<Places>, peer: &str) -> Vec<Place> {
        let peer: IpAddr = peer.parse().unwrap();
        std::iter::from_fn(|| places.enter(peer).ok()).take(100).collect()
    }

    #[test]
    fn one_machine_leaves_places_for_others_and_all_others_leave_some_for_this_one() {
        let places = Arc::new(Places::default());
        let first = fill(&places, "192.168.7.2");
        assert_eq!(first.len(), ONE);
        let refused = places.enter("192.168.7.2".parse().unwrap()).unwrap_err();
        assert_eq!(refused, "too many connections of one machine");
        let second = fill(&places, "::ffff:192.168.7.3");
        assert_eq!(first.len() + second.len(), OTHERS);
        assert_eq!(fill(&places, "192.168.7.4").len(), 0);
        let own = fill(&places, "127.0.0.1");
        assert_eq!(own.len(), ALL - OTHERS);
        drop(first);
        assert_eq!(fill(&places, "192.168.7.4").len(), ONE);
        drop((second, own));
        assert_eq!(fill(&places, "::1").len(), ALL);
        assert!(places.taken().is_empty());
    }

    #[test]
    fn addresses_below_one_prefix_are_one_machine() {
        let places = Arc::new(Places::default());
        let some = fill(&places, "2001:db8::1");
        assert_eq!(fill(&places, "2001:db8::77").len(), 0);
        assert_eq!(fill(&places, "2001:db8:0:1::77").len(), OTHERS - some.len());
    }
}
