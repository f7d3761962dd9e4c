//! What a recording tells in words: its stops, the moments that matter, a single tick.

use std::path::{Path, PathBuf};

use foretrace_record::explain;
use foretrace_record::read::{Content, RecordingEntry, RecordingReader};
use foretrace_shm::{FaultReason, Mode, StopCause, StopDetail};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};

use super::failed::of_record;
use super::recording::{OF_ALL, ReadFailure, Room, of_read};
use super::values::table;
use super::work::{StillWanted, apart};

/// What a stop takes as a dict with its text, about.
const DICT_BYTES: usize = 1024;

/// Of a tick in which a stop latched what is told.
struct LatchedStop {
    tick: u64,
    /// After the first record \[s\].
    after_s: f64,
    fault: u32,
    stop: StopDetail,
}

fn stops(path: &Path, most: u64, wanted: &StillWanted) -> Result<Vec<LatchedStop>, ReadFailure> {
    let mut reader = RecordingReader::open(path)?;
    let (mut found, mut last, mut begin, mut room) = (Vec::new(), None, None, Room::of(most));
    let halted = |mode: u32| mode == u32::from(Mode::Stopped) || mode == u32::from(Mode::Fault);
    while wanted.still()
        && let Some(entry) = reader.next_entry()?
    {
        let RecordingEntry::Message(message) = entry else { continue };
        let Content::Tick(tick) = reader.ticks_and_things(&message)? else { continue };
        let begin_ns = *begin.get_or_insert(tick.release_ns);
        // A second reason latches beside the first one; what the first tick has may be old.
        let is = (halted(tick.mode), tick.fault, tick.stop.at_ns);
        if is.0 && last.is_some_and(|last| last != is) {
            let after_s = tick.release_ns.saturating_sub(begin_ns) as f64 * 1e-9;
            room.count(DICT_BYTES, OF_ALL)?;
            room.take(&mut found, 1, OF_ALL)?;
            found.push(LatchedStop { tick: tick.tick, after_s, fault: tick.fault, stop: tick.stop });
        }
        last = Some(is);
    }
    Ok(found)
}

/// The stops that latched in a recording, in order of time, as dicts.
#[pyfunction]
fn recording_stops(python: Python<'_>, path: PathBuf, most: u64) -> PyResult<Bound<'_, PyList>> {
    let failed = of_read(path.clone());
    let found = apart(python, move |wanted| stops(&path, most, wanted))?.map_err(failed)?;
    let list = PyList::empty(python);
    for LatchedStop { tick, after_s, fault, stop } in found {
        let reason = FaultReason::try_from(fault).map_or("unknown reason", FaultReason::label);
        let cause = StopCause::try_from(stop.cause).map_or("unknown cause", StopCause::label);
        let detail = stop.to_string();
        let text = if detail.is_empty() { reason.to_owned() } else { format!("{reason}; {detail}") };
        list.append(table!(python;
            "tick" => tick,
            "after_s" => after_s,
            "reason" => reason,
            "cause" => cause,
            "joint" => (stop.joint >= 0).then_some(stop.joint),
            "amount" => stop.amount,
            "limit" => stop.limit,
            "at_ns" => stop.at_ns,
            "text" => text,
        ))?;
    }
    Ok(list)
}

/// The moments that matter most: those of `foretrace explain`.
#[pyfunction]
fn recording_moments(python: Python<'_>, path: PathBuf) -> PyResult<Bound<'_, PyDict>> {
    let told = apart(python, move |_| explain::moments(&path))?.map_err(of_record)?;
    let moments = PyList::empty(python);
    for moment in &told.moments {
        moments.append((moment.tick, moment.after_s, &moment.what))?;
    }
    Ok(table!(python; "moments" => moments, "every_ticks" => told.every_ticks, "damage" => told.damage))
}

/// What a tick saw, decided and cost, as sentences: those of `foretrace explain`.
#[pyfunction]
fn recording_tick(python: Python<'_>, path: PathBuf, tick: u64) -> PyResult<Vec<String>> {
    apart(python, move |_| explain::tick(&path, tick))?.map_err(of_record)
}

pub fn add(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(recording_stops, module)?)?;
    module.add_function(wrap_pyfunction!(recording_moments, module)?)?;
    module.add_function(wrap_pyfunction!(recording_tick, module)?)
}
