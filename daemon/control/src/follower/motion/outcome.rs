//! Outcome of following: the tool's distance from the pen, relative to that under feedback alone.
//!
//! Contract: fixed size, no allocation, total. The command of one dead time before the sample is used as tool
//! position: that is where the arm is at the sample, also if a plan models its servo (commands then lead by
//! the servo's lag). Under feedback alone the tool is where the pen was one dead time and feedback lag
//! earlier.

use crate::estimate::LawParameters;
use crate::state::state;
use crate::units::Stamp;

/// Ticks remembered: half a second in periods of 1 ms, more than the longest dead time and lag.
const TICKS: usize = 512;

/// The two mean squared errors.
#[derive(Debug, Clone)]
pub(super) struct Outcome {
    /// Tool and pen per tick \[m\], a ring; `last` is the newest, `known` how many there are.
    tool: [[f64; 2]; TICKS],
    pen: [[f64; 2]; TICKS],
    last: usize,
    known: usize,
    period_ns: u64,
    lag_ns: u64,
    /// See [`LawParameters::outcome_s`] and [`LawParameters::outcome_poor`].
    time_s: f64,
    poor: f64,
    /// Mean squared errors \[m²\].
    followed: f64,
    held: f64,
}

state! { [] Outcome { tool, pen, last, known, period_ns, lag_ns, time_s, poor, followed, held } }

impl Outcome {
    /// Without evidence, in ticks of `period_ns` \[ns\]; feedback lags `lag_s` \[s\] behind the samples.
    #[must_use]
    pub(super) fn new(period_ns: u64, lag_s: f64, law: &LawParameters) -> Self {
        Self {
            tool: [[0.0; 2]; TICKS],
            pen: [[0.0; 2]; TICKS],
            last: 0,
            known: 0,
            period_ns: period_ns.max(1),
            lag_ns: (lag_s * 1e9) as u64,
            time_s: law.outcome_s,
            poor: law.outcome_poor,
            followed: 0.0,
            held: 0.0,
        }
    }

    /// The arm does not follow: nothing to judge.
    pub(super) fn forget(&mut self) {
        (self.known, self.followed, self.held) = (0, 0.0, 0.0);
    }

    /// Time was lost: stored ticks are older than their index says. The mean errors stay.
    pub(super) fn break_off(&mut self) {
        self.known = 0;
    }

    /// A tick at `now` put the tool to `tool` \[m\] for the end of its period; the newest sample lay at `pen`
    /// \[m\] at `stamp`.
    pub(super) fn see(
        &mut self,
        now: Stamp,
        tool: [f64; 2],
        (stamp, pen): (Stamp, [f64; 2]),
        dead_time_ns: u64,
    ) {
        self.last = (self.last + 1) % TICKS;
        self.known = (self.known + 1).min(TICKS);
        if let (Some(to), Some(at)) = (self.tool.get_mut(self.last), self.pen.get_mut(self.last)) {
            (*to, *at) = (tool, pen);
        }
        let age_ns = u64::try_from(now.since(stamp)).unwrap_or(0);
        let back_ns = age_ns.saturating_add(dead_time_ns).saturating_add(self.period_ns);
        let ago = |trail: &[[f64; 2]; TICKS], ns: u64| {
            let ticks = usize::try_from(ns.saturating_add(self.period_ns / 2) / self.period_ns).ok()?;
            (ticks < self.known).then(|| trail.get((self.last + TICKS - ticks) % TICKS).copied()).flatten()
        };
        let reached = ago(&self.tool, back_ns);
        let feedback = ago(&self.pen, back_ns.saturating_add(self.lag_ns));
        let (Some(reached), Some(feedback)) = (reached, feedback) else { return };
        let off = |[x, y]: [f64; 2]| {
            let [px, py] = pen;
            (x - px) * (x - px) + (y - py) * (y - py)
        };
        let pace = self.period_ns as f64 * 1e-9 / self.time_s;
        let (followed, held) = (
            self.followed + pace * (off(reached) - self.followed),
            self.held + pace * (off(feedback) - self.held),
        );
        if followed.is_finite() && held.is_finite() {
            (self.followed, self.held) = (followed, held);
        }
    }

    /// Delay from a change of the plan's targets to its effect here: dead time plus the lag of feedback
    /// \[ns\].
    #[must_use]
    pub(super) const fn reaction_ns(&self, dead_time_ns: u64) -> u64 {
        dead_time_ns.saturating_add(self.lag_ns)
    }

    /// Following was hardly better than feedback alone.
    #[must_use]
    pub(super) fn is_poor(&self) -> bool {
        self.followed > self.poor * self.held
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERIOD_NS: u64 = 2_000_000;
    const DEAD_NS: u64 = 34_000_000;
    const LAG_S: f64 = 0.018;

    fn pen(t: f64) -> [f64; 2] {
        [0.02 * (9.0 * t).sin(), 0.01 * (14.0 * t).cos()]
    }

    /// Two seconds of an arm whose tool is, one dead time after the command, where the pen was `late_s`
    /// earlier.
    fn follow(outcome: &mut Outcome, late_s: f64) {
        for tick in 0..1000_u64 {
            let now = Stamp(1_000_000_000 + tick * PERIOD_NS);
            let at = |ns: f64| pen((now.0 as f64 + ns) * 1e-9);
            let tool = at((PERIOD_NS + DEAD_NS) as f64 - late_s * 1e9);
            // The newest sample is 4 ms old.
            outcome.see(now, tool, (Stamp(now.0 - 4_000_000), at(-4e6)), DEAD_NS);
        }
    }

    #[test]
    fn who_follows_like_feedback_follows_poorly_and_who_is_there_does_not() {
        let mut outcome = Outcome::new(PERIOD_NS, LAG_S, &LawParameters::SHIPPED);
        assert!(!outcome.is_poor());
        follow(&mut outcome, 0.0);
        assert!(!outcome.is_poor());
        assert!(outcome.followed < 1e-4 * outcome.held, "{} {}", outcome.followed, outcome.held);
        // Feedback commands for the end of its period where the pen was its lag before the newest sample.
        let feedback_s = PERIOD_NS as f64 * 1e-9 + DEAD_NS as f64 * 1e-9 + LAG_S + 0.004;
        follow(&mut outcome, feedback_s);
        assert!((outcome.followed / outcome.held - 1.0).abs() < 0.01, "{}", outcome.followed / outcome.held);
        assert!(outcome.is_poor());
        // Squared errors are proportional to squared lags.
        follow(&mut outcome, 0.6 * feedback_s);
        assert!(!outcome.is_poor());
        follow(&mut outcome, 0.8 * feedback_s);
        assert!(outcome.is_poor());
        outcome.forget();
        assert!(!outcome.is_poor());
    }

    #[test]
    fn what_is_poor_and_how_long_is_looked_back_are_parameters() {
        let mut strict = LawParameters { outcome_poor: 0.01, ..LawParameters::SHIPPED };
        let mut outcome = Outcome::new(PERIOD_NS, LAG_S, &LawParameters::SHIPPED);
        let mut asked = Outcome::new(PERIOD_NS, LAG_S, &strict);
        strict.outcome_s = 1e3;
        let mut slow = Outcome::new(PERIOD_NS, LAG_S, &strict);
        for outcome in [&mut outcome, &mut asked, &mut slow] {
            follow(outcome, 0.02);
        }
        assert!(!outcome.is_poor() && asked.is_poor());
        assert!(slow.held < 0.01 * asked.held, "{} {}", slow.held, asked.held);
        // Non-finite parameters have no effect.
        let nothing = LawParameters { outcome_s: 0.0, outcome_poor: f64::NAN, ..LawParameters::SHIPPED };
        let mut broken = Outcome::new(PERIOD_NS, LAG_S, &nothing);
        follow(&mut broken, 0.02);
        assert!(!broken.is_poor() && broken.followed == 0.0);
    }

    #[test]
    fn time_that_was_lost_is_no_error_of_an_arm_that_is_where_it_should_be() {
        let followed = |reported: bool| {
            let mut outcome = Outcome::new(PERIOD_NS, LAG_S, &LawParameters::SHIPPED);
            let mut now = Stamp(1_000_000_000);
            for tick in 0..3000_u64 {
                now = now + PERIOD_NS;
                if tick % 200 == 199 {
                    now = now + 20 * PERIOD_NS;
                    if reported {
                        outcome.break_off();
                    }
                }
                let at = |ns: f64| pen((now.0 as f64 + ns) * 1e-9);
                outcome.see(now, at((PERIOD_NS + DEAD_NS) as f64), (now, at(0.0)), DEAD_NS);
            }
            outcome.followed / outcome.held
        };
        let [known, unreported] = [true, false].map(followed);
        assert!(known < 1e-4 && unreported > 10.0 * known, "{known} {unreported}");
    }

    #[test]
    fn numbers_that_are_none_and_times_that_cannot_be_leave_sound_sums() {
        let mut outcome = Outcome::new(PERIOD_NS, f64::NAN, &LawParameters::SHIPPED);
        follow(&mut outcome, 0.1);
        let bad = [f64::NAN, f64::INFINITY, -1e300];
        for (tick, bad) in bad.into_iter().cycle().take(600).enumerate() {
            let now = Stamp(tick as u64 * 1_000);
            outcome.see(now, [bad, 0.0], (Stamp(u64::MAX), [0.0, bad]), u64::MAX);
            outcome.see(now, [bad, 0.0], (now, [0.0, bad]), DEAD_NS);
        }
        assert!(outcome.followed.is_finite() && outcome.held.is_finite());
        follow(&mut outcome, 0.0);
        assert!(!outcome.is_poor());
    }
}
