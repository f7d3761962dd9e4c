//! What all pages and the daemon's link share.
//!
//! Contract: locks are held for copies only. Channels are bounded; what finds no room is counted.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{Sender, SyncSender, TrySendError};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use foretrace_client::PenSample;
/// Now, on the monotonic clock \[ns\].
pub(crate) use foretrace_client::monotonic_now_ns as now_ns;
use foretrace_serve::guard::Token;
use serde::Serialize;

use crate::keys::{KeyVerdict, Keys};
use crate::message::{HOLD_LASTS_NS, OperatorRequest};

/// An order that has waited for longer is dropped \[ns\].
pub(crate) const ORDER_LASTS_NS: u64 = 1_000_000_000;

/// What a page asked for, when, and where the answer goes.
#[derive(Debug)]
pub(crate) struct PageOrder {
    pub(crate) what: PageAction,
    pub(crate) page: u64,
    /// When a person asked for it \[ns, monotonic clock\].
    pub(crate) asked_ns: u64,
    pub(crate) reply: Sender<PageReply>,
}

/// Things that are carried out elsewhere than at the page's own thread.
#[derive(Debug)]
pub(crate) enum PageAction {
    Ask(OperatorRequest),
    Write(String),
    TakePen,
    Record(bool),
}

impl PageOrder {
    /// Whether it may still be carried out.
    ///
    /// # Errors
    ///
    /// A word for the count of refusals.
    pub(crate) fn judge(&self, board: &ConsoleBoard, now_ns: u64) -> Result<(), &'static str> {
        if now_ns.saturating_sub(self.asked_ns) > ORDER_LASTS_NS {
            Err("order waited for too long")
        } else if board.stops.last_ns() >= self.asked_ns {
            Err("order from before a stop")
        } else if !board.controls(self.page) {
            Err("order of a page that no longer controls")
        } else {
            Ok(())
        }
    }

    /// Drops it, counted and answered.
    pub(crate) fn refuse(self, board: &ConsoleBoard, reason: &'static str) {
        board.refuse(reason);
        // The page may be gone.
        let _ = self.reply.send(Err(format!("not carried out: {reason}; ask again")).into());
    }
}

/// An answer that a page shows.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub(crate) struct PageReply {
    pub(crate) done: bool,
    pub(crate) words: String,
}

impl From<Result<String, String>> for PageReply {
    fn from(done: Result<String, String>) -> Self {
        Self { done: done.is_ok(), words: done.unwrap_or_else(|words| words) }
    }
}

/// What came and went; keys are stable.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize)]
pub struct ConsoleTally {
    /// Pages that were connected.
    pub pages: u64,
    /// Requests, messages and connections that were refused, by reason.
    pub refused: BTreeMap<&'static str, u64>,
    /// Pen samples that were passed on.
    pub samples: u64,
    /// Pen samples that were refused, by reason.
    pub samples_refused: BTreeMap<&'static str, u64>,
    /// Frames that a page was too slow for.
    pub frames_dropped: u64,
    /// Stops that were asked for.
    pub stops: u64,
    /// Lines for the console's shell that found no room.
    pub lines_dropped: u64,
}

/// A page that waits for the confirmation of its stop.
pub(crate) struct PendingStop {
    page: u64,
    pub(crate) address: String,
    pub(crate) reply: Sender<PageReply>,
    /// Times that it has asked.
    pub(crate) times: u64,
}

/// The stops that wait, and when the last one was asked for.
#[derive(Default)]
pub(crate) struct PendingStops {
    waiting: Mutex<Vec<PendingStop>>,
    came: Condvar,
    last_ns: AtomicU64,
}

impl PendingStops {
    /// Asks for a stop in the name of a page.
    pub(crate) fn ask(&self, page: u64, address: &str, reply: &Sender<PageReply>) {
        self.last_ns.fetch_max(now_ns(), Ordering::AcqRel);
        let mut waiting = locked(&self.waiting);
        match waiting.iter_mut().find(|one| one.page == page) {
            Some(one) => one.times += 1,
            None => waiting.push(PendingStop {
                page,
                address: address.to_owned(),
                reply: reply.clone(),
                times: 1,
            }),
        }
        drop(waiting);
        self.came.notify_all();
    }

    /// When a page asked for a stop the last time; 0: never \[ns\].
    pub(crate) fn last_ns(&self) -> u64 {
        self.last_ns.load(Ordering::Acquire)
    }

    /// Lets the thread look whether everything ends.
    pub(crate) fn wake(&self) {
        self.came.notify_all();
    }

    /// Those that wait, at the latest after `patience`.
    pub(crate) fn next(&self, patience: Duration) -> Vec<PendingStop> {
        let mut waiting = locked(&self.waiting);
        if waiting.is_empty() {
            waiting = self.came.wait_timeout(waiting, patience).unwrap_or_else(PoisonError::into_inner).0;
        }
        std::mem::take(&mut *waiting)
    }
}

/// Why a page does not get the control.
#[derive(Debug)]
pub(crate) struct ControlDenied {
    pub(crate) words: String,
    /// The same may be granted later.
    pub(crate) passing: bool,
}

/// Shared by all threads of a console.
pub(crate) struct ConsoleBoard {
    keys: Mutex<Keys>,
    lines: SyncSender<String>,
    pub(crate) stops: PendingStops,
    /// None before the link is up.
    scene: Mutex<Option<Arc<str>>>,
    frame: Mutex<(u64, Arc<str>)>,
    /// The page that controls, and its address.
    controller: Mutex<Option<(u64, String)>>,
    held_ns: AtomicU64,
    pens: SyncSender<PenSample>,
    orders: SyncSender<PageOrder>,
    tally: Mutex<ConsoleTally>,
    over: AtomicBool,
}

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl ConsoleBoard {
    pub(crate) fn new(
        keys: Keys,
        lines: SyncSender<String>,
        pens: SyncSender<PenSample>,
        orders: SyncSender<PageOrder>,
    ) -> Self {
        Self {
            keys: Mutex::new(keys),
            lines,
            stops: PendingStops::default(),
            scene: Mutex::new(None),
            frame: Mutex::new((0, "{}".into())),
            controller: Mutex::new(None),
            held_ns: AtomicU64::new(0),
            pens,
            orders,
            tally: Mutex::new(ConsoleTally::default()),
            over: AtomicBool::new(false),
        }
    }

    /// Tells the person at the console's shell, without waiting for a terminal.
    pub(crate) fn note(&self, words: &str) {
        if let Err(TrySendError::Full(_)) = self.lines.try_send(words.to_owned()) {
            self.count(|tally| tally.lines_dropped += 1);
        }
    }

    pub(crate) fn show_scene(&self, scene: Arc<str>) {
        *locked(&self.scene) = Some(scene);
    }

    pub(crate) fn scene(&self) -> Option<Arc<str>> {
        locked(&self.scene).clone()
    }

    /// The newest frame replaces the one before.
    pub(crate) fn show(&self, frame: Arc<str>) {
        let mut newest = locked(&self.frame);
        *newest = (newest.0 + 1, frame);
    }

    /// The newest frame and its number.
    pub(crate) fn frame(&self) -> (u64, Arc<str>) {
        locked(&self.frame).clone()
    }

    pub(crate) fn count(&self, change: impl FnOnce(&mut ConsoleTally)) {
        change(&mut locked(&self.tally));
    }

    pub(crate) fn refuse(&self, reason: &'static str) {
        self.count(|tally| *tally.refused.entry(reason).or_default() += 1);
    }

    pub(crate) fn tally(&self) -> ConsoleTally {
        locked(&self.tally).clone()
    }

    /// The token's text, for the address that is printed.
    pub(crate) fn token(&self) -> String {
        locked(&self.keys).text().to_owned()
    }

    /// A token that works once more.
    pub(crate) fn renew_token(&self, token: Token) {
        locked(&self.keys).renew(token);
    }

    /// Gives the control to page `id`; inside, the key that it has to present from here on.
    ///
    /// # Errors
    ///
    /// Who has it, or that the token is wrong or used; in words.
    pub(crate) fn take_control(
        &self,
        id: u64,
        address: &str,
        token: &str,
    ) -> Result<Option<String>, ControlDenied> {
        let mut keys = locked(&self.keys);
        let judged = keys.judge(token);
        let refused = match judged {
            KeyVerdict::Opens | KeyVerdict::OpensOnce => None,
            KeyVerdict::Wrong => {
                Some(("wrong token", "the token is wrong: open the address that `foretrace console` printed"))
            }
            KeyVerdict::Used => Some((
                "token used before",
                "the token has been used, it works once: type `token` where `foretrace console` runs for another",
            )),
        };
        if let Some((reason, words)) = refused {
            self.refuse(reason);
            return Err(ControlDenied { words: words.to_owned(), passing: false });
        }
        let mut controller = locked(&self.controller);
        if let Some((_, at)) = controller.as_ref().filter(|(other, _)| *other != id) {
            let words = format!("the page of {at} controls: give the control back there first");
            drop(controller);
            self.refuse("another page controls");
            return Err(ControlDenied { words, passing: true });
        }
        let no_key = |error| ControlDenied { words: format!("no key can be made: {error}"), passing: false };
        let key = match judged {
            KeyVerdict::OpensOnce => Some(Token::random().map_err(no_key)?),
            _ => None,
        };
        *controller = Some((id, address.to_owned()));
        Ok(key.map(|key| {
            let text = key.text().to_owned();
            keys.use_up(key);
            text
        }))
    }

    pub(crate) fn controls(&self, id: u64) -> bool {
        locked(&self.controller).as_ref().is_some_and(|(holder, _)| *holder == id)
    }

    /// The address of the page that controls.
    pub(crate) fn controller(&self) -> Option<String> {
        locked(&self.controller).as_ref().map(|(_, address)| address.clone())
    }

    /// Takes the control back from page `id`, and with it the hold-to-run button.
    pub(crate) fn release(&self, id: u64) -> bool {
        let mut controller = locked(&self.controller);
        let was = controller.as_ref().is_some_and(|(holder, _)| *holder == id);
        if was {
            *controller = None;
            self.held_ns.store(0, Ordering::Release);
        }
        was
    }

    /// The hold-to-run button was held, or let go, at `now_ns`.
    pub(crate) fn hold(&self, held: bool, now_ns: u64) {
        self.held_ns.store(if held { now_ns } else { 0 }, Ordering::Release);
    }

    /// Whether it is held at `now_ns`: by a page that controls, and heard of a moment ago.
    pub(crate) fn is_held(&self, now_ns: u64) -> bool {
        let held_ns = self.held_ns.load(Ordering::Acquire);
        held_ns != 0 && now_ns.saturating_sub(held_ns) < HOLD_LASTS_NS
    }

    /// Passes a sample on to the link.
    pub(crate) fn pen(&self, sample: PenSample) {
        if let Err(TrySendError::Full(_)) = self.pens.try_send(sample) {
            self.count(|tally| *tally.samples_refused.entry("no room").or_default() += 1);
        }
    }

    /// Passes an order on; `false`: there is no room for it.
    pub(crate) fn order(&self, order: PageOrder) -> bool {
        let placed = self.orders.try_send(order).is_ok();
        if !placed {
            self.refuse("too many orders");
        }
        placed
    }

    pub(crate) fn finish(&self) {
        self.over.store(true, Ordering::Release);
        self.held_ns.store(0, Ordering::Release);
        self.stops.wake();
    }

    pub(crate) fn is_over(&self) -> bool {
        self.over.load(Ordering::Acquire)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::mpsc::sync_channel;

    fn board() -> ConsoleBoard {
        let lines = sync_channel(2).0;
        let keys = Keys::new(Token::random().unwrap(), false);
        ConsoleBoard::new(keys, lines, sync_channel(2).0, sync_channel(2).0)
    }

    #[test]
    fn one_page_controls_and_only_with_the_token() {
        let board = board();
        let token = board.token();
        assert!(board.take_control(1, "here", "x").unwrap_err().words.contains("token is wrong"));
        board.take_control(1, "here", &token).unwrap();
        let denied = board.take_control(2, "there", &token).unwrap_err();
        assert!(denied.passing && denied.words.contains("the page of here controls"));
        assert!(board.controls(1) && !board.controls(2) && !board.release(2));
        assert!(board.release(1));
        board.take_control(2, "there", &token).unwrap();
        assert_eq!(board.tally().refused.values().sum::<u64>(), 2);
    }

    #[test]
    fn a_button_is_held_only_while_it_is_heard_of_and_its_page_controls() {
        let board = board();
        board.take_control(1, "here", &board.token()).unwrap();
        board.hold(true, 1000);
        assert!(board.is_held(1000) && board.is_held(999 + HOLD_LASTS_NS));
        assert!(!board.is_held(1000 + HOLD_LASTS_NS));
        board.hold(true, 2000);
        board.release(1);
        assert!(!board.is_held(2001));
    }
}
