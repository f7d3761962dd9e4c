//! Position of the tip of the preset `ur5`'s pen, computed independently from measured joints.
//!
//! Contract: shares no code with the control law: Denavit-Hartenberg parameters of the UR5, the preset's pen
//! and plane are defined here. Keeps extremes, never alters.

use foretrace_shm::JOINTS;
use serde_json::{Value, json};

/// a, d \[m\] and α \[rad\] of each link. Source: Universal Robots, "DH parameters for calculations of
/// kinematics and dynamics", UR5.
const LINKS: [[f64; 3]; JOINTS] = [
    [0.0, 0.089159, QUARTER],
    [-0.425, 0.0, 0.0],
    [-0.39225, 0.0, 0.0],
    [0.0, 0.10915, QUARTER],
    [0.0, 0.09465, -QUARTER],
    [0.0, 0.0823, 0.0],
];
const QUARTER: f64 = std::f64::consts::FRAC_PI_2;
/// `robot.tool_m`: the tip lies on the flange's z axis \[m\].
const PEN: f64 = 0.15;
/// `plane.origin_m`; its x is the base's −y, its y the base's x, its normal the base's z.
const ORIGIN: [f64; 3] = [0.5526, 0.1092, 0.0683];
/// `plane.workspace_m` in the plane: half of its length along x and y \[m\].
const HALF: [f64; 2] = [0.15, 0.1];

/// Extremes of the tip so far; none before the first joints.
#[derive(Debug, Default)]
pub struct Tip {
    /// Lowest and greatest height over the paper \[m\], farthest outside the workspace \[m\], largest tilt
    /// \[rad\].
    extremes: Option<[f64; 4]>,
}

/// x, y and height in the plane \[m\], and the angle between the pen and the plane's normal \[rad\].
fn place(q: &[f64; JOINTS]) -> ([f64; 3], f64) {
    // The tip's position and the pen's axis, carried from the last link back to the base.
    let (mut tip, mut axis) = ([0.0, 0.0, PEN], [0.0, 0.0, 1.0]);
    for (angle, [a, d, alpha]) in q.iter().zip(LINKS).rev() {
        let ((s, c), (sin, cos)) = (angle.sin_cos(), alpha.sin_cos());
        let turned = |[x, y, z]: [f64; 3]| {
            let (y, z) = (y * cos - z * sin, y * sin + z * cos);
            [x * c - y * s, x * s + y * c, z]
        };
        let [x, y, z] = turned(tip);
        tip = [x + a * c, y + a * s, z + d];
        axis = turned(axis);
    }
    let [x, y, z] = [0, 1, 2].map(|i| tip[i] - ORIGIN[i]);
    ([-y, x, z], (-axis[2]).clamp(-1.0, 1.0).acos())
}

impl Tip {
    /// Takes in an arm that was measured at `q` \[rad\].
    pub fn see(&mut self, q: &[f64; JOINTS]) {
        let ([x, y, height], tilt) = place(q);
        let [over_x, over_y] = [(x, HALF[0]), (y, HALF[1])].map(|(at, half)| (at.abs() - half).max(0.0));
        let outside = over_x.hypot(over_y);
        let [low, high, farthest, steepest] = self.extremes.unwrap_or([height, height, outside, tilt]);
        self.extremes = Some([low.min(height), high.max(height), farthest.max(outside), steepest.max(tilt)]);
    }

    /// The extremes; null before the first joints.
    #[must_use]
    pub fn report(&self) -> Value {
        self.extremes.map_or(Value::Null, |[low, high, outside, tilt]| {
            json!({ "height_min_m": low, "height_max_m": high, "outside_max_m": outside,
                "tilt_max_rad": tilt })
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `robot.home_rad` puts the pen upright over the middle of the paper, 6 mm up.
    #[test]
    fn home_is_over_the_middle_of_the_paper_with_the_pen_upright() {
        let ([x, y, height], tilt) = place(&[2.0 * QUARTER, -1.3, 1.8, -2.0708, -QUARTER, 0.0]);
        assert!(x.abs() < 2e-3 && y.abs() < 2e-3, "{x} {y}");
        assert!((0.0..0.02).contains(&height) && tilt < 1e-3, "{height} {tilt}");
    }

    /// Worked by hand, all joints zero: the links lie along x, the pen along −y.
    #[test]
    fn zero_pose_is_the_one_worked_by_hand() {
        let ([x, y, height], tilt) = place(&[0.0; JOINTS]);
        let base = [y + ORIGIN[0], ORIGIN[1] - x, height + ORIGIN[2]];
        let expected = [-0.81725, -(0.10915 + 0.0823 + PEN), 0.089159 - 0.09465];
        assert!(base.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-12), "{base:?}");
        assert!((tilt - QUARTER).abs() < 1e-12);
    }
}
