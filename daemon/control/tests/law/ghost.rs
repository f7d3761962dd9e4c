//! The ghost beside a loop: the same motion if the loop is at Hold, that of a loop at trust 0 if it predicts,
//! and no figures where ticks are missing.

use std::collections::VecDeque;

use crate::support::{HOME, PERIOD_NS, settings};
use foretrace_control::follower::{
    Budget, Follower, JointReading, Mode, NoClock, Request, StepInput, StepOutput,
};
use foretrace_control::ghost::{Ghost, GhostReport, GhostState, GhostTick};
use foretrace_control::pen::PenReading;
use foretrace_control::predict::PredictorKind;
use foretrace_control::trust::TrustRequest;
use foretrace_control::units::{Stamp, Trust};

/// The arm is where the commands wanted it this many periods ago.
const LAG_PERIODS: u64 = 15;
const LAG_NS: u64 = LAG_PERIODS * PERIOD_NS;

/// A loop in front of an arm with a delay and a servo of first order, and its ghost.
struct Rig {
    follower: Follower<10, 6>,
    ghost: Ghost<10, 6>,
    sent: VecDeque<[f64; 6]>,
    q: [f64; 6],
    now: Stamp,
    tick: u64,
    /// Ticks that the ghost does not receive.
    deaf: bool,
    /// Fraction of the remaining way that the servo moves per period; 1: a pure delay.
    servo: f64,
    /// The arm's lag as reported to the ghost.
    lag_ns: i64,
    /// Age of a pen sample when it arrives.
    pen_age_ns: u64,
}

impl Rig {
    fn new(trust: TrustRequest) -> Self {
        let mut settings = settings(PredictorKind::CONSTANT_VELOCITY);
        settings.trust_request = trust;
        settings.dead_time_ns = LAG_NS;
        settings.trust.stale_after_ns = 300_000_000;
        // The ghost must transform from device to plane as the loop does.
        settings.plane.pen_scale = 2.0;
        settings.plane.pen_origin = [0.003, -0.002];
        Self {
            ghost: Ghost::new(settings.clone()).unwrap(),
            follower: Follower::new(settings).unwrap(),
            sent: VecDeque::new(),
            q: HOME,
            now: Stamp(10_000_000_000),
            tick: 0,
            deaf: false,
            servo: 1.0,
            lag_ns: LAG_NS as i64,
            pen_age_ns: 3_000_000,
        }
    }

    fn tick(&mut self, pen: &[PenReading], request: Option<Request>) -> (StepOutput<6>, GhostReport) {
        let joints = JointReading { stamp: self.now, q: self.q, qd: [0.0; 6], motion_allowed: true };
        let input = StepInput { pen, joints: Some(&joints), request, ..StepInput::nothing(self.now) };
        let output = self.follower.step(&input, Budget::default(), &mut NoClock);
        self.tick += 1;
        let tick = GhostTick {
            tick: self.tick,
            now: self.now,
            budget: Budget::default(),
            output: &output,
            measured: Some((self.now, self.q)),
            lag_ns: self.lag_ns,
        };
        let report = if self.deaf { GhostReport::default() } else { self.ghost.follow(&tick) };
        if let Some(command) = output.command {
            self.sent.push_back(command.q);
            // The command is for the next tick; the arm is late by the lag.
            if self.sent.len() as u64 > LAG_PERIODS {
                let wanted = self.sent.pop_front().unwrap();
                self.q.iter_mut().zip(wanted).for_each(|(q, wanted)| *q += self.servo * (wanted - *q));
            }
        }
        self.now = self.now.plus_ns(PERIOD_NS);
        (output, report)
    }

    /// The pen as it comes at 200 Hz; irregular to the ticks.
    fn pen(&self) -> Vec<PenReading> {
        let (first, period) = (10_000_000_000, 5_000_000);
        let newest = |now: u64| now.saturating_sub(first + self.pen_age_ns) / period;
        (newest(self.now.0 - PERIOD_NS) + 1..=newest(self.now.0))
            .map(|k| {
                let t = k as f64 * 0.005;
                let place = [0.003 + 0.0075 * (6.7 * t).sin(), -0.002 + 0.006 * (9.2 * t + 0.4).sin()];
                PenReading::new(Stamp(first + k * period), place, t % 2.0 < 1.6)
            })
            .collect()
    }

    fn write(&mut self, ticks: u64) -> Vec<(StepOutput<6>, GhostReport)> {
        (0..ticks)
            .map(|_| {
                let pen = self.pen();
                self.tick(&pen, None)
            })
            .collect()
    }

    fn armed(trust: TrustRequest) -> Self {
        let mut rig = Self::new(trust);
        for _ in 0..20 {
            assert_eq!(rig.tick(&[], None).1, GhostReport::default());
        }
        assert_eq!(rig.tick(&[], Some(Request::Arm)).0.answer, Some(Ok(())));
        rig
    }
}

const HOLD: TrustRequest = TrustRequest::Manual(Trust::NONE);
const BELIEVE: TrustRequest = TrustRequest::Manual(Trust::FULL);

#[test]
fn the_ghost_of_a_loop_that_only_holds_is_that_loop_bit_for_bit() {
    let mut rig = Rig::armed(HOLD);
    let mut compared = 0;
    for (output, report) in rig.write(3000) {
        assert_eq!(report.tool, output.command.map(|_| output.tool));
        if let Some(both) = report.compared {
            assert!((both.error_m - both.ghost_error_m).abs() < 1e-12, "{both:?}");
            compared += 1;
        }
    }
    assert!(compared > 2000, "{compared}");
    let figures = rig.ghost.figures();
    assert_eq!(figures.state, GhostState::Comparable);
    assert!((figures.real.session_rms.unwrap() - figures.ghost.session_rms.unwrap()).abs() < 1e-12);
    assert_eq!(
        figures.real.recent_lag.map(|s| (s * 1e9) as i64),
        figures.ghost.recent_lag.map(|s| (s * 1e9) as i64)
    );
    assert!(figures.real.session_lag.unwrap() > LAG_NS as f64 * 1e-9);
}

#[test]
fn the_ghost_of_a_loop_that_predicts_does_what_a_loop_at_trust_0_does() {
    let (mut holding, mut predicting) = (Rig::armed(HOLD), Rig::armed(BELIEVE));
    let mut apart = 0.0_f64;
    for ((held, _), (output, report)) in holding.write(3000).iter().zip(predicting.write(3000)) {
        assert_eq!(report.tool, Some(held.tool));
        apart = apart.max((output.tool[0] - held.tool[0]).abs());
    }
    assert!(apart > 1e-3, "the loop never left its ghost");
    let (held, figures) = (holding.ghost.figures(), predicting.ghost.figures());
    let close = |a: Option<f64>, b: Option<f64>| (a.unwrap() - b.unwrap()).abs() < 1e-4;
    assert!(close(held.real.session_rms, figures.ghost.session_rms), "{held:?} {figures:?}");
    let (real, ghost) = (figures.real, figures.ghost);
    assert!(real.session_rms.unwrap() < 0.6 * ghost.session_rms.unwrap(), "{figures:?}");
    assert!(real.session_lag.unwrap() + 0.02 < ghost.session_lag.unwrap(), "{figures:?}");
}

/// Behind a network the pen of an instant is known late; the tools are compared with it all the same.
#[test]
fn a_pen_that_is_old_on_arrival_is_compared_at_its_own_time() {
    let lag_s = |pen_age_ns: u64| {
        let mut rig = Rig { pen_age_ns, ..Rig::armed(HOLD) };
        rig.write(4000);
        let figures = rig.ghost.figures();
        assert_eq!(figures.state, GhostState::Comparable, "{pen_age_ns}");
        assert!(figures.seconds > 4.0, "{figures:?}");
        assert_eq!(figures.real.session_lag, figures.ghost.session_lag);
        figures.real.session_lag.unwrap()
    };
    let soon = lag_s(3_000_000);
    for age_ms in [60.0, 150.0, 250.0] {
        let later = lag_s((age_ms * 1e6) as u64) - soon;
        assert!((later - (age_ms - 3.0) * 1e-3).abs() < 3e-3, "age {age_ms} ms: {later} s later");
    }
}

#[test]
fn behind_an_arm_that_filters_the_ghost_is_judged_as_a_loop_at_trust_0_would_be() {
    let written = |trust: TrustRequest| {
        let mut rig = Rig::armed(trust);
        // 25 ms, on top of the delay; the reported lag fits neither fast nor slow motion.
        rig.servo = 0.077;
        rig.lag_ns = 45_000_000;
        rig.write(4000);
        rig.ghost.figures()
    };
    let (held, figures) = (written(HOLD), written(BELIEVE));
    for (name, ghost) in [("its own", held.ghost), ("the other's", figures.ghost)] {
        let ratio = ghost.session_rms.unwrap() / held.real.session_rms.unwrap();
        assert!((ratio - 1.0).abs() < 0.01, "{name}: {ratio}");
        let apart_s = ghost.session_lag.unwrap() - held.real.session_lag.unwrap();
        assert!(apart_s.abs() < 1e-3, "{name}: {apart_s} s");
    }
    assert!(figures.real.session_rms.unwrap() < 0.8 * figures.ghost.session_rms.unwrap(), "{figures:?}");
}

#[test]
fn after_missing_ticks_nothing_is_compared_until_both_have_settled() {
    let mut rig = Rig::armed(HOLD);
    rig.write(1500);
    assert_eq!(rig.ghost.figures().state, GhostState::Comparable);
    rig.deaf = true;
    rig.write(7);
    rig.deaf = false;
    let after = rig.write(1000);
    let quiet = after.iter().position(|(_, report)| report.state != GhostState::Settling).unwrap();
    assert!((499..=501).contains(&quiet), "{quiet} ticks instead of a second");
    // Instants are judged a tenth of a second later.
    assert!(after[..quiet + 45].iter().all(|(_, report)| report.compared.is_none()));
    assert!(after[..quiet].iter().any(|(output, report)| report.tool != Some(output.tool)));
    let settled: Vec<_> = after[quiet + 60..].iter().filter_map(|(_, report)| report.compared).collect();
    assert!(settled.len() > 300);
    for both in settled {
        assert!((both.error_m - both.ghost_error_m).abs() < 1e-4, "{both:?}");
    }
}

#[test]
fn without_pen_or_arm_nothing_is_compared_and_a_new_session_begins_with_arming() {
    let mut rig = Rig::armed(BELIEVE);
    rig.write(2000);
    let before = rig.ghost.figures();
    assert!(before.seconds > 2.0);
    for _ in 0..200 {
        rig.tick(&[], None);
    }
    assert_eq!(rig.ghost.figures().state, GhostState::Approaching, "the pen is silent");
    rig.tick(&[], Some(Request::Disarm));
    while rig.tick(&[], None).0.mode != Mode::Idle {}
    // Figures stay until the next session.
    let idle = rig.ghost.figures();
    assert_eq!((idle.state, idle.real.session_rms.is_some()), (GhostState::Off, true));
    for _ in 0..50 {
        assert_eq!(rig.tick(&[], None).1, GhostReport::default());
    }
    rig.sent.clear();
    assert_eq!(rig.tick(&[], Some(Request::Arm)).0.answer, Some(Ok(())));
    assert_eq!(rig.ghost.figures().real.session_rms, None);
    rig.write(1500);
    assert_eq!(rig.ghost.figures().state, GhostState::Comparable);
}

#[test]
fn a_ghost_that_comes_late_or_hears_nonsense_says_that_it_cannot_tell() {
    let mut rig = Rig::new(BELIEVE);
    rig.deaf = true;
    rig.tick(&[], Some(Request::Arm));
    rig.write(500);
    rig.deaf = false;
    assert!(rig.write(400).iter().all(|(_, report)| report.state == GhostState::Settling));
    // The same tick again, time that stands still, runs back or jumps: never a panic, never a non-finite
    // number.
    for (k, leap_ms) in [0_i64, -3000, 40, 5000, 0, 1_000_000].into_iter().enumerate() {
        rig.now = Stamp(rig.now.0.saturating_add_signed(leap_ms * 1_000_000));
        rig.tick -= u64::from(k % 2 == 0);
        for (_, report) in rig.write(50) {
            let numbers = report.compared.map_or([0.0; 2], |both| [both.error_m, both.ghost_error_m]);
            assert!(numbers.iter().all(|number| number.is_finite()), "{report:?}");
        }
    }
    let figures = rig.ghost.figures();
    let all = [figures.real, figures.ghost].map(|one| [one.session_rms, one.hover_rms, one.session_lag]);
    assert!(all.into_iter().flatten().flatten().all(f64::is_finite), "{figures:?}");
}
