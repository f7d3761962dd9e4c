//! What a tick decided, as attributes. Units stand in the names; `q` [rad] and `qd` [rad/s] have none.

use foretrace_control::follower::{JointCommand, Refusal, StepOutput};
use foretrace_control::ik::IkSource;
use foretrace_control::mpc::{AxisReport, SolvePath};
use foretrace_shm::{guard_mask, health};
use foretraced::wire::{self, JOINTS};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};

use crate::files::values::table;

/// A command that may leave: finite, inside every limit, continuous with the last one.
#[pyclass(frozen, get_all, name = "Command", module = "foretrace._native")]
pub struct LawCommand {
    /// The instant for which `q` holds [ns].
    pub stamp_ns: u64,
    /// Follow q + qd·(t − stamp) until here [ns], then brake.
    pub valid_until_ns: u64,
    /// Joint positions [rad], base first.
    pub q: [f64; JOINTS],
    /// Mean joint velocities over the period that ends at the stamp [rad/s].
    pub qd: [f64; JOINTS],
    /// The arm may move with this command.
    pub enabled: bool,
}

impl LawCommand {
    fn of(command: &JointCommand<JOINTS>) -> Self {
        let JointCommand { stamp, valid_until, q, qd, enabled } = *command;
        Self { stamp_ns: stamp.0, valid_until_ns: valid_until.0, q, qd, enabled }
    }
}

#[pymethods]
impl LawCommand {
    fn __repr__(&self) -> String {
        let Self { stamp_ns, q, qd, enabled, .. } = self;
        format!(
            "Command(stamp_ns={stamp_ns}, q={q:?}, qd={qd:?}, enabled={})",
            if *enabled { "True" } else { "False" }
        )
    }
}

/// Everything that one tick decided.
#[pyclass(frozen, name = "Step", module = "foretrace._native")]
pub struct LawStep(pub Box<StepOutput<JOINTS>>);

fn said(answer: Option<Result<(), Refusal>>) -> (Option<bool>, Option<&'static str>) {
    match answer {
        None => (None, None),
        Some(Ok(())) => (Some(true), None),
        Some(Err(refusal)) => (Some(false), Some(wire::refusal(refusal).1)),
    }
}

fn axis<'py>(python: Python<'py>, report: &AxisReport) -> PyResult<Bound<'py, PyDict>> {
    let path = match report.path {
        SolvePath::Gain => "gain",
        SolvePath::ActiveSet => "active set",
        SolvePath::Other => "other solver",
        SolvePath::Failed => "failed",
    };
    let active = report.active;
    Ok(table!(python;
        "path" => path,
        "iterations" => report.iterations,
        "kkt_residual" => report.kkt_residual,
        "active_jerk" => active.jerk,
        "active_acceleration" => active.acceleration,
        "active_velocity" => active.velocity,
        "active_position" => active.position,
        "saturated" => active.saturated,
    ))
}

#[pymethods]
impl LawStep {
    #[getter]
    fn command(&self) -> Option<LawCommand> {
        self.0.command.as_ref().map(LawCommand::of)
    }

    #[getter]
    fn begins(&self) -> bool {
        self.0.begins
    }

    #[getter]
    fn mode(&self) -> &'static str {
        wire::mode(self.0.mode).label()
    }

    #[getter]
    fn rung(&self) -> &'static str {
        wire::rung(self.0.rung).label()
    }

    #[getter]
    fn stop_reason(&self) -> Option<&'static str> {
        let reason = wire::fault(self.0.stop_reason);
        (reason != foretrace_shm::FaultReason::None).then(|| reason.label())
    }

    #[getter]
    fn stop<'py>(&self, python: Python<'py>) -> PyResult<Option<Bound<'py, PyDict>>> {
        let Some(reason) = self.stop_reason() else { return Ok(None) };
        let detail = wire::stop_detail(&self.0.stop_detail);
        let cause = foretrace_shm::StopCause::try_from(detail.cause);
        Ok(Some(table!(python;
            "reason" => reason,
            "cause" => cause.map_or("unknown cause", foretrace_shm::StopCause::label),
            "joint" => (detail.joint >= 0).then_some(detail.joint),
            "amount" => detail.amount,
            "limit" => detail.limit,
            "at_ns" => detail.at_ns,
            "text" => detail.to_string(),
        )))
    }

    #[getter]
    fn accepted(&self) -> Option<bool> {
        said(self.0.answer).0
    }

    #[getter]
    fn refusal(&self) -> Option<&'static str> {
        said(self.0.answer).1
    }

    #[getter]
    fn way_clear(&self) -> Option<bool> {
        said(self.0.way).0
    }

    #[getter]
    fn way_refusal(&self) -> Option<&'static str> {
        said(self.0.way).1
    }

    #[getter]
    fn home<'py>(&self, python: Python<'py>) -> PyResult<Option<Bound<'py, PyDict>>> {
        let Some(home) = self.0.home else { return Ok(None) };
        let is = table!(python; "moving" => home.moving, "share" => home.share, "left_s" => home.left_s);
        Ok(Some(is))
    }

    #[getter]
    fn health(&self) -> Vec<&'static str> {
        health::labels(wire::health(self.0.health)).collect()
    }

    #[getter]
    fn arm_speed_share(&self) -> Option<f64> {
        self.0.arm_speed_share
    }

    #[getter]
    fn trust(&self) -> f64 {
        self.0.trust.alpha.alpha()
    }

    #[getter]
    fn trust_target(&self) -> f64 {
        self.0.trust.target.alpha()
    }

    #[getter]
    fn trust_reason(&self) -> &'static str {
        wire::trust_reason(self.0.trust.reason, self.0.governor).label()
    }

    #[getter]
    fn predictor(&self) -> &'static str {
        self.0.predictor.name()
    }

    #[getter]
    fn weights_version(&self) -> u64 {
        self.0.weights_version
    }

    #[getter]
    fn governor(&self) -> f64 {
        self.0.governor
    }

    #[getter]
    fn pen_stamp_ns(&self) -> Option<u64> {
        self.0.pen_stamp.map(|stamp| stamp.0)
    }

    #[getter]
    fn pen_m(&self) -> [f64; 2] {
        self.0.pen_position
    }

    #[getter]
    fn pen_contact(&self) -> bool {
        self.0.pen_contact
    }

    #[getter]
    fn pen_sequence(&self) -> u64 {
        self.0.pen_origin.sequence
    }

    #[getter]
    fn pen_counters<'py>(&self, python: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let pen = &self.0.pen_counters;
        Ok(table!(python;
            "received" => pen.received,
            "accepted" => pen.accepted,
            "non_finite" => pen.non_finite,
            "out_of_range" => pen.out_of_range,
            "from_future" => pen.from_future,
            "repeats" => pen.repeats,
            "time_backwards" => pen.time_backwards,
            "outliers" => pen.outliers,
            "jumps" => pen.jumps,
            "restarts" => pen.restarts,
            "overwritten" => pen.overwritten,
        ))
    }

    #[getter]
    fn pen_refused(&self) -> Option<String> {
        let refused = self.0.pen_refused.as_ref()?;
        let words = wire::pen_rejection(refused).map(|rejection| rejection.to_string());
        Some(words.unwrap_or_else(|| format!("{:?}", refused.why).to_lowercase()))
    }

    #[getter]
    fn predictor_error_m(&self) -> Option<f64> {
        self.0.predictor_error
    }

    #[getter]
    fn predictor_band_m(&self) -> Option<f64> {
        self.0.predictor_band
    }

    #[getter]
    fn dead_time_ns(&self) -> u64 {
        self.0.dead_time_ns
    }

    #[getter]
    fn lag<'py>(&self, python: Python<'py>) -> PyResult<Option<Bound<'py, PyDict>>> {
        let Some(lag) = self.0.lag else { return Ok(None) };
        Ok(Some(table!(python; "lag_s" => lag.lag_s, "std_s" => lag.std_s, "shift_s" => lag.shift_s)))
    }

    #[getter]
    fn reference_m(&self) -> [f64; 3] {
        self.0.reference
    }

    #[getter]
    fn preview_m(&self) -> Vec<(f32, f32)> {
        self.0.path.points().iter().map(|[x, y]| (*x, *y)).collect()
    }

    #[getter]
    fn setpoint(&self) -> Vec<(f64, f64, f64)> {
        self.0.setpoint.iter().map(|axis| (axis.position, axis.velocity, axis.acceleration)).collect()
    }

    #[getter]
    fn tool_m(&self) -> [f64; 3] {
        self.0.tool
    }

    #[getter]
    fn axes<'py>(&self, python: Python<'py>) -> PyResult<Bound<'py, PyList>> {
        let list = PyList::empty(python);
        for report in &self.0.axes {
            list.append(axis(python, report)?)?;
        }
        Ok(list)
    }

    #[getter]
    fn ik<'py>(&self, python: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let ik = &self.0.ik;
        let source = match ik.source {
            IkSource::Optimum => "optimum",
            IkSource::Clamped => "clamped",
            IkSource::Brake => "brake",
        };
        let held = ik.active.lower | ik.active.upper;
        let error: [f64; 3] = ik.velocity_error.into();
        Ok(table!(python;
            "source" => source,
            "iterations" => ik.iterations,
            "kkt_residual" => ik.kkt_residual,
            "held_joints" => (0..JOINTS).filter(|j| held & (1 << j) != 0).collect::<Vec<_>>(),
            "velocity_error_mps" => error,
            "tilt_error_radps" => ik.tilt_error,
            "damping_m2" => ik.damping,
            "singularity_m" => ik.singularity,
            "envelope_rows" => ik.envelope,
        ))
    }

    #[getter]
    fn guard_altered(&self) -> Vec<&'static str> {
        guard_mask::labels(wire::guard_mask(self.0.guard_altered)).collect()
    }

    #[getter]
    fn grid_steps(&self) -> usize {
        self.0.learn_count
    }

    fn __repr__(&self) -> String {
        let command = if self.0.command.is_some() { "a command" } else { "no command" };
        let (mode, trust, rung) = (self.mode(), self.trust(), self.rung());
        format!("<Step: {mode}, {command}, {rung}, trust {trust:.2}>")
    }
}

pub fn add(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<LawCommand>()?;
    module.add_class::<LawStep>()
}
