//! The fixed-rate loop: when each tick may start, how late it started, and what was lost.
//!
//! Contract: releases lie on a lattice `PHASE_NS + k * period` of the clock that no overrun moves.
//! [`Cyclic::wait`] sleeps until `release - spin`, then spins, never longer than the margin. When whole
//! periods have passed, they are skipped and counted, and the tick runs at once for the last release that has
//! come. A loop that has not slept for [`BUSY_PERIODS`] skips periods until it has slept for half of one:
//! under SCHED_FIFO no other thread would run on its CPU, not even one that wants to stop it. Nothing here
//! allocates or blocks except the sleep.

use foretrace_control::units::Stamp;

use super::clock::Clock;

/// Offset of the releases from the multiples of the period \[ns\].
///
/// The kernel's tick, and every program that sleeps to round times, runs at multiples of a millisecond, which
/// delays a release there by 15 us even while it spins. Half a millisecond is farthest from all of them, for
/// every period from 1 ms and every usual kernel tick.
pub const PHASE_NS: u64 = 500_000;

/// Most periods without a sleep.
pub const BUSY_PERIODS: u64 = 4;
/// A sleep shorter than this fraction of a period does not count.
const REST_PART: u64 = 16;

/// The rhythm of a loop.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Rhythm {
    /// Time between releases \[ns\]; at least 1.
    pub period_ns: u64,
    /// Time before a release that is spun instead of slept \[ns\]; 0 = only sleep. Limited to half a period,
    /// because a thread that never sleeps starves all others.
    pub spin_ns: u64,
}

/// The start of one tick.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Wake {
    /// Index of this tick's release on the lattice, from 0; skipped periods count.
    pub index: u64,
    /// The release that was waited for.
    pub due: Stamp,
    /// When the tick was allowed to start: `due`, or the last release before the wait ended, if that was too
    /// late.
    pub release: Stamp,
    pub started: Stamp,
    /// Whole periods skipped just before this one.
    pub skipped: u64,
}

impl Wake {
    /// Delay from the release that was waited for to the start \[ns\]; includes skipped periods.
    #[must_use]
    pub const fn latency_ns(&self) -> u64 {
        self.started.0.saturating_sub(self.due.0)
    }

    /// The deadline of this tick: the next release.
    #[must_use]
    pub const fn deadline(&self, period_ns: u64) -> Stamp {
        self.release.plus_ns(period_ns)
    }
}

/// A loop with a fixed rhythm on the clock `C`.
#[derive(Debug)]
pub struct Cyclic<C> {
    clock: C,
    rhythm: Rhythm,
    next_release: Stamp,
    next_index: u64,
    /// End of the last sleep that counted.
    rested: Stamp,
    /// Ticks since then: a single stall is no reason to skip more periods.
    restless: u32,
}

impl<C: Clock> Cyclic<C> {
    /// A loop whose first release is the next point of the lattice that is at least one period away.
    ///
    /// The lattice depends on clock and period only: a restarted daemon ticks at the same times.
    #[must_use]
    pub fn new(clock: C, rhythm: Rhythm) -> Self {
        let period_ns = rhythm.period_ns.max(1);
        let rhythm = Rhythm { period_ns, spin_ns: rhythm.spin_ns.min(period_ns / 2) };
        let now = clock.now().0;
        let first = (now / period_ns).saturating_add(2).saturating_mul(period_ns).saturating_add(PHASE_NS);
        Self { clock, rhythm, next_release: Stamp(first), next_index: 0, rested: Stamp(now), restless: 0 }
    }

    /// The rhythm in force.
    #[must_use]
    pub const fn rhythm(&self) -> Rhythm {
        self.rhythm
    }

    /// The clock of the loop.
    pub const fn clock(&self) -> &C {
        &self.clock
    }

    /// Waits for the next release.
    pub fn wait(&mut self) -> Wake {
        // Periods can be lost twice: in the step before, and in a sleep that ends much too late.
        let now = self.clock.now();
        let lost = self.periods_since(self.next_release, now);
        let lost = lost.saturating_add(self.periods_of_rest(now, self.after(self.next_release, lost)));
        let due = self.after(self.next_release, lost);
        let started = self.reach(due);
        let overslept = self.periods_since(due, started);
        let release = self.after(due, overslept);
        let skipped = lost.saturating_add(overslept);
        let index = self.next_index.saturating_add(skipped);
        self.next_release = self.after(release, 1);
        self.next_index = index.saturating_add(1);
        Wake { index, due, release, started, skipped }
    }

    /// Periods to skip beyond `due`, so that a loop that has been busy for too long sleeps.
    fn periods_of_rest(&self, now: Stamp, due: Stamp) -> u64 {
        let Rhythm { period_ns, spin_ns } = self.rhythm;
        let busy_ns = now.0.saturating_sub(self.rested.0);
        if self.restless < 2 || busy_ns <= BUSY_PERIODS.saturating_mul(period_ns) {
            return 0;
        }
        let wanted = now.0.saturating_add(period_ns / 2).saturating_add(spin_ns);
        wanted.saturating_sub(due.0).div_ceil(period_ns)
    }

    /// Whole periods from `release` to `now`; 0 if `release` has not come.
    fn periods_since(&self, release: Stamp, now: Stamp) -> u64 {
        now.0.saturating_sub(release.0) / self.rhythm.period_ns
    }

    /// The release `periods` after `release`.
    const fn after(&self, release: Stamp, periods: u64) -> Stamp {
        release.plus_ns(periods.saturating_mul(self.rhythm.period_ns))
    }

    /// Sleeps to the margin, spins the rest; returns the first reading at or after `release`.
    fn reach(&mut self, release: Stamp) -> Stamp {
        let margin = Stamp(release.0.saturating_sub(self.rhythm.spin_ns));
        let mut now = self.clock.now();
        let before = now;
        while now < margin {
            self.clock.sleep_until(margin);
            now = self.clock.now();
        }
        if now.0.saturating_sub(before.0) >= self.rhythm.period_ns / REST_PART {
            self.rested = now;
            self.restless = 0;
        } else {
            self.restless = self.restless.saturating_add(1);
        }
        // Without the processor's pause instruction, which hypervisors take for a wait and yield the CPU.
        while now < release {
            now = self.clock.now();
        }
        now
    }
}

#[cfg(test)]
mod tests {
    use std::cell::Cell;

    use super::*;

    /// Simulated time: each reading costs `read_ns`, each sleep ends `oversleep_ns` late.
    struct SimulatedClock {
        now: Cell<u64>,
        slept: Cell<u64>,
        read_ns: u64,
        oversleep_ns: u64,
    }

    impl SimulatedClock {
        fn at(now: u64) -> Self {
            Self { now: Cell::new(now), slept: Cell::new(0), read_ns: 0, oversleep_ns: 0 }
        }
        fn work(&self, ns: u64) {
            self.now.set(self.now.get() + ns);
        }
    }

    impl Clock for SimulatedClock {
        fn now(&self) -> Stamp {
            self.now.set(self.now.get() + self.read_ns);
            Stamp(self.now.get())
        }
        fn sleep_until(&self, instant: Stamp) {
            let end = instant.0.max(self.now.get()) + self.oversleep_ns;
            self.slept.set(self.slept.get() + end - self.now.get());
            self.now.set(end);
        }
    }

    const PERIOD: u64 = 2_000_000;

    fn rhythm(spin_ns: u64) -> Rhythm {
        Rhythm { period_ns: PERIOD, spin_ns }
    }

    #[test]
    fn releases_lie_on_one_lattice_off_the_round_milliseconds() {
        let mut cyclic = Cyclic::new(SimulatedClock::at(12_345), rhythm(0));
        for k in 0..1000 {
            let wake = cyclic.wait();
            assert_eq!(wake.release.0, (k + 2) * PERIOD + PHASE_NS);
            assert_eq!(wake.index, k);
            assert_eq!(wake.skipped, 0);
            assert_eq!(wake.latency_ns(), 0);
            cyclic.clock().work(700_000);
        }
    }

    #[test]
    fn a_late_wake_up_is_latency_and_does_not_move_the_next_release() {
        let clock = SimulatedClock { oversleep_ns: 14_000, ..SimulatedClock::at(0) };
        let mut cyclic = Cyclic::new(clock, rhythm(0));
        for k in 0..1000 {
            let wake = cyclic.wait();
            assert_eq!(wake.release.0, (k + 2) * PERIOD + PHASE_NS);
            assert_eq!(wake.latency_ns(), 14_000);
        }
    }

    #[test]
    fn a_step_longer_than_the_period_but_not_by_a_whole_one_skips_nothing() {
        let mut cyclic = Cyclic::new(SimulatedClock::at(0), rhythm(0));
        let first = cyclic.wait();
        cyclic.clock().work(PERIOD + PERIOD / 2);
        let second = cyclic.wait();
        assert_eq!(second.skipped, 0);
        assert_eq!(second.release.0, first.release.0 + PERIOD);
        assert_eq!(second.latency_ns(), PERIOD / 2);
        let third = cyclic.wait();
        assert_eq!(third.release.0, first.release.0 + 2 * PERIOD);
        assert_eq!(third.latency_ns(), 0);
    }

    #[test]
    fn whole_periods_lost_are_skipped_and_counted_and_the_phase_is_kept() {
        let mut cyclic = Cyclic::new(SimulatedClock::at(0), rhythm(0));
        let first = cyclic.wait();
        cyclic.clock().work(7 * PERIOD + 300);
        let second = cyclic.wait();
        assert_eq!(second.skipped, 6);
        assert_eq!(second.index, first.index + 7);
        assert_eq!(second.release.0, first.release.0 + 7 * PERIOD);
        assert_eq!(second.latency_ns(), 300);
        assert_eq!(second.release.0 % PERIOD, PHASE_NS);
    }

    #[test]
    fn a_sleep_that_ends_periods_too_late_runs_for_the_last_release_and_shows_how_late_it_was() {
        let clock = SimulatedClock { oversleep_ns: 5 * PERIOD + 400, ..SimulatedClock::at(0) };
        let mut cyclic = Cyclic::new(clock, rhythm(0));
        let wake = cyclic.wait();
        assert_eq!((wake.skipped, wake.index), (5, 5));
        assert_eq!(wake.due.0, 2 * PERIOD + PHASE_NS);
        assert_eq!(wake.release.0, 7 * PERIOD + PHASE_NS);
        assert_eq!(wake.latency_ns(), 5 * PERIOD + 400);
        let next = cyclic.wait();
        assert_eq!((next.due.0, next.index), (8 * PERIOD + PHASE_NS, 11));
    }

    #[test]
    fn a_loop_that_cannot_keep_its_rate_still_leaves_time_to_others() {
        for (step, spin) in [(PERIOD, 0), (3 * PERIOD / 2, 0), (3 * PERIOD, 50_000), (10 * PERIOD, 1_000_000)]
        {
            let clock = SimulatedClock { read_ns: 100, ..SimulatedClock::at(0) };
            let mut cyclic = Cyclic::new(clock, rhythm(spin));
            let (mut last, mut sum) = (cyclic.wait(), 0);
            let (begin, slept) = (cyclic.clock().now.get(), cyclic.clock().slept.get());
            for _ in 0..1000 {
                cyclic.clock().work(step + 1);
                let wake = cyclic.wait();
                assert_eq!(wake.index, last.index + 1 + wake.skipped);
                assert_eq!(wake.release.0 % PERIOD, PHASE_NS);
                assert!(wake.release > last.release && wake.started >= wake.release);
                (last, sum) = (wake, sum + wake.skipped);
            }
            let share =
                (cyclic.clock().slept.get() - slept) as f64 / (cyclic.clock().now.get() - begin) as f64;
            assert!(share > 0.015, "steps of {step} ns leave {share:.3} of the time");
            assert!(step == PERIOD || sum > 0);
        }
    }

    #[test]
    fn it_sleeps_to_the_margin_and_spins_only_the_rest() {
        let clock = SimulatedClock { read_ns: 10, ..SimulatedClock::at(0) };
        let mut cyclic = Cyclic::new(clock, rhythm(50_000));
        cyclic.wait();
        let (before, slept) = (cyclic.clock().now.get(), cyclic.clock().slept.get());
        let wake = cyclic.wait();
        let spun = wake.started.0 - before - (cyclic.clock().slept.get() - slept);
        assert!((50_000..=50_040).contains(&spun), "spun {spun} ns");
        assert!(wake.latency_ns() <= 10);
    }

    #[test]
    fn a_spin_margin_is_held_below_half_a_period() {
        let cyclic = Cyclic::new(SimulatedClock::at(0), rhythm(u64::MAX));
        assert_eq!(cyclic.rhythm().spin_ns, PERIOD / 2);
    }

    #[test]
    fn a_storm_of_signals_neither_shortens_nor_loses_a_period() {
        /// Every sleep is interrupted after 2 us, and each handler takes 1 us: 600 of them in a period.
        struct Bombarded(SimulatedClock);
        impl Clock for Bombarded {
            fn now(&self) -> Stamp {
                self.0.now()
            }
            fn sleep_until(&self, instant: Stamp) {
                let interrupted = instant.0.min(self.0.now.get() + 2_000);
                self.0.sleep_until(Stamp(interrupted));
                self.0.work(1_000);
            }
        }
        let clock = SimulatedClock { read_ns: 10, ..SimulatedClock::at(0) };
        let mut cyclic = Cyclic::new(Bombarded(clock), rhythm(50_000));
        for k in 0..1000 {
            let wake = cyclic.wait();
            assert_eq!((wake.index, wake.skipped), (k, 0));
            assert_eq!(wake.release.0, (k + 2) * PERIOD + PHASE_NS);
            assert!(wake.latency_ns() <= 1_000, "{wake:?}");
            cyclic.clock().0.work(700_000);
        }
    }

    #[test]
    fn an_interrupted_sleep_is_taken_up_again() {
        struct Interrupted(SimulatedClock);
        impl Clock for Interrupted {
            fn now(&self) -> Stamp {
                self.0.now()
            }
            fn sleep_until(&self, instant: Stamp) {
                let half = self.0.now.get() + (instant.0 - self.0.now.get()).div_ceil(2);
                self.0.sleep_until(Stamp(half));
            }
        }
        let mut cyclic = Cyclic::new(Interrupted(SimulatedClock::at(0)), rhythm(0));
        assert_eq!(cyclic.wait().latency_ns(), 0);
        assert_eq!(cyclic.wait().latency_ns(), 0);
    }
}
