//! `foretrace demo` from start to end, and when things go wrong in the middle.

use foretrace_tests::page::Page;
use foretrace_tests::{World, assert_refused, json, shared_data, told, until};

use crate::PROGRAM;

/// Names of the demo's own in /dev/shm and /tmp.
fn leftovers(pid: u32) -> Vec<String> {
    let named = format!("foretrace-demo-{pid}");
    let in_tmp = std::fs::read_dir("/tmp").unwrap().flatten().map(|entry| entry.file_name());
    in_tmp.map(|name| name.to_string_lossy().into_owned()).filter(|name| name.starts_with(&named)).collect()
}

fn check_report(world: &World, folder: &str) -> serde_json::Value {
    let report = json(&world.file(folder).join("report.json"));
    for key in [
        "/loop/rate_hz",
        "/loop/ticks",
        "/loop/overruns",
        "/loop/allocations_per_tick",
        "/loop/connection_allocations",
        "/loop/step_us/p50",
        "/loop/step_us/p99_9",
        "/loop/wakeup_us/max",
        "/loop/overruns_by_wakeup",
        "/loop/overruns_by_work",
        "/tracking/rms_m",
        "/tracking/max_m",
        "/tracking/lag_ms",
        "/tracking/ghost_rms_m",
        "/tracking/ghost_max_m",
        "/tracking/ghost_lag_ms",
        "/tracking/records_rms_apart",
        "/tracking/records_lag_apart_ms",
        "/ghost/compared_s",
        "/ghost/compared_share",
        "/ghost/cost_us",
        "/joints/velocity_share/0",
        "/joints/acceleration_share/5",
        "/commands/count",
        "/commands/limit_violations",
        "/pen/samples",
        "/pen/rejected",
        "/pen/dropped",
        "/learner/updates",
        "/learner/promotions",
        "/learner/rollbacks",
    ] {
        let value = report.pointer(key).unwrap_or_else(|| panic!("{key} is missing in {report}"));
        assert!(value.is_number(), "{key} = {value}");
    }
    assert_eq!(report["commands"]["limit_violations"], 0, "{report}");
    assert_eq!(report["pen"]["rejected"], 0, "{report}");
    assert_eq!(names(world, folder), ["report.html", "report.json"]);
    let page = Page::read(&world.file(folder).join("report.html"));
    assert_eq!(page.pictures.len(), 5, "one picture per claim");
    assert_eq!(page.beside[..2], [true; 2], "lag and error show the arm and its ghost");
    let moved = page.moved.as_ref().expect("a replay");
    for series in ["pen", "arm", "ghost"] {
        let places = moved[series]["x"].as_array().unwrap().iter().filter(|x| x.is_number()).count();
        assert!(places > 50, "{series}: {places} frames");
    }
    let joints = moved["arm_joints"]["at"].as_array().unwrap();
    assert!(
        joints.len() > 21 * 25 && joints.iter().any(serde_json::Value::is_number),
        "the arm from its side"
    );
    assert_eq!(doubles(&report), Vec::<String>::new());
    page.agrees_with(&report);
    report
}

/// Figures of tracking and ghost that stand there twice: as they are, squared, or in another unit.
fn doubles(report: &serde_json::Value) -> Vec<String> {
    let of = |part: &str| report[part].as_object().unwrap().clone().into_iter();
    let all: Vec<(String, f64)> = of("tracking")
        .chain(of("ghost"))
        .filter_map(|(key, value)| Some((key, value.as_f64().filter(|number| *number != 0.0)?)))
        .collect();
    let same = |a: f64, b: f64| {
        let ratio = [a / b, b / a, a * a / b, b * b / a];
        ratio.iter().any(|ratio| [1.0, 1e3].iter().any(|factor| (ratio / factor - 1.0).abs() < 1e-9))
    };
    let pairs = all.iter().enumerate().flat_map(|(k, a)| all[k + 1..].iter().map(move |b| (a, b)));
    pairs.filter(|(a, b)| same(a.1, b.1)).map(|(a, b)| format!("{} and {}", a.0, b.0)).collect()
}

fn names(world: &World, folder: &str) -> Vec<String> {
    let entries = std::fs::read_dir(world.file(folder)).unwrap().flatten();
    let mut names: Vec<_> = entries.map(|entry| entry.file_name().to_string_lossy().into_owned()).collect();
    names.sort();
    names
}

/// A machine that keeps no 40 ms may stop this arm: then the demo says so, and the figures hold up to there.
#[test]
fn demo_of_a_universal_robot_counts_what_bridge_and_bare_line_lost() {
    let world = World::new(PROGRAM);
    let demo = ["demo", "--arm", "ur", "--seconds", "3", "--no-rights", "--out", "report"];
    let output = world.start(0, &demo).output();
    assert!(matches!(output.status.code(), Some(0 | 1)), "{}", told(&output));
    let report = json(&world.file("report").join("report.json"));
    assert_eq!(report["commands"]["limit_violations"], 0, "{report}");
    let count = |pointer: &str| report.pointer(pointer).and_then(serde_json::Value::as_u64);
    assert!(count("/arm/link/following_cycles") > Some(50), "{report}");
    assert!(count("/echo/cycles") > Some(100), "{report}");
    for counted in
        ["/arm/link/lost_counters", "/arm/link/late_cycles", "/echo/lost_counters", "/echo/late_cycles"]
    {
        assert!(count(counted).is_some(), "{counted}: {report}");
    }
    assert!(told(&output).contains("a bare echo pair beside it"), "{}", told(&output));
}

#[test]
fn demo_ends_by_itself_with_a_whole_report_and_leaves_nothing() {
    let world = World::new(PROGRAM);
    let demo = world.start(0, &["demo", "--seconds", "3", "--no-rights", "--out", "report", "--json", "-"]);
    let pid = demo.pid();
    let output = demo.output();
    assert!(output.status.success(), "{}", told(&output));
    let printed: serde_json::Value =
        serde_json::from_slice(&output.stdout).expect("stdout carries JSON only");
    assert_eq!(printed, check_report(&world, "report"));
    assert_eq!(leftovers(pid), Vec::<String>::new());
}

#[test]
fn at_trust_0_the_demo_and_its_ghost_agree_and_both_with_the_records() {
    let world = World::new(PROGRAM);
    let arguments = ["demo", "--seconds", "5", "--trust", "0", "--no-rights", "--out", "report"];
    let output = world.run(0, &arguments);
    assert!(output.status.success(), "{}", told(&output));
    let report = check_report(&world, "report");
    let number = |key: &str| report.pointer(key).and_then(serde_json::Value::as_f64).unwrap();
    let tracking = &report["tracking"];
    let (real, ghost) = (number("/tracking/rms_m"), number("/tracking/ghost_rms_m"));
    assert!((ghost / real - 1.0).abs() < 0.03, "{tracking}");
    assert!((number("/tracking/ghost_lag_ms") - number("/tracking/lag_ms")).abs() < 2.0, "{tracking}");
    // The daemon measured online what the demo computes from the records of arm and player.
    assert!(number("/tracking/records_rms_apart").abs() < 0.05, "{tracking}");
    assert!(number("/tracking/records_lag_apart_ms").abs() < 3.0, "{tracking}");
    assert!(number("/ghost/compared_share") > 0.5, "{}", report["ghost"]);
}

#[test]
fn a_demo_that_is_stopped_reports_up_to_there_and_says_what_fired_and_what_to_do() {
    let world = World::new(PROGRAM);
    let fault = ["--arm-fault", "stuck@5"];
    let demo = ["demo", "--seconds", "20", "--no-rights", "--out", "report"];
    let output = world.run(0, &[demo.as_slice(), fault.as_slice()].concat());
    assert_refused(
        &output,
        1,
        &["stopped the arm by itself after", "\n  tracking error: ", "\n  the arm did not follow"],
    );
    let report = json(&world.file("report").join("report.json"));
    assert_eq!(report["loop"]["stops"][0]["reason"], "tracking error", "{report}");
    let page = Page::read(&world.file("report").join("report.html"));
    page.agrees_with(&report);
    let alert = page.alert.as_deref().expect("a box on top");
    let lines: Vec<&str> = alert.lines().map(str::trim).filter(|line| !line.is_empty()).collect();
    assert!(lines[0].starts_with("The daemon stopped the arm by itself after"), "{lines:?}");
    assert!(lines[1].starts_with("What fired: tracking error: "), "{lines:?}");
    assert!(lines[2].starts_with("What to do: the arm did not follow its commands"), "{lines:?}");
    assert!(!page.pictures.is_empty(), "what was seen up to there is drawn");
}

#[test]
fn demo_whose_output_nobody_reads_leaves_nothing() {
    let world = World::new(PROGRAM);
    let mut demo = world.start(0, &["demo", "--seconds", "1", "--no-rights", "--out", "report"]);
    let pid = demo.pid();
    demo.close_stdout();
    let output = demo.output();
    assert!(output.status.success(), "{}", told(&output));
    assert_eq!(leftovers(pid), Vec::<String>::new());
}

#[test]
fn demo_plays_recorded_handwriting_of_both_sets() {
    let world = World::new(PROGRAM);
    for set in ["unipen-ced", "unipen-tos"] {
        let Some(folder) = shared_data(set) else { continue };
        let table = std::fs::read_to_string(folder.join("split.tsv")).unwrap();
        let file =
            table.lines().skip(1).flat_map(|line| line.split('\t')).find(|cell| cell.ends_with(".dat"));
        let pen = folder.join(file.expect("a file in the split table")).display().to_string();
        let output = world.run(0, &["demo", "--seconds", "3", "--no-rights", "--out", set, "--pen", &pen]);
        assert!(output.status.success(), "{set}: {}", told(&output));
        check_report(&world, set);
    }
}

#[test]
fn refused_demo_makes_no_folder() {
    let world = World::new(PROGRAM);
    for refused in [["--set", "mpc.velocity_lead_ms=abc"], ["--pen", "nowhere.csv"], ["--predictor", "luck"]]
    {
        let output = world.run(0, &[&["demo", "--out", "report"], refused.as_slice()].concat());
        assert!(!output.status.success(), "{refused:?}: {}", told(&output));
        assert!(!world.file("report").exists(), "{refused:?}");
    }
}

#[test]
fn interrupted_demo_ends_its_children_and_leaves_nothing() {
    let world = World::new(PROGRAM);
    let mut demo = world.start(0, &["demo", "--seconds", "60", "--no-rights", "--out", "report"]);
    let pid = demo.pid();
    let children = || {
        let list = std::fs::read_to_string(format!("/proc/{pid}/task/{pid}/children")).unwrap_or_default();
        list.split_whitespace().filter_map(|pid| pid.parse::<u32>().ok()).collect::<Vec<_>>()
    };
    let family = until("the demo has its three children", || {
        demo.expect_alive();
        Some(children()).filter(|family| family.len() == 3)
    });
    demo.signal("-INT");
    let output = demo.output();
    assert_refused(&output, 130, &["interrupted"]);
    for child in family {
        assert!(!std::path::Path::new(&format!("/proc/{child}")).exists(), "child {child} is still there");
    }
    assert_eq!(leftovers(pid), Vec::<String>::new());
}

#[test]
fn demo_whose_child_is_killed_says_which_and_ends() {
    let world = World::new(PROGRAM);
    let mut demo = world.start(0, &["demo", "--seconds", "60", "--no-rights", "--out", "report"]);
    let pid = demo.pid();
    let arm = until("the demo has its arm", || {
        demo.expect_alive();
        let list = std::fs::read_to_string(format!("/proc/{pid}/task/{pid}/children")).unwrap_or_default();
        list.split_whitespace().nth(1).map(str::to_owned)
    });
    let killed = std::process::Command::new("kill").args(["-KILL", &arm]).status().unwrap();
    assert!(killed.success());
    assert_refused(&demo.output(), 1, &["the arm ended early"]);
    assert_eq!(leftovers(pid), Vec::<String>::new());
}
