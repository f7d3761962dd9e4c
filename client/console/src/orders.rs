//! What a page asks for, and the thread that asks the daemon for it.
//!
//! Contract: an order is carried out at once or not at all. One that has waited too long, whose page no
//! longer controls, or that is from before a stop is dropped, counted and answered: it must not move an arm
//! that somebody has stopped since then.

use std::sync::Arc;
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::time::Duration;

use foretrace_client::{Foretrace, Instance, ServiceError};

use crate::board::{ConsoleBoard, PageAction, PageOrder, now_ns};
use crate::message::OperatorRequest;

/// Orders that may wait for the daemon: the one that is being asked is not among them.
const WAITING: usize = 2;
/// How long the daemon has to answer.
const ANSWER: Duration = Duration::from_secs(3);

/// The way to the daemon.
pub(crate) struct Asks(SyncSender<PageOrder>);

impl Asks {
    /// Starts the thread that asks, one order after another; it ends with this value.
    ///
    /// # Errors
    ///
    /// The daemon cannot be attached to; inside, that no thread can be started.
    pub(crate) fn start(
        instance: &Instance,
        board: &Arc<ConsoleBoard>,
    ) -> Result<std::io::Result<Self>, ServiceError> {
        let mut foretrace = Foretrace::attach_within(instance, Duration::ZERO)?;
        let board = board.clone();
        let (sender, orders) = sync_channel(WAITING);
        let asks = move || {
            serve(&board, &orders, |request, asked_ns| {
                let _ = foretrace.reattach_if_needed();
                ask(&foretrace, request, asked_ns)
            });
        };
        let started = std::thread::Builder::new().name("console-asks".to_owned()).spawn(asks);
        Ok(started.map(|_| Self(sender)))
    }

    /// Passes an order on; one that finds no room is refused.
    pub(crate) fn pass(&self, order: PageOrder, board: &ConsoleBoard) {
        match self.0.try_send(order) {
            Ok(()) => {}
            Err(TrySendError::Full(order)) => order.refuse(board, "orders before it wait for the daemon"),
            Err(TrySendError::Disconnected(order)) => order.refuse(board, "nobody asks the daemon any more"),
        }
    }
}

fn serve(
    board: &ConsoleBoard,
    orders: &Receiver<PageOrder>,
    mut ask: impl FnMut(&OperatorRequest, u64) -> Result<String, String>,
) {
    while let Ok(order) = orders.recv() {
        // It may have waited behind another one.
        match (order.judge(board, now_ns()), &order.what) {
            (Ok(()), PageAction::Ask(request)) => {
                let done = ask(request, order.asked_ns);
                // The page may be gone.
                let _ = order.reply.send(done.into());
            }
            (Ok(()), _) => order.refuse(board, "no question for the daemon"),
            (Err(reason), _) => order.refuse(board, reason),
        }
    }
}

fn ask(foretrace: &Foretrace, request: &OperatorRequest, asked_ns: u64) -> Result<String, String> {
    // The daemon refuses to arm what anybody has stopped since the click.
    let mut requests = foretrace.requests().decided_at(asked_ns);
    let answer = match request {
        OperatorRequest::Arm(_) => requests.arm(ANSWER),
        OperatorRequest::Disarm(_) => requests.disarm(ANSWER),
        OperatorRequest::Home(_) => requests.move_home(ANSWER),
        OperatorRequest::TrustAuto(_) => requests.trust_auto(ANSWER),
        OperatorRequest::FreezeTrust(_) => requests.freeze_trust(ANSWER),
        OperatorRequest::Trust(value) => requests.set_trust(*value, ANSWER),
        OperatorRequest::Predictor(name) => requests.switch_predictor(name, ANSWER),
        OperatorRequest::Reload(_) => requests.reload(ANSWER),
    };
    let text = answer.map_err(|error| error.to_string())?.text();
    Ok(if text.is_empty() { "done".to_owned() } else { text })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::board::{ORDER_LASTS_NS as LASTS_NS, PageReply};
    use crate::keys::Keys;
    use foretrace_serve::guard::Token;
    use std::sync::mpsc::channel;

    fn board() -> ConsoleBoard {
        let lines = sync_channel(2).0;
        let board = ConsoleBoard::new(
            Keys::new(Token::random().unwrap(), false),
            lines,
            sync_channel(2).0,
            sync_channel(2).0,
        );
        board.take_control(1, "here", &board.token()).unwrap();
        board
    }

    fn order(request: OperatorRequest, asked_ns: u64) -> (PageOrder, Receiver<PageReply>) {
        let (reply, answers) = channel();
        (PageOrder { what: PageAction::Ask(request), page: 1, asked_ns, reply }, answers)
    }

    #[test]
    fn an_order_is_dropped_that_is_old_or_from_before_a_stop_or_of_a_page_without_control() {
        let board = board();
        let now = now_ns();
        let (fresh, _told) = order(OperatorRequest::Arm(true), now);
        assert_eq!(fresh.judge(&board, now + LASTS_NS), Ok(()));
        assert_eq!(fresh.judge(&board, now + LASTS_NS + 1), Err("order waited for too long"));
        board.stops.ask(2, "there", &channel().0);
        assert_eq!(fresh.judge(&board, now), Err("order from before a stop"));
        let (later, _told) = order(OperatorRequest::Arm(true), now_ns() + 1);
        assert_eq!(later.judge(&board, now), Ok(()));
        board.release(1);
        assert_eq!(later.judge(&board, now), Err("order of a page that no longer controls"));
    }

    #[test]
    fn what_waits_behind_a_slow_answer_does_not_arm_after_a_stop_and_everybody_is_reported() {
        let board = board();
        let (sender, orders) = sync_channel(WAITING);
        let asks = Asks(sender);
        let mut told = Vec::new();
        for request in [OperatorRequest::Disarm(true), OperatorRequest::Arm(true), OperatorRequest::Arm(true)]
        {
            let (order, answers) = order(request, now_ns());
            asks.pass(order, &board);
            told.push(answers);
        }
        drop(asks);
        let mut asked = Vec::new();
        serve(&board, &orders, |request, _| {
            asked.push(request.clone());
            // Somebody stops the arm while the daemon takes its time.
            board.stops.ask(2, "there", &channel().0);
            Ok("done".to_owned())
        });
        assert_eq!(asked, [OperatorRequest::Disarm(true)]);
        let told: Vec<PageReply> = told.iter().map(|answers| answers.recv().unwrap()).collect();
        assert!(told[0].done && !told[1].done && !told[2].done, "{told:?}");
        assert!(told[1].words.contains("from before a stop"), "{told:?}");
        assert!(told[2].words.contains("wait for the daemon"), "{told:?}");
        assert_eq!(board.tally().refused.values().sum::<u64>(), 2);
    }
}
