//! Troubles of the network, on request: services that are off, a cut, delays.

use std::net::IpAddr;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use super::options::Service;

/// Clients whose lines are cut at a time.
const MOST_CUTS: usize = 16;

/// Troubles of the network, on request.
#[derive(Debug, Default)]
pub struct Trouble {
    state: Mutex<TroubleState>,
}

#[derive(Debug, Default)]
struct TroubleState {
    /// Whose line is cut, everybody's where nobody is named, and until when.
    cuts: Vec<(Option<IpAddr>, Instant)>,
    away_until: Option<Instant>,
    shut_down: bool,
    off: Vec<Service>,
    delay: Duration,
    jitter: Duration,
    draws: u64,
}

impl Trouble {
    fn lock(&self) -> MutexGuard<'_, TroubleState> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Nothing goes in or out for this long, to and from the client at `address` or everybody; connections
    /// stay. A cut of no length ends the one before. False where too many clients are cut off already.
    #[must_use]
    pub fn cut(&self, duration: Duration, address: Option<IpAddr>) -> bool {
        let (now, address) = (Instant::now(), address.map(|address| address.to_canonical()));
        let mut state = self.lock();
        let everybody = address.is_none();
        state.cuts.retain(|(whose, until)| *until > now && !everybody && *whose != address);
        let Some(until) = now.checked_add(duration) else { return false };
        if state.cuts.len() >= MOST_CUTS {
            return false;
        }
        state.cuts.push((address, until));
        true
    }

    /// All connections end; all ports are closed for this long.
    pub fn reboot(&self, away: Duration) {
        let mut state = self.lock();
        state.away_until = Instant::now().checked_add(away);
        state.shut_down = false;
    }

    /// All ports are closed until a reboot.
    pub fn shut_down(&self) {
        self.lock().shut_down = true;
    }

    /// Switches a service on or off.
    pub fn switch(&self, service: Service, on: bool) {
        let mut state = self.lock();
        state.off.retain(|off| *off != service);
        if !on {
            state.off.push(service);
        }
    }

    /// RTDE packages leave that much later.
    pub fn delay(&self, delay: Duration) {
        self.lock().delay = delay;
    }

    /// And evenly spread up to that much later still.
    pub fn jitter(&self, jitter: Duration) {
        self.lock().jitter = jitter;
    }

    /// Whether the service is on. That of faults always is.
    pub fn is_on(&self, service: Service) -> bool {
        let state = self.lock();
        let away = state.away_until.is_some_and(|until| Instant::now() < until);
        service == Service::Faults || !(away || state.shut_down || state.off.contains(&service))
    }

    /// Nothing may go to or come from the client at `address`.
    pub fn is_cut(&self, address: IpAddr) -> bool {
        let (now, address) = (Instant::now(), address.to_canonical());
        let meant = |whose: &Option<IpAddr>| whose.is_none_or(|whose| whose == address);
        self.lock().cuts.iter().any(|(whose, until)| meant(whose) && now < *until)
    }

    /// Of the next package.
    pub fn next_delay(&self) -> Duration {
        let mut state = self.lock();
        if state.jitter.is_zero() {
            return state.delay;
        }
        state.draws =
            state.draws.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        let share = (state.draws >> 40) as f64 / (1u64 << 24) as f64;
        state.delay + state.jitter.mul_f64(share)
    }
}
