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
//! moving farther out. A loop that lost periods lately has the same rows for the point where the joints come
//! to rest by themselves if no further command comes, and for where the tool turns back on the way there.
//! After the command is made, its forward kinematics are judged: beyond the margin and farther out than
//! before, the loop latches a stop.
//!
//! Contract: no allocation, bounded work, no panic. The only memory is how far outside the tool was when it
//! was armed, and what was lost. A tick whose wanted velocities satisfy all rows is unchanged bit for bit.

mod judge;
mod rows;
mod settings;

use crate::state::state;
pub use judge::EnvelopeFigures;
pub(crate) use rows::fastest_stoppable;
pub use settings::{EnvelopeError, EnvelopeSettings};

use nalgebra::Vector3;

use crate::arm::limits::longest;
use crate::arm::{Chain, JointLimits, Kinematics};
use crate::plane::Plane;
use crate::units::Stamp;
use judge::Allowed;

/// Rows lie this fraction of the margin outside the workspace; the rest is for what they cannot prevent.
const ROW_SHARE: f64 = 0.5;
/// How long after a gap the next one is expected \[ns\].
const EXPECTED_NS: u64 = 10_000_000_000;
/// Where more than this share of the time is lost, up to so many gaps are expected in a row, with one tick
/// between them.
const LOSS_BORNE: f64 = 1.0 / 3.0;
const MOST_GAPS: f64 = 3.0;
/// A tilt beyond its limit by this much, and a speed by this share, latch a stop.
const TILT_MARGIN_RAD: f64 = 0.03;
const SPEED_MARGIN: f64 = 0.1;

/// What the loop missed lately: a machine that took periods away will do so again.
#[derive(Debug, Clone, Copy, Default)]
struct Gaps {
    last: Stamp,
    expected_until: Stamp,
    /// How long the arm may go on by itself before a command changes that \[s\]; `None`: no gap is expected.
    expected_s: Option<f64>,
    /// Time lost beyond what one gap at a time explains \[s\].
    owed_s: f64,
}

state! { [] Gaps { last, expected_until, expected_s, owed_s } }

/// The envelope of one arm.
#[derive(Debug, Clone)]
pub struct Envelope<const J: usize> {
    chain: Chain<J>,
    plane: Plane,
    limits: JointLimits<J>,
    /// Lowest and highest position along the plane's axes for the rows, and for the stop \[m\].
    inner: [[f64; 2]; 3],
    outer: [[f64; 2]; 3],
    tilt: f64,
    speed: f64,
    /// Turns a distance that silence leads into a speed \[1/s\].
    rate: f64,
    allowed: Allowed,
    gaps: Gaps,
}

state! {
    [const J: usize] Envelope<J> { allowed, gaps }
    fixed { chain, plane, limits, inner, outer, tilt, speed, rate }
}

impl<const J: usize> Envelope<J> {
    /// Around `workspace` \[m\], \[lowest, highest\] along the axes of `plane`. `fastest`: the speed that the
    /// plan may ask for \[m/s\].
    ///
    /// # Errors
    /// A number outside its range.
    pub fn new(
        settings: &EnvelopeSettings,
        chain: &Chain<J>,
        plane: Plane,
        workspace: [[f64; 2]; 3],
        fastest: f64,
        limits: &JointLimits<J>,
    ) -> Result<Self, EnvelopeError> {
        settings.validate()?;
        let wider = |by: f64| workspace.map(|[low, high]| [low - by, high + by]);
        Ok(Self {
            chain: chain.clone(),
            plane,
            limits: *limits,
            inner: wider(ROW_SHARE * settings.margin_m),
            outer: wider(settings.margin_m),
            tilt: settings.max_tilt_rad,
            speed: settings.max_speed_mps.unwrap_or(fastest),
            rate: 1.0 / (limits.hold_s() + longest(limits.velocity(), limits.deceleration())),
            allowed: Allowed::default(),
            gaps: Gaps::default(),
        })
    }

    /// Takes in that a tick begins at `now`, and that none came for `lost_ns` before it. Once per tick.
    pub fn tick(&mut self, now: Stamp, lost_ns: u64) {
        let Gaps { last, expected_until, expected_s, owed_s } = &mut self.gaps;
        if lost_ns > 0 {
            *expected_until = now.plus_ns(EXPECTED_NS);
        }
        *owed_s += lost_ns as f64 * 1e-9 - LOSS_BORNE * now.seconds_since(*last);
        // A consumer goes on for `hold_s` by itself, and again after a command between two gaps, which brakes
        // for one period only.
        let hold_s = self.limits.hold_s();
        *owed_s = owed_s.max(0.0).min(MOST_GAPS * hold_s);
        *expected_s = (now < *expected_until).then_some(owed_s.max(hold_s));
        *last = now;
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
