//! The latency from pen to arm in parts: per tick, and as medians over the last second.
//!
//! Contract: pure, time comes with the ticks. An echo of the arm counts only if it names a tick of this
//! daemon together with that tick's pen sample, and was accepted after the command was sent; otherwise that
//! part is unknown.

use std::collections::VecDeque;

use hdrhistogram::Histogram;

use foretrace_control::units::Stamp;
use foretrace_shm::{RejectReason, Rejection};

use crate::rt::facts::TickFacts;
use crate::wire::{Echo, Refused};

/// Commands that an echo may still name: one second at 1 kHz.
const KEPT: usize = 1024;
/// Medians are over intervals of this length \[ns\].
const STRETCH_NS: i64 = 1_000_000_000;
/// Longer times count as this \[ns\].
const LONGEST_NS: u64 = 60_000_000_000;

/// Parts of the latency \[ns\]; `None`: unknown.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Parts {
    /// Newest pen sample: device stamp to sent.
    pub pen_reader: Option<u64>,
    /// Newest pen sample: sent to received by a tick.
    pub pen_transport: Option<u64>,
    /// Newest pen sample: device stamp to the release of the tick.
    pub pen_age: Option<u64>,
    /// Start of the tick to the command handed to the port.
    pub compute: Option<u64>,
    /// Handed to the port to accepted by the arm, of the newest echoed command.
    pub command_transport: Option<u64>,
}

/// What was sent in a tick.
#[derive(Debug, Clone, Copy)]
struct Sent {
    tick: u64,
    published: Stamp,
    pen_sequence: u64,
    pen_stamp: Option<Stamp>,
}

/// Recent commands and recent latencies.
#[derive(Debug)]
pub struct ChainWatch {
    sent: VecDeque<Sent>,
    echoed: Option<Echo>,
    transport: Option<u64>,
    refused: Option<Refused>,
    pen: Option<(Stamp, u64)>,
    since: Option<Stamp>,
    /// In the order of the fields of [`Parts`].
    recent: [IntervalMedian; 5],
}

impl ChainWatch {
    #[must_use]
    pub fn new() -> Self {
        Self {
            sent: VecDeque::with_capacity(KEPT),
            echoed: None,
            transport: None,
            refused: None,
            pen: None,
            since: None,
            recent: std::array::from_fn(|_| IntervalMedian::new()),
        }
    }

    /// Takes in a tick; returns its parts.
    pub fn tick(&mut self, facts: &TickFacts) -> Parts {
        let (now, output) = (facts.wake.release, &facts.output);
        if now.since(*self.since.get_or_insert(now)).abs() >= STRETCH_NS {
            self.since = Some(now);
            self.recent.iter_mut().for_each(IntervalMedian::turn);
        }
        let commanded = output.command.is_some() && !facts.not_sent;
        if commanded {
            if self.sent.len() == KEPT {
                self.sent.pop_front();
            }
            self.sent.push_back(Sent {
                tick: facts.tick,
                published: facts.published,
                pen_sequence: output.pen_origin.sequence,
                pen_stamp: output.pen_stamp,
            });
        }
        let news = facts.echo != self.echoed;
        if news {
            self.echoed = facts.echo;
            let outcome = facts.echo.map(|echo| self.transport_of(&echo));
            self.transport = outcome.and_then(|outcome| outcome.ok().flatten());
            if let Some(Err(why)) = outcome {
                self.refused = Some(Refused { why, at: now });
            }
        }
        let origin = output.pen_origin;
        let pen = output.pen_stamp.map(|stamp| (stamp, origin.sequence));
        let fresh = pen != self.pen;
        self.pen = pen;
        let stamped = |stamp: Stamp| (stamp.0 != 0).then_some(stamp);
        let (sent, received) = (stamped(origin.sent), stamped(origin.received));
        let parts = Parts {
            pen_reader: between(output.pen_stamp, sent),
            pen_transport: between(sent, received),
            pen_age: between(output.pen_stamp, Some(now)),
            compute: commanded.then(|| facts.published.0.saturating_sub(facts.wake.started.0)),
            command_transport: self.transport,
        };
        let new = [
            parts.pen_reader.filter(|_| fresh),
            parts.pen_transport.filter(|_| fresh),
            parts.pen_age,
            parts.compute,
            parts.command_transport.filter(|_| news),
        ];
        for (recent, ns) in self.recent.iter_mut().zip(new) {
            recent.add(ns);
        }
        parts
    }

    /// Medians over the last complete interval of a second.
    #[must_use]
    pub fn recent(&self) -> Parts {
        let [pen_reader, pen_transport, pen_age, compute, command_transport] =
            self.recent.each_ref().map(|recent| recent.median);
        Parts { pen_reader, pen_transport, pen_age, compute, command_transport }
    }

    /// The newest echo that was rejected.
    #[must_use]
    pub const fn refused(&self) -> Option<Refused> {
        self.refused
    }

    /// Latency from publishing to acceptance of the command that `echo` names; `None` if it does not say.
    ///
    /// # Errors
    /// Why the echo is rejected.
    fn transport_of(&self, echo: &Echo) -> Result<Option<u64>, Rejection> {
        let why = |reason, field, value, bound| Rejection::new(reason, field).because(value, bound);
        let Some(sent) = self.sent.iter().rev().find(|sent| sent.tick == echo.tick) else {
            let newest = self.sent.back().map_or(0, |sent| sent.tick);
            let (tick, newest) = (echo.tick as f64, newest as f64);
            return Err(why(RejectReason::OutOfRange, "command_tick", tick, newest));
        };
        if sent.pen_sequence != echo.pen_sequence || sent.pen_stamp != echo.pen_stamp {
            let (echoed, sent) = (echo.pen_sequence as f64, sent.pen_sequence as f64);
            return Err(why(RejectReason::OutOfRange, "pen_sequence", echoed, sent));
        }
        let Some(accepted) = echo.accepted else { return Ok(None) };
        u64::try_from(accepted.since(sent.published)).map(Some).map_err(|_| {
            let early_s = sent.published.since(accepted) as f64 * 1e-9;
            why(RejectReason::TimeBackwards, "command_accepted_ns", early_s, 0.0)
        })
    }
}

impl Default for ChainWatch {
    fn default() -> Self {
        Self::new()
    }
}

/// Time from `earlier` to `later`; 0 if the two clocks disagree about the order.
fn between(earlier: Option<Stamp>, later: Option<Stamp>) -> Option<u64> {
    Some(u64::try_from(later?.since(earlier?)).unwrap_or(0))
}

/// The median of the last complete interval.
#[derive(Debug)]
struct IntervalMedian {
    current: Option<Histogram<u64>>,
    median: Option<u64>,
}

impl IntervalMedian {
    fn new() -> Self {
        // The crate accepts these constant bounds; without a histogram there would be no median.
        Self { current: Histogram::new_with_bounds(1, LONGEST_NS, 3).ok(), median: None }
    }

    fn add(&mut self, ns: Option<u64>) {
        if let (Some(current), Some(ns)) = (&mut self.current, ns) {
            current.saturating_record(ns.max(1));
        }
    }

    fn turn(&mut self) {
        if let Some(current) = &mut self.current {
            self.median = (!current.is_empty()).then(|| current.value_at_quantile(0.5));
            current.reset();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ipc::tests::commanding;

    const MS: u64 = 1_000_000;

    /// A tick that commands, with pen sample `tick` stamped 4 ms, sent 3 ms, taken in at its start.
    fn tick(tick: u64) -> TickFacts {
        let mut facts = commanding(tick);
        let now = facts.wake.release;
        facts.output.pen_stamp = Some(Stamp(now.0 - 4 * MS));
        facts.output.pen_origin.sequence = tick;
        facts.output.pen_origin.sent = Stamp(now.0 - 3 * MS);
        facts.output.pen_origin.received = now;
        facts.published = now.plus_ns(30_000);
        facts
    }

    /// `facts` as it would be `ticks` later.
    fn later(facts: &TickFacts, ticks: u64) -> TickFacts {
        let mut later = TickFacts { tick: facts.tick + ticks, ..*facts };
        let ns = 2 * ticks * MS;
        let (wake, origin) = (&mut later.wake, &mut later.output.pen_origin);
        let stamps = [&mut wake.release, &mut wake.started, &mut origin.sent, &mut origin.received];
        stamps.into_iter().chain([&mut later.published]).for_each(|stamp| *stamp = stamp.plus_ns(ns));
        later.output.pen_stamp = facts.output.pen_stamp.map(|stamp| stamp.plus_ns(ns));
        origin.sequence += ticks;
        later
    }

    fn echo_of(facts: &TickFacts, after_ns: u64) -> Echo {
        Echo {
            tick: facts.tick,
            accepted: Some(facts.published.plus_ns(after_ns)),
            pen_sequence: facts.output.pen_origin.sequence,
            pen_stamp: facts.output.pen_stamp,
        }
    }

    #[test]
    fn the_parts_of_a_tick_are_distinguished() {
        let mut watch = ChainWatch::new();
        let first = tick(100);
        assert_eq!(watch.tick(&first).command_transport, None);
        let second = TickFacts { echo: Some(echo_of(&first, 400_000)), ..tick(101) };
        let parts = Parts {
            pen_reader: Some(MS),
            pen_transport: Some(3 * MS),
            pen_age: Some(4 * MS),
            compute: Some(30_000),
            command_transport: Some(400_000),
        };
        assert_eq!(watch.tick(&second), parts);
    }

    #[test]
    fn an_echo_of_another_daemon_or_another_pen_sample_is_not_believed() {
        let mut watch = ChainWatch::new();
        let first = tick(100);
        watch.tick(&first);
        let good = echo_of(&first, 400_000);
        let bad = [
            Echo { tick: 99, ..good },
            Echo { pen_sequence: 99, ..good },
            Echo { pen_stamp: None, ..good },
            Echo { accepted: None, ..good },
            Echo { accepted: Some(Stamp(first.published.0 - 1)), ..good },
        ];
        for (next, echo) in (101..).zip(bad) {
            let parts = watch.tick(&TickFacts { echo: Some(echo), ..tick(next) });
            assert_eq!(parts.command_transport, None, "{echo:?}");
        }
        let parts = watch.tick(&TickFacts { echo: Some(good), ..tick(110) });
        assert_eq!(parts.command_transport, Some(400_000));
    }

    #[test]
    fn medians_are_those_of_the_last_second_and_vanish_with_their_cause() {
        let mut watch = ChainWatch::new();
        assert_eq!(watch.recent(), Parts::default());
        // 500 ticks are a second; the pen is live in the first two.
        let first = tick(100);
        for k in 100..=1200 {
            watch.tick(&later(&first, k - 100));
        }
        let median = watch.recent().pen_transport.unwrap();
        assert!(median.abs_diff(3 * MS) < 10_000, "{median}");
        let silent = commanding(1201);
        for k in 0..1100 {
            watch.tick(&later(&silent, k));
        }
        assert_eq!((watch.recent().pen_transport, watch.recent().pen_age), (None, None));
        assert!(watch.recent().compute.is_some());
    }
}
