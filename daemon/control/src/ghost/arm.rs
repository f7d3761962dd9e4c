//! A fit of the real arm's response to its commands, so that the ghost's arm responds alike.
//!
//! Contract: an arm with known lag L is measured where the commands wanted it L ago, apart from what its
//! servo filters. To second order in time that is
//!
//! measured(t) ≈ c(t − L) + b ċ(t − L) + a c̈(t − L)
//!
//! for any linear arm (Taylor expansion of its frequency response about 0): b is the error of L, a the spread
//! of the impulse response. Both are fitted to real commands and measurements by least squares with
//! forgetting, regularised towards 0 while little has moved. Without the fit, an arm that rounds corners
//! would look better than its ghost, because a smaller path at the same lag is nearer to the pen. Not
//! modelled: saturation of the arm. Nothing allocates.

use super::track::Track;
use crate::units::Stamp;

/// Half-width of the central differences \[ns\].
const REACH_NS: u64 = 15_000_000;
/// Regularisation: the pull towards a pure delay counts as much as this motion, squared speed \[m²/s²\] and
/// acceleration \[m²/s⁴\] summed over samples. A quarter of a second of ordinary writing has more.
const PULL: [f64; 2] = [0.05, 20.0];
/// Time constant of forgetting, in time of motion \[ns\]; a pause does not age the evidence.
const MEMORY_NS: f64 = 3e9;
/// Samples further apart than this count as this far apart \[ns\].
const STEP_NS: i64 = 20_000_000;
/// Largest b \[s\]: L may be the configured dead time of another arm while nothing better is known.
const LARGEST_S: f64 = 0.06;

/// A past command with its derivatives.
#[derive(Debug, Clone, Copy)]
struct CommandMotion {
    position: [f64; 2],
    velocity: [f64; 2],
    acceleration: [f64; 2],
}

impl CommandMotion {
    /// Central differences about `then`; `None` where the commands around it are unknown.
    fn at(commands: &Track, then: Stamp) -> Option<Self> {
        let before = commands.at(Stamp(then.0.checked_sub(REACH_NS)?))?.position;
        let position = commands.at(then)?.position;
        let after = commands.at(then.plus_ns(REACH_NS))?.position;
        let h = REACH_NS as f64 * 1e-9;
        let each = |f: fn(f64, f64, f64, f64) -> f64| {
            let ([x0, y0], [x1, y1], [x2, y2]) = (before, position, after);
            [f(x0, x1, x2, h), f(y0, y1, y2, h)]
        };
        Some(Self {
            position,
            velocity: each(|before, _, after, h| (after - before) / (2.0 * h)),
            acceleration: each(|before, here, after, h| (after - 2.0 * here + before) / (h * h)),
        })
    }
}

/// The arm's response to its commands, fitted.
#[derive(Debug, Clone, Copy, Default)]
pub struct ArmFit {
    /// Sums of ċċ, ċc̈, c̈c̈, and of the residual of the measured position times ċ and c̈.
    vv: f64,
    va: f64,
    aa: f64,
    rv: f64,
    ra: f64,
    /// Newest sample learned from.
    learned: Option<Stamp>,
    /// b \[s\] and a \[s²\].
    response: [f64; 2],
}

impl ArmFit {
    /// Learns that the command at `then` became the tool position `measured` \[m\].
    pub fn learn(&mut self, commands: &Track, then: Stamp, measured: [f64; 2]) {
        let Some(command) =
            CommandMotion::at(commands, then).filter(|_| measured.iter().all(|x| x.is_finite()))
        else {
            return;
        };
        let elapsed_ns = self.learned.replace(then).map_or(0, |last| then.since(last).clamp(0, STEP_NS));
        let keep = (-(elapsed_ns as f64) / MEMORY_NS).exp();
        for sum in [&mut self.vv, &mut self.va, &mut self.aa, &mut self.rv, &mut self.ra] {
            *sum *= keep;
        }
        let pairs = command.velocity.into_iter().zip(command.acceleration);
        for ((v, a), (m, c)) in pairs.zip(measured.into_iter().zip(command.position)) {
            self.vv += v * v;
            self.va += v * a;
            self.aa += a * a;
            self.rv += (m - c) * v;
            self.ra += (m - c) * a;
        }
        let [pull_v, pull_a] = PULL;
        let (vv, aa) = (self.vv + pull_v, self.aa + pull_a);
        // Positive definite: both regularisation terms are positive.
        let determinant = vv * aa - self.va * self.va;
        let b = (self.rv * aa - self.ra * self.va) / determinant;
        let a = (self.ra * vv - self.rv * self.va) / determinant;
        if b.is_finite() && a.is_finite() {
            let most = LARGEST_S * LARGEST_S;
            self.response = [b.clamp(-LARGEST_S, LARGEST_S), a.clamp(-most, most)];
        }
    }

    /// Where an arm like this one is after the command at `then` \[m\]; `None` where the commands are
    /// unknown.
    #[must_use]
    pub fn respond(&self, commands: &Track, then: Stamp) -> Option<[f64; 2]> {
        let CommandMotion { position: [x, y], velocity: [vx, vy], acceleration: [ax, ay] } =
            CommandMotion::at(commands, then)?;
        let [b, a] = self.response;
        Some([x + b * vx + a * ax, y + b * vy + a * ay])
    }
}

#[cfg(test)]
mod tests {
    use super::super::track::Point;
    use super::*;

    const MS: u64 = 1_000_000;

    /// Commands every 2 ms along `path` \[s -> m\].
    fn commands(path: impl Fn(f64) -> [f64; 2]) -> Track {
        let mut track = Track::new(2000, 50 * MS as i64);
        for k in 0..1500_u64 {
            let point = Point { stamp: Stamp(2 * k * MS), position: path(k as f64 * 0.002), contact: true };
            track.push(point);
        }
        track
    }

    /// A sine of frequency `w` \[rad/s\] behind a pure delay of `delay` \[s\] and a critically damped servo
    /// of look-ahead `T`: gain 1/(1 + (wT/2)²), phase −2 atan(wT/2) − w delay.
    fn servo(amplitude: f64, w: f64, t: f64, delay: f64, look_ahead: f64) -> f64 {
        let x = w * look_ahead / 2.0;
        amplitude / (1.0 + x * x) * (w * (t - delay) - 2.0 * x.atan()).sin()
    }

    #[test]
    fn an_arm_that_filters_is_learned_and_its_answer_to_another_path_foretold() {
        let (delay, look_ahead) = (0.010, 0.030);
        let path = |t: f64| [0.02 * (9.0 * t).sin(), 0.015 * (14.0 * t).sin()];
        let measured =
            |t: f64| [servo(0.02, 9.0, t, delay, look_ahead), servo(0.015, 14.0, t, delay, look_ahead)];
        let track = commands(path);
        let mut fit = ArmFit::default();
        // The lag is wrong by 2 ms.
        let lag = 38 * MS;
        for ms in (200..2900_u64).step_by(8) {
            fit.learn(&track, Stamp(ms * MS - lag), measured(ms as f64 * 1e-3));
        }
        // Faster, and another shape.
        let other = commands(|t| [0.01 * (18.0 * t).sin(), 0.02 * (6.0 * t).sin()]);
        let (mut worst, mut without) = (0.0_f64, 0.0_f64);
        for ms in (200..2900_u64).step_by(8) {
            let (then, t) = (Stamp(ms * MS - lag), ms as f64 * 1e-3);
            let truth = [servo(0.01, 18.0, t, delay, look_ahead), servo(0.02, 6.0, t, delay, look_ahead)];
            let apart = |[x, y]: [f64; 2]| (x - truth[0]).hypot(y - truth[1]);
            worst = worst.max(apart(fit.respond(&other, then).unwrap()));
            without = without.max(apart(ArmFit::default().respond(&other, then).unwrap()));
        }
        assert!(worst < 0.2 * without && worst < 1.5e-4, "{worst} m with the fit, {without} m without");
    }

    #[test]
    fn an_arm_at_rest_teaches_nothing_and_a_mere_delay_stays_one() {
        let track = commands(|_| [0.01, 0.02]);
        let mut fit = ArmFit::default();
        for ms in 100..2000_u64 {
            fit.learn(&track, Stamp(ms * MS), [0.0101, 0.0199]);
        }
        assert_eq!(fit.respond(&track, Stamp(500 * MS)), Some([0.01, 0.02]));
        let track = commands(|t| [0.02 * (9.0 * t).sin(), 0.0]);
        for ms in (100..2000_u64).step_by(2) {
            let then = Stamp(ms * MS);
            fit.learn(&track, then, track.at(then).unwrap().position);
        }
        let [x, _] = fit.respond(&track, Stamp(500 * MS)).unwrap();
        assert!((x - track.at(Stamp(500 * MS)).unwrap().position[0]).abs() < 1e-12);
    }

    #[test]
    fn nonsense_is_bounded_and_unknown_commands_answer_nothing() {
        let track = commands(|t| [0.02 * (9.0 * t).sin(), 0.0]);
        let mut fit = ArmFit::default();
        for ms in 100..2000_u64 {
            fit.learn(&track, Stamp(ms * MS), [1e3, f64::from(ms as u32)]);
        }
        fit.learn(&track, Stamp(500 * MS), [f64::NAN, f64::INFINITY]);
        let [x, y] = fit.respond(&track, Stamp(500 * MS)).unwrap();
        assert!(x.abs() < 0.05 && y.abs() < 0.05, "{x} {y}");
        assert_eq!(fit.respond(&track, Stamp(5_000 * MS)), None);
        assert_eq!(fit.respond(&track, Stamp(0)), None);
    }

    /// Against the normal equations over all samples, each with its age in time of motion.
    #[test]
    fn the_fit_is_least_squares_over_what_is_not_forgotten() {
        let track = commands(|t| [0.02 * (9.0 * t).sin() + 0.01 * (4.0 * t).cos(), 0.015 * (14.0 * t).sin()]);
        let mut fit = ArmFit::default();
        let mut cases: Vec<(f64, [[f64; 2]; 3])> = Vec::new();
        let mut ms = 100;
        for k in 0..110_u64 {
            // Pauses count as 20 ms.
            let elapsed_ms = [4, 8, 15, 60][k as usize % 4];
            ms += elapsed_ms;
            let h = 0.015;
            let at = |ms: u64| track.at(Stamp(ms * MS)).unwrap().position;
            let (before, here, after) = (at(ms - 15), at(ms), at(ms + 15));
            let velocity = [0, 1].map(|i| (after[i] - before[i]) / (2.0 * h));
            let acceleration = [0, 1].map(|i| (after[i] - 2.0 * here[i] + before[i]) / (h * h));
            // A filter that changes meanwhile, and a disturbance that no filter explains.
            let b = if k < 60 { 0.02 } else { -0.01 };
            let off =
                [0, 1].map(|i| b * velocity[i] + 2e-4 * acceleration[i] + 1e-4 * (k as f64 * 0.7).sin());
            let moved_ns = (elapsed_ms as f64 * 1e6).min(STEP_NS as f64);
            cases.iter_mut().for_each(|case| case.0 *= (-moved_ns / MEMORY_NS).exp());
            cases.push((1.0, [velocity, acceleration, off]));
            fit.learn(&track, Stamp(ms * MS), [here[0] + off[0], here[1] + off[1]]);
        }
        // Σ of the products of velocity, acceleration and residual, by their indices.
        let sum = |one: usize, other: usize| {
            let dot = |case: &[[f64; 2]; 3]| (0..2).map(|i| case[one][i] * case[other][i]).sum::<f64>();
            cases.iter().map(|(weight, case)| weight * dot(case)).sum::<f64>()
        };
        let gram = nalgebra::Matrix2::new(sum(0, 0) + PULL[0], sum(0, 1), sum(1, 0), sum(1, 1) + PULL[1]);
        let right = nalgebra::Vector2::new(sum(0, 2), sum(1, 2));
        let expected = gram.lu().solve(&right).unwrap();
        let [b, a] = fit.response;
        assert!(
            (b / expected.x - 1.0).abs() < 1e-9 && (a / expected.y - 1.0).abs() < 1e-9,
            "{b} {a} {expected}"
        );
        assert!(b > -0.0095 && b < 0.019, "all of it counts alike, or only the newest: {b}");
    }
}
