//! Wrong input gives one sentence and the right exit code.

mod table;

use std::os::unix::fs::{PermissionsExt, chown};
use std::path::Path;
use std::process::{Command, Stdio};

use foretrace_tests::{World, assert_refused, skipped, told};

use crate::PROGRAM;

/// Every entry below `folder`, so that a case can be seen to have made none.
fn entries(folder: &Path) -> Vec<String> {
    let mut found: Vec<String> = std::fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned())
        .collect();
    found.sort();
    found
}

#[test]
fn one_table_of_wrong_invocations() {
    let world = World::new(PROGRAM);
    for (name, text) in table::FILES {
        let _ = world.write(name, text);
    }
    let folder = world.file("");
    let before = entries(&folder);
    assert!(table::CASES.len() >= 100, "{}", table::CASES.len());
    let mut wrong = Vec::new();
    for (case, code, expected) in table::CASES {
        let words = table::words(case, folder.to_str().unwrap().trim_end_matches('/'));
        let output = world.start_plain(&words).output();
        let stderr = String::from_utf8_lossy(&output.stderr).into_owned();
        let said = stderr.lines().any(|line| line.split_whitespace().count() >= 3);
        let begins = ["foretrace: ", "error: ", "Usage: ", "play: ", "lab: "]
            .iter()
            .any(|begin| stderr.contains(begin));
        let raw = stderr
            .chars()
            .any(|c| (c.is_control() && c != '\n' && c != '\t') || ('\u{202a}'..='\u{202e}').contains(&c));
        let missing: Vec<_> = expected.iter().filter(|word| !stderr.contains(**word)).collect();
        let left: Vec<String> = entries(&folder).into_iter().filter(|name| !before.contains(name)).collect();
        let complaints = [
            (output.status.code() != Some(*code), format!("exit code is not {code}")),
            (!missing.is_empty(), format!("missing: {missing:?}")),
            (!output.stdout.is_empty(), "something on stdout".to_owned()),
            (!said || !begins, "no sentence".to_owned()),
            (stderr.contains("panicked") || stderr.contains("RUST_BACKTRACE"), "a panic".to_owned()),
            (raw, "a raw control character".to_owned()),
            (!left.is_empty(), format!("left behind: {left:?}")),
        ];
        for (_, complaint) in complaints.iter().filter(|(broken, _)| *broken) {
            wrong.push(format!("`foretrace {}`: {complaint}: {}", case.escape_debug(), told(&output)));
        }
        for name in left {
            let path = folder.join(name);
            let _ = std::fs::remove_file(&path).or_else(|_| std::fs::remove_dir_all(&path));
        }
    }
    assert!(wrong.is_empty(), "{} complaints:\n{}", wrong.len(), wrong.join("\n"));
}

/// Runs the program under `limits` of a shell, for example `-n 32`.
fn limited(world: &World, limits: &str, arguments: &[&str]) -> std::process::Output {
    // A limit without effect must not block the test for ever.
    let script = format!("ulimit {limits} || exit 99; exec timeout 60 \"$@\"");
    let mut command = Command::new("sh");
    command.args(["-c", &script, "sh", PROGRAM]).args(arguments).current_dir(world.file(""));
    command.env_remove("XDG_RUNTIME_DIR").stdin(Stdio::null()).output().unwrap()
}

#[test]
fn low_limits_are_named_with_what_to_do() {
    let world = World::new(PROGRAM);
    let options = world.instance_options(0);
    let daemon: Vec<&str> =
        ["daemon", "--no-rights"].into_iter().chain(options.iter().map(String::as_str)).collect();
    let demo = ["demo", "--seconds", "1", "--no-rights", "--out", "report"];
    for (limits, words) in
        [("-n 32", "open files is 32 (ulimit -n)"), ("-f 8", "(ulimit -f), the daemon needs 4096")]
    {
        assert_refused(&limited(&world, limits, &daemon), 1, &[words, "raise it"]);
        assert_refused(&limited(&world, limits, &demo), 1, &[words, "raise it"]);
    }
    // A small stack is no reason to fail.
    let output = limited(&world, "-s 256", &["config", "show", "ur5e"]);
    assert!(output.status.success() && output.stdout.len() > 1000, "{}", told(&output));
    // More than the shell lets a file grow: an error of the program, not its end by a signal.
    let output = limited(&world, "-f 8", &["config", "show", "ur5e"]);
    assert!(output.status.success(), "a pipe is no file: {}", told(&output));
    let csv = "t_s,x_m,y_m,contact\n0.0,0.0,0.0,1\n0.01,0.1,0.0,1\n";
    let file = world.write("a.csv", csv);
    let long = ["lab", "evaluate", "--data", &file];
    assert_refused(&limited(&world, "-n 32", &long), 5, &["a.csv"]);
}

#[test]
fn a_device_without_room_is_named_by_every_command_that_prints() {
    let world = World::new(PROGRAM);
    let mesh = world.write("a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 2 4\n");
    let urdf = format!(
        "<robot name=\"a\"><link name=\"l\"><collision><geometry><mesh \
         filename=\"{mesh}\"/></geometry></collision></link></robot>"
    );
    let urdf = world.write("a.urdf", &urdf);
    let settings = world.write("a.toml", "preset = \"ur5\"\n");
    for words in [
        &["--help"][..],
        &["--version"],
        &["lab", "train", "--help"],
        &["config", "show"],
        &["config", "check", &settings],
        &["config", "shapes", &urdf],
    ] {
        let full = std::fs::OpenOptions::new().write(true).open("/dev/full").unwrap();
        let output = Command::new(PROGRAM).args(words).stdout(full).stderr(Stdio::piped()).output().unwrap();
        assert_refused(&output, 1, &["stdout cannot be written", "No space left"]);
    }
    let output = world.run_plain(&["config", "shapes", &urdf, "--out", "/dev/full"]);
    assert_refused(&output, 1, &["/dev/full", "No space left"]);
}

#[test]
fn ctrl_c_leaves_no_half_written_targets() {
    // A pipe that nobody reads keeps the export waiting for as long as the test likes.
    let world = World::new(PROGRAM);
    let data = world.file("set");
    std::fs::create_dir(&data).unwrap();
    let mut csv = "t_s,x_m,y_m,contact\n".to_owned();
    for i in 0..60_000 {
        csv += &format!(
            "{:.3},{:.5},{:.5},1\n",
            f64::from(i) * 0.01,
            0.05 * (f64::from(i) * 0.05).sin(),
            1e-6 * f64::from(i)
        );
    }
    for name in ["a", "b", "c", "d"] {
        std::fs::write(data.join(format!("{name}.csv")), &csv).unwrap();
    }
    let out = world.file("targets");
    std::fs::create_dir(&out).unwrap();
    for path in [&data, &out] {
        std::fs::set_permissions(path, std::fs::Permissions::from_mode(0o755)).unwrap();
        chown(path, Some(world.user()), Some(world.user())).unwrap();
    }
    let words =
        ["lab", "leadtime", "--data", data.to_str().unwrap(), "--export-targets", out.to_str().unwrap()];
    let words: Vec<String> = words.iter().map(|word| (*word).to_owned()).collect();
    let export = world.start_plain(&words);
    foretrace_tests::until("a file is being written", || (!entries(&out).is_empty()).then_some(()));
    export.signal("-INT");
    let output = export.output();
    assert!(matches!(output.status.code(), Some(0 | 130)), "{}", told(&output));
    let left: Vec<String> = entries(&out).into_iter().filter(|name| name.contains("partial")).collect();
    assert!(left.is_empty(), "{left:?}: {}", told(&output));
    if output.status.code() == Some(130) {
        assert!(String::from_utf8_lossy(&output.stderr).contains("interrupted"), "{}", told(&output));
    }
}

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
    // The shown settings load as the same settings.
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
    let file = world.write("broken.csv", "t_s,x_m,y_m,contact\n0.0,0.0,0.0,1\nsoon,0.1,0.0,1\n");
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
    assert_refused(&world.run(0, &["arm", "sim"]), 1, &["the only publisher slot is in use"]);
    let player = world.start(0, &["play", "glyphs:ab", "--loop"]);
    world.wait_for_mode(0, "following");
    assert_refused(&world.run(0, &["play", "glyphs:a"]), 1, &["the pen is held by the player"]);
    for process in [player, arm, daemon] {
        process.end();
    }
}

#[test]
fn requests_that_make_no_sense_never_leave() {
    let world = World::new(PROGRAM);
    for wrong in [&["trust", "1.5"][..], &["predictor", "oracle"], &["fly"]] {
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
