//! `foretrace relay`: any number of recorders listen to a daemon through one process, and go on without it.

use std::collections::BTreeMap;
use std::io::Write as _;
use std::os::unix::net::UnixStream;
use std::time::Duration;

use foretrace_tests::{World, assert_refused, json, told, until};
use serde_json::Value;

use crate::PROGRAM;

fn size(world: &World, name: &str) -> u64 {
    std::fs::metadata(world.file(name)).map_or(0, |file| file.len())
}

/// Waits until the recorder of `name` has written this much.
fn grown(world: &World, name: &str, bytes: u64) {
    let part = format!("{name}.mcap.part");
    until(&format!("{part} grows"), || (size(world, &part) > bytes).then_some(()));
}

/// Ticks of a recording by number, without the time of the file.
fn ticks(world: &World, name: &str) -> BTreeMap<u64, String> {
    let [file, csv] = ["mcap", "csv"].map(|end| world.file(&format!("{name}.{end}")).display().to_string());
    let output = world.run_plain(&["export", &file, "--csv", &csv]);
    assert!(output.status.success(), "{}", told(&output));
    let text = std::fs::read_to_string(csv).unwrap();
    let mut lines = text.lines();
    let column = lines.next().unwrap().split(',').position(|name| name.starts_with("tick ")).unwrap();
    let rows = lines.map(|line| {
        let number = line.split(',').nth(column).unwrap().parse().unwrap();
        (number, line.split_once(',').unwrap().1.to_owned())
    });
    rows.collect()
}

#[test]
fn a_relay_serves_more_recorders_than_there_are_places_and_each_has_what_the_daemon_sent() {
    let world = World::new(PROGRAM);
    let daemon = world.daemon(0);
    let _arm = world.armed_arm(0, &[]);
    let direct = world.start(0, &["record", "direct.mcap", "--json", "direct.json"]);
    grown(&world, "direct", 1000);
    let relay = world.start(0, &["relay", "--json", "relay.json"]);
    let socket = world.instance(0).root().join("relay.sock");
    until("the relay listens", || socket.exists().then_some(()));
    // One that wants everything and never reads, and one that says what nobody says.
    let mut silent = UnixStream::connect(&socket).unwrap();
    silent.write_all(&[2, 0, 0, 0, 7, 0, 0, 0, 1, 1]).unwrap();
    let mut rude = UnixStream::connect(&socket).unwrap();
    rude.write_all(&[0xff; 64]).unwrap();
    let names = ["a", "b", "c", "d"];
    let recorders = names.map(|name| {
        let (file, report) = (format!("{name}.mcap"), format!("{name}.json"));
        world.start(0, &["record", &file, "--json", &report])
    });
    let flight = world.start(0, &["flight", "box", "--keep", "1", "--json", "flight.json"]);
    names.iter().for_each(|name| grown(&world, name, 1_000_000));
    flight.signal("-USR1");
    let is_file = |entry: &std::fs::DirEntry| entry.path().to_string_lossy().ends_with("request.mcap");
    until("a flight recording", || {
        let mut files = std::fs::read_dir(world.file("box")).ok()?.flatten();
        files.any(|entry| is_file(&entry)).then_some(())
    });
    recorders.into_iter().for_each(|recorder| drop(recorder.end()));
    direct.end();
    flight.end();
    relay.end();
    daemon.end();

    let first = ticks(&world, "direct");
    for name in names {
        let report = json(&world.file(&format!("{name}.json")));
        assert!(report["inputs"].as_u64() > Some(200) && report["states"].as_u64() >= Some(1), "{report}");
        let own = ticks(&world, name);
        let common: Vec<_> = own.iter().filter(|(number, _)| first.contains_key(number)).collect();
        assert!(common.len() > 200, "{} ticks in common", common.len());
        for (number, row) in common {
            assert_eq!(Some(row), first.get(number), "tick {number} of {name}");
        }
        let file = world.file(&format!("{name}.mcap")).display().to_string();
        let output = world.run_plain(&["replay", &file, "--json", "-"]);
        assert!(output.status.success(), "{}", told(&output));
        let replayed: Value = serde_json::from_slice(&output.stdout).unwrap();
        assert!(replayed["ticks"].as_u64() > Some(100), "{replayed}");
    }
    let tally = json(&world.file("relay.json"));
    assert_eq!(tally["admitted"], 7, "{tally}");
    assert!(tally["refused"].as_u64() >= Some(1), "the rude one is let go: {tally}");
}

#[test]
fn without_a_place_a_recorder_is_told_who_holds_them_and_that_a_relay_helps() {
    let world = World::new(PROGRAM);
    let daemon = world.daemon(0);
    let two = ["a", "b"].map(|name| {
        let recorder = world.start(0, &["record", &format!("{name}.mcap")]);
        grown(&world, name, 1000);
        recorder
    });
    let holders = two.each_ref().map(|recorder| recorder.pid().to_string());
    let words = ["all 2 subscriber slots are in use", "foretrace relay", &holders[0], &holders[1]];
    assert_refused(&world.run(0, &["record", "c.mcap"]), 1, &words);
    assert!(!world.file("c.mcap.part").exists(), "nothing was begun");
    let refused = world.run(0, &["relay"]);
    assert_refused(&refused, 1, &["subscriber slots are in use", &holders[0], "start the relay again"]);
    two.into_iter().for_each(|recorder| drop(recorder.end()));
    let relay = world.start(0, &["relay"]);
    let socket = world.instance(0).root().join("relay.sock");
    until("the relay listens", || socket.exists().then_some(()));
    let second = world.run(0, &["relay"]);
    assert_refused(&second, 1, &["is the relay of this instance already", &relay.pid().to_string()]);
    relay.end();
    daemon.end();
}

#[test]
fn a_recorder_goes_on_without_a_relay_that_was_killed_and_counts_what_it_missed() {
    let world = World::new(PROGRAM);
    let daemon = world.daemon(0);
    let relay = world.start(0, &["relay"]);
    let socket = world.instance(0).root().join("relay.sock");
    until("the relay listens", || socket.exists().then_some(()));
    let recorder = world.start(0, &["record", "run.mcap", "--json", "report.json"]);
    grown(&world, "run", 300_000);
    relay.kill();
    // It looks four times a second; the file also grows by what had waited.
    std::thread::sleep(Duration::from_secs(2));
    let then = size(&world, "run.mcap.part");
    grown(&world, "run", then + 500_000);
    let output = recorder.end();
    assert!(told(&output).contains("through the relay"), "{}", told(&output));
    assert!(told(&output).contains("the relay is gone"), "{}", told(&output));
    daemon.end();
    let report = json(&world.file("report.json"));
    assert!(report["states"].as_u64() >= Some(2), "a start for each way: {report}");
    let rows = ticks(&world, "run");
    let (Some((first, _)), Some((last, _))) = (rows.first_key_value(), rows.last_key_value()) else {
        panic!("no ticks");
    };
    let missing = last - first + 1 - rows.len() as u64;
    // A slow disk may have cost some more, which are counted with all other messages.
    let [lost, queued] = ["ticks_lost", "queue_lost"].map(|key| report[key].as_u64().unwrap());
    assert!((lost..=lost + queued).contains(&missing), "{missing} ticks are missing: {report}");
    assert!(lost > 0, "a relay that dies costs some: {report}");
}
