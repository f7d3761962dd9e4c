//! Replays: bit for bit, and with another law.

use std::num::NonZero;
use std::path::PathBuf;

use foretrace_record::replay::{ReplayEnd, ReplayStart, replay as run};
use foretrace_record::what_if::{Variant, what_if as compare};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};

use super::failed::{of_replay, of_what_if};
use super::values::table;
use super::work::apart;

/// The recorded ticks once more; see `Replay` on the Python side.
#[pyfunction]
fn replay(python: Python<'_>, path: PathBuf) -> PyResult<Bound<'_, PyDict>> {
    let is = apart(python, move |_| run(&path))?.map_err(of_replay)?;
    let (end, next, version) = match &is.end {
        ReplayEnd::OfRecording => ("of_recording", None, None),
        ReplayEnd::Gap { next } => ("gap", Some(*next), None),
        ReplayEnd::Incomplete => ("incomplete", None, None),
        ReplayEnd::NoPreview { tick } => ("no_preview", Some(*tick), None),
        ReplayEnd::NoWeights { version } => ("no_weights", None, Some(*version)),
        ReplayEnd::OtherDaemon => ("other_daemon", None, None),
        ReplayEnd::Damaged { .. } => ("damaged", None, None),
    };
    let verdict = is.verdict();
    let difference = is.difference.as_ref();
    let difference = difference.map(|d| (d.tick, &d.field, &d.recorded, &d.replayed));
    Ok(table!(python;
        "start" => if is.start == ReplayStart::State { "state" } else { "first_tick" },
        "first_tick" => is.first_tick,
        "ticks" => is.ticks,
        "seconds" => is.seconds,
        "end" => end,
        "next_tick" => next,
        "missing_weights" => version,
        "damage" => &is.damage,
        "gone" => &is.gone,
        "difference" => difference,
        "different_ticks" => is.different_ticks,
        "largest_rad" => is.largest_rad,
        "recorded_build" => &is.recorded_build,
        "same_build" => is.same_build,
        "same" => verdict.is_ok() && is.ticks > 0,
        "summary" => is.summary(),
        "verdict" => verdict.map_or_else(|unequal| unequal.to_string(), str::to_owned),
    ))
}

/// The name of a variant, and its pairs; without any the name is the command's text.
type NamedChanges = (String, Option<Vec<(String, String)>>);

/// The hand of the recording in front of other laws: each variant a name, and pairs of keys and TOML values.
#[pyfunction]
fn what_if(python: Python<'_>, path: PathBuf, variants: Vec<NamedChanges>) -> PyResult<Bound<'_, PyDict>> {
    let variants = variants.iter().map(|(name, pairs)| match pairs {
        None => Variant::parse(name),
        Some(pairs) => Ok(Variant::of(name, pairs.iter().map(|(key, value)| (key.as_str(), value.as_str())))),
    });
    let variants = variants.collect::<Result<Vec<_>, _>>().map_err(of_what_if)?;
    let threads = std::thread::available_parallelism().map_or(1, NonZero::get);
    let is = apart(python, move |_| compare(&path, &variants, threads))?.map_err(of_what_if)?;
    let rows = PyList::empty(python);
    for (row, curve) in is.rows.iter().zip(&is.curves) {
        let tool: Vec<_> = curve.tool.iter().map(|s| (s.t_s, s.x_m, s.y_m)).collect();
        rows.append(table!(python;
            "name" => &row.name,
            "rms_mm" => row.rms_mm,
            "max_mm" => row.max_mm,
            "lag_ms" => row.lag_ms,
            "jerk_mps3" => row.jerk_mps3,
            "saturated" => row.saturated,
            "worst_stroke_mm" => row.worst_stroke_mm,
            "worst_stroke_at_s" => row.worst_stroke_at_s,
            "stopped" => &row.stopped,
            "error_mm" => &curve.error_mm,
            "stroke_tool" => tool,
            "stroke_mm" => curve.stroke_mm,
        ))?;
    }
    let stroke: Vec<_> = is.stroke.iter().map(|s| (s.t_s, s.x_m, s.y_m)).collect();
    Ok(table!(python;
        "seconds" => is.seconds,
        "ticks" => is.ticks,
        "damage" => &is.damage,
        "gone" => &is.gone,
        "previews_missing" => is.previews_missing,
        "delay_s" => is.arm.delay_s,
        "filter_s" => is.arm.filter_s,
        "joint_loop_s" => is.arm.joint_loop_s,
        "rms_rad" => is.arm.rms_rad,
        "arm_misfit_mm" => is.arm_misfit_mm,
        "rows" => rows,
        "stretch_s" => is.stretch_s,
        "stroke" => stroke,
    ))
}

pub fn add(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(replay, module)?)?;
    module.add_function(wrap_pyfunction!(what_if, module)?)
}
