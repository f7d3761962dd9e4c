//! `foretrace bench --against`: two programs in turn, and every way in which the other one may not take part.

use std::os::unix::fs::PermissionsExt;

use foretrace_tests::{World, told};
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
    std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o755)).unwrap();
    path
}

fn report(rows: &str) -> String {
    format!("echo '{{\"horizon\": 20, \"samples\": 50, \"optimised_build\": true, {rows}}}'")
}

fn comparison(world: &World, other: &str, more: &[&str]) -> Value {
    let words = [&["bench", "--against", other, "--samples", "50", "--json", "-"], more].concat();
    // Its own limit of time is the bound: the world's is too short for many benches on a busy machine.
    let mut program = std::process::Command::new(PROGRAM);
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
    let found = comparison(&world, PROGRAM, &["--rounds", "2", "--part", "ik,lag", "--out", "cells"]);
    assert_eq!(found["this"]["version"], found["other"]["version"]);
    assert_eq!((&found["rounds"], &found["samples"]), (&json!(2), &json!(50)));
    // One process per part, round and side; who begins alternates by round.
    let cells = &found["cells"];
    let [a, b] = [["this", "other", "this", "other"], ["other", "this", "other", "this"]];
    assert_eq!(column(cells, "side"), [a, b].concat());
    assert_eq!(column(cells, "part"), ["ik", "ik", "lag", "lag"].repeat(2));
    assert_eq!(column(cells, "round"), ["1", "2"].map(|round| [round; 4]).concat());
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
    assert_eq!(std::fs::read_dir(world.file("cells")).unwrap().count(), 8 + 1);

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
    let found = comparison(&world, &older, &["--rounds", "2", "--out", "cells"]);
    assert_eq!(found["other"]["version"], "0.0.9");
    assert_eq!(column(&found["cells"], "side"), ["this", "other", "other", "this"]);
    assert_eq!(column(&found["cells"], "part"), ["all"; 4]);
    assert_eq!(column(&found["rows"], "row"), ["lag_us"]);
    assert_eq!(found["rows"][0]["other_us"], 1e6);
    assert!(found["rows"][0]["ratio"].as_f64().unwrap() > 1.0, "{found}");
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
        ("exec sleep 600", 1, "no end within 10.0 s"),
        (
            r#"echo '{"horizon": 10, "samples": 50, "optimised_build": true, "lag_us": {"p50": 1}}'"#,
            5,
            "different problems",
        ),
        (&report(r#""new_us": {"p50": 1}"#), 5, "no row in common"),
    ];
    for (number, (answer, code, words)) in cases.into_iter().enumerate() {
        let other = pretender(&world, &format!("other-{number}"), true, answer);
        let cells = format!("cells-{number}");
        let limit = if words.contains("no end") { "10" } else { "120" };
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
        if !["different", "common"].iter().any(|whole| words.contains(whole)) {
            assert!(told(&out).contains("round 1, part lag"), "{answer}: {}", told(&out));
        }
        let left = std::fs::read_dir(world.file(&cells)).into_iter().flatten().flatten();
        let names: Vec<String> = left.map(|file| file.file_name().to_string_lossy().into_owned()).collect();
        assert!(
            names.iter().all(|name| name.ends_with("this.json") || name.ends_with("other.json")),
            "{names:?}"
        );
    }
    let missing = world.file("nobody").display().to_string();
    let plain = world.write("plain", "not a program\n");
    let stranger = world.write("stranger", "#!/bin/sh\necho hello\n");
    std::fs::set_permissions(&stranger, std::fs::Permissions::from_mode(0o755)).unwrap();
    let mute = pretender(&world, "mute", true, &good);
    std::fs::write(&mute, "#!/bin/sh\nexit 1\n").unwrap();
    for (other, words) in [
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
