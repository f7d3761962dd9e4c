//! `StatusHandle`: the newest status, or the next one.

use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::time::{Duration, Instant};

use foretrace_client::wire::Wire;
use foretrace_client::{Foretrace, Instance, Lasting, Status, StatusReader};
use pyo3::prelude::*;
use pyo3::types::PyBytes;

use super::failure::{FailureKind, LiveFailure};
use super::pen::PATIENCE;
use super::worker::{Closing, HandleWorker, locked, same_process, seconds};

/// A status comes ten times per second and on every change.
const COLLECT: Duration = Duration::from_millis(5);

type NewestStatus = Arc<(Mutex<Option<Status>>, Condvar)>;

struct StatusCollector {
    reader: Lasting<StatusReader>,
    newest: NewestStatus,
}

impl StatusCollector {
    fn collect(&mut self) {
        if let Some(status) = self.reader.handle.as_mut().and_then(StatusReader::newest_if_new) {
            *locked(&self.newest.0) = Some(status);
            self.newest.1.notify_all();
        }
        // An error is no end: the next look tries again.
        let _ = self.reader.look(Foretrace::status);
    }
}

/// The status of an instance, also over restarts of its daemon.
#[pyclass(frozen, module = "foretrace._native")]
pub struct StatusHandle {
    worker: Arc<HandleWorker<StatusCollector>>,
    newest: NewestStatus,
    instance: Instance,
    pid: u32,
}

impl StatusHandle {
    pub fn open(py: Python<'_>, instance: Instance) -> PyResult<Self> {
        let newest = NewestStatus::default();
        let (shared, there) = (newest.clone(), instance.clone());
        let open = move || -> Result<StatusCollector, LiveFailure> {
            let foretrace = Foretrace::attach_within(&there, Duration::ZERO)?;
            let reader = foretrace.status()?;
            Ok(StatusCollector { reader: Lasting::new(foretrace, reader), newest: shared })
        };
        let worker =
            HandleWorker::start(py, "the status", COLLECT, PATIENCE, open, StatusCollector::collect)?;
        Ok(Self { worker, newest, instance, pid: std::process::id() })
    }
}

#[pymethods]
impl StatusHandle {
    /// The newest status with a stamp after `after_ns`; waits for it up to `timeout_s`.
    fn newer<'py>(&self, py: Python<'py>, after_ns: u64, timeout_s: f64) -> PyResult<Bound<'py, PyBytes>> {
        same_process(self.pid, "the status")?;
        let begin = Instant::now();
        let deadline = begin + seconds("timeout", timeout_s)?;
        loop {
            let found = py.detach(|| {
                let (mutex, came) = &*self.newest;
                let left = deadline.saturating_duration_since(Instant::now()).min(Duration::from_millis(100));
                let old = |status: &mut Option<Status>| {
                    status.is_none_or(|status| status.header.stamp_ns <= after_ns)
                };
                let waited = came.wait_timeout_while(locked(mutex), left, old);
                let (newest, waited) = waited.unwrap_or_else(PoisonError::into_inner);
                newest.filter(|_| !waited.timed_out())
            });
            if let Some(status) = found {
                let mut bytes = Vec::with_capacity(size_of::<Status>());
                status.put(&mut bytes);
                return Ok(PyBytes::new(py, &bytes));
            }
            py.check_signals()?;
            if Instant::now() >= deadline {
                return Err(py.detach(|| self.silent(begin.elapsed())).into());
            }
        }
    }

    fn close(&self, py: Python<'_>) {
        py.detach(|| self.worker.close());
    }
}

impl StatusHandle {
    fn silent(&self, waited: Duration) -> LiveFailure {
        let (number, root) = (self.instance.number(), self.instance.root().display());
        if self.instance.daemon().is_none() {
            let text = format!(
                "no daemon running for instance {number} (looked in {root}): start it with `foretrace daemon`"
            );
            return LiveFailure::new(FailureKind::NoDaemon, text);
        }
        // A daemon of another layout is there, but nobody of this version hears it.
        if let Err(error) = Foretrace::attach_within(&self.instance, Duration::ZERO) {
            return error.into();
        }
        let text = format!(
            "no status within {:.1} s, though the daemon of instance {number} runs: it hangs, or has only just \
             started; see `foretrace doctor`",
            waited.as_secs_f64()
        );
        LiveFailure::new(FailureKind::NoAnswer, text)
    }
}
