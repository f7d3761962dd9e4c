//! Adam, the learning rate over the steps, and a limit on the gradient's length.
//!
//! Adam exactly as `torch.optim.Adam`: m <- b1 m + (1-b1) g; v <- b2 v + (1-b2) g^2;
//! p <- p - rate/(1-b1^n) m / (sqrt(v)/sqrt(1-b2^n) + eps), n from 1 (Kingma and Ba 2015, algorithm 1).

use super::real::Real;

#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AdamSettings {
    /// Decay of the mean gradient.
    pub beta1: f64,
    /// Decay of the mean square.
    pub beta2: f64,
    /// Keeps the quotient finite.
    pub epsilon: f64,
}

impl Default for AdamSettings {
    fn default() -> Self {
        Self { beta1: 0.9, beta2: 0.999, epsilon: 1e-8 }
    }
}

#[derive(Debug, Clone, PartialEq)]
pub struct Adam<F> {
    settings: AdamSettings,
    /// Steps made so far.
    pub step: u64,
    /// Running mean of the gradient.
    pub mean: Vec<F>,
    /// Running mean of its square.
    pub square: Vec<F>,
}

impl<F: Real> Adam<F> {
    /// Before the first step, for `count` parameters.
    #[must_use]
    pub fn new(settings: AdamSettings, count: usize) -> Self {
        Self { settings, step: 0, mean: vec![F::default(); count], square: vec![F::default(); count] }
    }

    /// One step along `gradient` at `rate`.
    pub fn update(&mut self, rate: f64, parameters: &mut [F], gradient: &[F]) {
        let AdamSettings { beta1, beta2, epsilon } = self.settings;
        self.step += 1;
        let steps = self.step as f64;
        let stride = rate / (1.0 - beta1.powf(steps));
        let root = (1.0 - beta2.powf(steps)).sqrt();
        let moments = self.mean.iter_mut().zip(&mut self.square);
        for ((p, g), (mean, square)) in parameters.iter_mut().zip(gradient).zip(moments) {
            *mean = F::of(beta1) * *mean + F::of(1.0 - beta1) * *g;
            *square = F::of(beta2) * *square + F::of(1.0 - beta2) * *g * *g;
            let length = square.wide().sqrt() / root + epsilon;
            *p = *p - F::of(stride * mean.wide() / length);
        }
    }
}

/// Learning rate over a whole training.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Schedule {
    Constant {
        rate: f64,
    },
    /// Up along a cosine from peak/25, then down along another to peak/25e4 (Smith 2017, PyTorch's
    /// `OneCycleLR`).
    OneCycle {
        peak: f64,
        /// Share of the steps until the peak, in (0, 1).
        warm_up: f64,
    },
}

impl Schedule {
    /// The rate of step `n` (from 0) of `total`.
    #[must_use]
    pub fn rate(&self, n: u64, total: u64) -> f64 {
        match *self {
            Self::Constant { rate } => rate,
            Self::OneCycle { peak, warm_up } => {
                let start = peak / 25.0;
                // The last step of either leg reaches its end.
                let top = warm_up * total as f64 - 1.0;
                let last = total as f64 - 1.0;
                let n = n as f64;
                let (from, to, share) = if n <= top {
                    (start, peak, n / top.max(1.0))
                } else {
                    (peak, start / 1e4, (n - top) / (last - top).max(1.0))
                };
                let share = share.clamp(0.0, 1.0);
                to + (from - to) / 2.0 * (1.0 + (std::f64::consts::PI * share).cos())
            }
        }
    }
}

/// Shortens `gradient` to `limit` if it is longer, as `torch.nn.utils.clip_grad_norm_`; returns its length
/// before.
pub fn limit_norm<F: Real>(gradient: &mut [F], limit: f64) -> f64 {
    let norm = gradient.iter().map(|g| g.wide() * g.wide()).sum::<f64>().sqrt();
    let factor = limit / (norm + 1e-6);
    if factor < 1.0 {
        for g in gradient {
            *g = *g * F::of(factor);
        }
    }
    norm
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_cycle_starts_low_peaks_after_the_warm_up_and_ends_near_zero() {
        let schedule = Schedule::OneCycle { peak: 1e-2, warm_up: 0.3 };
        let rates: Vec<f64> = (0..100).map(|n| schedule.rate(n, 100)).collect();
        assert!((rates[0] - 4e-4).abs() < 1e-12);
        // torch.optim.lr_scheduler.OneCycleLR(max_lr=1e-2, total_steps=100, pct_start=0.3) at steps 10, 29,
        // 60, 99.
        for (n, expected) in [(10, 2.951_639_484_641e-3), (29, 1e-2), (60, 5.892_800_902_856e-3), (99, 4e-8)]
        {
            assert!((rates[n] - expected).abs() < 1e-14, "step {n}: {} {expected}", rates[n]);
        }
    }

    #[test]
    fn a_long_gradient_keeps_its_direction_and_a_short_one_its_length() {
        let mut long = [3.0_f64, 4.0];
        assert!((limit_norm(&mut long, 1.0) - 5.0).abs() < 1e-12);
        assert!((long[0] - 0.6).abs() < 1e-6 && (long[1] - 0.8).abs() < 1e-6);
        let mut short = [0.3_f64, 0.4];
        limit_norm(&mut short, 1.0);
        assert_eq!(short, [0.3, 0.4]);
    }
}
