//! Training from the command line: killed anywhere, it leaves no broken file and continues to the same bytes.

use std::fmt::Write as _;
use std::path::PathBuf;
use std::process::Command;

use foretrace_tests::{World, assert_refused, skipped, told, until};

use crate::PROGRAM;

/// A set of four writers who draw spirals, in files of this world.
fn spirals(world: &World) -> String {
    let folder = world.file("spirals");
    std::fs::create_dir(&folder).unwrap();
    let mut table = String::from("set\twriter\tfile\n");
    for writer in 0..4 {
        for file in 0..3 {
            let mut text = String::from("t_s,x_m,y_m,contact\n");
            for i in 0..200 {
                let (t, turn) = (f64::from(i) * 0.005, 9.0 + f64::from(writer) + 0.3 * f64::from(file));
                let radius = 0.01 * (1.0 + (3.0 * t).sin());
                let (x, y) = (radius * (turn * t).cos() + 0.02 * t, radius * (turn * t).sin());
                writeln!(text, "{t},{x},{y},1").unwrap();
            }
            let name = format!("w{writer}-{file}.csv");
            std::fs::write(folder.join(&name), text).unwrap();
            writeln!(table, "train\tw{writer}\t{name}").unwrap();
        }
    }
    std::fs::write(folder.join("split.tsv"), table).unwrap();
    folder.display().to_string()
}

fn options<'a>(data: &'a str, out: &'a str, more: &[&'a str]) -> Vec<&'a str> {
    let common = ["lab", "train", "--model", "lstm10", "--recipe", "robust", "--data", data, "--out", out];
    [&common, more].concat()
}

#[test]
fn a_killed_training_leaves_no_model_and_continues_to_the_same_bytes() {
    let world = World::alone(PROGRAM);
    let data = spirals(&world);
    let path = |name: &str| world.file(name).display().to_string();
    let more = ["--epochs", "60", "--augment", "scale=0.7..1.4,time=0.9..1.1", "--seed", "5"];
    let (whole, killed) = (path("whole.safetensors"), path("killed.safetensors"));
    let output = world.run_plain(&[&options(&data, &whole, &more)[..], &["--threads", "1"]].concat());
    assert!(output.status.success(), "{}", told(&output));

    let words: Vec<String> = options(&data, &killed, &more).into_iter().map(str::to_owned).collect();
    let process = world.start_plain(&words);
    let checkpoint = world.file("killed.safetensors.checkpoint");
    until("a first checkpoint", || checkpoint.exists().then_some(()));
    process.kill();
    // The kill may have come after the end on a fast machine; then there is nothing to continue.
    if checkpoint.exists() {
        assert!(!world.file("killed.safetensors").exists());
        let process = world.start_plain(&[&words[..], &["--resume".to_owned()]].concat());
        std::thread::sleep(std::time::Duration::from_millis(50));
        process.signal("-INT");
        let output = process.output();
        assert!(matches!(output.status.code(), Some(0 | 130)), "{}", told(&output));
        if checkpoint.exists() {
            let other = world
                .run_plain(&[&options(&data, &killed, &more)[..], &["--resume", "--batch", "7"]].concat());
            assert_refused(&other, 5, &["killed.safetensors.checkpoint", "batch: 32", "batch: 7"]);
            let output = world.run_plain(&[&options(&data, &killed, &more)[..], &["--resume"]].concat());
            assert!(output.status.success(), "{}", told(&output));
        }
    }
    let read = |name: &str| std::fs::read(world.file(name)).unwrap();
    assert!(read("whole.safetensors") == read("killed.safetensors"), "the models differ");
    assert_eq!(read("whole.svg"), read("killed.svg"));
    assert!(!checkpoint.exists());
    let again = world.run_plain(&[&options(&data, &killed, &more)[..], &["--resume"]].concat());
    assert_refused(&again, 5, &["killed.safetensors is finished", "without --resume"]);
}

#[test]
fn a_training_whose_picture_cannot_be_written_says_that_the_model_is_saved() {
    let world = World::alone(PROGRAM);
    let data = spirals(&world);
    let out = world.file("m.safetensors");
    // A folder in place of the picture, as a stand-in for a full disk.
    std::fs::create_dir(world.file("m.svg")).unwrap();
    let words = |more: &[&str]| {
        world.run_plain(&options(&data, out.to_str().unwrap(), &[&["--epochs", "2"], more].concat()))
    };
    let output = words(&[]);
    assert_refused(&output, 1, &["m.svg", "the model is saved in", "m.safetensors", "--resume"]);
    assert!(output.stdout.is_empty(), "{}", told(&output));
    let saved = std::fs::read(&out).unwrap();
    std::fs::remove_dir(world.file("m.svg")).unwrap();
    let output = words(&["--resume"]);
    assert!(output.status.success() && world.file("m.svg").is_file(), "{}", told(&output));
    assert!(saved == std::fs::read(&out).unwrap(), "the model has changed");
}

#[test]
fn wrong_options_and_data_are_answered_with_what_is_legal() {
    let world = World::alone(PROGRAM);
    let data = spirals(&world);
    let out = world.file("m.safetensors").display().to_string();
    let refused = |more: &[&str], code: i32, words: &[&str]| {
        assert_refused(&world.run_plain(&options(&data, &out, more)), code, words);
    };
    refused(&["--augment", "warp=2"], 2, &["warp=2", "scale=0.5..2"]);
    refused(&["--clip", "-1"], 2, &["-1", "above 0", "none"]);
    refused(&["--rate", "7"], 2, &["1e-8 to 1"]);
    refused(&["--step-ms", "2"], 5, &["2 ms is finer", "200 Hz", "5 ms"]);
    refused(&["--padding", "counted", "--augment", "scale=1..2"], 2, &["--padding masked"]);
    refused(&["--split", "tes"], 5, &["tes", "train"]);
    let dybm = world.run_plain(&["lab", "train", "--model", "dybm", "--data", &data, "--out", &out]);
    assert_refused(&dybm, 2, &["lstm10, lstm32, lstm64 or foresight", "lab table1"]);
    let nowhere = world.file("no/m.safetensors").display().to_string();
    assert_refused(
        &world.run_plain(&options(&data, &nowhere, &[])),
        5,
        &["no/m.safetensors", "existing folder"],
    );
    assert!(!world.file("m.safetensors").exists());
}

/// Only agreement is tested: the program under test need not be a release build.
#[test]
fn pytorch_computes_the_same_training() {
    let python = std::env::var("FORETRACE_PYTHON").unwrap_or_else(|_| "python3".to_owned());
    let script = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("pytorch/train_side_by_side.py");
    let output = Command::new(&python).arg(script).args(["--rounds", "1", "--foretrace", PROGRAM]).output();
    let code = output.as_ref().ok().and_then(|output| output.status.code());
    if code.is_none_or(|code| code == 77) {
        skipped(&format!("no PyTorch in {python} (set FORETRACE_PYTHON)"));
        return;
    }
    let output = output.unwrap();
    assert!(output.status.success(), "{}", told(&output));
}
