//! `lab closed-loop` from the command line, on a small synthetic set.

use std::path::Path;

use foretrace_tests::{World, assert_refused, told};
use serde_json::Value;

use crate::PROGRAM;

/// Two hands of two characters each at 200 Hz.
fn set(world: &World) -> String {
    let mut folder = String::new();
    std::fs::create_dir_all(world.file("set")).unwrap();
    for file in 0..2_u32 {
        let mut text =
            String::from(".VERSION 1.0\n.COORD X Y\n.POINTS_PER_SECOND 200\n.HIERARCHY CHARACTER\n");
        for character in 0..2_u32 {
            let points: String = (0..80_u32)
                .map(|i| {
                    let angle = 0.08 * f64::from(i) * (1.0 + 0.1 * f64::from(character + file));
                    format!("{:.0} {:.0}\n", 90.0 * angle.cos() + f64::from(i), 90.0 * angle.sin())
                })
                .collect();
            text += &format!(".PEN_DOWN\n{points}.PEN_UP\n");
        }
        text += ".SEGMENT CHARACTER 0 OK \"o\"\n.SEGMENT CHARACTER 1 OK \"C\"\n";
        folder = world.write(&format!("set/w{file}.dat"), &text);
    }
    Path::new(&folder).parent().unwrap().display().to_string()
}

fn result(world: &World, arguments: &[&str]) -> Value {
    let output = world.run_plain(arguments);
    assert!(output.status.success(), "{}", told(&output));
    serde_json::from_slice(&output.stdout).unwrap()
}

#[test]
fn closed_loop_gives_a_table_json_and_pictures() {
    let world = World::alone(PROGRAM);
    let set = set(&world);
    let out = world.file("report").display().to_string();
    let names = "hold,mixture,servoj-ros,oracle";
    let arguments = ["lab", "closed-loop", "--data", &set, "--predictors", names, "--arms", "ideal,ur5"];
    let json = result(&world, &[&arguments[..], &["--limit", "1", "--out", &out, "--json", "-"]].concat());
    let rows = json["rows"].as_array().unwrap();
    let order: Vec<_> =
        rows.iter().map(|row| format!("{} {}", row["predictor"], row["arm"]).replace('"', "")).collect();
    let wanted = ["ideal", "ur5"].map(|arm| names.split(',').map(move |name| format!("{name} {arm}")));
    assert_eq!(order, wanted.into_iter().flatten().collect::<Vec<_>>());
    for row in rows {
        assert_eq!(row["sequences"], 2);
        for key in [
            "mse_m2",
            "median_mse_m2",
            "pen_down_mse_m2",
            "max_m",
            "lag_ms",
            "rms_jerk",
            "saturated_pct",
            "illegal_pct",
            "worse_than_hold_pct",
        ] {
            assert!(row[key].is_number(), "{key}: {row}");
        }
    }
    for picture in ["errors", "letters-ideal", "letters-ur5"] {
        let text = std::fs::read_to_string(world.file(&format!("report/closed-loop-{picture}.svg"))).unwrap();
        assert!(text.contains("hold") && text.contains("mixture"), "{picture}");
    }
    let text = std::fs::read_to_string(world.file("report/closed-loop-errors.svg")).unwrap();
    assert!(names.split(',').all(|name| text.contains(name)));
}

#[test]
fn each_sequence_has_scores_of_its_own_that_add_up_to_the_rows() {
    let world = World::alone(PROGRAM);
    let set = set(&world);
    let out = world.file("report").display().to_string();
    let arguments =
        ["lab", "closed-loop", "--data", &set, "--predictors", "hold,mixture", "--arms", "ideal,ur5"];
    // The folder of the file is the one that the pictures will make.
    let file = world.file("report/all.json");
    let written = world.run_plain(
        &[&arguments[..], &["--out", &out, "--json", &file.display().to_string(), "--each"]].concat(),
    );
    assert!(written.status.success(), "{}", told(&written));
    let json: Value = serde_json::from_str(&std::fs::read_to_string(file).unwrap()).unwrap();
    let each = json["sequences"].as_array().unwrap();
    assert_eq!(each.len(), 2 * 2 * 4);
    for row in json["rows"].as_array().unwrap() {
        let own: Vec<_> = each
            .iter()
            .filter(|one| one["predictor"] == row["predictor"] && one["arm"] == row["arm"])
            .collect();
        let mean = own.iter().map(|one| one["mse_m2"].as_f64().unwrap()).sum::<f64>() / 4.0;
        assert!((mean / row["mse_m2"].as_f64().unwrap() - 1.0).abs() < 1e-12, "{mean} {row}");
        let named =
            |one: &&Value| format!("{} {} {}", one["file"], one["index"], one["label"]).replace('"', "");
        let names: Vec<_> = own.iter().map(named).collect();
        assert_eq!(names, ["w0.dat 0 o", "w0.dat 1 C", "w1.dat 0 o", "w1.dat 1 C"]);
    }
    let file = world.file("no/such/folder.json").display().to_string();
    let refused = world.run_plain(&[&arguments[..], &["--json", &file]].concat());
    assert_refused(&refused, 5, &["there is no folder", "--json"]);
    assert!(world.run_plain(&[&arguments[..], &["--each"]].concat()).status.code() == Some(2));
}

#[test]
fn pareto_gives_points_json_and_a_picture() {
    let world = World::alone(PROGRAM);
    let set = set(&world);
    let out = world.file("report").display().to_string();
    let arguments = ["lab", "closed-loop", "--pareto", "--data", &set, "--arms", "ideal", "--limit", "1"];
    let json = result(&world, &[&arguments[..], &["--out", &out, "--json", "-"]].concat());
    let points = json["pareto"].as_array().unwrap();
    for method in ["hold", "mixture", "servoj-gello", "servoj-ros", "otg", "kalman"] {
        let swept: Vec<_> = points.iter().filter(|point| point["method"] == method).collect();
        assert!(swept.len() >= 6, "{method}: {swept:?}");
        assert_eq!(swept.iter().filter(|point| point["default"] == true).count(), 1, "{method}");
        for point in swept {
            assert!(point["rms_m"].is_number() && point["rms_jerk"].is_number(), "{point}");
            assert!(point["label"].is_string() && point["arm"] == "ideal", "{point}");
        }
    }
    let text = std::fs::read_to_string(world.file("report/closed-loop-pareto.svg")).unwrap();
    assert!(text.contains("otg") && text.contains("RMS error [mm]"));
}

/// The table of `lab law` says what `--law` does.
#[test]
fn a_number_of_the_law_changes_the_error_by_as_much_as_its_table_says() {
    let world = World::alone(PROGRAM);
    let set = set(&world);
    let out = world.file("report").display().to_string();
    let both = ["--data", &set, "--split", "all", "--arms", "ur5", "--json", "-"];
    let law = ["lab", "law", "--numbers", "onset_first,right"];
    let json = result(&world, &[&law[..], &both[..]].concat());
    let cells: Vec<_> = json["cells"].as_array().unwrap().iter().map(|cell| &cell["effect"]).collect();
    let tried: Vec<_> = cells.iter().map(|cell| (cell["number"].as_str().unwrap(), &cell["value"])).collect();
    let values = [0.15, 0.6, 0.05, 0.2].map(Value::from);
    let names = ["onset_first", "onset_first", "right", "right"];
    assert_eq!(tried, names.into_iter().zip(&values).collect::<Vec<_>>());

    let error = |more: &[&str]| {
        let run = ["lab", "closed-loop", "--predictors", "mixture", "--out", &out];
        result(&world, &[&run[..], &both[..], more].concat())["rows"][0]["mse_m2"].as_f64().unwrap()
    };
    let ratio = error(&["--law", "onset_first=0.15"]) / error(&[]);
    let told = cells[0]["error_ratio"].as_f64().unwrap();
    assert!((ratio / told - 1.0).abs() < 1e-9 && (ratio - 1.0).abs() > 1e-3, "{ratio} {told}");
}

/// A program that predicts nothing.
const SILENT: &str = "external:while read -r line; do echo '{}'; done";

#[test]
fn a_predictor_in_another_program_takes_part_and_one_that_fails_ends_the_run() {
    let world = World::alone(PROGRAM);
    let set = set(&world);
    let out = world.file("report").display().to_string();
    let names = format!("mixture,{SILENT}");
    let base = ["lab", "closed-loop", "--data", &set, "--arms", "ur5", "--limit", "1", "--out", &out];
    let run = |more: &[&str]| world.run_plain(&[&base[..], more].concat());
    let file = world.file("all.json");
    let output = run(&["--predictors", &names, "--each", "--json", &file.display().to_string()]);
    assert!(output.status.success() && told(&output).contains(SILENT), "{}", told(&output));
    let json: Value = serde_json::from_str(&std::fs::read_to_string(&file).unwrap()).unwrap();
    let of = |rows: &Value, name: &str| -> Vec<String> {
        let rows = rows.as_array().unwrap().iter().filter(|row| row["predictor"] == name);
        rows.map(|row| row.to_string().replace(&Value::from(name).to_string(), "")).collect()
    };
    for (key, count) in [("rows", 1), ("sequences", 2)] {
        let silent = of(&json[key], SILENT);
        assert_eq!(silent.len(), count);
        assert_eq!(silent, of(&json[key], "mixture"), "{key}");
    }
    let picture = std::fs::read_to_string(world.file("report/closed-loop-errors.svg")).unwrap();
    assert!(picture.contains("external:while"));
    let parts = [1, 2].map(|index| {
        let part = world.file(&format!("part-{index}.json")).display().to_string();
        let shard = format!("{index}/2");
        // No --out beside --shard.
        let cut =
            [&base[..8], &["--predictors", &names, "--each", "--shard", &shard, "--json", &part]].concat();
        let output = world.run_plain(&cut);
        assert!(output.status.success(), "{}", told(&output));
        part
    });
    let merged = result(&world, &["lab", "merge", &parts[0], &parts[1], "--out", &out, "--json", "-"]);
    assert_eq!(merged, json);
    assert_refused(
        &run(&["--predictors", "external:sleep 0.1; exit 4"]),
        1,
        &["w0.dat", "external:sleep 0.1; exit 4", "greeting", "exit status: 4"],
    );
    assert_refused(&run(&["--predictors", SILENT, "--stop-at", "1"]), 2, &["--stop-at", SILENT, "mixture"]);
}

#[test]
fn names_that_nobody_has_are_answered_with_those_that_there_are() {
    let world = World::alone(PROGRAM);
    let set = set(&world);
    let base = ["lab", "closed-loop", "--data", &set];
    let cases = [
        (["--predictors", "hold,ruckig"], 2, "ruckig", "servoj-gello servoj-ros otg kalman oracle"),
        (["--predictors", "external:"], 2, "external:", "external:COMMAND"),
        (["--arms", "ur10"], 2, "ur10", "ideal delay30 ur5 slow"),
        // The parts come from the set.
        (["--split", "tset"], 5, "tset", "all"),
    ];
    for (wrong, code, value, legal) in cases {
        let output = world.run_plain(&[&base[..], &wrong[..]].concat());
        assert_refused(&output, code, &[value, legal]);
    }
}
