//! The policy on late ticks: what a tick may spend, and when the arm stops because too many were late.
//!
//! Contract: pure, fixed memory, no clock. A period is late if its tick's own work took longer than the
//! period, or if it was skipped because of such a tick. Wake-ups delayed by other programs do not count,
//! because they pass by themselves while an overload does not. Ticks with a shed solve are neutral: they do
//! not show whether the loop can keep its rate. The first half of the budget of late ticks is spent on
//! shedding work, then the arm stops.

use foretrace_control::stop::{StopCause, StopDetail};
use foretrace_control::units::Stamp;

use super::cyclic::Wake;

/// The longest window \[periods\]: two seconds at 1000 Hz.
pub const MAX_WINDOW: usize = 2048;
const WORD: usize = u64::BITS as usize;

/// Size of the budget.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OverrunLimit {
    /// Share of the periods in the window that may be late, in (0, 1].
    pub share: f64,
    /// Periods in the window, 1 to [`MAX_WINDOW`].
    pub window: usize,
}

impl OverrunLimit {
    /// No number of late ticks stops the arm.
    pub const NONE: Self = Self { share: f64::INFINITY, window: MAX_WINDOW };
}

/// How a tick handles its solve.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Solve {
    Wanted,
    /// Shed, as too little time was left in the period.
    ShedForTime,
    /// Shed, as more than half of the budget of late ticks is spent.
    ShedForRelief,
}

/// The decision on a tick before its step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OverrunDecision {
    /// Whether the tick solves.
    pub solve: Solve,
    /// The evidence for a stop, where the budget is spent.
    pub stop: Option<StopDetail>,
}

/// The newest periods, how many of them were late, and what a step usually costs.
#[derive(Debug, Clone)]
pub struct Overruns {
    limit: OverrunLimit,
    period_ns: u64,
    /// Decaying maximum of the duration of a tick that solved \[ns\].
    usual_cost_ns: u64,
    late: [u64; MAX_WINDOW / WORD],
    slot: usize,
    sum: usize,
}

impl Overruns {
    /// An unspent budget for ticks of `period_ns`; the window is clamped into its range.
    #[must_use]
    pub fn new(limit: OverrunLimit, period_ns: u64) -> Self {
        let limit = OverrunLimit { window: limit.window.clamp(1, MAX_WINDOW), ..limit };
        let late = [0; MAX_WINDOW / WORD];
        Self { limit, period_ns: period_ns.max(1), usual_cost_ns: 0, late, slot: 0, sum: 0 }
    }

    /// Resets the budget, at arming.
    pub const fn forget(&mut self) {
        self.late = [0; MAX_WINDOW / WORD];
        self.slot = 0;
        self.sum = 0;
    }

    /// Decides on tick number `tick` that `wake` began, at `now`.
    ///
    /// Sheds the solve if less time is left than a tick usually takes; half a period is always enough, so
    /// that a slow solver is not shed for ever. A loop that has spent half of its budget solves in every
    /// second tick.
    #[must_use]
    pub fn decide(&self, wake: &Wake, now: Stamp, tick: u64) -> OverrunDecision {
        let (share, limit) = (self.share(), self.limit.share);
        let stop = (share > limit).then_some(StopDetail {
            cause: StopCause::LateTicks,
            joint: None,
            amount: share,
            limit,
            at: wake.release,
        });
        let relief = stop.is_none() && 2.0 * share > limit;
        let left_ns = wake.deadline(self.period_ns).0.saturating_sub(now.0);
        let solve = if relief && tick.is_multiple_of(2) {
            Solve::ShedForRelief
        } else if left_ns < self.usual_cost_ns.min(self.period_ns / 2) {
            Solve::ShedForTime
        } else {
            Solve::Wanted
        };
        OverrunDecision { solve, stop }
    }

    /// Counts the tick that `wake` began and that ended at `finished`, and the periods lost before it.
    pub fn count(&mut self, wake: &Wake, finished: Stamp, solve: Solve) {
        // Time that a busy machine takes from the sleeping loop is not its own work: that delay passes by
        // itself.
        let overslept = wake.release.0.saturating_sub(wake.due.0) / self.period_ns;
        // A longer gap fills the window once; whether it was too long for the arm is
        // `safety.latch_after_ms`'s to decide.
        for _ in 0..wake.skipped.saturating_sub(overslept).min(self.limit.window as u64) {
            self.push(true);
        }
        let cost_ns = finished.0.saturating_sub(wake.started.0);
        let late = cost_ns > self.period_ns;
        if solve == Solve::Wanted || solve == Solve::ShedForTime && late {
            self.push(late);
        }
        if solve == Solve::Wanted {
            self.usual_cost_ns = (self.usual_cost_ns - self.usual_cost_ns / 64).max(cost_ns);
        }
    }

    /// Late periods in the window; periods before the first tick count as on time.
    fn share(&self) -> f64 {
        self.sum as f64 / self.limit.window as f64
    }

    fn push(&mut self, late: bool) {
        let bit = 1_u64 << (self.slot % WORD);
        if let Some(word) = self.late.get_mut(self.slot / WORD) {
            self.sum -= usize::from(*word & bit != 0);
            *word = if late { *word | bit } else { *word & !bit };
            self.sum += usize::from(late);
        }
        self.slot = (self.slot + 1) % self.limit.window;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERIOD_NS: u64 = 2_000_000;
    const RELEASE: Stamp = Stamp(10_000_000_000);

    fn half_of(window: usize) -> Overruns {
        Overruns::new(OverrunLimit { share: 0.5, window }, PERIOD_NS)
    }

    /// A tick that began in time, after `skipped` periods.
    fn punctual(skipped: u64) -> Wake {
        Wake { index: 0, due: RELEASE, release: RELEASE, started: RELEASE, skipped }
    }

    fn count(overruns: &mut Overruns, skipped: u64, late: bool, solve: Solve) {
        overruns.count(&punctual(skipped), RELEASE.plus_ns(PERIOD_NS + u64::from(late)), solve);
    }

    /// The decision with the whole period left.
    fn decide(overruns: &Overruns, tick: u64) -> OverrunDecision {
        overruns.decide(&punctual(0), RELEASE, tick)
    }

    /// Pseudo-random in 0 to 99, uncorrelated with every second tick: splitmix64.
    fn scattered(tick: u64) -> u64 {
        let z = tick.wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        let z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        (z ^ (z >> 31)) % 100
    }

    /// Ticks until a stop, with `late` deciding whether a tick, shed or not, is late.
    fn ticks_to_stop(overruns: &mut Overruns, late: impl Fn(u64, bool) -> bool) -> Option<u64> {
        for tick in 0..10_000_u64 {
            let OverrunDecision { solve, stop } = decide(overruns, tick);
            if let Some(detail) = stop {
                assert!(detail.amount > detail.limit && detail.at == RELEASE, "{detail:?}");
                return Some(tick);
            }
            count(overruns, 0, late(tick, solve != Solve::Wanted), solve);
        }
        None
    }

    #[test]
    fn a_loop_whose_every_solve_is_late_is_stopped_within_a_window() {
        // The shed ticks are on time, but do not prevent the stop.
        let ticks = ticks_to_stop(&mut half_of(500), |_, shed| !shed).unwrap();
        assert!((251..=380).contains(&ticks), "{ticks}");
        let ticks = ticks_to_stop(&mut half_of(500), |_, _| true).unwrap();
        assert!((251..=380).contains(&ticks), "{ticks}");
    }

    #[test]
    fn shares_below_the_limit_never_stop_and_shares_above_always_do() {
        for percent in [0, 10, 25, 35] {
            assert_eq!(ticks_to_stop(&mut half_of(200), |tick, _| scattered(tick) < percent), None);
        }
        for percent in [65, 75, 90] {
            let stopped = ticks_to_stop(&mut half_of(200), |tick, _| scattered(tick) < percent);
            assert!(stopped.is_some(), "{percent}");
        }
    }

    #[test]
    fn a_solver_so_slow_that_every_second_tick_has_no_time_left_is_found_out() {
        let mut overruns = half_of(100);
        for _ in 0..51 {
            count(&mut overruns, 0, true, Solve::Wanted);
            count(&mut overruns, 0, false, Solve::ShedForTime);
        }
        assert!(decide(&overruns, 0).stop.is_some(), "{}", overruns.share());
    }

    #[test]
    fn the_budget_is_spent_on_every_second_solve_from_its_half_on_and_on_a_stop_beyond_it() {
        let mut overruns = half_of(100);
        for late in 0..60 {
            let even = decide(&overruns, 2 * late);
            let wanted = if (26..=50).contains(&late) { Solve::ShedForRelief } else { Solve::Wanted };
            assert_eq!((even.solve, even.stop.is_some()), (wanted, late > 50), "{late} late ticks");
            assert_eq!(decide(&overruns, 2 * late + 1).solve, Solve::Wanted, "{late} late ticks");
            count(&mut overruns, 0, true, Solve::Wanted);
        }
        // A tick that sheds for relief does not count, however late; one that sheds for time only if late.
        let before = overruns.share();
        count(&mut overruns, 0, true, Solve::ShedForRelief);
        count(&mut overruns, 0, false, Solve::ShedForTime);
        assert_eq!(overruns.share(), before);
        count(&mut overruns, 0, true, Solve::ShedForTime);
        assert!((overruns.share() - before - 0.01).abs() < 1e-12);
    }

    #[test]
    fn a_stop_names_share_limit_and_release() {
        let mut overruns = half_of(4);
        (0..3).for_each(|_| count(&mut overruns, 0, true, Solve::Wanted));
        let detail =
            StopDetail { cause: StopCause::LateTicks, joint: None, amount: 0.75, limit: 0.5, at: RELEASE };
        assert_eq!(decide(&overruns, 0), OverrunDecision { solve: Solve::Wanted, stop: Some(detail) });
    }

    #[test]
    fn a_tick_solves_while_what_it_usually_takes_is_left_and_always_with_half_a_period() {
        let mut overruns = half_of(100);
        let at = |overruns: &Overruns, left_ns: u64| {
            overruns.decide(&punctual(0), RELEASE.plus_ns(PERIOD_NS - left_ns), 1).solve
        };
        assert_eq!(at(&overruns, 0), Solve::Wanted, "nothing is known yet");
        let cost = |overruns: &mut Overruns, ns: u64, solve: Solve| {
            overruns.count(&punctual(0), RELEASE.plus_ns(ns), solve);
        };
        cost(&mut overruns, 640_000, Solve::Wanted);
        assert_eq!([640_000, 639_999].map(|left| at(&overruns, left)), [Solve::Wanted, Solve::ShedForTime]);
        // Ticks without a solve say nothing of its cost; those with one let the maximum fade by a 64th.
        cost(&mut overruns, 900_000, Solve::ShedForTime);
        cost(&mut overruns, 900_000, Solve::ShedForRelief);
        cost(&mut overruns, 1000, Solve::Wanted);
        assert_eq!([630_000, 629_999].map(|left| at(&overruns, left)), [Solve::Wanted, Solve::ShedForTime]);
        cost(&mut overruns, 10 * PERIOD_NS, Solve::Wanted);
        let half = PERIOD_NS / 2;
        assert_eq!([half, half - 1].map(|left| at(&overruns, left)), [Solve::Wanted, Solve::ShedForTime]);
        // After the deadline nothing is left.
        let over = RELEASE.plus_ns(PERIOD_NS + 1);
        assert_eq!(overruns.decide(&punctual(0), over, 1).solve, Solve::ShedForTime);
    }

    #[test]
    fn periods_lost_by_the_loop_count_and_those_overslept_do_not() {
        // Five periods skipped: three in the sleep before, two by the tick before that.
        let mut overruns = half_of(100);
        let release = RELEASE.plus_ns(3 * PERIOD_NS);
        let wake = Wake { index: 9, due: RELEASE, release, started: release.plus_ns(5), skipped: 5 };
        overruns.count(&wake, wake.started.plus_ns(PERIOD_NS), Solve::Wanted);
        assert!((overruns.share() - 0.02).abs() < 1e-12, "{}", overruns.share());
        // A start long after the release is not the tick's own work.
        let late = Wake { skipped: 0, started: RELEASE.plus_ns(9 * PERIOD_NS), ..punctual(0) };
        overruns.count(&late, late.started.plus_ns(1), Solve::Wanted);
        assert!((overruns.share() - 0.02).abs() < 1e-12, "{}", overruns.share());
    }

    #[test]
    fn lost_periods_count_and_old_ones_are_forgotten() {
        let mut overruns = half_of(100);
        count(&mut overruns, 30, true, Solve::Wanted);
        assert!((overruns.share() - 0.31).abs() < 1e-12);
        for _ in 0..100 {
            count(&mut overruns, 0, false, Solve::Wanted);
        }
        assert_eq!(overruns.share(), 0.0);
        count(&mut overruns, u64::MAX, true, Solve::Wanted);
        assert_eq!(overruns.share(), 1.0);
        overruns.forget();
        assert_eq!((overruns.share(), decide(&overruns, 0).stop), (0.0, None));
        // The window begins again as a whole: 100 punctual ticks later nothing of it is left.
        count(&mut overruns, 0, true, Solve::Wanted);
        (0..99).for_each(|_| count(&mut overruns, 0, false, Solve::Wanted));
        assert_eq!(overruns.share(), 0.01);
        count(&mut overruns, 0, false, Solve::Wanted);
        assert_eq!(overruns.share(), 0.0);
    }

    #[test]
    fn windows_out_of_range_are_brought_into_it() {
        for (window, late) in [(0, 1), (usize::MAX, MAX_WINDOW)] {
            let mut overruns = half_of(window);
            for _ in 0..late {
                assert!(overruns.share() < 1.0);
                count(&mut overruns, 0, true, Solve::Wanted);
            }
            assert_eq!(overruns.share(), 1.0);
        }
        let unlimited = OverrunDecision { solve: Solve::Wanted, stop: None };
        let mut overruns = Overruns::new(OverrunLimit::NONE, PERIOD_NS);
        count(&mut overruns, u64::MAX, true, Solve::Wanted);
        assert_eq!(decide(&overruns, 0), unlimited);
    }
}
