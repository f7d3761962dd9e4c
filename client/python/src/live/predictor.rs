//! `PredictorHandle`: steps of the pen's grid in, previews out, for a predictor that is written in Python.

use std::sync::Arc;
use std::time::{Duration, Instant};

use foretrace_client::{Foretrace, Instance, Lasting, PenSteps, Previews, ServiceError};
use pyo3::prelude::*;
use pyo3::types::PyBytes;

use super::failure::{FailureKind, LiveFailure};
use super::pen::PATIENCE;
use super::ports::bytes_of;
use super::worker::{Closing, HandleWorker, seconds};

/// Between two looks for a new daemon.
const LOOK: Duration = Duration::from_millis(250);
/// Longest wait for a step in one go: Ctrl-C is seen between two.
const WAIT: Duration = Duration::from_millis(50);

type PredictorPorts = (PenSteps, Previews);

fn open_ports(foretrace: &Foretrace) -> Result<PredictorPorts, ServiceError> {
    Ok((foretrace.pen_steps()?, foretrace.previews()?))
}

/// The predictor's place of an instance, from any Python thread.
#[pyclass(frozen, module = "foretrace._native")]
pub struct PredictorHandle {
    worker: Arc<HandleWorker<Lasting<PredictorPorts>>>,
}

impl PredictorHandle {
    pub fn open(py: Python<'_>, instance: Instance) -> PyResult<Self> {
        let open = move || -> Result<Lasting<PredictorPorts>, LiveFailure> {
            let foretrace = Foretrace::attach_within(&instance, Duration::ZERO)?;
            let ports = open_ports(&foretrace)?;
            Ok(Lasting::new(foretrace, ports))
        };
        let idle = |ports: &mut Lasting<PredictorPorts>| {
            let given_away = |(_, previews): &mut PredictorPorts| previews.handed_to().is_some();
            if !ports.handle.as_mut().is_some_and(given_away) {
                // An error is no end: the next look tries again.
                let _ = ports.look(open_ports);
            }
        };
        Ok(Self { worker: HandleWorker::start(py, "the predictor", LOOK, PATIENCE, open, idle)? })
    }
}

#[pymethods]
impl PredictorHandle {
    /// The next unread step; none where none comes in time.
    fn next<'py>(&self, py: Python<'py>, timeout_s: f64) -> PyResult<Option<Bound<'py, PyBytes>>> {
        let deadline = Instant::now() + seconds("timeout", timeout_s)?;
        loop {
            let wait = WAIT.min(deadline.saturating_duration_since(Instant::now()));
            let step = self.worker.call(py, PATIENCE, move |ports| match &mut ports.handle {
                Some((steps, _)) => steps.next_within(wait).map(|step| bytes_of(&step)),
                None => {
                    std::thread::sleep(wait);
                    None
                }
            })?;
            if let Some(step) = step {
                return Ok(Some(PyBytes::new(py, &step)));
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
        let job = move |ports: &mut Lasting<PredictorPorts>| match &mut ports.handle {
            Some((_, previews)) => Ok(previews.send(base_index, &positions, &radii)?),
            None => Err(LiveFailure::new(
                FailureKind::NoDaemon,
                "no daemon hears the predictor: start one, or wait for it",
            )),
        };
        Ok(self.worker.call(py, PATIENCE, job)??)
    }

    fn handed_to(&self, py: Python<'_>) -> PyResult<Option<String>> {
        self.worker.call(py, PATIENCE, |ports| {
            ports.handle.as_mut().and_then(|(_, previews)| previews.handed_to().map(ToString::to_string))
        })
    }

    fn close(&self, py: Python<'_>) {
        py.detach(|| self.worker.close());
    }
}
