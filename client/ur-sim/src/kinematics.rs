//! Kinematics of the simulated arm: nominal Denavit-Hartenberg parameters, an own calibration, the tool's
//! pose.
//!
//! *Source*: the maker's description package, UR5 and UR5e: T_i = Rz(q + θ) Tz(d) Tx(a) Rx(α).

use std::f64::consts::FRAC_PI_2;

use super::options::Series;

/// A 3 × 3 rotation and a place \[m\].
pub type Frame = ([[f64; 3]; 3], [f64; 3]);

/// Denavit-Hartenberg parameters \[rad\], \[m\].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Dh {
    /// \[rad\]
    pub theta: [f64; 6],
    /// \[m\]
    pub a: [f64; 6],
    /// \[m\]
    pub d: [f64; 6],
    /// \[rad\]
    pub alpha: [f64; 6],
}

impl Dh {
    /// Of a UR5 (CB3) or UR5e.
    #[must_use]
    pub const fn nominal(series: Series) -> Self {
        let (a3, d) = match series {
            Series::Cb3 => (-0.39225, [0.089_159, 0.0, 0.0, 0.10915, 0.09465, 0.0823]),
            Series::E => (-0.3922, [0.1625, 0.0, 0.0, 0.1333, 0.0997, 0.0996]),
        };
        let alpha = [FRAC_PI_2, 0.0, 0.0, FRAC_PI_2, -FRAC_PI_2, 0.0];
        Self { theta: [0.0; 6], a: [0.0, -0.425, a3, 0.0, 0.0, 0.0], d, alpha }
    }

    /// Of an arm whose flange is `error_m` off the nominal one at `q` \[rad\]; the same seed, the same arm.
    #[must_use]
    pub fn calibrated(series: Series, error_m: f64, seed: u64, q: &[f64; 6]) -> Self {
        let nominal = Self::nominal(series);
        if !(error_m > 0.0 && error_m.is_finite()) {
            return nominal;
        }
        let mut random = Random(seed);
        // Millimetres and milliradians in the same proportion; 2nd and 3rd d stay: their axes are parallel.
        let draw = |random: &mut Random| std::array::from_fn::<f64, 6, _>(|_| random.within_one() * 1e-3);
        let (theta, a, mut d, alpha) =
            (draw(&mut random), draw(&mut random), draw(&mut random), draw(&mut random));
        for fixed in d.iter_mut().skip(1).take(2) {
            *fixed = 0.0;
        }
        let scaled = |scale: f64| {
            let add = |nominal: &[f64; 6], by: &[f64; 6]| {
                let mut sum = *nominal;
                sum.iter_mut().zip(by).for_each(|(sum, by)| *sum += scale * by);
                sum
            };
            Self {
                theta: add(&nominal.theta, &theta),
                a: add(&nominal.a, &a),
                d: add(&nominal.d, &d),
                alpha: add(&nominal.alpha, &alpha),
            }
        };
        let (_, from) = nominal.flange(q);
        let mut scale = 1.0;
        // Nearly linear: a few steps find the scale.
        for _ in 0..5 {
            let off = distance(&scaled(scale).flange(q).1, &from);
            if off > 0.0 {
                scale *= error_m / off;
            }
        }
        scaled(scale)
    }

    /// The flange in the base frame at `q` \[rad\].
    #[must_use]
    pub fn flange(&self, q: &[f64; 6]) -> Frame {
        self.after(6, q)
    }

    /// The elbow in the base frame at `q` \[rad\]: \[m\].
    #[must_use]
    pub fn elbow(&self, q: &[f64; 6]) -> [f64; 3] {
        self.after(2, q).1
    }

    /// The frame behind the first `joints`.
    fn after(&self, joints: usize, q: &[f64; 6]) -> Frame {
        let mut at = IDENTITY;
        let rows = q.iter().take(joints).zip(&self.theta).zip(&self.a).zip(&self.d).zip(&self.alpha);
        for ((((q, theta), a), d), alpha) in rows {
            let (sin, cos) = (q + theta).sin_cos();
            let (sin_alpha, cos_alpha) = alpha.sin_cos();
            let turn = [
                [cos, -sin * cos_alpha, sin * sin_alpha],
                [sin, cos * cos_alpha, -cos * sin_alpha],
                [0.0, sin_alpha, cos_alpha],
            ];
            at = chain(&at, &(turn, [a * cos, a * sin, *d]));
        }
        at
    }
}

const IDENTITY: Frame = ([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], [0.0; 3]);

/// `second` in the frame `first`.
#[must_use]
pub fn chain(first: &Frame, second: &Frame) -> Frame {
    let (rotation, place) = first;
    let turned = |v: [f64; 3]| rotation.map(|row| dot(&row, &v));
    let (r2, p2) = second;
    let columns = transpose(r2).map(turned);
    let moved = turned(*p2);
    let mut sum = *place;
    sum.iter_mut().zip(moved).for_each(|(sum, by)| *sum += by);
    (transpose(&columns), sum)
}

/// From `before` to `after`, near to each other: way \[m\] and turn about an axis \[rad\], both in the frame
/// that the two are given in. The difference of two rotation vectors is no turn.
#[must_use]
pub fn twist(before: &Frame, after: &Frame) -> [f64; 6] {
    let turn = chain(&(after.0, [0.0; 3]), &(transpose(&before.0), [0.0; 3])).0;
    let [[_, ab, ac], [ba, _, bc], [ca, cb, _]] = turn;
    let ([x, y, z], [bx, by, bz]) = (after.1, before.1);
    [x - bx, y - by, z - bz, 0.5 * (cb - bc), 0.5 * (ac - ca), 0.5 * (ba - ab)]
}

fn transpose(m: &[[f64; 3]; 3]) -> [[f64; 3]; 3] {
    let [[a, b, c], [d, e, f], [g, h, i]] = *m;
    [[a, d, g], [b, e, h], [c, f, i]]
}

fn dot(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn distance(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum::<f64>().sqrt()
}

/// The frame of a pose: place \[m\], rotation vector \[rad\].
#[must_use]
pub fn frame(pose: &[f64; 6]) -> Frame {
    let [x, y, z, rx, ry, rz] = *pose;
    let angle = (rx * rx + ry * ry + rz * rz).sqrt();
    if angle < 1e-12 {
        return (IDENTITY.0, [x, y, z]);
    }
    let (sin, cos) = angle.sin_cos();
    let [kx, ky, kz] = [rx / angle, ry / angle, rz / angle];
    let v = 1.0 - cos;
    let rotation = [
        [cos + kx * kx * v, kx * ky * v - kz * sin, kx * kz * v + ky * sin],
        [ky * kx * v + kz * sin, cos + ky * ky * v, ky * kz * v - kx * sin],
        [kz * kx * v - ky * sin, kz * ky * v + kx * sin, cos + kz * kz * v],
    ];
    (rotation, [x, y, z])
}

/// The pose of a frame.
#[must_use]
pub fn pose(frame: &Frame) -> [f64; 6] {
    let ([[a, b, c], [d, e, f], [g, h, i]], [x, y, z]) = *frame;
    let (u, v, w) = (h - f, c - g, d - b);
    let sin = 0.5 * (u * u + v * v + w * w).sqrt();
    let cos = 0.5 * (a + e + i - 1.0);
    let angle = sin.atan2(cos);
    let [rx, ry, rz] = if sin > 1e-9 {
        [u, v, w].map(|axis| axis * 0.5 / sin * angle)
    } else if cos > 0.0 {
        [0.0; 3]
    } else {
        // Half a turn: the axis stands in the diagonal, its signs beside it.
        let [kx, ky, kz] = [a, e, i].map(|diagonal: f64| (0.5 * (diagonal + 1.0)).max(0.0).sqrt());
        let (sy, sz) = if kx > 1e-6 { (b, c) } else { (1.0, if ky > 1e-6 { f } else { 1.0 }) };
        [kx * angle, ky.copysign(sy) * angle, kz.copysign(sz) * angle]
    };
    [x, y, z, rx, ry, rz]
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
    use crate::options::Options;

    #[test]
    fn flange_stands_where_the_table_says() {
        // Straight out at q = 0: x = a2 + a3, y = −(d4 + d6), z = d1 − d5.
        let (_, p) = Dh::nominal(Series::Cb3).flange(&[0.0; 6]);
        for (is, wanted) in p.iter().zip([-0.81725, -0.19145, -0.005_491]) {
            assert!((is - wanted).abs() < 1e-9, "{p:?}");
        }
    }

    #[test]
    fn poses_come_back_also_at_half_a_turn() {
        for turn in
            [[0.0; 3], [0.3, -1.2, 0.5], [3.0, 0.2, 0.1], [std::f64::consts::PI, 0.0, 0.0], [0.0, 2.2, 2.2]]
        {
            let [rx, ry, rz] = turn;
            let wanted = [0.1, 0.2, 0.3, rx, ry, rz];
            let again = frame(&pose(&frame(&wanted)));
            let first = frame(&wanted);
            for (a, b) in again.0.as_flattened().iter().zip(first.0.as_flattened()) {
                assert!((a - b).abs() < 1e-9, "{turn:?}");
            }
        }
    }

    #[test]
    fn a_calibration_is_off_by_what_was_asked_for_and_the_same_again() {
        let q = Options::new(Series::E).q;
        let arm = Dh::calibrated(Series::E, 0.004, 7, &q);
        let off = distance(&arm.flange(&q).1, &Dh::nominal(Series::E).flange(&q).1);
        assert!((off - 0.004).abs() < 1e-5, "{off}");
        assert_eq!(arm, Dh::calibrated(Series::E, 0.004, 7, &q));
        assert_ne!(arm, Dh::calibrated(Series::E, 0.004, 8, &q));
        assert_eq!(Dh::calibrated(Series::E, 0.0, 7, &q), Dh::nominal(Series::E));
    }
}
