//! From readings of a device to the daemon's pen: mapping, repeats at rest, counts.

use std::time::Duration;

use foretrace_client::{Claimant, FeedError, Lasting, PenFeed, PenReading, Place, monotonic_now_ns};
use foretrace_tablet::{Decoded, MappedHand, Rate};
use serde::Serialize;

use crate::attach::follow;
use crate::failure::Failure;
use crate::output::note;
use crate::take_over::handed_over;

/// A pen at rest is sent again after this time: silence means that it is gone.
const REPEAT_NS: u64 = 20_000_000;
/// A repeated reading is stamped this long ago, so that an event which is still on its way stays later
/// than it.
pub(super) const MARGIN: Duration = Duration::from_millis(5);

/// What was sent; keys are stable.
#[derive(Debug, Default, Clone, PartialEq, Serialize)]
pub(super) struct TabletCounts {
    /// Readings of the device.
    pub(super) readings: u64,
    /// Sent again at rest.
    pub(super) repeats: u64,
    /// Sent while no daemon listened.
    pub(super) unheard: u64,
    /// Refused by the checks of a pen sample.
    pub(super) refused: u64,
    /// Came with a stamp that was not later than the one before, and were stamped just after it.
    pub(super) late: u64,
}

/// The feed, and what was sent last.
pub(super) struct Feeding {
    feed: Lasting<PenFeed>,
    who: Claimant,
    pub(super) hand: MappedHand,
    clutch_flag: Option<u32>,
    /// The device's last reading, while its pen is in range.
    last: Option<PenReading>,
    last_ns: u64,
    pub(super) counts: TabletCounts,
    pub(super) rate: Rate,
}

impl Feeding {
    pub(super) fn new(
        feed: Lasting<PenFeed>,
        who: Claimant,
        hand: MappedHand,
        clutch_flag: Option<u32>,
    ) -> Self {
        Self {
            feed,
            who,
            hand,
            clutch_flag,
            last: None,
            last_ns: 0,
            counts: TabletCounts::default(),
            rate: Rate::default(),
        }
    }

    /// Whether a pen is in range, and whether it touches.
    pub(super) fn pen(&self) -> Option<bool> {
        self.last.map(|reading| reading.contact)
    }

    /// Takes what the device reported. `clutched`: the clutch is held by a word.
    ///
    /// # Errors
    ///
    /// Somebody took the pen over.
    pub(super) fn take(&mut self, decoded: Decoded, clutched: bool) -> Result<(), Failure> {
        match decoded {
            Decoded::Reading(reading) => {
                self.rate.take(reading.device_stamp_ns);
                self.counts.readings += 1;
                self.last = Some(reading);
                self.lead(reading, clutched)
            }
            Decoded::Gone { stamp_ns } => self.gone(stamp_ns),
            Decoded::Nothing | Decoded::Lost => Ok(()),
        }
    }

    /// The pen left the range, or its device went.
    pub(super) fn gone(&mut self, stamp_ns: u64) -> Result<(), Failure> {
        match (self.last.take(), self.hand.gone(stamp_ns)) {
            (Some(_), Some(reading)) => self.send(reading),
            _ => Ok(()),
        }
    }

    /// Sends the last reading again, where it is time to.
    pub(super) fn rest(&mut self, clutched: bool) -> Result<(), Failure> {
        let stamp_ns = monotonic_now_ns().saturating_sub(MARGIN.as_nanos() as u64);
        match self.last {
            Some(last) if stamp_ns > self.last_ns.saturating_add(REPEAT_NS) => {
                self.counts.repeats += 1;
                self.lead(PenReading { device_stamp_ns: stamp_ns, ..last }, clutched)
            }
            _ => Ok(()),
        }
    }

    fn lead(&mut self, reading: PenReading, clutched: bool) -> Result<(), Failure> {
        let held = self.clutch_flag.is_some_and(|flag| reading.more_flags & flag != 0);
        let before = self.hand.is_clutched();
        self.hand.clutch(held || clutched);
        if before != self.hand.is_clutched() {
            note!("tablet: {}", if before { "the hand leads" } else { "clutched: the arm stays" });
        }
        let reading = self.hand.map(reading);
        self.send(reading)
    }

    fn send(&mut self, mut reading: PenReading) -> Result<(), Failure> {
        if reading.device_stamp_ns <= self.last_ns {
            self.counts.late += 1;
            reading.device_stamp_ns = self.last_ns + 1;
        }
        self.last_ns = reading.device_stamp_ns;
        match self.feed.handle.as_mut().map(|feed| feed.send(reading)) {
            Some(Ok(true)) => {}
            Some(Ok(false)) | None => self.counts.unheard += 1,
            Some(Err(FeedError::HandedOver)) => return self.still_ours(),
            Some(Err(error)) => {
                if self.counts.refused == 0 {
                    note!("tablet: {error}; counted from here on");
                }
                self.counts.refused += 1;
            }
        }
        Ok(())
    }

    /// Gives way to whoever asks for the pen.
    ///
    /// # Errors
    ///
    /// Somebody did.
    pub(super) fn still_ours(&mut self) -> Result<(), Failure> {
        match self.feed.handle.as_mut().and_then(PenFeed::handed_to) {
            Some(to) => Err(handed_over(Place::Pen, Some(to))),
            None => Ok(()),
        }
    }

    /// Follows the daemon when it goes and comes back.
    pub(super) fn follow(&mut self) {
        let Self { feed, who, .. } = self;
        follow("tablet", "waiting for the next", feed, |foretrace| foretrace.pen_feed_as(who));
    }
}
