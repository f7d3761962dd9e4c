//! Whether the tip stays above the paper on a path in joint space. The paper is always checked, whatever the
//! settings keep clear of.
//!
//! Checked at a thousand points. Between two of them the tip moves by a few millimetres, over which its
//! height differs by less than [`ROUNDING_M`] from linear interpolation.
//!
//! Contract: pure, no allocation, one forward kinematics per check. Absent: the table around the workspace,
//! which only `[clearance]` knows.

use crate::arm::Chain;
use crate::clearance::{Obstructed, Way, WayCheck};
use crate::follower::{FollowerSettings, WayBlocked};
use crate::plane::Plane;
use crate::state::state;

const LOOKS: u32 = 1000;
/// An arm that was stopped in the paper may leave it from this depth \[m\].
const DEEPEST_M: f64 = 0.02;
const ROUNDING_M: f64 = 1e-4;

/// The paper, and how far a path over it was checked.
#[derive(Debug, Clone)]
pub(super) struct Paper {
    plane: Plane,
    /// Along the plane's axes \[m\].
    workspace: [[f64; 2]; 3],
    looked: u32,
    /// Lowest tip allowed \[m\], plane frame.
    lowest: f64,
}

state! { [] Paper { looked, lowest } fixed { plane, workspace } }

impl Paper {
    pub(super) fn new<const J: usize>(settings: &FollowerSettings<J>) -> Self {
        let workspace = settings.mpc.limits().map(|axis| axis.position_m);
        let [_, _, [lowest, _]] = workspace;
        Self { plane: settings.plane, workspace, looked: 0, lowest }
    }

    /// Begins to check a path.
    pub(super) fn begin(&mut self) {
        self.looked = 0;
    }

    /// Checks one more point of `way`.
    pub(super) fn look<const J: usize>(&mut self, chain: &Chain<J>, way: &Way<J>) -> WayCheck {
        let share = f64::from(self.looked) / f64::from(LOOKS);
        let tip = self.plane.point_from_base(&chain.forward(&way.at(share)).position);
        let [across @ .., [low, _]] = self.workspace;
        if self.looked == 0 {
            self.lowest = low.min(tip.z.max(low - DEEPEST_M)) - ROUNDING_M;
        }
        let over = across.iter().zip(tip.iter()).all(|([low, high], at)| (low..=high).contains(&at));
        if over && !(tip.z >= self.lowest) {
            return WayCheck::Blocked(Obstructed { pair: WayBlocked::PAPER, share, distance_m: tip.z });
        }
        if self.looked >= LOOKS {
            return WayCheck::Clear;
        }
        self.looked += 1;
        WayCheck::SoFar
    }
}
