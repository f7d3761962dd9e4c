//! Joint positions at irregular stamps, sampled on a uniform grid of absolute times.
//!
//! Contract: linear between neighbours, which is what a command means and what a joint state allows. A gap, a
//! stamp that goes back, or a jump that no arm makes begins a new stretch; nothing is interpolated across it.
//! Bounded work per sample.

use crate::history::History;
use crate::state::state;
use crate::units::Stamp;

/// Grid step of the estimator \[ns\]: index k is the instant k·10 ms.
pub(in crate::arm) const GRID_NS: u64 = 10_000_000;
/// The same \[s\].
pub(in crate::arm) const GRID_S: f64 = GRID_NS as f64 * 1e-9;
/// Neighbours farther apart than this belong to different stretches \[ns\].
const MAX_GAP_NS: u64 = 60_000_000;
/// Positions beyond this are invalid \[rad\].
const MAX_RAD: f64 = 1e3;
/// A jump: faster than this \[rad/s\] by more than [`LEAP_RAD`], which allows for jittering stamps.
const MAX_RADPS: f64 = 20.0;
const LEAP_RAD: f64 = 0.05;
/// Grid points kept: the longest lag, and as much again for joint states that arrive late.
const KEPT: usize = 64;

/// One stretch of motion on the grid.
#[derive(Debug, Clone)]
pub(in crate::arm) struct JointTrack<const J: usize> {
    /// Each under its grid index.
    points: History<[f64; J], KEPT>,
    last: Option<(Stamp, [f64; J])>,
}

state! { [const J: usize] JointTrack<J> { points, last } }

impl<const J: usize> JointTrack<J> {
    pub(in crate::arm) const fn new() -> Self {
        Self { points: History::new([0.0; J]), last: None }
    }

    /// Adds a sample; non-finite positions and repeated stamps are ignored.
    pub(in crate::arm) fn push(&mut self, stamp: Stamp, q: &[f64; J]) {
        if !q.iter().all(|q| q.abs() <= MAX_RAD) {
            return;
        }
        let next = stamp.0 / GRID_NS + 1;
        let span_ns = match &self.last {
            Some((before, _)) if *before == stamp => return,
            Some((before, from)) => joined(*before, from, stamp, q),
            None => None,
        };
        if let (Some(span_ns), Some((before, from))) = (span_ns, &self.last) {
            // One past the last sample; a state from a file may hold anything here.
            let first = before.0 / GRID_NS + 1;
            self.points.go_on_at(first);
            // At most MAX_GAP_NS / GRID_NS turns.
            for k in first..next {
                let part = (k * GRID_NS - before.0) as f64 / span_ns as f64;
                let mut point = *from;
                for (point, to) in point.iter_mut().zip(q) {
                    *point += part * (to - *point);
                }
                self.points.push(point);
            }
        } else {
            self.points.restart(next);
        }
        self.last = Some((stamp, *q));
    }

    /// Forgets everything: the next sample begins a new stretch.
    pub(in crate::arm) fn restart(&mut self) {
        self.last = None;
        self.points.restart(0);
    }

    /// First grid index that is still stored.
    pub(in crate::arm) fn begin(&self) -> u64 {
        self.points.begin()
    }

    /// Nothing of the present stretch was dropped yet.
    pub(in crate::arm) fn whole(&self) -> bool {
        self.points.is_whole()
    }

    /// One past the newest grid index.
    pub(in crate::arm) fn end(&self) -> u64 {
        self.points.end()
    }

    /// Positions at grid index `k` of the present stretch.
    pub(in crate::arm) fn at(&self, k: u64) -> Option<&[f64; J]> {
        self.points.get(k)
    }
}

/// Time between two samples of one stretch \[ns\]; `None` if they do not belong together.
fn joined<const J: usize>(before: Stamp, from: &[f64; J], stamp: Stamp, q: &[f64; J]) -> Option<u64> {
    let span_ns = stamp.0.checked_sub(before.0).filter(|span| *span <= MAX_GAP_NS)?;
    let reach = MAX_RADPS * span_ns as f64 * 1e-9 + LEAP_RAD;
    from.iter().zip(q).all(|(from, to)| (to - from).abs() <= reach).then_some(span_ns)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ms(ms: u64) -> Stamp {
        Stamp(ms * 1_000_000)
    }

    #[test]
    fn grid_points_lie_on_the_line_between_samples() {
        let mut track = JointTrack::<1>::new();
        for t in (1003..1100).step_by(7) {
            track.push(ms(t), &[t as f64 * 1e-3]);
        }
        assert_eq!((track.begin(), track.end()), (101, 110));
        for k in 101..110 {
            assert!((track.at(k).unwrap()[0] - k as f64 * 0.01).abs() < 1e-12);
        }
        assert!(track.at(100).is_none() && track.at(110).is_none());
    }

    #[test]
    fn a_restored_end_that_does_not_fit_the_last_sample_costs_no_time() {
        for end in [0, 5, u64::MAX] {
            let mut track = JointTrack::<1>::new();
            track.push(ms(3_600_000_000), &[0.5]);
            track.points.go_on_at(end);
            track.push(ms(3_600_000_010), &[0.5]);
            assert_eq!(track.end(), 360_000_002, "restored as {end}");
        }
    }

    #[test]
    fn gaps_leaps_and_time_that_goes_back_begin_anew() {
        for (stamp, q) in [(ms(1200), 0.0), (ms(900), 0.0), (ms(1052), 0.9)] {
            let mut track = JointTrack::<1>::new();
            for t in 1000..=1050 {
                track.push(ms(t), &[0.0]);
            }
            assert_eq!((track.begin(), track.end()), (101, 106));
            track.push(stamp, &[q]);
            assert_eq!(track.begin(), track.end());
        }
    }

    #[test]
    fn what_is_no_position_or_no_news_is_left_out() {
        let mut track = JointTrack::<1>::new();
        track.push(ms(1000), &[0.0]);
        for (stamp, q) in [(ms(1001), f64::NAN), (ms(1001), 1e9), (ms(1000), 0.01)] {
            track.push(stamp, &[q]);
        }
        track.push(ms(1020), &[0.02]);
        assert!((track.at(101).unwrap()[0] - 0.01).abs() < 1e-12);
    }
}
