//! `foretrace record`: everything the pen sent is in the file, and Ctrl-C or a killed recorder loses none of
//! it.

use foretrace_tests::{World, assert_refused, told, until};

use crate::PROGRAM;

/// Rows of x, y and contact below the header.
fn rows(text: &str) -> Vec<String> {
    let data = text.lines().filter(|line| !line.starts_with(['#', 't']));
    data.map(|line| line.split_once(',').expect("a column t_s").1.to_owned()).collect()
}

#[test]
fn a_recording_has_every_sample_and_can_be_played() {
    let world = World::new(PROGRAM);
    let daemon = world.daemon(0);
    let recorder =
        world.start(0, &["record", "--pen", "pen.csv", "--writer", "anna", "--json", "report.json"]);
    until("the recorder listens", || world.file("pen.csv.part").exists().then_some(()));
    let played = world.run(0, &["play", "glyphs:Kx", "--record", "sent.csv"]);
    assert!(played.status.success(), "{}", told(&played));
    recorder.end();

    let [pen, sent] = ["pen.csv", "sent.csv"].map(|name| std::fs::read_to_string(world.file(name)).unwrap());
    assert!(pen.starts_with("# foretrace-pen version=1 unit=m rate_hz=200.000 "), "{}", &pen[..100]);
    assert!(pen.lines().next().unwrap().ends_with(" writer=anna"));
    assert_eq!(rows(&pen), rows(&sent));
    assert!(!world.file("pen.csv.part").exists());
    let report = foretrace_tests::json(&world.file("report.json"));
    assert_eq!(report["samples"], rows(&sent).len());
    assert_eq!((&report["lost"], &report["out_of_order"]), (&0.into(), &0.into()), "{report}");

    let again = world.run(0, &["play", "pen.csv", "--json", "-"]);
    assert!(again.status.success(), "{}", told(&again));
    let again: serde_json::Value = serde_json::from_slice(&again.stdout).unwrap();
    assert_eq!(again["samples"], report["samples"]);
    daemon.end();
}

#[test]
fn a_killed_recorder_leaves_what_it_had_and_nothing_is_written_over() {
    let world = World::new(PROGRAM);
    let _daemon = world.daemon(0);
    let recorder = world.start(0, &["record", "--pen", "pen.csv"]);
    until("the recorder listens", || world.file("pen.csv.part").exists().then_some(()));
    let played = world.run(0, &["play", "glyphs:Kx"]);
    assert!(played.status.success(), "{}", told(&played));
    recorder.kill();
    let part = std::fs::read_to_string(world.file("pen.csv.part")).unwrap();
    assert!(rows(&part).len() > 100, "{} rows", rows(&part).len());
    // The next one sets it aside, and says so; it records nothing itself here.
    let silent = world.run(0, &["record", "--pen", "pen.csv", "--seconds", "0.2"]);
    assert_refused(&silent, 1, &["pen.interrupted-1.csv", "0 pen samples came"]);
    assert_eq!(std::fs::read_to_string(world.file("pen.interrupted-1.csv")).unwrap(), part);
    let refused = world.run(0, &["record", "--pen", "none/pen.csv"]);
    assert_refused(&refused, 5, &["none/pen.csv.part: No such file"]);
    let silent = world.run(0, &["record", "--pen", "other.csv", "--seconds", "0.2"]);
    assert_refused(&silent, 1, &["0 pen samples came, and a recording needs 2"]);
    assert!(!world.file("other.csv").exists() && !world.file("other.csv.part").exists());
}
