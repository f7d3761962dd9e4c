//! The kinematic chain of an arm of 1 to 8 joints: pose, Jacobian, joints of a pose.

use std::path::PathBuf;
use std::sync::Arc;

use foretrace_config::files::read_xml;
use foretrace_control::arm::{Chain, ChainError, LONGEST_BYTES};
use foretrace_control::ik::{ToolTarget, solve_pose};
use nalgebra::Vector3;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use super::numbers::{finite, finite_per_joint, for_joints, too_many};
use crate::files::settings::NamedSettings;
use crate::files::values::table;
use crate::files::work::apart;
use crate::problem::{invalid, problem};

/// How far a direction may be from unit length.
const UNIT: f64 = 1e-6;

/// Where the tool is, in the frame of the base link.
#[pyclass(frozen, get_all, module = "foretrace._native")]
struct Pose {
    /// Origin of the tool [m].
    position: [f64; 3],
    /// Tool frame to base frame, by rows.
    rotation: [[f64; 3]; 3],
    /// Rotation vector [rad]: what a pendant shows.
    rotation_vector: [f64; 3],
    /// 6 rows of one number per joint: tool origin [m/rad], rotation [rad/rad].
    jacobian: Vec<Vec<f64>>,
}

trait AnyChain: Send + Sync {
    fn joints(&self) -> usize;
    fn forward(&self, q: &[f64]) -> PyResult<Pose>;
    fn inverse(&self, near: &[f64], target: &ToolTarget) -> PyResult<Option<Vec<f64>>>;
    fn tool_motion(&self, q: &[f64], qd: &[f64], qdd: &[f64]) -> PyResult<[[f64; 3]; 3]>;
    fn limits<'py>(&self, python: Python<'py>) -> PyResult<Bound<'py, PyDict>>;
    fn ends(&self) -> (&str, &str);
}

impl<const J: usize> AnyChain for Chain<J> {
    fn joints(&self) -> usize {
        J
    }

    fn forward(&self, q: &[f64]) -> PyResult<Pose> {
        let is = Chain::forward(self, &finite_per_joint("q", q)?);
        let [_, _, _, a, b, c] = is.pose();
        let rotation = is.rotation.transpose().into();
        let jacobian = (0..6).map(|row| is.jacobian.row(row).iter().copied().collect()).collect();
        Ok(Pose { position: is.position.into(), rotation, rotation_vector: [a, b, c], jacobian })
    }

    fn inverse(&self, near: &[f64], target: &ToolTarget) -> PyResult<Option<Vec<f64>>> {
        Ok(solve_pose(self, &finite_per_joint("near", near)?, target).map(|q| q.to_vec()))
    }

    fn tool_motion(&self, q: &[f64], qd: &[f64], qdd: &[f64]) -> PyResult<[[f64; 3]; 3]> {
        let (qd, qdd) = (finite_per_joint("qd", qd)?, finite_per_joint("qdd", qdd)?);
        let is = Chain::forward(self, &finite_per_joint("q", q)?).tool_motion(&qd, &qdd);
        Ok([is.position.into(), is.velocity.into(), is.acceleration.into()])
    }

    fn limits<'py>(&self, python: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let limits = Chain::limits(self);
        let pairs = |pairs: &[[f64; 2]; J]| pairs.iter().map(|[a, b]| (*a, *b)).collect::<Vec<_>>();
        Ok(table!(python;
            "names" => limits.names.to_vec(),
            "position" => pairs(&limits.position),
            "velocity" => limits.velocity.to_vec(),
            "effort" => limits.effort.to_vec(),
            "friction" => pairs(&limits.friction),
        ))
    }

    fn ends(&self) -> (&str, &str) {
        Chain::ends(self)
    }
}

/// A chain of any number of joints.
#[pyclass(frozen, module = "foretrace._native")]
pub struct ChainOf(Arc<dyn AnyChain>);

impl ChainOf {
    pub fn of<const J: usize>(chain: Chain<J>) -> Self {
        Self(Arc::new(chain))
    }
}

fn built<const J: usize>(
    text: &str,
    base: Option<&str>,
    tip: Option<&str>,
    tool_m: [f64; 3],
) -> Result<ChainOf, ChainError> {
    Ok(ChainOf::of(Chain::<J>::from_urdf(text, base, tip)?.with_tool(tool_m.into())))
}

fn read(text: &str, base: Option<&str>, tip: Option<&str>, tool_m: [f64; 3]) -> PyResult<ChainOf> {
    // Most arms have six; what another has, the refusal says.
    match built::<6>(text, base, tip, tool_m) {
        Err(ChainError::Count { found, .. }) => {
            let other = for_joints!(found, J => built::<J>(text, base, tip, tool_m));
            other.ok_or_else(|| too_many(found))?.map_err(problem)
        }
        other => other.map_err(problem),
    }
}

fn direction(name: &str, [x, y, z]: [f64; 3]) -> PyResult<Vector3<f64>> {
    finite(name, &[x, y, z])?;
    let direction = Vector3::new(x, y, z);
    let length = direction.norm();
    if (length - 1.0).abs() > UNIT {
        let what = format_args!("{name} has the length {length}; legal: unit vectors, to within {UNIT}");
        return Err(invalid(what));
    }
    Ok(direction)
}

#[pymethods]
impl ChainOf {
    /// Of a description's text, or of the file at `path`.
    #[new]
    fn new(
        python: Python<'_>,
        text: Option<String>,
        path: Option<PathBuf>,
        base: Option<String>,
        tip: Option<String>,
        tool_m: [f64; 3],
    ) -> PyResult<Self> {
        finite("tool_m", &tool_m)?;
        apart(python, move |_| {
            let text = match (text, path) {
                (Some(text), _) => text,
                (None, path) => {
                    let path = path.unwrap_or_default();
                    let wrong = |error| problem(format_args!("{}: {error}", path.display()));
                    read_xml(&path, LONGEST_BYTES as u64).map_err(wrong)?
                }
            };
            read(&text, base.as_deref(), tip.as_deref(), tool_m)
        })?
    }

    /// That of settings, to the tip of their tool.
    #[staticmethod]
    fn of_settings(python: Python<'_>, settings: NamedSettings) -> PyResult<Self> {
        apart(python, move |_| Ok(Self::of(settings.load()?.robot().chain.clone())))?
    }

    #[getter]
    fn joints(&self) -> usize {
        self.0.joints()
    }

    #[getter]
    fn base(&self) -> &str {
        self.0.ends().0
    }

    #[getter]
    fn tip(&self) -> &str {
        self.0.ends().1
    }

    #[getter]
    fn limits<'py>(&self, python: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        self.0.limits(python)
    }

    fn forward(&self, q: Vec<f64>) -> PyResult<Pose> {
        self.0.forward(&q)
    }

    fn tool_motion(&self, q: Vec<f64>, qd: Vec<f64>, qdd: Vec<f64>) -> PyResult<[[f64; 3]; 3]> {
        self.0.tool_motion(&q, &qd, &qdd)
    }

    fn inverse(
        &self,
        position: [f64; 3],
        axis: [f64; 3],
        spin: Option<[f64; 3]>,
        near: Vec<f64>,
    ) -> PyResult<Option<Vec<f64>>> {
        finite("position", &position)?;
        let axis = direction("axis", axis)?;
        let spin = spin.map(|spin| direction("spin", spin)).transpose()?;
        self.0.inverse(&near, &ToolTarget::at_rest(position.into(), axis, spin))
    }
}

pub fn add(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<Pose>()?;
    module.add_class::<ChainOf>()
}
