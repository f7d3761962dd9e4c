//! `foretrace move home` over processes: confirmed, refused with the obstacle, interrupted, and orphaned in
//! the middle.

use foretrace_tests::{Process, World, assert_refused, json, told, until};

use crate::PROGRAM;

/// Home of the preset with the base turned by a radian: half a metre beside the paper.
const TURNED: &str = "--from=2.1416,-1.3,1.8,-2.0708,-1.5708,0.0";

/// The arm's joint states have arrived.
fn heard(world: &World) {
    until("the daemon hears the arm", || {
        world.status(0)["way_home"]["farthest_rad"].is_number().then_some(())
    });
}

/// `move home` runs, and the arm has gone at least `share` of its way.
fn underway(world: &World, share: f64) -> Process {
    let mover = world.start(0, &["move", "home", "--yes"]);
    until("the arm is on its way", || {
        let way = world.status(0)["way_home"].clone();
        (way["moving"] == true && way["share"].as_f64() > Some(share)).then_some(())
    });
    mover
}

#[test]
fn an_arm_far_away_comes_home_through_a_stop_and_a_killed_daemon() {
    let world = World::new(PROGRAM);
    let daemon = world.daemon(0);
    let report = world.file("arm.json");
    let file = report.display().to_string();
    let arm = world.start(0, &["arm", "sim", TURNED, "--json", &file]);
    heard(&world);
    assert_refused(&world.run(0, &["request", "arm"]), 4, &["outside the workspace", "foretrace move home"]);
    // No confirmation, and no terminal to ask on.
    assert_refused(&world.run(0, &["move", "home"]), 2, &["no terminal", "--yes"]);
    assert_eq!(world.status(0)["mode"], "idle");

    let mover = underway(&world, 0.1);
    assert_refused(&world.run(0, &["request", "arm"]), 4, &["moving home"]);
    mover.signal("-INT");
    assert_refused(&mover.output(), 130, &["interrupted", "stopped"]);
    world.wait_for_mode(0, "stopped");
    let stopped = world.status(0)["way_home"]["farthest_rad"].as_f64();
    assert!(stopped > Some(0.05) && stopped < Some(0.95), "in the middle: {stopped:?}");

    let mover = underway(&world, 0.1);
    let _ = daemon.kill();
    let output = mover.output();
    assert!(!output.status.success(), "{}", told(&output));
    let daemon = world.daemon(0);
    heard(&world);
    let left = world.status(0)["way_home"]["farthest_rad"].as_f64();
    assert!(left > Some(0.05) && left < stopped, "it braked by itself: {left:?}");

    let output = world.run(0, &["move", "home", "--yes", "--json", "-"]);
    assert!(output.status.success(), "{}", told(&output));
    let said: serde_json::Value = serde_json::from_slice(&output.stdout).expect("stdout carries JSON only");
    assert!(said["left_rad"].as_f64().is_some_and(|left| left < 0.005), "{said}");
    assert_eq!(world.status(0)["mode"], "idle");
    let armed = world.run(0, &["request", "arm"]);
    assert!(armed.status.success(), "{}", told(&armed));
    arm.end();
    daemon.end();
    let commands = &json(&report)["commands"];
    assert_eq!(commands["limit_violations"], 0, "{commands}");
    let fastest = commands["max_velocity_radps"].as_f64();
    assert!(fastest > Some(0.1) && fastest < Some(0.2501), "{commands}");
}

#[test]
fn without_a_daemon_or_with_joints_that_are_none_nothing_begins() {
    let world = World::new(PROGRAM);
    assert_refused(&world.run(0, &["move", "home", "--yes"]), 3, &["no daemon running", "foretrace daemon"]);
    assert_refused(&world.run(0, &["move", "home"]), 2, &["no terminal", "--yes"]);
    assert_refused(&world.run(0, &["move", "away"]), 2, &["away"]);
    for (from, words) in [
        ("--from=1,2", ["2 numbers", "6 joints"]),
        ("--from=9,-1.3,1.8,-2.1,-1.6,0", ["joint 0 at 9 rad", "legal -6.283 to 6.283"]),
        ("--from=nan,-1.3,1.8,-2.1,-1.6,0", ["joint 0 at NaN rad", "legal -6.283 to 6.283"]),
    ] {
        assert_refused(&world.run(0, &["arm", "sim", from]), 2, &words);
    }
}

#[test]
fn a_box_in_the_way_is_named_and_nothing_moves() {
    let world = World::new(PROGRAM);
    // Position of the pen when the base has turned half of the way.
    let pillar = "clearance.boxes_m=[[[0.537, -0.169, 0.3], [0.05, 0.05, 0.6], [0.0, 0.0, 0.0]]]";
    let daemon = world.daemon_with(0, &["--set", pillar]);
    let arm = world.start(0, &["arm", "sim", TURNED]);
    heard(&world);
    let before = world.status(0)["way_home"]["farthest_rad"].clone();
    let refused = world.run(0, &["move", "home", "--yes"]);
    assert_refused(&refused, 4, &["path home is blocked", "box 0 of clearance.boxes_m", "% of the way on"]);
    let after = world.status(0);
    assert_eq!((&after["mode"], &after["way_home"]["farthest_rad"]), (&"idle".into(), &before));
    arm.end();
    daemon.end();
}
