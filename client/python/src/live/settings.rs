//! `settings`: those in force, as the daemon sends them to whoever begins to record.

use std::sync::Arc;
use std::time::{Duration, Instant};

use foretrace_client::wire::PieceKind;
use foretrace_client::{Foretrace, InputWatch, Instance};
use pyo3::prelude::*;

use super::failure::{FailureKind, LiveFailure};
use super::pen::PATIENCE;
use super::worker::{Closing, HandleWorker, locked, seconds};

/// The middleware keeps some messages only: at 500 Hz, look every few milliseconds.
const COLLECT: Duration = Duration::from_millis(5);

/// Settings as they arrived: how often they were changed, and their text.
type ArrivedSettings = Arc<std::sync::Mutex<Option<(u64, String)>>>;

struct SettingsCollector {
    inputs: InputWatch,
    arrived: ArrivedSettings,
}

impl SettingsCollector {
    fn collect(&mut self) {
        // They come beside the inputs of all ticks, which nobody needs here.
        self.inputs.drain(|_| {});
        let arrived = &self.arrived;
        self.inputs.snapshots(|thing| {
            if thing.kind == PieceKind::Settings {
                let text = String::from_utf8_lossy(&thing.bytes).into_owned();
                *locked(arrived) = Some((thing.number, text));
            }
        });
    }
}

/// The settings of a running daemon: how often they were changed since its start, and their TOML.
///
/// # Errors
///
/// `Taken` when two others record already; `NoAnswer`.
pub fn settings(py: Python<'_>, instance: Instance, timeout_s: f64) -> PyResult<(u64, String)> {
    let deadline = Instant::now() + seconds("timeout", timeout_s)?;
    let arrived = ArrivedSettings::default();
    let shared = arrived.clone();
    let open = move || -> Result<SettingsCollector, LiveFailure> {
        let foretrace = Foretrace::attach_within(&instance, Duration::ZERO)?;
        Ok(SettingsCollector { inputs: foretrace.inputs()?, arrived: shared })
    };
    let worker =
        HandleWorker::start(py, "the settings", COLLECT, PATIENCE, open, SettingsCollector::collect)?;
    let found = loop {
        let found = locked(&arrived).take();
        if found.is_some() || Instant::now() >= deadline {
            break found;
        }
        py.detach(|| std::thread::sleep(COLLECT));
        py.check_signals()?;
    };
    py.detach(|| worker.close());
    found.ok_or_else(|| {
        let text = format!("the daemon sent no settings within {timeout_s} s: see `foretrace doctor`");
        LiveFailure::new(FailureKind::NoAnswer, text).into()
    })
}
