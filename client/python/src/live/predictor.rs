//! `PredictorHandle`: steps of the pen's grid in, previews out, for a predictor that is written in Python.

use std::collections::VecDeque;
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::time::{Duration, Instant};

use foretrace_client::wire::PenStep;
use foretrace_client::{Foretrace, Instance, PenSteps, Previews, ServiceError};
use pyo3::prelude::*;
use pyo3::types::PyBytes;

use super::failure::LiveFailure;
use super::kept::KeptHandle;
use super::pen::PATIENCE;
use super::ports::bytes_of;
use super::worker::{Closing, HandleWorker, closed, locked, same_process, seconds};

/// Steps come every 10 ms.
const COLLECT: Duration = Duration::from_millis(1);
/// Between two looks for Ctrl-C.
const LOOK: Duration = Duration::from_millis(100);
/// Steps that wait for Python at most: 2.56 s at 10 ms. As the middleware keeps.
const ROOM: usize = 256;
const NAME: &str = "the predictor";

type PredictorPorts = (PenSteps, Previews);

fn open_ports(foretrace: &Foretrace) -> Result<PredictorPorts, ServiceError> {
    Ok((foretrace.pen_steps()?, foretrace.previews()?))
}

/// Steps that wait for Python, and why none will come.
#[derive(Default)]
struct WaitingSteps {
    steps: VecDeque<PenStep>,
    /// Those that Python will never see: for want of room here, or on the way.
    lost: u64,
    failure: Option<LiveFailure>,
    over: bool,
}

type SharedSteps = Arc<(Mutex<WaitingSteps>, Condvar)>;

struct StepCollector {
    ports: KeptHandle<PredictorPorts>,
    queue: SharedSteps,
}

impl StepCollector {
    fn collect(&mut self) {
        let (mutex, came) = &*self.queue;
        if let Some((steps, previews)) = self.ports.handle() {
            let mut queue = locked(mutex);
            let on_the_way = steps.lost();
            steps.drain(|step| {
                if queue.steps.len() == ROOM {
                    queue.steps.pop_front();
                    queue.lost += 1;
                }
                queue.steps.push_back(*step);
            });
            queue.lost += steps.lost().saturating_sub(on_the_way);
            if !queue.steps.is_empty() {
                came.notify_all();
            }
            drop(queue);
            if previews.handed_to().is_some() {
                return;
            }
        }
        self.ports.look(open_ports);
        let failure = self.ports.lasting_failure();
        let failed = failure.is_some();
        locked(mutex).failure = failure;
        if failed {
            came.notify_all();
        }
    }
}

impl Drop for StepCollector {
    fn drop(&mut self) {
        locked(&self.queue.0).over = true;
        self.queue.1.notify_all();
    }
}

/// The predictor's place of an instance, from any Python thread.
#[pyclass(frozen, module = "foretrace._native")]
pub struct PredictorHandle {
    worker: Arc<HandleWorker<StepCollector>>,
    queue: SharedSteps,
    pid: u32,
}

impl PredictorHandle {
    pub fn open(py: Python<'_>, instance: Instance) -> PyResult<Self> {
        let queue = SharedSteps::default();
        let shared = queue.clone();
        let open = move || -> Result<StepCollector, LiveFailure> {
            let foretrace = Foretrace::attach_within(&instance, Duration::ZERO)?;
            let ports = open_ports(&foretrace)?;
            Ok(StepCollector { ports: KeptHandle::new(foretrace, ports), queue: shared })
        };
        let worker = HandleWorker::start(py, NAME, COLLECT, PATIENCE, open, StepCollector::collect)?;
        Ok(Self { worker, queue, pid: std::process::id() })
    }
}

#[pymethods]
impl PredictorHandle {
    /// The next unread step; none where none comes in time.
    fn next<'py>(&self, py: Python<'py>, timeout_s: f64) -> PyResult<Option<Bound<'py, PyBytes>>> {
        same_process(self.pid, NAME)?;
        let deadline = Instant::now() + seconds("timeout", timeout_s)?;
        loop {
            let found = py.detach(|| {
                let (mutex, came) = &*self.queue;
                let wait = LOOK.min(deadline.saturating_duration_since(Instant::now()));
                let nothing = |queue: &mut WaitingSteps| {
                    queue.steps.is_empty() && queue.failure.is_none() && !queue.over
                };
                let waited = came.wait_timeout_while(locked(mutex), wait, nothing);
                let mut queue = waited.unwrap_or_else(PoisonError::into_inner).0;
                if queue.over {
                    return Err(closed(NAME));
                }
                match (queue.steps.pop_front(), &queue.failure) {
                    (None, Some(failure)) => Err(failure.clone()),
                    (step, _) => Ok(step),
                }
            })?;
            if let Some(step) = found {
                return Ok(Some(PyBytes::new(py, &bytes_of(&step))));
            }
            py.check_signals()?;
            if Instant::now() >= deadline {
                return Ok(None);
            }
        }
    }

    /// Sends a preview; whether a daemon was there.
    fn send(
        &self,
        py: Python<'_>,
        base_index: u64,
        positions: Vec<[f64; 2]>,
        radii: Vec<f64>,
    ) -> PyResult<bool> {
        let job = move |collector: &mut StepCollector| {
            let (_, previews) = collector.ports.open(NAME)?;
            Ok::<_, LiveFailure>(previews.send(base_index, &positions, &radii)?)
        };
        Ok(self.worker.call(py, PATIENCE, job)??)
    }

    /// Steps that were never given out.
    #[getter]
    fn lost(&self) -> PyResult<u64> {
        // A lock that another thread of the parent held at the fork stays shut here.
        same_process(self.pid, NAME)?;
        Ok(locked(&self.queue.0).lost)
    }

    fn handed_to(&self, py: Python<'_>) -> PyResult<Option<String>> {
        self.worker.call(py, PATIENCE, |collector| {
            let (_, previews) = collector.ports.handle()?;
            previews.handed_to().map(ToString::to_string)
        })
    }

    fn close(&self, py: Python<'_>) {
        py.detach(|| self.worker.close());
    }
}
