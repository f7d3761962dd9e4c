//! One stroke of the sigma-lognormal model: lognormal speed along a circular arc.
//!
//! Speed |v(t)| = D Λ(t; t₀, μ, σ²), direction φ(t) = θ_s + (θ_e − θ_s) F(t), with F the distribution
//! function of Λ. The integral has a closed form, so positions are exact at any time. Source: O'Reilly &
//! Plamondon, "Development of a Sigma-Lognormal representation for on-line signatures", Pattern Recognition
//! 42 (2009), equations 1-4.

/// A stroke; lengths in em, times in seconds, angles in radians.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Lognormal {
    /// Length of the arc, D.
    pub(super) length: f64,
    /// Time of the command, t₀.
    pub(super) onset_s: f64,
    /// Log time delay, μ.
    pub(super) mu: f64,
    /// Log response time, σ.
    pub(super) sigma: f64,
    /// Direction at the start, θ_s.
    pub(super) start_rad: f64,
    /// Angle turned on the way, θ_e − θ_s; counter-clockwise positive.
    pub(super) bend_rad: f64,
}

impl Lognormal {
    /// The arc from `from` to `to` that turns by `bend_rad`; onset 0, timing as given.
    pub(super) fn between(from: [f64; 2], to: [f64; 2], bend_rad: f64, mu: f64, sigma: f64) -> Self {
        let (dx, dy) = (to[0] - from[0], to[1] - from[1]);
        let half = bend_rad / 2.0;
        let stretch = if half.abs() < 1e-6 { 1.0 } else { half / half.sin() };
        let start_rad = dy.atan2(dx) - half;
        Self { length: dx.hypot(dy) * stretch, onset_s: 0.0, mu, sigma, start_rad, bend_rad }
    }

    /// The μ for which the stroke takes `seconds` from 2 % to 98 % of its way.
    pub(super) fn mu_for(seconds: f64, sigma: f64) -> f64 {
        (seconds / (2.0 * (TAIL * sigma).sinh())).ln()
    }

    /// When the stroke has done Φ(z) of its way \[s\].
    pub(super) fn time_at(&self, z: f64) -> f64 {
        self.onset_s + (self.mu + self.sigma * z).exp()
    }

    /// Direction at the end \[rad\].
    pub(super) fn end_rad(&self) -> f64 {
        self.start_rad + self.bend_rad
    }

    /// Displacement until `t_s`, from (0, 0).
    pub(super) fn displacement(&self, t_s: f64) -> [f64; 2] {
        let since = t_s - self.onset_s;
        if since <= 0.0 {
            return [0.0; 2];
        }
        let share = normal_share((since.ln() - self.mu) / self.sigma);
        // Chord of the arc turned so far: stable also for straight strokes.
        let half = self.bend_rad * share / 2.0;
        let sinc = if half.abs() < 1e-6 { 1.0 } else { half.sin() / half };
        let chord = self.length * share * sinc;
        let direction = self.start_rad + half;
        [chord * direction.cos(), chord * direction.sin()]
    }
}

/// z with Φ(z) = 98 %.
pub(super) const TAIL: f64 = 2.054;

/// Φ(z), the share of a normal distribution below z, to about 1e-7.
///
/// Source: Press et al., Numerical Recipes, 2nd ed., section 6.2 (Chebyshev fit of erfc).
fn normal_share(z: f64) -> f64 {
    const FIT: [f64; 10] = [
        -1.265_512_23,
        1.000_023_68,
        0.374_091_96,
        0.096_784_18,
        -0.186_288_06,
        0.278_868_07,
        -1.135_203_98,
        1.488_515_87,
        -0.822_152_23,
        0.170_872_77,
    ];
    let x = z.abs() / std::f64::consts::SQRT_2;
    let t = 1.0 / (1.0 + 0.5 * x);
    let series = FIT.iter().rev().fold(0.0, |sum, c| sum * t + c);
    let tail = 0.5 * t * (series - x * x).exp();
    if z > 0.0 { 1.0 - tail } else { tail }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn normal_share_has_the_tabulated_values() {
        for (z, share) in [(0.0, 0.5), (1.0, 0.841_344_746), (-1.96, 0.024_997_895), (3.0, 0.998_650_102)] {
            assert!((normal_share(z) - share).abs() < 2e-7, "{z}");
        }
    }

    #[test]
    fn a_stroke_goes_from_target_to_target() {
        for bend in [0.0, 1.2, -2.9] {
            let s = Lognormal::between([0.1, 0.2], [-0.3, 0.9], bend, -1.5, 0.25);
            let [x, y] = s.displacement(1e3);
            assert!((x + 0.4).abs() < 1e-9 && (y - 0.7).abs() < 1e-9, "bend {bend}: {x} {y}");
        }
    }

    #[test]
    fn speed_is_lognormal_along_the_arc() {
        let (mu, sigma) = (-1.5, 0.3);
        let s = Lognormal::between([0.0; 2], [1.0, 0.0], 1.5, mu, sigma);
        for t in [0.1, 0.2, 0.3, 0.5_f64] {
            let h = 1e-4;
            let (a, b) = (s.displacement(t - h), s.displacement(t + h));
            let speed = (b[0] - a[0]).hypot(b[1] - a[1]) / (2.0 * h);
            let z = (t.ln() - mu) / sigma;
            let exact = s.length * (-z * z / 2.0).exp() / (sigma * t * std::f64::consts::TAU.sqrt());
            // The fit of erfc is good to 1e-7, divided by the 2e-4 s of the difference.
            assert!((speed - exact).abs() < 2e-3, "{t}: {speed} {exact}");
        }
    }

    #[test]
    fn two_to_ninety_eight_percent_takes_the_time_asked_for() {
        let mu = Lognormal::mu_for(0.2, 0.3);
        let s = Lognormal::between([0.0; 2], [1.0, 0.0], 0.0, mu, 0.3);
        assert!((s.time_at(TAIL) - s.time_at(-TAIL) - 0.2).abs() < 1e-12);
        assert!((s.displacement(s.time_at(TAIL))[0] - 0.98).abs() < 1e-4);
    }
}
