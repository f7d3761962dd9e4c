//! `foretrace calibrate lag` against simulated arms of known lag, and its failures.

use std::process::Output;
use std::time::Duration;

use foretrace_tests::{Process, World, assert_refused, json, told, until};

use crate::PROGRAM;

/// A long stall of the machine makes the daemon stop the arm, correctly: repeats the run.
fn calibrated(world: &World, options: &[&str]) -> Output {
    let mut tried = 0;
    loop {
        let output = world.run(0, &[&["calibrate", "lag", "--arm"], options].concat());
        tried += 1;
        let message = String::from_utf8_lossy(&output.stderr);
        let stalled = message.contains("stopped following") || message.contains("too busy");
        if output.status.success() || !stalled || tried == 4 {
            return output;
        }
        // The stop has to be over before the arm can be armed again.
        std::thread::sleep(Duration::from_secs(2));
    }
}

/// Runs an arm with `options`, calibrates, ends the arm; (calibration's report, arm's own lag \[ms\]).
fn measured(world: &World, options: &[&str]) -> (serde_json::Value, f64) {
    let own = world.file("arm.json").display().to_string();
    let arm = world.start(0, &[&["arm", "sim", "--json", &own], options].concat());
    let output = calibrated(world, &["--seconds", "3", "--json", "-"]);
    assert!(output.status.success(), "{}", told(&output));
    arm.end();
    let report = serde_json::from_slice(&output.stdout).expect("stdout carries JSON only");
    let lag_ms = json(&world.file("arm.json"))["arm"]["lag_ms"].as_f64().expect("the arm knows its lag");
    (report, lag_ms)
}

#[test]
fn the_lag_of_a_servo_and_of_a_pure_delay_is_found_within_three_milliseconds() {
    let world = World::new(PROGRAM);
    let daemon = world.daemon(0);
    for (options, verdict) in [
        (&["--rate=500", "--lag-ms=40"][..], "servo"),
        (&["--rate=500", "--lag-ms=25", "--look-ahead-ms=0"], "pure-delay"),
        (&["--rate=125", "--look-ahead-ms=60"], "servo"),
    ] {
        let (report, lag_ms) = measured(&world, options);
        let found_ms = report["lag_ms"].as_f64().expect("a figure");
        assert!((found_ms - lag_ms).abs() < 3.0, "{options:?}: {found_ms} instead of {lag_ms} ms: {report}");
        assert_eq!(report["verdict"], verdict, "{options:?}: {report}");
        assert!(
            report["lag_interquartile_ms"].as_f64().is_some_and(|ms| (0.0..3.0).contains(&ms)),
            "{report}"
        );
        assert!(report["settings"]["dead_time_ms"].is_number(), "{report}");
        let compensated = &report["settings"]["compensated"];
        assert_eq!(compensated.is_object(), verdict == "servo", "{report}");
        if let Some(whole_ms) = compensated["dead_time_ms"].as_f64() {
            assert!((whole_ms - lag_ms).abs() < 3.0, "the whole time, filter included: {report}");
            let part_ms = compensated["servo_filter_ms"].as_f64().expect("a part of it");
            assert!(part_ms > 0.0 && part_ms <= whole_ms, "{report}");
        }
        assert!(report["heard"]["states"].as_u64() > Some(100), "{report}");
        let picture = std::fs::read_to_string(world.file("foretrace-lag.svg")).expect("a picture");
        assert!(picture.starts_with("<svg") && picture.contains("How late the arm is"));
        // It disarmed the arm that it had armed.
        world.wait_for_mode(0, "idle");
    }
    daemon.end();
}

#[test]
fn an_arm_that_stands_still_is_refused_with_a_reason() {
    let world = World::new(PROGRAM);
    let daemon = world.daemon(0);
    let arm = world.start(0, &["arm", "sim", "--speed-scaling", "0"]);
    let output = calibrated(&world, &["--seconds", "2"]);
    assert_refused(&output, 1, &["tracking error", "stands still while commands move", "speed slider"]);
    assert!(!world.file("foretrace-lag.svg").exists());
    world.wait_for_mode(0, "idle");
    arm.end();
    daemon.end();
}

#[test]
fn what_is_missing_is_said_before_anything_moves() {
    let world = World::new(PROGRAM);
    let daemon = world.daemon(0);
    let arm = world.start(0, &["arm", "sim"]);
    assert_refused(&world.run(0, &["calibrate", "lag"]), 4, &["not armed", "--arm"]);
    let wide = world.run(
        0,
        &["calibrate", "lag", "--arm", "--set", "plane.workspace_m=[[-0.01,0.01],[-0.1,0.1],[-0.005,0.06]]"],
    );
    assert_refused(&wide, 5, &["no room", "--amplitude-mm"]);
    let player = world.start(0, &["play", "glyphs:ab", "--loop"]);
    until("the pen is heard", || world.status(0)["pen"]["samples"].as_u64().filter(|count| *count > 0));
    assert_refused(
        &world.run(0, &["calibrate", "lag", "--arm"]),
        1,
        &["the pen is held by the player", "end that program"],
    );
    for process in [player, arm, daemon] {
        process.end();
    }
}

#[test]
fn interrupted_it_leaves_the_arm_at_rest_and_let_go_of() {
    let world = World::new(PROGRAM);
    let daemon = world.daemon(0);
    let own = world.file("arm.json").display().to_string();
    let arm = world.start(0, &["arm", "sim", "--json", &own]);
    let calibration: Process = world.start(0, &["calibrate", "lag", "--arm", "--seconds", "60"]);
    world.wait_for_mode(0, "following");
    calibration.signal("-INT");
    assert_refused(&calibration.output(), 130, &["interrupted"]);
    assert!(!world.file("foretrace-lag.svg").exists());
    world.wait_for_mode(0, "idle");
    arm.end();
    daemon.end();
    let commands = &json(&world.file("arm.json"))["commands"];
    assert!(commands["count"].as_u64() > Some(10), "{commands}");
    assert_eq!(commands["limit_violations"], 0, "{commands}");
}

#[test]
fn other_settings_than_the_daemons_move_nothing() {
    let world = World::new(PROGRAM);
    let daemon = world.daemon(0);
    let own = world.file("arm.json").display().to_string();
    let arm = world.start(0, &["arm", "sim", "--json", &own]);
    let output = calibrated(&world, &["--set", "robot.tool_m=[0.0, 0.0, 0.145]"]);
    assert_refused(&output, 5, &["5.0 mm", "settings", "--config"]);
    world.wait_for_mode(0, "idle");
    arm.end();
    let report = json(&world.file("arm.json"));
    assert_eq!(report["commands"]["max_step_rad"].as_f64(), Some(0.0), "{report}");
    daemon.end();
}
