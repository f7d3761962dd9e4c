//! Position, velocity and acceleration of the pen at its newest sample: a parabola through the last samples.

use std::collections::VecDeque;

use nalgebra::{Matrix3, Vector3};

/// More samples than any window holds at 1 kHz would only cost time.
const MOST: usize = 256;

/// Position \[m\], velocity \[m/s\] and acceleration \[m/s²\] of one axis.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct AxisTrend {
    pub(super) position: f64,
    pub(super) velocity: f64,
    pub(super) acceleration: f64,
}

impl AxisTrend {
    /// Under constant acceleration, `later_s` from now.
    pub(super) fn after(&self, later_s: f64) -> Self {
        Self {
            position: self.position + later_s * (self.velocity + 0.5 * later_s * self.acceleration),
            velocity: self.velocity + later_s * self.acceleration,
            acceleration: self.acceleration,
        }
    }
}

/// The samples of the last `window_s`.
#[derive(Debug, Clone)]
pub(super) struct Trend {
    window_s: f64,
    samples: VecDeque<(f64, [f64; 2])>,
}

impl Trend {
    pub(super) fn new(window_s: f64) -> Self {
        Self { window_s, samples: VecDeque::with_capacity(MOST) }
    }

    pub(super) fn clear(&mut self) {
        self.samples.clear();
    }

    /// `t_s` must be later than before, and all finite.
    pub(super) fn push(&mut self, t_s: f64, position: [f64; 2]) {
        self.samples.push_back((t_s, position));
        while self.samples.len() > MOST || self.samples.front().is_some_and(|(t, _)| t_s - t > self.window_s)
        {
            self.samples.pop_front();
        }
    }

    /// Least squares over the window at its newest sample: a parabola through three or more samples, a line
    /// through two, rest with one. `None` without samples.
    pub(super) fn fit(&self) -> Option<[AxisTrend; 2]> {
        let &(newest, at) = self.samples.back()?;
        let still = at.map(|position| AxisTrend { position, ..AxisTrend::default() });
        let (&(oldest, before), count) = (self.samples.front()?, self.samples.len());
        let span = newest - oldest;
        if count < 2 || !(span > 0.0) {
            return Some(still);
        }
        if count == 2 {
            let mut line = still;
            for (axis, (now, before)) in line.iter_mut().zip(at.into_iter().zip(before)) {
                axis.velocity = (now - before) / span;
            }
            return Some(line);
        }
        // Times in spans, positions from the newest sample: the normal equations stay well conditioned.
        let mut normal = Matrix3::zeros();
        let mut right = [Vector3::zeros(); 2];
        for (t, position) in &self.samples {
            let u = (t - newest) / span;
            let row = Vector3::new(1.0, u, 0.5 * u * u);
            normal += row * row.transpose();
            for (right, (value, origin)) in right.iter_mut().zip(position.iter().zip(at)) {
                *right += row * (value - origin);
            }
        }
        let Some(inverse) = normal.cholesky() else { return Some(still) };
        let mut parabola = still;
        for (axis, right) in parabola.iter_mut().zip(&right) {
            let fitted = inverse.solve(right);
            axis.position += fitted[0];
            axis.velocity = fitted[1] / span;
            axis.acceleration = fitted[2] / (span * span);
        }
        Some(parabola)
    }
}
