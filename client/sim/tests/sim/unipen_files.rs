//! UNIPEN files made here: the grammar, the errors, and hostile bytes.

use foretrace_sim::data::load_recording;
use proptest::prelude::*;
use std::path::{Path, PathBuf};

const HEAD: &str = ".COORD X Y\n.POINTS_PER_SECOND 200\n.X_POINTS_PER_MM 10\n.Y_POINTS_PER_MM 10\n";
const INK: &str =
    ".PEN_DOWN\n1 2\n1 2\n3 4\n.PEN_UP\n.DT 40\n.PEN_UP\n5 6\n.PEN_DOWN\n0 0\n.PEN_DOWN\n7 8\n9 9\n";

/// A set folder with `data/d/a.dat` and files below `include/`.
fn set(dat: &[u8], includes: &[(&str, &str)]) -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("data/d/a.dat");
    std::fs::create_dir_all(file.parent().unwrap()).unwrap();
    std::fs::write(&file, dat).unwrap();
    for (name, text) in includes {
        let path = folder.path().join("include").join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, text).unwrap();
    }
    (folder, file)
}

fn refusal(dat: &str, includes: &[(&str, &str)]) -> String {
    let (_folder, file) = set(dat.as_bytes(), includes);
    let message = load_recording(&file).expect_err("must be refused").to_string();
    assert!(message.contains(".dat") || message.contains(".doc"), "no file named: {message}");
    message
}

#[test]
fn empty_blocks_are_not_counted_and_dummies_are() {
    let dat = ".INCLUDE s/h.doc\n.INCLUDE s/ink.dat\n.SEGMENT CHARACTER 0,1 ? \"\\\"\"\n.SEGMENT CHARACTER \
               2-3:0 OK \"\\\\\"\n";
    let (_folder, file) = set(dat.as_bytes(), &[("s/h.doc", HEAD), ("s/ink.dat", INK)]);
    let r = load_recording(&file).unwrap();
    assert_eq!((r.rate_hz, r.units_per_m), (200.0, Some([1e4, 1e4])));
    let [quote, backslash] = &r.segments[..] else { panic!("{:?}", r.segments) };
    assert_eq!((quote.label.as_str(), backslash.label.as_str()), ("\"", "\\"));
    assert_eq!(quote.components[0].points, [[1.0, 2.0], [1.0, 2.0], [3.0, 4.0]]);
    assert!(!quote.components[1].contact);
    assert_eq!(quote.components[1].dt_before_s, Some(0.04));
    assert!(backslash.components[0].is_dummy());
    assert_eq!(backslash.components[1].points, [[7.0, 8.0]]);
}

#[test]
fn latin_1_labels_are_read() {
    let dat = [HEAD.as_bytes(), INK.as_bytes(), b".SEGMENT CHARACTER 0 ? \"\xe9\"\n"].concat();
    let (_folder, file) = set(&dat, &[]);
    assert_eq!(load_recording(&file).unwrap().segments[0].label, "é");
}

#[test]
fn columns_may_come_in_any_order_and_number() {
    let dat =
        ".COORD T Y Z X\n.POINTS_PER_SECOND 100\n.PEN_DOWN 0 2 9 1 5 4 9 3\n.SEGMENT CHARACTER 0 ? \"a\"\n";
    let (_folder, file) = set(dat.as_bytes(), &[]);
    let r = load_recording(&file).unwrap();
    assert_eq!(r.segments[0].components[0].points, [[1.0, 2.0], [3.0, 4.0]]);
    assert_eq!(r.units_per_m, None);
}

#[test]
fn stamps_of_points_are_the_time_with_and_without_a_rate() {
    let file = |head: &str, rows: &str| {
        format!(
            ".COORD T X Y\n{head}.SEGMENT CHARACTER\n.PEN_DOWN\n{rows}.PEN_UP\n.DT 80\n.PEN_DOWN\n900 0 0\n913 1 1\n"
        )
    };
    let even = "0 0 0\n13 1 0\n26 2 0\n39 3 0\n";
    for head in ["", ".POINTS_PER_SECOND 77\n", ".POINTS_PER_SECOND 200\n"] {
        let (_folder, path) = set(file(head, even).as_bytes(), &[]);
        let r = load_recording(&path).unwrap();
        assert!((r.rate_hz - 77.0).abs() < 0.1 && !r.rate_assumed, "{head}: {}", r.rate_hz);
        let [character] = &r.segments[..] else { panic!("{:?}", r.segments) };
        assert_eq!((character.components.len(), character.components[1].dt_before_s), (2, Some(0.08)));
        assert!(character.components[0].stamps_s.is_empty());
        assert_eq!(r.remarks.len(), usize::from(head.contains("200")), "{:?}", r.remarks);
    }
    let uneven = "0 0 0\n8 1 0\n32 4 0\n32 4 0\n30 9 9\n40 5 0\n64 8 0\n";
    let (_folder, path) = set(file("", uneven).as_bytes(), &[]);
    let r = load_recording(&path).unwrap();
    let first = &r.segments[0].components[0];
    assert_eq!((first.points.len(), first.stamps_s.len(), r.remarks.len()), (5, 5, 2));
    assert!(
        first.even_points(r.rate_hz).windows(2).all(|w| (w[1][0] - w[0][0] - 125.0 / r.rate_hz).abs() < 1e-6)
    );
    // A column that is there and empty is no clock.
    let (_folder, path) = set(
        file("", &even.replace("13 ", "0 ").replace("26 ", "0 ").replace("39 ", "0 "))
            .replace("913", "900")
            .as_bytes(),
        &[],
    );
    let message = load_recording(&path).unwrap_err().to_string();
    assert!(message.contains("no .POINTS_PER_SECOND, and no T in .COORD that rises"), "{message}");
}

#[test]
fn words_are_read_where_there_are_no_characters_and_a_malformed_page_is_passed_over() {
    let dat = format!(
        "{HEAD}{INK}.SEGMENT PAGE x ? \"p\"\n.SEGMENT WORD 0-1 ? \"ab\"\n.SEGMENT WORD 2-3 OK \"c\"\n"
    );
    let (_folder, file) = set(dat.as_bytes(), &[]);
    let r = load_recording(&file).unwrap();
    let labels: Vec<&str> = r.segments.iter().map(|c| c.label.as_str()).collect();
    assert_eq!(labels, ["ab", "c"]);
    assert!(
        refusal(&format!("{HEAD}{INK}.SEGMENT PAGE x ? \"p\"\n"), &[])
            .contains("a.dat:18: malformed segment")
    );
}

fn labels_and_remarks(dat: &str) -> (Vec<String>, Vec<(u64, String)>) {
    let (_folder, file) = set(dat.as_bytes(), &[]);
    let r = load_recording(&file).unwrap();
    let labels = r.segments.iter().map(|c| c.label.clone()).collect();
    (labels, r.remarks.into_iter().map(|remark| (remark.count, remark.what)).collect())
}

#[test]
fn ink_that_is_left_out_is_counted() {
    // Strokes 0 and 3 are ink, 1 is in the air, 2 a place holder.
    for (segments, labels, lost) in [
        (".SEGMENT CHARACTER 0 ? \"a\"\n.SEGMENT WORD 3 ? \"bc\"\n", &["a"][..], 1),
        (".SEGMENT CHARACTER 0 ? \"a\"\n.SEGMENT GLYPH 3 ? \"g\"\n", &["a"], 1),
        (".SEGMENT CHARACTER 0-3 ? \"a\"\n.SEGMENT GLYPH 3 ? \"g\"\n", &["a"], 0),
        (".SEGMENT SYMBOL 0-3 ? \"s\"\n.SEGMENT WORD 0 ? \"w\"\n", &["s"], 0),
    ] {
        let (found, remarks) = labels_and_remarks(&format!("{HEAD}{INK}{segments}"));
        assert_eq!(found, labels, "{segments}");
        assert_eq!(remarks.iter().map(|(count, _)| count).sum::<u64>(), lost, "{segments}: {remarks:?}");
        assert!(remarks.iter().all(|(_, what)| what.contains("belong to no .SEGMENT")), "{remarks:?}");
    }
    let words =
        format!("{HEAD}{INK}.SEGMENT WORD x ? \"no\"\n.SEGMENT PAGE x ? \"p\"\n.SEGMENT WORD 0-3 ? \"b\"\n");
    let (_, remarks) = labels_and_remarks(&words);
    assert_eq!(remarks, [(1, ".SEGMENT lines cannot be read, and are left out".to_owned())]);
}

#[test]
fn segments_below_their_ink_have_the_ink_above() {
    let stroke = ".PEN_DOWN\n1 1\n2 2\n";
    let segment = |label: &str| format!(".SEGMENT CHARACTER ? ? \"{label}\"\n");
    let [x, y] = [segment("x"), segment("y")];
    // The pen in the air behind the last one is not its ink.
    let dat = format!("{HEAD}{stroke}{x}{stroke}{stroke}{y}.PEN_UP\n3 3\n");
    let (_folder, file) = set(dat.as_bytes(), &[]);
    let r = load_recording(&file).unwrap();
    let strokes: Vec<_> = r.segments.iter().map(|c| (c.label.as_str(), c.components.len())).collect();
    assert_eq!((strokes.as_slice(), r.remarks.len()), (&[("x", 1), ("y", 2)][..], 0), "{:?}", r.remarks);
    // Above it they have what follows, and what stands before all is nobody's.
    let (_, remarks) = labels_and_remarks(&format!("{HEAD}{stroke}{x}{stroke}{y}{stroke}"));
    assert_eq!(remarks.iter().map(|(count, _)| *count).collect::<Vec<_>>(), [1]);
}

#[test]
fn a_rate_of_zero_does_no_harm_beside_stamps() {
    let dat = |rate: &str, begin: u64| {
        let rows: String = (0..9).map(|k| format!("{k} 0 {}\n", begin + 5 * k)).collect();
        format!(".COORD X Y T\n.POINTS_PER_SECOND {rate}\n.PEN_DOWN\n{rows}.SEGMENT CHARACTER 0 ? \"a\"\n")
    };
    for rate in ["0", "-1", "x"] {
        let (_folder, file) = set(dat(rate, 0).as_bytes(), &[]);
        let r = load_recording(&file).unwrap();
        assert!((r.rate_hz - 200.0).abs() < 1e-9 && !r.rate_assumed && r.remarks.len() == 1, "{r:?}");
    }
    // Times since 1970 are as fine as others.
    let (_folder, file) = set(dat("x", 1_700_000_000_000).as_bytes(), &[]);
    let rate_hz = load_recording(&file).unwrap().rate_hz;
    assert!((rate_hz - 200.0).abs() < 1e-9, "{rate_hz}");
}

#[test]
fn times_that_do_not_rise_leave_the_points_to_the_stated_rate() {
    for t in [|_| 0, |k: u32| 1000 * (k / 200)] {
        let rows: String = (0..1000).map(|k| format!("{k} 0 {}\n", t(k))).collect();
        let dat =
            format!(".COORD X Y T\n.POINTS_PER_SECOND 200\n.PEN_DOWN\n{rows}.SEGMENT CHARACTER 0 ? \"a\"\n");
        let (_folder, file) = set(dat.as_bytes(), &[]);
        let r = load_recording(&file).unwrap();
        assert_eq!((r.rate_hz, r.segments[0].components[0].points.len(), r.remarks.len()), (200.0, 1000, 1));
    }
}

#[test]
fn a_byte_order_mark_is_no_part_of_the_text() {
    let dat = format!("\u{feff}{HEAD}{INK}.SEGMENT CHARACTER 0-3 ? \"é\"\n").replace('\n', "\r\n");
    let wide: Vec<u8> = dat.encode_utf16().flat_map(u16::to_le_bytes).collect();
    for bytes in [dat.into_bytes(), wide] {
        let (_folder, file) = set(&bytes, &[]);
        let r = load_recording(&file).unwrap();
        assert_eq!((r.segments[0].label.as_str(), r.segments[0].components[0].points.len()), ("é", 3));
    }
    let (_folder, file) = set(
        format!(".INCLUDE h.doc\n{INK}.SEGMENT CHARACTER 0-3 ? \"a\"\n").as_bytes(),
        &[("h.doc", &format!("\u{feff}{HEAD}"))],
    );
    assert_eq!(load_recording(&file).unwrap().rate_hz, 200.0);
}

#[test]
fn a_long_hierarchy_takes_no_longer_than_its_length() {
    // The best of three, because others use the machine too.
    let took = |kinds: usize| {
        let hierarchy: String = (0..kinds).map(|k| format!(" KIND{k}")).collect();
        let segments: String = (0..kinds).map(|k| format!(".SEGMENT KIND{k} 0 ? \"{k}\"\n")).collect();
        let text = format!("{HEAD}.HIERARCHY{hierarchy}\n{INK}{segments}");
        let runs = (0..3).map(|_| {
            let begin = std::time::Instant::now();
            assert_eq!(labels_and_remarks(&text).0, [(kinds - 1).to_string()]);
            begin.elapsed().as_secs_f64()
        });
        runs.fold(f64::INFINITY, f64::min)
    };
    let (short, long) = (took(4_000), took(40_000));
    // Ten times as long; a hundred times where every segment looks through all of it.
    assert!(long < 35.0 * short, "{short} s, {long} s");
}

#[test]
fn the_name_of_an_included_file_is_never_cut() {
    let long = format!("{}/the-name-of-the-file.doc", "a-long-folder/".repeat(20));
    assert!(refusal(&format!(".INCLUDE {long}\n"), &[]).contains("…"));
    assert!(
        refusal(&format!(".INCLUDE {long}\n"), &[]).contains("/the-name-of-the-file.doc\" was not found")
    );
}

#[test]
fn resolution_may_be_stated_per_inch_and_the_writer_anywhere() {
    let dat = ".COORD X Y\n.POINTS_PER_SECOND 100\n.X_POINTS_PER_INCH 508\n.Y_POINTS_PER_INCH 254\n\
               .PEN_DOWN 0 2\n.SEGMENT CHARACTER 0 ? \"a\"\n.WRITER_ID  NAPL4256\n";
    let (_folder, file) = set(dat.as_bytes(), &[]);
    let r = load_recording(&file).unwrap();
    let [x, y] = r.units_per_m.unwrap();
    assert!((x - 20e3).abs() < 1e-6 && (y - 10e3).abs() < 1e-6, "{x} {y}");
    assert_eq!((r.segments[0].writer.as_str(), r.rate_assumed), ("NAPL4256", false));
}

#[test]
fn every_refusal_names_file_line_and_reason() {
    let seg = ".SEGMENT CHARACTER 0 ? \"a\"\n";
    type Case = (String, &'static [(&'static str, &'static str)], &'static str);
    let cases: [Case; 16] = [
        (
            format!(".INCLUDE s/h.doc\n{INK}{seg}"),
            &[("s/h.doc", "version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 1234\n")],
            "h.doc: not UNIPEN: it is a Git LFS pointer",
        ),
        (".INCLUDE s/no.doc\n".into(), &[], "a.dat:1: included file \"s/no.doc\" was not found"),
        (".INCLUDE ../../x\n".into(), &[], "a.dat:1: include \"../../x\" leads out"),
        (
            ".INCLUDE a.doc\n".into(),
            &[("a.doc", "\n.INCLUDE b.doc\n"), ("b.doc", ".INCLUDE a.doc\n")],
            "b.doc:1: include \"a.doc\" is cyclic",
        ),
        (format!("{HEAD}.PEN_DOWN\n1 x2\n{seg}"), &[], "a.dat:6: \"x2\" is not a number"),
        (
            format!("{HEAD}.PEN_DOWN\n1 2\n3\n{seg}"),
            &[],
            "a.dat:7: a point has 2 numbers (.COORD), the line ends after 1",
        ),
        (format!("{HEAD}.PEN_DOWN\n1 1e300\n{seg}"), &[], "a.dat:6: coordinate 1"),
        (format!("{HEAD}.PEN_DOWN\n1 NaN\n{seg}"), &[], "a.dat:6: coordinate NaN is outside"),
        (
            format!("{HEAD}{INK}.SEGMENT CHARACTER 2-9 ? \"a\"\n"),
            &[],
            "a.dat:18: segment out of range: component 9 of 4",
        ),
        (
            format!("{HEAD}{INK}.SEGMENT CHARACTER 0-0:7 ? \"a\"\n"),
            &[],
            "a.dat:18: segment out of range: point 7 of 3",
        ),
        (
            format!("{HEAD}{INK}.SEGMENT CHARACTER 0 ? \"a\n"),
            &[],
            "a.dat:18: malformed segment: the label has no closing quote",
        ),
        (format!("{HEAD}{INK}"), &[], "a.dat: no .SEGMENT line"),
        (format!("{HEAD}{seg}"), &[], "a.dat: no points"),
        (format!(".COORD X Y\n{INK}{seg}"), &[], "a.dat: no .POINTS_PER_SECOND"),
        (format!(".COORD X Y\n.POINTS_PER_SECOND 0\n{INK}{seg}"), &[], "a.dat:2: value 0 is outside"),
        (format!(".POINTS_PER_SECOND 9\n{INK}{seg}"), &[], "a.dat:3: points before .COORD"),
    ];
    for (dat, includes, wanted) in cases {
        let message = refusal(&dat, includes);
        assert!(message.contains(wanted), "{message}\nwanted: {wanted}");
    }
    let missing = load_recording(Path::new("/nonexistent/a.dat")).unwrap_err().to_string();
    assert!(missing.starts_with("/nonexistent/a.dat: cannot read the file"), "{missing}");
    assert!(load_recording(Path::new("/")).is_err() && load_recording(Path::new("/dev/null")).is_err());
}

#[test]
fn includes_that_multiply_end_with_an_error() {
    let twice = |next: usize| format!(".INCLUDE f{next}\n").repeat(3);
    let files: Vec<(String, String)> = (0..14).map(|i| (format!("f{i}"), twice(i + 1))).collect();
    let files: Vec<(&str, &str)> =
        files.iter().map(|(n, t)| (n.as_str(), t.as_str())).chain([("f14", "")]).collect();
    let (_folder, file) = set(b".INCLUDE f0\n", &files);
    assert!(load_recording(&file).unwrap_err().to_string().contains("more than 1000 includes"));
}

fn mutated() -> impl Strategy<Value = Vec<u8>> {
    let good = format!("{HEAD}{INK}.SEGMENT CHARACTER 0-1:0,3 ? \"a\"\n.INCLUDE a.doc\n").into_bytes();
    let edit = (any::<prop::sample::Index>(), 0u8..4, any::<u8>(), 0usize..20);
    prop::collection::vec(edit, 0..8).prop_map(move |edits| {
        let mut text = good.clone();
        for (index, kind, byte, length) in edits {
            let at = index.index(text.len() + 1);
            let end = (at + length).min(text.len());
            match kind {
                0 => text.insert(at, byte),
                1 => drop(text.drain(at..end)),
                2 => text.get_mut(at..).unwrap_or_default().iter_mut().take(1).for_each(|b| *b = byte),
                _ => {
                    let piece = text[at..end].to_vec();
                    text.splice(at..at, piece);
                }
            }
        }
        text
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]

    #[test]
    fn no_bytes_make_the_reader_panic(text in prop_oneof![
        mutated(),
        prop::collection::vec(any::<u8>(), 0..300),
        "(\\.(PEN_DOWN|PEN_UP|DT|COORD X Y|COORD|SEGMENT \
         CHARACTER|POINTS_PER_SECOND|INCLUDE|X_POINTS_PER_MM)[ \n][0-9:,\\-\". \\\\aNn\n]{0,12}\n){0,20}".prop_map(String::into_bytes),
    ]) {
        let (_folder, file) = set(&text, &[("a.doc", ".PEN_UP\n4 4\n")]);
        if let Ok(recording) = load_recording(&file) {
            prop_assert!(recording.rate_hz > 0.0);
            let mut all = recording.segments.iter().flat_map(|c| &c.components);
            prop_assert!(
                all.all(|c| !c.points.is_empty() && c.points.iter().flatten().all(|v| v.is_finite()))
            );
        }
    }
}
