//! `Attachment` of the package: an instance and its daemon; makes the handles, asks, and stops what it has
//! set in motion.

use std::mem::ManuallyDrop;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, MutexGuard, TryLockError, Weak};
use std::time::{Duration, Instant};

use foretrace_client::wire::ControlResponse;
use foretrace_client::{DaemonMark, Foretrace, Instance, JOINTS, RequestError, Requests, Stopped};
use pyo3::prelude::*;

use super::arm::ArmHandle;
use super::dead_man::DeadManHandle;
use super::failure::{FailureKind, LiveFailure};
use super::history::HistoryHandle;
use super::pen::{PATIENCE, PenHandle};
use super::ports::ArmPortsHandle;
use super::predictor::PredictorHandle;
use super::status::StatusHandle;
use super::watch::WatchHandle;
use super::worker::{Closing, in_a_thread, locked, remember, same_process, seconds};

/// For the stop at the end of a block, or of the interpreter.
const STOPPING: Duration = Duration::from_secs(2);
/// Between two looks whether another request that moves the arm is over.
const TURN: Duration = Duration::from_millis(2);

/// An answer of the daemon: status, detail, value, text.
type AnswerParts = (i32, u32, f64, String);

/// What this attachment has asked to move.
#[derive(Default)]
struct MotionMark {
    /// The daemon that was asked to move the arm.
    daemon: Option<DaemonMark>,
    /// Requests that set the mark so far.
    asked: u64,
}

struct Inner {
    /// Not dropped in a child process: what it holds in shared memory is the parent's.
    foretrace: Mutex<ManuallyDrop<Option<Foretrace>>>,
    instance: Instance,
    pid: u32,
    moved: Mutex<MotionMark>,
    /// Held by one request that moves the arm, from its mark until it is known whether the mark stays.
    moving: Mutex<()>,
}

impl Inner {
    /// Stops the arm if this attachment set it in motion and the same daemon still runs. After a stop that
    /// failed, the next call tries again.
    fn stop_what_moves(&self) -> Result<bool, LiveFailure> {
        if self.pid != std::process::id() {
            return Ok(false);
        }
        let Some(daemon) = locked(&self.moved).daemon.take() else { return Ok(false) };
        if self.instance.daemon() != Some(daemon) {
            return Ok(false);
        }
        match foretrace_client::stop(&self.instance, STOPPING) {
            Ok(_) => Ok(true),
            Err(error) => {
                locked(&self.moved).daemon.get_or_insert(daemon);
                Err(error.into())
            }
        }
    }

    /// Lets no further request pass, then stops what moves.
    fn end(&self) -> Result<bool, LiveFailure> {
        if self.pid != std::process::id() {
            return Ok(false);
        }
        let foretrace = locked(&self.foretrace).take();
        let stopped = self.stop_what_moves();
        drop(foretrace);
        stopped
    }

    /// Asks with an attachment that is renewed where there is a new daemon.
    fn ask(
        &self,
        timeout: Duration,
        moves: bool,
        decided_ns: u64,
        ask: impl FnOnce(&mut Requests, Duration) -> Result<ControlResponse, RequestError>,
    ) -> Result<ControlResponse, LiveFailure> {
        let deadline = Instant::now() + timeout;
        // One after the other: what a refusal undoes is never the mark of another request.
        let _moving = if moves { Some(self.wait_to_move(deadline)?) } else { None };
        let mut place = locked(&self.foretrace);
        let foretrace = place.as_mut().ok_or_else(closed)?;
        foretrace.reattach_if_needed()?;
        let mut requests = foretrace.requests().decided_at(decided_ns);
        let daemon = foretrace.daemon();
        // Before the answer: a request whose answer is lost may have moved the arm all the same. And before
        // anybody can close: who closes after this finds the mark.
        let before = moves.then(|| {
            let mut moved = locked(&self.moved);
            moved.asked += 1;
            moved.daemon.replace(daemon)
        });
        drop(place);
        let result = ask(&mut requests, deadline.saturating_duration_since(Instant::now()));
        let not_moved = matches!(
            result,
            Err(RequestError::Refused { .. } | RequestError::Invalid(_) | RequestError::NotConnected(_))
        );
        if let Some(before) = before.filter(|before| not_moved && *before != Some(daemon)) {
            let mut moved = locked(&self.moved);
            // A stop meanwhile has cleared it.
            if moved.daemon == Some(daemon) {
                moved.daemon = before;
            }
        }
        Ok(result?)
    }

    fn wait_to_move(&self, deadline: Instant) -> Result<MutexGuard<'_, ()>, LiveFailure> {
        loop {
            match self.moving.try_lock() {
                Ok(guard) => return Ok(guard),
                Err(TryLockError::Poisoned(poisoned)) => return Ok(poisoned.into_inner()),
                Err(TryLockError::WouldBlock) if Instant::now() < deadline => std::thread::sleep(TURN),
                Err(TryLockError::WouldBlock) => {
                    let text = "another request that moves the arm still waits for its answer: ask again";
                    return Err(LiveFailure::new(FailureKind::NoAnswer, text));
                }
            }
        }
    }

    /// The arm has stopped, unless somebody asked it to move since there were `asked` requests.
    fn stands(&self, asked: u64) {
        let mut moved = locked(&self.moved);
        if moved.asked == asked {
            moved.daemon = None;
        }
    }

    fn asked(&self) -> u64 {
        locked(&self.moved).asked
    }
}

impl Closing for Inner {
    fn moves_an_arm(&self) -> bool {
        true
    }

    fn close(&self) {
        // At the interpreter's end there is nobody to tell; the arm brakes when commands stay away.
        let _ = self.end();
    }
}

impl Drop for Inner {
    fn drop(&mut self) {
        // The stop was tried by the attachment, which released the interpreter lock for it.
        if self.pid == std::process::id() {
            drop(locked(&self.foretrace).take());
        }
    }
}

/// An instance and its daemon.
#[pyclass(frozen, name = "Attachment", module = "foretrace._native")]
pub struct LiveAttachment(Arc<Inner>);

impl Drop for LiveAttachment {
    fn drop(&mut self) {
        // A stop takes its time, which other threads of Python must not have to wait for.
        let released = Python::try_attach(|py| py.detach(|| self.0.close()));
        if released.is_none() {
            self.0.close();
        }
    }
}

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
    let stop = move || Ok(foretrace_client::stop(&instance, timeout)?);
    Ok(stopped(in_a_thread(py, "the stop", timeout + PATIENCE, stop)?))
}

impl LiveAttachment {
    fn ask(
        &self,
        py: Python<'_>,
        timeout_s: f64,
        moves: bool,
        ask: impl FnOnce(&mut Requests, Duration) -> Result<ControlResponse, RequestError> + Send + 'static,
    ) -> PyResult<AnswerParts> {
        self.ask_at(py, timeout_s, moves, 0, ask)
    }

    /// Asks in a thread, which also ends what Ctrl-C no longer waits for.
    fn ask_at(
        &self,
        py: Python<'_>,
        timeout_s: f64,
        moves: bool,
        decided_ns: u64,
        ask: impl FnOnce(&mut Requests, Duration) -> Result<ControlResponse, RequestError> + Send + 'static,
    ) -> PyResult<AnswerParts> {
        same_process(self.0.pid, "the attachment")?;
        let timeout = seconds("timeout", timeout_s)?;
        let inner = self.0.clone();
        let asking = move || inner.ask(timeout, moves, decided_ns, ask);
        let answer = in_a_thread(py, "the request", timeout + PATIENCE, asking)?;
        Ok((answer.status, answer.detail, answer.value, answer.text()))
    }

    fn open<T>(&self, py: Python<'_>, open: impl FnOnce(Instance) -> PyResult<T>) -> PyResult<T> {
        same_process(self.0.pid, "the attachment")?;
        // Another thread may hold the place while it attaches anew.
        if py.detach(|| locked(&self.0.foretrace).is_none()) {
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
        let deadline = Instant::now() + wait;
        // In pieces, so that Ctrl-C ends the wait.
        let foretrace = loop {
            let left = deadline.saturating_duration_since(Instant::now());
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
            moved: Mutex::default(),
            moving: Mutex::default(),
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
        self.open(py, |instance| PenHandle::open(py, instance, name, take_over_s))
    }

    fn dead_man(
        &self,
        py: Python<'_>,
        name: Option<&str>,
        take_over_s: Option<f64>,
    ) -> PyResult<DeadManHandle> {
        self.open(py, |instance| DeadManHandle::open(py, instance, name, take_over_s))
    }

    fn predictor(&self, py: Python<'_>) -> PyResult<PredictorHandle> {
        self.open(py, |instance| PredictorHandle::open(py, instance))
    }

    fn status(&self, py: Python<'_>) -> PyResult<StatusHandle> {
        self.open(py, |instance| StatusHandle::open(py, instance))
    }

    fn watch(&self, py: Python<'_>, kind: &str) -> PyResult<WatchHandle> {
        self.open(py, |instance| WatchHandle::open(py, instance, kind))
    }

    fn history(&self, py: Python<'_>) -> PyResult<HistoryHandle> {
        self.open(py, |instance| HistoryHandle::open(py, instance))
    }

    fn arm_interface(
        &self,
        py: Python<'_>,
        rate_hz: f64,
        deceleration: [f64; JOINTS],
        pause_after_s: f64,
        simulated: bool,
    ) -> PyResult<ArmHandle> {
        self.open(py, |instance| {
            ArmHandle::open(py, instance, rate_hz, deceleration, pause_after_s, simulated)
        })
    }

    fn settings(&self, py: Python<'_>, timeout_s: f64) -> PyResult<(u64, String)> {
        self.open(py, |instance| super::settings::settings(py, instance, timeout_s))
    }

    fn arm_ports(&self, py: Python<'_>) -> PyResult<ArmPortsHandle> {
        self.open(py, |instance| ArmPortsHandle::open(py, instance))
    }

    fn arm(&self, py: Python<'_>, timeout_s: f64, decided_ns: u64) -> PyResult<AnswerParts> {
        self.ask_at(py, timeout_s, true, decided_ns, Requests::arm)
    }

    fn move_home(&self, py: Python<'_>, timeout_s: f64) -> PyResult<AnswerParts> {
        self.ask(py, timeout_s, true, Requests::move_home)
    }

    fn disarm(&self, py: Python<'_>, timeout_s: f64) -> PyResult<AnswerParts> {
        let asked = self.0.asked();
        let answer = self.ask(py, timeout_s, false, Requests::disarm)?;
        self.0.stands(asked);
        Ok(answer)
    }

    fn query(&self, py: Python<'_>, timeout_s: f64) -> PyResult<AnswerParts> {
        self.ask(py, timeout_s, false, Requests::query)
    }

    fn set_trust(&self, py: Python<'_>, trust: f64, timeout_s: f64) -> PyResult<AnswerParts> {
        self.ask(py, timeout_s, false, move |requests, wait| requests.set_trust(trust, wait))
    }

    fn freeze_trust(&self, py: Python<'_>, timeout_s: f64) -> PyResult<AnswerParts> {
        self.ask(py, timeout_s, false, Requests::freeze_trust)
    }

    fn trust_auto(&self, py: Python<'_>, timeout_s: f64) -> PyResult<AnswerParts> {
        self.ask(py, timeout_s, false, Requests::trust_auto)
    }

    fn switch_predictor(&self, py: Python<'_>, name: &str, timeout_s: f64) -> PyResult<AnswerParts> {
        let name = name.to_owned();
        self.ask(py, timeout_s, false, move |requests, wait| requests.switch_predictor(&name, wait))
    }

    fn reload(&self, py: Python<'_>, timeout_s: f64) -> PyResult<AnswerParts> {
        self.ask(py, timeout_s, false, Requests::reload)
    }

    /// Needs no attachment, and works where every other way is closed.
    fn stop(&self, py: Python<'_>, timeout_s: f64) -> PyResult<(Option<u32>, Option<f64>)> {
        same_process(self.0.pid, "the attachment")?;
        let timeout = seconds("timeout", timeout_s)?;
        let inner = self.0.clone();
        let stop = move || {
            let asked = inner.asked();
            let result = foretrace_client::stop(&inner.instance, timeout)?;
            inner.stands(asked);
            Ok(result)
        };
        Ok(stopped(in_a_thread(py, "the stop", timeout + PATIENCE, stop)?))
    }

    /// Stops the arm if this attachment set it in motion, and leaves the instance; whether it stopped it.
    fn close(&self, py: Python<'_>) -> PyResult<bool> {
        Ok(py.detach(|| self.0.end())?)
    }
}
