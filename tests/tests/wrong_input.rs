//! What people get wrong is answered in one sentence, with the right exit code.

use foretrace_tests::{World, assert_refused, skipped, told};

const PROGRAM: &str = env!("CARGO_BIN_EXE_foretrace-under-test");

#[test]
fn misspelt_key_is_named_with_file_and_line() {
    let world = World::new(PROGRAM);
    let file = world.write("wrong.toml", "preset = \"ur5\"\n[loop]\nrate_herz = 500\n");
    let output = world.run_plain(&["config", "check", &file]);
    assert_refused(&output, 5, &["wrong.toml:3", "rate_herz", "rate_hz"]);
    let output = world.run(0, &["daemon", "--config", &file]);
    assert_refused(&output, 5, &["wrong.toml:3", "rate_herz"]);
}

#[test]
fn negative_limit_is_refused_with_its_legal_range() {
    let world = World::new(PROGRAM);
    let file = world.write("wrong.toml", "preset = \"ur5\"\n[mpc.limits.x]\nvelocity_mps = -0.5\n");
    let output = world.run_plain(&["config", "check", &file]);
    assert_refused(&output, 5, &["wrong.toml:3", "-0.5", "0.001 to 5"]);
}

#[test]
fn workspace_out_of_reach_is_refused() {
    let world = World::new(PROGRAM);
    let file = world.write("wrong.toml", "preset = \"ur5\"\n[plane]\norigin_m = [1.5, 0.1, 0.2]\n");
    let output = world.run_plain(&["config", "check", &file]);
    assert_refused(&output, 5, &["wrong.toml", "reach"]);
    let output = world.run(0, &["demo", "--config", &file, "--seconds", "2"]);
    assert_refused(&output, 5, &["reach"]);
}

#[test]
fn settings_that_are_right_are_summed_up_and_shown() {
    let world = World::new(PROGRAM);
    let file = world.write("right.toml", "preset = \"ur5e\"\n[loop]\nrate_hz = 250\n[pen]\nstep_ms = 12\n");
    let output = world.run_plain(&["config", "check", &file]);
    assert!(output.status.success(), "{}", told(&output));
    let output = world.run_plain(&["config", "show", "--config", &file]);
    assert!(String::from_utf8_lossy(&output.stdout).contains("rate_hz = 250"), "{}", told(&output));
    // What is shown reads back as the same settings.
    let shown = world.write("shown.toml", &String::from_utf8_lossy(&output.stdout));
    let output = world.run_plain(&["config", "check", &shown]);
    assert!(output.status.success(), "{}", told(&output));
}

#[test]
fn missing_and_malformed_recordings_are_told_apart() {
    let world = World::new(PROGRAM);
    for command in [&["play"][..], &["demo", "--seconds", "2", "--pen"][..]] {
        let output = world.run(0, &[command, &["nowhere.dat"]].concat());
        assert_refused(&output, 5, &["nowhere.dat", "No such file"]);
    }
    let file = world.write("broken.dat", ".VERSION 1.0\n.PEN_DOWN\n12 what\n.PEN_UP\n");
    assert_refused(&world.run(0, &["play", &file]), 5, &["broken.dat"]);
    let file = world.write("broken.csv", "t_s,x_m,y_m,contact\n0.0,0.0,0.0,1\n0.0,0.1,0.0,1\n");
    assert_refused(&world.run(0, &["play", &file]), 5, &["broken.csv:3", "t_s"]);
    assert_refused(&world.run(0, &["play", "glyphs:ß"]), 5, &["ß"]);
    let output = world.run_plain(&["lab", "fig2", "--data", "nowhere"]);
    assert_refused(&output, 5, &["nowhere", "split"]);
}

#[test]
fn without_a_daemon_every_peer_says_so() {
    let world = World::new(PROGRAM);
    for command in [
        &["status"][..],
        &["status", "--watch"],
        &["request", "arm"],
        &["play", "glyphs:a"],
        &["arm", "sim"],
        &["record", "--pen", "a.csv"],
        &["calibrate", "lag"],
    ] {
        assert_refused(&world.run(0, command), 3, &["no daemon running", "foretrace daemon"]);
    }
}

#[test]
fn second_daemon_on_the_same_instance_is_refused_and_the_first_lives_on() {
    let world = World::new(PROGRAM);
    let mut first = world.daemon(0);
    let second = world.run(0, &["daemon", "--no-rights"]);
    assert_refused(&second, 1, &["already has a daemon", &first.pid().to_string()]);
    first.expect_alive();
    assert_eq!(world.status(0)["pid"], first.pid());
    first.end();
}

#[test]
fn second_arm_and_second_player_are_refused() {
    let world = World::new(PROGRAM);
    let daemon = world.daemon(0);
    let arm = world.armed_arm(0, &[]);
    assert_refused(&world.run(0, &["arm", "sim"]), 1, &["places", "taken"]);
    let player = world.start(0, &["play", "glyphs:ab", "--loop"]);
    world.wait_for_mode(0, "following");
    assert_refused(&world.run(0, &["play", "glyphs:a"]), 1, &["places", "taken"]);
    for process in [player, arm, daemon] {
        process.end();
    }
}

#[test]
fn requests_that_make_no_sense_never_leave() {
    let world = World::new(PROGRAM);
    for wrong in [&["trust", "1.5"][..], &["trust", "nan"], &["predictor", "crystal-ball"], &["fly"]] {
        assert_refused(&world.run(0, &[&["request"], wrong].concat()), 2, &[]);
    }
}

#[test]
fn arming_without_an_arm_is_refused_with_the_reason() {
    let world = World::new(PROGRAM);
    let daemon = world.daemon(0);
    assert_refused(&world.run(0, &["request", "arm"]), 4, &["refused", "joint state"]);
    daemon.end();
}

#[test]
fn daemon_without_rights_runs_on_and_says_what_is_missing() {
    let world = World::new(PROGRAM);
    if !world.is_unprivileged() {
        skipped("the program cannot be run as an unprivileged user here");
        return;
    }
    // Asks for rights it cannot have; does not spin, because two cores would starve.
    let daemon = world.start(0, &["daemon", "--set", "loop.spin_us=0"]);
    let status = foretrace_tests::until("the daemon comes up", || {
        let output = world.run(0, &["status", "--json", "-"]);
        let status: Option<serde_json::Value> = serde_json::from_slice(&output.stdout).ok();
        status.filter(|status| status["missing_rights"].as_array().is_some_and(|rights| !rights.is_empty()))
    });
    let missing = status["missing_rights"].to_string();
    assert!(missing.contains("real-time scheduling"), "{missing}");
    let output = daemon.end();
    assert!(String::from_utf8_lossy(&output.stderr).contains("WARN"), "{}", told(&output));
}

#[test]
fn closed_pipe_ends_the_program_quietly() {
    use std::process::{Command, Stdio};
    let mut shown = Command::new(PROGRAM)
        .args(["config", "show"])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    drop(shown.stdout.take());
    let output = shown.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(0), "{}", told(&output));
    assert!(output.stderr.is_empty(), "{}", told(&output));
}
