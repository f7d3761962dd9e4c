//! Saturation: in which share of its recent motion the arm was at a limit.
//!
//! Read by the onset, which waits longer where a wrong way costs more, and by the governor.

use crate::estimate::LawParameters;
use crate::state::state;

/// ρ, the share, an exponential mean over time of motion.
#[derive(Debug, Clone, Copy)]
pub(in crate::follower) struct Saturation {
    share: f64,
    /// Weight of the newest tick \[1\].
    part: f64,
}

state! { [] Saturation { share } fixed { part } }

impl Saturation {
    /// Of an arm that has not moved, in ticks of `period_ns` \[ns\]: as if it had always been at a limit, so
    /// that it waits until it is known better.
    pub(in crate::follower) fn new(period_ns: u64, law: &LawParameters) -> Self {
        let period_s = period_ns as f64 * 1e-9;
        // A memory shorter than a tick, or NaN, is one tick.
        Self { share: 1.0, part: period_s / law.saturation_s.max(period_s) }
    }

    /// ρ, between 0 and 1.
    pub(in crate::follower) const fn share(&self) -> f64 {
        self.share
    }

    /// Takes in a tick: joints, acceleration or speed were saturated; `None` unless a fresh plan was followed
    /// in motion.
    pub(in crate::follower) fn record(&mut self, at_limit: Option<bool>) {
        if let Some(at_limit) = at_limit {
            self.share += self.part * (f64::from(u8::from(at_limit)) - self.share);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_the_share_of_motion_at_limits_over_a_fifth_of_a_second() {
        let mut saturation = Saturation::new(2_000_000, &LawParameters::SHIPPED);
        let drive = |saturation: &mut Saturation, ticks: u32, every: u32| {
            for tick in 0..ticks {
                saturation.record(Some(tick % every == 0));
                saturation.record(None);
            }
            saturation.share()
        };
        assert_eq!(saturation.share(), 1.0);
        let after = drive(&mut saturation, 100, u32::MAX);
        assert!((after - (-1.0_f64).exp()).abs() < 0.02, "one time constant: {after}");
        assert!(drive(&mut saturation, 500, u32::MAX) < 0.01);
        let tenth = drive(&mut saturation, 1000, 10);
        assert!((tenth - 0.1).abs() < 0.01, "{tenth}");
    }

    #[test]
    fn a_memory_that_is_none_leaves_a_share() {
        for saturation_s in [0.0, f64::NAN, -0.0, 1e-300, -1.0, f64::INFINITY] {
            let law = LawParameters { saturation_s, ..LawParameters::SHIPPED };
            let mut saturation = Saturation::new(2_000_000, &law);
            saturation.record(Some(false));
            assert!((0.0..=1.0).contains(&saturation.share()), "{saturation_s}");
        }
    }
}
