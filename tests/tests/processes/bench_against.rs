//! `foretrace bench --against`: two programs in turn, and every way in which the other one may not take part.

use std::os::unix::fs::PermissionsExt;
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

use foretrace_tests::{World, told};
use rustix::process::Signal;
use serde_json::{Value, json};

use crate::PROGRAM;

/// A shell script that greets like foretrace and answers `bench` with `answer`.
fn pretender(world: &World, name: &str, knows_parts: bool, answer: &str) -> String {
    let help = if knows_parts { "--part <PARTS>" } else { "--samples <N>" };
    let text = format!(
        "#!/bin/sh\ncase \"$*\" in\n--version) echo 'foretrace 0.0.9, messages 0';;\n'bench --help') echo '  {help}';;\n\
         *) {answer};;\nesac\n"
    );
    let path = world.write(name, &text);
    // Who runs in the world may be another user, and one of the programs writes to itself.
    std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o777)).unwrap();
    path
}

fn report(rows: &str) -> String {
    format!("echo '{{\"horizon\": 20, \"samples\": 50, \"optimised_build\": true, {rows}}}'")
}

fn comparison(world: &World, other: &str, more: &[&str]) -> Value {
    let words = [&["bench", "--against", other, "--samples", "50", "--json", "-"], more].concat();
    // Its own limit of time is the bound: the world's is too short for many benches on a busy machine.
    let mut program = Command::new(PROGRAM);
    let out = program.args(words).current_dir(world.file("")).output().unwrap();
    assert!(out.status.success(), "{}", told(&out));
    serde_json::from_slice(&out.stdout).unwrap()
}

fn column(cells: &Value, key: &str) -> Vec<String> {
    let text = |cell: &Value| cell[key].as_str().map_or_else(|| cell[key].to_string(), str::to_owned);
    cells.as_array().unwrap().iter().map(text).collect()
}

#[test]
fn itself_in_turn_every_cell_kept_and_every_row_with_its_interval() {
    let world = World::new(PROGRAM);
    let found = comparison(&world, PROGRAM, &["--rounds", "6", "--part", "ik,lag", "--out", "cells"]);
    for key in ["version", "sha256", "program"] {
        assert!(found["this"][key].is_string() && found["this"][key] == found["other"][key], "{found}");
    }
    assert_eq!((&found["rounds"], &found["samples"]), (&json!(6), &json!(50)));
    // One process per part, round and side; who begins alternates by round.
    let cells = &found["cells"];
    let [a, b] = [["this", "other", "this", "other"], ["other", "this", "other", "this"]];
    assert_eq!(column(cells, "side"), [a, b].concat().repeat(3));
    assert_eq!(column(cells, "part"), ["ik", "ik", "lag", "lag"].repeat(6));
    assert_eq!(column(cells, "round"), ["1", "2", "3", "4", "5", "6"].map(|round| [round; 4]).concat());
    for file in column(cells, "file") {
        let kept: Value =
            serde_json::from_slice(&std::fs::read(world.file("cells").join(&file)).unwrap()).unwrap();
        let part = if file.contains("-ik-") { "ik_us" } else { "lag_us" };
        assert!(kept[part].is_object() && kept["horizon"].is_u64(), "{file}: {kept}");
    }
    assert_eq!(
        column(&found["rows"], "row"),
        ["ik_us.clarabel", "ik_us.clarabel_tuned", "ik_us.exact", "lag_us"]
    );
    for row in found["rows"].as_array().unwrap() {
        let [ratio, low, high] = ["ratio", "low", "high"].map(|key| row[key].as_f64().unwrap());
        assert!(0.0 < low && low <= ratio && ratio <= high && high.is_finite(), "{row}");
    }
    assert_eq!((&found["only_this"], &found["only_other"]), (&json!([]), &json!([])));
    let kept: Value =
        serde_json::from_slice(&std::fs::read(world.file("cells/comparison.json")).unwrap()).unwrap();
    assert_eq!(kept, found);
    assert_eq!(std::fs::read_dir(world.file("cells")).unwrap().count(), 24 + 1);

    // Cells of two comparisons do not mix.
    let again = world.run_plain(&["bench", "--against", PROGRAM, "--out", "cells"]);
    assert_eq!(again.status.code(), Some(5), "{}", told(&again));
    assert!(told(&again).contains("cells") && told(&again).contains("has files"), "{}", told(&again));
}

#[test]
fn an_older_program_is_compared_bench_by_bench_and_its_other_rows_are_named() {
    let world = World::new(PROGRAM);
    let answer = report(r#""lag_us": {"p50": 1e6}, "gone_us": {"p50": 2}"#);
    let older = pretender(&world, "older", false, &answer);
    // A name without a slash is that of a file here, too, and is not looked for elsewhere.
    let found = comparison(&world, "older", &["--rounds", "2", "--out", "cells"]);
    assert_eq!(found["other"]["version"], "0.0.9");
    assert_eq!(column(&found["cells"], "side"), ["this", "other", "other", "this"]);
    assert_eq!(column(&found["cells"], "part"), ["all"; 4]);
    assert_eq!(column(&found["rows"], "row"), ["lag_us"]);
    assert_eq!(found["rows"][0]["other_us"], 1e6);
    assert!(found["rows"][0]["ratio"].as_f64().unwrap() > 1.0, "{found}");
    // Two rounds say too little for an interval.
    assert_eq!((&found["rows"][0]["low"], &found["rows"][0]["high"]), (&Value::Null, &Value::Null));
    assert_eq!(found["only_other"], json!(["gone_us"]));
    assert!(found["only_this"].as_array().unwrap().len() > 10, "{found}");

    let part = world.run_plain(&["bench", "--against", &older, "--part", "lag"]);
    assert_eq!(part.status.code(), Some(2), "{}", told(&part));
    assert!(told(&part).contains("leave --part out"), "{}", told(&part));
}

#[test]
fn whatever_the_other_does_instead_is_told_with_its_round_and_part_and_leaves_no_result() {
    let world = World::new(PROGRAM);
    let good = report(r#""lag_us": {"p50": 1}"#);
    let cases = [
        ("echo hello", 5, "printed no result of a bench"),
        ("echo '{}'", 5, "no horizon"),
        ("echo 'cannot plan' >&2; exit 3", 1, "exit status: 3: cannot plan"),
        ("kill -9 $$", 1, "signal: 9"),
        ("exec sleep 600", 1, "no end within 20.0 s"),
        ("exec yes", 5, "prints more than 1048576 bytes"),
        ("exec yes >&2", 5, "prints more than 1048576 bytes"),
        (
            r#"echo '{"horizon": 10, "samples": 50, "optimised_build": true, "lag_us": {"p50": 1}}'"#,
            5,
            "different problems",
        ),
        (&report(r#""new_us": {"p50": 1}"#), 5, "no row in common"),
        (&format!("{good}; echo '#' >>\"$0\""), 1, "changed while it was measured"),
    ];
    for (number, (answer, code, words)) in cases.into_iter().enumerate() {
        let other = pretender(&world, &format!("other-{number}"), true, answer);
        let cells = format!("cells-{number}");
        let limit = if words.contains("no end") { "20" } else { "120" };
        let out = world.run_plain(&[
            "bench",
            "--against",
            &other,
            "--samples",
            "50",
            "--rounds",
            "2",
            "--part",
            "lag",
            "--cell-limit",
            limit,
            "--out",
            &cells,
        ]);
        assert_eq!(out.status.code(), Some(code), "{answer}: {}", told(&out));
        assert!(told(&out).contains(words), "{answer}: {}", told(&out));
        if !["different", "common", "changed"].iter().any(|whole| words.contains(whole)) {
            let place = format!("{other}, round 1, part lag");
            assert!(told(&out).contains(&place), "{answer}: {}", told(&out));
        }
        let left = std::fs::read_dir(world.file(&cells)).into_iter().flatten().flatten();
        let names: Vec<String> = left.map(|file| file.file_name().to_string_lossy().into_owned()).collect();
        assert!(
            names.iter().all(|name| name.ends_with("this.json") || name.ends_with("other.json")),
            "{names:?}"
        );
        // What can be seen at once costs no second round.
        assert!(
            !words.contains("different") || names.iter().all(|name| name.contains("round-001")),
            "{names:?}"
        );
    }
    let twice = world.run_plain(&["bench", "--part", "lag,ik,lag"]);
    assert_eq!(twice.status.code(), Some(2), "{}", told(&twice));
    assert!(told(&twice).contains("part lag is named twice"), "{}", told(&twice));
    let missing = world.file("nobody").display().to_string();
    let plain = world.write("plain", "not a program\n");
    let stranger = world.write("stranger", "#!/bin/sh\necho hello\n");
    std::fs::set_permissions(&stranger, std::fs::Permissions::from_mode(0o755)).unwrap();
    let mute = pretender(&world, "mute", true, &good);
    std::fs::write(&mute, "#!/bin/sh\nexit 1\n").unwrap();
    // A file that may be run needs not be one that may be read.
    let hidden = pretender(&world, "hidden", true, &good);
    std::fs::set_permissions(&hidden, std::fs::Permissions::from_mode(0o111)).unwrap();
    let refused = if world.is_unprivileged() {
        "cannot be read, for its sum: Permission denied"
    } else {
        "cannot be started: Permission denied"
    };
    let hidden = if world.is_unprivileged() { &hidden } else { &plain };
    for (other, words) in [
        (hidden, refused),
        (&missing, "cannot be started: No such file"),
        (&plain, "cannot be started: Permission denied"),
        (&stranger, "is not foretrace: --version says \"hello\""),
        (&mute, "is not foretrace: --version ended with exit status: 1"),
    ] {
        let out = world.run_plain(&["bench", "--against", other, "--out", "none"]);
        assert_eq!(out.status.code(), Some(5), "{}", told(&out));
        assert!(told(&out).contains(words) && told(&out).contains("--against BINARY"), "{}", told(&out));
        assert!(!world.file("none").exists());
    }
}

/// Neither a bench that takes too long nor one whose comparison is interrupted leaves anything that runs.
#[test]
fn nothing_that_the_other_started_is_left() {
    let world = World::new(PROGRAM);
    let other =
        pretender(&world, "other", true, "sleep 600 & echo $! $$ >pids.part; mv pids.part pids; wait");
    // The limit holds for the cell of this program, too, which comes first.
    let late = ended_beside(&world, &other, "20", None);
    assert_eq!(late.status.code(), Some(1), "{}", told(&late));
    let who = format!("{other}, round 1, part lag: no end within 20.0 s");
    assert!(told(&late).contains(&who), "{}", told(&late));
    // What a terminal sends reaches none but the program that it began.
    for signal in [Signal::TERM, Signal::QUIT, Signal::HUP] {
        let out = ended_beside(&world, &other, "500", Some(signal));
        assert_eq!(out.status.code(), Some(130), "{signal:?}: {}", told(&out));
    }
}

/// One that is killed can end nothing: the system ends what it started.
#[test]
fn what_a_killed_comparison_ran_ends_with_it() {
    let world = World::new(PROGRAM);
    let other = pretender(&world, "other", true, "echo $$ >pids.part; mv pids.part pids; exec sleep 600");
    let out = ended_beside(&world, &other, "500", Some(Signal::KILL));
    assert_eq!(out.status.code(), None, "{}", told(&out));
}

/// How a comparison with `other` ends, which notes its processes in the file `pids`; `signal` is sent once it
/// has. None of these is left.
fn ended_beside(world: &World, other: &str, limit: &str, signal: Option<Signal>) -> Output {
    let pids = world.file("pids");
    let _ = std::fs::remove_file(&pids);
    let words = ["bench", "--against", other, "--samples", "50", "--part", "lag", "--cell-limit", limit];
    let mut program = Command::new(PROGRAM);
    program.args(words).current_dir(world.file("")).stderr(Stdio::piped());
    let child = program.spawn().unwrap();
    let began = Instant::now();
    if let Some(signal) = signal {
        while !pids.exists() {
            assert!(began.elapsed().as_secs() < 120);
            std::thread::sleep(Duration::from_millis(10));
        }
        rustix::process::kill_process(rustix::process::Pid::from_child(&child), signal).unwrap();
    }
    let out = child.wait_with_output().unwrap();
    for pid in std::fs::read_to_string(&pids).unwrap().split_whitespace() {
        while runs(pid) {
            assert!(began.elapsed().as_secs() < 240, "{pid} is left");
            std::thread::sleep(Duration::from_millis(10));
        }
    }
    out
}

/// Whether a process is there that has not ended: one that nobody has waited for yet has.
fn runs(pid: &str) -> bool {
    let stat = std::fs::read_to_string(format!("/proc/{pid}/stat"));
    stat.is_ok_and(|stat| !stat.contains(") Z "))
}
