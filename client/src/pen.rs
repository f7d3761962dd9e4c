//! For tablet readers: `PenFeed`.

use std::time::Duration;

use foretrace_shm::{
    Claimant, Holder, PenSample, Place, PublishError, Rejection, ServiceError, Validate, monotonic_now_ns,
    pen_flags,
};

use crate::Foretrace;
use crate::seat::Seat;

/// One reading of the pen, in metres in the device's plane.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct PenReading {
    /// When the pen was there \[ns\], on the clock of `monotonic_now_ns()`.
    pub device_stamp_ns: u64,
    /// Position \[m\], to the right.
    pub x_m: f64,
    /// Position \[m\], away from the writer.
    pub y_m: f64,
    /// The pen touches the surface.
    pub contact: bool,
    /// Pressure from 0 to 1, if the device reports it.
    pub pressure: Option<f32>,
    /// Tilt towards x and y from the plane's normal \[rad\], if the device reports it.
    pub tilt_rad: Option<[f32; 2]>,
    /// Further [`pen_flags`]; `CONTACT` and `IN_RANGE` are set from `contact`.
    pub more_flags: u32,
}

impl PenReading {
    /// The same reading as a sample, without a header.
    pub(crate) fn sample(&self) -> PenSample {
        let [tilt_x_rad, tilt_y_rad] = self.tilt_rad.unwrap_or_default();
        let touch = if self.contact { pen_flags::CONTACT | pen_flags::IN_RANGE } else { 0 };
        PenSample {
            device_stamp_ns: self.device_stamp_ns,
            x_m: self.x_m,
            y_m: self.y_m,
            pressure: self.pressure.unwrap_or(-1.0),
            tilt_x_rad,
            tilt_y_rad,
            flags: self.more_flags | touch,
            ..Default::default()
        }
    }
}

/// Why a reading was not sent.
#[derive(Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum FeedError {
    /// The daemon would refuse it.
    #[error("the pen reading is invalid: {0}")]
    Invalid(#[from] Rejection),
    /// It could not be delivered.
    #[error("the pen reading was not sent: {0}")]
    NotSent(#[from] PublishError),
    /// Somebody asked for the pen and has it; [`PenFeed::handed_to`] says who.
    #[error("the pen was handed to a program that asked for it (--take-over): end this one")]
    HandedOver,
}

/// Sends pen readings. One per instance at a time; gives way to whoever asks for the pen.
#[derive(Debug)]
pub struct PenFeed(Seat<PenSample>);

impl Foretrace {
    /// The pen feed, to be used in this thread. Held in the name of this program.
    ///
    /// # Errors
    ///
    /// `Place` when another reader or player feeds already: it names that one.
    pub fn pen_feed(&self) -> Result<PenFeed, ServiceError> {
        self.pen_feed_as(&Claimant::this_program())
    }

    /// The pen feed, held in the name of `who`.
    ///
    /// # Errors
    ///
    /// As [`Foretrace::pen_feed`].
    pub fn pen_feed_as(&self, who: &Claimant) -> Result<PenFeed, ServiceError> {
        let claim = self.instance().claim(Place::Pen, who)?;
        Seat::take(claim, &self.services.pen, self.leaving.clone()).map(PenFeed)
    }

    /// The pen feed, for which the program that holds it is asked; waits for that up to `patience`.
    ///
    /// # Errors
    ///
    /// `Place` when it does not give way.
    pub fn take_pen_feed(&self, who: &Claimant, patience: Duration) -> Result<PenFeed, ServiceError> {
        let claim = self.instance().take_over(Place::Pen, who, patience)?;
        Seat::take(claim, &self.services.pen, self.leaving.clone()).map(PenFeed)
    }
}

impl PenFeed {
    /// Send one reading. Readings must come in the order of their stamps. Returns whether the daemon was
    /// connected.
    ///
    /// # Errors
    ///
    /// See [`FeedError`]; nothing is sent then.
    pub fn send(&mut self, reading: PenReading) -> Result<bool, FeedError> {
        self.send_sample(reading.sample())
    }

    /// Send a sample as it stands; its header is filled in.
    ///
    /// # Errors
    ///
    /// As [`PenFeed::send`].
    pub fn send_sample(&mut self, sample: PenSample) -> Result<bool, FeedError> {
        sample.validate()?;
        let now_ns = monotonic_now_ns();
        self.0.give_way_if_asked(now_ns);
        let publisher = self.0.publisher().ok_or(FeedError::HandedOver)?;
        Ok(publisher.publish(now_ns, sample)? > 0)
    }

    /// Gives way to whoever asks, and returns who has the pen since then. Every reading sent does the same:
    /// call it while nothing is sent.
    pub fn handed_to(&mut self) -> Option<&Holder> {
        self.0.give_way_if_asked(monotonic_now_ns());
        self.0.handed_to()
    }

    /// Readings sent so far.
    pub fn sent(&self) -> u64 {
        self.0.sent()
    }
}
