//! `foretrace doctor`: a whole report on any machine, and removal of leftovers of dead processes only.

use std::fs::Permissions;
use std::os::unix::fs::PermissionsExt;
use std::path::Path;

use foretrace_tests::{World, assert_refused, json, told, until};
use serde_json::Value;

use crate::PROGRAM;

/// Short, and without real-time rights.
const DOCTOR: [&str; 4] = ["doctor", "--no-rights", "--seconds", "0.5"];

fn doctor(world: &World, more: &[&str]) -> std::process::Output {
    world.run(0, &[&DOCTOR, more].concat())
}

fn check<'a>(report: &'a Value, name: &str) -> &'a Value {
    let found = report["checks"].as_array().unwrap().iter().find(|check| check["name"] == name);
    found.unwrap_or_else(|| panic!("no check {name} in {report}"))
}

/// What holds for every report on every machine.
fn assert_whole(report: &Value) {
    let checks = report["checks"].as_array().unwrap();
    assert!(checks.len() >= 8, "{report}");
    let mut names: Vec<_> = checks.iter().map(|check| check["name"].as_str().unwrap()).collect();
    names.sort_unstable();
    names.dedup();
    assert_eq!(names.len(), checks.len(), "{report}");
    for check in checks {
        let (ok, fix) = (check["ok"].as_bool().unwrap(), check["fix"].as_str().unwrap());
        assert_eq!(ok, fix.is_empty(), "{check}");
        assert_eq!(ok, check["level"] == "ok", "{check}");
        assert!(!check["value"].as_str().unwrap().is_empty(), "{check}");
    }
    let bad = checks.iter().any(|check| check["level"] == "bad");
    assert_eq!(report["verdict"], if bad { "unfit" } else { "fit" }, "{report}");
}

fn segments_of(world: &World) -> usize {
    world.instance(0).shared_memory().unwrap().segments
}

#[test]
fn the_report_is_whole_and_says_how_to_mend_what_is_not_ok() {
    let world = World::new(PROGRAM);
    let output = doctor(&world, &["--rate", "250", "--json", "report.json"]);
    // Without rights no machine is fit.
    assert_refused(&output, 6, &["unfit for 250 Hz", "rt-thread"]);
    let report = json(&world.file("report.json"));
    assert_whole(&report);
    assert_eq!(
        (&report["verdict"], &report["rate_hz"], &report["period_us"]),
        (&"unfit".into(), &250.into(), &4000.into())
    );
    let words = String::from_utf8_lossy(&output.stdout);
    for check in report["checks"].as_array().unwrap() {
        for part in ["name", "value", "fix"] {
            assert!(words.contains(check[part].as_str().unwrap()), "{check} in {}", told(&output));
        }
    }
    assert!(words.contains("UNFIT for 250 Hz"), "{}", told(&output));

    let lateness = &report["lateness_us"];
    let [ticks, missed] = ["ticks", "missed"].map(|key| lateness[key].as_u64().unwrap());
    assert!(ticks > 0 && ticks + missed >= 120, "{lateness}");
    let counted: u64 =
        lateness["histogram"].as_array().unwrap().iter().map(|b| b["count"].as_u64().unwrap()).sum();
    assert_eq!(counted, ticks, "{lateness}");
    let of = |key: &str| lateness[key].as_f64().unwrap();
    assert!(of("p50") <= of("p99") && of("p99") <= of("p99_9") && of("p99_9") <= of("max"), "{lateness}");

    let names: Vec<_> = std::fs::read_dir(world.file(".")).unwrap().map(|e| e.unwrap().file_name()).collect();
    assert!(!names.iter().any(|name| name.to_string_lossy().contains("partial")), "{names:?}");
    let output = doctor(&world, &["--json", "-"]);
    let report: Value = serde_json::from_slice(&output.stdout).expect("stdout carries JSON only");
    assert_whole(&report);
    assert_eq!(report["rate_hz"], 500);
}

#[test]
fn with_rights_asked_for_exit_code_and_verdict_agree() {
    if std::env::var_os("FORETRACE_RT_TESTS").is_none_or(|value| value != "1") {
        return;
    }
    let world = World::new(PROGRAM);
    let output = world.run(0, &["doctor", "--seconds", "0.5", "--json", "report.json"]);
    let report = json(&world.file("report.json"));
    assert_whole(&report);
    let code = if report["verdict"] == "fit" { 0 } else { 6 };
    assert_eq!(output.status.code(), Some(code), "{}", told(&output));
}

#[test]
fn wrong_input_is_refused_before_anything_is_measured_or_written() {
    let world = World::new(PROGRAM);
    let file = world.write("wrong.toml", "preset = \"ur5\"\n[loop]\nrate_herz = 500\n");
    let nowhere = world.file("none/report.json").display().to_string();
    for (more, code, words) in [
        (&["--config", file.as_str()][..], 5, &["wrong.toml:3", "rate_herz"][..]),
        (&["--config", "nowhere.toml"], 5, &["nowhere.toml"]),
        (&["--preset", "ur7"], 2, &["ur7"]),
        (&["--rate", "333"], 2, &["333"]),
        (&["--set", "loop.cpu=-1"], 5, &["loop.cpu", "-1"]),
        (&["--json", nowhere.as_str()], 5, &["none/report.json", "no folder"]),
        (&["--json", "."], 5, &["it is a folder"]),
    ] {
        let output = doctor(
            &world,
            &[&["--json", "report.json"][..(2 * usize::from(more[0] != "--json"))], more].concat(),
        );
        assert_refused(&output, code, words);
        assert!(output.stdout.is_empty(), "{}", told(&output));
        assert!(!world.file("report.json").exists());
    }
    for seconds in ["0", "-1", "nan", "1e9", "soon"] {
        let output = world.run(0, &["doctor", &format!("--seconds={seconds}")]);
        assert_refused(&output, 2, &["--seconds", "0.5 to 3600"]);
    }
    assert!(!Path::new(&nowhere).exists());
}

#[test]
fn leftovers_of_a_killed_daemon_are_told_and_removed_on_request_only() {
    let world = World::new(PROGRAM);
    world.daemon(0).kill();
    let left = segments_of(&world);
    assert!(left > 0, "a killed daemon leaves its segments");
    let output = doctor(&world, &["--json", "before.json"]);
    let found = json(&world.file("before.json"));
    assert_whole(&found);
    let leftovers = check(&found, "leftovers");
    assert!(
        leftovers["level"] == "warning" && leftovers["fix"].as_str().unwrap().contains("--clean"),
        "{}",
        told(&output)
    );
    assert!(found.get("removed").is_none() && segments_of(&world) == left, "{found}");

    let output = doctor(&world, &["--clean", "--json", "after.json"]);
    let cleaned = json(&world.file("after.json"));
    let [removed] = cleaned["removed"].as_array().unwrap().as_slice() else { panic!("{cleaned}") };
    assert_eq!(
        (&removed["segments"], &removed["dead_nodes"]),
        (&left.into(), &2.into()),
        "{}",
        told(&output)
    );
    assert!(
        String::from_utf8_lossy(&output.stdout).contains(&format!("{left} files in /dev/shm")),
        "{}",
        told(&output)
    );
    assert!(check(&cleaned, "leftovers")["ok"] == true && segments_of(&world) == 0, "{cleaned}");
    let output = doctor(&world, &["--clean"]);
    assert!(String::from_utf8_lossy(&output.stdout).contains("nothing to remove"), "{}", told(&output));
}

/// Puts garbage in place of every file below `folder`.
fn damage(folder: &Path) {
    for entry in std::fs::read_dir(folder).unwrap().map(Result::unwrap) {
        if entry.file_type().unwrap().is_dir() {
            damage(&entry.path());
        } else {
            std::fs::set_permissions(entry.path(), Permissions::from_mode(0o600)).unwrap();
            std::fs::write(entry.path(), b"\xff\x00 nothing that anybody wrote").unwrap();
        }
    }
}

#[test]
fn damaged_leftovers_are_removed_too() {
    let world = World::new(PROGRAM);
    world.daemon(0).kill();
    let instance = world.instance(0);
    damage(&instance.root().join("iox2"));
    for entry in std::fs::read_dir("/dev/shm").unwrap().map(Result::unwrap) {
        if entry.file_name().to_string_lossy().starts_with(instance.prefix()) {
            // The leftovers of a process killed between making a segment and setting its size.
            std::fs::File::create(entry.path()).unwrap();
            std::fs::set_permissions(entry.path(), Permissions::from_mode(0o200)).unwrap();
        }
    }
    let output = doctor(&world, &["--clean", "--json", "report.json"]);
    let report = json(&world.file("report.json"));
    assert_whole(&report);
    assert_eq!(report["removed"].as_array().unwrap().len(), 1, "{}", told(&output));
    assert!(check(&report, "leftovers")["ok"] == true && segments_of(&world) == 0, "{report}");
    world.daemon(0).end();
}

#[test]
fn nothing_of_a_living_daemon_is_removed_when_a_peer_of_it_died() {
    let world = World::new(PROGRAM);
    let mut daemon = world.daemon(0);
    let arm = world.start(0, &["arm", "sim"]);
    until("the arm is attached", || (world.instance(0).peers().unwrap().len() > 1).then_some(()));
    until("joint states arrive", || (world.status(0)["arm"]["states"].as_u64() > Some(0)).then_some(()));
    arm.kill();
    let output = doctor(&world, &["--clean", "--json", "report.json"]);
    let report = json(&world.file("report.json"));
    assert_whole(&report);
    let [removed] = report["removed"].as_array().unwrap().as_slice() else { panic!("{}", told(&output)) };
    assert_eq!(removed["dead_nodes"], 1, "{report}");
    // It would be disturbed by a second real-time thread.
    let thread = check(&report, "rt-thread");
    assert!(thread["level"] == "skipped", "{report}");
    assert!(thread["value"].as_str().unwrap().contains(&format!("process {}", daemon.pid())), "{report}");
    assert!(check(&report, "leftovers")["ok"] == true, "{report}");
    daemon.expect_alive();
    // The services are whole: another arm can attach.
    world.armed_arm(0, &[]).end();
    daemon.end();
}
