//! Joints that oscillate about their commands with growing amplitude: a loop somewhere that becomes unstable.

use crate::state::state;
use crate::units::Stamp;

/// A swing grows if each amplitude is larger than the one before by this factor.
const GROWTH: f64 = 1.05;
/// Each amplitude follows the one before within this time \[ns\].
const LONGEST_NS: i64 = 1_000_000_000;

#[derive(Debug, Clone, Copy, Default)]
struct Swing {
    /// Largest distance in the present swing, signed, and in the two before \[rad\].
    peaks: [f64; 3],
    /// When it was outside last.
    at: Stamp,
}

state! { [] Swing { peaks, at } }

#[derive(Debug, Clone)]
pub(super) struct Swings<const J: usize> {
    joints: [Swing; J],
}

state! { [const J: usize] Swings<J> { joints } }

impl<const J: usize> Swings<J> {
    pub(super) const fn new() -> Self {
        let still = Swing { peaks: [0.0; 3], at: Stamp(0) };
        Self { joints: [still; J] }
    }

    /// `outside`: distance of each joint from its commands \[rad\], signed; up to `least` counts as zero.
    /// Returns the amplitude of each joint whose third swing in a row is larger than the second, and that
    /// larger than the first.
    pub(super) fn see(&mut self, stamp: Stamp, outside: &[f64; J], least: f64) -> [Option<f64>; J] {
        let mut grown = [None; J];
        for (grown, (swing, outside)) in grown.iter_mut().zip(self.joints.iter_mut().zip(outside)) {
            if outside.abs() <= least {
                continue;
            }
            if stamp.since(swing.at) > LONGEST_NS {
                swing.peaks = [0.0; 3];
            }
            swing.at = stamp;
            let [now, before, first] = swing.peaks;
            swing.peaks = if now * outside < 0.0 {
                [*outside, now, before]
            } else {
                [if outside.abs() > now.abs() { *outside } else { now }, before, first]
            };
            let [now, before, first] = swing.peaks.map(f64::abs);
            if first > 0.0 && before > GROWTH * first && now > GROWTH * before {
                *grown = Some(now);
            }
        }
        grown
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Whether a swing of amplitude times e^(growth t) is reported within 2 s.
    fn grows(growth: f64) -> bool {
        let mut swings = Swings::<1>::new();
        (0..1000_u64).any(|tick| {
            let t = tick as f64 * 2e-3;
            let outside = 0.006 * (growth * t).exp() * (25.0 * t).sin();
            swings.see(Stamp(tick * 2_000_000), &[outside], 0.005)[0].is_some()
        })
    }

    #[test]
    fn only_what_grows_is_told() {
        assert!(grows(1.0));
        assert!(!grows(0.0) && !grows(-1.0));
    }

    #[test]
    fn the_same_side_again_is_no_swing() {
        let mut swings = Swings::<1>::new();
        for tick in 1..100_u64 {
            assert_eq!(swings.see(Stamp(tick * 2_000_000), &[tick as f64 * 1e-3], 0.005), [None]);
        }
    }
}
