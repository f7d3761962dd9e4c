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
    assert_eq!((points(&wanted).len(), wanted.notes.len()), (32, 0));
    for (name, layout) in layouts() {
        let read = load_recording(&file(&folder, &format!("{name}.mcap"), &rewritten(&own, &layout)));
        let read = read.unwrap_or_else(|error| panic!("{name}: {error}"));
        assert_eq!((&read.segments, &read.notes), (&wanted.segments, &wanted.notes), "{name}");
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
                    assert!(wanted.starts_with(&got), "{name} at {there}");
                    let [note] = &recording.notes[..] else { panic!("{:?}", recording.notes) };
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
    assert!(set.errors.len() == 1 && set.errors[0].to_string().contains("it ends early"), "{:?}", set.errors);
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
    let note = load_recording(&file(&folder, "chunks.mcap", &wrong)).unwrap().notes.join("; ");
    assert!(note.contains("after ") && note.contains("bytes from there on are left out"), "{note}");
    // Without chunks the sum of all data tells.
    let mut wrong = flat.clone();
    wrong[flat.len() / 2] ^= 1;
    match load_recording(&file(&folder, "flat.mcap", &wrong)) {
        Ok(read) => {
            assert!(read.notes.join("; ").contains("the checksum of all before is wrong"), "{:?}", read.notes)
        }
        Err(error) => assert!(error.to_string().contains("ends early"), "{error}"),
    }
    let unknown = [&chunks[..end], &chunk("br", b"packed", true), &chunks[end..]].concat();
    let note = load_recording(&file(&folder, "unknown.mcap", &unknown)).unwrap().notes.join("; ");
    assert!(note.contains(&format!("after {end} bytes: a chunk is compressed with \"br\"")), "{note}");
    // Nothing but such chunks.
    let only = [mcap::MAGIC, &chunk("br", b"packed", true)].concat();
    let told = refused(&file(&folder, "only.mcap", &only));
    for words in ["only.mcap: it has no topic /raw/input", "after 8 bytes", "\"br\"", "write the file anew"] {
        assert!(told.contains(words), "{told}");
    }
    let mut claims = chunks.clone();
    let first = 8 + 9 + 8;
    claims[first + 9 + 16..][..8].copy_from_slice(&(1_u64 << 40).to_le_bytes());
    let told = refused(&file(&folder, "claims.mcap", &claims));
    assert!(told.contains("claims 1099511627776 bytes") && told.contains("134217728 are the most"), "{told}");
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
