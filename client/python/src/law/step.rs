//! What a tick decided, as attributes. Units stand in the names; `q` [rad] and `qd` [rad/s] have none.

use foretrace_control::follower::{JointCommand, Refusal, StepOutput};
use foretrace_control::ik::IkSource;
use foretrace_control::mpc::{AxisReport, SolvePath};
use foretrace_control::predict::LearnStep;
use foretrace_shm::{PreviewRefusal, guard_mask, health};
use foretraced::wire::{self, JOINTS};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict, PyList};

use crate::files::values::table;
use crate::live::message_bytes;

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
pub struct LawStep {
    pub output: Box<StepOutput<JOINTS>>,
    /// Length of a step of the pen's grid.
    pub step_ns: u64,
}

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
        self.output.command.as_ref().map(LawCommand::of)
    }

    #[getter]
    fn begins(&self) -> bool {
        self.output.begins
    }

    #[getter]
    fn mode(&self) -> &'static str {
        wire::mode(self.output.mode).label()
    }

    #[getter]
    fn rung(&self) -> &'static str {
        wire::rung(self.output.rung).label()
    }

    #[getter]
    fn stop_reason(&self) -> Option<&'static str> {
        let reason = wire::fault(self.output.stop_reason);
        (reason != foretrace_shm::FaultReason::None).then(|| reason.label())
    }

    #[getter]
    fn stop<'py>(&self, python: Python<'py>) -> PyResult<Option<Bound<'py, PyDict>>> {
        let Some(reason) = self.stop_reason() else { return Ok(None) };
        let detail = wire::stop_detail(&self.output.stop_detail);
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
        said(self.output.answer).0
    }

    #[getter]
    fn refusal(&self) -> Option<&'static str> {
        said(self.output.answer).1
    }

    #[getter]
    fn way_clear(&self) -> Option<bool> {
        said(self.output.way).0
    }

    #[getter]
    fn way_refusal(&self) -> Option<&'static str> {
        said(self.output.way).1
    }

    #[getter]
    fn home<'py>(&self, python: Python<'py>) -> PyResult<Option<Bound<'py, PyDict>>> {
        let Some(home) = self.output.home else { return Ok(None) };
        let is = table!(python; "moving" => home.moving, "share" => home.share, "left_s" => home.left_s);
        Ok(Some(is))
    }

    #[getter]
    fn health(&self) -> Vec<&'static str> {
        health::labels(wire::health(self.output.health)).collect()
    }

    #[getter]
    fn arm_speed_share(&self) -> Option<f64> {
        self.output.arm_speed_share
    }

    #[getter]
    fn trust(&self) -> f64 {
        self.output.trust.alpha.alpha()
    }

    #[getter]
    fn trust_target(&self) -> f64 {
        self.output.trust.target.alpha()
    }

    #[getter]
    fn trust_reason(&self) -> &'static str {
        wire::trust_reason(self.output.trust.reason, self.output.governor).label()
    }

    #[getter]
    fn predictor(&self) -> &'static str {
        self.output.predictor.name()
    }

    #[getter]
    fn preview_steps(&self) -> usize {
        self.output.preview_steps
    }

    #[getter]
    fn external<'py>(&self, python: Python<'py>) -> PyResult<Option<Bound<'py, PyDict>>> {
        let Some(report) = &self.output.external else { return Ok(None) };
        let verdict = report.verdict.map(|verdict| match verdict {
            Ok(()) => "taken",
            // The shell counts from `None` on.
            Err(why) => (PreviewRefusal::try_from(why.index() as u32 + 1))
                .map_or("unknown reason", PreviewRefusal::label),
        });
        Ok(Some(table!(python;
            "weight" => report.weight,
            "evidence" => report.evidence,
            "age" => report.age,
            "verdict" => verdict,
        )))
    }

    /// As records of `foretrace.messages`.
    #[getter]
    fn pen_steps<'py>(&self, python: Python<'py>) -> PyResult<Vec<Bound<'py, PyAny>>> {
        let kind = python.import("foretrace.messages")?.getattr("PenStep")?;
        let closed = self.output.learn.iter().take(self.output.learn_count);
        let record = |step: &LearnStep| {
            let message = wire::pen_step(step, self.step_ns, self.output.preview_steps);
            kind.call_method1("from_buffer_copy", (PyBytes::new(python, &message_bytes(&message)),))
        };
        closed.map(record).collect()
    }

    #[getter]
    fn weights_version(&self) -> u64 {
        self.output.weights_version
    }

    #[getter]
    fn governor(&self) -> f64 {
        self.output.governor
    }

    #[getter]
    fn pen_stamp_ns(&self) -> Option<u64> {
        self.output.pen_stamp.map(|stamp| stamp.0)
    }

    #[getter]
    fn pen_m(&self) -> [f64; 2] {
        self.output.pen_position
    }

    #[getter]
    fn pen_contact(&self) -> bool {
        self.output.pen_contact
    }

    #[getter]
    fn pen_sequence(&self) -> u64 {
        self.output.pen_origin.sequence
    }

    #[getter]
    fn pen_counters<'py>(&self, python: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let pen = &self.output.pen_counters;
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
        let refused = self.output.pen_refused.as_ref()?;
        let words = wire::pen_rejection(refused).map(|rejection| rejection.to_string());
        Some(words.unwrap_or_else(|| format!("{:?}", refused.why).to_lowercase()))
    }

    #[getter]
    fn predictor_error_m(&self) -> Option<f64> {
        self.output.predictor_error
    }

    #[getter]
    fn predictor_band_m(&self) -> Option<f64> {
        self.output.predictor_band
    }

    #[getter]
    fn dead_time_ns(&self) -> u64 {
        self.output.dead_time_ns
    }

    #[getter]
    fn lag<'py>(&self, python: Python<'py>) -> PyResult<Option<Bound<'py, PyDict>>> {
        let Some(lag) = self.output.lag else { return Ok(None) };
        Ok(Some(table!(python; "lag_s" => lag.lag_s, "std_s" => lag.std_s, "shift_s" => lag.shift_s)))
    }

    #[getter]
    fn reference_m(&self) -> [f64; 3] {
        self.output.reference
    }

    #[getter]
    fn preview_m(&self) -> Vec<(f32, f32)> {
        self.output.path.points().iter().map(|[x, y]| (*x, *y)).collect()
    }

    #[getter]
    fn setpoint(&self) -> Vec<(f64, f64, f64)> {
        self.output.setpoint.iter().map(|axis| (axis.position, axis.velocity, axis.acceleration)).collect()
    }

    #[getter]
    fn tool_m(&self) -> [f64; 3] {
        self.output.tool
    }

    #[getter]
    fn axes<'py>(&self, python: Python<'py>) -> PyResult<Bound<'py, PyList>> {
        let list = PyList::empty(python);
        for report in &self.output.axes {
            list.append(axis(python, report)?)?;
        }
        Ok(list)
    }

    #[getter]
    fn ik<'py>(&self, python: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let ik = &self.output.ik;
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
        guard_mask::labels(wire::guard_mask(self.output.guard_altered)).collect()
    }

    #[getter]
    fn grid_steps(&self) -> usize {
        self.output.learn_count
    }

    fn __repr__(&self) -> String {
        let command = if self.output.command.is_some() { "a command" } else { "no command" };
        let (mode, trust, rung) = (self.mode(), self.trust(), self.rung());
        format!("<Step: {mode}, {command}, {rung}, trust {trust:.2}>")
    }
}

pub fn add(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<LawCommand>()?;
    module.add_class::<LawStep>()
}
