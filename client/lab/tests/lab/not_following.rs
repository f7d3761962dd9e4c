//! Arms that do not follow their commands, or report wrongly, in simulated time: the daemon's law stops soon,
//! with the reason; and arms that do follow, however large their lag and jitter, are never stopped.
//!
//! The table of docs/results/not-following.md: `cargo test --release -p foretrace-lab --test lab
//! not_following -- --nocapture`.

use crate::desk::{Desk, Pen, Seen};
use foretrace_config::Config;
use foretrace_control::arm::lag::Following;
use foretrace_control::follower::{Mode, Refusal, Request};
use foretrace_control::monitor::SlowArm;
use foretrace_control::stop::{StopCause, StopDetail, StopReason};
use foretrace_sim::arm::{ArmSettings, DelayChange, DelaySettings, Fault, FaultKind};

/// Time of the fault after the pen began [s]: by then the lag is known.
const AT_S: f64 = 3.0;
/// Faults are found within this time, if there is motion that shows them [s]: the longest lag that the
/// settings allow, what the servo spreads, the window in which motion has to show.
const FOUND_S: f64 = 1.5;

fn late(delay_s: f64) -> ArmSettings {
    let delay = DelaySettings {
        jitter_s: if delay_s > 0.0 { 0.005 } else { 0.0 },
        ..DelaySettings::constant(delay_s)
    };
    ArmSettings { delay, ..ArmSettings::ur5(0.002, 0.030) }
}

/// Name, arm.
fn arms() -> [(&'static str, ArmSettings); 4] {
    [
        ("2 ms", ArmSettings::delayed(0.002, 0.002)),
        ("34 ms", late(0.0)),
        ("100 ms", late(0.066)),
        ("150 ms", late(0.116)),
    ]
}

const PENS: [(&str, Pen); 4] = [
    ("small", Pen { radius_m: 0.004, speed_mps: 0.06 }),
    ("slow", Pen { radius_m: 0.05, speed_mps: 0.05 }),
    ("medium", Pen { radius_m: 0.05, speed_mps: 0.2 }),
    ("fast", Pen { radius_m: 0.06, speed_mps: 0.5 }),
];

fn faults() -> [(&'static str, FaultKind); 10] {
    [
        ("stuck", FaultKind::Stuck),
        ("paused", FaultKind::Paused),
        ("locked", FaultKind::Locked(0)),
        ("frozen", FaultKind::Frozen(0)),
        ("offset 0.2", FaultKind::Offset(0.2)),
        ("offset -0.05", FaultKind::Offset(-0.05)),
        ("flipped", FaultKind::Flipped(0)),
        ("wrapped", FaultKind::Wrapped(3)),
        ("runaway 0.5", FaultKind::Runaway(0.5)),
        ("oscillation", FaultKind::Oscillation(4.0)),
    ]
}

#[test]
fn every_fault_latches_at_every_lag_and_speed() {
    println!("fault          lag     pen      joints     found after   tool off    cause");
    for (name, kind) in faults() {
        for (lag, arm) in arms() {
            for (speed, pen) in PENS {
                let arm = ArmSettings { fault: Some(Fault { kind, at_s: AT_S + 1.0 }), ..arm };
                let mut desk = Desk::armed(arm);
                let stop = desk.write(pen, AT_S + FOUND_S + 1.0);
                let seen = desk.seen;
                let (reason, detail) = stop.unwrap_or_else(|| panic!("{name}, {lag}, {speed}: not noticed"));
                assert_eq!(reason, StopReason::TrackingError, "{name}, {lag}, {speed}");
                let after = desk.since_begin(detail.at) - AT_S;
                println!(
                    "{name:<14} {lag:<7} {speed:<8} {:4.2} rad/s  {:6.0} ms   {:7.1} mm   {:?} {:?} {:.3} > \
                     {:.3}",
                    seen.joint_radps,
                    after * 1e3,
                    seen.off_m * 1e3,
                    detail.cause,
                    detail.joint,
                    detail.amount,
                    detail.limit,
                );
                assert!(after > 0.0, "{name}, {lag}, {speed}: blamed before the fault");
                // An oscillation has to grow first.
                let allowed = if matches!(kind, FaultKind::Oscillation(_)) { 1.3 } else { FOUND_S };
                assert!(after < allowed, "{name}, {lag}, {speed}: {after} s");
                assert!(detail.cause != StopCause::None && detail.amount > detail.limit, "{detail:?}");
            }
        }
    }
}

#[test]
fn an_arm_that_holds_still_may_not_move_by_itself() {
    for (kind, cause) in [
        (FaultKind::Runaway(0.5), StopCause::Runaway),
        (FaultKind::Runaway(-0.15), StopCause::Runaway),
        (FaultKind::Offset(0.05), StopCause::JointDeviation),
        (FaultKind::Oscillation(4.0), StopCause::Oscillation),
    ] {
        let arm = ArmSettings { fault: Some(Fault { kind, at_s: AT_S + 1.0 }), ..late(0.0) };
        let mut desk = Desk::armed(arm);
        let (reason, detail) = desk.wait(AT_S + 3.0).unwrap_or_else(|| panic!("{kind:?}: not noticed"));
        println!("{kind:?}: {:.0} ms, {detail:?}", 1e3 * (desk.since_begin(detail.at) - AT_S));
        assert_eq!((reason, detail.cause), (StopReason::TrackingError, cause), "{kind:?}");
    }
}

#[test]
fn arming_again_waits_for_the_cause_to_go_or_for_an_operator() {
    // Away from where it is held: only an operator can accept that.
    let arm = ArmSettings { fault: Some(Fault { kind: FaultKind::Offset(0.1), at_s: AT_S }), ..late(0.0) };
    let mut desk = Desk::armed(arm);
    assert!(desk.wait(AT_S + 1.0).is_some());
    assert_eq!(desk.ask(Request::Arm), Err(Refusal::NotFollowing));
    assert_eq!(desk.ask(Request::Disarm), Ok(()));
    assert_eq!(desk.ask(Request::Arm), Ok(()));

    // Moving: cannot be armed.
    let arm = ArmSettings { fault: Some(Fault { kind: FaultKind::Runaway(0.1), at_s: AT_S }), ..late(0.0) };
    let mut desk = Desk::armed(arm);
    assert!(desk.wait(AT_S + 2.0).is_some());
    let refused = desk.ask(Request::Arm);
    assert!(matches!(refused, Err(Refusal::NotFollowing | Refusal::ArmMoves)), "{refused:?}");
}

#[test]
fn an_offset_from_before_arming_shows_when_the_arm_answers() {
    for kind in [FaultKind::Offset(0.1), FaultKind::Wrapped(0), FaultKind::Flipped(0)] {
        let arm = ArmSettings { fault: Some(Fault { kind, at_s: 0.0 }), ..late(0.0) };
        let mut desk = Desk::new(arm);
        if desk.ask(Request::Arm).is_err() {
            // A turn farther on may be outside the joint limits: refused is as good.
            continue;
        }
        let stop = desk.write(PENS[1].1, 2.0);
        assert_eq!(stop.map(|(reason, _)| reason), Some(StopReason::TrackingError), "{kind:?}");
    }
}

#[test]
fn arms_that_obey_are_never_blamed() {
    let change = |before, after| {
        let change = DelayChange { at_s: 4.0, delay_s: after };
        let delay = DelaySettings {
            delay_s: before,
            change: Some(change),
            jitter_s: 0.005,
            ..DelaySettings::default()
        };
        ArmSettings { delay, ..ArmSettings::ur5(0.002, 0.030) }
    };
    let jitter = DelaySettings { delay_s: 0.03, jitter_s: 0.03, seed: 3, ..DelaySettings::default() };
    let more = [
        ("150 ms, a delay", ArmSettings::delayed(0.002, 0.150)),
        ("150 ms, a servo", ArmSettings::ur5(0.002, 0.146)),
        ("CB3", ArmSettings::ur5(0.008, 0.030)),
        ("0 to 116 ms", change(0.0, 0.116)),
        ("116 to 0 ms", change(0.116, 0.0)),
        ("jitter of 30 ms", ArmSettings { delay: jitter, ..ArmSettings::ur5(0.002, 0.030) }),
    ];
    for (lag, arm) in arms().into_iter().chain(more) {
        let mut worst = [0.0_f64; 2];
        for (speed, pen) in PENS {
            let mut desk = Desk::armed(arm);
            let stop = desk.write(pen, 7.0);
            // While the lag itself jumps by 116 ms the tool is off by what it moves in that time.
            let changes = arm.delay.change.is_some();
            let cause = stop.map(|(_, detail)| detail.cause);
            if changes && matches!(cause, Some(StopCause::Response | StopCause::ToolDeviation)) {
                continue;
            }
            assert!(stop.is_none() && desk.mode == Mode::Following, "{lag}, {speed}: {stop:?}");
            assert!(desk.seen.share.is_none_or(|share| share == 1.0), "{lag}, {speed}: {:?}", desk.seen);
            worst = [worst[0].max(desk.seen.joint_radps), worst[1].max(desk.seen.off_m)];
        }
        for (text, seed) in [("Kx4 Rg8 Sy2", 0), ("anticipate", 1)] {
            let mut desk = Desk::armed(arm);
            let stop = desk.write_text(text, seed);
            assert!(stop.is_none(), "{lag}, {text:?}: {stop:?}");
            assert!(desk.seen.share.is_none_or(|share| share == 1.0), "{lag}, {text:?}: {:?}", desk.seen);
        }
        println!("{lag:<18} at most {:.2} rad/s, {:.1} mm off all commands", worst[0], worst[1] * 1e3);
    }
}

/// An arm that moves at `share` of its speed from before the pen begins, and a pen that asks for more.
fn slowed(share: f64, pen: Pen, slow_arm: SlowArm) -> (Desk, Option<(StopReason, StopDetail)>) {
    let arm = ArmSettings { fault: Some(Fault { kind: FaultKind::Slow(share), at_s: 0.5 }), ..late(0.0) };
    let mut settings = Config::preset("ur5e").unwrap().follower_settings();
    settings.safety.tracking.slow_arm = slow_arm;
    let mut desk = Desk::with(arm, settings);
    assert_eq!(desk.ask(Request::Arm), Ok(()));
    let stop = desk.write(pen, 12.0);
    (desk, stop)
}

#[test]
fn in_front_of_a_slow_arm_the_tool_slows_down_or_stops() {
    for (arm_share, speed_mps) in [(0.3, 0.7), (0.15, 0.5), (0.05, 0.2)] {
        let pen = Pen { radius_m: 0.06, speed_mps };
        let (mut desk, stop) = slowed(arm_share, pen, SlowArm::SlowDown);
        let (share, off_m) = (desk.seen.share.expect("the arm has moved"), desk.seen.off_m);
        // The commands are then within the arm's ability: it is at its commanded position.
        desk.seen = Seen::default();
        let later = stop.or_else(|| desk.write(pen, 16.0));
        println!(
            "{arm_share} of {speed_mps} m/s: share {share:.2}, up to {:.1} mm off, afterwards {:.1} at {:.2} \
             m/s: {later:?}",
            off_m * 1e3,
            desk.seen.off_m * 1e3,
            desk.seen.tool_mps
        );
        // A share this small cannot be told apart from joints that are slow: it may stop instead.
        if arm_share < 0.2 && later.is_some_and(|(_, detail)| detail.cause == StopCause::Response) {
            continue;
        }
        assert!(share < 0.75, "{arm_share}: {share}");
        assert!(later.is_none() && desk.seen.off_m < 0.05, "{arm_share}: {later:?}");
        assert!(desk.seen.tool_mps < 0.9 * speed_mps, "{arm_share}: {} m/s", desk.seen.tool_mps);
    }
    // A hand that writes what such an arm can just catch up with between the strokes: it looks late, and is
    // slow all the same.
    for share in [0.3, 0.15] {
        let arm =
            ArmSettings { fault: Some(Fault { kind: FaultKind::Slow(share), at_s: AT_S }), ..late(0.0) };
        let mut desk = Desk::armed(arm);
        let stop = desk.write_text("Kx4 Rg8 Sy2 Kx4 Rg8", 0);
        println!("writing at {share}: {stop:?} {:?}", desk.seen);
        assert!(stop.is_none() && desk.seen.off_m < 0.02, "{stop:?} {:?}", desk.seen);
        assert!(share > 0.2 || desk.seen.share.is_some_and(|share| share < 0.75), "{:?}", desk.seen);
    }

    let (_, stop) = slowed(0.3, Pen { radius_m: 0.06, speed_mps: 0.7 }, SlowArm::Stop);
    let (reason, detail) = stop.expect("a stop");
    println!("stopped: {detail:?}");
    assert_eq!((reason, detail.cause), (StopReason::TrackingError, StopCause::SlowArm));
}

/// The paper's law, a scalar trust over a plan with steps of 10 ms, demands more of an arm than the preset
/// does.
#[test]
fn an_arm_behind_a_slow_servo_is_not_blamed_for_a_plan_in_a_hurry() {
    let arm = ArmSettings::ur5(0.002, 0.1);
    for following in [Following::Fixed, Following::Measured { max_ns: 150_000_000, rate: 0.02 }] {
        for (text, seed) in
            [("Kx4 Rg8 Sy2", 0), ("ANTICIPATE", 11), ("abcdefghijklm", 22), ("abcdefghijklm", 32)]
        {
            let mut settings = Config::preset("ur5e").unwrap().follower_settings();
            settings.dead_time_ns = (arm.group_delay_s() * 1e9) as u64;
            settings.following = following;
            crate::paper_law::set(&mut settings);
            let mut desk = Desk::with(arm, settings);
            assert_eq!(desk.ask(Request::Arm), Ok(()));
            let stop = desk.write_text(text, seed);
            println!("{following:?} {text}: {stop:?} {:?}", desk.seen);
            assert!(stop.is_none(), "{following:?}, {text}, {seed}: {stop:?}");
            assert!(
                desk.seen.share.is_none_or(|share| share == 1.0),
                "{following:?}, {text}: {:?}",
                desk.seen
            );
        }
    }
}
