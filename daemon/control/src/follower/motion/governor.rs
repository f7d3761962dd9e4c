//! The governor: how far of the way to the preview the arm is asked to go, because it is saturated.
//!
//! An arm that is saturated in nearly every tick cannot follow the preview: it lags, overshoots, and may be
//! worse than under feedback alone. Where following is hardly better than that ([`Outcome`]), the aim is
//! drawn towards the newest sample until the arm is saturated no more often than it should be; α, and with it
//! the gains of the plan, stay as they are. Where following is much better, saturation does no harm.
//!
//! κ ∈ [`governor_least`, 1] is a factor on the displacement from the newest sample to the aim, with
//!
//! d ln κ/dt = (1 − ρ)/`governor_rise_s` − ρ/(`governor_fall` · reaction)
//!
//! in time of motion. ρ is the saturated share ([`super::Saturation`]) while that is in vain, else 0; an
//! operator's trust is not governed, so κ rises.

use super::outcome::Outcome;
use crate::estimate::LawParameters;
use crate::estimate::record::Record;
use crate::state::state;
use crate::units::Stamp;

/// κ, and what following came to.
#[derive(Debug)]
pub(in crate::follower) struct Governor {
    law: LawParameters,
    outcome: Box<Outcome>,
    /// ln κ, at most 0.
    log_share: f64,
    period_ns: u64,
}

state! { [] Governor { outcome, log_share } fixed { law, period_ns } }

/// What a tick that followed the pen came to.
pub(in crate::follower) struct Followed {
    /// Release of the tick.
    pub(in crate::follower) now: Stamp,
    /// Commanded tool \[m\], plane frame.
    pub(in crate::follower) tool: [f64; 2],
    /// The newest sample \[m\], in the workspace, and its stamp.
    pub(in crate::follower) pen: (Stamp, [f64; 2]),
    /// From a command to the arm's motion \[ns\].
    pub(in crate::follower) dead_time_ns: u64,
    /// ρ; `None` unless a fresh plan was followed in motion.
    pub(in crate::follower) saturated: Option<f64>,
}

impl Governor {
    /// κ = 1, in ticks of `period_ns` \[ns\]; under feedback alone the commanded tool lags `lag_s` \[s\]
    /// behind the samples.
    pub(in crate::follower) fn new(period_ns: u64, lag_s: f64, law: &LawParameters) -> Self {
        let outcome = Box::new(Outcome::new(period_ns, lag_s, law));
        Self { law: *law, outcome, log_share: 0.0, period_ns }
    }

    /// κ, between the least and 1.
    pub(in crate::follower) fn share(&self) -> f64 {
        self.log_share.exp()
    }

    /// The arm, or the predictor, is another one from now on.
    pub(in crate::follower) fn release(&mut self) {
        self.log_share = 0.0;
    }

    /// Time was lost before this tick.
    pub(in crate::follower) fn break_off(&mut self) {
        self.outcome.break_off();
    }

    /// Takes in what a tick came to, `None` if the tool did not follow. `record`: of the preview in use;
    /// `governs`: no operator decides about the trust.
    pub(in crate::follower) fn record(&mut self, tick: Option<&Followed>, record: &Record, governs: bool) {
        let Some(tick) = tick else {
            self.outcome.forget();
            return;
        };
        self.outcome.see(tick.now, tick.tool, tick.pen, tick.dead_time_ns);
        let Some(saturated) = tick.saturated else { return };
        let LawParameters { governor_fall, governor_rise_s: rise_s, governor_least, right, .. } = self.law;
        // A right preview is worth its saturation: following it within the limits is the best there is.
        let in_vain = governs && self.outcome.is_poor() && !(record.preview <= right * record.hold);
        let vain = if in_vain { saturated } else { 0.0 };
        let fall_s = (governor_fall * self.outcome.reaction_ns(tick.dead_time_ns) as f64 * 1e-9).max(rise_s);
        let change = self.period_ns as f64 * 1e-9 * ((1.0 - vain) / rise_s - vain / fall_s);
        // Total, unlike `clamp`, for any least share.
        self.log_share = (self.log_share + change).max(governor_least.ln()).min(0.0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERIOD_NS: u64 = 2_000_000;
    const PERIOD_S: f64 = 2e-3;
    const DEAD_NS: u64 = 42_000_000;
    const LAG_S: f64 = 0.018;
    /// Dead time and feedback's lag \[s\].
    const REACTION_S: f64 = 0.06;
    const FALL_S: f64 = 7.0 * REACTION_S;
    const RISE_S: f64 = 0.19;

    /// Half of Hold's squared error.
    const FAIR: Record = Record { preview: 50.0, hold: 100.0, evidence: 20.0 };

    fn pen(t: f64) -> [f64; 2] {
        [0.02 * (9.0 * t).sin(), 0.01 * (14.0 * t).cos()]
    }

    /// A governor, and the arm that it governs.
    struct Rig {
        governor: Governor,
        now: Stamp,
        dead_time_ns: u64,
        /// Lag of the arm behind the pen \[s\].
        late_s: f64,
        record: Record,
        governs: bool,
    }

    impl Rig {
        /// After two seconds of an arm that follows no better than feedback alone, away from its limits.
        fn poor() -> Self {
            Self::behind(DEAD_NS)
        }

        fn behind(dead_time_ns: u64) -> Self {
            let lag_s = if dead_time_ns == 0 { 0.0 } else { LAG_S };
            let mut rig = Self {
                governor: Governor::new(PERIOD_NS, lag_s, &LawParameters::SHIPPED),
                now: Stamp(1_000_000_000),
                dead_time_ns,
                late_s: PERIOD_S + dead_time_ns as f64 * 1e-9 + LAG_S,
                record: FAIR,
                governs: true,
            };
            assert_eq!(rig.drive(2.0, Some(false)), 1.0);
            rig
        }

        /// One tick; the share after it.
        fn tick(&mut self, at_limit: Option<bool>) -> f64 {
            let at = |s: f64| pen(self.now.0 as f64 * 1e-9 + s);
            let tool = at(PERIOD_S + self.dead_time_ns as f64 * 1e-9 - self.late_s);
            let (now, dead_time_ns) = (self.now, self.dead_time_ns);
            let saturated = at_limit.map(|at_limit| f64::from(u8::from(at_limit)));
            let followed = Followed { now, tool, pen: (now, at(0.0)), dead_time_ns, saturated };
            self.governor.record(Some(&followed), &self.record, self.governs);
            self.now = self.now + PERIOD_NS;
            self.governor.share()
        }

        fn drive(&mut self, seconds: f64, at_limit: Option<bool>) -> f64 {
            (0..(seconds / PERIOD_S).round() as u64).fold(self.governor.share(), |_, _| self.tick(at_limit))
        }
    }

    fn assert_near(share: f64, expected: f64) {
        assert!((share / expected - 1.0).abs() < 1e-9, "{share} instead of {expected}");
    }

    #[test]
    fn the_share_falls_by_e_in_seven_reactions_of_saturation_in_vain_and_never_below_a_tenth() {
        let mut rig = Rig::poor();
        assert_near(rig.drive(FALL_S, Some(true)), (-1.0_f64).exp());
        for _ in 0..2000 {
            assert!(rig.tick(Some(true)) >= 0.1 - 1e-12);
        }
        assert_near(rig.governor.share(), 0.1);
        // Twice the reaction, half the pace, ...
        let mut slow = Rig::behind(2 * DEAD_NS + 18_000_000);
        assert_near(slow.drive(FALL_S, Some(true)), (-0.5_f64).exp());
        // ... and where there is none the fall is no faster than the rise.
        assert_near(Rig::behind(0).drive(RISE_S, Some(true)), (-1.0_f64).exp());
        let mut never = Rig::poor();
        never.dead_time_ns = u64::MAX;
        assert!((0.99..1.0).contains(&never.drive(1.0, Some(true))));
    }

    #[test]
    fn the_share_rises_by_e_in_a_fifth_of_a_second_of_motion_until_nothing_is_held_back() {
        let mut rig = Rig::poor();
        rig.drive(4.0, Some(true));
        assert_near(rig.drive(RISE_S, Some(false)), 0.1 * 1_f64.exp());
        assert_eq!(rig.drive(2.0, Some(false)), 1.0);
        // Who is at the pen is saturated to good purpose.
        rig.drive(4.0, Some(true));
        rig.late_s = 0.0;
        rig.drive(2.0, None);
        assert_near(rig.drive(RISE_S, Some(true)), 0.1 * 1_f64.exp());
        assert_eq!(rig.drive(2.0, Some(true)), 1.0);
    }

    #[test]
    fn rest_and_ticks_without_a_plan_leave_the_share_alone() {
        let mut rig = Rig::poor();
        assert_eq!(rig.drive(1.0, None), 1.0);
        let lowered = rig.drive(FALL_S, Some(true));
        assert_eq!(rig.drive(4.0, None), lowered);
        // Nor does an arm that does not follow; what following came to is then forgotten.
        for _ in 0..500 {
            rig.governor.record(None, &FAIR, true);
            assert_eq!(rig.governor.share(), lowered);
        }
        assert!(rig.tick(Some(true)) > lowered, "nothing is known to be in vain");
        assert!(rig.drive(2.0, Some(true)) < lowered);
    }

    #[test]
    fn a_right_preview_is_worth_every_saturation() {
        let mut rig = Rig::poor();
        rig.record = Record { preview: 9.9, ..FAIR };
        assert_eq!(rig.drive(4.0, Some(true)), 1.0);
        rig.record = Record { preview: 10.1, ..FAIR };
        assert_near(rig.drive(FALL_S, Some(true)), (-1.0_f64).exp());
        rig.record = Record { preview: 9.9, ..FAIR };
        assert_near(rig.drive(0.5 * RISE_S + 1e-3, Some(true)), (-1.0 + 48.0 * PERIOD_S / RISE_S).exp());
        // What is no number is not right.
        for record in [Record { preview: f64::NAN, ..FAIR }, Record { hold: f64::NAN, ..FAIR }] {
            let mut rig = Rig::poor();
            rig.record = record;
            assert!(rig.drive(1.0, Some(true)) < 0.2);
        }
    }

    #[test]
    fn while_an_operator_decides_the_share_rises_and_what_following_came_to_is_learned() {
        let mut rig = Rig::poor();
        let lowered = rig.drive(FALL_S, Some(true));
        rig.governs = false;
        assert_near(rig.drive(50.0 * PERIOD_S, Some(true)), lowered * (50.0 * PERIOD_S / RISE_S).exp());
        rig.late_s = 0.0;
        rig.drive(2.0, Some(true));
        rig.late_s = Rig::poor().late_s;
        rig.governs = true;
        assert_eq!(rig.tick(Some(true)), 1.0, "it had come to the pen meanwhile");
        assert!(rig.drive(2.0, Some(true)) < 0.5);
    }

    #[test]
    fn who_is_released_has_all_of_the_way_at_once_and_is_governed_as_before() {
        let mut rig = Rig::poor();
        rig.drive(4.0, Some(true));
        rig.governor.release();
        assert_eq!(rig.governor.share(), 1.0);
        assert_near(rig.drive(FALL_S, Some(true)), (-1.0_f64).exp());
    }

    /// It falls and rises as long as its time constants say in the mean.
    #[test]
    fn an_arm_ends_where_it_is_saturated_as_often_as_rise_and_fall_balance() {
        let mut rig = Rig::poor();
        let (mut due, mut at_limits) = (0.0, 0.0);
        for tick in 0..4000 {
            due += 1.6 * rig.governor.share();
            let at_limit = due >= 1.0;
            due -= f64::from(u8::from(at_limit));
            at_limits += f64::from(u8::from(at_limit && tick >= 2000));
            rig.tick(Some(at_limit));
        }
        let (share, well_used) = (at_limits / 2000.0, FALL_S / (FALL_S + RISE_S));
        assert!((share - well_used).abs() < 0.02, "{share} of the ticks, {well_used} expected");
        assert!((rig.governor.share() - share / 1.6).abs() < 0.1, "{}", rig.governor.share());
    }

    #[test]
    fn numbers_that_are_none_leave_a_share() {
        let mut rig = Rig::poor();
        for bad in [f64::NAN, f64::INFINITY, -1e300].into_iter().cycle().take(3000) {
            (rig.late_s, rig.record) = (bad, Record { preview: bad, hold: bad, evidence: bad });
            let share = rig.tick(Some(bad > 0.0));
            assert!((0.1 - 1e-12..=1.0).contains(&share), "{share}");
        }
    }
}
