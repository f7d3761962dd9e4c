//! What viewers ask for, and the two threads that do it: one stops the arm, one asks the daemon.
//!
//! Contract: a stop waits for nothing but stops. Those that came before one is sent share it. An order has a
//! bounded queue to wait in, is dropped when it has waited for more than a second, and keeps its date, so
//! that the daemon refuses to arm what was stopped since then.

use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::time::Duration;

use foretrace_client::{Foretrace, Instance, monotonic_now_ns};

use super::protocol::ViewerSetting;

/// Orders that may wait.
const WAITING: usize = 4;
/// Stops that may wait to be answered together.
const STOPS: usize = 64;
/// How long the daemon has to answer.
const ANSWER: Duration = Duration::from_secs(3);
/// Longest wait for the confirmation of a stop.
const STOP: Duration = Duration::from_secs(2);
/// An order that has waited for longer is dropped \[ns\].
const LASTS_NS: u64 = 1_000_000_000;

/// What came of it, in words.
pub(crate) type OrderAnswer = Result<String, String>;
/// Where the answer goes.
pub(crate) type ReplyFn = Box<dyn FnOnce(OrderAnswer) + Send>;

/// What the daemon is asked for.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum OrderKind {
    Arm,
    Set(ViewerSetting),
}

struct ViewerOrder {
    what: OrderKind,
    asked_ns: u64,
    reply: ReplyFn,
}

/// The way to both threads, which end with the last of these.
#[derive(Clone)]
pub(crate) struct Orders {
    orders: SyncSender<ViewerOrder>,
    stops: SyncSender<ReplyFn>,
}

impl Orders {
    pub(crate) fn start(instance: &Instance) -> std::io::Result<Self> {
        let ((orders, due), (stops, wanted)) = (sync_channel(WAITING), sync_channel(STOPS));
        let (asked, stopped) = (instance.clone(), instance.clone());
        let thread = |name: &str| std::thread::Builder::new().name(name.to_owned());
        thread("foretrace-asks").spawn(move || serve(&due, |what, at_ns| ask(&asked, what, at_ns)))?;
        thread("foretrace-stops").spawn(move || {
            serve_stops(&wanted, || {
                let stopped = foretrace_client::stop(&stopped, STOP);
                let done = stopped.map(|stopped| format!("the arm stops: {}", stopped.words()));
                done.map_err(|error| format!("{error}: use the arm's own stop button"))
            });
        })?;
        Ok(Self { orders, stops })
    }

    pub(crate) fn stop(&self, reply: ReplyFn) {
        match self.stops.try_send(reply) {
            Ok(()) => {}
            // Sixty-four stops are under way.
            Err(TrySendError::Full(reply) | TrySendError::Disconnected(reply)) => {
                reply(Err("a stop is under way already".to_owned()));
            }
        }
    }

    /// Passes an order on; one that finds no room is refused.
    pub(crate) fn pass(&self, what: OrderKind, reply: ReplyFn) {
        match self.orders.try_send(ViewerOrder { what, asked_ns: monotonic_now_ns(), reply }) {
            Ok(()) => {}
            Err(TrySendError::Full(order) | TrySendError::Disconnected(order)) => {
                (order.reply)(Err("orders before it wait for the daemon: try again".to_owned()));
            }
        }
    }
}

fn serve(due: &Receiver<ViewerOrder>, mut ask: impl FnMut(&OrderKind, u64) -> OrderAnswer) {
    while let Ok(ViewerOrder { what, asked_ns, reply }) = due.recv() {
        let waited_ns = monotonic_now_ns().saturating_sub(asked_ns);
        let late = "it waited behind other orders for too long: try again";
        reply(if waited_ns > LASTS_NS { Err(late.to_owned()) } else { ask(&what, asked_ns) });
    }
}

fn serve_stops(wanted: &Receiver<ReplyFn>, mut stop: impl FnMut() -> OrderAnswer) {
    while let Ok(first) = wanted.recv() {
        let mut replies = vec![first];
        replies.extend(wanted.try_iter().take(STOPS));
        let answer = stop();
        replies.into_iter().for_each(|reply| reply(answer.clone()));
    }
}

fn ask(instance: &Instance, what: &OrderKind, asked_ns: u64) -> OrderAnswer {
    let words = |error: &dyn std::fmt::Display| error.to_string();
    let foretrace = Foretrace::attach_within(instance, Duration::ZERO).map_err(|error| words(&error))?;
    let mut requests = foretrace.requests().decided_at(asked_ns);
    let answer = match what {
        OrderKind::Arm => requests.arm(ANSWER),
        OrderKind::Set(ViewerSetting::Trust(trust)) => requests.set_trust(*trust, ANSWER),
        OrderKind::Set(ViewerSetting::TrustAuto) => requests.trust_auto(ANSWER),
        OrderKind::Set(ViewerSetting::Predictor(name)) => requests.switch_predictor(name, ANSWER),
    };
    let text = answer.map_err(|error| words(&error))?.text();
    Ok(if text.is_empty() { "done".to_owned() } else { text })
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::mpsc::channel;

    #[test]
    fn stops_that_wait_share_one_and_each_is_answered_while_orders_hang() {
        let (sender, answers) = channel();
        let (stops, wanted) = sync_channel(STOPS);
        for _ in 0..10 {
            let sender = sender.clone();
            let reply: ReplyFn = Box::new(move |answer| sender.send(answer).unwrap());
            assert!(stops.try_send(reply).is_ok());
        }
        drop((stops, sender));
        let mut sent = 0;
        serve_stops(&wanted, || {
            sent += 1;
            Ok("stopped".to_owned())
        });
        assert_eq!((sent, answers.iter().filter(Result::is_ok).count()), (1, 10));
    }

    #[test]
    fn an_order_keeps_its_date_and_is_dropped_when_it_is_old() {
        let (orders, due) = sync_channel(WAITING);
        let (sender, answers) = channel();
        let now = monotonic_now_ns();
        for asked_ns in [now, now - 2 * LASTS_NS] {
            let sender = sender.clone();
            let reply: ReplyFn = Box::new(move |answer| sender.send(answer).unwrap());
            assert!(orders.try_send(ViewerOrder { what: OrderKind::Arm, asked_ns, reply }).is_ok());
        }
        drop((orders, sender));
        let mut asked = Vec::new();
        serve(&due, |what, at_ns| {
            asked.push((what.clone(), at_ns));
            Ok("armed".to_owned())
        });
        assert_eq!(asked, [(OrderKind::Arm, now)]);
        let answers: Vec<OrderAnswer> = answers.iter().collect();
        assert!(answers[0].is_ok() && answers[1].is_err(), "{answers:?}");
    }
}
