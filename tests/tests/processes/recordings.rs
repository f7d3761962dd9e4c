//! `foretrace record FILE.mcap` and `foretrace replay`: what a running instance did is in the file, replays
//! bit for bit, and survives a killed recorder.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use foretrace_client::Foretrace;
use foretrace_record::info::{Info, info};
use foretrace_record::read::{Content, RecordingEntry, RecordingReader};
use foretrace_shm::{Mode, input_flags, monotonic_now_ns};
use foretrace_tests::{World, assert_refused, json, told, until};
use serde_json::Value;

use crate::PROGRAM;

/// Opcode of a chunk (MCAP specification).
const CHUNK: u8 = 6;

/// What is in the file once it has a state to replay from and `inputs` messages about ticks.
fn recorded(world: &World, name: &str, inputs: u64) -> Info {
    until(&format!("{name} holds a state and {inputs} inputs"), || {
        let told = info(&world.file(name)).ok()?;
        let enough = !told.states.is_empty() && told.topics.get("/raw/input") >= Some(&inputs);
        enough.then_some(told)
    })
}

/// `foretrace replay FILE` must find no difference; returns its report.
fn replayed(world: &World, file: &str) -> Value {
    let output = world.run_plain(&["replay", file, "--json", "-"]);
    assert!(output.status.success(), "{}", told(&output));
    let report: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!((&report["difference"], &report["different_ticks"]), (&Value::Null, &0.into()), "{report}");
    assert_eq!(report["same_build"], true, "{report}");
    report
}

#[test]
fn a_run_is_recorded_and_every_command_of_it_comes_again_bit_for_bit() {
    let world = World::new(PROGRAM);
    let daemon = world.daemon(0);
    let arm = world.armed_arm(0, &[]);
    let recorder = world.start(0, &["record", "run.mcap", "--json", "report.json"]);
    recorded(&world, "run.mcap.part", 1);
    let played = world.run(0, &["play", "glyphs:Kx"]);
    assert!(played.status.success(), "{}", told(&played));
    let stopped = world.run(0, &["request", "stop"]);
    assert!(stopped.status.success(), "{}", told(&stopped));
    recorder.end();
    arm.end();
    daemon.end();

    let report = json(&world.file("report.json"));
    assert!(report["inputs"].as_u64() > Some(500) && report["states"].as_u64() >= Some(1), "{report}");
    let file = world.file("run.mcap").display().to_string();
    let output = world.run_plain(&["record", "--info", &file, "--json", "-"]);
    let info: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(info["damage"], Value::Null);
    assert_eq!(info["topics"]["/raw/tick"], report["ticks"], "{info}");
    assert_eq!(info["topics"]["/tick"], report["ticks"], "{info}");
    assert!(info["topics"]["/log"].as_u64() >= Some(2), "it followed and was stopped: {info}");
    assert_eq!(info["end"]["queue_lost"], "0", "{info}");
    let (mut previewed, mut reader) = (0, RecordingReader::open(&world.file("run.mcap")).unwrap());
    while let Some(entry) = reader.next_entry().unwrap() {
        let RecordingEntry::Message(message) = entry else { continue };
        let Content::Tick(record) = reader.content(&message).unwrap() else { continue };
        let path: Vec<[f32; 2]> = record.path().collect();
        let off = |[x, y]: [f32; 2], of: [f64; 3]| (f64::from(x) - of[0]).hypot(f64::from(y) - of[1]);
        assert!(path.is_empty() || path.len() == 10 && off(path[0], record.reference_m) < 0.01, "{record:?}");
        assert!(path.iter().all(|at| off(*at, record.pen_m) < 0.2), "{path:?} at {:?}", record.pen_m);
        let follows = [Mode::Following, Mode::Holding].map(u32::from).contains(&record.mode);
        assert!(path.is_empty() || follows, "mode {}", record.mode);
        previewed += usize::from(!path.is_empty());
    }
    assert!(previewed > 200, "{previewed} previewed paths");
    let again = replayed(&world, &file);
    assert_eq!(again["start"], "state");
    // On a busy machine the recorder may lose some: then the replay ends there, and says so.
    let lost = report["inputs_lost"].as_u64().unwrap() + report["queue_lost"].as_u64().unwrap();
    assert!(again["ticks"].as_u64() > Some(300), "{again}");
    assert!(lost > 0 || again["end"] == "of_recording", "{again} {report}");

    let output = world.run_plain(&["explain", &file]);
    assert!(output.status.success() && told(&output).contains("tick "), "{}", told(&output));
    let page = world.file("run.html").display().to_string();
    let paged = || world.run_plain(&["explain", &file, "--html", &page]);
    assert!(paged().status.success());
    let read = foretrace_tests::page::Page::read(&world.file("run.html"));
    assert!(read.moved.is_some_and(|moved| moved["ghost"].is_object()), "a replay with the recorded ghost");
    assert_eq!(read.pictures.len(), 3, "lag, error, deadlines");
    let before = std::fs::read(&page).unwrap();
    assert_refused(&paged(), 5, &["run.html exists already"]);
    assert_eq!(std::fs::read(&page).unwrap(), before);
    let tick = (again["first_tick"].as_u64().unwrap() + 100).to_string();
    let output = world.run_plain(&["explain", &file, "--tick", &tick]);
    assert!(told(&output).contains("Trust was"), "{}", told(&output));
    let csv = world.file("run.csv").display().to_string();
    let fields = ["--every", "10", "--fields", "tick,q,path_m"];
    let output = world.run_plain(&[&["export", &file, "--csv", &csv], &fields[..]].concat());
    assert!(output.status.success(), "{}", told(&output));
    let text = std::fs::read_to_string(&csv).unwrap();
    let columns = "time [ns since 1970],tick [1],q[0] [rad],q[1] [rad],q[2] [rad],q[3] [rad],q[4] [rad],\
                   q[5] [rad],path_m[0] [m],path_m[1] [m],";
    assert!(text.starts_with(columns) && text.lines().next().unwrap().ends_with(",path_m[19] [m]"), "{text}");
    let rows = report["ticks"].as_u64().unwrap().div_ceil(10);
    assert_eq!(text.lines().count() as u64, 1 + rows);
    let pen = world.file("pen.csv").display().to_string();
    let output = world.run_plain(&["export", &file, "--pen", &pen]);
    assert!(output.status.success(), "{}", told(&output));
    assert!(std::fs::read_to_string(&pen).unwrap().lines().count() > 100);

    let sent = world.file("sent.csv").display().to_string();
    let second = world.daemon(1);
    let played = world.run(1, &["play", &file, "--record", &sent]);
    assert!(played.status.success(), "{}", told(&played));
    let rows = |name: &str| {
        let text = std::fs::read_to_string(world.file(name)).unwrap();
        let rows = text.lines().filter(|line| line.starts_with(|c: char| c.is_ascii_digit()));
        rows.map(|line| line.split_once(',').unwrap().1.to_owned()).collect::<Vec<_>>()
    };
    assert_eq!(rows("sent.csv"), rows("pen.csv"), "its pen is played as it was");
    second.end();

    // One bit of one joint.
    let mut bytes = std::fs::read(world.file("run.mcap")).unwrap();
    let at = middle_of_a_chunk(&bytes);
    bytes[at] ^= 1;
    std::fs::write(world.file("flipped.mcap"), bytes).unwrap();
    let flipped = world.file("flipped.mcap").display().to_string();
    let output = world.run_plain(&["record", "--info", &flipped]);
    assert!(told(&output).contains("it ends early"), "{}", told(&output));
    // Nobody takes the part before it for the whole.
    let (csv, pen) = (world.file("half.csv"), world.file("half-pen.csv"));
    let (csv, pen) = (csv.display().to_string(), pen.display().to_string());
    for words in
        [&["replay", &flipped] as &[&str], &["explain", &flipped], &["export", &flipped, "--csv", &csv]]
    {
        assert_refused(&world.run_plain(words), 5, &["flipped.mcap ends early", "record --repair"]);
    }
    // Half a recording may be too short for these.
    assert_refused(&world.run_plain(&["export", &flipped, "--pen", &pen]), 5, &["flipped.mcap"]);
    assert_refused(&world.run_plain(&["replay", &flipped, "--what-if", "trust=0"]), 5, &["record"]);
}

/// A byte that a chunk's checksum covers: that of the chunk around the middle of a recording. Between chunks
/// stand the indices that only readers of others use.
fn middle_of_a_chunk(bytes: &[u8]) -> usize {
    // Magic, then records: opcode, length, content (MCAP specification).
    let mut at = 8;
    loop {
        let length = u64::from_le_bytes(bytes[at + 1..at + 9].try_into().unwrap()) as usize;
        let end = at + 9 + length;
        if bytes[at] == CHUNK && end > bytes.len() / 2 {
            return at + 9 + length / 2;
        }
        at = end;
    }
}

#[test]
fn a_recording_that_ends_while_weights_are_on_their_way_is_run_again_to_its_last_tick() {
    // This process listens beside the recorder, which only the daemon's user may.
    let world = World::with_rights_kept(PROGRAM);
    let daemon = world.daemon(0);
    let arm = world.armed_arm(0, &[]);
    let foretrace = Foretrace::attach_within(&world.instance(0), Duration::from_secs(5)).unwrap();
    let mut inputs = foretrace.inputs().unwrap();
    let hand = world.start(0, &["play", "glyphs:Kxabcdefghijklmnop"]);
    let mut whole = 0;
    for number in 0..4 {
        let name = format!("{number}.mcap");
        let recorder = world.start(0, &["record", &name, "--json", &format!("{number}.json")]);
        recorded(&world, &format!("{name}.part"), 50);
        inputs.drain(|_| {});
        let begin = Instant::now();
        let mut offered = false;
        while !offered {
            inputs.drain(|input| offered |= input.flags & input_flags::WEIGHTS != 0);
            inputs.snapshots(drop);
            assert!(begin.elapsed() < Duration::from_secs(60), "the hand writes, and nothing is learned");
            std::thread::sleep(Duration::from_micros(200));
        }
        recorder.end();
        let again = replayed(&world, &world.file(&name).display().to_string());
        let report = json(&world.file(&format!("{number}.json")));
        let lost = report["inputs_lost"].as_u64().unwrap() + report["queue_lost"].as_u64().unwrap();
        assert!(lost > 0 || again["end"] == "of_recording", "{again} {report}");
        whole += u32::from(lost == 0);
    }
    assert!(whole > 0, "a loss in each recording: nothing was looked at");
    drop((inputs, foretrace));
    hand.end();
    arm.end();
    daemon.end();
}

#[test]
fn a_flight_recorder_beside_a_recorder_goes_on_for_longer_than_it_keeps() {
    let world = World::new(PROGRAM);
    let daemon = world.daemon(0);
    let recorder = world.start(0, &["record", "run.mcap", "--json", "report.json"]);
    recorded(&world, "run.mcap.part", 1);
    let flight = world.start(0, &["flight", "box", "--keep", "1", "--json", "flight.json"]);
    let count = || {
        let files = std::fs::read_dir(world.file("box")).map(Iterator::flatten).into_iter().flatten();
        files.filter(|file| file.path().to_string_lossy().ends_with("request.mcap")).count()
    };
    until("the folder is there", || world.file("box").exists().then_some(()));
    for number in 1..=3 {
        // Each takes longer than half of what is kept, after which a state is asked for again.
        flight.signal("-USR1");
        until("a file on request", || (count() >= number).then_some(()));
    }
    flight.end();
    recorder.end();
    daemon.end();
    let report = json(&world.file("flight.json"));
    let file = world.file(report["files"][0]["recording"].as_str().unwrap()).display().to_string();
    assert!(replayed(&world, &file)["ticks"].as_u64() > Some(100), "{report}");
}

#[test]
fn a_killed_recorder_loses_its_last_moments_only_and_the_next_one_mends_the_file() {
    let world = World::new(PROGRAM);
    let daemon = world.daemon(0);
    let _arm = world.armed_arm(0, &[]);
    let recorder = world.start(0, &["record", "run.mcap"]);
    let known = recorded(&world, "run.mcap.part", 600);
    recorder.kill();

    let next = world.run(0, &["record", "run.mcap", "--seconds", "1"]);
    assert!(next.status.success(), "{}", told(&next));
    assert!(told(&next).contains("run.interrupted-1.mcap"), "{}", told(&next));
    let mended = world.file("run.interrupted-1.mcap").display().to_string();
    let output = world.run_plain(&["record", "--info", &mended, "--json", "-"]);
    let info: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(info["damage"], Value::Null, "{info}");
    assert!(info["topics"]["/raw/input"].as_u64() >= known.topics.get("/raw/input").copied(), "{info}");
    assert!(replayed(&world, &mended)["ticks"].as_u64() > Some(100));
    replayed(&world, &world.file("run.mcap").display().to_string());

    let refused = world.run(0, &["record", "run.mcap"]);
    assert_refused(&refused, 5, &["run.mcap exists already"]);
    daemon.end();
}

/// Ticks after `last` that the daemon had begun by `until_ns`, as `witness` has them.
fn ticks_between(witness: &BTreeMap<u64, u64>, last: u64, until_ns: u64) -> usize {
    witness.range(last + 1..).take_while(|(_, now_ns)| **now_ns <= until_ns).count()
}

#[test]
fn what_a_killed_recorder_loses_is_half_a_second_of_ticks_at_most() {
    let world = World::new(PROGRAM);
    let daemon = world.daemon(0);
    let second_recorder = world.start(0, &["record", "witness.mcap"]);
    recorded(&world, "witness.mcap.part", 1);
    let mut kills = Vec::new();
    for number in 0..5_u64 {
        let name = format!("{number}.mcap");
        let recorder = world.start(0, &["record", &name]);
        recorded(&world, &format!("{name}.part"), 100);
        // Anywhere between two chunks.
        std::thread::sleep(Duration::from_millis(number * 55));
        kills.push(monotonic_now_ns());
        recorder.kill();
        let mended = world.run_plain(&["record", "--repair", &format!("{name}.part")]);
        assert!(mended.status.success(), "{}", told(&mended));
    }
    second_recorder.end();
    daemon.end();
    let (mut witness, mut seconds) = (BTreeMap::new(), 0.0);
    let mut reader = RecordingReader::open(&world.file("witness.mcap")).unwrap();
    while let Some(entry) = reader.next_entry().unwrap() {
        if let RecordingEntry::Message(message) = entry
            && let Content::Input(input) = reader.content(&message).unwrap()
        {
            let first = witness.first_key_value().map_or(input.now_ns, |(_, now_ns)| *now_ns);
            seconds = (input.now_ns - first) as f64 * 1e-9;
            witness.insert(input.tick, input.now_ns);
        }
    }
    let rate_hz = witness.len() as f64 / seconds;
    let mut lost: Vec<usize> = Vec::new();
    for (number, killed_ns) in kills.into_iter().enumerate() {
        let (_, last) = info(&world.file(&format!("{number}.mended.mcap"))).unwrap().ticks.unwrap();
        lost.push(ticks_between(&witness, last, killed_ns));
    }
    lost.sort_unstable();
    // The middle one: a machine that lets the recorder wait loses more, and says nothing of it.
    assert!(lost[2] as f64 <= 0.5 * rate_hz, "{lost:?} ticks at {rate_hz:.0} Hz");
    assert!(lost[4] > 0, "a kill that costs nothing was none: {lost:?}");
}

#[test]
fn a_recording_goes_on_in_further_files_and_each_can_be_replayed() {
    let world = World::new(PROGRAM);
    let daemon = world.daemon(0);
    let words = ["record", "run.mcap", "--max-size", "1M", "--max-files", "2", "--json", "report.json"];
    let recorder = world.start(0, &words);
    until("a third file", || world.file("run.3.mcap.part").exists().then_some(()));
    recorded(&world, "run.3.mcap.part", 1);
    // What another recorder of the same name would mend is being written.
    let second = world.run(0, &["record", "run.mcap"]);
    assert_refused(&second, 5, &["mcap.part is being written by another recorder"]);
    recorder.end();
    daemon.end();
    let report = json(&world.file("report.json"));
    let files = report["files"].as_array().unwrap();
    assert_eq!(files.len(), 2, "{report}");
    assert!(!world.file("run.mcap").exists(), "the oldest is gone");
    for file in files {
        let file = world.file(file.as_str().unwrap()).display().to_string();
        assert!(replayed(&world, &file)["ticks"].as_u64() > Some(0));
    }
}

#[test]
fn a_stop_leaves_its_last_seconds_behind_as_recording_and_trace() {
    let world = World::new(PROGRAM);
    let daemon = world.daemon(0);
    let _arm = world.armed_arm(0, &[]);
    let flight = world.start(0, &["flight", "box", "--keep", "3", "--apart", "0", "--json", "flight.json"]);
    let played = world.run(0, &["play", "glyphs:Kx"]);
    assert!(played.status.success(), "{}", told(&played));
    let found = |word: &str| {
        let files = std::fs::read_dir(world.file("box")).ok()?;
        let mut names = files.flatten().map(|file| file.path());
        names.find(|path| path.to_string_lossy().ends_with(&format!("{word}.mcap")))
    };
    // A busy machine may have stopped the loop before: then there is none until it is armed again.
    let recording = until("the stop is written", || {
        let _ = world.run(0, &["request", "arm"]);
        let _ = world.run(0, &["request", "stop"]);
        found("stop")
    });
    flight.signal("-USR1");
    until("a file on request", || found("request"));
    flight.end();
    let (shown, page) = (world.status(0)["flight"].clone(), told(&world.run(0, &["status"])));
    daemon.end();
    let report = json(&world.file("flight.json"));
    let files = report["files"].as_array().unwrap();
    assert!(files.len() >= 2, "{report}");
    // Any trigger may have come last on a busy machine.
    let newest = world.file(files.last().unwrap()["recording"].as_str().unwrap()).display().to_string();
    assert_eq!(shown["recording"].as_str(), Some(newest.as_str()), "{report}");
    assert!(page.contains("\nflight      ") && page.contains(&newest), "{page}");
    let file = recording.display().to_string();
    assert!(replayed(&world, &file)["ticks"].as_u64() > Some(100));
    let output = world.run_plain(&["explain", &file]);
    assert!(told(&output).contains("it stopped: "), "{}", told(&output));
    let trace = std::fs::read(recording.with_extension("perfetto-trace")).unwrap();
    assert!(trace.len() > 10_000 && trace[0] == 0x0a, "{} bytes", trace.len());
}
