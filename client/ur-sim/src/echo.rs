//! A bare echo pair: what a line and a machine do to counters, without robot, protocol, law or arm.
//!
//! One end plays the controller: every cycle it reads what has come, counts as the program on a controller
//! does, and sends a state. The other end answers each state with the next counter. Run beside a bridge, over
//! the same kind of socket, it tells which late cycles and lost counters are not the bridge's.
//!
//! Contract: every wait is bounded. Messages are as large as the bridge's.

use std::io::{ErrorKind, Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::time::{Duration, Instant};

use serde::Serialize;

/// Bytes of a state: that of the bridge's recipe, with its header.
const STATE_BYTES: usize = 212;
/// Bytes of an answer: that of the bridge's registers, with its header.
const ANSWER_BYTES: usize = 108;
/// Longest wait for a partner, and for a state.
const PATIENCE: Duration = Duration::from_millis(50);

/// A run in figures; keys are stable.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub struct EchoTally {
    /// Cycles since the first counter came.
    pub cycles: u64,
    /// Cycles without a fresh counter.
    pub late_cycles: u64,
    /// Counters that were never looked at: a newer one came within the same cycle.
    pub lost_counters: u64,
    /// The longest time without a fresh counter \[cycles\].
    pub longest_cycles: u64,
}

/// What a controller sees of counters, cycle by cycle.
#[derive(Debug, Clone, Copy, Default)]
struct CounterWatch {
    tally: EchoTally,
    counter: u64,
    missed: u64,
}

impl CounterWatch {
    /// A cycle that found `newest`; nothing is counted before the first.
    fn cycle(&mut self, newest: Option<u64>) {
        let Self { tally, counter, missed } = self;
        let fresh = newest.filter(|newest| *newest > *counter);
        if *counter == 0 {
            *counter = fresh.unwrap_or(0);
            return;
        }
        tally.cycles += 1;
        match fresh {
            Some(newest) => {
                tally.lost_counters += newest - *counter - 1;
                (*counter, *missed) = (newest, 0);
            }
            None => {
                tally.late_cycles += 1;
                *missed += 1;
                tally.longest_cycles = tally.longest_cycles.max(*missed);
            }
        }
    }
}

/// Plays the controller at `rate_hz` for the first partner at `listener`, until `goes_on` says no or the
/// partner leaves.
///
/// # Errors
///
/// The system's, but for a partner that leaves.
pub fn controller(
    listener: &TcpListener,
    rate_hz: f64,
    goes_on: &mut dyn FnMut() -> bool,
) -> std::io::Result<EchoTally> {
    let mut seen = CounterWatch::default();
    listener.set_nonblocking(true)?;
    let mut partner = loop {
        match listener.accept() {
            Ok((stream, _)) => break stream,
            Err(error) if error.kind() == ErrorKind::WouldBlock && goes_on() => {
                std::thread::sleep(PATIENCE);
            }
            Err(error) if error.kind() == ErrorKind::WouldBlock => return Ok(seen.tally),
            Err(error) => return Err(error),
        }
    };
    partner.set_nodelay(true)?;
    partner.set_nonblocking(true)?;
    let (mut answers, state) = (AnswerReader::default(), [0; STATE_BYTES]);
    let (period, mut next) = (Duration::from_secs_f64(1.0 / rate_hz), Instant::now());
    while goes_on() {
        next += period;
        std::thread::sleep(next.saturating_duration_since(Instant::now()));
        let Some(newest) = answers.read(&mut partner)? else { break };
        seen.cycle(newest);
        match partner.write(&state) {
            Ok(STATE_BYTES) => {}
            // A partner that does not read: it is not given more, as by a controller under load.
            Err(error) if error.kind() == ErrorKind::WouldBlock => {}
            _ => break,
        }
    }
    Ok(seen.tally)
}

/// The bytes of an answer that is not whole yet.
#[derive(Debug)]
struct AnswerReader {
    bytes: [u8; ANSWER_BYTES],
    filled: usize,
}

impl Default for AnswerReader {
    fn default() -> Self {
        Self { bytes: [0; ANSWER_BYTES], filled: 0 }
    }
}

impl AnswerReader {
    /// The newest counter that has come, if any; `None` when the partner has left.
    fn read(&mut self, partner: &mut TcpStream) -> std::io::Result<Option<Option<u64>>> {
        let mut newest = None;
        // Bounded: a partner that floods must not hold a cycle up.
        for _ in 0..64 {
            let Some(rest) = self.bytes.get_mut(self.filled..) else { break };
            match partner.read(rest) {
                Ok(0) => return Ok(None),
                Ok(count) => self.filled += count,
                Err(error) if error.kind() == ErrorKind::WouldBlock => break,
                Err(error) if error.kind() == ErrorKind::ConnectionReset => return Ok(None),
                Err(error) => return Err(error),
            }
            if self.filled == ANSWER_BYTES {
                newest = self.bytes.first_chunk().map(|bytes| u64::from_be_bytes(*bytes));
                self.filled = 0;
            }
        }
        Ok(Some(newest))
    }
}

/// Waits for a controller at `address` and answers every state of it with the next counter, until `goes_on`
/// says no or the controller leaves.
///
/// # Errors
///
/// The system's, but for a controller that leaves.
pub fn bridge(address: SocketAddr, goes_on: &mut dyn FnMut() -> bool) -> std::io::Result<()> {
    let mut controller = loop {
        match TcpStream::connect_timeout(&address, PATIENCE) {
            Ok(stream) => break stream,
            Err(error) if !goes_on() => return Err(error),
            // Nobody listens there yet.
            Err(_) => std::thread::sleep(PATIENCE),
        }
    };
    controller.set_nodelay(true)?;
    controller.set_read_timeout(Some(PATIENCE))?;
    let (mut state, mut filled, mut counter) = ([0; STATE_BYTES], 0, 0_u64);
    let mut answer = [0; ANSWER_BYTES];
    while goes_on() {
        match state.get_mut(filled..).map_or(Ok(0), |rest| controller.read(rest)) {
            Ok(0) => break,
            Ok(count) => filled += count,
            Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {}
            Err(_) => break,
        }
        if filled == STATE_BYTES {
            filled = 0;
            counter += 1;
            answer[..8].copy_from_slice(&counter.to_be_bytes());
            if controller.write_all(&answer).is_err() {
                break;
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn late_lost_and_longest_are_counted_as_the_program_counts_them() {
        let mut seen = CounterWatch::default();
        for newest in [None, Some(3), Some(4), None, None, Some(7), Some(7), Some(9)] {
            seen.cycle(newest);
        }
        let expected = EchoTally { cycles: 6, late_cycles: 3, lost_counters: 3, longest_cycles: 2 };
        assert_eq!(seen.tally, expected);
    }

    /// Over real sockets: every counter arrives, and one that stands still for 100 ms is seen to.
    #[test]
    fn a_pair_over_loopback_counts_a_pause_of_one_end() {
        let listener = TcpListener::bind(("127.0.0.1", 0)).unwrap();
        let address = listener.local_addr().unwrap();
        let began = Instant::now();
        let lasts = move || began.elapsed() < Duration::from_millis(900);
        let answering = std::thread::spawn(move || {
            let mut paused = false;
            bridge(address, &mut || {
                if !paused && began.elapsed() > Duration::from_millis(400) {
                    paused = true;
                    std::thread::sleep(Duration::from_millis(100));
                }
                lasts()
            })
        });
        let tally = controller(&listener, 125.0, &mut || lasts()).unwrap();
        answering.join().unwrap().unwrap();
        assert!(tally.cycles > 10 && tally.longest_cycles >= 10, "{tally:?}");
        // After the pause all waiting states are answered at once: the newest of a cycle counts.
        assert!(tally.lost_counters >= 10, "{tally:?}");
    }
}
