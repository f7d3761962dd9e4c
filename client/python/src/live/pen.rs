//! `PenHandle` and `GatewayHandle`: pen samples in, through shared memory or a gateway's socket.

use std::path::PathBuf;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use foretrace_client::{
    Claimant, DaemonChange, FeedError, Foretrace, GatewayFeed, HolderKind, Instance, PenFeed, PenReading,
    monotonic_now_ns,
};
use pyo3::prelude::*;

use super::failure::{FailureKind, LiveFailure};
use super::kept::KeptHandle;
use super::worker::{Closing, HandleWorker, locked, same_process, seconds};

/// Every call on a handle, without what it waits for.
pub const PATIENCE: Duration = Duration::from_secs(6);
/// Between two looks for a new daemon and for whoever asks for the pen.
const LOOK: Duration = Duration::from_millis(100);
/// No pen's stamp is farther from the clock than this, unless it is of another clock \[ns\].
const OTHER_CLOCK_NS: u64 = 1_000_000_000;

/// A sample as Python gives it: stamp \[ns\], x \[m\], y \[m\], contact, pressure, tilt \[rad\], flags.
type GivenSample = (u64, f64, f64, bool, Option<f32>, Option<[f32; 2]>, u32);

fn readings(samples: Vec<GivenSample>) -> Vec<PenReading> {
    let reading = |sample: GivenSample| {
        let (device_stamp_ns, x_m, y_m, contact, pressure, tilt_rad, more_flags) = sample;
        PenReading { device_stamp_ns, x_m, y_m, contact, pressure, tilt_rad, more_flags }
    };
    samples.into_iter().map(reading).collect()
}

/// Refuses stamps of another clock; what is closer is for the daemon to judge.
fn of_this_clock(reading: &PenReading) -> Result<(), LiveFailure> {
    let (stamp_ns, now_ns) = (reading.device_stamp_ns, monotonic_now_ns());
    if stamp_ns.abs_diff(now_ns) <= OTHER_CLOCK_NS {
        return Ok(());
    }
    Err(other_clock(stamp_ns, now_ns))
}

/// Names how far a stamp lies from the clock.
pub fn other_clock(stamp_ns: u64, now_ns: u64) -> LiveFailure {
    let far_s = stamp_ns.abs_diff(now_ns) as f64 * 1e-9;
    let side = if stamp_ns > now_ns { "in the future" } else { "old" };
    LiveFailure::invalid(format!(
        "stamp = {stamp_ns} ns is {far_s:.3} s {side}, allowed 1 s: stamps are those of time.monotonic_ns(), \
         not of time.time_ns() or of a device"
    ))
}

/// Sends readings in order. Ends with the first that fails: its number and why.
fn send_all(
    readings: &[PenReading],
    mut send: impl FnMut(PenReading) -> Result<bool, LiveFailure>,
) -> (u64, u64, Option<LiveFailure>) {
    let (mut sent, mut heard) = (0, 0);
    for reading in readings {
        match of_this_clock(reading).and_then(|()| send(*reading)) {
            Ok(true) => (sent, heard) = (sent + 1, heard + 1),
            Ok(false) => sent += 1,
            Err(failure) => return (sent, heard, Some(failure)),
        }
    }
    (sent, heard, None)
}

/// What sending came to: how many were sent, how many of them were heard, and the exception that ended it.
type SendOutcome = (u64, u64, Option<Py<PyAny>>);

fn outcome(py: Python<'_>, result: (u64, u64, Option<LiveFailure>)) -> SendOutcome {
    let (sent, heard, failure) = result;
    (sent, heard, failure.map(|failure| PyErr::from(failure).into_value(py).into_any()))
}

/// A pen that outlives the daemon.
struct LastingPen {
    pen: KeptHandle<PenFeed>,
    who: Claimant,
    /// A killed daemon stays connected; only a look finds that it is gone.
    gone: bool,
}

impl LastingPen {
    fn look(&mut self) {
        match self.pen.look(|foretrace| foretrace.pen_feed_as(&self.who)) {
            DaemonChange::None => {}
            DaemonChange::Gone => self.gone = true,
            DaemonChange::Back | DaemonChange::Renewed => self.gone = false,
        }
    }
}

/// Feeds the pen of an instance from any Python thread.
#[pyclass(frozen, module = "foretrace._native")]
pub struct PenHandle {
    worker: Arc<HandleWorker<LastingPen>>,
}

fn claimant(name: Option<&str>) -> Claimant {
    Claimant::new(HolderKind::Program, name.unwrap_or("python"))
}

fn handed_over(feed: &mut PenFeed) -> LiveFailure {
    let who = feed.handed_to().map_or_else(|| "another program".to_owned(), ToString::to_string);
    LiveFailure::new(
        FailureKind::Taken,
        format!("the pen was handed to {who}, which asked for it: end this one"),
    )
}

impl PenHandle {
    pub fn open(
        py: Python<'_>,
        instance: Instance,
        name: Option<&str>,
        take_over_s: Option<f64>,
    ) -> PyResult<Self> {
        let who = claimant(name);
        let patience = take_over_s.map(|patience| seconds("take_over", patience)).transpose()?;
        let open = move || -> Result<LastingPen, LiveFailure> {
            let foretrace = Foretrace::attach_within(&instance, Duration::ZERO)?;
            let feed = match patience {
                None => foretrace.pen_feed_as(&who)?,
                Some(patience) => foretrace.take_pen_feed(&who, patience)?,
            };
            Ok(LastingPen { pen: KeptHandle::new(foretrace, feed), who, gone: false })
        };
        let idle = |pen: &mut LastingPen| {
            let handed = pen.pen.handle().is_some_and(|feed| feed.handed_to().is_some());
            if !handed {
                pen.look();
            }
        };
        let opening = PATIENCE + patience.unwrap_or_default();
        Ok(Self { worker: HandleWorker::start(py, "the pen", LOOK, opening, open, idle)? })
    }
}

#[pymethods]
impl PenHandle {
    fn send(&self, py: Python<'_>, samples: Vec<GivenSample>) -> PyResult<SendOutcome> {
        let readings = readings(samples);
        let job = move |pen: &mut LastingPen| {
            pen.look();
            let LastingPen { pen, gone, .. } = pen;
            let feed = match pen.open("the pen") {
                Ok(feed) => feed,
                Err(failure) => return (0, 0, Some(failure)),
            };
            send_all(&readings, |reading| match feed.send(reading) {
                Ok(heard) => Ok(heard && !*gone),
                Err(FeedError::HandedOver) => Err(handed_over(feed)),
                Err(error) => Err(error.into()),
            })
        };
        let result = self.worker.call(py, PATIENCE, job)?;
        Ok(outcome(py, result))
    }

    fn handed_to(&self, py: Python<'_>) -> PyResult<Option<String>> {
        self.worker.call(py, PATIENCE, |pen| {
            pen.pen.handle().and_then(|feed| feed.handed_to().map(ToString::to_string))
        })
    }

    fn close(&self, py: Python<'_>) {
        py.detach(|| self.worker.close());
    }
}

/// Feeds the pen through the socket of `foretrace gateway`.
#[pyclass(frozen, module = "foretrace._native")]
pub struct GatewayHandle {
    feed: Mutex<Option<GatewayFeed>>,
    pid: u32,
}

#[pymethods]
impl GatewayHandle {
    #[new]
    fn connect(py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        let feed = py.detach(|| GatewayFeed::connect(path)).map_err(LiveFailure::from)?;
        Ok(Self { feed: Mutex::new(Some(feed)), pid: std::process::id() })
    }

    fn send(&self, py: Python<'_>, samples: Vec<GivenSample>) -> PyResult<SendOutcome> {
        same_process(self.pid, "the gateway")?;
        let readings = readings(samples);
        let result = py.detach(|| {
            let mut place = locked(&self.feed);
            let Some(feed) = place.as_mut() else {
                let failure = LiveFailure::new(FailureKind::NoDaemon, "the gateway is closed: connect again");
                return (0, 0, Some(failure));
            };
            let mut over = false;
            let result = send_all(&readings, |reading| match feed.send(reading) {
                Ok(()) => Ok(true),
                Err(error) => {
                    over = !matches!(error, foretrace_client::GatewayError::Invalid(_));
                    Err(error.into())
                }
            });
            if over {
                *place = None;
            }
            result
        });
        Ok(outcome(py, result))
    }

    /// Ends the connection; the gateway's last line, or none if it was over before.
    fn close(&self, py: Python<'_>) -> PyResult<Option<String>> {
        same_process(self.pid, "the gateway")?;
        let finished = py.detach(|| locked(&self.feed).take().map(GatewayFeed::finish));
        Ok(finished.transpose().map_err(LiveFailure::from)?)
    }
}
