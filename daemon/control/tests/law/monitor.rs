//! The tracking monitor by itself: simulated arms, each with one fault, and the findings.

use crate::support;
use foretrace_control::arm::lag::LagEstimate;
use foretrace_control::follower::FollowerError;
use foretrace_control::monitor::{ArmKnowledge, Monitor, SlowArm, TrackingSettings};
use foretrace_control::predict::PredictorKind;
use foretrace_control::stop::{StopCause, StopDetail};
use foretrace_control::units::Stamp;
use std::f64::consts::TAU;

const TICK_NS: u64 = 2_000_000;
const TICK_S: f64 = 2e-3;
/// The tool goes this far per turn of joint 0 \[m/rad\].
const LEVER_M: f64 = 0.2;

/// Three joints, of which the first moves the tool.
struct Rig {
    monitor: Monitor<3>,
    lag: Option<LagEstimate>,
    tick: u64,
}

impl Rig {
    fn new(settings: TrackingSettings, longest_ns: u64) -> Self {
        let mut monitor = Monitor::new(settings, longest_ns, [3.1; 3]);
        monitor.begin(Stamp(1_000_000_000));
        let mut rig = Self { monitor, lag: None, tick: 500 };
        rig.monitor.commanded(rig.now(), &[0.0; 3], &[0.0; 3]);
        rig
    }

    fn usual() -> Self {
        Self::new(TrackingSettings::DEFAULT, 40_000_000)
    }

    fn now(&self) -> Stamp {
        Stamp(self.tick * TICK_NS)
    }

    /// One tick: joint states as `measured`, with the tool `off` \[m\] where they put it, then the next
    /// command.
    fn tick_off(&mut self, measured: [f64; 3], off: [f64; 3], command: [f64; 3]) -> Option<StopDetail> {
        let known = ArmKnowledge { lag: self.lag, response: None };
        let tool_of = |q: &[f64; 3]| {
            let [x, y, z] = if *q == measured { off } else { [0.0; 3] };
            [x + LEVER_M * q[0], y, z]
        };
        let wrong = self.monitor.measured(self.now(), &measured, &known, tool_of);
        self.tick += 1;
        self.monitor.commanded(self.now(), &command, &[LEVER_M * command[0], 0.0, 0.0]);
        wrong
    }

    fn tick(&mut self, measured: [f64; 3], command: [f64; 3]) -> Option<StopDetail> {
        self.tick_off(measured, [0.0; 3], command)
    }

    /// Stands at zero for a second.
    fn rested(mut self) -> Self {
        for _ in 0..500 {
            assert_eq!(self.tick([0.0; 3], [0.0; 3]), None);
        }
        self
    }
}

/// Finding within 3 s for an arm whose joints do the shares `does` of their commands: up and down by 12 mrad
/// times `asked`, once a second.
fn partly(asked: [f64; 3], does: [f64; 3]) -> Option<StopDetail> {
    let mut rig = Rig::usual().rested();
    (0..1500).find_map(|tick| {
        let wave = |t: f64| asked.map(|size| 0.006 * size * (1.0 - (TAU * t).cos()));
        let t = f64::from(tick) * TICK_S;
        let command = wave(t);
        let measured = std::array::from_fn(|i| does[i] * command[i]);
        rig.tick(measured, wave(t + TICK_S))
    })
}

#[test]
fn a_joint_that_stands_is_named_and_an_arm_that_stands_is_the_arm() {
    let all = [1.0, 0.9, 0.8];
    for (asked, does, joint) in [
        (all, [1.0, 0.0, 1.0], Some(1)),
        (all, [1.0, 1.0, 0.04], Some(2)),
        // Of two joints that stand, the one with the larger command.
        (all, [1.0, 0.0, 0.0], Some(1)),
        ([0.0, 0.0, 1.0], [1.0, 1.0, 0.0], Some(2)),
        // With equal commands they are found together.
        ([1.0; 3], [0.0; 3], None),
        ([1.0, 0.0, 1.0], [0.0, 1.0, 0.0], None),
    ] {
        let detail = partly(asked, does).expect("it stands");
        assert_eq!((detail.cause, detail.joint), (StopCause::NoMotion, joint), "{asked:?} {does:?}");
        assert_eq!(detail.limit, TrackingSettings::DEFAULT.still_rad);
        assert!(detail.amount > detail.limit && detail.amount < 0.012, "{detail:?}");
    }
    assert_eq!(partly(all, [1.0; 3]), None);
    assert_eq!(partly(all, [1.0, 0.06, 1.0]), None, "a twentieth of what was asked is motion");
    assert_eq!(partly([0.4; 3], [0.0; 3]), None, "motion this small need not show");
}

/// Finding within 3 s for an arm whose servo is a critically damped filter with a lag of 0.1 s, known or not,
/// where joint 1 is asked to swing by 4 mrad at `hz`; `jammed`, where it stands.
fn swung_at(hz: f64, known: bool, jammed: bool) -> Option<StopDetail> {
    let mut rig = Rig::new(TrackingSettings::DEFAULT, 150_000_000).rested();
    rig.lag = known.then_some(LagEstimate { lag_s: 0.1, std_s: 1e-3, shift_s: 0.05 });
    let asked = |tick: i32| {
        let t = f64::from(tick) * TICK_S;
        [0.02 * (TAU * t).sin(), 0.004 * (TAU * hz * t).sin(), 0.0]
    };
    let w = 2.0 / 0.1;
    let (mut joints, mut speeds) = ([0.0; 3], [0.0; 3]);
    (0..1500).find_map(|tick| {
        for ((q, v), target) in joints.iter_mut().zip(&mut speeds).zip(asked(tick)) {
            *v += TICK_S * w * (w * (target - *q) - 2.0 * *v);
            *q += TICK_S * *v;
        }
        let [first, second, third] = joints;
        rig.tick([first, if jammed { 0.0 } else { second }, third], asked(tick + 1))
    })
}

#[test]
fn short_strokes_that_a_slow_servo_takes_away_are_no_standing_joint() {
    for known in [false, true] {
        for hz in [3.0, 8.0, 14.0, 18.0, 25.0] {
            assert_eq!(swung_at(hz, known, false), None, "{hz} Hz, lag known: {known}");
        }
        // What a servo of 0.15 s leaves of 8 Hz, a coarse encoder may hide.
        let jammed: &[f64] = if known { &[2.0, 3.0, 8.0] } else { &[2.0, 3.0] };
        for hz in jammed {
            let found = swung_at(*hz, known, true).expect("it is jammed");
            assert_eq!((found.cause, found.joint), (StopCause::NoMotion, Some(1)), "{hz} Hz");
        }
    }
}

#[test]
fn a_joint_that_leaves_its_commands_runs_away_or_goes_the_wrong_way() {
    let TrackingSettings { joint_rad, runaway_radps, .. } = TrackingSettings::DEFAULT;
    for sign in [1.0, -1.0] {
        // Commands that stand, and commands that lead the other way.
        for (commanded_radps, cause, amount, limit) in [
            (0.0, StopCause::Runaway, 0.3, runaway_radps),
            (-0.6, StopCause::WrongDirection, 0.0125, 0.5 * joint_rad),
        ] {
            let mut rig = Rig::usual().rested();
            let after = |tick: u32, radps: f64| [0.0, sign * radps * f64::from(tick) * TICK_S, 0.0];
            let (tick, detail) = (0..100)
                .find_map(|tick| {
                    let wrong = rig.tick(after(tick, 0.3), after(tick + 1, commanded_radps));
                    wrong.map(|wrong| (tick, wrong))
                })
                .expect("it leaves");
            assert_eq!((detail.cause, detail.joint, detail.limit), (cause, Some(1), limit), "{sign}");
            assert!((detail.amount / amount - 1.0).abs() < 0.1, "{detail:?}");
            // Half of the tolerance is used up in 34 ms; then it must last for 10 ms.
            assert_eq!(tick, 17 + 5, "{detail:?}");
        }
    }
}

#[test]
fn what_creeps_away_is_blamed_where_the_tolerance_ends() {
    let TrackingSettings { joint_rad, tool_m, .. } = TrackingSettings::DEFAULT;
    let mut rig = Rig::usual().rested();
    let creep = |tick: u32| -0.05 * f64::from(tick) * TICK_S;
    let (tick, detail) = (0..400)
        .find_map(|tick| rig.tick([0.0, 0.0, creep(tick)], [0.0; 3]).map(|wrong| (tick, wrong)))
        .expect("it creeps");
    assert_eq!((detail.cause, detail.joint, detail.limit), (StopCause::JointDeviation, Some(2), joint_rad));
    assert_eq!(detail.amount, -creep(tick));
    assert!((200..=206).contains(&tick), "{tick}");

    // At the tolerance to the last bit it is still inside.
    let mut rig = Rig::usual().rested();
    assert!((0..800).all(|tick| rig.tick([0.0, 0.0, creep(tick).max(-joint_rad)], [0.0; 3]).is_none()));

    // The tool is judged by its distance: the way along three axes together; three times as patiently until
    // the arm has moved for two seconds.
    for (moved_s, limit) in [(0.0, 3.0 * tool_m), (3.0, tool_m)] {
        for (part, blamed) in [(1.02, true), (0.98, false)] {
            let off = part * limit / 3f64.sqrt();
            let mut rig = Rig::usual().rested();
            let turns = (moved_s / TICK_S) as u32;
            for tick in 0..turns {
                let at = |tick: u32| 0.3 * (TAU * f64::from(tick) / f64::from(turns) * 2.0).sin();
                assert_eq!(rig.tick([0.0, at(tick), 0.0], [0.0, at(tick + 1), 0.0]), None);
            }
            let mut rig = rig.rested();
            let found = (0..500).find_map(|tick| {
                let here = off * (f64::from(tick) * TICK_S).min(1.0);
                // Of no joint: the tool alone is off.
                rig.tick_off([1e-12, 0.0, 0.0], [here, -here, here], [0.0; 3])
            });
            assert_eq!(found.is_some(), blamed, "{moved_s} {off}");
            if let Some(detail) = found {
                assert_eq!(
                    (detail.cause, detail.joint, detail.limit),
                    (StopCause::ToolDeviation, None, limit)
                );
                assert!(detail.amount > limit && detail.amount <= off * 3f64.sqrt() + 1e-9, "{detail:?}");
            }
        }
    }
    // A single joint state far off does not last.
    let mut rig = Rig::usual().rested();
    assert_eq!(rig.tick([0.5, 0.0, 0.0], [0.0; 3]), None);
    rig.rested();
}

/// About constant commands: oscillation of `size` \[rad\] at 1.5 Hz, with amplitudes growing by `growth`.
fn swinging(size: f64, growth: f64) -> Option<StopDetail> {
    let mut rig = Rig::usual().rested();
    (0..1500).find_map(|tick| {
        let swings = 3.0 * f64::from(tick) * TICK_S;
        let q = size * growth.powf(swings.floor()) * (0.5 * TAU * swings).sin();
        rig.tick([0.0, q, 0.0], [0.0; 3])
    })
}

#[test]
fn a_joint_that_swings_farther_each_time_is_blamed_long_before_the_tolerance_ends() {
    let joint_rad = TrackingSettings::DEFAULT.joint_rad;
    let detail = swinging(0.0025, 1.3).expect("it is about to be unstable");
    assert_eq!((detail.cause, detail.joint), (StopCause::Oscillation, Some(1)));
    assert_eq!(detail.limit, 0.25 * joint_rad);
    assert!(detail.amount > 0.25 * joint_rad && detail.amount < 0.4 * joint_rad, "{detail:?}");
    for growth in [1.0, 0.9] {
        assert_eq!(swinging(0.45 * joint_rad, growth), None, "{growth}");
    }
    assert_eq!(swinging(5e-4, 1.2), None, "too small to say anything");
}

#[test]
fn after_a_stop_an_arm_is_suspect_while_it_moves_or_stands_elsewhere() {
    let mut rig = Rig::usual().rested();
    assert!(!rig.monitor.unsettled(0.05), "nothing was wrong yet");
    let away = |tick: u32| [0.3 * f64::from(tick) * TICK_S, 0.0, 0.0];
    assert!((0..100).any(|tick| rig.tick(away(tick), [0.0; 3]).is_some()));
    assert!(rig.monitor.unsettled(0.05), "it goes on");
    // `moving` [rad/s] about `at` [rad] for 0.2 s.
    let mut stand = |at: f64, moving: f64| {
        for tick in 0..100 {
            rig.tick += 1;
            rig.monitor.watched(rig.now(), &[at + moving * f64::from(tick) * TICK_S, 0.0, 0.0]);
        }
        rig.monitor.unsettled(0.05)
    };
    assert!(stand(0.025, 0.0), "it stands outside the tolerance");
    assert!(stand(0.0, 0.06), "it is near, but moves");
    assert!(!stand(-0.015, 0.04));
    assert!(stand(0.03, 0.0));
    rig.monitor.acknowledge();
    assert!(!rig.monitor.unsettled(0.05), "an operator says that it is right");
}

/// Joint 0 oscillates by `size` \[rad\] at `hz`; the arm follows its commands at `cap` \[rad/s\] at most.
/// Returns the finding, the share of speed found, and the lowest speed limit when it first falls below all.
fn swung(settings: TrackingSettings, cap: f64) -> (Option<StopDetail>, Option<f64>, Option<f64>) {
    let (size, hz) = (0.02, 3.0);
    let mut rig = Rig::new(settings, 40_000_000);
    assert_eq!(rig.monitor.speed_share(), None, "nothing moved yet");
    let mut q = 0.0_f64;
    for tick in 0..1500 {
        let at = |tick: f64| size * (TAU * hz * tick * TICK_S).sin();
        q += (at(f64::from(tick)) - q).clamp(-cap * TICK_S, cap * TICK_S);
        let wrong = rig.tick([q, 0.0, 0.0], [at(f64::from(tick + 1)), 0.0, 0.0]);
        let slowed = rig.monitor.allowed_mps().is_some();
        if wrong.is_some() || slowed {
            return (wrong, rig.monitor.speed_share(), rig.monitor.allowed_mps());
        }
    }
    (None, rig.monitor.speed_share(), rig.monitor.allowed_mps())
}

#[test]
fn the_share_of_the_speed_is_that_of_the_arm() {
    let asked_radps = 0.02 * 3.0 * TAU;
    assert_eq!(swung(TrackingSettings::DEFAULT, 10.0), (None, Some(1.0), None));
    for part in [0.5, 0.65] {
        let (wrong, share, allowed) = swung(TrackingSettings::DEFAULT, part * asked_radps);
        assert_eq!(wrong, None);
        let (share, allowed) = (share.unwrap(), allowed.unwrap());
        assert!((share / part - 1.0).abs() < 0.15, "{share} of {part}");
        // The tool is asked for what the arm has shown.
        assert!((allowed / (share * LEVER_M * asked_radps) - 1.0).abs() < 0.05, "{allowed} m/s, {share}");
        let stopping = TrackingSettings { slow_arm: SlowArm::Stop, ..TrackingSettings::DEFAULT };
        let (wrong, told, allowed) = swung(stopping, part * asked_radps);
        let detail = wrong.expect("a slow arm is a reason to stop");
        assert_eq!((detail.cause, detail.joint, detail.limit), (StopCause::SlowArm, None, 0.75));
        assert!(
            (detail.amount - share).abs() < 1e-9 && told == Some(share) && allowed.is_none(),
            "{detail:?}"
        );
    }
}

/// Whatever lag is assumed of an arm that follows exactly, and however that changes, it is not slow.
#[test]
fn a_lag_that_is_known_now_and_then_makes_no_arm_slow() {
    let mut rig = Rig::new(TrackingSettings::DEFAULT, 200_000_000);
    let at = |tick: f64| 0.1 * (TAU * 1.5 * tick * TICK_S).sin();
    for tick in 0..6000 {
        let known = tick / 230 % 2 == 1;
        rig.lag = Some(LagEstimate { lag_s: 0.0, std_s: if known { 1e-3 } else { 4e-3 }, shift_s: 0.0 });
        let wrong = rig.tick([at(f64::from(tick)), 0.0, 0.0], [at(f64::from(tick + 1)), 0.0, 0.0]);
        assert_eq!((wrong, rig.monitor.allowed_mps()), (None, None), "{tick}");
    }
    assert_eq!(rig.monitor.speed_share(), Some(1.0));
}

#[test]
fn a_little_less_speed_counts_only_where_the_arm_falls_behind() {
    // A servo of 50 ms damps 2.7 Hz to 85 %, and stays within the commands that it may be answering.
    let mut rig = Rig::usual();
    rig.lag = Some(LagEstimate { lag_s: 0.016, std_s: 5e-4, shift_s: 0.016 });
    let (mut q, mut qd) = (0.0, 0.0);
    let w = 2.0 / 0.05;
    for tick in 0..4000 {
        let at = |tick: f64| 0.05 * (TAU * 2.7 * tick * TICK_S).sin();
        for _ in 0..20 {
            qd += TICK_S / 20.0 * (w * w * (at(f64::from(tick)) - q) - 2.0 * w * qd);
            q += TICK_S / 20.0 * qd;
        }
        assert_eq!(rig.tick([q, 0.0, 0.0], [at(f64::from(tick + 1)), 0.0, 0.0]), None);
        assert_eq!(rig.monitor.allowed_mps(), None, "{tick}");
    }
    assert_eq!(rig.monitor.speed_share(), Some(1.0));

    // An arm at nine tenths of long strokes falls farther behind with each: its speed limit is lowered.
    let mut rig = Rig::new(TrackingSettings::DEFAULT, 10_000_000);
    let mut q = 0.0_f64;
    let slowed = (0..4000).any(|tick| {
        // ±0.3 rad at 1 rad/s.
        let at = |tick: f64| 0.3 - ((tick * TICK_S + 0.3).rem_euclid(1.2) - 0.6).abs();
        q += (at(f64::from(tick)) - q).clamp(-0.9 * TICK_S, 0.9 * TICK_S);
        assert_eq!(rig.tick([q, 0.0, 0.0], [at(f64::from(tick + 1)), 0.0, 0.0]), None, "{tick}");
        rig.monitor.allowed_mps().is_some()
    });
    assert!(slowed);
    let (share, allowed) = (rig.monitor.speed_share().unwrap(), rig.monitor.allowed_mps().unwrap());
    assert!((share - 0.9).abs() < 0.03 && (allowed - 0.9 * LEVER_M).abs() < 0.01, "{share} {allowed}");
}

/// Three joints that write circles of 1 cm, 100 ms late, the first mirrored: the finding.
fn mirrored(size: f64) -> Option<StopDetail> {
    let mut rig = Rig::new(TrackingSettings::DEFAULT, 200_000_000).rested();
    (0..2000).find_map(|tick| {
        let at = |tick: f64| {
            let phase = TAU * 2.5 * (tick * TICK_S).max(0.0);
            [size * phase.sin(), size * (1.0 - phase.cos()), size * (phase.sin() - phase.cos() + 1.0)]
        };
        let [a, b, c] = at(f64::from(tick) - 50.0);
        rig.tick([-a, b, c], at(f64::from(tick + 1)))
    })
}

#[test]
fn a_joint_that_moves_against_the_others_inside_its_commands_is_blamed_for_its_travel() {
    let detail = mirrored(0.008).expect("it is turned about");
    let limit = 2.0 * TrackingSettings::DEFAULT.still_rad;
    assert_eq!((detail.cause, detail.joint, detail.limit), (StopCause::WrongDirection, Some(0), limit));
    assert!(detail.amount > limit, "{detail:?}");
    // On so small a circle it travels less within the memory.
    assert_eq!(mirrored(0.002), None);
}

/// Time \[s\] from commands moving by 0.2 rad to the finding for a joint that hardly follows. Before, it
/// moved for `moved_s`.
fn blamed_after(moved_s: f64, std_s: f64) -> f64 {
    let mut rig = Rig::new(TrackingSettings::DEFAULT, 200_000_000);
    rig.lag = Some(LagEstimate { lag_s: 0.02, std_s, shift_s: 0.02 });
    let mut rig = rig.rested();
    let begin = (moved_s / TICK_S) as u32;
    for tick in 0..begin {
        let at = |t: f64| 0.5 * ((t.max(0.0) + 0.25).rem_euclid(0.5) - 0.25).abs();
        let t = f64::from(tick) * TICK_S;
        assert_eq!(rig.tick([at(t - 0.02), 0.0, 0.0], [at(t + TICK_S), 0.0, 0.0]), None);
    }
    let after = (0..1000).find(|tick| {
        let t = f64::from(*tick) * TICK_S;
        let went = |t: f64| 2.0 * t.clamp(0.0, 0.1);
        rig.tick([0.1 * t, 0.0, 0.0], [went(t + TICK_S), 0.0, 0.0]).is_some()
    });
    f64::from(after.expect("it does not follow")) * TICK_S
}

/// The longest lag, the spread of a servo with that lag or the known one, and jitter: 0.2 + 2 · 0.2 + 0.02 s,
/// or 2 · 0.02 s.
#[test]
fn a_lag_counts_when_it_is_known_well_and_the_arm_has_moved_for_two_seconds() {
    for (moved_s, std_s, reach_s) in
        [(2.5, 1e-3, 0.26), (2.5, 5e-3, 0.62), (1.5, 1e-3, 0.62), (0.0, 1e-3, 0.62)]
    {
        let after = blamed_after(moved_s, std_s);
        // Until the tolerance is used up, which lasts for 10 ms; blocks of 10 ms. Of an arm that is unknown a
        // servo may swing on: 20 % of these commands are 40 mrad, which the joint has to come out of.
        let more_s = if moved_s < 2.0 { 0.2 } else { 0.1 };
        assert!((reach_s..reach_s + more_s).contains(&after), "{moved_s} s, {std_s} s: {after} s");
    }
}

#[test]
fn tolerances_outside_their_range_are_refused_by_name() {
    type Set = fn(&mut TrackingSettings, f64);
    let with = |set: Set, value: f64| {
        let mut settings = support::settings(PredictorKind::CONSTANT_VELOCITY);
        set(&mut settings.safety.tracking, value);
        settings.preview_steps(10)
    };
    let ranges: [(&str, Set, f64, f64, &str); 4] = [
        ("joint tolerance", |s, x| s.joint_rad = x, 0.002, 0.5, "rad"),
        ("tool tolerance", |s, x| s.tool_m = x, 0.001, 0.2, "m"),
        ("motion that has to show", |s, x| s.still_rad = x, 0.002, 0.5, "rad"),
        ("runaway speed", |s, x| s.runaway_radps = x, 0.02, 3.0, "rad/s"),
    ];
    for (name, set, low, high, unit) in ranges {
        assert!(with(set, low).is_ok() && with(set, high).is_ok(), "{name}");
        for value in [low.next_down(), high.next_up(), 0.0] {
            assert_eq!(with(set, value), Err(FollowerError::Number { name, value, low, high, unit }));
        }
    }
    let hold: Set = |s, ns| s.hold_ns = ns as u64;
    assert!(with(hold, 0.0).is_ok() && with(hold, 2e8).is_ok());
    let refused = with(hold, 2.1e8).unwrap_err().to_string();
    assert!(refused.contains("hold time of the tracking monitor"), "{refused}");
}
