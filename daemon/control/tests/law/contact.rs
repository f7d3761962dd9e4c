//! Efforts that an arm reports: what it touches stops it, and nothing else does.

use foretrace_control::contact::EffortUnit;
use foretrace_control::follower::Mode;
use foretrace_control::state::{bytes_of, read};
use foretrace_control::stop::{StopCause, StopReason};
use nalgebra::Vector3;

use crate::support::touching::{Thing, Touching, World};

/// Runs for `seconds`; the reason of a stop, and when it came \[s\].
fn written(world: World, seconds: f64) -> (Touching, Option<(StopReason, f64)>) {
    let mut arm = Touching::armed(world, 1);
    while arm.time_s() < seconds {
        let output = arm.tick();
        if output.mode == Mode::Stopped {
            let stop = (output.stop_reason, arm.time_s());
            let detail = output.stop_detail;
            if output.stop_reason == StopReason::Contact {
                assert_eq!(detail.cause, StopCause::Effort);
                assert!(detail.joint.is_some() && detail.amount > detail.limit && detail.limit > 0.0);
            }
            return (arm, Some(stop));
        }
    }
    (arm, None)
}

/// Unknown payload, friction, a servo with overshoot, noise of 5 % of the torque limit: with half the time to
/// spare.
#[test]
fn nothing_that_an_honest_arm_does_counts_as_touching() {
    for payload_kg in [0.0, 5.0] {
        for friction in [1.0, 3.0] {
            for zeta in [0.5, 1.0] {
                let world = World { payload_kg, friction, zeta, noise: 0.05, patience: 0.5, ..World::PLAIN };
                let (_, stop) = written(world, 30.0);
                assert_eq!(stop, None, "{payload_kg} kg, friction x{friction}, zeta {zeta}");
            }
        }
    }
}

#[test]
fn pushes_of_30_newtons_for_a_fifth_of_a_second_are_borne() {
    for way in [Vector3::x(), -Vector3::x(), Vector3::y(), -Vector3::y(), Vector3::z(), -Vector3::z()] {
        let world = World { noise: 0.02, patience: 0.5, thing: Thing::Push(way * 30.0, 0.2), ..World::PLAIN };
        let (arm, stop) = written(world, 20.0);
        assert!(arm.worst_n > 29.0);
        assert_eq!(stop, None, "{way:?}");
    }
}

/// A surface higher than the law was told, a table, a wall beside the paper: stiffness, and how long after
/// the first touch a stop has to come \[s\].
#[test]
fn what_the_arm_touches_stops_it_in_time() {
    for (name, thing, within_s) in [
        ("paper +3 mm", Thing::Surface(0.003, 20e3), 2.0),
        ("paper +8 mm", Thing::Surface(0.008, 20e3), 0.5),
        ("table +4 mm", Thing::Surface(0.004, 200e3), 0.4),
        ("wall", Thing::Wall(0.03, 50e3), 0.5),
    ] {
        for payload_kg in [0.3, 5.0] {
            let world = World { thing, payload_kg, noise: 0.02, ..World::PLAIN };
            let (arm, stop) = written(world, 25.0);
            let (touched, force) = (arm.touched_s.unwrap(), arm.worst_n);
            let Some((reason, at)) = stop else { panic!("{name}, {payload_kg} kg: {force:.0} N, no stop") };
            println!("{name}, {payload_kg} kg: after {:.2} s, at most {force:.0} N", at - touched);
            assert_eq!(reason, StopReason::Contact, "{name}");
            assert!(at - touched < within_s, "{name}: {} s", at - touched);
        }
    }
}

/// What is touched from the first stroke on is no part of the expectation, learned with the tool lifted.
#[test]
fn paper_that_is_wrong_from_the_beginning_is_not_learned() {
    let world = World { thing: Thing::Surface(0.008, 20e3), from_s: 0.0, ..World::PLAIN };
    let (_, stop) = written(world, 40.0);
    assert_eq!(stop.map(|(reason, _)| reason), Some(StopReason::Contact));
}

#[test]
fn currents_and_shares_of_the_limit_are_judged_by_what_they_mean() {
    for (unit, gain) in [(EffortUnit::Amperes, 0.8), (EffortUnit::Amperes, 1.2), (EffortUnit::Share, 1.0)] {
        let calm = World { unit, gain, noise: 0.02, ..World::PLAIN };
        assert_eq!(written(calm, 20.0).1, None, "{unit:?}");
        let (_, stop) = written(World { thing: Thing::Surface(0.008, 20e3), ..calm }, 20.0);
        assert_eq!(stop.map(|(reason, _)| reason), Some(StopReason::Contact), "{unit:?} {gain}");
    }
}

#[test]
fn what_was_learned_is_part_of_the_state() {
    let world = World { thing: Thing::Surface(0.008, 20e3), noise: 0.02, ..World::PLAIN };
    let (mut one, mut other) = (Touching::armed(world, 2), Touching::armed(world, 2));
    while one.time_s() < 14.0 {
        one.tick();
        other.tick();
    }
    let state = bytes_of(&one.bench.follower).unwrap();
    let mut follower = Touching::armed(world, 2).bench.follower;
    read(&mut follower, &state).unwrap();
    other.bench.follower = follower;
    loop {
        let (a, b) = (one.tick(), other.tick());
        assert_eq!((a.stop_detail, a.command), (b.stop_detail, b.command));
        if a.mode == Mode::Stopped {
            assert_eq!(a.stop_reason, StopReason::Contact);
            return;
        }
    }
}
