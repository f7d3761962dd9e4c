//! The 1€ filter: a low-pass whose cut-off grows with speed. Little jitter at rest, little lag in motion.
//!
//! Source: Casiez, Roussel, Vogel, "1€ Filter: A Simple Speed-based Low-pass Filter for Noisy Input in
//! Interactive Systems", CHI 2012, equations 1 to 6 and appendix A. Code of our own. Per axis, as is usual
//! for positions.

use std::f64::consts::TAU;

use super::OneEuroKnobs;

/// Two axes of the filter.
#[derive(Debug, Clone, Copy)]
pub struct OneEuro {
    knobs: OneEuroKnobs,
    /// Filtered position \[m\] and filtered speed \[m/s\] per axis; `None` before the first value.
    axes: Option<[OneEuroAxis; 2]>,
}

#[derive(Debug, Clone, Copy)]
struct OneEuroAxis {
    position: f64,
    speed: f64,
}

impl OneEuro {
    /// A filter without samples.
    #[must_use]
    pub fn new(knobs: OneEuroKnobs) -> Self {
        Self { knobs, axes: None }
    }

    /// Forgets everything and stands at `position` \[m\].
    pub fn restart(&mut self, position: [f64; 2]) {
        self.axes = Some(position.map(|position| OneEuroAxis { position, speed: 0.0 }));
    }

    /// Filters `position` \[m\], which came `elapsed_s` after the last one; the first passes unchanged.
    pub fn step(&mut self, elapsed_s: f64, position: [f64; 2]) -> [f64; 2] {
        let Some(mut axes) = self.axes.filter(|_| elapsed_s > 0.0) else {
            self.restart(position);
            return position;
        };
        for (axis, x) in axes.iter_mut().zip(position) {
            // The appendix takes the speed from the last *filtered* value.
            let speed = (x - axis.position) / elapsed_s;
            axis.speed += share(self.knobs.speed_cutoff_hz, elapsed_s) * (speed - axis.speed);
            let cutoff_hz = self.knobs.min_cutoff_hz + self.knobs.beta_hz_per_mps * axis.speed.abs();
            axis.position += share(cutoff_hz, elapsed_s) * (x - axis.position);
        }
        self.axes = Some(axes);
        axes.map(|axis| axis.position)
    }

    /// The newest filtered position \[m\].
    #[must_use]
    pub fn position(&self) -> Option<[f64; 2]> {
        self.axes.map(|axes| axes.map(|axis| axis.position))
    }
}

/// α = 1 / (1 + τ/Te), τ = 1/(2πf).
fn share(cutoff_hz: f64, elapsed_s: f64) -> f64 {
    let w = TAU * cutoff_hz * elapsed_s;
    if w.is_finite() { w / (1.0 + w) } else { 1.0 }
}
