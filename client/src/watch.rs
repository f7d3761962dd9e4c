//! For observers: `Telemetry` (every tick), `StatusReader` (ten times per second), `PenWatch` (every pen
//! sample), `JointWatch` (every joint state).

use std::sync::Arc;
use std::time::{Duration, Instant};

use foretrace_shm::{
    HeaderBounds, JointState, Message, PenSample, Rejections, ServiceError, Status, Subscriber, TickRecord,
    monotonic_now_ns,
};

use crate::Foretrace;
use crate::attach::Leaving;

/// Receives the records of ticks.
#[derive(Debug)]
pub struct Telemetry {
    subscriber: Subscriber<TickRecord>,
    _leaving: Arc<Leaving>,
}

/// Receives the daemon's status.
#[derive(Debug)]
pub struct StatusReader {
    subscriber: Subscriber<Status>,
    newest: Option<Status>,
    _leaving: Arc<Leaving>,
}

/// Receives the pen samples that the daemon receives too.
#[derive(Debug)]
pub struct PenWatch {
    subscriber: Subscriber<PenSample>,
    _leaving: Arc<Leaving>,
}

/// Receives the joint states that the daemon receives too.
#[derive(Debug)]
pub struct JointWatch {
    subscriber: Subscriber<JointState>,
    _leaving: Arc<Leaving>,
}

impl Foretrace {
    /// The joint states from now on, to be used in this thread. 256 are kept unread: at 500 Hz, drain at
    /// least twice per second.
    ///
    /// # Errors
    ///
    /// `NoPlace` when three others watch the arm already.
    pub fn joint_watch(&self) -> Result<JointWatch, ServiceError> {
        let buffer = JointState::QOS.buffer;
        Ok(JointWatch {
            subscriber: self.services.joint_state.subscriber(buffer, HeaderBounds::DEFAULT)?,
            _leaving: self.leaving.clone(),
        })
    }

    /// The pen samples from now on, to be used in this thread. 256 are kept unread: at 200 Hz, drain at least
    /// once per second.
    ///
    /// # Errors
    ///
    /// `NoPlace` when three others watch the pen already.
    pub fn pen_watch(&self) -> Result<PenWatch, ServiceError> {
        let buffer = PenSample::QOS.buffer;
        Ok(PenWatch {
            subscriber: self.services.pen.subscriber(buffer, HeaderBounds::DEFAULT)?,
            _leaving: self.leaving.clone(),
        })
    }

    /// The tick records from now on, to be used in this thread. 256 are kept unread: at 500 Hz, drain at
    /// least twice per second.
    ///
    /// # Errors
    ///
    /// `NoPlace` when three others observe already.
    pub fn telemetry(&self) -> Result<Telemetry, ServiceError> {
        let buffer = TickRecord::QOS.buffer;
        Ok(Telemetry {
            subscriber: self.services.telemetry.subscriber(buffer, HeaderBounds::DEFAULT)?,
            _leaving: self.leaving.clone(),
        })
    }

    /// The status, to be used in this thread.
    ///
    /// # Errors
    ///
    /// `NoPlace`.
    pub fn status(&self) -> Result<StatusReader, ServiceError> {
        let buffer = Status::QOS.buffer;
        Ok(StatusReader {
            subscriber: self.services.status.subscriber(buffer, HeaderBounds::DEFAULT)?,
            newest: None,
            _leaving: self.leaving.clone(),
        })
    }
}

impl Telemetry {
    /// Every unread record, oldest first. Returns how many there were.
    pub fn drain(&mut self, mut use_record: impl FnMut(&TickRecord)) -> usize {
        self.subscriber.drain(monotonic_now_ns(), |record| use_record(&record))
    }

    /// Records lost so far between the daemon's publisher and here. Records the daemon itself had to drop are
    /// counted in `TickRecord::counters.telemetry_ring_dropped`.
    pub fn lost(&self) -> u64 {
        self.subscriber.dropped()
    }

    /// Records refused, by reason.
    pub fn rejections(&self) -> &Rejections {
        self.subscriber.rejections()
    }

    /// How often another daemon took over.
    pub fn restarts(&self) -> u64 {
        self.subscriber.restarts()
    }
}

impl PenWatch {
    /// Every unread sample, oldest first. Returns how many there were.
    pub fn drain(&mut self, mut use_sample: impl FnMut(&PenSample)) -> usize {
        self.subscriber.drain(monotonic_now_ns(), |sample| use_sample(&sample))
    }

    /// Samples lost so far between the pen's publisher and here.
    pub fn lost(&self) -> u64 {
        self.subscriber.dropped()
    }

    /// Samples refused, by reason.
    pub fn rejections(&self) -> &Rejections {
        self.subscriber.rejections()
    }
}

impl JointWatch {
    /// Every unread state, oldest first. Returns how many there were.
    pub fn drain(&mut self, mut use_state: impl FnMut(&JointState)) -> usize {
        self.subscriber.drain(monotonic_now_ns(), |state| use_state(&state))
    }

    /// States lost so far between the arm's publisher and here.
    pub fn lost(&self) -> u64 {
        self.subscriber.dropped()
    }

    /// States refused, by reason.
    pub fn rejections(&self) -> &Rejections {
        self.subscriber.rejections()
    }
}

impl StatusReader {
    /// The newest status received, unread or not.
    pub fn latest(&mut self) -> Option<&Status> {
        if let Some(status) = self.subscriber.latest(monotonic_now_ns()) {
            self.newest = Some(status);
        }
        self.newest.as_ref()
    }

    /// Wait for the next unread status; `None` when none came in time.
    pub fn next_within(&mut self, timeout: Duration) -> Option<Status> {
        let deadline = Instant::now() + timeout;
        loop {
            if let Some(status) = self.subscriber.latest(monotonic_now_ns()) {
                self.newest = Some(status);
                return Some(status);
            }
            if Instant::now() >= deadline {
                return None;
            }
            std::thread::sleep(Duration::from_millis(2));
        }
    }

    /// Age of the newest status; more than a second means that the daemon is gone or stuck.
    pub fn age(&self) -> Option<Duration> {
        self.newest.map(|status| Duration::from_nanos(status.header.age_ns(monotonic_now_ns())))
    }
}
