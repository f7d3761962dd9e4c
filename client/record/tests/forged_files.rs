//! Recordings in MCAP that were forged: whatever reads them ends with a sentence, in little memory and time.

#[path = "../../../tests/src/forged.rs"]
mod forging;

use std::path::Path;

use foretrace_config::Config;
use foretrace_record::info::info;
use foretrace_record::read::RecordingReader;
use foretrace_record::repair::repair;
use foretrace_record::replay::replay;
use foretrace_record::topics::{RecordingTopic, thing_bytes};
use foretrace_record::what_if::what_if;
use foretrace_record::write::{FileFacts, Output};
use foretrace_record::{explain, table};
use foretrace_shm::{PieceKind, Thing, TickInput, TickRecord, Wire};
use foretrace_sim::data::load_recording;
use mcap::records::op;

/// A tenth of what a machine with one arm has; a recorder's largest record has a sixteenth of it.
const MIB: u64 = 1024;

/// A small recording, as its recorder writes it.
fn recording(folder: &Path) -> Vec<u8> {
    let settings = Config::preset("ur5").unwrap().render().into_bytes();
    let settings = Thing { kind: PieceKind::Settings, number: 0, daemon_id: 1, bytes: settings };
    let facts = FileFacts::from([("version".to_owned(), "0.0.1".to_owned())]);
    let mut output = Output::create(&folder.join("whole.mcap"), &facts).unwrap();
    output.put(RecordingTopic::Thing, 1, &thing_bytes(&settings)).unwrap();
    for tick in 1..20_u64 {
        let now_ns = 10_000_000_000 + tick * 2_000_000;
        let mut bytes = Vec::new();
        TickInput { tick, now_ns, daemon_id: 1, parts: 1, ..Default::default() }.put(&mut bytes);
        output.put(RecordingTopic::Input, now_ns, &bytes).unwrap();
        let mut bytes = Vec::new();
        TickRecord { tick, release_ns: now_ns, ..Default::default() }.put(&mut bytes);
        output.put(RecordingTopic::TickRaw, now_ns, &bytes).unwrap();
    }
    std::fs::read(output.finish(&facts).unwrap()).unwrap()
}

/// The same without checksums, and with the records of chunks outside of them: damage reaches their readers.
fn opened(bytes: &[u8]) -> [Vec<u8>; 2] {
    let (mut unsummed, mut flat, mut at) = (bytes.to_vec(), mcap::MAGIC.to_vec(), mcap::MAGIC.len());
    while let Some(length) = bytes.get(at + 1..at + 9) {
        let end = at + 9 + u64::from_le_bytes(length.try_into().unwrap()) as usize;
        if bytes[at] == op::CHUNK {
            unsummed[at + 9 + 24..][..4].fill(0);
            // Two times, the size, the checksum, no compression, the size again.
            flat.extend(&bytes[at + 9 + 40..end]);
        } else {
            flat.extend(&bytes[at..end]);
        }
        at = end;
    }
    flat.extend(&bytes[at..]);
    [unsummed, flat]
}

/// Everything that reads a recording; no sentence is long.
fn read_by_all(path: &Path, folder: &Path) {
    let mended = folder.join("mended.mcap");
    let _ = std::fs::remove_file(&mended);
    let reported = [
        info(path).err().map(|error| error.to_string()),
        explain::moments(path).err().map(|error| error.to_string()),
        replay(path).err().map(|error| error.to_string()),
        what_if(path, &[], 1).err().map(|error| error.to_string()),
        repair(path, &mended).err().map(|error| error.to_string()),
        load_recording(path).err().map(|error| error.to_string()),
        RecordingReader::open(path).ok().and_then(|mut reader| {
            let made = table::csv(&mut reader, "/raw/tick", 1, &[], &mut std::io::sink());
            made.err().map(|error| error.to_string())
        }),
    ];
    for reported in reported.into_iter().flatten() {
        assert!(!reported.is_empty() && reported.len() < 20_000, "{} bytes: {reported:.300}", reported.len());
    }
    if mended.exists() {
        assert_eq!(info(&mended).unwrap().damage, None);
    }
}

#[test]
fn forged_mcap_files_are_refused_with_a_sentence() {
    let folder = tempfile::tempdir().unwrap();
    let whole = recording(folder.path());
    let [unsummed, flat] = opened(&whole);
    let (path, seeds) = (folder.path().join("bad.mcap"), [whole, unsummed, flat.clone(), flat]);
    forging::read_forged("forged_mcap_files_are_refused_with_a_sentence", MIB, &seeds, |bytes| {
        std::fs::write(&path, bytes).unwrap();
        read_by_all(&path, folder.path());
    });
}

#[test]
fn a_few_bytes_that_claim_gigabytes_take_no_memory() {
    let claims: Vec<Vec<u8>> = [op::HEADER, op::SCHEMA, op::CHANNEL, op::METADATA, op::CHUNK, op::ATTACHMENT]
        .into_iter()
        .flat_map(|kind| (0..40).map(move |before| (kind, before)))
        .map(|(kind, before)| {
            let body = [vec![0; before], 0xefff_ffff_u32.to_le_bytes().to_vec(), b"abc".to_vec()].concat();
            let length = (body.len() as u64).to_le_bytes();
            [mcap::MAGIC.to_vec(), vec![kind], length.to_vec(), body].concat()
        })
        .collect();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("small.mcap");
    let mut next = 0;
    // What the lengths say would not fit, wherever they stand.
    forging::read_forged("a_few_bytes_that_claim_gigabytes_take_no_memory", 512, &claims, |bytes| {
        for bytes in [bytes, &claims[next % claims.len()]] {
            std::fs::write(&path, bytes).unwrap();
            read_by_all(&path, folder.path());
        }
        next += 1;
    });
}

#[test]
fn what_a_killed_program_left_blocks_no_second_try() {
    let folder = tempfile::tempdir().unwrap();
    let whole = folder.path().join("in.mcap");
    std::fs::write(&whole, recording(folder.path())).unwrap();
    let target = folder.path().join("out.mcap");
    let left = folder.path().join("out.mcap.partial");
    std::fs::write(&left, "half").unwrap();
    // Somebody else is at it.
    let other = std::fs::File::open(&left).unwrap();
    other.lock().unwrap();
    let reported = repair(&whole, &target).unwrap_err().to_string();
    assert!(reported.contains("out.mcap.partial is being written"), "{reported}");
    assert_eq!(std::fs::read(&left).unwrap(), b"half");
    // It was killed.
    drop(other);
    assert_eq!(repair(&whole, &target).unwrap().damage, None);
    assert!(!left.exists() && info(&target).unwrap().damage.is_none());
    // A recorder's part is a recording: nothing made of other files takes its name.
    let part = foretrace_record::write::part_of(&whole.with_file_name("b.mcap"));
    std::fs::write(&part, "only here").unwrap();
    repair(&whole, &folder.path().join("b.mcap")).unwrap();
    assert_eq!(std::fs::read(&part).unwrap(), b"only here");
    // One that was killed before its first byte, and one that a power cut left with holes.
    for (name, bytes) in [("c.mcap", vec![]), ("d.mcap", vec![0; 4096])] {
        let target = folder.path().join(name);
        std::fs::write(foretrace_record::write::part_of(&target), &bytes).unwrap();
        let aside = foretrace_record::repair::mend_leftovers(&target).unwrap();
        assert_eq!((aside.len(), std::fs::read(&aside[0].0).unwrap()), (1, bytes));
        drop(Output::create(&target, &FileFacts::new()).unwrap());
    }
}
