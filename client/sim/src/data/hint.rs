//! Files that are no recordings, and those of data sets in a form that is not read: what they are, and what
//! to do.

use super::foreign::foreign;
use foretrace_config::files::shortened_path;
use std::path::Path;

/// What `head`, the first bytes of a file, is, in a sentence that says what to do; `None`: nothing known.
pub(super) fn what_it_is(head: &[u8]) -> Option<String> {
    office(head).or_else(|| foreign(head, head.len() as u64)).or_else(|| written(head))
}

/// Documents of office programs are archives, and may hold ink.
fn office(head: &[u8]) -> Option<String> {
    let within = |part: &[u8]| head.windows(part.len()).any(|window| window == part);
    let office = head.starts_with(b"PK\x03\x04") && [&b"word/"[..], b"ppt/", b"xl/"].into_iter().any(within);
    office.then(|| "it is a document of an office program; export its ink as InkML".to_owned())
}

/// By the first words of a text.
fn written(head: &[u8]) -> Option<String> {
    let text = super::decoded(head);
    let text = text.trim_start_matches('\u{feff}').trim_start();
    if text.contains("<WhiteboardCaptureSession") {
        return Some(
            "it is an XML file of the IAM on-line database, which is not read; convert it to InkML"
                .to_owned(),
        );
    }
    if text.starts_with('<') {
        return Some("it is XML, but not InkML, whose document is <ink>".to_owned());
    }
    // `[Recording]` begins a file of settings, or the text above a table.
    let of_json = |c: char| c.is_ascii_digit() || "{[]\"-".contains(c);
    let lists = |rest: &str| rest.trim_start().starts_with(of_json);
    if text.starts_with('{') || text.strip_prefix('[').is_some_and(lists) {
        return Some("it is JSON, which is not read; write it as CSV with t_s,x_m,y_m,contact".to_owned());
    }
    let (first, second) = (text.lines().next().unwrap_or_default(), text.lines().nth(1));
    let numbers = |line: &str| -> Option<Vec<f64>> {
        let words =
            line.split(|c: char| c == ',' || c == ';' || c.is_whitespace()).filter(|word| !word.is_empty());
        words.map(|word| word.parse().ok()).collect()
    };
    match numbers(first).as_deref() {
        Some([points @ .., digit]) if is_of_eight_points(points, *digit) => Some(
            "it is UCI's pendigits with eight points a digit, which have no times; take pendigits-orig.tra \
             and pendigits-orig.tes of the same set"
                .to_owned(),
        ),
        Some([rows]) if *rows >= 1.0 && second.and_then(numbers).is_some_and(|row| row.len() == 7) => Some(
            "it is a signature of SVC (x y time button azimuth altitude pressure); put the header \
             x,y,t_ms,contact,azimuth,altitude,pressure in place of its first line, and commas between its \
             numbers"
                .to_owned(),
        ),
        Some([_, _, ..]) => {
            Some("it holds numbers without a header; name the columns in the first line, as in t_s,x_m,y_m,contact".to_owned())
        }
        _ if text.lines().any(|line| line.starts_with("WORD ")) && text.contains("NUMSTROKES") => {
            Some("it is a file of UJI pen characters, which have no times; give a set with times".to_owned())
        }
        _ => None,
    }
}

fn is_of_eight_points(points: &[f64], digit: f64) -> bool {
    let legal = points.iter().all(|p| (0.0..=100.0).contains(p));
    points.len() == 16 && legal && (0.0..=9.0).contains(&digit)
}

/// What stands in a folder without recordings: the sets in it, or what its first file is.
pub(super) fn what_is_there(folder: &Path, files: &[String]) -> String {
    /// Files that are looked into, and names in a message.
    const MOST: (usize, usize) = (50, 8);
    let sets: Vec<&str> =
        files.iter().filter_map(|file| file.strip_suffix("/split.tsv")).take(MOST.1).collect();
    if !sets.is_empty() {
        return format!("; it holds sets of its own, name one of them: {}", sets.join(", "));
    }
    let about = |file: &String| {
        let head = super::format::head_of(&folder.join(file)).ok()?;
        let what = what_it_is(&head)?;
        Some(format!("; {}: {what}", shortened_path(file, 100)))
    };
    files.iter().take(MOST.0).find_map(about).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_no_recording_is_named_with_what_to_do() {
        let tar = [&[b'a'; 257][..], b"ustar\0"].concat();
        let cases: [(&[u8], &str); 18] = [
            (b"", "empty"),
            (&[0; 40], "zeros"),
            (b"version https://git-lfs.github.com/spec/v1\noid sha256:1\nsize 2\n", "git lfs pull"),
            (b"/annex/objects/SHA256E-s1--2.dat\n", "git annex get"),
            (b"\x1f\x8b\x08", "gzip"),
            (b"PK\x03\x04 word/document.xml", "export its ink as InkML"),
            (b"PK\x03\x04 a.csv", "ZIP archive"),
            (&tar, "tar archive"),
            (b"\x89HDF\r\n\x1a\n", "HDF5"),
            (b"<!DOCTYPE HTML><html>", "download failed"),
            (b"<?xml?>\n<WhiteboardCaptureSession>", "IAM on-line"),
            (b"<svg/>", "whose document is <ink>"),
            (b" 47,100, 27, 81, 57, 37, 26,  0,  0, 23, 56, 53,100, 90, 40, 98, 8\n", "pendigits-orig.tra"),
            (b"2\n1 2 3 0 5 6 7\n1 2 3 0 5 6 7\n", "SVC"),
            (b"0.0 1.0 2.0\n", "without a header"),
            (b"[{\"x\":1}]", "JSON"),
            (b"[\n  [0, 1]]", "JSON"),
            (b"[ 0.5, 1]", "JSON"),
        ];
        for (head, wanted) in cases {
            let what = what_it_is(head).unwrap_or_default();
            assert!(what.contains(wanted), "{}: {what}", head.escape_ascii());
        }
        assert_eq!(what_it_is(b"some words"), None);
        assert_eq!(what_it_is(b"[Recording]\nDevice=A\n"), None);
    }
}
