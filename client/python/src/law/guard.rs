//! The guard alone: the legal command nearest to whatever is proposed, for arms of 1 to 8 joints.

use std::sync::{Mutex, PoisonError};

use foretrace_control::arm::{JointLimits, JointMotion};
use foretrace_control::guard::{Commanded, Guard, Reasons, StopProfile, consumer_state};
use foretrace_control::units::Stamp;
use pyo3::prelude::*;

use super::numbers::{finite, for_joints, per_joint, too_many};
use crate::files::settings::NamedSettings;
use crate::files::work::apart;
use crate::problem::invalid;

/// Limits of an arm, as they were judged.
#[pyclass(frozen, get_all, module = "foretrace._native")]
#[derive(Clone)]
pub struct LimitsOf {
    /// Lowest and highest position per joint [rad].
    position: Vec<(f64, f64)>,
    velocity: Vec<f64>,
    acceleration: Vec<f64>,
    jerk: Option<Vec<f64>>,
    /// How long a consumer without commands extrapolates [s].
    hold_s: f64,
    /// What it then brakes with [rad/s²].
    braking: Vec<f64>,
}

impl LimitsOf {
    pub fn of<const J: usize>(limits: &JointLimits<J>) -> Self {
        Self {
            position: limits.position().iter().map(|[low, high]| (*low, *high)).collect(),
            velocity: limits.velocity().to_vec(),
            acceleration: limits.acceleration().to_vec(),
            jerk: limits.jerk().map(|jerk| jerk.to_vec()),
            hold_s: limits.hold_s(),
            braking: limits.deceleration().to_vec(),
        }
    }

    fn joints<const J: usize>(&self) -> PyResult<JointLimits<J>> {
        let position: [(f64, f64); J] = per_joint("position", &self.position)?;
        let limits = JointLimits::new(
            position.map(|(low, high)| [low, high]),
            per_joint("velocity", &self.velocity)?,
            per_joint("acceleration", &self.acceleration)?,
        );
        let mut limits = limits.map_err(invalid)?;
        if let Some(jerk) = &self.jerk {
            limits = limits.with_jerk(per_joint("jerk", jerk)?).map_err(invalid)?;
        }
        limits.with_stale_braking(self.hold_s, per_joint("braking", &self.braking)?).map_err(invalid)
    }
}

#[pymethods]
impl LimitsOf {
    #[new]
    fn new(
        position: Vec<(f64, f64)>,
        velocity: Vec<f64>,
        acceleration: Vec<f64>,
        jerk: Option<Vec<f64>>,
        hold_s: f64,
        braking: Option<Vec<f64>>,
    ) -> PyResult<Self> {
        let braking = braking.unwrap_or_else(|| acceleration.clone());
        let limits = Self { position, velocity, acceleration, jerk, hold_s, braking };
        let count = limits.position.len();
        for_joints!(count, J => limits.joints::<J>().map(|_| ())).ok_or_else(|| too_many(count))??;
        Ok(limits)
    }

    /// Those of settings: of the arm's description and of the settings together.
    #[staticmethod]
    fn of_settings(python: Python<'_>, settings: NamedSettings) -> PyResult<Self> {
        apart(python, move |_| Ok(Self::of(&settings.load()?.robot().limits)))?
    }
}

/// What the guard let pass.
#[pyclass(frozen, get_all, name = "Verdict", module = "foretrace._native")]
struct GuardVerdict {
    stamp_ns: u64,
    /// Joint positions [rad], base first.
    q: Vec<f64>,
    /// Mean joint velocities of the step [rad/s].
    qd: Vec<f64>,
    /// Joint accelerations of the step [rad/s²].
    qdd: Vec<f64>,
    /// Joints whose position differs from the proposal, base first.
    altered: Vec<usize>,
    /// Why, over all joints.
    reasons: Vec<&'static str>,
}

#[pymethods]
impl GuardVerdict {
    fn __repr__(&self) -> String {
        let Self { stamp_ns, q, altered, reasons, .. } = self;
        format!("<Verdict at {stamp_ns} ns: q {q:?}, altered joints {altered:?}, {reasons:?}>")
    }
}

fn words(reasons: Reasons) -> Vec<&'static str> {
    let known = [
        (Reasons::NOT_FINITE, "not finite"),
        (Reasons::POSITION, "position"),
        (Reasons::VELOCITY, "velocity"),
        (Reasons::ACCELERATION, "acceleration"),
        (Reasons::JERK, "jerk"),
        (Reasons::STAMP, "stamp"),
        (Reasons::GAP, "gap"),
    ];
    known.into_iter().filter(|(reason, _)| reasons.contains(*reason)).map(|(_, word)| word).collect()
}

trait AnyGuard: Send {
    fn begin(&mut self, stamp: Stamp, motion: [&[f64]; 3]) -> PyResult<()>;
    fn clamp(&mut self, q: &[f64], stamp: Stamp) -> PyResult<GuardVerdict>;
    fn stop(&mut self, stamp: Stamp) -> PyResult<GuardVerdict>;
    fn after_silence(&mut self, now: Stamp) -> PyResult<GuardVerdict>;
    fn at_rest(&self) -> PyResult<bool>;
    fn viable(&self) -> PyResult<bool>;
}

struct GuardOf<const J: usize> {
    guard: Guard<J>,
    profile: StopProfile<J>,
    last: Option<Commanded<J>>,
}

impl<const J: usize> GuardOf<J> {
    fn last(&self) -> PyResult<Commanded<J>> {
        let what =
            "the guard does not know where the arm stands; call begin(q, t_ns) with measured joints first";
        self.last.ok_or_else(|| invalid(what))
    }

    fn passed(&mut self, command: Commanded<J>, altered: u32, reasons: Reasons) -> GuardVerdict {
        self.last = Some(command);
        GuardVerdict {
            stamp_ns: command.stamp().0,
            q: command.q().to_vec(),
            qd: command.qd().to_vec(),
            qdd: command.qdd().to_vec(),
            altered: (0..J).filter(|j| altered & (1 << j) != 0).collect(),
            reasons: words(reasons),
        }
    }
}

impl<const J: usize> AnyGuard for GuardOf<J> {
    fn begin(&mut self, stamp: Stamp, [q, qd, qdd]: [&[f64]; 3]) -> PyResult<()> {
        for (name, values) in [("q", q), ("qd", qd), ("qdd", qdd)] {
            finite(name, values)?;
        }
        let rest = [0.0; J];
        let or_rest =
            |name, values: &[f64]| if values.is_empty() { Ok(rest) } else { per_joint(name, values) };
        let motion = JointMotion { q: per_joint("q", q)?, qd: or_rest("qd", qd)?, qdd: or_rest("qdd", qdd)? };
        self.last = Commanded::new(stamp, motion);
        Ok(())
    }

    fn clamp(&mut self, q: &[f64], stamp: Stamp) -> PyResult<GuardVerdict> {
        let verdict = self.guard.clamp(&self.last()?, &per_joint("q", q)?, stamp);
        Ok(self.passed(verdict.command, verdict.altered, verdict.reasons))
    }

    fn stop(&mut self, stamp: Stamp) -> PyResult<GuardVerdict> {
        let last = self.last()?;
        let (h, qd) = (stamp.seconds_since(last.stamp()), self.profile.next(&last, stamp));
        let mut q = *last.q();
        for (q, qd) in q.iter_mut().zip(qd) {
            *q += qd * h;
        }
        self.clamp(&q, stamp)
    }

    fn after_silence(&mut self, now: Stamp) -> PyResult<GuardVerdict> {
        let last = self.last()?;
        if now < last.stamp() {
            let (now, last) = (now.0, last.stamp().0);
            return Err(invalid(format_args!(
                "now_ns is {now}, before the last command at {last} ns; legal: from there on"
            )));
        }
        let limits = self.guard.limits();
        // Of limits that were judged: 0 to 1 s.
        let hold_ns = (limits.hold_s() * 1e9).round() as u64;
        let motion = consumer_state(&last, last.stamp() + hold_ns, limits.deceleration(), now);
        let command = Commanded::new(now, motion).unwrap_or(last);
        Ok(self.passed(command, 0, Reasons::NONE))
    }

    fn at_rest(&self) -> PyResult<bool> {
        Ok(StopProfile::is_done(&self.last()?))
    }

    fn viable(&self) -> PyResult<bool> {
        Ok(self.guard.limits().is_viable(self.last()?.motion()))
    }
}

/// The last stage before a command leaves.
#[pyclass(frozen, module = "foretrace._native")]
struct LawGuard {
    inner: Mutex<Box<dyn AnyGuard>>,
    limits: LimitsOf,
}

impl LawGuard {
    fn with<T>(&self, work: impl FnOnce(&mut dyn AnyGuard) -> T) -> T {
        work(self.inner.lock().unwrap_or_else(PoisonError::into_inner).as_mut())
    }
}

fn guard<const J: usize>(limits: &LimitsOf) -> PyResult<Box<dyn AnyGuard>> {
    let limits = limits.joints::<J>()?;
    Ok(Box::new(GuardOf { guard: Guard::new(limits), profile: StopProfile::new(limits), last: None }))
}

#[pymethods]
impl LawGuard {
    #[new]
    fn new(limits: &LimitsOf) -> PyResult<Self> {
        let count = limits.position.len();
        let inner = for_joints!(count, J => guard::<J>(limits)).ok_or_else(|| too_many(count))??;
        Ok(Self { inner: Mutex::new(inner), limits: limits.clone() })
    }

    #[getter]
    fn limits(&self) -> LimitsOf {
        self.limits.clone()
    }

    fn begin(&self, q: Vec<f64>, t_ns: u64, qd: Vec<f64>, qdd: Vec<f64>) -> PyResult<()> {
        self.with(|guard| guard.begin(Stamp(t_ns), [&q, &qd, &qdd]))
    }

    fn clamp(&self, q: Vec<f64>, t_ns: u64) -> PyResult<GuardVerdict> {
        self.with(|guard| guard.clamp(&q, Stamp(t_ns)))
    }

    fn stop(&self, t_ns: u64) -> PyResult<GuardVerdict> {
        self.with(|guard| guard.stop(Stamp(t_ns)))
    }

    fn after_silence(&self, now_ns: u64) -> PyResult<GuardVerdict> {
        self.with(|guard| guard.after_silence(Stamp(now_ns)))
    }

    #[getter]
    fn at_rest(&self) -> PyResult<bool> {
        self.with(|guard| guard.at_rest())
    }

    #[getter]
    fn viable(&self) -> PyResult<bool> {
        self.with(|guard| guard.viable())
    }
}

pub fn add(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<LimitsOf>()?;
    module.add_class::<GuardVerdict>()?;
    module.add_class::<LawGuard>()
}
