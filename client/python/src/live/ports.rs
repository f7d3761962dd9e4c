//! `ArmPortsHandle`: the messages of an arm as they are, for a loop that is written in Python.

use std::sync::Arc;
use std::time::Duration;

use foretrace_client::wire::{Wire, command_flags};
use foretrace_client::{
    Commands, Demand, Foretrace, Instance, JOINTS, JointCommand, JointState, JointStates, demand_at,
    host_boot_id,
};
use pyo3::prelude::*;
use pyo3::types::PyBytes;

use super::arm_loop::open_ports;
use super::failure::LiveFailure;
use super::kept::KeptHandle;
use super::pen::PATIENCE;
use super::worker::{Closing, HandleWorker};

/// Between two looks for a new daemon.
const LOOK: Duration = Duration::from_millis(250);

/// Newest command in, joint states out.
#[pyclass(frozen, module = "foretrace._native")]
pub struct ArmPortsHandle {
    worker: Arc<HandleWorker<KeptHandle<(Commands, JointStates)>>>,
}

pub fn bytes_of(message: &impl Wire) -> Vec<u8> {
    let mut bytes = Vec::new();
    message.put(&mut bytes);
    bytes
}

fn read<T: Wire>(what: &str, mut bytes: &[u8]) -> Result<T, LiveFailure> {
    if bytes.len() != size_of::<T>() {
        let text = format!("the {what} has {} bytes, it needs {}", bytes.len(), size_of::<T>());
        return Err(LiveFailure::invalid(text));
    }
    T::get(&mut bytes).ok_or_else(|| LiveFailure::invalid(format!("the {what} has too few bytes")))
}

impl ArmPortsHandle {
    pub fn open(py: Python<'_>, instance: Instance) -> PyResult<Self> {
        let open = move || -> Result<KeptHandle<(Commands, JointStates)>, LiveFailure> {
            let foretrace = Foretrace::attach_within(&instance, Duration::ZERO)?;
            let ports = open_ports(&foretrace)?;
            Ok(KeptHandle::new(foretrace, ports))
        };
        let idle = |ports: &mut KeptHandle<(Commands, JointStates)>| {
            ports.look(open_ports);
        };
        Ok(Self { worker: HandleWorker::start(py, "the arm's messages", LOOK, PATIENCE, open, idle)? })
    }
}

#[pymethods]
impl ArmPortsHandle {
    /// The newest command, and a joint state that echoes it; none before the first.
    fn latest<'py>(&self, py: Python<'py>) -> PyResult<Option<(Bound<'py, PyBytes>, Bound<'py, PyBytes>)>> {
        let newest = self.worker.call(py, PATIENCE, |ports| {
            if let Some(failure) = ports.lasting_failure() {
                return Err(failure);
            }
            let Some((commands, _)) = ports.handle() else { return Ok(None) };
            let command = commands.latest().copied();
            Ok(command.map(|command| (bytes_of(&command), bytes_of(&commands.echo()))))
        })??;
        Ok(newest.map(|(command, echo)| (PyBytes::new(py, &command), PyBytes::new(py, &echo))))
    }

    /// Sends a joint state, measured at `stamp_ns`; whether a daemon was there.
    fn publish(&self, py: Python<'_>, stamp_ns: u64, state: &[u8]) -> PyResult<bool> {
        let state: JointState = read("joint state", state)?;
        let job = move |ports: &mut KeptHandle<(Commands, JointStates)>| {
            let (_, states) = ports.open("the arm")?;
            Ok::<_, LiveFailure>(states.publish(stamp_ns, state)?)
        };
        Ok(self.worker.call(py, PATIENCE, job)??)
    }

    fn close(&self, py: Python<'_>) {
        py.detach(|| self.worker.close());
    }
}

/// Positions \[rad\] and velocities \[rad/s\] of a command at an instant; none: brake.
#[pyfunction]
#[pyo3(name = "demand_at")]
pub fn demand(command: &[u8], now_ns: u64) -> PyResult<Option<([f64; JOINTS], [f64; JOINTS])>> {
    let command: JointCommand = read("command", command)?;
    if command.flags & command_flags::ENABLED != 0 && command.header.boot_id != host_boot_id() {
        let text =
            "the command is of before this machine's last start, or of another machine: read a new one";
        return Err(LiveFailure::invalid(text).into());
    }
    match demand_at(&command, now_ns) {
        Demand::Follow { q, qd } if q.iter().chain(&qd).all(|number| number.is_finite()) => Ok(Some((q, qd))),
        Demand::Follow { .. } => {
            Err(LiveFailure::invalid("the command holds a number that is not finite").into())
        }
        Demand::Brake => Ok(None),
    }
}
