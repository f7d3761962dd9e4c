//! The budget of late ticks: first half spent on shedding work, then on the arm's stop.
//!
//! Contract: pure, fixed memory, no clock. A period is late if its tick's own work took longer than the
//! period, or if it was skipped because of such a tick. Wake-ups delayed by other programs do not count,
//! because they pass by themselves while an overload does not. Ticks with a shed solve are neutral: they do
//! not show whether the loop can keep its rate.

use foretrace_control::stop::{StopCause, StopDetail};
use foretrace_control::units::Stamp;

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
    /// No limit.
    pub const NONE: Self = Self { share: f64::INFINITY, window: MAX_WINDOW };
}

/// How a tick handled its solve.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Solve {
    /// Solved as usual.
    Done,
    /// Shed, as too little time was left in the period.
    ShedForTime,
    /// Shed by the budget.
    ShedForRelief,
}

/// The budget's verdict.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Verdict {
    /// Continue.
    Fine,
    /// More than half of the budget is spent: solve in every second tick only.
    Shed,
    /// The budget is spent: stop.
    Stop(StopDetail),
}

/// The newest periods, and how many of them were late.
#[derive(Debug, Clone)]
pub struct OverrunBudget {
    limit: OverrunLimit,
    late: [u64; MAX_WINDOW / WORD],
    place: usize,
    sum: usize,
}

impl OverrunBudget {
    /// An unspent budget; the window is clamped into its range.
    #[must_use]
    pub fn new(limit: OverrunLimit) -> Self {
        let window = limit.window.clamp(1, MAX_WINDOW);
        let limit = OverrunLimit { window, ..limit };
        Self { limit, late: [0; MAX_WINDOW / WORD], place: 0, sum: 0 }
    }

    /// Resets the budget, at arming.
    pub const fn forget(&mut self) {
        self.late = [0; MAX_WINDOW / WORD];
        self.place = 0;
        self.sum = 0;
    }

    /// Counts one tick, and `skipped` periods before it without a tick.
    pub fn count(&mut self, skipped: u64, late: bool, solve: Solve) {
        // A longer gap fills the window once; whether it was too long for the arm is
        // `safety.latch_after_ms`'s to decide.
        for _ in 0..skipped.min(self.limit.window as u64) {
            self.push(true);
        }
        match solve {
            Solve::ShedForRelief => {}
            Solve::ShedForTime if !late => {}
            Solve::ShedForTime | Solve::Done => self.push(late),
        }
    }

    /// The verdict at `now`, with evidence for a stop.
    #[must_use]
    pub fn verdict(&self, now: Stamp) -> Verdict {
        let share = self.share();
        if share > self.limit.share {
            let (cause, limit) = (StopCause::LateTicks, self.limit.share);
            return Verdict::Stop(StopDetail { cause, joint: None, amount: share, limit, at: now });
        }
        if 2.0 * share > self.limit.share { Verdict::Shed } else { Verdict::Fine }
    }

    /// Late periods in the window; periods before the first tick count as on time.
    #[must_use]
    pub fn share(&self) -> f64 {
        self.sum as f64 / self.limit.window as f64
    }

    fn push(&mut self, late: bool) {
        let bit = 1_u64 << (self.place % WORD);
        if let Some(word) = self.late.get_mut(self.place / WORD) {
            self.sum -= usize::from(*word & bit != 0);
            *word = if late { *word | bit } else { *word & !bit };
            self.sum += usize::from(late);
        }
        self.place = (self.place + 1) % self.limit.window;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn half_of(window: usize) -> OverrunBudget {
        OverrunBudget::new(OverrunLimit { share: 0.5, window })
    }

    /// Pseudo-random in 0 to 99, uncorrelated with every second tick: splitmix64.
    fn scattered(tick: u64) -> u64 {
        let z = tick.wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        let z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        (z ^ (z >> 31)) % 100
    }

    /// Ticks until a stop, with `late` deciding whether a tick, shed or not, is late.
    fn ticks_to_stop(budget: &mut OverrunBudget, late: impl Fn(u64, bool) -> bool) -> Option<u64> {
        for tick in 0..10_000_u64 {
            let verdict = budget.verdict(Stamp(tick));
            if let Verdict::Stop(detail) = verdict {
                assert!(detail.amount > detail.limit && detail.at == Stamp(tick), "{detail:?}");
                return Some(tick);
            }
            let shed = verdict == Verdict::Shed && tick % 2 == 0;
            let solve = if shed { Solve::ShedForRelief } else { Solve::Done };
            budget.count(0, late(tick, shed), solve);
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
        let mut budget = half_of(100);
        for _ in 0..51 {
            budget.count(0, true, Solve::Done);
            budget.count(0, false, Solve::ShedForTime);
        }
        assert!(matches!(budget.verdict(Stamp(0)), Verdict::Stop(_)), "{}", budget.share());
    }

    #[test]
    fn solves_are_shed_before_the_arm_is_stopped() {
        let mut budget = half_of(100);
        let mut order = Vec::new();
        for tick in 0..60 {
            let kind = match budget.verdict(Stamp(tick)) {
                Verdict::Fine => 'f',
                Verdict::Shed => 's',
                Verdict::Stop(_) => 'x',
            };
            if order.last() != Some(&kind) {
                order.push(kind);
            }
            budget.count(0, true, Solve::Done);
        }
        assert_eq!(order, ['f', 's', 'x']);
    }

    #[test]
    fn lost_periods_count_and_old_ones_are_forgotten() {
        let mut budget = half_of(100);
        budget.count(30, true, Solve::Done);
        assert!((budget.share() - 0.31).abs() < 1e-12);
        for _ in 0..100 {
            budget.count(0, false, Solve::Done);
        }
        assert_eq!(budget.share(), 0.0);
        budget.count(u64::MAX, true, Solve::Done);
        assert_eq!(budget.share(), 1.0);
        budget.forget();
        assert_eq!((budget.share(), budget.verdict(Stamp(0))), (0.0, Verdict::Fine));
    }

    #[test]
    fn windows_out_of_range_are_brought_into_it() {
        for window in [0, usize::MAX] {
            let mut budget = OverrunBudget::new(OverrunLimit { share: 0.5, window });
            for _ in 0..3 * MAX_WINDOW {
                budget.count(0, true, Solve::Done);
            }
            assert_eq!(budget.share(), 1.0);
        }
        assert_eq!(OverrunBudget::new(OverrunLimit::NONE).verdict(Stamp(0)), Verdict::Fine);
    }
}
