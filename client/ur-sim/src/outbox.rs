//! What waits to be written to one connection: replies in order, and the newest package.
//!
//! Contract: bounded. A newer package replaces one that was not written yet, so that a client that
//! stops reading costs the control loop nothing. With a delay asked for, packages wait in a queue instead.

use std::collections::VecDeque;
use std::io::Write;
use std::net::{Shutdown, TcpStream};
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Replies that wait at most.
const MOST_REPLIES: usize = 256;
/// Packages that wait at most, where they are delayed: 2 s at 500 Hz.
const MOST_DELAYED: usize = 1000;

#[derive(Debug, Default)]
struct Queue {
    replies: VecDeque<Vec<u8>>,
    packages: VecDeque<(Instant, Vec<u8>)>,
    closed: bool,
}

#[derive(Debug, Default)]
pub struct ConnectionOutbox {
    queue: Mutex<Queue>,
    news: Condvar,
}

impl ConnectionOutbox {
    fn lock(&self) -> MutexGuard<'_, Queue> {
        self.queue.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Bytes that must arrive; false where too many wait already.
    pub fn reply(&self, bytes: Vec<u8>) -> bool {
        let mut queue = self.lock();
        if queue.closed || queue.replies.len() >= MOST_REPLIES {
            return false;
        }
        queue.replies.push_back(bytes);
        drop(queue);
        self.news.notify_one();
        true
    }

    /// A package that replaces an older one, to be written after `delay`.
    pub fn package(&self, bytes: Vec<u8>, delay: Duration) {
        let mut queue = self.lock();
        if delay.is_zero() {
            queue.packages.clear();
        } else if queue.packages.len() >= MOST_DELAYED {
            queue.packages.pop_front();
        }
        // Jitter never changes the order.
        let due = Instant::now() + delay;
        let due = queue.packages.back().map_or(due, |(before, _)| due.max(*before));
        queue.packages.push_back((due, bytes));
        drop(queue);
        self.news.notify_one();
    }

    /// Packages that were not written yet are of no use any more.
    pub fn forget_packages(&self) {
        self.lock().packages.clear();
    }

    /// Nothing is written any more.
    pub fn close(&self) {
        self.lock().closed = true;
        self.news.notify_one();
    }

    /// The next bytes to be written; `None` once closed and replied to.
    fn next(&self) -> Option<Vec<u8>> {
        let mut queue = self.lock();
        loop {
            if let Some(reply) = queue.replies.pop_front() {
                return Some(reply);
            }
            if queue.closed {
                return None;
            }
            let due = queue.packages.front().map(|(due, _)| due.saturating_duration_since(Instant::now()));
            queue = match due {
                Some(Duration::ZERO) => return queue.packages.pop_front().map(|(_, bytes)| bytes),
                Some(wait) => match self.news.wait_timeout(queue, wait) {
                    Ok((queue, _)) => queue,
                    Err(poisoned) => poisoned.into_inner().0,
                },
                None => self.news.wait(queue).unwrap_or_else(PoisonError::into_inner),
            };
        }
    }

    /// Writes until the outbox is closed or the connection breaks, then shuts it down. `may_write` waits out
    /// a cut network.
    pub fn write_to(&self, mut stream: &TcpStream, may_write: impl Fn()) {
        while let Some(bytes) = self.next() {
            may_write();
            if stream.write_all(&bytes).is_err() {
                break;
            }
        }
        self.close();
        // It may be shut down already.
        let _ = stream.shutdown(Shutdown::Both);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_newest_package_takes_the_place_of_older_ones_and_replies_are_kept() {
        let outbox = ConnectionOutbox::default();
        assert!(outbox.reply(vec![1]));
        for package in 2..100 {
            outbox.package(vec![package], Duration::ZERO);
        }
        assert!(outbox.reply(vec![200]));
        assert_eq!((0..3).map(|_| outbox.next().unwrap()).collect::<Vec<_>>(), [[1], [200], [99]]);
        outbox.close();
        assert_eq!(outbox.next(), None);
    }

    #[test]
    fn nobody_who_reads_costs_no_more_than_the_bound() {
        let outbox = ConnectionOutbox::default();
        let taken = (0..10 * MOST_REPLIES).filter(|_| outbox.reply(vec![0])).count();
        assert_eq!(taken, MOST_REPLIES);
        for _ in 0..10 * MOST_DELAYED {
            outbox.package(vec![0], Duration::from_secs(100));
        }
        assert_eq!(outbox.lock().packages.len(), MOST_DELAYED);
    }

    #[test]
    fn delayed_packages_keep_their_order() {
        let outbox = ConnectionOutbox::default();
        outbox.package(vec![1], Duration::from_millis(20));
        outbox.package(vec![2], Duration::from_millis(1));
        assert_eq!((outbox.next(), outbox.next()), (Some(vec![1]), Some(vec![2])));
    }
}
