//! `DeadManHandle`: the dead-man signal. Python itself beats: a thread of ours would beat for a dead program.

use std::sync::Arc;
use std::time::Duration;

use foretrace_client::{Claimant, DeadMan, DeadManError, Foretrace, HolderKind, Instance};
use pyo3::prelude::*;

use super::failure::{FailureKind, LiveFailure};
use super::kept::KeptHandle;
use super::pen::PATIENCE;
use super::worker::{Closing, HandleWorker, seconds};

/// The dead-man switch of an instance, from any Python thread.
#[pyclass(frozen, module = "foretrace._native")]
pub struct DeadManHandle {
    worker: Arc<HandleWorker<KeptHandle<DeadMan>>>,
}

impl DeadManHandle {
    pub fn open(
        py: Python<'_>,
        instance: Instance,
        name: Option<&str>,
        take_over_s: Option<f64>,
    ) -> PyResult<Self> {
        let who = Claimant::new(HolderKind::Program, name.unwrap_or("python"));
        let patience = take_over_s.map(|patience| seconds("take_over", patience)).transpose()?;
        let again = who.clone();
        let open = move || -> Result<KeptHandle<DeadMan>, LiveFailure> {
            let foretrace = Foretrace::attach_within(&instance, Duration::ZERO)?;
            let dead_man = match patience {
                None => foretrace.dead_man_as(&who)?,
                Some(patience) => foretrace.take_dead_man(&who, patience)?,
            };
            Ok(KeptHandle::new(foretrace, dead_man))
        };
        let idle = move |switch: &mut KeptHandle<DeadMan>| {
            if switch.handle().is_none_or(|dead_man| dead_man.handed_to().is_none()) {
                switch.look(|foretrace| foretrace.dead_man_as(&again));
            }
        };
        let opening = PATIENCE + patience.unwrap_or_default();
        let pause = Duration::from_millis(100);
        Ok(Self { worker: HandleWorker::start(py, "the dead-man switch", pause, opening, open, idle)? })
    }
}

/// Sends a signal; none is sent where there is no daemon.
fn signal(
    switch: &mut KeptHandle<DeadMan>,
    send: impl FnOnce(&mut DeadMan) -> Result<(), DeadManError>,
) -> Result<(), LiveFailure> {
    let dead_man = switch.open("the dead-man switch")?;
    match send(dead_man) {
        Err(DeadManError::HandedOver) => {
            let who = dead_man.handed_to().map_or_else(|| "another program".to_owned(), ToString::to_string);
            let text = format!("the dead-man switch was handed to {who}, which asked for it: end this one");
            Err(LiveFailure::new(FailureKind::Taken, text))
        }
        other => Ok(other?),
    }
}

#[pymethods]
impl DeadManHandle {
    fn beat(&self, py: Python<'_>) -> PyResult<()> {
        Ok(self.worker.call(py, PATIENCE, |switch| signal(switch, DeadMan::beat))??)
    }

    fn stop(&self, py: Python<'_>) -> PyResult<()> {
        Ok(self.worker.call(py, PATIENCE, |switch| signal(switch, DeadMan::stop))??)
    }

    fn handed_to(&self, py: Python<'_>) -> PyResult<Option<String>> {
        self.worker.call(py, PATIENCE, |switch| {
            switch.handle().and_then(|dead_man| dead_man.handed_to().map(ToString::to_string))
        })
    }

    fn close(&self, py: Python<'_>) {
        py.detach(|| self.worker.close());
    }
}
