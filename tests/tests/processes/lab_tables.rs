//! `lab table1`, `lab evaluate` and `lab leadtime` from the command line, on a small synthetic set.

use std::path::Path;

use foretrace_tests::{World, assert_refused, json, told};
use serde_json::Value;

use crate::PROGRAM;

/// Five files of four characters each at 200 Hz, 50 units per mm; the first three to train on.
fn set(world: &World) -> String {
    let mut table = String::from("set\tfile\n");
    for file in 0..5_u32 {
        let mut text = String::from(
            ".VERSION 1.0\n.COORD X Y\n.POINTS_PER_SECOND 200\n.X_POINTS_PER_MM 50\n.Y_POINTS_PER_MM 50\n\
             .HIERARCHY CHARACTER\n",
        );
        for character in 0..4_u32 {
            let points: String = (0..60_u32)
                .map(|i| {
                    let angle = 0.1 * f64::from(i) * (1.0 + 0.1 * f64::from(character + file));
                    format!("{:.0} {:.0}\n", 90.0 * angle.cos() + 2.0 * f64::from(i), 90.0 * angle.sin())
                })
                .collect();
            text += &format!(".PEN_DOWN\n{points}.PEN_UP\n");
        }
        for (character, label) in ["o", "C", "o", "e"].iter().enumerate() {
            text += &format!(".SEGMENT CHARACTER {character} OK \"{label}\"\n");
        }
        let name = format!("w{file}.dat");
        world.write(&name, &text);
        table += &format!("{}\t{name}\n", if file < 3 { "train" } else { "test" });
    }
    let table = world.write("split.tsv", &table);
    Path::new(&table).parent().unwrap().display().to_string()
}

fn done(world: &World, arguments: &[&str]) -> std::process::Output {
    let output = world.run_plain(arguments);
    assert!(output.status.success(), "{}", told(&output));
    output
}

#[test]
fn table_1_gives_text_json_and_pictures() {
    let world = World::alone(PROGRAM);
    let set = set(&world);
    let out = world.file("report").display().to_string();
    let models = "constant-velocity,dybm,lstm10-reference,mixture-cold";
    let output = done(
        &world,
        &["lab", "table1", "--data", &set, "--models", models, "--by-label", "--out", &out, "--json", "-"],
    );
    let result: Value = serde_json::from_slice(&output.stdout).unwrap();
    let rows = result["rows"].as_array().unwrap();
    assert_eq!(rows.iter().map(|r| r["model"].as_str().unwrap()).collect::<Vec<_>>().join(","), models);
    for row in rows {
        let whole = ["mse", "within", "median", "ps_b", "ps_lstm", "rms_mm_10", "us_per_step"];
        assert!(whole.iter().all(|key| row[key].is_number()), "{row}");
        assert!(row["pos_mse"]["10"].is_number() && row["vel_mse"]["1"] == row["mse"], "{row}");
    }
    assert_eq!((rows[0]["ps_b"].as_f64(), rows[2]["ps_lstm"].as_f64()), (Some(0.0), Some(0.0)));
    assert!(rows[1]["train_s_per_epoch"].is_number() && rows[0]["train_s_per_epoch"].is_null());
    let labels = result["by_label"]["labels"].as_array().unwrap();
    assert_eq!(labels.iter().map(|l| l["sequences"].as_u64().unwrap()).sum::<u64>(), 8);
    let words = String::from_utf8_lossy(&output.stderr);
    assert!(words.contains("Differences from the paper") && words.contains("By symbol"), "{words}");
    let picture = std::fs::read_to_string(world.file("report/table1.svg")).unwrap();
    assert!(picture.contains("mixture-cold"));
}

#[test]
fn networks_are_trained_anew_where_asked_for() {
    let world = World::alone(PROGRAM);
    let set = set(&world);
    let out = world.file("report").display().to_string();
    let file = world.file("rows.json");
    let run =
        ["lab", "table1", "--data", &set, "--models", "hold,lstm10", "--train", "--out", &out, "--json"];
    done(&world, &[&run[..], &[file.to_str().unwrap()]].concat());
    let rows = json(&file)["rows"].clone();
    assert_eq!(rows[1]["model"], "lstm10");
    assert!(rows[1]["train_s_per_epoch"].is_number());
    assert!(rows[1]["mse"].as_f64() < rows[0]["mse"].as_f64(), "{rows}");
}

#[test]
fn any_part_can_be_evaluated_also_cold() {
    let world = World::alone(PROGRAM);
    let set = set(&world);
    let rows = |arguments: &[&str]| {
        let command = [&["lab", "evaluate", "--data", &set, "--json", "-"], arguments].concat();
        let result: Value = serde_json::from_slice(&done(&world, &command).stdout).unwrap();
        (result["sequences"].as_u64().unwrap(), result)
    };
    let (all, result) = rows(&["--models", "dybm-offline"]);
    assert_eq!(all, 20);
    assert!(result["notes"]["dybm-offline"].as_str().unwrap().contains("cold"), "{result}");
    let (train, result) = rows(&["--split", "train", "--cold"]);
    assert_eq!(train, 12);
    let models: Vec<&str> =
        result["rows"].as_array().unwrap().iter().filter_map(|r| r["model"].as_str()).collect();
    assert!(models.contains(&"mixture-cold") && !models.iter().any(|m| m.starts_with("lstm")), "{models:?}");
}

#[test]
fn others_take_part_with_predictions_for_exported_targets() {
    let world = World::alone(PROGRAM);
    let set = set(&world);
    let name = Path::new(&set).file_name().unwrap().to_str().unwrap().to_owned();
    let exports = world.file("targets");
    done(&world, &["lab", "leadtime", "--data", &set, "--export-targets", exports.to_str().unwrap()]);
    let read = |what: &str| std::fs::read_to_string(exports.join(format!("{name}-{what}.csv"))).unwrap();
    // The pen stays where it is: what `hold` predicts.
    let points: Vec<Vec<String>> =
        read("points").lines().skip(1).map(|l| l.split(',').map(str::to_owned).collect()).collect();
    let mut answers = String::from("file,segment,t,lead,x,y\n");
    for target in read("targets").lines().skip(1) {
        let cells: Vec<&str> = target.split(',').collect();
        let point = points.iter().find(|p| p[..3] == cells[..3]).unwrap();
        answers += &format!("{target},{},{}\n", point[4], point[5]);
    }
    let file = world.write("answers.csv", &answers);
    let out = world.file("report").display().to_string();
    let models = format!("hold,file:{file},constant-velocity");
    let output =
        done(&world, &["lab", "leadtime", "--data", &set, "--models", &models, "--out", &out, "--json", "-"]);
    let result: Value = serde_json::from_slice(&output.stdout).unwrap();
    let lanes = result["sets"][0]["models"].as_array().unwrap();
    assert_eq!((lanes.len(), result["sets"][0]["unit"].as_str()), (3, Some("mm")));
    for (hold, mine) in
        lanes[0]["leads"].as_array().unwrap().iter().zip(lanes[1]["leads"].as_array().unwrap())
    {
        let (a, b) = (hold["rms"].as_f64().unwrap(), mine["rms"].as_f64().unwrap());
        assert!((a - b).abs() < 1e-9 && hold["targets"] == mine["targets"], "{hold} {mine}");
    }
    assert_eq!(result["standings"].as_array().unwrap().len(), 3);
    assert_eq!(result.get("sequences"), None);
    let each =
        ["lab", "leadtime", "--data", &set, "--models", &models, "--out", &out, "--json", "-", "--each"];
    let told: Value = serde_json::from_slice(&done(&world, &each).stdout).unwrap();
    assert_eq!(told["sets"], result["sets"]);
    let scored = |model: &Value| {
        let sequences = told["sequences"].as_array().unwrap();
        let of_model = sequences.iter().filter(|sequence| sequence["model"] == *model);
        of_model.map(|sequence| sequence["targets"][4].as_u64().unwrap()).sum::<u64>()
    };
    assert!(lanes.iter().all(|lane| lane["leads"][4]["targets"] == scored(&lane["model"])), "{told}");
    let cut = answers.lines().take(5).collect::<Vec<_>>().join("\n");
    let short = format!("file:{}", world.write("short.csv", &cut));
    let output = world.run_plain(&["lab", "leadtime", "--data", &set, "--models", &short, "--out", &out]);
    assert_refused(&output, 5, &["short.csv", "no prediction", "--export-targets"]);
    let wrong = format!("file:{}", world.write("wrong.csv", &format!("{cut}\nw9.dat,0,4,10,1,1\n")));
    let output = world.run_plain(&["lab", "leadtime", "--data", &set, "--models", &wrong, "--out", &out]);
    assert_refused(&output, 5, &["wrong.csv:6", "w9.dat"]);
}

#[test]
fn a_predictor_in_another_program_has_rows_and_one_that_fails_ends_the_run() {
    let world = World::alone(PROGRAM);
    let set = set(&world);
    let out = world.file("report").display().to_string();
    let silent = "external:while read -r line; do echo '{}'; done";
    let models = format!("hold,{silent}");
    for command in ["table1", "evaluate", "leadtime"] {
        let place: &[&str] = if command == "evaluate" { &[] } else { &["--out", &out] };
        let run = |models: &str| {
            let base = ["lab", command, "--data", &set, "--models", models, "--json", "-"];
            world.run_plain(&[&base[..], place].concat())
        };
        let output = run(&models);
        assert!(output.status.success(), "{}", told(&output));
        let result: Value = serde_json::from_slice(&output.stdout).unwrap();
        let (rows, figures) = match command {
            "leadtime" => (&result["sets"][0]["models"], "leads"),
            _ => (&result["rows"], "pos_mse"),
        };
        assert_eq!((&rows[1]["model"], &rows[1][figures]), (&Value::from(silent), &rows[0][figures]));
        let failing = "external:read -r line; echo '{}'; read -r line; echo thinking; cat";
        assert_refused(&run(failing), 1, &[failing, "character 0", "step 0", "thinking", "\"positions\""]);
        assert_refused(&run("external:"), 2, &["external:COMMAND"]);
    }
}

#[test]
fn wrong_names_sets_and_parts_are_refused_with_the_legal_ones() {
    let world = World::alone(PROGRAM);
    let set = set(&world);
    for command in ["table1", "evaluate", "leadtime"] {
        let refused = |arguments: &[&str], code: i32, words: &[&str]| {
            assert_refused(&world.run_plain(&[&["lab", command], arguments].concat()), code, words);
        };
        refused(&["--data", "nowhere"], 5, &["nowhere"]);
        refused(&["--data", &set, "--models", "lstm11"], 2, &["lstm11", "dybm-esn"]);
        refused(&["--data", &set, "--models", "hold,hold"], 2, &["hold", "twice"]);
        refused(&["--data", &set, "--models", "lstm:nowhere.safetensors"], 5, &["nowhere.safetensors"]);
    }
    // Three samples are no stroke to judge by.
    let short = world.file("short");
    std::fs::create_dir(&short).unwrap();
    std::fs::write(short.join("a.csv"), "t_s,x_m,y_m\n0,0,0\n0.005,0.001,0\n0.01,0.002,0\n").unwrap();
    let output = world.run_plain(&["lab", "leadtime", "--data", short.to_str().unwrap(), "--models", "hold"]);
    assert_refused(&output, 5, &["short: no stroke is long enough", "longer recordings"]);
    let output = world.run_plain(&["lab", "evaluate", "--data", &set, "--split", "tests"]);
    assert_refused(&output, 5, &["tests", "train, test, all"]);
    let output =
        world.run_plain(&["lab", "evaluate", "--data", &set, "--cold", "--models", "lstm10-reference"]);
    assert_refused(&output, 2, &["--cold", "lstm10-reference", "mixture-cold"]);
}

#[test]
fn one_bad_file_is_named_and_left_out_and_ends_only_a_strict_command() {
    let world = World::alone(PROGRAM);
    let set = set(&world);
    world.write("w4.dat", ".PEN_DOWN\n1 2\nthree 4\n");
    for command in ["table1", "evaluate"] {
        let arguments = ["lab", command, "--data", &set, "--models", "hold"];
        let lenient = done(&world, &arguments);
        assert!(told(&lenient).contains("w4.dat"), "{}", told(&lenient));
        let strict = world.run_plain(&[&arguments[..], &["--strict"]].concat());
        assert_refused(&strict, 5, &["w4.dat", "--strict"]);
    }
}
