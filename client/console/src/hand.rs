//! The pen and the hold-to-run button, in the name of the page that controls.
//!
//! Contract: the slots of pen and dead-man switch are taken when they are needed, in the browser's name, and
//! given back with the control. Samples go through the gateway's admission; those that do not go on are
//! counted by reason. A button that is let go says stop.

use std::sync::Arc;
use std::time::{Duration, Instant};

use foretrace_client::{
    Claimant, DeadMan, DeadManError, FeedError, Foretrace, HolderKind, PenFeed, PenReading, PenSample,
};
use foretrace_serve::admission::Admission;

use crate::board::{ConsoleBoard, now_ns};
use crate::hold::{ButtonStep, Grip};

/// Between two attempts to get the pen.
const AGAIN: Duration = Duration::from_millis(500);
/// How long a holder has to give the pen up.
const PATIENCE: Duration = Duration::from_secs(2);
/// The gateway's bounds: samples per second in the long run, and at once.
const RATE: u32 = 2000;
const BURST: u32 = 400;

/// The pen and the hold-to-run button, in the name of the page that controls.
pub(crate) struct BrowserHand {
    pub(crate) board: Arc<ConsoleBoard>,
    admission: Admission,
    pub(crate) feed: Option<PenFeed>,
    dead_man: Option<DeadMan>,
    pub(crate) grip: Grip,
    next_pen: Instant,
    pub(crate) pen_note: Option<String>,
    pub(crate) hold_note: Option<String>,
}

impl BrowserHand {
    pub(crate) fn new(board: Arc<ConsoleBoard>) -> Self {
        let now = Instant::now();
        Self {
            board,
            admission: Admission::new(RATE, BURST, now_ns()),
            feed: None,
            dead_man: None,
            grip: Grip::default(),
            next_pen: now,
            pen_note: None,
            hold_note: None,
        }
    }

    fn who(&self) -> Claimant {
        Claimant::new(HolderKind::Browser, &self.board.controller().unwrap_or_else(|| "console".to_owned()))
    }

    /// A sample of the page that controls.
    pub(crate) fn pen(&mut self, foretrace: &Foretrace, sample: &PenSample) {
        let refusal = match self.admission.judge(sample, now_ns()) {
            Ok(()) if self.feed.is_none() && Instant::now() < self.next_pen => Some("the pen is held"),
            Ok(()) if self.feed.is_none() && self.claim(foretrace).is_err() => Some("the pen is held"),
            Ok(()) => None,
            Err(refusal) => Some(refusal.label()),
        };
        if let Some(label) = refusal {
            return self.refused(label);
        }
        match self.feed.as_mut().map(|feed| feed.send_sample(*sample)) {
            Some(Ok(_)) => self.board.count(|tally| tally.samples += 1),
            Some(Err(FeedError::HandedOver)) => self.handed_over(),
            Some(Err(_)) | None => {
                self.refused("not sent");
            }
        }
    }

    pub(crate) fn refused(&self, label: &'static str) {
        self.board.count(|tally| *tally.samples_refused.entry(label).or_default() += 1);
    }

    /// A reading of the writer; `false`: the pen is gone.
    pub(crate) fn send(&mut self, reading: PenReading) -> bool {
        match self.feed.as_mut().map(|feed| feed.send(reading)) {
            Some(Err(FeedError::HandedOver)) | None => {
                self.handed_over();
                false
            }
            Some(_) => true,
        }
    }

    pub(crate) fn claim(&mut self, foretrace: &Foretrace) -> Result<(), String> {
        if self.feed.is_none() {
            self.next_pen = Instant::now() + AGAIN;
            match foretrace.pen_feed_as(&self.who()) {
                Ok(feed) => (self.feed, self.pen_note) = (Some(feed), None),
                Err(error) => {
                    self.pen_note = Some(error.to_string());
                    return Err(error.to_string());
                }
            }
        }
        Ok(())
    }

    pub(crate) fn take_over(&mut self, foretrace: &Foretrace) -> Result<String, String> {
        if self.feed.is_some() {
            return Ok("this page has the pen already".to_owned());
        }
        match foretrace.take_pen_feed(&self.who(), PATIENCE) {
            Ok(feed) => {
                (self.feed, self.pen_note) = (Some(feed), None);
                Ok("this page has the pen".to_owned())
            }
            Err(error) => Err(error.to_string()),
        }
    }

    fn handed_over(&mut self) {
        let to = self.feed.as_mut().and_then(|feed| feed.handed_to().map(ToString::to_string));
        if let Some(to) = to {
            self.board.note(&format!("the pen was handed to {to}"));
            self.pen_note = Some(format!("the pen was handed to {to}, which asked for it"));
        }
        self.feed = None;
        // Whoever asked gets the time to take it.
        self.next_pen = Instant::now() + PATIENCE;
    }

    pub(crate) fn go_on(&mut self, foretrace: &Foretrace, now: u64) {
        if self.board.controller().is_none() {
            self.let_go();
            self.grip = Grip::default();
            return;
        }
        if self.feed.as_mut().is_some_and(|feed| feed.handed_to().is_some()) {
            self.handed_over();
        }
        self.button(foretrace, self.board.is_held(now), now);
    }

    fn button(&mut self, foretrace: &Foretrace, held: bool, now: u64) {
        let mut step = self.grip.look(held, self.dead_man.is_some(), now);
        if step == ButtonStep::Claim {
            match foretrace.dead_man_as(&self.who()) {
                Ok(dead_man) => (self.dead_man, self.hold_note) = (Some(dead_man), None),
                Err(error) => self.hold_note = Some(error.to_string()),
            }
            step = self.grip.claimed(self.dead_man.is_some(), now);
        }
        let Some(dead_man) = &mut self.dead_man else { return };
        let sent = match step {
            ButtonStep::Beat => dead_man.beat(),
            // Silence stops as well.
            ButtonStep::Stop => dead_man.stop(),
            ButtonStep::GiveBack => {
                self.dead_man = None;
                return;
            }
            ButtonStep::Nothing | ButtonStep::Claim => match dead_man.handed_to() {
                Some(_) => Err(DeadManError::HandedOver),
                None => Ok(()),
            },
        };
        if let Err(error) = sent {
            self.hold_note = Some(error.to_string());
            self.dead_man = None;
        }
    }

    /// Gives pen and button back; a button that was held says stop.
    pub(crate) fn let_go(&mut self) {
        if let (true, Some(dead_man)) = (self.grip.is_held(), &mut self.dead_man) {
            let _ = dead_man.stop();
        }
        (self.feed, self.dead_man) = (None, None);
        (self.pen_note, self.hold_note) = (None, None);
    }
}
