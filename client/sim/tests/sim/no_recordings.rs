//! Files that are no recordings, and folders of other things: what they are is said, and what to do.

use foretrace_sim::data::{DataSet, Split, load_recording};
use std::path::PathBuf;

const POINTER: &str = "version https://git-lfs.github.com/spec/v1\noid sha256:4d7a214614ab2935c943f9e0ff69d22eadbb8f32b1258daaa5e2ca24d17e2393\nsize 12345\n";
const UNIPEN: &str =
    ".COORD X Y\n.POINTS_PER_SECOND 100\n.PEN_DOWN\n1 2\n3 4\n.SEGMENT CHARACTER 0 ? \"a\"\n";
const EIGHT_POINTS: &str = " 47,100, 27, 81, 57, 37, 26,  0,  0, 23, 56, 53,100, 90, 40, 98, 8\n";

fn folder(files: &[(&str, &str)]) -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    for (name, text) in files {
        let file = folder.path().join(name);
        std::fs::create_dir_all(file.parent().unwrap()).unwrap();
        std::fs::write(file, text).unwrap();
    }
    let path = folder.path().to_path_buf();
    (folder, path)
}

#[test]
fn a_file_that_is_something_else_says_what_it_is() {
    for (name, text, wanted) in [
        ("a.dat", POINTER, "not UNIPEN: it is a Git LFS pointer"),
        ("a.csv", POINTER, "not CSV: it is a Git LFS pointer"),
        ("a.mat", POINTER, "not MATLAB v5: it is a Git LFS pointer"),
        ("a.txt", POINTER, "not a recording: it is a Git LFS pointer"),
        ("a.inkml", "", "not InkML: it is empty"),
        ("pendigits.tra", EIGHT_POINTS, "take pendigits-orig.tra"),
        ("pendigits.txt", EIGHT_POINTS, "take pendigits-orig.tra"),
    ] {
        let (_folder, path) = folder(&[(name, text)]);
        let message = load_recording(&path.join(name)).unwrap_err().to_string();
        assert!(message.contains(wanted) && message.contains(&format!("/{name}: ")), "{message}");
    }
}

#[test]
fn a_folder_of_something_else_says_what_is_there() {
    for (files, wanted) in [
        (&[("x.txt", EIGHT_POINTS)][..], "; x.txt: it is UCI's pendigits with eight points a digit"),
        (
            &[
                ("a/split.tsv", "set\tfile\n"),
                ("b/split.tsv", ""),
                ("a/a.dat", UNIPEN),
                ("b/b.csv", "t,x,y\n"),
            ],
            "it holds sets of its own",
        ),
        (&[("README.md", "words"), ("a.zip", "PK\u{3}\u{4}")], "; a.zip: it is a ZIP archive; unpack it"),
    ] {
        let (_folder, path) = folder(files);
        let result = DataSet::load(&path, &Split::All, false);
        let message = match result {
            Err(error) => error.to_string(),
            Ok(set) => panic!("{set:?}"),
        };
        assert!(message.contains(wanted), "{message}\nwanted: {wanted}");
    }
    // One pointer among good files is left out with that reason.
    let (_folder, path) = folder(&[("a.dat", UNIPEN), ("b.dat", POINTER)]);
    let set = DataSet::load(&path, &Split::All, false).unwrap();
    assert!(set.files.len() == 1 && set.errors[0].to_string().contains("git lfs pull"), "{:?}", set.errors);
}

#[test]
fn a_byte_order_mark_hides_nothing() {
    let page = "<!DOCTYPE html>\n<html><body>Sign in</body></html>";
    for (text, wanted) in [(POINTER, "it is a Git LFS pointer"), (page, "it is a web page")] {
        let wide: Vec<u8> = format!("\u{feff}{text}").encode_utf16().flat_map(u16::to_le_bytes).collect();
        for bytes in [format!("\u{feff}{text}").into_bytes(), wide] {
            for name in ["a.dat", "a.csv", "a.mcap", "a.inkml", "a.txt"] {
                let (_folder, path) = folder(&[]);
                std::fs::write(path.join(name), &bytes).unwrap();
                let message = load_recording(&path.join(name)).unwrap_err().to_string();
                assert!(message.contains(wanted), "{name}: {message}");
            }
        }
    }
}

#[test]
fn a_split_table_that_is_something_else_says_what_it_is() {
    for (text, wanted) in [
        (POINTER.to_owned(), "split.tsv: cannot read the split table: it is a Git LFS pointer"),
        (format!("\u{feff}{POINTER}"), "it is a Git LFS pointer"),
        ("<html>Sign in</html>".to_owned(), "it is a web page"),
    ] {
        let (_folder, path) = folder(&[("a.dat", UNIPEN), ("split.tsv", &text)]);
        let message = DataSet::load(&path, &Split::All, false).unwrap_err().to_string();
        assert!(message.contains(wanted), "{message}");
    }
}
