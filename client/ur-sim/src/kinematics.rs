//! Kinematics of the simulated arm: nominal Denavit-Hartenberg parameters, an own calibration.
//!
//! *Source*: the maker's description package, UR5 and UR5e.

use std::f64::consts::FRAC_PI_2;

use foretrace_ur::bridge::kinematics::DhParameters;

use super::options::Series;

/// Of a UR5 (CB3) or UR5e.
#[must_use]
pub const fn nominal(series: Series) -> DhParameters {
    let (a3, d) = match series {
        Series::Cb3 => (-0.39225, [0.089_159, 0.0, 0.0, 0.10915, 0.09465, 0.0823]),
        Series::E => (-0.3922, [0.1625, 0.0, 0.0, 0.1333, 0.0997, 0.0996]),
    };
    let alpha = [FRAC_PI_2, 0.0, 0.0, FRAC_PI_2, -FRAC_PI_2, 0.0];
    DhParameters { theta: [0.0; 6], a: [0.0, -0.425, a3, 0.0, 0.0, 0.0], d, alpha }
}

/// Of an arm whose flange is `error_m` off the nominal one at `q` \[rad\]; the same seed, the same arm.
#[must_use]
pub fn calibrated(series: Series, error_m: f64, seed: u64, q: &[f64; 6]) -> DhParameters {
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
        DhParameters {
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
        let at = |arm: &DhParameters| arm.flange(&q).translation.vector;
        let off = (at(&arm) - at(&nominal(Series::E))).norm();
        assert!((off - 0.004).abs() < 1e-5, "{off}");
        assert_eq!(arm, calibrated(Series::E, 0.004, 7, &q));
        assert_ne!(arm, calibrated(Series::E, 0.004, 8, &q));
        assert_eq!(calibrated(Series::E, 0.0, 7, &q), nominal(Series::E));
    }
}
