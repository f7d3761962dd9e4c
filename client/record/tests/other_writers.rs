//! Recordings that other programs wrote anew, cut, or that are of another kind altogether: read by
//! everything, or told by everything.

#[path = "../../../tests/src/rewritten.rs"]
mod rewriting;

use std::path::{Path, PathBuf};

use foretrace_config::Config;
use foretrace_record::info::info;
use foretrace_record::pen::pen_samples;
use foretrace_record::read::{RecordingEntry, RecordingReader};
use foretrace_record::repair::repair;
use foretrace_record::replay::replay;
use foretrace_record::topics::{RecordingTopic, thing_bytes};
use foretrace_record::what_if::what_if;
use foretrace_record::write::{FileFacts, Output};
use foretrace_record::{explain, table};
use foretrace_shm::{PieceKind, Thing, TickInput, TickRecord, Wire, input_flags};
use rewriting::{Layout, chunk, layouts, rewritten};
use tempfile::TempDir;

const TICKS: u64 = 60;

/// A recording of an armed loop, as its recorder writes it: chunks without compression.
fn recording(folder: &Path) -> Vec<u8> {
    let settings = Config::preset("ur5").unwrap().render().into_bytes();
    let settings = Thing { kind: PieceKind::Settings, number: 0, daemon_id: 1, bytes: settings };
    let facts = FileFacts::from([("version".to_owned(), "0.0.1".to_owned())]);
    let mut output = Output::create(&folder.join("own.mcap"), &facts).unwrap();
    output.put(RecordingTopic::Thing, 1, &thing_bytes(&settings)).unwrap();
    for tick in 1..=TICKS {
        let now_ns = 10_000_000_000 + tick * 2_000_000;
        let mut input = TickInput { tick, now_ns, daemon_id: 1, parts: 1, ..Default::default() };
        input.flags = input_flags::JOINTS;
        (input.joints_ns, input.command_ns) = (now_ns, now_ns + 2_000_000);
        input.q = [0.1 * (tick as f64 * 0.02).sin(); 6];
        (input.joints_q, input.valid_until_ns) = (input.q, now_ns + 20_000_000);
        input.pen_samples = 1;
        (input.pen[0].stamp_ns, input.pen[0].x_m, input.pen[0].contact) = (now_ns, 1e-4 * tick as f64, 1);
        let mut bytes = Vec::new();
        input.put(&mut bytes);
        output.put(RecordingTopic::Input, now_ns, &bytes).unwrap();
        let mut bytes = Vec::new();
        TickRecord { tick, release_ns: now_ns, ..Default::default() }.put(&mut bytes);
        output.put(RecordingTopic::TickRaw, now_ns, &bytes).unwrap();
    }
    std::fs::read(output.finish(&facts).unwrap()).unwrap()
}

fn file(folder: &TempDir, name: &str, bytes: &[u8]) -> PathBuf {
    let path = folder.path().join(name);
    std::fs::write(&path, bytes).unwrap();
    path
}

/// What everything that reads a recording makes of it; numbers in full, errors without the path.
///
/// The law of a variant takes long: it is run where `variants` says so.
fn answers(path: &Path, variants: bool) -> Vec<(&'static str, Result<String, String>)> {
    let told = |error: &dyn std::fmt::Display| error.to_string().replace(&*path.to_string_lossy(), "FILE");
    let csv = |reader: &mut RecordingReader| {
        let mut out = Vec::new();
        table::csv(reader, "/raw/tick", 1, &[], &mut out).map(|rows| format!("{rows} {}", out.len()))
    };
    let pens = |reader: &mut RecordingReader| {
        let mut seen = Vec::new();
        pen_samples(reader, |sample| {
            seen.push((sample.stamp_ns, sample.x_m.to_bits()));
            Ok::<(), ()>(())
        })
        .map(|_| match reader.lack("it holds 0 pen samples") {
            Some(lack) if seen.is_empty() => Err(told(&lack)),
            _ => Ok(format!("{} {:?}", seen.len(), seen.last())),
        })
    };
    let mut all = vec![
        ("replay", replay(path).map(|outcome| format!("{outcome:?}")).map_err(|error| told(&error))),
        ("explain", explain::moments(path).map(|found| format!("{found:?}")).map_err(|error| told(&error))),
        ("tick", explain::tick(path, 7).map(|found| format!("{found:?}")).map_err(|error| told(&error))),
        ("export", RecordingReader::open(path).and_then(|mut r| csv(&mut r)).map_err(|error| told(&error))),
        ("pen", RecordingReader::open(path).and_then(|mut r| pens(&mut r)).map_err(|e| told(&e)).flatten()),
    ];
    if variants {
        all.push((
            "what if",
            what_if(path, &[], 1).map(|answer| format!("{answer:?}")).map_err(|error| told(&error)),
        ));
    }
    all
}

#[test]
fn every_layout_of_a_recording_gives_the_same_answers() {
    let folder = TempDir::new().unwrap();
    let own = recording(folder.path());
    let path = folder.path().join("own.mcap");
    let (wanted, about) = (answers(&path, true), info(&path).unwrap());
    assert!(wanted.iter().filter(|(_, answer)| answer.is_ok()).count() > 4, "{wanted:?}");
    for (name, layout) in layouts() {
        let path = file(&folder, &format!("{name}.mcap"), &rewritten(&own, &layout));
        for (wanted, got) in wanted.iter().zip(answers(&path, name == "mixed")) {
            assert_eq!(wanted, &got, "{name}");
        }
        let told = info(&path).unwrap();
        assert_eq!((&told.topics, &told.begin, &told.damage), (&about.topics, &about.begin, &None), "{name}");
        let attachment = layout.extras.then(|| "1 attachment".to_owned());
        assert_eq!(told.passed_over, attachment, "{name}");
        let mended = folder.path().join(format!("{name}.mended.mcap"));
        let result = repair(&path, &mended).unwrap();
        assert_eq!((result.messages, result.damage, result.passed_over), (1 + 2 * TICKS, None, attachment));
        // The mended files are alike: a few of them stand for all.
        if ["mixed", "no-chunks"].contains(&name) {
            assert_eq!(answers(&mended, false), wanted[..5], "{name}");
        }
    }
}

#[test]
fn a_cut_file_is_answered_up_to_its_cut_and_never_called_short() {
    let folder = TempDir::new().unwrap();
    let own = recording(folder.path());
    for compression in [&["zstd"], &["lz4"], &[""]] {
        let whole = rewritten(&own, &Layout { chunk: Some(10_000), compression, ..Layout::default() });
        let mut before = 0;
        for there in (8..whole.len()).step_by(whole.len() / 8) {
            let path = file(&folder, "cut.mcap", &whole[..there]);
            for (who, answer) in answers(&path, false) {
                match answer {
                    Ok(found) => assert!(
                        !matches!(who, "replay" | "explain")
                            || found.contains("Cut")
                            || found.contains("damage: Some"),
                        "{who}: {found}"
                    ),
                    Err(why) => {
                        assert!(
                            why.contains("ends early, after") || why.contains("cannot be told"),
                            "{who}: {why}"
                        );
                        assert!(!why.contains("too short") && !why.contains("Clarabel"), "{who}: {why}");
                    }
                }
            }
            let mended = folder.path().join("mended.mcap");
            let _ = std::fs::remove_file(&mended);
            match repair(&path, &mended) {
                Ok(saved) => {
                    assert!(saved.messages >= before && saved.damage.is_some() && mended.exists());
                    before = saved.messages;
                    assert_eq!(info(&mended).unwrap().damage, None);
                }
                Err(error) => {
                    let told = error.to_string();
                    assert!(before == 0 && !mended.exists(), "{told}");
                    assert!(
                        told.contains("no message") && told.contains("after ") && told.contains("copy it"),
                        "{told}"
                    );
                }
            }
        }
        assert!(before > TICKS, "{before} messages at most");
    }
}

#[test]
fn what_cannot_be_read_is_told_by_everything_with_its_place() {
    let folder = TempDir::new().unwrap();
    let own = recording(folder.path());
    let whole = rewritten(&own, &Layout { chunk: Some(usize::MAX), ..Layout::default() });
    let sum = whole.windows(4).position(|bytes| bytes == b"zstd").unwrap() - 8;
    let mut wrong = whole.clone();
    wrong[sum] ^= 1;
    let unknown = [mcap::MAGIC, &chunk("snappy", b"packed", true)].concat();
    let mut huge = whole.clone();
    huge[sum - 8..sum].copy_from_slice(&(1_u64 << 33).to_le_bytes());
    let cases = [
        ("sum.mcap", wrong, "the checksum of a chunk is wrong"),
        ("unknown.mcap", unknown, "\"snappy\", which is not read here"),
        ("huge.mcap", huge, "claims 8589934592 bytes of records, and 134217728 are the most"),
    ];
    for (name, bytes, words) in cases {
        let path = file(&folder, name, &bytes);
        for (who, answer) in answers(&path, true) {
            let why = answer.unwrap_err();
            assert!(
                why.contains("FILE") && why.contains(words) && why.contains("after "),
                "{name}, {who}: {why}"
            );
            assert!(why.contains("bytes from there on are left out"), "{name}, {who}: {why}");
        }
        assert!(info(&path).unwrap().damage.unwrap().contains(words), "{name}");
        let mended = folder.path().join("mended.mcap");
        let told = repair(&path, &mended).unwrap_err().to_string();
        assert!(told.contains(words) && told.contains("no file was written") && !mended.exists(), "{told}");
        assert!(!folder.path().join("mended.mcap.partial").exists());
    }
    // Nothing stands before the damage that could be mended.
    let path = file(&folder, "mark.mcap", mcap::MAGIC);
    for (who, answer) in answers(&path, true) {
        let why = answer.unwrap_err();
        assert!(why.contains("no message stands before that") && !why.contains("--repair"), "{who}: {why}");
    }
}

#[test]
fn files_of_other_programs_are_told_by_their_topics() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("theirs.mcap");
    let mut writer =
        mcap::WriteOptions::new().compression(None).create(std::fs::File::create(&path).unwrap()).unwrap();
    for topic in ["/camera", "/joint_states", "/odom", "/scan", "/tf"] {
        let channel = writer.add_channel(0, topic, "cdr", &FileFacts::new()).unwrap();
        let header =
            mcap::records::MessageHeader { channel_id: channel, sequence: 0, log_time: 1, publish_time: 1 };
        writer.write_to_known_channel(&header, b"theirs").unwrap();
    }
    writer.finish().unwrap();
    for (who, answer) in answers(&path, true) {
        let why = answer.unwrap_err();
        assert!(why.contains("(/camera, /joint_states, /odom, /scan, 1 more)"), "{who}: {why}");
        assert!(!why.contains("too short"), "{who}: {why}");
    }
    assert_eq!(info(&path).unwrap().topics.len(), 5);
    // Without any topic.
    let empty =
        rewritten(&[mcap::MAGIC, &[0x0f, 4, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]].concat(), &Layout::default());
    let path = file(&folder, "empty.mcap", &empty);
    assert!(replay(&path).unwrap_err().to_string().contains("it has none"));
    let told = repair(&path, &folder.path().join("mended.mcap")).unwrap_err().to_string();
    assert!(told.contains("no message that can be read; no file was written"), "{told}");
}

#[test]
fn a_mended_file_keeps_times_and_facts_and_tells_what_it_leaves_out() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("facts.mcap");
    let mut writer =
        mcap::WriteOptions::new().compression(None).create(std::fs::File::create(&path).unwrap()).unwrap();
    let facts = FileFacts::from([("frame".to_owned(), "paper".to_owned())]);
    let channel = writer.add_channel(0, "/a", "json", &facts).unwrap();
    let header =
        mcap::records::MessageHeader { channel_id: channel, sequence: 3, log_time: 20, publish_time: 10 };
    writer.write_to_known_channel(&header, b"{}").unwrap();
    writer.finish().unwrap();
    // A message of a channel that nobody told of.
    let mut bytes = rewritten(
        &std::fs::read(&path).unwrap(),
        &Layout { chunk: None, extras: true, sums: false, ..Layout::default() },
    );
    let end = bytes.len() - (9 + 4) - (9 + 20) - 8;
    let orphan = [&[5, 22, 0, 0, 0, 0, 0, 0, 0, 9, 9][..], &[0; 20]].concat();
    bytes.splice(end..end, orphan);
    let path = file(&folder, "facts.mcap", &bytes);
    let mended = folder.path().join("mended.mcap");
    let result = repair(&path, &mended).unwrap();
    assert_eq!((result.messages, result.damage), (1, None));
    assert_eq!(result.passed_over.as_deref(), Some("1 attachment and 1 message of unknown channels"));
    let mut reader = RecordingReader::open(&mended).unwrap();
    let Some(RecordingEntry::Message(message)) = reader.next_entry().unwrap() else { panic!("no message") };
    assert_eq!((message.sequence, message.time_ns, message.publish_ns), (3, 20, 10));
    assert_eq!(reader.channels()[&message.channel].metadata, facts);
}

#[test]
fn other_files_and_folders_are_told_for_what_they_are() {
    let folder = TempDir::new().unwrap();
    let cases: [(&[u8], &str); 7] = [
        (b"version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 1\n", "`git lfs pull`"),
        (b"", "it is empty"),
        (b"\x89MCAP", "5 bytes are too short for an MCAP file"),
        (b"#ROSBAG V2.0\n", "a bag of ROS 1"),
        (b"SQLite format 3\0", "such as rosbag2 writes"),
        (b"\x1f\x8b\x08\0", "gzip as a whole; unpack it"),
        (b"t_s,x_m,y_m,contact\n0,0,0,1\n", "but as CSV; `foretrace play` and `foretrace lab` read"),
    ];
    let deep = folder.path().join("a-long-name-of-a-folder/".repeat(8));
    std::fs::create_dir_all(&deep).unwrap();
    for (bytes, words) in cases {
        let path = deep.join("the-name-of-the-file.mcap");
        std::fs::write(&path, bytes).unwrap();
        let told = RecordingReader::open(&path).unwrap_err().to_string();
        assert!(
            told.contains(words) && told.contains("the-name-of-the-file.mcap is no recording: "),
            "{told}"
        );
    }
    let told = RecordingReader::open(&deep).unwrap_err().to_string();
    assert!(
        told.contains("it is a folder; give a file, for example ") && told.ends_with("the-file.mcap"),
        "{told}"
    );
    let told = RecordingReader::open(folder.path()).unwrap_err().to_string();
    assert!(told.contains("a folder, without an .mcap file"), "{told}");
}
