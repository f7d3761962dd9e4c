//! The thread that feeds the daemon and hears it: pages' samples and orders, the built-in writer, telemetry
//! and status.
//!
//! Contract: it outlives the daemon. Nothing that a page sends makes it wait, but a request to take the pen
//! over, which waits for its holder for a bounded time.

use std::sync::Arc;
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::time::{Duration, Instant};

use foretrace_client::wire::pen_flags;
use foretrace_client::{
    Attachment, Foretrace, Instance, PenReading, PenSample, Place, ServiceError, StatusReader, Telemetry,
};
use foretrace_config::Config;

use crate::board::{ConsoleBoard, PageAction, PageOrder, now_ns};
use crate::frame::{PageFrames, Remedy};
use crate::hand::BrowserHand;
use crate::orders::Asks;
use crate::scene::scene;

/// Longest wait for a sample, and so between two looks at everything else.
const LOOK_EVERY: Duration = Duration::from_millis(4);
/// Thirty frames per second.
const FRAME_EVERY: Duration = Duration::from_millis(33);
/// Between two attempts to get a daemon.
const AGAIN: Duration = Duration::from_millis(500);

/// Why a console has no link.
#[derive(thiserror::Error)]
pub enum LinkError {
    /// The daemon cannot be attached to.
    #[error(transparent)]
    Service(#[from] ServiceError),
    /// A thread cannot be started.
    #[error("no thread can be started: {0}: raise `ulimit -u`")]
    Thread(std::io::Error),
}

foretrace_serve::debug_as_display!(LinkError);

/// A point of the built-in writer: seconds from the begin, x and y \[m\], contact.
pub type WriterPoint = (f64, f64, f64, bool);

/// The path of a text by the built-in writer, or why there is none.
pub type TextWriter = Box<dyn Fn(&str) -> Result<Vec<WriterPoint>, String> + Send>;

/// Records what the daemon sees and does, for pages that ask for it. No call may wait for the disk.
pub trait Records: Send {
    /// Begins a recording; in words, where.
    ///
    /// # Errors
    ///
    /// Why not, in words.
    fn begin(&mut self) -> Result<String, String>;

    /// Ends the one under way.
    ///
    /// # Errors
    ///
    /// There is none.
    fn end(&mut self) -> Result<String, String>;

    /// What a page is shown: `on`, `ending`, `path`, `seconds`, `bytes`, `lost`, `figures`, `failed`.
    fn shown(&self) -> serde_json::Value;
}

/// What the link needs to know, and to be told.
pub struct DaemonLink {
    pub instance: Instance,
    pub config: Config,
    /// The path of a text, by the built-in writer.
    pub writer: TextWriter,
    /// What to do about a stop.
    pub remedy: Box<Remedy>,
    /// For the record button.
    pub recordings: Box<dyn Records>,
}

/// The pages' side of the link.
pub(crate) struct PageInbox {
    pub(crate) pens: Receiver<PenSample>,
    pub(crate) orders: Receiver<PageOrder>,
}

impl DaemonLink {
    /// Serves the pages of `board` until it is over.
    pub(crate) fn run(self, board: &Arc<ConsoleBoard>, inbox: &PageInbox) -> Result<(), LinkError> {
        let foretrace = Foretrace::attach_within(&self.instance, Duration::ZERO)?;
        board.show_scene(serde_json::json!({ "scene": scene(&self.config) }).to_string().into());
        let mut running = RunningLink {
            telemetry: foretrace.telemetry()?,
            status: foretrace.status()?,
            frames: PageFrames::new(self.config.clone()),
            hand: BrowserHand::new(board.clone()),
            asks: Asks::start(&self.instance, board)?.map_err(LinkError::Thread)?,
            foretrace,
            link: self,
            daemon: true,
            writing: None,
        };
        let (mut looked, mut shown) = (Instant::now(), Instant::now());
        while !board.is_over() {
            match inbox.pens.recv_timeout(LOOK_EVERY) {
                Ok(sample) => {
                    running.pen(&sample);
                    while let Ok(sample) = inbox.pens.try_recv() {
                        running.pen(&sample);
                    }
                }
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => break,
            }
            while let Ok(order) = inbox.orders.try_recv() {
                running.carry_out(order);
            }
            running.go_on();
            if looked.elapsed() >= AGAIN {
                looked = Instant::now();
                running.follow();
            }
            if shown.elapsed() >= FRAME_EVERY {
                shown = Instant::now();
                running.show();
            }
        }
        running.hand.let_go();
        Ok(())
    }
}

/// The link at work.
struct RunningLink {
    link: DaemonLink,
    foretrace: Foretrace,
    telemetry: Telemetry,
    status: StatusReader,
    frames: PageFrames,
    hand: BrowserHand,
    asks: Asks,
    daemon: bool,
    writing: Option<WriterRun>,
}

/// A text that is being written.
struct WriterRun {
    points: Vec<WriterPoint>,
    next: usize,
    asked_ns: u64,
    begin_ns: u64,
}

impl RunningLink {
    fn pen(&mut self, sample: &PenSample) {
        if self.writing.is_some() {
            self.hand.refused("the writer writes");
        } else {
            self.hand.pen(&self.foretrace, sample);
        }
    }

    fn carry_out(&mut self, order: PageOrder) {
        let board = &self.hand.board;
        if let Err(reason) = order.judge(board, now_ns()) {
            return order.refuse(board, reason);
        }
        let done = match &order.what {
            PageAction::Ask(_) => return self.asks.pass(order, board),
            PageAction::Write(text) => self.write(text, order.asked_ns),
            PageAction::TakePen => self.hand.take_over(&self.foretrace),
            PageAction::Record(true) => self.link.recordings.begin(),
            PageAction::Record(false) => self.link.recordings.end(),
        };
        // The page may be gone.
        let _ = order.reply.send(done.into());
    }

    fn write(&mut self, text: &str, asked_ns: u64) -> Result<String, String> {
        if self.writing.is_some() {
            return Err("the writer is at work: wait until it has finished".to_owned());
        }
        let points = (self.link.writer)(text)?;
        self.hand.claim(&self.foretrace)?;
        let seconds = points.last().map_or(0.0, |(at, ..)| *at);
        // The loop gets a moment to hear the pen before it writes.
        self.writing = Some(WriterRun { points, next: 0, asked_ns, begin_ns: now_ns() + 50_000_000 });
        Ok(format!("the writer writes for {seconds:.0} s"))
    }

    /// Everything that time asks for.
    fn go_on(&mut self) {
        let now = now_ns();
        if let Some(writing) = &mut self.writing {
            // A text must not go on by itself after an arm was stopped and armed again.
            let stopped = self.hand.board.stops.last_ns() >= writing.asked_ns;
            let mut over = stopped || self.hand.feed.is_none();
            while let Some((at_s, x_m, y_m, contact)) = writing.points.get(writing.next).copied() {
                let due = writing.begin_ns + (at_s * 1e9) as u64;
                if over || due > now {
                    break;
                }
                writing.next += 1;
                let (device_stamp_ns, more_flags) = (due, pen_flags::IN_RANGE);
                let at =
                    PenReading { device_stamp_ns, x_m, y_m, contact, more_flags, ..PenReading::default() };
                over |= !self.hand.send(at);
            }
            if over || writing.next >= writing.points.len() {
                self.writing = None;
            }
        }
        self.hand.go_on(&self.foretrace, now);
        let frames = &mut self.frames;
        self.telemetry.drain(|record| frames.take(record));
        self.status.latest();
    }

    /// Follows the daemon when it goes and comes back.
    fn follow(&mut self) {
        match self.foretrace.reattach_if_needed() {
            Ok(Attachment::Unchanged) => self.daemon = true,
            Ok(found) => {
                self.daemon = true;
                self.frames.restart();
                self.hand.grip.wait_for_release();
                if found == Attachment::Renewed {
                    // The old handles hold the slots that the new ones need.
                    self.hand.let_go();
                    let renewed = self.foretrace.telemetry().and_then(|telemetry| {
                        (self.telemetry, self.status) = (telemetry, self.foretrace.status()?);
                        Ok(())
                    });
                    if let Err(error) = renewed {
                        self.hand.board.note(&error.to_string());
                    }
                }
            }
            Err(_) => self.daemon = false,
        }
    }

    fn show(&mut self) {
        let hand = &self.hand;
        let holder = |place| self.link.instance.holder(place).map(|holder| holder.to_string());
        let here = serde_json::json!({
            "daemon": self.daemon,
            "pen": holder(Place::Pen),
            "dead_man": holder(Place::DeadMan),
            "held": hand.board.is_held(now_ns()),
            "controller": hand.board.controller(),
            // Why the page's pen is not passed on, and why its hold-to-run button does nothing.
            "pen_note": hand.pen_note,
            "hold_note": hand.hold_note,
            "writing": self.writing.is_some(),
            "samples": hand.board.tally().samples,
            "recording": self.link.recordings.shown(),
        });
        let status = self.status.latest().copied();
        let frame = self.frames.frame(status.as_ref(), here, &*self.link.remedy);
        hand.board.show(frame.to_string().into());
    }
}

/// Room between the pages and the link.
pub(crate) fn channels() -> (SyncSender<PenSample>, SyncSender<PageOrder>, PageInbox) {
    let ((pen, pens), (order, orders)) = (sync_channel(1024), sync_channel(16));
    (pen, order, PageInbox { pens, orders })
}
