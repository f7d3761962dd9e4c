//! MCAP files as other programs write them, cut short, damaged, or of another kind altogether.

use crate::made;
use crate::rewriting::{Layout, chunk, layouts, rewritten};
use foretrace_sim::data::{DataSet, Recording, Split, load_recording};
use foretrace_sim::source::{PathOptions, load};
use std::path::{Path, PathBuf};

fn file(folder: &tempfile::TempDir, name: &str, bytes: &[u8]) -> PathBuf {
    let path = folder.path().join(name);
    std::fs::write(&path, bytes).unwrap();
    path
}

fn points(recording: &Recording) -> Vec<[f64; 2]> {
    recording
        .segments
        .iter()
        .flat_map(|segment| &segment.components)
        .flat_map(|part| part.points.clone())
        .collect()
}

fn refused(path: &Path) -> String {
    load_recording(path).unwrap_err().to_string()
}

#[test]
fn every_layout_of_a_file_gives_the_same_pen() {
    let folder = tempfile::tempdir().unwrap();
    let own = made::mcap(true);
    let wanted = load_recording(&file(&folder, "own.mcap", &own)).unwrap();
    assert_eq!((points(&wanted).len(), &wanted.damage), (32, &None));
    for (name, layout) in layouts() {
        let read = load_recording(&file(&folder, &format!("{name}.mcap"), &rewritten(&own, &layout)));
        let read = read.unwrap_or_else(|error| panic!("{name}: {error}"));
        assert_eq!((&read.segments, &read.damage), (&wanted.segments, &wanted.damage), "{name}");
    }
}

#[test]
fn a_cut_file_is_read_up_to_its_cut_which_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let own = made::mcap(true);
    let wanted = points(&load_recording(&file(&folder, "own.mcap", &own)).unwrap());
    for (name, layout) in layouts() {
        let whole = rewritten(&own, &layout);
        let (mut read, mut most) = (0, 0);
        for there in (0..whole.len()).step_by(whole.len() / 12) {
            let path = file(&folder, "cut.mcap", &whole[..there]);
            match load_recording(&path) {
                Ok(recording) => {
                    let got = points(&recording);
                    // The last may be merged with one of its stamp that is cut off.
                    let sure = &got[..got.len() - 1];
                    assert!(wanted.starts_with(sure) && got.len() <= wanted.len(), "{name} at {there}");
                    let note = recording.damage.as_deref().unwrap();
                    assert!(
                        note.starts_with("it ends early, after ") && note.contains("record --repair"),
                        "{note}"
                    );
                    (read, most) = (read + 1, most.max(got.len()));
                }
                Err(error) => {
                    let told = error.to_string();
                    let known = ["it ends early, after ", "it is empty", "too short for an MCAP file"];
                    assert!(known.iter().any(|words| told.contains(words)), "{name} at {there}: {told}");
                    assert!(!told.contains("record while"), "{told}");
                }
            }
        }
        assert!(read > 0 && most > 10, "{name}: {read} cuts were read, {most} points");
    }
    // The note reaches whoever plays it, and a set's list of what was left out.
    let whole = rewritten(&own, &Layout { chunk: Some(500), ..Layout::default() });
    let path = file(&folder, "cut.mcap", &whole[..whole.len() * 9 / 10]);
    let settings = foretrace_config::Config::preset("ur5").unwrap();
    let played = load(&[path.display().to_string()], &PathOptions::default(), settings.settings()).unwrap();
    assert!(
        played.notes.iter().any(|note| note.contains("cut.mcap: it ends early, after")),
        "{:?}",
        played.notes
    );
    std::fs::remove_file(folder.path().join("own.mcap")).unwrap();
    folder
        .path()
        .read_dir()
        .unwrap()
        .flatten()
        .map(|entry| entry.path())
        .filter(|other| *other != path)
        .for_each(|other| std::fs::remove_file(other).unwrap());
    let set = DataSet::load(folder.path(), &Split::All, false).unwrap();
    // It is read: what is told is its damage, and nothing is left out.
    assert!(set.errors.is_empty() && set.files.len() == 1, "{:?}", set.errors);
    assert!(set.damaged.len() == 1 && set.damaged[0].to_string().contains("it ends early"), "{set:?}");
    assert!(set.remarks()[0].contains("cut.mcap: it ends early"), "{:?}", set.remarks());
    let folder_name = [folder.path().display().to_string()];
    let played = load(&folder_name, &PathOptions::default(), settings.settings()).unwrap();
    assert!(played.notes.iter().any(|note| note.contains("cut.mcap: it ends early")), "{:?}", played.notes);
    assert!(DataSet::load(folder.path(), &Split::All, true).unwrap_err().to_string().contains("ends early"));
}

#[test]
fn damage_is_told_with_its_place_and_what_is_left_out() {
    let folder = tempfile::tempdir().unwrap();
    let own = made::mcap(true);
    let chunks =
        rewritten(&own, &Layout { chunk: Some(700), compression: &["zstd", "lz4", ""], ..Layout::default() });
    let flat = rewritten(&own, &Layout { chunk: None, ..Layout::default() });
    // A byte of the last chunk's records, before data end, footer and mark.
    let end = chunks.len() - (9 + 4) - (9 + 20) - 8;
    let mut wrong = chunks.clone();
    wrong[end - 3] ^= 1;
    let note = load_recording(&file(&folder, "chunks.mcap", &wrong)).unwrap().damage.unwrap_or_default();
    assert!(note.contains("after ") && note.contains("bytes from there on are left out"), "{note}");
    // Without chunks the sum of all data tells.
    let mut wrong = flat.clone();
    wrong[flat.len() / 2] ^= 1;
    match load_recording(&file(&folder, "flat.mcap", &wrong)) {
        Ok(read) => {
            assert!(
                read.damage.as_ref().unwrap().contains("the checksum of all before is wrong"),
                "{:?}",
                read.damage
            )
        }
        Err(error) => assert!(error.to_string().contains("ends early"), "{error}"),
    }
    let unknown = [&chunks[..end], &chunk("br", b"packed", true), &chunks[end..]].concat();
    let note = load_recording(&file(&folder, "unknown.mcap", &unknown)).unwrap().damage.unwrap_or_default();
    assert!(note.contains(&format!("after {end} bytes: a chunk is compressed with \"br\"")), "{note}");
    // Nothing but such chunks.
    let only = [mcap::MAGIC, &chunk("br", b"packed", true)].concat();
    let told = refused(&file(&folder, "only.mcap", &only));
    for words in ["only.mcap: it ends early, after 8 bytes", "\"br\"", "write the file anew"] {
        assert!(told.contains(words), "{told}");
    }
    assert!(!told.contains("topic"), "{told}");
    let mut claims = chunks.clone();
    let first = 8 + 9 + 8;
    claims[first + 9 + 16..][..8].copy_from_slice(&(1_u64 << 40).to_le_bytes());
    let told = refused(&file(&folder, "claims.mcap", &claims));
    assert!(told.contains("claims 1099511627776 bytes") && told.contains("134217728 are the most"), "{told}");
}

/// A recording with these samples in its only topic: stamps \[ms\] after a second, and x and y \[m\].
fn recorded(topic: &str, samples: &[(i64, f64, f64)]) -> Vec<u8> {
    let table = "layout 0 size 36\npen_samples 0 4 u32\npart 4 4 u32\npen[0].stamp_ns 8 8 u64\n\
                 pen[0].x_m 16 8 f64\npen[0].y_m 24 8 f64\npen[0].contact 32 4 u32\n";
    let mut file = std::io::Cursor::new(Vec::new());
    let mut writer = mcap::WriteOptions::new().compression(None).create(&mut file).unwrap();
    let schema = writer.add_schema("TickInput", "foretrace.wire", table.as_bytes()).unwrap();
    let channel = writer.add_channel(schema, topic, "foretrace.wire", &Default::default()).unwrap();
    for (ms, x_m, y_m) in samples {
        let mut message = [1_u32.to_le_bytes(), [0; 4]].concat();
        message.extend((1_000_000_000 + ms * 1_000_000).to_le_bytes());
        message.extend([x_m.to_le_bytes(), y_m.to_le_bytes()].concat());
        message.extend(1_u32.to_le_bytes());
        let header =
            mcap::records::MessageHeader { channel_id: channel, sequence: 0, log_time: 0, publish_time: 0 };
        writer.write_to_known_channel(&header, &message).unwrap();
    }
    writer.finish().unwrap();
    drop(writer);
    file.into_inner()
}

#[test]
fn samples_that_are_not_taken_as_they_stand_are_counted() {
    let folder = tempfile::tempdir().unwrap();
    let samples = [
        (0, 0.0, 0.0),
        (5, 0.001, 0.0),
        (5, 0.003, 0.004),
        (10, 0.002, 0.0),
        (-3, 9.0, 9.0),
        (15, f64::NAN, 0.0),
        (15, 0.003, 101.0),
        (15, 0.003, 0.0),
    ];
    let read = load_recording(&file(&folder, "odd.mcap", &recorded("/raw/input", &samples))).unwrap();
    assert_eq!(points(&read), [[0.0, 0.0], [0.002, 0.002], [0.002, 0.0], [0.003, 0.0]]);
    let counts: Vec<(u64, bool)> =
        read.remarks.iter().map(|remark| (remark.count, remark.what.contains("samples"))).collect();
    assert_eq!(counts, [(1, true), (1, true), (2, true)], "{:?}", read.remarks);
    // More of them step back than not: that is no clock.
    let back: Vec<_> = (0..9).map(|k| (-5 * k, 0.0, 0.0)).collect();
    let told = refused(&file(&folder, "back.mcap", &recorded("/raw/input", &back)));
    assert!(told.contains("back.mcap: 8 of 9 stamps step back"), "{told}");
    // One that leaps ahead takes none of those behind it along.
    let mut leap: Vec<_> = (0..9).map(|k| (5 * k, f64::from(k as i32) * 1e-3, 0.0)).collect();
    leap[4].0 = 60_000;
    let read = load_recording(&file(&folder, "leap.mcap", &recorded("/raw/input", &leap))).unwrap();
    assert_eq!((points(&read).len(), read.remarks[0].count), (8, 1), "{:?}", read.remarks);
    // The note of a set.
    let set = DataSet::load(folder.path(), &Split::All, false).unwrap();
    assert!(set.remarks().iter().any(|line| line.starts_with("odd.mcap: 1 samples step back")), "{set:?}");
}

#[test]
fn files_of_other_programs_are_told_by_their_topics() {
    let folder = tempfile::tempdir().unwrap();
    let told = refused(&file(&folder, "theirs.mcap", &recorded("/camera", &[(0, 0.0, 0.0)])));
    assert!(told.contains("none of its topics (/camera) is one of `foretrace record`"), "{told}");
    assert!(!told.contains("while the pen writes"), "{told}");
    let told = refused(&file(&folder, "ticks.mcap", &recorded("/raw/tick", &[(0, 0.0, 0.0)])));
    assert!(told.contains("no topic /raw/input") && told.contains("/raw/tick"), "{told}");
    let told = refused(&file(&folder, "one.mcap", &recorded("/raw/input", &[(0, 0.0, 0.0)])));
    assert!(told.contains("it holds 1 pen samples") && told.contains("while the pen writes"), "{told}");
}

#[test]
fn files_of_other_kinds_are_told_by_their_contents() {
    let folder = tempfile::tempdir().unwrap();
    let pointer = b"version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 12345\n";
    let mut tar = vec![b'x'; 512];
    tar[257..262].copy_from_slice(b"ustar");
    let cases: [(&[u8], &str); 14] = [
        (pointer, "a Git LFS pointer"),
        (b"", "it is empty"),
        (b"#ROSBAG V2.0\nE\0\0\0", "a bag of ROS 1"),
        (b"SQLite format 3\0\x10\0", "rosbag2"),
        (b"\x1f\x8b\x08\0\0\0", "gzip"),
        (b"\x28\xb5\x2f\xfd\0\0\0\0", "zstd as a whole"),
        (b"\x04\x22\x4d\x18\0\0\0\0", "lz4 as a whole"),
        (b"PK\x03\x04\0\0", "a ZIP archive"),
        (b"\x89HDF\r\n\x1a\n\0\0", "an HDF5 file"),
        (&tar, "a tar archive"),
        (b"<!DOCTYPE html>\n<html><body>Sign in</body></html>", "a web page"),
        (b"{\"version\": 1}", "JSON"),
        (&[0; 600], "zeros"),
        (b"\x89MCAP0\n\x01\0", "text mode"),
    ];
    let settings = foretrace_config::Config::preset("ur5").unwrap();
    for (bytes, words) in cases {
        // Whatever it is called.
        for name in ["a.mcap", "a.csv", "a.inkml", "a.dat", "a.mat", "a.bin"] {
            let told = refused(&file(&folder, name, bytes));
            assert!(told.contains(words) && told.contains(name) && told.contains("; "), "{name}: {told}");
            let path = folder.path().join(name).display().to_string();
            let told = load(&[path], &PathOptions::default(), settings.settings()).unwrap_err().to_string();
            assert!(told.contains(words), "{name}: {told}");
            std::fs::remove_file(folder.path().join(name)).unwrap();
        }
        // A set of such files only.
        file(&folder, "a.bin", bytes);
        let told = DataSet::load(folder.path(), &Split::All, false).unwrap_err().to_string();
        assert!(bytes.is_empty() || (told.contains("a.bin: it ") && told.contains(words)), "{told}");
        std::fs::remove_file(folder.path().join("a.bin")).unwrap();
    }
    let told = refused(&file(&folder, "a.mcap", b"t_s,x_m,y_m,contact\n0,0,0,1\n"));
    assert!(!told.contains("MCAP"), "the contents decide: {told}");
    let own = file(&folder, "own.csv", &made::mcap(true));
    let named = load(&[own.display().to_string()], &PathOptions::default(), settings.settings()).unwrap_err();
    assert!(named.to_string().contains("ends in .mcap"), "{named}");
}
