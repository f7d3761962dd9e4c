//! One page: its messages in, scene, frames and answers out.
//!
//! Contract: every wait is bounded. A page that sends too much, or reads too slowly for too long, or falls
//! silent is let go, and with it whatever it held.

use std::sync::Arc;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::Duration;

use foretrace_serve::websocket::{Incoming, Message as Packet, Socket, SocketLimits};

use crate::board::{ConsoleBoard, ControlDenied, PageAction, PageOrder, PageReply, now_ns};
use crate::message::{MESSAGE_BYTES, OperatorRequest, PageMessage, asked_at, held_at, sample};
use crate::wire::PageStream;

/// Longest wait for a message, and so between two looks at new frames.
const WAIT: Duration = Duration::from_millis(5);
/// Longest time for which one write may hold the page's thread up.
const WRITE: Duration = Duration::from_millis(20);
/// A pen of 1000 Hz sends one message per sample at most; a page measures its clock every second.
const LIMITS: SocketLimits = SocketLimits {
    message_bytes: MESSAGE_BYTES,
    messages_per_s: 1500,
    write_buffer: 0,
    stuck: Duration::from_secs(3),
    silent: Duration::from_secs(15),
};

/// Serves the page until it ends; `stream` has been upgraded.
pub(crate) fn serve(board: &Arc<ConsoleBoard>, stream: PageStream, id: u64, address: &str) {
    if stream.set_timeouts(WAIT, WRITE).and_then(|()| stream.set_nodelay()).is_err() {
        return;
    }
    let (replies, answers) = channel();
    let mut page = Page {
        socket: Socket::new(stream, LIMITS),
        board,
        id,
        address,
        replies,
        answers,
        shown: 0,
        has_scene: false,
    };
    let reason = page.talk();
    page.socket.close().end();
    if board.release(id) {
        board.note(&format!("the page of {address} ended ({reason}) and no longer controls"));
    }
}

struct Page<'a> {
    socket: Socket<PageStream>,
    board: &'a Arc<ConsoleBoard>,
    id: u64,
    address: &'a str,
    replies: Sender<PageReply>,
    answers: Receiver<PageReply>,
    /// Number of the last frame that was shown.
    shown: u64,
    has_scene: bool,
}

impl Page<'_> {
    /// Until it ends, and why.
    fn talk(&mut self) -> &'static str {
        while !self.board.is_over() {
            match self.socket.receive() {
                Ok(Incoming::Message(Packet::Text(text))) => self.hear(text.as_str()),
                Ok(Incoming::Message(_)) => self.board.refuse("binary message"),
                Ok(Incoming::Nothing) => {}
                Ok(Incoming::Closed) => return "closed",
                Ok(Incoming::Broken) => return "connection broke",
                Err(reason) => {
                    self.board.refuse(reason);
                    return reason;
                }
            }
            while let Ok(reply) = self.answers.try_recv() {
                self.send(&serde_json::json!({ "reply": reply }).to_string());
            }
            if let Some(reason) = self.show() {
                return reason;
            }
        }
        "the console ends"
    }

    /// Shows the newest frame, unless an older one still waits to be read.
    fn show(&mut self) -> Option<&'static str> {
        if let Err(reason) = self.socket.push() {
            self.board.refuse(reason);
            return Some(reason);
        }
        // A page may come before the daemon was attached to.
        if let (false, Some(scene)) = (self.has_scene, self.board.scene()) {
            self.send(&scene);
            self.has_scene = true;
        }
        let (number, frame) = self.board.frame();
        if number != self.shown {
            let missed = number.saturating_sub(self.shown + 1);
            if self.socket.is_stuck() {
                self.board.count(|tally| tally.frames_dropped += 1);
            } else {
                if self.shown != 0 {
                    self.board.count(|tally| tally.frames_dropped += missed);
                }
                self.send(&frame);
            }
            self.shown = number;
        }
        None
    }

    fn send(&mut self, text: &str) {
        self.socket.send(Packet::text(text));
        self.socket.flush();
    }

    /// Does what the page says, if it may.
    fn hear(&mut self, text: &str) {
        let message = match PageMessage::read(text) {
            Ok(message) => message,
            Err(reason) => {
                self.board.refuse(reason);
                return;
            }
        };
        if message.needs_control() && !self.board.controls(self.id) {
            self.board.refuse("without control");
            if !matches!(message, PageMessage::Pen(_) | PageMessage::Hold(..)) {
                self.tell(false, "this page only watches: take the control first".to_owned());
            }
            return;
        }
        self.carry_out(message);
    }

    fn carry_out(&mut self, message: PageMessage) {
        match message {
            PageMessage::Ping(at) => {
                let pong = serde_json::json!({ "pong": [at, now_ns() as f64 * 1e-3] });
                self.send(&pong.to_string());
            }
            PageMessage::Control(token) => {
                let (key, refused) = match self.board.take_control(self.id, self.address, &token) {
                    Ok(key) => {
                        self.board.note(&format!("the page of {} controls", self.address));
                        (key, None)
                    }
                    Err(refused) => (None, Some(refused)),
                };
                self.controls(refused, key);
            }
            PageMessage::Release(_) => {
                self.board.release(self.id);
                self.controls(None, None);
            }
            // Anybody may stop the arm, in the way that needs no middleware.
            PageMessage::Stop(_) => self.board.stops.ask(self.id, self.address, &self.replies),
            PageMessage::Pen(samples) => samples.into_iter().map(sample).for_each(|one| self.board.pen(one)),
            PageMessage::Hold(held, at_us) => match held_at(held, at_us, now_ns()) {
                Ok(at_ns) => self.board.hold(held, at_ns),
                Err(reason) => self.board.refuse(reason),
            },
            PageMessage::Ask(request, at_us) => self.order(PageAction::Ask(request), Some(at_us)),
            PageMessage::Write(text, at_us) => self.order(PageAction::Write(text), Some(at_us)),
            PageMessage::TakePen(_) => self.order(PageAction::TakePen, None),
            PageMessage::Record(on) => self.order(PageAction::Record(on), None),
        }
    }

    /// `at_us`: when it was asked for, by the page's account; none: now.
    fn order(&mut self, what: PageAction, at_us: Option<f64>) {
        let now_ns = now_ns();
        let asked_ns = match at_us.map_or(Ok(now_ns), |at_us| asked_at(at_us, now_ns)) {
            Ok(asked_ns) => asked_ns,
            Err(_) if matches!(what, PageAction::Ask(OperatorRequest::Disarm(_))) => now_ns,
            Err(reason) => {
                self.board.refuse(reason);
                let words = format!("not carried out: {reason}: the page's clock is wrong; load it again");
                return self.tell(false, words);
            }
        };
        let reply = self.replies.clone();
        if !self.board.order(PageOrder { what, page: self.id, asked_ns, reply }) {
            self.tell(false, "too much is asked for at once: try again".to_owned());
        }
    }

    /// `key`: what opens the control from here on, in place of a token that worked once.
    fn controls(&mut self, refused: Option<ControlDenied>, key: Option<String>) {
        let mine = self.board.controls(self.id);
        let (refused, passing) = refused.map_or((None, false), |denied| (Some(denied.words), denied.passing));
        let control = serde_json::json!({ "mine": mine, "refused": refused, "passing": passing, "key": key });
        self.send(&serde_json::json!({ "control": control }).to_string());
    }

    fn tell(&mut self, done: bool, words: String) {
        self.send(&serde_json::json!({ "reply": PageReply { done, words } }).to_string());
    }
}
