//! Logs stops that came without a request, and invalid messages at the stop socket.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use tracing::{info, warn};

use crate::rt::stops::StopFlag;
use crate::stop_socket::StopTally;

/// Time between two lines about the same flood.
const FLOOD: Duration = Duration::from_secs(1);

/// What has been logged.
#[derive(Debug)]
pub(super) struct StopLog {
    flag: Arc<StopFlag>,
    tally: Arc<StopTally>,
    reported: [u64; 6],
    next: Instant,
}

impl StopLog {
    pub(super) fn new(flag: Arc<StopFlag>, tally: Arc<StopTally>) -> Self {
        Self { flag, tally, reported: [0; 6], next: Instant::now() }
    }

    /// The flag for SIGUSR1.
    pub(super) fn signal(&self) -> Arc<AtomicBool> {
        self.flag.signal()
    }

    /// Logs what has come since the last line.
    pub(super) fn report(&mut self) {
        let now = Instant::now();
        if now >= self.next {
            self.next = now + FLOOD;
            self.flush();
        }
    }

    /// The same, however recent the last line is.
    pub(super) fn flush(&mut self) {
        let tally = &self.tally;
        let [stops, malformed, foreign, unanswered, failures] =
            [&tally.stops, &tally.malformed, &tally.foreign, &tally.unanswered, &tally.failures]
                .map(|count| count.load(Ordering::Relaxed));
        let seen = [stops, self.flag.counts().1, malformed, foreign, unanswered, failures];
        if seen == self.reported {
            return;
        }
        let [stops, signals, malformed, foreign, unanswered, failures] =
            std::array::from_fn(|at| seen[at] - self.reported[at]);
        self.reported = seen;
        if stops > 0 {
            let pid = tally.newest_pid.load(Ordering::Relaxed);
            info!("{stops} stops asked for at the socket (the last by process {pid}, as it says)");
        }
        if signals > 0 {
            info!("{signals} stops asked for by SIGUSR1");
        }
        for (count, what) in [
            (malformed, "messages at the stop socket were no stop frames"),
            (foreign, "stop frames were of another boot"),
            (unanswered, "answers to stops could not be delivered"),
            (failures, "failures of the stop socket"),
        ] {
            if count > 0 {
                warn!("{count} {what}");
            }
        }
    }
}
