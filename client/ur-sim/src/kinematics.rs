//! Kinematics of the simulated arm: nominal Denavit-Hartenberg parameters, an own calibration, the frames.
//!
//! The bridge has its own, so that neither can hide an error of the other.
//!
//! *Source*: the maker's description package, UR5 and UR5e: T_i = Rz(q + θ) Tz(d) Tx(a) Rx(α).

use std::f64::consts::FRAC_PI_2;

use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};

use super::options::Series;

/// Position limits \[rad\]: 363 degrees.
pub const POSITION_LIMIT_RAD: f64 = 6.336;

/// Denavit-Hartenberg parameters of the simulated arm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ArmDh {
    /// \[rad\]
    pub theta: [f64; 6],
    /// \[m\]
    pub a: [f64; 6],
    /// \[m\]
    pub d: [f64; 6],
    /// \[rad\]
    pub alpha: [f64; 6],
}

impl ArmDh {
    /// The flange in the base frame at `q` \[rad\].
    #[must_use]
    pub fn flange(&self, q: &[f64; 6]) -> Isometry3<f64> {
        self.after(6, q)
    }

    /// The elbow in the base frame at `q` \[rad\]: \[m\].
    #[must_use]
    pub fn elbow(&self, q: &[f64; 6]) -> Vector3<f64> {
        self.after(2, q).translation.vector
    }

    /// The frame behind the first `joints`, by the matrix of the convention.
    fn after(&self, joints: usize, q: &[f64; 6]) -> Isometry3<f64> {
        let rows = q.iter().take(joints).zip(&self.theta).zip(&self.a).zip(&self.d).zip(&self.alpha);
        rows.fold(Isometry3::identity(), |at, ((((q, theta), a), d), alpha)| {
            let (sin, cos) = (q + theta).sin_cos();
            let (sin_alpha, cos_alpha) = alpha.sin_cos();
            let turn = Rotation3::from_matrix_unchecked(Matrix3::new(
                cos,
                -sin * cos_alpha,
                sin * sin_alpha,
                sin,
                cos * cos_alpha,
                -cos * sin_alpha,
                0.0,
                sin_alpha,
                cos_alpha,
            ));
            let turn = UnitQuaternion::from_rotation_matrix(&turn);
            at * Isometry3::from_parts(Translation3::new(a * cos, a * sin, *d), turn)
        })
    }
}

/// Of a UR5 (CB3) or UR5e.
#[must_use]
pub const fn nominal(series: Series) -> ArmDh {
    let (a3, d) = match series {
        Series::Cb3 => (-0.39225, [0.089_159, 0.0, 0.0, 0.10915, 0.09465, 0.0823]),
        Series::E => (-0.3922, [0.1625, 0.0, 0.0, 0.1333, 0.0997, 0.0996]),
    };
    let alpha = [FRAC_PI_2, 0.0, 0.0, FRAC_PI_2, -FRAC_PI_2, 0.0];
    ArmDh { theta: [0.0; 6], a: [0.0, -0.425, a3, 0.0, 0.0, 0.0], d, alpha }
}

/// Of an arm whose flange is `error_m` off the nominal one at `q` \[rad\]; the same seed, the same arm.
#[must_use]
pub fn calibrated(series: Series, error_m: f64, seed: u64, q: &[f64; 6]) -> ArmDh {
    let nominal = nominal(series);
    if !(error_m > 0.0 && error_m.is_finite()) {
        return nominal;
    }
    let mut random = Random(seed);
    // Millimetres and milliradians in the same proportion; 2nd and 3rd d stay: their axes are parallel.
    let mut draw = || std::array::from_fn::<f64, 6, _>(|_| random.within_one() * 1e-3);
    let (theta, a, mut d, alpha) = (draw(), draw(), draw(), draw());
    d.iter_mut().skip(1).take(2).for_each(|fixed| *fixed = 0.0);
    let scaled = |scale: f64| {
        let add = |nominal: &[f64; 6], by: &[f64; 6]| {
            let mut sum = *nominal;
            sum.iter_mut().zip(by).for_each(|(sum, by)| *sum += scale * by);
            sum
        };
        ArmDh {
            theta: add(&nominal.theta, &theta),
            a: add(&nominal.a, &a),
            d: add(&nominal.d, &d),
            alpha: add(&nominal.alpha, &alpha),
        }
    };
    let from = nominal.flange(q).translation.vector;
    let mut scale = 1.0;
    // Nearly linear: a few steps find the scale.
    for _ in 0..5 {
        let off = (scaled(scale).flange(q).translation.vector - from).norm();
        if off > 0.0 {
            scale *= error_m / off;
        }
    }
    scaled(scale)
}

/// Numbers for a calibration (splitmix64).
struct Random(u64);

impl Random {
    fn within_one(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::options::ControllerOptions;

    #[test]
    fn flange_stands_where_the_table_says() {
        // Straight out at q = 0: x = a2 + a3, y = −(d4 + d6), z = d1 − d5.
        let at = nominal(Series::Cb3).flange(&[0.0; 6]).translation.vector;
        for (is, wanted) in at.iter().zip([-0.81725, -0.19145, -0.005_491]) {
            assert!((is - wanted).abs() < 1e-9, "{at:?}");
        }
    }

    #[test]
    fn a_calibration_is_off_by_what_was_asked_for_and_the_same_again() {
        let q = ControllerOptions::new(Series::E).q;
        let arm = calibrated(Series::E, 0.004, 7, &q);
        let at = |arm: &ArmDh| arm.flange(&q).translation.vector;
        let off = (at(&arm) - at(&nominal(Series::E))).norm();
        assert!((off - 0.004).abs() < 1e-5, "{off}");
        assert_eq!(arm, calibrated(Series::E, 0.004, 7, &q));
        assert_ne!(arm, calibrated(Series::E, 0.004, 8, &q));
        assert_eq!(calibrated(Series::E, 0.0, 7, &q), nominal(Series::E));
    }
}
