//! The whole chain over real shared memory: daemon, arm and player as processes, started, killed and started
//! again.

use std::collections::{BTreeMap, BTreeSet};

use foretrace_tests::{World, assert_refused, json, told, until};

use crate::PROGRAM;

/// Tick numbers, commands and the like as the status tells them.
fn number(value: &serde_json::Value) -> u64 {
    value.as_u64().unwrap_or_else(|| panic!("{value} is not a count"))
}

#[test]
fn the_arm_follows_the_pen_and_no_command_breaks_a_limit() {
    let world = World::new(PROGRAM);
    let daemon = world.daemon(0);
    let report = world.file("arm.json");
    let record = world.file("arm.csv");
    let arm = world
        .armed_arm(0, &["--json", &report.display().to_string(), "--record", &record.display().to_string()]);
    let played = world.run(0, &["play", "glyphs:Kx", "--json", "-"]);
    assert!(played.status.success(), "{}", told(&played));
    let sent: serde_json::Value = serde_json::from_slice(&played.stdout).expect("stdout carries JSON only");

    let status = world.status(0);
    assert_eq!(number(&status["pen"]["samples"]), number(&sent["samples"]), "{status}");
    assert_eq!(number(&status["pen"]["rejected"]), 0, "{status}");
    assert_eq!(number(&status["pen"]["dropped"]), 0, "{status}");
    assert!(world.run(0, &["request", "disarm"]).status.success());
    world.wait_for_mode(0, "idle");
    arm.end();
    daemon.end();

    let report = json(&report);
    assert!(number(&report["commands"]["count"]) > 100, "{report}");
    assert_eq!(number(&report["commands"]["limit_violations"]), 0, "{report}");
    assert_eq!(number(&report["commands"]["refused"]["jump"]), 0, "{report}");
    // The letters are 30 mm high at half a metre from the base: some joint must have moved by more than 20
    // mrad.
    let text = std::fs::read_to_string(record).unwrap();
    let joints: Vec<Vec<f64>> = text
        .lines()
        .skip(1)
        .map(|line| line.split(',').skip(1).map(|number| number.parse().unwrap()).collect())
        .collect();
    let travel = |joint: usize| {
        let values = joints.iter().map(|q| q[joint]);
        values.clone().fold(f64::MIN, f64::max) - values.fold(f64::MAX, f64::min)
    };
    assert!((0..6).map(travel).fold(0.0, f64::max) > 0.02, "the arm did not move");
}

/// A pen sample's identity: number in its publisher's sequence, and device stamp.
type Identity = (u64, u64);

fn identity(pair: &serde_json::Value) -> Identity {
    (number(&pair[0]), number(&pair[1]))
}

#[test]
fn every_sample_keeps_its_identity_from_the_device_to_the_command_and_back() {
    let world = World::new(PROGRAM);
    let daemon = world.daemon(0);
    let arm = world.armed_arm(0, &[]);
    let player = world.start(0, &["play", "glyphs:ab", "--loop"]);
    world.wait_for_mode(0, "following");
    let observed = world.run(0, &["observe", "2"]);
    assert!(observed.status.success(), "{}", told(&observed));
    let seen: serde_json::Value = serde_json::from_slice(&observed.stdout).expect("stdout carries JSON only");
    let status = world.status(0);
    for process in [player, arm, daemon] {
        process.end();
    }

    let list = |key: &str| seen[key].as_array().unwrap().clone();
    let pens: BTreeSet<Identity> = list("pens").iter().map(identity).collect();
    let first = pens.first().expect("pen samples").0;
    let sent: BTreeMap<u64, Identity> =
        list("commands").iter().map(|row| (number(&row[0]), (number(&row[1]), number(&row[2])))).collect();
    assert!(pens.len() > 100 && sent.len() > 100, "{} samples, {} commands", pens.len(), sent.len());
    let (mut behind, mut echoed, mut timed) = (BTreeSet::new(), BTreeSet::new(), 0);
    for tick in list("ticks") {
        let (index, pen) = (number(&tick["tick"]), identity(&tick["pen"]));
        // The observer does not know samples from before it attached.
        if pen.0 >= first {
            assert!(pens.contains(&pen), "{tick} names a sample that was never sent");
            behind.insert(pen);
        }
        if let Some(command) = sent.get(&index) {
            assert_eq!(*command, pen, "{tick}");
        }
        let (echo_tick, echo) = (number(&tick["echo_tick"]), identity(&tick["echo_pen"]));
        assert!(echo_tick < index, "{tick}");
        if let Some(command) = sent.get(&echo_tick) {
            assert_eq!(*command, echo, "{tick}");
            echoed.insert(echo);
        }
        let [reader, transport, age, _computed, _to_the_arm] =
            ["pen_reader_ns", "pen_transport_ns", "pen_age_ns", "compute_ns", "command_transport_ns"]
                .map(|key| tick[key].as_u64());
        if let (Some(reader), Some(transport), Some(age)) = (reader, transport, age) {
            // A tick takes samples in when it starts, which is its wake-up after the release.
            assert!(reader + transport <= age + number(&tick["wakeup_ns"]), "{tick}");
            timed += 1;
        }
    }
    assert!(timed > 100, "{timed} ticks told their parts");
    let whole = echoed.iter().filter(|sample| pens.contains(sample) && behind.contains(sample)).count();
    assert!(whole > 50, "{whole} samples were seen from the device to the echo");
    for part in ["pen_reader_ms", "pen_transport_ms", "pen_age_ms", "compute_ms", "command_transport_ms"] {
        assert!(status["chain"][part].is_number(), "{part} is missing in {}", status["chain"]);
    }
}

#[test]
fn a_killed_daemon_comes_back_while_arm_and_player_live_on() {
    let world = World::new(PROGRAM);
    let daemon = world.daemon(0);
    let report = world.file("arm.json");
    let mut arm = world.armed_arm(0, &["--json", &report.display().to_string()]);
    let mut player = world.start(0, &["play", "glyphs:ab", "--loop"]);
    world.wait_for_mode(0, "following");

    daemon.kill();
    assert_refused(&world.run(0, &["status"]), 3, &["no daemon running"]);
    arm.expect_alive();
    player.expect_alive();

    let daemon = world.daemon(0);
    // A restarted daemon moves nothing until it is asked to.
    assert_eq!(world.status(0)["mode"], "idle");
    world.arm(0, &mut arm);
    world.wait_for_mode(0, "following");
    let samples = number(&world.status(0)["pen"]["samples"]);
    until("the pen is heard again", || (number(&world.status(0)["pen"]["samples"]) > samples).then_some(()));
    player.end();
    arm.end();
    daemon.end();
    let report = json(&report);
    assert_eq!(number(&report["commands"]["limit_violations"]), 0, "{report}");
    assert_eq!(number(&report["arm"]["daemons"]), 2, "{report}");
}

#[test]
fn a_killed_player_can_be_replaced() {
    let world = World::new(PROGRAM);
    let daemon = world.daemon(0);
    let arm = world.armed_arm(0, &[]);
    let player = world.start(0, &["play", "glyphs:ab", "--loop"]);
    world.wait_for_mode(0, "following");
    player.kill();
    world.wait_for_mode(0, "holding");
    let player = world.start(0, &["play", "glyphs:ab", "--loop"]);
    world.wait_for_mode(0, "following");
    player.end();
    arm.end();
    daemon.end();
}

#[test]
fn a_killed_arm_stops_the_loop_until_it_is_armed_again() {
    let world = World::new(PROGRAM);
    let daemon = world.daemon(0);
    let arm = world.armed_arm(0, &[]);
    let player = world.start(0, &["play", "glyphs:ab", "--loop"]);
    world.wait_for_mode(0, "following");
    arm.kill();
    until("the daemon stops by itself", || {
        let mode = world.status(0)["mode"].clone();
        (mode == "fault" || mode == "stopped").then_some(())
    });
    let refused = until("the stop is over", || {
        let asked = world.run(0, &["request", "arm"]);
        (!String::from_utf8_lossy(&asked.stderr).contains("still being stopped")).then_some(asked)
    });
    assert_refused(&refused, 4, &["joint state"]);

    let report = world.file("arm.json");
    let arm = world.armed_arm(0, &["--json", &report.display().to_string()]);
    world.wait_for_mode(0, "following");
    player.end();
    arm.end();
    daemon.end();
    assert_eq!(number(&json(&report)["commands"]["limit_violations"]), 0);
}

#[test]
fn two_instances_do_not_hear_each_other() {
    let world = World::new(PROGRAM);
    let (left, right) = (world.daemon(0), world.daemon(1));
    let (left_arm, right_arm) = (world.armed_arm(0, &[]), world.armed_arm(1, &[]));
    let played = world.run(0, &["play", "glyphs:a"]);
    assert!(played.status.success(), "{}", told(&played));
    let (left_status, right_status) = (world.status(0), world.status(1));
    assert!(number(&left_status["pen"]["samples"]) > 0, "{left_status}");
    assert_eq!(number(&right_status["pen"]["samples"]), 0, "{right_status}");
    assert_eq!(right_status["mode"], "armed");
    assert!(world.run(1, &["request", "stop"]).status.success());
    world.wait_for_mode(1, "stopped");
    assert_ne!(world.status(0)["mode"], "stopped");
    for process in [left_arm, right_arm, left, right] {
        process.end();
    }
}

#[test]
fn trust_and_predictor_follow_requests() {
    let world = World::new(PROGRAM);
    let daemon = world.daemon(0);
    let arm = world.armed_arm(0, &[]);
    let player = world.start(0, &["play", "glyphs:ab", "--loop"]);
    world.wait_for_mode(0, "following");
    assert!(world.run(0, &["request", "trust", "0.25"]).status.success());
    until("trust is 0.25", || (world.status(0)["trust"]["value"] == 0.25).then_some(()));
    for name in ["hold", "constant-velocity", "dybm", "dybm-esn", "ar-rls", "lstm", "mixture"] {
        assert!(world.run(0, &["request", "predictor", name]).status.success(), "{name}");
        until("the predictor is another", || (world.status(0)["predictor"]["name"] == name).then_some(()));
    }
    assert_refused(&world.run(0, &["request", "predictor", "oracle"]), 2, &["runs in the lab only"]);
    for process in [player, arm, daemon] {
        process.end();
    }
}
