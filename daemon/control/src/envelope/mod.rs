//! The tool's envelope: bounds on workspace, height over the paper, tilt and speed, independent of the plan.
//!
//! Two halves. Before the joints move, rows on their velocities (in the IK's QP, and in stops): along the
//! direction n towards a bound,
//!
//!   nᵀJ q̇ + ½h·nᵀJ̇q̇ ≤ v,     v: the fastest from which the tool is at rest before the bound,
//!
//! with half of the deceleration that the joint limits give there, ½ Σ_j |nᵀJ_j| a_j (half, because several
//! bounds may be active and the Jacobian changes meanwhile). Joint limits are the QP's box and hard;
//! clearance rows have the higher price, then the envelope, then the task. Outside a bound, rows only forbid
//! moving farther out. After the command is made, its forward kinematics are judged: beyond the margin and
//! farther out than before, the loop latches a stop.
//!
//! Contract: no allocation, bounded work, no panic. The only memory is how far outside the tool was when it
//! was armed. A tick whose wanted velocities satisfy all rows is unchanged bit for bit.

mod judge;
mod rows;
mod settings;

use crate::state::state;
pub use judge::EnvelopeFigures;
pub use settings::{EnvelopeError, EnvelopeSettings};

use nalgebra::Vector3;

use crate::arm::{JointLimits, Kinematics};
use crate::plane::Plane;
use judge::Allowed;

/// Rows lie this fraction of the margin outside the workspace; the rest is for what they cannot prevent.
const ROW_SHARE: f64 = 0.5;
/// A tilt beyond its limit by this much, and a speed by this share, latch a stop.
const TILT_MARGIN_RAD: f64 = 0.03;
const SPEED_MARGIN: f64 = 0.1;

/// The envelope of one arm.
#[derive(Debug, Clone)]
pub struct Envelope<const J: usize> {
    plane: Plane,
    limits: JointLimits<J>,
    /// Lowest and highest position along the plane's axes for the rows, and for the stop \[m\].
    inner: [[f64; 2]; 3],
    outer: [[f64; 2]; 3],
    tilt: f64,
    speed: f64,
    allowed: Allowed,
}

state! { [const J: usize] Envelope<J> { allowed } fixed { plane, limits, inner, outer, tilt, speed } }

impl<const J: usize> Envelope<J> {
    /// Around `workspace` \[m\], \[lowest, highest\] along the axes of `plane`. `fastest`: the speed that the
    /// plan may ask for \[m/s\].
    ///
    /// # Errors
    /// A number outside its range.
    pub fn new(
        settings: &EnvelopeSettings,
        plane: Plane,
        workspace: [[f64; 2]; 3],
        fastest: f64,
        limits: &JointLimits<J>,
    ) -> Result<Self, EnvelopeError> {
        settings.validate()?;
        let wider = |by: f64| workspace.map(|[low, high]| [low - by, high + by]);
        Ok(Self {
            plane,
            limits: *limits,
            inner: wider(ROW_SHARE * settings.margin_m),
            outer: wider(settings.margin_m),
            tilt: settings.max_tilt_rad,
            speed: settings.max_speed_mps.unwrap_or(fastest),
            allowed: Allowed::default(),
        })
    }

    /// The angle between tool and normal \[rad\], its sine, and the axis about which a turn tilts it farther.
    fn tilted(&self, kinematics: &Kinematics<J>) -> (f64, Vector3<f64>) {
        let tool: Vector3<f64> = kinematics.rotation.column(2).into_owned();
        let down = self.plane.tool_axis();
        let across = down.cross(&tool);
        let sine = across.norm();
        let angle = sine.atan2(down.dot(&tool));
        (angle, if sine > 1e-9 { across / sine } else { Vector3::zeros() })
    }
}
