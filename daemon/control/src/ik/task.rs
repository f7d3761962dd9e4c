//! What the tool should do next, as a least-squares cost over joint velocities.
//!
//! Contract: pure, no allocation. Linear rows in the base frame \[m/s\]; angular rows in the tool frame,
//! multiplied by a length so that they are metres per second too. The rotation about the tool axis is a
//! separate task with a small weight: an arm of 6 joints then has as many rows as joints, so the small weight
//! distorts nothing while no limit is active.

use nalgebra::{Matrix3, SMatrix, SVector, Vector3, Vector6};

use crate::arm::chain::Kinematics;

/// Tilt of the tool from which rotations have full weight \[rad\].
pub const FULL_TILT_RAD: f64 = 0.15;

/// Target of the tool for one step, in the base frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ToolTarget {
    /// Wanted tool origin at the instant of the last command \[m\].
    pub position: Vector3<f64>,
    /// Wanted mean velocity of the tool origin over the step \[m/s\]: (next − now) / dt.
    pub velocity: Vector3<f64>,
    /// Wanted direction of the tool's z axis, a unit vector: against the plane's normal.
    pub axis: Vector3<f64>,
    /// Direction of the tool's x axis, seen along the tool axis; `None` only stops the spin.
    pub spin: Option<Vector3<f64>>,
}

impl ToolTarget {
    /// A pose to stay at.
    #[must_use]
    pub const fn at_rest(position: Vector3<f64>, axis: Vector3<f64>, spin: Option<Vector3<f64>>) -> Self {
        Self { position, velocity: Vector3::new(0.0, 0.0, 0.0), axis, spin }
    }
}

/// Weights and gains of one IK step. All finite, lengths and gains positive.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct IkSettings<const J: usize> {
    /// K: fraction of the pose error removed per second \[1/s\], at most 1/dt.
    pub gain_hz: f64,
    /// Length that makes a rotation comparable with a displacement \[m\].
    pub orientation_m: f64,
    /// Weight of position errors along the wanted tool axis relative to those across it, at least 1: where
    /// joints cannot satisfy both, the tip leaves the line rather than the paper.
    pub normal_weight: f64,
    /// Weight of rotations relative to displacements of a point `orientation_m` away, at most 1: where joints
    /// cannot satisfy both, the tool tilts a little and the tip stays on the line. Applies to an upright
    /// tool; it grows to 1 at [`FULL_TILT_RAD`].
    pub tilt_weight: f64,
    /// Weight of the rotation about the tool axis relative to the other two, 0 to 1.
    pub spin_weight: f64,
    /// Damping far from singularities \[m²\]; relative velocity error about damping/σ².
    pub damping_floor_m2: f64,
    /// Damping at a singularity \[m²\].
    pub damping_peak_m2: f64,
    /// Distance to singularities (see [`singularity`]) below which damping grows \[m\].
    pub singular_m: f64,
    /// Fastest correction of a position error \[m/s\].
    pub correction_mps: f64,
    /// Corrections are slowed so that they can end with this deceleration \[m/s²\].
    pub correction_mps2: f64,
    /// Pull towards `home` \[m²\], for arms with more joints than the task; 0 for none.
    pub posture_weight_m2: f64,
    /// Rate of that pull \[1/s\].
    pub posture_hz: f64,
    /// Joint positions of that pull \[rad\].
    pub home: [f64; J],
}

impl<const J: usize> IkSettings<J> {
    /// Settings for a control period of `period_s` \[s\] around the joint positions `home` \[rad\].
    #[must_use]
    pub fn for_period(period_s: f64, home: [f64; J]) -> Self {
        Self {
            gain_hz: 0.5 / period_s,
            orientation_m: 0.1,
            normal_weight: 10.0,
            tilt_weight: 0.2,
            spin_weight: 0.1,
            damping_floor_m2: 1e-9,
            damping_peak_m2: 1e-3,
            singular_m: 0.02,
            correction_mps: 0.25,
            correction_mps2: 2.0,
            posture_weight_m2: if J > 6 { 1e-7 } else { 0.0 },
            posture_hz: 1.0,
            home,
        }
    }
}

/// Hessian and gradient of half the cost, and the terms that they consist of.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Task<const J: usize> {
    /// H = AᵀA + (λ + μ)·1, J x J \[m²\].
    pub h: SMatrix<f64, J, J>,
    /// g = −Aᵀb − μ·q̇_home, J.
    pub g: SVector<f64, J>,
    /// A: weighted Jacobian, 6 x J \[m/rad\]. Rows: linear x, y, z (base), scaled along the wanted tool axis;
    /// angular x, y, z (tool) times lengths and weights.
    pub rows: SMatrix<f64, 6, J>,
    /// b: weighted velocities wanted, 6 \[m/s\].
    pub wanted: Vector6<f64>,
    /// Weight that rotations have in `rows` and `wanted`.
    pub tilt_weight: f64,
    /// λ \[m²\].
    pub damping: f64,
    /// Distance to the nearest singularity \[m\].
    pub singularity: f64,
}

/// Assembles min ‖A q̇ − b‖² + λ‖q̇‖² + μ‖q̇ − q̇_home‖² for a step of `elapsed` seconds.
///
/// `kinematics` belongs to `q` \[rad\], the position last commanded with velocity `qd` \[rad/s\]. b =
/// velocity + correction of the pose error − ½·elapsed·J̇q̇: the last term removes the bending of the path
/// within the step, which a linear model leaves behind.
#[must_use]
pub fn assemble<const J: usize>(
    kinematics: &Kinematics<J>,
    q: &[f64; J],
    qd: &[f64; J],
    target: &ToolTarget,
    settings: &IkSettings<J>,
    elapsed: f64,
) -> Task<J> {
    let length = settings.orientation_m;
    let tool = &kinematics.rotation;
    let bending = kinematics.jacobian_dot_qd(qd) * (0.5 * elapsed);
    let error = target.position - kinematics.position;
    let linear = target.velocity
        + corrected(&error, settings.gain_hz, settings.correction_mps, settings.correction_mps2)
        - bending.fixed_rows::<3>(0);
    // Rotations are corrected like displacements of a point `length` away.
    let turn = tool.tr_mul(&orientation_error(tool, &target.axis, target.spin.as_ref())) * length;
    let bent = tool.tr_mul(&bending.fixed_rows::<3>(3)) * length;
    let mut angular =
        corrected(&turn, settings.gain_hz, settings.correction_mps, settings.correction_mps2) - bent;
    angular.z *= settings.spin_weight;

    let mut rows = SMatrix::<f64, 6, J>::zeros();
    rows.fixed_rows_mut::<3>(0).copy_from(&kinematics.jacobian.fixed_rows::<3>(0));
    let scale = Matrix3::from_diagonal(&Vector3::new(length, length, length * settings.spin_weight));
    rows.fixed_rows_mut::<3>(3)
        .copy_from(&((scale * tool.transpose()) * kinematics.jacobian.fixed_rows::<3>(3)));

    let singularity = singularity(&rows, settings.damping_floor_m2);
    let stretch = stretch(&target.axis, settings.normal_weight);
    let across = rows.fixed_rows::<3>(0).into_owned();
    rows.fixed_rows_mut::<3>(0).copy_from(&(stretch * across));
    let linear = stretch * linear;
    let tilt_weight = tilt_weight(settings.tilt_weight, tool, &target.axis);
    rows.fixed_rows_mut::<3>(3).scale_mut(tilt_weight);
    angular *= tilt_weight;
    let wanted = Vector6::new(linear.x, linear.y, linear.z, angular.x, angular.y, angular.z);

    let damping = damping(singularity, settings);
    let mut h = rows.tr_mul(&rows);
    let mut g = -rows.tr_mul(&wanted);
    let posture = settings.posture_weight_m2;
    for (i, column) in h.data.0.iter_mut().enumerate() {
        if let Some(diagonal) = column.get_mut(i) {
            *diagonal += damping + posture;
        }
    }
    if posture > 0.0 {
        for (g, (home, q)) in g.iter_mut().zip(settings.home.iter().zip(q)) {
            *g -= posture * settings.posture_hz * (home - q);
        }
    }
    Task { h, g, rows, wanted, tilt_weight, damping, singularity }
}

/// `upright` if the tool's z is along `axis`, 1 from [`FULL_TILT_RAD`] on, smooth in between.
fn tilt_weight(upright: f64, tool: &Matrix3<f64>, axis: &Vector3<f64>) -> f64 {
    let z = tool.column(2);
    let ratio2 = (z - axis).norm_squared() / (FULL_TILT_RAD * FULL_TILT_RAD);
    upright + (1.0 - upright) * (ratio2 * ratio2).min(1.0)
}

/// Scales by `factor` along the unit vector `axis` and by 1 across it: 1 + (factor − 1) axis axisᵀ.
#[must_use]
pub fn stretch(axis: &Vector3<f64>, factor: f64) -> Matrix3<f64> {
    Matrix3::identity() + axis * axis.transpose() * (factor - 1.0)
}

/// A cheap measure of the distance to singularities, smooth in q: (tr (A₅A₅ᵀ + floor)⁻¹)^(−½) \[m\].
///
/// A₅ are the rows of position and tool axis. With σ_min the smallest singular value of A₅ it lies between
/// σ_min/√5 and σ_min (up to the floor).
#[must_use]
#[expect(
    clippy::indexing_slicing,
    clippy::needless_range_loop,
    reason = "every index runs over 0..5 of a [_; 5] or over rows of a 6 x J matrix"
)]
pub fn singularity<const J: usize>(rows: &SMatrix<f64, 6, J>, floor: f64) -> f64 {
    let mut gram = [[0.0; 5]; 5];
    for column in &rows.data.0 {
        for i in 0..5 {
            for j in 0..=i {
                gram[i][j] += column[i] * column[j];
            }
        }
    }
    // LDLᵀ instead of Cholesky avoids square roots. Then tr(G⁻¹) = Σ_i ‖row i of L⁻¹‖² / d_i.
    let mut inverse_factor = [[0.0; 5]; 5];
    let mut trace = 0.0;
    for i in 0..5 {
        inverse_factor[i][i] = 1.0;
        let reciprocal = 1.0 / (gram[i][i] + floor).max(0.5 * floor);
        let mut norm = 0.0;
        for k in 0..=i {
            norm += inverse_factor[i][k] * inverse_factor[i][k];
        }
        trace += norm * reciprocal;
        for row in i + 1..5 {
            let factor = gram[row][i] * reciprocal;
            for j in i + 1..=row {
                gram[row][j] -= factor * gram[j][i];
            }
            for k in 0..=i {
                inverse_factor[row][k] -= factor * inverse_factor[i][k];
            }
        }
    }
    1.0 / trace.sqrt()
}

/// Floor + peak·(1 − (s/s₀)²)² inside s₀: the value and its slope are continuous.
fn damping<const J: usize>(singularity: f64, settings: &IkSettings<J>) -> f64 {
    let ratio = singularity / settings.singular_m;
    let inside = (1.0 - ratio * ratio).max(0.0);
    settings.damping_floor_m2 + settings.damping_peak_m2 * inside * inside
}

/// Velocity that removes `error`: K·e when small, the braking profile √(2·a·|e|) when larger, at most
/// `v_max`.
fn corrected(error: &Vector3<f64>, gain: f64, v_max: f64, a_max: f64) -> Vector3<f64> {
    let distance = error.norm();
    let limit = v_max.min((2.0 * a_max * distance).sqrt());
    if gain * distance <= limit { error * gain } else { error * (limit / distance) }
}

/// Remaining rotation \[rad\] in the base frame: tilt of the tool's z onto `axis`, then spin of its x towards
/// `spin`.
fn orientation_error(tool: &Matrix3<f64>, axis: &Vector3<f64>, spin: Option<&Vector3<f64>>) -> Vector3<f64> {
    let (x, z): (Vector3<f64>, Vector3<f64>) = (tool.column(0).into_owned(), tool.column(2).into_owned());
    let tilt = turn_between(&z, axis, &x);
    match spin {
        // Only the component across the tool axis, which spin can correct.
        Some(direction) => {
            let across = direction - z * z.dot(direction);
            // Fades out as the direction approaches the tool axis, where it does not define the spin.
            tilt + turn_between(&x, &(across / across.norm().max(0.1)), &z)
        }
        None => tilt,
    }
}

/// The rotation from unit vector `from` onto `to`: length sin θ up to a right angle, 2 − sin θ beyond (times
/// the length of `to`, so that both are continuous); `spare` is the axis used at θ = π, where any axis is
/// valid.
fn turn_between(from: &Vector3<f64>, to: &Vector3<f64>, spare: &Vector3<f64>) -> Vector3<f64> {
    let turn = from.cross(to);
    if from.dot(to) >= 0.0 {
        return turn;
    }
    let (sine, whole) = (turn.norm(), to.norm());
    if sine > 1e-9 { turn * ((2.0 * whole - sine) / sine) } else { spare * (2.0 * whole) }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Rotation3, Unit};
    use std::f64::consts::{FRAC_PI_2, PI};

    use super::*;

    #[test]
    fn a_turn_is_as_long_as_it_is_far_and_about_the_axis_that_takes_it_there() {
        let (from, about) = (Vector3::x(), Vector3::new(0.0, 0.6, 0.8));
        for length in [1.0, 0.3] {
            for angle in [0.0, 0.3, 1.0, FRAC_PI_2, 2.0, 3.0] {
                let to = Rotation3::from_axis_angle(&Unit::new_unchecked(about), angle) * from * length;
                let turn = turn_between(&from, &to, &Vector3::z());
                let far = if angle <= FRAC_PI_2 { angle.sin() } else { 2.0 - angle.sin() };
                assert!((turn - about * (far * length)).norm() < 1e-12, "{angle} {length}: {turn}");
            }
            let back = turn_between(&from, &(-from * length), &Vector3::z());
            assert!((back - Vector3::z() * (2.0 * length)).norm() < 1e-12, "{length}: {back}");
        }
    }

    /// The spin error is largest at half a turn; a direction along the tool axis gives none.
    #[test]
    fn tilt_and_spin_are_mended_together() {
        let tool = Matrix3::identity();
        let error = |axis, spin: Option<Vector3<f64>>| orientation_error(&tool, &axis, spin.as_ref());
        assert_eq!(error(Vector3::z(), None), Vector3::zeros());
        let tilted = Vector3::new(0.0, 0.1_f64.sin(), 0.1_f64.cos());
        let tilt = Vector3::new(-(0.1_f64.sin()), 0.0, 0.0);
        assert!((error(tilted, None) - tilt).norm() < 1e-15);
        for angle in [-2.5, -0.4, 0.7, PI] {
            // Only the direction seen along the tool axis counts, however much it leans.
            let spun = error(tilted, Some(Vector3::new(angle.cos(), angle.sin(), 0.5)));
            let far = if angle.abs() < FRAC_PI_2 { angle.sin() } else { angle.signum() * 2.0 - angle.sin() };
            assert!((spun - tilt - Vector3::z() * far).norm() < 1e-9, "{angle}: {spun}");
        }
        // A direction along the tool axis fades out: 0.05 across it counts half.
        let faint = error(Vector3::z(), Some(Vector3::new(0.0, 0.05, 1.0)));
        assert!((faint - Vector3::z() * 0.5).norm() < 1e-12, "{faint}");
    }

    #[test]
    fn corrections_end_with_their_deceleration_and_never_outrun_the_gain() {
        let along = Vector3::new(0.0, -0.6, 0.8);
        for (error, speed) in [
            // K e, √(2 a e), and the fastest.
            (0.001, 0.02),
            (0.01, 0.2),
            (0.02, (2.0 * 2.0 * 0.02_f64).sqrt()),
            (0.04, 0.4),
            (1.0, 0.45),
        ] {
            let v = corrected(&(along * error), 20.0, 0.45, 2.0);
            assert!((v - along * speed).norm() < 1e-12, "{error} m: {v}");
        }
        assert_eq!(corrected(&Vector3::zeros(), 20.0, 0.45, 2.0), Vector3::zeros());
    }

    #[test]
    fn rotations_weigh_more_with_the_tilt_and_damping_with_the_singularity() {
        let weight =
            |tilt: f64| tilt_weight(0.2, &Matrix3::identity(), &Vector3::new(tilt.sin(), 0.0, tilt.cos()));
        assert_eq!((weight(0.0), weight(0.2), weight(2.0)), (0.2, 1.0, 1.0));
        // At half of the full tilt, a sixteenth of the increase.
        assert!((weight(0.5 * FULL_TILT_RAD) - (0.2 + 0.8 / 16.0)).abs() < 1e-3, "{}", weight(0.075));
        let settings = IkSettings::for_period(0.002, [0.0; 6]);
        let IkSettings { damping_floor_m2: floor, damping_peak_m2: peak, singular_m, .. } = settings;
        for (share, inside) in [(0.0, 1.0), (0.5, 0.5625), (1.0, 0.0), (3.0, 0.0)] {
            let found = damping(share * singular_m, &settings);
            assert!((found - floor - peak * inside).abs() < 1e-15, "{share}: {found}");
        }
    }
}
