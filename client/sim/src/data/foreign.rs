//! What a file is that is no recording, and what to do about it.
//!
//! Contract: told by the first bytes, which are those of formats in wide use; of the rest nothing is guessed.

use super::decoded;
use std::borrow::Cow;
use std::path::Path;

/// A kind of file: where its first bytes stand, what they are, what it is, what to do.
struct ForeignKind(usize, &'static [u8], &'static str, &'static str);

const UNPACK: &str = "unpack it, and give the file that is in it";
const NOT_OURS: &str = "recordings are those of `foretrace record`: other programs' topics are not read; a pen \
                        path of theirs can be given as CSV with the columns t_s,x_m,y_m,contact";
const AGAIN: &str = "copy or download it again";

const KINDS: &[ForeignKind] = &[
    ForeignKind(
        0,
        b"version https://git-lfs.github.com/spec/",
        "a Git LFS pointer, not the file that it stands for",
        "fetch that with `git lfs pull` in its repository",
    ),
    ForeignKind(
        0,
        b"/annex/objects/",
        "a git-annex pointer, not the file that it stands for",
        "fetch that with `git annex get` in its repository",
    ),
    ForeignKind(0, b"#ROSBAG V", "a bag of ROS 1", NOT_OURS),
    ForeignKind(0, b"SQLite format 3\0", "an SQLite database, such as rosbag2 writes (.db3)", NOT_OURS),
    ForeignKind(0, b"ULog\x01\x12\x35", "a log of PX4 (ULog)", NOT_OURS),
    ForeignKind(0, b"RRF", "a recording of Rerun (.rrd)", NOT_OURS),
    ForeignKind(0, b"\x89HDF\r\n\x1a\n", "an HDF5 file", NOT_OURS),
    ForeignKind(0, b"PAR1", "a Parquet file", NOT_OURS),
    ForeignKind(0, b"ARROW1", "an Arrow file", NOT_OURS),
    ForeignKind(0, b"\x93NUMPY", "a NumPy array", NOT_OURS),
    ForeignKind(0, b"\x1f\x8b", "compressed with gzip as a whole", UNPACK),
    ForeignKind(0, b"\x28\xb5\x2f\xfd", "compressed with zstd as a whole", UNPACK),
    ForeignKind(0, b"\x04\x22\x4d\x18", "compressed with lz4 as a whole", UNPACK),
    ForeignKind(0, b"\xfd7zXZ\0", "compressed with xz as a whole", UNPACK),
    ForeignKind(0, b"BZh", "compressed with bzip2 as a whole", UNPACK),
    ForeignKind(0, b"PK\x03\x04", "a ZIP archive", UNPACK),
    ForeignKind(0, b"PK\x05\x06", "an empty ZIP archive", AGAIN),
    ForeignKind(0, b"7z\xbc\xaf\x27\x1c", "a 7-Zip archive", UNPACK),
    ForeignKind(0, b"Rar!\x1a\x07", "a RAR archive", UNPACK),
    ForeignKind(257, b"ustar", "a tar archive", UNPACK),
    ForeignKind(0, b"\x7fELF", "a program", "give a recording"),
    ForeignKind(0, b"%PDF-", "a PDF document", "give a recording"),
    ForeignKind(0, b"\x89PNG\r\n", "a PNG picture", "give a recording"),
    ForeignKind(0, b"\xff\xd8\xff", "a JPEG picture", "give a recording"),
    // A copy in text mode changes the ends of lines in the mark.
    ForeignKind(
        0,
        b"\x89MCAP0\n",
        "an MCAP file that a copy in text mode has damaged",
        "copy it in binary mode",
    ),
    ForeignKind(
        0,
        b"\x89MCAP0\r\r\n",
        "an MCAP file that a copy in text mode has damaged",
        "copy it in binary mode",
    ),
];

/// What a file of `length` bytes is that begins with `head`, and what to do; `None`: nothing that is known
/// here, or a recording.
pub(crate) fn foreign(head: &[u8], length: u64) -> Option<String> {
    if length == 0 && head.is_empty() {
        return Some(format!("it is empty; {AGAIN}"));
    }
    let unmarked = unmarked(head);
    let head = unmarked.as_ref();
    let begins =
        |ForeignKind(at, mark, ..): &&ForeignKind| head.get(*at..).is_some_and(|head| head.starts_with(mark));
    if let Some(ForeignKind(_, _, what, remedy)) = KINDS.iter().find(begins) {
        return Some(format!("it is {what}; {remedy}"));
    }
    if head.len() >= 16 && head.iter().all(|byte| *byte == 0) {
        return Some(format!(
            "it holds zeros where it begins, as a full disk or a power cut leaves; {AGAIN}"
        ));
    }
    let text = head.trim_ascii_start();
    let tag = |tag: &[u8]| text.get(..tag.len()).is_some_and(|begin| begin.eq_ignore_ascii_case(tag));
    if tag(b"<!doctype html") || tag(b"<html") {
        return Some(
            "it is a web page, perhaps one that says why a download failed; download it again".to_owned(),
        );
    }
    // What follows the bracket is a name, the end, or another value.
    if let [b'{', rest @ ..] = text
        && matches!(rest.trim_ascii_start(), [b'"' | b'}', ..])
    {
        return Some(format!("it is JSON; {NOT_OURS}"));
    }
    None
}

/// The bytes behind a byte order mark, which editors and shells put before a text of any kind; UTF-16 as
/// UTF-8.
fn unmarked(head: &[u8]) -> Cow<'_, [u8]> {
    match head {
        [0xef, 0xbb, 0xbf, rest @ ..] => Cow::Borrowed(rest),
        [0xff, 0xfe, ..] | [0xfe, 0xff, ..] => {
            Cow::Owned(decoded(head).trim_start_matches('\u{feff}').as_bytes().to_vec())
        }
        _ => Cow::Borrowed(head),
    }
}

/// Why a file of `length` bytes that begins with `head` is no MCAP file, and what to do; `None`: it is one.
pub(super) fn not_mcap(head: &[u8], length: u64) -> Option<String> {
    if head.starts_with(mcap::MAGIC) {
        return None;
    }
    if let Some(known) = foreign(head, length) {
        return Some(known);
    }
    const GIVE: &str = "give a file of `foretrace record`";
    if mcap::MAGIC.starts_with(head) {
        return Some(format!("its {length} bytes are too short for an MCAP file; {AGAIN}"));
    }
    if let [0x89, b'M', b'C', b'A', b'P', version, b'\r', b'\n', ..] = head {
        let version = char::from(*version).escape_default();
        return Some(format!("it is an MCAP file of version {version}, and 0 is read; {GIVE}"));
    }
    let text = String::from_utf8_lossy(head);
    let text = text.trim_start_matches('\u{feff}').trim_start();
    let first =
        text.lines().find(|line| !line.trim().is_empty() && !line.starts_with('#')).unwrap_or_default();
    let pen = match () {
        () if head.starts_with(b"MATLAB ") => "a MATLAB file",
        () if text.starts_with("<ink") || (text.starts_with("<?xml") && text.contains("<ink")) => "InkML",
        () if text.lines().any(|line| line.starts_with(".PEN_DOWN") || line.starts_with(".COORD")) => {
            "UNIPEN"
        }
        () if first.contains(',') && first.bytes().all(|byte| byte.is_ascii_graphic() || byte == b' ') => {
            "CSV"
        }
        () => return Some(format!("it does not begin as an MCAP file; {GIVE}")),
    };
    Some(format!(
        "it does not begin as an MCAP file but as {pen}; `foretrace play` and `foretrace lab` read pens of that \
         kind, here {GIVE}"
    ))
}

/// What to do where a recording was meant, and `folder` is a folder.
#[must_use]
pub fn folder_for_file(folder: &Path) -> String {
    let mut files: Vec<_> = std::fs::read_dir(folder).into_iter().flatten().take(1000).flatten().collect();
    files.sort_by_key(std::fs::DirEntry::file_name);
    let mcap = files
        .iter()
        .map(std::fs::DirEntry::path)
        .find(|file| file.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("mcap")));
    match mcap {
        Some(file) => format!("it is a folder; give a file, for example {}", file.display()),
        None => "it is a folder, without an .mcap file; give a file of `foretrace record`".to_owned(),
    }
}
