//! Round trip of the counter: how many cycles pass from a state package to the cycle that uses the answer to
//! it.
//!
//! Contract: in cycles of the controller's own clock, so that this host's delays on the way back do not count
//! twice.

use super::registers::ProgramAnswer;

/// Counters under way that are remembered, 0.5 s at 500 Hz.
const REMEMBERED: usize = 256;
/// Longest round trip that is told apart, in cycles.
const LONGEST: usize = 16;
/// Share of the past that is kept per echo.
const FADE: f64 = 0.995;

/// What has been sent and what came back.
#[derive(Debug, Clone)]
pub struct Trips {
    cycle_s: f64,
    /// Counter, and the timestamp of the state that it answered \[s\]; newest at `next − 1`.
    sent: [(i32, f64); REMEMBERED],
    next: usize,
    echoed: i32,
    /// When something new was echoed last \[s\]; `None`: nothing since the line began.
    echoed_at_s: Option<f64>,
    /// The first state of this line \[s\].
    begun_s: Option<f64>,
    /// Fading number of round trips of each length; the last holds all longer ones.
    recent: [f64; LONGEST + 1],
    usual: usize,
    /// Number of round trips of each length, in cycles; the last holds all longer ones.
    counts: [u64; LONGEST + 1],
    base: (i32, i32),
    late: u64,
    lost: u64,
}

impl Trips {
    /// For a controller that cycles every `cycle_s`. Until something came back, a trip is taken to last
    /// `guess` cycles.
    #[must_use]
    pub fn new(cycle_s: f64, guess: usize) -> Self {
        Self {
            cycle_s,
            sent: [(0, 0.0); REMEMBERED],
            next: 0,
            echoed: 0,
            echoed_at_s: None,
            begun_s: None,
            recent: [0.0; LONGEST + 1],
            usual: guess.min(LONGEST),
            counts: [0; LONGEST + 1],
            base: (0, 0),
            late: 0,
            lost: 0,
        }
    }

    /// `counter` answers the state stamped `timestamp_s`.
    pub fn sent(&mut self, counter: i32, timestamp_s: f64) {
        if let Some(slot) = self.sent.get_mut(self.next) {
            *slot = (counter, timestamp_s);
        }
        self.next = (self.next + 1) % REMEMBERED;
    }

    /// Another connection begins: what is under way is nobody's any more.
    pub fn restart(&mut self) {
        self.sent = [(0, 0.0); REMEMBERED];
        self.echoed = 0;
        (self.echoed_at_s, self.begun_s) = (None, None);
        self.base = (0, 0);
    }

    /// The program's answer in the state stamped `timestamp_s`. Returns whether it has read something new.
    pub fn answered(&mut self, answer: &ProgramAnswer, timestamp_s: f64) -> bool {
        self.begun_s.get_or_insert(timestamp_s);
        // Both grow; less than before is another program.
        let grown = |now: i32, before: i32| u64::try_from(now.checked_sub(before).unwrap_or(0)).unwrap_or(0);
        self.late += grown(answer.late, self.base.0);
        self.lost += grown(answer.lost, self.base.1);
        self.base = (answer.late, answer.lost);
        let Some((_, sent_s)) =
            self.sent.iter().copied().find(|(counter, _)| *counter == answer.echo && answer.echo > 0)
        else {
            return false;
        };
        if answer.echo == self.echoed {
            return false;
        }
        self.echoed = answer.echo;
        // Where states are missing, the echo was there before this one showed it.
        self.echoed_at_s = Some(timestamp_s.min(sent_s + self.usual as f64 * self.cycle_s));
        let cycles = ((timestamp_s - sent_s) / self.cycle_s).round();
        let length = if cycles >= 0.0 { (cycles as usize).min(LONGEST) } else { return false };
        if let Some(count) = self.counts.get_mut(length) {
            *count += 1;
        }
        self.recent.iter_mut().for_each(|recent| *recent *= FADE);
        if let Some(recent) = self.recent.get_mut(length) {
            *recent += 1.0;
        }
        self.choose_usual();
        true
    }

    /// Cycles from a state to the one that uses the answer to it: the most frequent of late.
    #[must_use]
    pub const fn usual(&self) -> usize {
        self.usual
    }

    /// The usual round trip \[ns\]; 0 before one was seen.
    #[must_use]
    pub fn usual_ns(&self) -> u64 {
        let seen = self.recent.iter().any(|recent| *recent > 0.0);
        if seen { (self.usual as f64 * self.cycle_s * 1e9) as u64 } else { 0 }
    }

    /// Whether a program has echoed a counter of this line. Registers outlive programs: only one that changes
    /// as our counters do is proof of a program that reads them.
    #[must_use]
    pub const fn is_echoed(&self) -> bool {
        self.echoed_at_s.is_some()
    }

    /// Seconds of the controller since a program last read something new, or since the line began.
    #[must_use]
    pub fn silence_s(&self, timestamp_s: f64) -> f64 {
        timestamp_s - self.echoed_at_s.or(self.begun_s).unwrap_or(timestamp_s)
    }

    /// Cycles in which the program found no fresh counter.
    #[must_use]
    pub const fn late(&self) -> u64 {
        self.late
    }

    /// Counters that the program never saw: a newer one came within the same cycle.
    #[must_use]
    pub const fn lost(&self) -> u64 {
        self.lost
    }

    /// Number of round trips of each length in cycles, from 0; the last holds all longer ones.
    #[must_use]
    pub const fn counts(&self) -> &[u64] {
        &self.counts
    }

    /// Another length is usual once it is half as frequent again: a target's instant does not flicker.
    fn choose_usual(&mut self) {
        let of = |length: usize| self.recent.get(length).copied().unwrap_or(0.0);
        let most =
            (0..=LONGEST).fold(self.usual, |most, length| if of(length) > of(most) { length } else { most });
        if of(most) > 1.5 * of(self.usual) {
            self.usual = most;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Sends a counter every cycle and echoes it `trip(cycle)` cycles later.
    fn run(cycles: u64, trip: impl Fn(u64) -> u64) -> Trips {
        let mut trips = Trips::new(0.008, 1);
        for cycle in 1..=cycles {
            let now = cycle as f64 * 0.008;
            let echo = cycle.saturating_sub(trip(cycle));
            trips.answered(&ProgramAnswer { echo: echo as i32, ..ProgramAnswer::default() }, now);
            trips.sent(cycle as i32, now);
        }
        trips
    }

    #[test]
    fn the_usual_round_trip_is_the_most_frequent_one() {
        assert_eq!(run(300, |_| 2).usual(), 2);
        assert_eq!(run(300, |cycle| if cycle % 5 == 0 { 3 } else { 2 }).usual(), 2);
        assert_eq!(run(0, |_| 2).usual(), 1);
    }

    #[test]
    fn two_lengths_as_frequent_as_each_other_do_not_make_it_flicker() {
        let mut trips = run(100, |_| 1);
        let mut changes = 0;
        for cycle in 101..600u64 {
            let (now, before) = (cycle as f64 * 0.008, trips.usual());
            let echo = (cycle - if (cycle / 3) % 2 == 0 { 1 } else { 2 }) as i32;
            trips.answered(&ProgramAnswer { echo, ..ProgramAnswer::default() }, now);
            trips.sent(cycle as i32, now);
            changes += usize::from(trips.usual() != before);
        }
        assert!(changes <= 1, "{changes}");
    }

    #[test]
    fn late_and_lost_are_summed_over_programs() {
        let mut trips = Trips::new(0.002, 1);
        let answer = |late, lost| ProgramAnswer { late, lost, ..ProgramAnswer::default() };
        trips.answered(&answer(3, 1), 0.0);
        trips.answered(&answer(5, 1), 0.1);
        // A new program begins at 0.
        trips.restart();
        trips.answered(&answer(2, 0), 0.2);
        assert_eq!((trips.late(), trips.lost()), (7, 1));
        trips.answered(&answer(i32::MIN, i32::MAX), 0.3);
        assert_eq!(trips.late(), 7);
    }

    #[test]
    fn echoes_of_others_are_not_trips() {
        let mut trips = Trips::new(0.002, 1);
        trips.sent(5, 1.0);
        for echo in [0, -1, 6, i32::MAX] {
            assert!(!trips.answered(&ProgramAnswer { echo, ..ProgramAnswer::default() }, 1.004));
        }
        assert!(!trips.is_echoed());
        assert!((trips.silence_s(1.104) - 0.1).abs() < 1e-12, "since the line began");
        assert!(trips.answered(&ProgramAnswer { echo: 5, ..ProgramAnswer::default() }, 1.004));
        assert!(trips.is_echoed());
        assert!(!trips.answered(&ProgramAnswer { echo: 5, ..ProgramAnswer::default() }, 1.006));
        // Sent at 1.0, read a cycle later as usual.
        assert!((trips.silence_s(1.102) - 0.1).abs() < 1e-12);
        assert_eq!(trips.counts()[2], 1);
    }
}
