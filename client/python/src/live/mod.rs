//! A running daemon: feed its pen, be its arm, watch it, ask it.
//!
//! Contract: the border to Python carries numbers, texts and the bytes of messages; `python/foretrace/`
//! makes records and arrays of them. Handles of the middleware live in threads of ours (`worker`,
//! `arm_loop`), which never touch the interpreter; every wait releases its lock and is bounded. What is open
//! at the interpreter's end is closed before it, and an arm that was set in motion is stopped.

mod failure;
mod worker;
mod kept;
mod pen;
mod dead_man;
mod status;
mod watch;
mod history;
mod arm_loop;
mod arm;
mod ports;
mod predictor;
mod settings;
mod attachment;

use pyo3::prelude::*;

pub use ports::bytes_of as message_bytes;

/// Closes what is still open; for the end of the interpreter.
#[pyfunction]
fn close_all(py: Python<'_>) {
    py.detach(worker::close_all);
}

/// The clock of all stamps [ns].
#[pyfunction]
fn now_ns() -> u64 {
    foretrace_client::monotonic_now_ns()
}

pub fn add(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("LAYOUT_HASH", foretrace_shm::C_LAYOUT_HASH)?;
    module.add("VERSION", env!("CARGO_PKG_VERSION"))?;
    module.add_class::<attachment::LiveAttachment>()?;
    module.add_class::<pen::PenHandle>()?;
    module.add_class::<pen::GatewayHandle>()?;
    module.add_class::<dead_man::DeadManHandle>()?;
    module.add_class::<status::StatusHandle>()?;
    module.add_class::<watch::WatchHandle>()?;
    module.add_class::<history::HistoryHandle>()?;
    module.add_class::<arm::ArmHandle>()?;
    module.add_class::<ports::ArmPortsHandle>()?;
    module.add_class::<predictor::PredictorHandle>()?;
    module.add_function(wrap_pyfunction!(attachment::stop, module)?)?;
    module.add_function(wrap_pyfunction!(ports::demand, module)?)?;
    module.add_function(wrap_pyfunction!(close_all, module)?)?;
    module.add_function(wrap_pyfunction!(now_ns, module)?)
}
