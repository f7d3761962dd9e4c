//! `Attachment` of the package: an instance and its daemon; makes the handles, asks, and stops what it has
//! set in motion.

use std::mem::ManuallyDrop;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, Weak};
use std::time::Duration;

use foretrace_client::wire::ControlResponse;
use foretrace_client::{DaemonMark, Foretrace, Instance, RequestError, Requests, Stopped};
use pyo3::prelude::*;

use super::arm::ArmHandle;
use super::dead_man::DeadManHandle;
use super::failure::{FailureKind, LiveFailure};
use super::history::HistoryHandle;
use super::pen::PenHandle;
use super::ports::ArmPortsHandle;
use super::predictor::PredictorHandle;
use super::status::StatusHandle;
use super::watch::WatchHandle;
use super::worker::{Closing, locked, remember, same_process, seconds};

/// For the stop at the end of a block, or of the interpreter.
const STOPPING: Duration = Duration::from_secs(2);

/// An answer of the daemon: status, detail, value, text.
type AnswerParts = (i32, u32, f64, String);

struct Inner {
    /// Not dropped in a child process: what it holds in shared memory is the parent's.
    foretrace: Mutex<ManuallyDrop<Option<Foretrace>>>,
    instance: Instance,
    pid: u32,
    /// The daemon that was asked to move the arm.
    moved: Mutex<Option<DaemonMark>>,
}

impl Inner {
    /// Stops the arm if this attachment set it in motion and the same daemon still runs.
    fn stop_what_moves(&self) -> Result<bool, LiveFailure> {
        if self.pid != std::process::id() {
            return Ok(false);
        }
        let Some(daemon) = locked(&self.moved).take() else { return Ok(false) };
        if self.instance.daemon() != Some(daemon) {
            return Ok(false);
        }
        foretrace_client::stop(&self.instance, STOPPING)?;
        Ok(true)
    }
}

impl Closing for Inner {
    fn close(&self) {
        if self.pid == std::process::id() {
            // At the interpreter's end there is nobody to tell; the arm brakes when commands stay away.
            let _ = self.stop_what_moves();
            drop(locked(&self.foretrace).take());
        }
    }
}

impl Drop for Inner {
    fn drop(&mut self) {
        self.close();
    }
}

/// An instance and its daemon.
#[pyclass(frozen, name = "Attachment", module = "foretrace._native")]
pub struct LiveAttachment(Arc<Inner>);

fn instance_of(number: u32, root: Option<PathBuf>) -> Result<Instance, LiveFailure> {
    Ok(match root {
        None => Instance::new(number)?,
        Some(root) => Instance::at(number, root)?,
    })
}

fn stopped(result: Stopped) -> (Option<u32>, Option<f64>) {
    (result.mode.map(u32::from), result.trust)
}

/// Stops the arm of an instance without attaching: the mode and the trust after it, where they are known.
#[pyfunction]
pub fn stop(
    py: Python<'_>,
    number: u32,
    root: Option<PathBuf>,
    timeout_s: f64,
) -> PyResult<(Option<u32>, Option<f64>)> {
    let (instance, timeout) = (instance_of(number, root)?, seconds("timeout", timeout_s)?);
    let result = py.detach(|| foretrace_client::stop(&instance, timeout));
    Ok(stopped(result.map_err(LiveFailure::from)?))
}

impl LiveAttachment {
    /// Asks with an attachment that is renewed where there is a new daemon.
    fn ask(
        &self,
        py: Python<'_>,
        timeout_s: f64,
        moves: bool,
        ask: impl FnOnce(&mut Requests, Duration) -> Result<ControlResponse, RequestError> + Send,
    ) -> PyResult<AnswerParts> {
        self.ask_at(py, timeout_s, moves, 0, ask)
    }

    fn ask_at(
        &self,
        py: Python<'_>,
        timeout_s: f64,
        moves: bool,
        decided_ns: u64,
        ask: impl FnOnce(&mut Requests, Duration) -> Result<ControlResponse, RequestError> + Send,
    ) -> PyResult<AnswerParts> {
        same_process(self.0.pid, "the attachment")?;
        let timeout = seconds("timeout", timeout_s)?;
        let answer = py.detach(|| -> Result<ControlResponse, LiveFailure> {
            let mut place = locked(&self.0.foretrace);
            let foretrace = place.as_mut().ok_or_else(closed)?;
            foretrace.reattach_if_needed()?;
            let mut requests = foretrace.requests().decided_at(decided_ns);
            let daemon = foretrace.daemon();
            drop(place);
            // Before the answer: a request whose answer is lost may have moved the arm all the same.
            let before = if moves { locked(&self.0.moved).replace(daemon) } else { None };
            let result = ask(&mut requests, timeout);
            if moves && matches!(result, Err(RequestError::Refused { .. } | RequestError::Invalid(_))) {
                *locked(&self.0.moved) = before;
            }
            Ok(result?)
        })?;
        Ok((answer.status, answer.detail, answer.value, answer.text()))
    }

    fn open<T>(&self, open: impl FnOnce(Instance) -> PyResult<T>) -> PyResult<T> {
        same_process(self.0.pid, "the attachment")?;
        if locked(&self.0.foretrace).is_none() {
            return Err(closed().into());
        }
        open(self.0.instance.clone())
    }
}

fn closed() -> LiveFailure {
    LiveFailure::new(FailureKind::Other, "the attachment is closed: attach again")
}

#[pymethods]
impl LiveAttachment {
    #[new]
    fn attach(py: Python<'_>, number: u32, root: Option<PathBuf>, wait_s: f64) -> PyResult<Self> {
        let (instance, wait) = (instance_of(number, root)?, seconds("wait", wait_s)?);
        let deadline = std::time::Instant::now() + wait;
        // In pieces, so that Ctrl-C ends the wait.
        let foretrace = loop {
            let left = deadline.saturating_duration_since(std::time::Instant::now());
            let piece = left.min(Duration::from_millis(200));
            let attached = py.detach(|| Foretrace::attach_within(&instance, piece));
            py.check_signals()?;
            match attached {
                Err(foretrace_client::ServiceError::NoDaemon { .. }) if left > piece => {}
                other => break other.map_err(LiveFailure::from)?,
            }
        };
        let inner = Arc::new(Inner {
            foretrace: Mutex::new(ManuallyDrop::new(Some(foretrace))),
            instance,
            pid: std::process::id(),
            moved: Mutex::new(None),
        });
        let weak: Weak<Inner> = Arc::downgrade(&inner);
        remember(weak);
        Ok(Self(inner))
    }

    #[getter]
    fn number(&self) -> u32 {
        self.0.instance.number()
    }

    #[getter]
    fn root(&self) -> PathBuf {
        self.0.instance.root().to_path_buf()
    }

    fn daemon_is_up(&self) -> bool {
        self.0.instance.daemon().is_some()
    }

    fn pen(&self, py: Python<'_>, name: Option<&str>, take_over_s: Option<f64>) -> PyResult<PenHandle> {
        self.open(|instance| PenHandle::open(py, instance, name, take_over_s))
    }

    fn dead_man(
        &self,
        py: Python<'_>,
        name: Option<&str>,
        take_over_s: Option<f64>,
    ) -> PyResult<DeadManHandle> {
        self.open(|instance| DeadManHandle::open(py, instance, name, take_over_s))
    }

    fn predictor(&self, py: Python<'_>) -> PyResult<PredictorHandle> {
        self.open(|instance| PredictorHandle::open(py, instance))
    }

    fn status(&self, py: Python<'_>) -> PyResult<StatusHandle> {
        self.open(|instance| StatusHandle::open(py, instance))
    }

    fn watch(&self, py: Python<'_>, kind: &str) -> PyResult<WatchHandle> {
        self.open(|instance| WatchHandle::open(py, instance, kind))
    }

    fn history(&self, py: Python<'_>) -> PyResult<HistoryHandle> {
        self.open(|instance| HistoryHandle::open(py, instance))
    }

    fn arm_interface(
        &self,
        py: Python<'_>,
        rate_hz: f64,
        deceleration: f64,
        pause_after_s: f64,
        simulated: bool,
    ) -> PyResult<ArmHandle> {
        self.open(|instance| ArmHandle::open(py, instance, rate_hz, deceleration, pause_after_s, simulated))
    }

    fn settings(&self, py: Python<'_>, timeout_s: f64) -> PyResult<(u64, String)> {
        self.open(|instance| super::settings::settings(py, instance, timeout_s))
    }

    fn arm_ports(&self, py: Python<'_>) -> PyResult<ArmPortsHandle> {
        self.open(|instance| ArmPortsHandle::open(py, instance))
    }

    fn arm(&self, py: Python<'_>, timeout_s: f64, decided_ns: u64) -> PyResult<AnswerParts> {
        self.ask_at(py, timeout_s, true, decided_ns, Requests::arm)
    }

    fn move_home(&self, py: Python<'_>, timeout_s: f64) -> PyResult<AnswerParts> {
        self.ask(py, timeout_s, true, Requests::move_home)
    }

    fn disarm(&self, py: Python<'_>, timeout_s: f64) -> PyResult<AnswerParts> {
        let answer = self.ask(py, timeout_s, false, Requests::disarm)?;
        *locked(&self.0.moved) = None;
        Ok(answer)
    }

    fn query(&self, py: Python<'_>, timeout_s: f64) -> PyResult<AnswerParts> {
        self.ask(py, timeout_s, false, Requests::query)
    }

    fn set_trust(&self, py: Python<'_>, trust: f64, timeout_s: f64) -> PyResult<AnswerParts> {
        self.ask(py, timeout_s, false, |requests, wait| requests.set_trust(trust, wait))
    }

    fn freeze_trust(&self, py: Python<'_>, timeout_s: f64) -> PyResult<AnswerParts> {
        self.ask(py, timeout_s, false, Requests::freeze_trust)
    }

    fn trust_auto(&self, py: Python<'_>, timeout_s: f64) -> PyResult<AnswerParts> {
        self.ask(py, timeout_s, false, Requests::trust_auto)
    }

    fn switch_predictor(&self, py: Python<'_>, name: &str, timeout_s: f64) -> PyResult<AnswerParts> {
        self.ask(py, timeout_s, false, |requests, wait| requests.switch_predictor(name, wait))
    }

    fn reload(&self, py: Python<'_>, timeout_s: f64) -> PyResult<AnswerParts> {
        self.ask(py, timeout_s, false, Requests::reload)
    }

    /// Needs no attachment, and works where every other way is closed.
    fn stop(&self, py: Python<'_>, timeout_s: f64) -> PyResult<(Option<u32>, Option<f64>)> {
        same_process(self.0.pid, "the attachment")?;
        let timeout = seconds("timeout", timeout_s)?;
        let result = py.detach(|| foretrace_client::stop(&self.0.instance, timeout));
        let result = result.map_err(LiveFailure::from)?;
        *locked(&self.0.moved) = None;
        Ok(stopped(result))
    }

    /// Stops the arm if this attachment set it in motion, and leaves the instance; whether it stopped it.
    fn close(&self, py: Python<'_>) -> PyResult<bool> {
        Ok(py.detach(|| {
            let stopped = self.0.stop_what_moves();
            self.0.close();
            stopped
        })?)
    }
}
