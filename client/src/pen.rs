//! For tablet readers: `PenFeed`.

use std::sync::Arc;

use foretrace_shm::{
    PenSample, PublishError, Publisher, Rejection, ServiceError, Validate, monotonic_now_ns, pen_flags,
};

use crate::Foretrace;
use crate::attach::Leaving;

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
    /// Pressure from 0 to 1, if the device tells.
    pub pressure: Option<f32>,
    /// Tilt towards x and y from the plane's normal \[rad\], if the device tells.
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
}

/// Sends pen readings. One per instance at a time.
#[derive(Debug)]
pub struct PenFeed {
    publisher: Publisher<PenSample>,
    _leaving: Arc<Leaving>,
}

impl Foretrace {
    /// The pen feed, to be used in this thread.
    ///
    /// # Errors
    ///
    /// `NoPlace` when another reader or player feeds already.
    pub fn pen_feed(&self) -> Result<PenFeed, ServiceError> {
        Ok(PenFeed { publisher: self.services.pen.publisher()?, _leaving: self.leaving.clone() })
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
        Ok(self.publisher.publish(monotonic_now_ns(), sample)? > 0)
    }

    /// Readings sent so far.
    pub fn sent(&self) -> u64 {
        self.publisher.sequence()
    }

    /// Whether anybody listens at this moment.
    pub fn is_heard(&self) -> bool {
        self.publisher.subscribers() > 0
    }
}
