//! Joints that swing about their commands, farther with every swing: a loop somewhere that is about to be
//! unstable.

use crate::units::Stamp;

/// A swing is farther than the one before by this factor,
const GROWTH: f64 = 1.05;
/// and follows it within this time \[ns\].
const LONGEST_NS: i64 = 1_000_000_000;

/// One joint.
#[derive(Debug, Clone, Copy, Default)]
struct Swing {
    /// Farthest of the swing that goes on, signed, and of the two before \[rad\].
    peaks: [f64; 3],
    /// When it was outside last.
    at: Stamp,
}

/// All joints.
#[derive(Debug, Clone)]
pub(super) struct Swings<const J: usize> {
    joints: [Swing; J],
}

impl<const J: usize> Swings<J> {
    pub(super) const fn new() -> Self {
        let still = Swing { peaks: [0.0; 3], at: Stamp(0) };
        Self { joints: [still; J] }
    }

    /// How far each joint is outside its commands \[rad\], signed; distances up to `least` count as none.
    /// Returns the swing of each joint whose third in a row is farther than the second, and that farther than
    /// the first.
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

    /// What became of a swing of `amplitude` times e^(growth t), looked at for 2 s.
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
