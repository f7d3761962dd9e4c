//! A Kalman filter of constant acceleration per axis, one gain for both, over samples at any rate.
//!
//! Contract: O(1) per sample, no allocation, total. It restarts after a silence and after a non-finite
//! sample.

use crate::estimate::LawParameters;
use crate::state::state;

/// State and covariance of the filter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct MotionFilter {
    /// Initial standard deviations of position, velocity and acceleration, in units of a sample's noise.
    first: [f64; 3],
    /// After a longer silence the velocity is unknown \[s\].
    forget_after_s: f64,
    /// Process noise: change of acceleration per sample over the noise of its position \[1/s²\].
    change: f64,
    /// Time of the newest sample \[s\]; `None` before the first.
    newest_s: Option<f64>,
    /// Position \[m\], velocity \[m/s\], acceleration \[m/s²\] per axis.
    axes: [[f64; 3]; 2],
    /// Covariance in units of a sample's noise.
    covariance: [[f64; 3]; 3],
}

state! { [] MotionFilter { change, newest_s, axes, covariance } fixed { first, forget_after_s } }

impl MotionFilter {
    /// Before the first sample; `change`: of the acceleration from sample to sample \[1/s²\], in units of a
    /// sample's noise.
    pub(super) const fn new(change: f64, law: &LawParameters) -> Self {
        Self {
            first: [1.0, law.filter_velocity, law.filter_acceleration],
            forget_after_s: law.filter_forget_s,
            change,
            newest_s: None,
            axes: [[0.0; 3]; 2],
            covariance: [[0.0; 3]; 3],
        }
    }

    pub(super) fn forget(&mut self) {
        self.newest_s = None;
    }

    /// A sample at `position` \[m\] and `time_s`; a repeated or older one is ignored.
    pub(super) fn see(&mut self, time_s: f64, position: [f64; 2]) {
        let elapsed_s = self.newest_s.map_or(f64::INFINITY, |newest_s| time_s - newest_s);
        if elapsed_s <= 0.0 {
            return;
        }
        self.newest_s = Some(time_s);
        if !(elapsed_s <= self.forget_after_s) {
            self.begin(position);
            return;
        }
        self.advance(elapsed_s);
        let [[variance, along_v, along_a], ..] = self.covariance;
        let gains = [variance, along_v, along_a].map(|cross| cross / (variance + 1.0));
        for (axis, measured) in self.axes.iter_mut().zip(position) {
            let [x, ..] = *axis;
            for (state, gain) in axis.iter_mut().zip(gains) {
                *state += gain * (measured - x);
            }
        }
        let [row, ..] = self.covariance;
        for (entries, gain) in self.covariance.iter_mut().zip(gains) {
            for (entry, first) in entries.iter_mut().zip(row) {
                *entry -= gain * first;
            }
        }
        let sound =
            self.axes.as_flattened().iter().chain(self.covariance.as_flattened()).all(|v| v.is_finite());
        if !sound {
            self.begin(position);
        }
    }

    /// Velocity \[m/s\] and acceleration \[m/s²\] at the newest sample.
    pub(super) fn motion(&self) -> [[f64; 2]; 2] {
        let [[_, vx, ax], [_, vy, ay]] = self.axes;
        [[vx, vy], [ax, ay]]
    }

    /// State and covariance `dt` later: P ← A P Aᵀ + g gᵀ, g = \[½dt², dt, 1\] · change.
    fn advance(&mut self, dt: f64) {
        let half = 0.5 * dt * dt;
        for [x, v, a] in &mut self.axes {
            *x += dt * *v + half * *a;
            *v += dt * *a;
        }
        let [[pp, pv, pa], [_, vv, va], [_, _, aa]] = self.covariance;
        // Rows of A P, then their products with the rows of A.
        let [xp, xv, xa] = [pp + dt * pv + half * pa, pv + dt * vv + half * va, pa + dt * va + half * aa];
        let [yv, ya] = [vv + dt * va, va + dt * aa];
        let [gx, gv, ga] = [half * self.change, dt * self.change, self.change];
        let (pp, pv, pa) = (xp + dt * xv + half * xa + gx * gx, xv + dt * xa + gx * gv, xa + gx * ga);
        let (vv, va, aa) = (yv + dt * ya + gv * gv, ya + gv * ga, aa + ga * ga);
        self.covariance = [[pp, pv, pa], [pv, vv, va], [pa, va, aa]];
    }

    fn begin(&mut self, position: [f64; 2]) {
        self.axes = position.map(|x| [x, 0.0, 0.0]);
        self.covariance = [[0.0; 3]; 3];
        for ((i, row), deviation) in self.covariance.iter_mut().enumerate().zip(self.first) {
            if let Some(diagonal) = row.get_mut(i) {
                *diagonal = deviation * deviation;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Matrix3, Matrix3x2, RowVector2, Vector3};

    use super::*;

    const SHIPPED: &LawParameters = &LawParameters::SHIPPED;

    #[test]
    fn a_steady_acceleration_is_found_at_any_rate() {
        for rate_hz in [60.0, 133.0, 1000.0] {
            let mut filter = MotionFilter::new(3e4, SHIPPED);
            let at = |t: f64| [0.1 * t + 0.5 * 3.0 * t * t, 0.2 - 0.3 * t];
            for k in 0..400 {
                let t = 5.0 + f64::from(k) / rate_hz;
                filter.see(t, at(t - 5.0));
            }
            let t = 399.0 / rate_hz;
            let [[vx, vy], [ax, ay]] = filter.motion();
            assert!(
                (vx - (0.1 + 3.0 * t)).abs() < 1e-3 && (vy + 0.3).abs() < 1e-3,
                "{rate_hz} Hz: {vx} {vy}"
            );
            assert!((ax - 3.0).abs() < 1e-2 && ay.abs() < 1e-2, "{rate_hz} Hz: {ax} {ay}");
        }
    }

    #[test]
    fn two_samples_tell_a_velocity_and_no_acceleration() {
        for (change, rate_hz) in [(3e3, 60.0), (3e3, 100.0), (3e3, 200.0), (3e4, 200.0)] {
            let mut filter = MotionFilter::new(change, SHIPPED);
            filter.see(1.0, [0.02, -0.01]);
            filter.see(1.0 + 1.0 / rate_hz, [0.02 + 0.3 / rate_hz, -0.01]);
            let [[vx, vy], [ax, ay]] = filter.motion();
            let ahead_s = 0.05;
            let way = ahead_s * vx + 0.5 * ahead_s * ahead_s * ax;
            assert!((way / (0.3 * ahead_s) - 1.0).abs() < 0.25, "{change} at {rate_hz} Hz: {way} m");
            assert_eq!([vy, ay], [0.0; 2]);
        }
    }

    #[test]
    fn silence_and_numbers_that_are_none_start_anew() {
        let mut filter = MotionFilter::new(3e4, SHIPPED);
        for k in 0..50 {
            filter.see(0.01 * f64::from(k), [0.01 * f64::from(k), 0.0]);
        }
        let moving = filter.motion();
        assert!((moving[0][0] - 1.0).abs() < 1e-3, "{moving:?}");
        filter.see(0.49, [9.0, 9.0]);
        assert_eq!(filter.motion(), moving, "an old sample changes nothing");
        filter.see(0.70, [0.49, 0.0]);
        assert_eq!(filter.motion(), [[0.0; 2]; 2]);
        filter.see(0.71, [f64::NAN, 0.0]);
        filter.see(0.72, [0.5, 0.0]);
        filter.see(0.73, [0.5, 0.0]);
        assert!(filter.motion().as_flattened().iter().all(|v| v.is_finite()));
        filter.see(f64::NAN, [0.5, 0.0]);
        filter.see(0.74, [0.5, 0.0]);
        assert!(filter.motion().as_flattened().iter().all(|v| v.is_finite()));
    }

    /// Textbook form: x ← A x, P ← A P Aᵀ + g gᵀ; K = P Hᵀ/(H P Hᵀ + 1).
    #[test]
    fn states_and_covariances_are_those_of_the_filter_in_matrices() {
        let change = 2e4;
        let mut filter = MotionFilter::new(change, SHIPPED);
        let (mut state, mut covariance) = (Matrix3x2::zeros(), Matrix3::zeros());
        let mut time_s: f64 = 7.0;
        for k in 0..60 {
            let elapsed_s = [0.005, 0.0081, 0.0166, 0.002][k % 4];
            time_s += elapsed_s;
            let t = time_s - 7.0;
            let position = [0.02 * (17.0 * t).sin(), 0.01 * (23.0 * t).cos() + 1e-4 * (k as f64).sin()];
            filter.see(time_s, position);
            let measured = RowVector2::from(position);
            if k == 0 {
                state.set_row(0, &measured);
                covariance = Matrix3::from_diagonal(&Vector3::new(1.0, 1e6, 9e8));
            } else {
                let half = 0.5 * elapsed_s * elapsed_s;
                let later = Matrix3::new(1.0, elapsed_s, half, 0.0, 1.0, elapsed_s, 0.0, 0.0, 1.0);
                let pushed = Vector3::new(half, elapsed_s, 1.0) * change;
                state = later * state;
                covariance = later * covariance * later.transpose() + pushed * pushed.transpose();
                let gain = covariance.column(0) / (covariance.m11 + 1.0);
                state += gain * (measured - state.row(0));
                covariance -= gain * covariance.row(0).into_owned();
            }
            for (axis, expected) in filter.axes.iter().zip(state.column_iter()) {
                let size = [0.02, 0.5, 10.0];
                for ((found, expected), size) in axis.iter().zip(expected.iter()).zip(size) {
                    assert!((found - expected).abs() < 1e-7 * size, "{k}: {found} {expected}");
                }
            }
            for (i, row) in filter.covariance.iter().enumerate() {
                for (j, found) in row.iter().enumerate() {
                    let size = (covariance[(i, i)] * covariance[(j, j)]).sqrt();
                    assert!((found - covariance[(i, j)]).abs() < 1e-7 * size, "{k}: {found} {i} {j}");
                }
            }
            let [[vx, vy], [ax, ay]] = filter.motion();
            assert_eq!([[vx, ax], [vy, ay]], filter.axes.map(|[_, v, a]| [v, a]));
        }
    }
}
