//! Set folders made here: words of the split table, folders without one, and everything that is refused.

use crate::made;
use foretrace_sim::data::{DataSet, SetError, Split};
use std::path::Path;

const CSV: &str = "t_s,x_m,y_m,contact\n0,0,0,1\n0.01,0.1,0,1\n";
const BAD_CSV: &str = "t_s,x_m,y_m,contact\n0,0,0,1\n0.01,far,0,1\n";
const INKML: &str = "<ink><trace>1 2,3 4</trace></ink>";
const UNIPEN: &str =
    ".COORD X Y\n.POINTS_PER_SECOND 100\n.WRITER_ID own\n.PEN_DOWN\n1 2\n.SEGMENT CHARACTER 0 ? \"a\"\n";
const DIGITS: &str = ".INCLUDE dene.doc\n.SEGMENT DIGIT 0-1 ? \"4\"\n.COMMENT 4 12 224\n.PEN_DOWN\n 1 2\n 3 \
                      4\n.PEN_UP\n.DT 100\n\
                      .PEN_DOWN\n 5 6\n.PEN_UP\n.DT 100\n.SEGMENT DIGIT 2 ? \"1\"\n.COMMENT 1 7 \
                      3\n.PEN_DOWN\n 7 7\n.PEN_UP\n";

fn folder(files: &[(&str, &str)]) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    for (name, text) in files {
        let file = folder.path().join(name);
        std::fs::create_dir_all(file.parent().unwrap()).unwrap();
        std::fs::write(file, text).unwrap();
    }
    folder
}

fn names(folder: &Path, split: &Split) -> Vec<String> {
    DataSet::load(folder, split, true).unwrap().files.into_iter().map(|f| f.file).collect()
}

fn named(word: &str) -> Split {
    word.parse().unwrap()
}

/// The message without the folder's path.
fn message(folder: &Path, result: Result<DataSet, SetError>) -> String {
    let path = folder.display().to_string();
    result.unwrap_err().to_string().replace(&format!("{path}/"), "").replace(&path, "SET")
}

#[test]
fn any_word_names_a_part_and_all_takes_every_row() {
    let table =
        "writer\tset\tfile\nA\ttrain\tx/b.csv\nB\tvalidation\ta.csv\nC\tfold 3\tx/b.csv\n\tfold 3\tc.dat\n";
    let set = folder(&[
        ("split.tsv", table),
        ("a.csv", CSV),
        ("x/b.csv", CSV),
        ("c.dat", UNIPEN),
        ("d.csv", BAD_CSV),
    ]);
    let set = set.path();
    assert_eq!(DataSet::splits(set).unwrap(), ["train", "validation", "fold 3", "all"]);
    assert_eq!(names(set, &named("validation")), ["a.csv"]);
    assert_eq!(names(set, &named("fold 3")), ["x/b.csv", "c.dat"]);
    // In the order of the table; a file in two parts is loaded once, a file in none not at all.
    assert_eq!(names(set, &named("all")), ["x/b.csv", "a.csv", "c.dat"]);
    let all = DataSet::load(set, &Split::All, true).unwrap();
    let writers: Vec<&str> = all.characters().map(|c| c.writer.as_str()).collect();
    assert_eq!(writers, ["A", "B", "own"]);
    assert_eq!(
        message(set, DataSet::load(set, &Split::test(), false)),
        "SET: no split \"test\"; it has: train, validation, fold 3, all"
    );
}

#[test]
fn a_folder_without_a_table_is_all_its_files_in_order_of_name() {
    let set = folder(&[
        ("z.dat", UNIPEN),
        ("a/b/c.dat", UNIPEN),
        ("a/README.md", "words"),
        ("include/a.dat", UNIPEN),
        (".hidden.dat", UNIPEN),
        ("notes.csv", "name,age\n"),
    ]);
    assert_eq!(DataSet::splits(set.path()).unwrap(), ["all"]);
    assert_eq!(names(set.path(), &Split::All), ["a/b/c.dat", "z.dat"]);
    let refused = message(set.path(), DataSet::load(set.path(), &Split::train(), false));
    assert_eq!(refused, "SET: no split \"train\"; it has: all");
    for (name, text) in [("a.ink", INKML), ("pen.txt", CSV)] {
        let set = folder(&[(name, text), ("LICENCE", "text")]);
        assert_eq!(names(set.path(), &Split::All), [name]);
    }
}

#[test]
fn tables_beside_recordings_are_no_recordings() {
    let set = folder(&[("a.csv", CSV), ("labels.tsv", "file\tlabel\na.csv\tx\n"), ("old/split.tsv", "x\n")]);
    assert_eq!(names(set.path(), &Split::All), ["a.csv"]);
    // By their contents they are.
    let set = folder(&[("a.tsv", &CSV.replace(',', "\t")), ("LABELS.TSV", "file\tlabel\n")]);
    assert_eq!(names(set.path(), &Split::All), ["a.tsv"]);
    // A part's own table is listed nowhere, also where its recordings are a part of the folder's.
    let table = "set\tfile\ntrain\tb.csv\n";
    let set = folder(&[("a.csv", CSV), ("in/b.csv", CSV), ("in/split.tsv", table)]);
    assert_eq!(names(set.path(), &Split::All), ["a.csv", "in/b.csv"]);
}

#[test]
fn a_folder_above_sets_of_one_format_names_them() {
    let table = "set\tfile\ntrain\ta.csv\n";
    let set = folder(&[
        ("one/a.csv", CSV),
        ("one/split.tsv", table),
        ("two/a.csv", CSV),
        ("two/split.tsv", table),
        ("README.md", "words"),
    ]);
    let refused = message(set.path(), DataSet::load(set.path(), &Split::All, false));
    assert!(refused.ends_with("; it holds sets of its own, name one of them: one, two"), "{refused}");
    assert_eq!(names(&set.path().join("two"), &Split::train()), ["a.csv"]);
}

#[test]
fn pendigits_have_their_own_parts_and_writers_of_two_files_stay_apart() {
    let set = folder(&[("p.tes", DIGITS), ("p.tra", DIGITS)]);
    assert_eq!(DataSet::splits(set.path()).unwrap(), ["test", "train", "all"]);
    assert_eq!(names(set.path(), &Split::train()), ["p.tra"]);
    let all = DataSet::load(set.path(), &Split::All, true).unwrap();
    let seen: Vec<_> =
        all.characters().map(|c| (c.label.as_str(), c.writer.as_str(), c.segment_index)).collect();
    assert_eq!(seen, [("4", "tes-12", 0), ("1", "tes-7", 1), ("4", "tra-12", 0), ("1", "tra-7", 1)]);
    let recording = &all.files[0].recording;
    assert_eq!((recording.rate_hz, recording.rate_assumed, recording.units_per_m), (100.0, true, None));
    let four = &recording.segments[0].components;
    assert_eq!((four.len(), &four[1].points, four[1].dt_before_s), (2, &vec![[5.0, 6.0]], Some(0.1)));
    // A table takes precedence over file names.
    let set = folder(&[("p.tra", DIGITS), ("split.tsv", "set\tfile\ndev\tp.tra\n")]);
    assert_eq!(DataSet::splits(set.path()).unwrap(), ["dev", "all"]);
}

#[test]
fn every_part_is_told_whole_and_a_message_names_as_many_as_it_holds() {
    let part = |number: usize| format!("{number:02}{}", "x".repeat(60));
    let rows: String = (0..30).map(|number| format!("{}\ta.csv\n", part(number))).collect();
    let set = folder(&[("a.csv", CSV), ("split.tsv", &format!("set\tfile\n{rows}"))]);
    let parts: Vec<String> = (0..30).map(part).chain(["all".to_owned()]).collect();
    assert_eq!(DataSet::splits(set.path()).unwrap(), parts);
    assert_eq!(names(set.path(), &Split::Named(part(29))), ["a.csv"]);
    let refused = message(set.path(), DataSet::load(set.path(), &Split::Named("y".to_owned()), false));
    let short = |number: usize| part(number)[..40].to_owned();
    assert!(refused.ends_with(&format!("{}, {}, …, all", short(18), short(19))), "{refused}");
}

#[test]
fn one_bad_file_stops_a_set_only_when_strict() {
    let table = "set\tfile\ntrain\tgood.csv\ntrain\tbad.csv\ntrain\tgone.csv\ntrain\todd.bin\n";
    let set = folder(&[("split.tsv", table), ("good.csv", CSV), ("bad.csv", BAD_CSV), ("odd.bin", "\0\0")]);
    let loaded = DataSet::load(set.path(), &Split::train(), false).unwrap();
    let found: Vec<String> = loaded.errors.iter().map(ToString::to_string).collect();
    let path = set.path().display();
    let wanted = [
        format!("{path}/bad.csv:3: x_m is \"far\"; legal: a number in [-100, 100]"),
        format!("{path}/gone.csv: cannot read the file: No such file or directory (os error 2)"),
        format!(
            "{path}/odd.bin: not a recording in a known format; legal: UNIPEN text, InkML, MATLAB v5 (UCI \
             Character \
             Trajectories), CSV with columns of time, x and y, or MCAP of foretrace record"
        ),
    ];
    assert_eq!((loaded.files.len(), found), (1, wanted.to_vec()));
    let strict = message(set.path(), DataSet::load(set.path(), &Split::train(), true));
    assert_eq!(strict, "bad.csv:3: x_m is \"far\"; legal: a number in [-100, 100]");
}

#[test]
fn recordings_of_everything_are_a_set_of_their_pens() {
    let set = folder(&[("split.tsv", "set\tfile\twriter\ntrain\ta.mcap\tanna\ntest\tb.mcap\tbert\n")]);
    let whole = made::mcap(true);
    std::fs::write(set.path().join("a.mcap"), &whole).unwrap();
    std::fs::write(set.path().join("b.mcap"), &whole[..whole.len() - 40]).unwrap();
    let loaded = DataSet::load(set.path(), &Split::train(), true).unwrap();
    let recording = &loaded.files[0].recording;
    assert!((recording.rate_hz - 200.0).abs() < 1e-6, "{} Hz", recording.rate_hz);
    let [character] = &recording.segments[..] else { panic!("{recording:?}") };
    assert_eq!(character.writer, "anna");
    // What did not move on, is no number or out of this world is left out.
    let points: Vec<_> = character.components.iter().map(|c| (c.contact, c.points.len())).collect();
    assert_eq!(points, [(true, 20), (false, 10), (true, 2)]);
    assert_eq!(character.components[0].points[1], [0.001, -0.0005]);
    assert!(character.components[2].dt_before_s.is_some_and(|gap_s| (gap_s - 0.1).abs() < 1e-9));
    let cut = message(set.path(), DataSet::load(set.path(), &named("test"), true));
    assert!(cut.starts_with("b.mcap: ") && cut.contains("record --repair"), "{cut}");
}

#[test]
fn what_is_no_set_is_refused_with_what_would_be() {
    let table = |text: &'static str| [("split.tsv", text)];
    let known = "UNIPEN text, InkML, MATLAB v5 (UCI Character Trajectories), CSV with columns of \
                 time, x and y, or MCAP of foretrace record";
    let cases: [(&[(&str, &str)], String); 9] = [
        (&[], format!("SET: no recording in this folder; a set is a folder of {known}")),
        (&[("a.txt", "hello")], format!("SET: no recording in this folder; a set is a folder of {known}")),
        (
            &[("b.dat", UNIPEN), ("a.inkml", INKML)],
            "SET: more than one format in one folder (UNIPEN: b.dat, InkML: a.inkml); keep one format per \
             folder, \
             or name the files in a split.tsv with the columns set and file"
                .to_owned(),
        ),
        (
            &[("a.csv", BAD_CSV), ("b.csv", "t,x\n")],
            "SET: no readable file in this split (2 refused; first: a.csv:3: x_m is \"far\"; legal: a number \
             in \
             [-100, 100])"
                .to_owned(),
        ),
        (
            &[("a.mat", "x"), ("notes.txt", "")],
            "SET: no readable file in this split (1 refused; first: a.mat: 1 bytes; a MATLAB file begins \
             with 128)"
                .to_owned(),
        ),
        (&table("set\tfile\n"), "SET: no readable file in this split (0 refused)".to_owned()),
        (&table(""), "split.tsv:1: the header must name the columns set and file, found []".to_owned()),
        (
            &table("set\tfile\ntrain\t/etc/passwd\n"),
            "split.tsv:2: file \"/etc/passwd\" is not a path below the set's folder".to_owned(),
        ),
        (
            &[("split.tsv/x", "")],
            "split.tsv: cannot read the split table: a directory, not a regular file".to_owned(),
        ),
    ];
    for (files, wanted) in cases {
        let set = folder(files);
        assert_eq!(message(set.path(), DataSet::load(set.path(), &Split::All, false)), wanted);
    }
    assert_eq!(
        DataSet::load(Path::new("nowhere"), &Split::All, false).unwrap_err().to_string(),
        "nowhere: cannot read the folder: No such file or directory (os error 2); a set is a folder of \
         recordings, \
         with or without a split.tsv"
    );
}

#[test]
fn pipes_and_links_in_circles_do_not_hold_a_loader_up() {
    let set = folder(&[("a.csv", CSV)]);
    std::os::unix::fs::symlink(set.path(), set.path().join("again")).unwrap();
    std::os::unix::fs::symlink("/dev/zero", set.path().join("b.csv")).unwrap();
    std::os::unix::fs::symlink("gone", set.path().join("c.csv")).unwrap();
    assert_eq!(names(set.path(), &Split::All), ["a.csv"]);
    std::fs::write(set.path().join("split.tsv"), "set\tfile\nx\tb.csv\n").unwrap();
    let refused = message(set.path(), DataSet::load(set.path(), &Split::All, true));
    assert_eq!(refused, "b.csv: cannot read the file: not a regular file");
}
