//! The dead time τ that the plan looks ahead: fixed, or following the measured lag slowly and bounded.
//!
//! Contract: starts at the configured value, moves only on good evidence, never faster than the configured
//! rate, and never leaves \[0, max\], for which the preview was sized. Deterministic.

use crate::arm::lag::LagEstimate;
use crate::state::state;

/// An estimate with a larger standard deviation is ignored \[s\].
const GOOD_S: f64 = 3e-3;
/// Time constant of the approach \[s\]; the rate bounds it.
const APPROACH_S: f64 = 0.5;

/// Whether the dead time follows the measured lag.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Following {
    /// The dead time stays as configured.
    Fixed,
    /// Follows the measured lag.
    Measured {
        /// Never beyond this \[ns\].
        max_ns: u64,
        /// Never faster than this \[s/s\].
        rate: f64,
    },
}

impl Following {
    /// The longest dead time that a start with `start_ns` \[ns\] can reach.
    #[must_use]
    pub const fn longest_ns(self, start_ns: u64) -> u64 {
        match self {
            Self::Fixed => start_ns,
            Self::Measured { max_ns, .. } => max_ns,
        }
    }
}

/// Which of the two figures of a [`LagEstimate`] is followed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Aim {
    /// The best shift: for a loop that does nothing about the lag but shift commands in time.
    #[default]
    Shift,
    /// The group delay: for a loop whose commands compensate the arm's filter.
    GroupDelay,
}

/// τ, and what it follows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DeadTime {
    following: Following,
    aim: Aim,
    tau_ns: f64,
}

state! { [] DeadTime { tau_ns } fixed { following, aim } }

impl DeadTime {
    /// τ = `start_ns`, within the bounds.
    #[must_use]
    pub fn new(start_ns: u64, following: Following) -> Self {
        Self { following, aim: Aim::Shift, tau_ns: start_ns.min(following.longest_ns(start_ns)) as f64 }
    }

    /// The same, following the other figure.
    #[must_use]
    pub const fn aiming_at(self, aim: Aim) -> Self {
        Self { aim, ..self }
    }

    /// τ \[ns\].
    #[must_use]
    pub fn ns(&self) -> u64 {
        self.tau_ns.round() as u64
    }

    /// Advances by `period_ns`; only a good estimate changes τ.
    pub fn advance(&mut self, estimate: Option<&LagEstimate>, period_ns: u64) {
        let Following::Measured { max_ns, rate } = self.following else { return };
        let Some(good) = estimate.filter(|estimate| estimate.std_s <= GOOD_S) else { return };
        let target_s = match self.aim {
            Aim::Shift => good.shift_s,
            Aim::GroupDelay => good.lag_s,
        };
        let target_ns = (target_s * 1e9).clamp(0.0, max_ns as f64);
        let most = rate * period_ns as f64;
        let step = (target_ns - self.tau_ns) * (period_ns as f64 * 1e-9 / APPROACH_S).min(1.0);
        if step.is_finite() && most >= 0.0 {
            self.tau_ns = (self.tau_ns + step.clamp(-most, most)).clamp(0.0, max_ns as f64);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FOLLOWING: Following = Following::Measured { max_ns: 80_000_000, rate: 0.02 };

    fn estimate(shift_s: f64, std_s: f64) -> LagEstimate {
        LagEstimate { lag_s: shift_s, std_s, shift_s }
    }

    #[test]
    fn fixed_stays_and_following_needs_good_evidence() {
        let mut fixed = DeadTime::new(35_000_000, Following::Fixed);
        let mut follows = DeadTime::new(35_000_000, FOLLOWING);
        for _ in 0..1000 {
            fixed.advance(Some(&estimate(0.05, 1e-4)), 2_000_000);
            for bad in [None, Some(&estimate(0.05, 0.01)), Some(&estimate(0.05, f64::NAN))] {
                follows.advance(bad, 2_000_000);
            }
        }
        assert_eq!((fixed.ns(), follows.ns()), (35_000_000, 35_000_000));
    }

    #[test]
    fn it_follows_no_faster_than_its_rate_and_arrives() {
        let mut tau = DeadTime::new(35_000_000, FOLLOWING);
        for tick in 1..=3000_u64 {
            let before = tau.ns();
            tau.advance(Some(&estimate(0.06, 5e-4)), 2_000_000);
            assert!(tau.ns() - before <= 40_001, "tick {tick}");
        }
        assert!(tau.ns().abs_diff(60_000_000) < 100_000, "{}", tau.ns());
    }

    #[test]
    fn it_follows_the_figure_that_it_aims_at() {
        let both = LagEstimate { lag_s: 0.05, std_s: 5e-4, shift_s: 0.04 };
        for (aim, ns) in [(Aim::Shift, 40_000_000), (Aim::GroupDelay, 50_000_000)] {
            let mut tau = DeadTime::new(45_000_000, FOLLOWING).aiming_at(aim);
            for _ in 0..5000 {
                tau.advance(Some(&both), 2_000_000);
            }
            assert!(tau.ns().abs_diff(ns) < 1000, "{aim:?}: {}", tau.ns());
        }
    }

    #[test]
    fn it_never_leaves_its_bounds() {
        let mut tau = DeadTime::new(500_000_000, FOLLOWING);
        assert_eq!(tau.ns(), 80_000_000);
        for shift_s in [0.2, 1e300, f64::INFINITY, f64::NAN, -0.01, -1e300] {
            for _ in 0..5000 {
                tau.advance(Some(&estimate(shift_s, 1e-4)), 2_000_000);
                assert!(tau.ns() <= 80_000_000);
            }
        }
        assert_eq!(tau.ns(), 0);
    }
}
