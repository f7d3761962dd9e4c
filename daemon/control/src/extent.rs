//! Where a tool has been: height over the paper, distance outside the workspace, tilt. For tests and reports,
//! not for the law.
//!
//! Contract: pure, no allocation; forward kinematics of the joints that it is given, measured or commanded.
//! Non-finite joints are ignored. A run is judged by comparing an [`Extent`] with [`ExtentBounds`].

use std::fmt;

use nalgebra::Vector3;

use crate::arm::Chain;
use crate::follower::FollowerSettings;
use crate::plane::Plane;

/// Extremes of a tool since the start of the watch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Extent {
    /// Lowest and greatest height of the tip over the paper \[m\].
    pub height_m: [f64; 2],
    /// Farthest outside the workspace in the plane, 0 inside \[m\].
    pub outside_m: f64,
    /// Largest angle between the tool's axis and the plane's normal \[rad\].
    pub tilt_rad: f64,
}

/// How far a measured tool may be beyond the envelope of the commanded one: \[m\] and \[rad\]. A critically
/// damped servo does not overshoot; this allows for noise and stamps.
const TOLERANCE_M: f64 = 1e-3;
const TOLERANCE_RAD: f64 = 0.05;

/// Bounds of a tool, from the settings.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ExtentBounds {
    /// Lowest and greatest height over the paper \[m\].
    pub height_m: [f64; 2],
    /// Farthest outside the workspace in the plane \[m\].
    pub outside_m: f64,
    /// Largest tilt \[rad\].
    pub tilt_rad: f64,
}

impl ExtentBounds {
    /// The bounds of `settings` for an arm that was armed inside its workspace.
    #[must_use]
    pub fn of<const J: usize>(settings: &FollowerSettings<J>) -> Self {
        let [.., [low, high]] = settings.mpc.axes.map(|axis| axis.position_m);
        let margin = settings.safety.envelope.margin_m + TOLERANCE_M;
        Self {
            height_m: [low - margin, high + margin],
            outside_m: margin,
            tilt_rad: settings.safety.envelope.max_tilt_rad + TOLERANCE_RAD,
        }
    }

    /// The first bound that `extent` violates.
    #[must_use]
    pub fn broken_by(&self, extent: &Extent) -> Option<Breach> {
        let ([low, high], [lowest, highest]) = (extent.height_m, self.height_m);
        let breach = |what, amount, limit, unit| Some(Breach { what, amount, limit, unit });
        if !(low >= lowest) {
            breach("lowest height over the paper", low * 1e3, lowest * 1e3, "mm")
        } else if !(high <= highest) {
            breach("greatest height over the paper", high * 1e3, highest * 1e3, "mm")
        } else if !(extent.outside_m <= self.outside_m) {
            breach("distance outside the workspace", extent.outside_m * 1e3, self.outside_m * 1e3, "mm")
        } else if !(extent.tilt_rad <= self.tilt_rad) {
            breach("tilt of the tool", extent.tilt_rad, self.tilt_rad, "rad")
        } else {
            None
        }
    }
}

/// A bound that the tool has violated.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Breach {
    /// Name of the number, as in the message.
    pub what: &'static str,
    /// The value that was observed.
    pub amount: f64,
    /// The bound that it violates.
    pub limit: f64,
    /// Unit of both values, as in the message.
    pub unit: &'static str,
}

impl fmt::Display for Breach {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { what, amount, limit, unit } = self;
        write!(f, "{what} {amount:.2} {unit}, limit {limit:.2} {unit}")
    }
}

/// Watches the tool of one arm.
#[derive(Debug, Clone)]
pub struct ExtentWatch<const J: usize> {
    chain: Chain<J>,
    plane: Plane,
    /// Lowest and highest x and y of the workspace \[m\].
    workspace: [[f64; 2]; 2],
    extent: Option<Extent>,
}

impl<const J: usize> ExtentWatch<J> {
    /// A watch over the arm, plane and workspace of `settings`.
    #[must_use]
    pub fn new(settings: &FollowerSettings<J>) -> Self {
        let [x, y, _] = settings.mpc.axes.map(|axis| axis.position_m);
        Self { chain: settings.chain.clone(), plane: settings.plane, workspace: [x, y], extent: None }
    }

    /// Forgets all observations, not the bounds.
    pub fn restart(&mut self) {
        self.extent = None;
    }

    /// Observes an arm at `q` \[rad\].
    pub fn see(&mut self, q: &[f64; J]) {
        let kinematics = self.chain.forward(q);
        let tip: Vector3<f64> = self.plane.point_from_base(&kinematics.position);
        let along = kinematics.rotation.column(2).dot(&self.plane.tool_axis());
        if !(tip.iter().all(|x| x.is_finite()) && along.is_finite()) {
            return;
        }
        let [x, y] = self.workspace;
        let beyond = |value: f64, [low, high]: [f64; 2]| (value - high).max(low - value).max(0.0);
        let outside_m = beyond(tip.x, x).hypot(beyond(tip.y, y));
        let tilt_rad = along.clamp(-1.0, 1.0).acos();
        let Extent { height_m: [low, high], outside_m: farthest, tilt_rad: steepest } =
            self.extent.unwrap_or(Extent { height_m: [tip.z; 2], outside_m, tilt_rad });
        self.extent = Some(Extent {
            height_m: [low.min(tip.z), high.max(tip.z)],
            outside_m: farthest.max(outside_m),
            tilt_rad: steepest.max(tilt_rad),
        });
    }

    /// The extremes; `None` before the first joints.
    #[must_use]
    pub const fn extent(&self) -> Option<Extent> {
        self.extent
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Rotation3;

    use super::*;

    const UR5: &str = include_str!("../../../config/robots/ur5.urdf");

    /// The plane lies at the tool of the upright arm, tilted against it by `tilt` about x.
    fn watch(tilt: f64) -> (ExtentWatch<6>, [f64; 6]) {
        let chain = Chain::from_urdf(UR5, None, None).unwrap();
        let q = [0.0, -1.3, 1.8, -2.0708, -std::f64::consts::FRAC_PI_2, 0.0];
        let kinematics = chain.forward(&q);
        let normal = -kinematics.rotation.column(2);
        let turned = Rotation3::from_matrix_unchecked(kinematics.rotation);
        let plane = Plane {
            origin: kinematics.position,
            rotation: turned * Rotation3::from_euler_angles(std::f64::consts::PI + tilt, 0.0, 0.0),
            pen_scale: 1.0,
            pen_origin: [0.0; 2],
            lift_height: 0.01,
            press_depth: 0.0,
        };
        if tilt == 0.0 {
            assert!((plane.rotation * Vector3::z() - normal).norm() < 1e-9);
        }
        (ExtentWatch { chain, plane, workspace: [[-0.01, 0.01]; 2], extent: None }, q)
    }

    #[test]
    fn heights_excess_and_tilt_are_those_of_the_joints_shown() {
        let (mut seen, q) = watch(0.2);
        assert_eq!(seen.extent(), None);
        seen.see(&q);
        let at = seen.extent().unwrap();
        assert!((at.tilt_rad - 0.2).abs() < 1e-9 && at.outside_m == 0.0, "{at:?}");
        assert!(at.height_m.iter().all(|height| height.abs() < 1e-12), "{at:?}");
        seen.see(&[f64::NAN; 6]);
        assert_eq!(seen.extent(), Some(at));
    }

    #[test]
    fn each_bound_is_told_when_it_breaks_and_none_otherwise() {
        let bounds = ExtentBounds { height_m: [-0.002, 0.06], outside_m: 0.002, tilt_rad: 0.3 };
        let good = Extent { height_m: [-0.001, 0.05], outside_m: 0.0, tilt_rad: 0.1 };
        assert_eq!(bounds.broken_by(&good), None);
        for (extent, words) in [
            (
                Extent { height_m: [-0.0401, 0.05], ..good },
                "lowest height over the paper -40.10 mm, limit -2.00 mm",
            ),
            (
                Extent { height_m: [0.0, 0.0611], ..good },
                "greatest height over the paper 61.10 mm, limit 60.00 mm",
            ),
            (Extent { outside_m: 0.095, ..good }, "distance outside the workspace 95.00 mm, limit 2.00 mm"),
            (Extent { tilt_rad: 0.4, ..good }, "tilt of the tool 0.40 rad, limit 0.30 rad"),
        ] {
            assert_eq!(bounds.broken_by(&extent).unwrap().to_string(), words);
        }
        assert!(bounds.broken_by(&Extent { outside_m: f64::NAN, ..good }).is_some());
    }

    #[test]
    fn extremes_grow_in_each_direction_and_stay() {
        let (mut seen, q) = watch(0.0);
        let base = seen.plane.origin;
        let mut shifted = |by: [f64; 3]| {
            // Moving the plane moves the tool the other way.
            seen.plane.origin = base - seen.plane.vector_to_base(&by.into());
            seen.see(&q);
            seen.extent().unwrap()
        };
        shifted([0.0, 0.0, 0.004]);
        shifted([0.013, 0.0, -0.003]);
        shifted([-0.013, -0.014, 0.0]);
        let at = shifted([0.0; 3]);
        let [low, high] = at.height_m;
        assert!((low + 0.003).abs() < 1e-9 && (high - 0.004).abs() < 1e-9, "{at:?}");
        assert!((at.outside_m - 0.003_f64.hypot(0.004)).abs() < 1e-9, "{at:?}");
    }
}
