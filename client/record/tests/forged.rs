//! Recordings that nobody recorded: whatever is in them, reading ends soon with a sentence and says nothing
//! else.

use std::io::{Seek as _, SeekFrom, Write as _};
use std::path::PathBuf;

use foretrace_config::Config;
use foretrace_record::explain;
use foretrace_record::info::info;
use foretrace_record::read::RecordingReader;
use foretrace_record::repair::repair;
use foretrace_record::replay::replay;
use foretrace_record::table;
use foretrace_record::topics::{RecordingTopic, thing_bytes};
use foretrace_record::what_if::what_if;
use foretrace_record::write::{FileFacts, Output, part_of};
use foretrace_shm::{PieceKind, Thing, TickInput, TickRecord, Wire, input_flags};
use tempfile::TempDir;

const PERIOD_NS: u64 = 2_000_000;

fn settings(toml: String) -> Thing {
    Thing { kind: PieceKind::Settings, number: 0, daemon_id: 1, bytes: toml.into_bytes() }
}

fn preset() -> Thing {
    settings(Config::preset("ur5").unwrap().render())
}

/// Ticks of an arm that is commanded and measured.
fn ticks(count: u64) -> Vec<TickInput> {
    let tick = |tick: u64| {
        let now_ns = 10_000_000_000 + tick * PERIOD_NS;
        let mut input = TickInput { tick, now_ns, daemon_id: 1, parts: 1, ..Default::default() };
        input.flags = input_flags::JOINTS;
        (input.joints_ns, input.command_ns) = (now_ns, now_ns + PERIOD_NS);
        input.q = [0.1 * (tick as f64 * 0.02).sin(); 6];
        (input.joints_q, input.valid_until_ns) = (input.q, now_ns + 10 * PERIOD_NS);
        input
    };
    (1..=count).map(tick).collect()
}

fn written(place: &TempDir, name: &str, things: &[Thing], inputs: &[TickInput]) -> PathBuf {
    let mut output = Output::create(&place.path().join(name), &FileFacts::new()).unwrap();
    for thing in things {
        output.put(RecordingTopic::Thing, 1, &thing_bytes(thing)).unwrap();
    }
    for input in inputs {
        let mut bytes = Vec::new();
        input.put(&mut bytes);
        output.put(RecordingTopic::Input, input.now_ns, &bytes).unwrap();
        let mut bytes = Vec::new();
        TickRecord { tick: input.tick, release_ns: input.now_ns, ..Default::default() }.put(&mut bytes);
        output.put(RecordingTopic::TickRaw, input.now_ns, &bytes).unwrap();
    }
    output.finish(&FileFacts::new()).unwrap()
}

#[test]
fn leaps_of_time_end_a_stretch_and_cost_neither_memory_nor_time() {
    let place = TempDir::new().unwrap();
    for (name, leap) in [("now", 0), ("command", 1), ("joints", 2)] {
        let mut inputs = ticks(300);
        for input in &mut inputs[200..] {
            let stamps = [&mut input.now_ns, &mut input.command_ns, &mut input.joints_ns];
            for (index, stamp) in stamps.into_iter().enumerate() {
                if index >= leap {
                    *stamp = stamp.saturating_add(1 << 62);
                }
            }
        }
        // However it is answered: it is.
        match what_if(&written(&place, name, &[preset()], &inputs), &[], 1) {
            Ok(answer) => assert!(answer.ticks <= 300 && answer.seconds < 1.0, "{name}: {answer:?}"),
            Err(error) => assert!(error.to_string().contains("recording"), "{name}: {error}"),
        }
    }
}

#[test]
fn the_last_tick_there_can_be_overflows_nothing() {
    let place = TempDir::new().unwrap();
    let mut inputs = ticks(3);
    for (input, tick) in inputs.iter_mut().zip([u64::MAX - 1, u64::MAX, u64::MAX]) {
        input.tick = tick;
    }
    let state = Thing { kind: PieceKind::State, number: u64::MAX, daemon_id: 1, bytes: vec![0; 8] };
    let file = written(&place, "last", &[preset(), state], &inputs);
    assert!(replay(&file).unwrap_err().to_string().contains("neither the first tick nor a state"));
    assert!(what_if(&file, &[], 1).is_err() && explain::moments(&file).is_ok() && info(&file).is_ok());
}

#[test]
fn settings_of_a_recording_open_no_device() {
    let place = TempDir::new().unwrap();
    let own = Config::preset("ur5").unwrap().render();
    let urdf = own.lines().find(|line| line.trim_start().starts_with("urdf")).unwrap();
    let forged = settings(own.replacen(urdf, "urdf = \"/dev/zero\"", 1));
    let file = written(&place, "device", &[forged], &ticks(10));
    let reported = replay(&file).unwrap_err().to_string();
    assert!(reported.contains("not a regular file"), "{reported}");
}

#[test]
fn a_pipe_is_refused_instead_of_waited_for() {
    let place = TempDir::new().unwrap();
    let pipe = place.path().join("pipe");
    assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
    assert!(RecordingReader::open(&pipe).unwrap_err().to_string().contains("not a regular file"));
}

#[test]
fn schemas_are_shared_by_their_channels_and_bounded() {
    let place = TempDir::new().unwrap();
    let written = |name: &str, bytes: usize, channels: u16| {
        let path = place.path().join(name);
        let mut writer = mcap::Writer::new(std::fs::File::create(&path).unwrap()).unwrap();
        let schema = writer.add_schema("T", "foretrace.wire", &vec![b'x'; bytes]).unwrap();
        for channel in 0..channels {
            writer.add_channel(schema, &format!("/{channel}"), "x", &FileFacts::new()).unwrap();
        }
        writer.finish().unwrap();
        let mut reader = RecordingReader::open(&path).unwrap();
        while reader.next_entry().unwrap().is_some() {}
        (reader.damage(), reader.channels().clone())
    };
    let (damage, channels) = written("shared", 1000, 200);
    assert_eq!((damage, channels.len()), (None, 200));
    let shared = |(a, b): (_, &foretrace_record::read::Channel)| {
        let a: &foretrace_record::read::Channel = a;
        std::sync::Arc::ptr_eq(&a.schema, &b.schema)
    };
    assert!(channels.values().zip(channels.values().skip(1)).all(shared));
    let (damage, channels) = written("large", 1 << 20, 200);
    assert!(damage.unwrap().contains("a schema of 10485") && channels.is_empty());
    let (damage, channels) = written("many", 10, 1000);
    assert!(damage.unwrap().contains("more than") && channels.len() < 1000);
}

/// Byte places of the checksums of the chunks of `bytes`.
fn checksums(bytes: &[u8]) -> Vec<usize> {
    let (mut at, mut found) = (mcap::MAGIC.len(), Vec::new());
    while let Some(length) = bytes.get(at + 1..at + 9) {
        if bytes[at] == mcap::records::op::CHUNK {
            found.push(at + 9 + 24);
        }
        at += 9 + u64::from_le_bytes(length.try_into().unwrap()) as usize;
    }
    found
}

#[test]
fn damaged_bytes_behind_a_good_checksum_never_panic() {
    let place = TempDir::new().unwrap();
    let file = written(&place, "whole", &[preset()], &ticks(60));
    let mut bytes = std::fs::read(&file).unwrap();
    let sums = checksums(&bytes);
    assert!(!sums.is_empty());
    for at in sums {
        // No checksum, so that what is damaged reaches the decoders.
        bytes[at..at + 4].fill(0);
    }
    let cases = std::env::var("FORETRACE_FUZZ_CASES").ok().and_then(|n| n.parse().ok()).unwrap_or(60_u64);
    let mut seed = 0x9e37_79b9_7f4a_7c15_u64;
    let mut next = || {
        seed ^= seed << 13;
        seed ^= seed >> 7;
        seed ^= seed << 17;
        seed
    };
    let (mut heard, path) = (0_u64, place.path().join("bad"));
    for _ in 0..cases {
        let mut bad = bytes.clone();
        for _ in 0..1 + next() % 20 {
            let at = next() as usize % bad.len();
            bad[at] = next() as u8;
        }
        std::fs::write(&path, &bad).unwrap();
        heard += info(&path).map_or(0, |info| info.topics.values().sum());
        let _ = (explain::moments(&path), explain::tick(&path, 30), replay(&path), what_if(&path, &[], 1));
        if let Ok(mut reader) = RecordingReader::open(&path) {
            let _ = table::csv(&mut reader, "/raw/tick", 1, &[], &mut std::io::sink());
        }
    }
    assert!(heard > cases * 60, "{heard} messages reached the decoders");
}

#[test]
fn a_file_that_is_no_recording_gets_a_sentence() {
    let place = TempDir::new().unwrap();
    let file = |name: &str, bytes: &[u8]| {
        let path = place.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        path
    };
    let huge = file("huge", b"");
    std::fs::File::options().write(true).open(&huge).unwrap().set_len(1 << 40).unwrap();
    let cases = [
        (file("empty", b""), "it is empty; copy"),
        (file("text", b"t_s,x_m,y_m,contact\n"), "does not begin as an MCAP file"),
        (huge, "it holds zeros where it begins"),
        (place.path().to_path_buf(), "it is a folder"),
        (place.path().join("nowhere"), "cannot read"),
    ];
    for (path, words) in cases {
        for reported in [
            info(&path).unwrap_err().to_string(),
            replay(&path).unwrap_err().to_string(),
            repair(&path, &place.path().join("mended")).unwrap_err().to_string(),
        ] {
            assert!(reported.contains(words) && !reported.contains('{'), "{reported}");
        }
    }
    assert!(!part_of(&place.path().join("mended")).exists());

    // Begins as a recording, and then a terabyte of holes.
    let sparse = file("sparse", mcap::MAGIC);
    let mut holes = std::fs::File::options().write(true).open(&sparse).unwrap();
    holes.seek(SeekFrom::Start(1 << 40)).unwrap();
    holes.write_all(b"x").unwrap();
    assert!(info(&sparse).unwrap().damage.is_some());
}
