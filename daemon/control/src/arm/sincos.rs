//! Sine and cosine of all joints at once, without calls into the C library.
//!
//! Contract: for |x| ≤ 1e5 the error is below 2 units in the last place of 1 (measured in the tests); beyond,
//! and for non-finite x, the standard library answers. Branch-free per element, so that baseline x86-64
//! vectorises it, and the same bits on every machine. *Source*: Cody-Waite reduction by π/2 in three parts;
//! kernel polynomials of fdlibm `k_sin.c`, `k_cos.c` (minimax, |r| ≤ π/4).

use std::f64::consts::FRAC_2_PI;

// π/2 in three parts of 33, 33 and 53 bits (fdlibm `e_rem_pio2.c`): k·part is exact for |k| < 2^20.
const PIO2_1: f64 = 1.570_796_326_734_125_6;
const PIO2_2: f64 = 6.077_100_506_303_966e-11;
const PIO2_3: f64 = 2.022_266_248_795_950_6e-21;

/// Adding and subtracting 1.5·2^52 rounds to the nearest integer; its lowest bits are that integer modulo 4.
const ROUND: f64 = 6_755_399_441_055_744.0;

/// (sines, cosines) of `x` \[rad\].
#[must_use]
pub(super) fn sin_cos<const J: usize>(x: &[f64; J]) -> ([f64; J], [f64; J]) {
    let (mut sines, mut cosines) = ([0.0; J], [0.0; J]);
    let mut ordinary = true;
    for ((x, s), c) in x.iter().zip(&mut sines).zip(&mut cosines) {
        ordinary &= x.abs() <= 1e5;
        let rounded = x * FRAC_2_PI + ROUND;
        let quadrant = rounded.to_bits();
        let k = rounded - ROUND;
        let r = ((x - k * PIO2_1) - k * PIO2_2) - k * PIO2_3;
        let (sine, cosine) = kernels(r);
        // Odd quadrants swap the two; sin is negative in quadrants 2 and 3, cos in 1 and 2.
        let swap = 0u64.wrapping_sub(quadrant & 1);
        let (sine, cosine) = (sine.to_bits(), cosine.to_bits());
        let difference = (sine ^ cosine) & swap;
        *s = f64::from_bits((sine ^ difference) ^ ((quadrant & 2) << 62));
        *c = f64::from_bits((cosine ^ difference) ^ ((quadrant.wrapping_add(1) & 2) << 62));
    }
    if !ordinary {
        for ((x, s), c) in x.iter().zip(&mut sines).zip(&mut cosines) {
            (*s, *c) = x.sin_cos();
        }
    }
    (sines, cosines)
}

/// (sin r, cos r) for |r| ≤ π/4.
fn kernels(r: f64) -> (f64, f64) {
    let z = r * r;
    let s = 8.333_333_333_322_49e-3
        + z * (-1.984_126_982_985_795e-4
            + z * (2.755_731_370_707_006_8e-6
                + z * (-2.505_076_025_340_686_4e-8 + z * 1.589_690_995_211_55e-10)));
    let sine = r + r * z * (-1.666_666_666_666_663_2e-1 + z * s);
    let c = 4.166_666_666_666_66e-2
        + z * (-1.388_888_888_887_411e-3
            + z * (2.480_158_728_947_673e-5
                + z * (-2.755_731_435_139_066_3e-7
                    + z * (2.087_572_321_298_175e-9 + z * -1.135_964_755_778_819_5e-11))));
    let half = 0.5 * z;
    let w = 1.0 - half;
    (sine, w + (((1.0 - w) - half) + z * z * c))
}

#[cfg(test)]
mod tests {
    use super::sin_cos;

    fn worst(xs: impl Iterator<Item = f64>) -> f64 {
        xs.map(|x| {
            let ([sine], [cosine]) = sin_cos(&[x]);
            let (s, c) = x.sin_cos();
            (sine - s).abs().max((cosine - c).abs())
        })
        .fold(0.0, f64::max)
    }

    #[test]
    fn agrees_with_the_standard_library() {
        // Joint range densely, then the whole range in which no fallback helps.
        assert!(worst((0..400_000).map(|i| (f64::from(i) - 200_000.0) * 3.3e-5)) <= f64::EPSILON);
        assert!(worst((0..400_000).map(|i| (f64::from(i) - 200_000.0) * 0.499_999)) <= f64::EPSILON);
    }

    #[test]
    fn right_angles_are_exact_to_rounding() {
        // The argument itself is rounded: half a unit in the last place of 157 is 1.4e-14.
        for k in -100i32..100 {
            let ([sine], [cosine]) = sin_cos(&[f64::from(k) * std::f64::consts::FRAC_PI_2]);
            let expected = [(0.0, 1.0), (1.0, 0.0), (0.0, -1.0), (-1.0, 0.0)][k.rem_euclid(4) as usize];
            assert!((sine - expected.0).abs() < 2e-14 && (cosine - expected.1).abs() < 2e-14, "{k}");
        }
    }

    #[test]
    fn beyond_the_reduction_the_standard_library_answers() {
        for x in [1e5 + 1.0, -1e300, f64::MAX] {
            let ([sine], [cosine]) = sin_cos(&[x]);
            assert_eq!((sine, cosine), x.sin_cos());
        }
        let (sines, _) = sin_cos(&[1.0, f64::NAN, f64::INFINITY]);
        assert!(sines[0] == 1.0f64.sin() && sines[1].is_nan() && sines[2].is_nan());
    }
}
