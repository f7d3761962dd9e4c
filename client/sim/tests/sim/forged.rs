//! Recordings of every format that were forged: each is refused with a sentence, or read, in little memory
//! and time.

use crate::forging::read_forged;
use crate::made::{self, Mat};
use crate::rewriting::{Layout, rewritten};
use foretrace_sim::data::{DataSet, Split, load_recording, parse_mcap_record};

/// A file of the greatest size that these tests forge takes a hundredth of it as it is.
const MIB: u64 = 1024;

#[test]
fn forged_recordings_are_refused_with_a_sentence() {
    let unipen = ".COORD X Y\n.POINTS_PER_SECOND 200\n.X_POINTS_PER_MM 10\n.Y_POINTS_PER_MM 10\n.PEN_DOWN\n1 2\n\
                  3 4\n.PEN_UP\n.DT 40\n.PEN_DOWN\n7 8\n9 9\n.SEGMENT CHARACTER 0:0,3 ? \"a\"\n.INCLUDE a.doc\n";
    let inkml = "<?xml version=\"1.0\"?><ink><traceGroup xml:id=\"g\"><annotation type=\"truth\">a</annotation>\
                 <trace>1125 18432,'23'43,\"7\"-8,3-5</trace></traceGroup><traceView traceDataRef=\"#g\"/></ink>";
    let csv = "t_s,x_m,y_m,contact\n0,0.1,0.2,1\n0.01,0.3,0.4,1\n0.02,0.3,0.4,0\n";
    let [little, big] = [false, true].map(|big_endian| Mat { big_endian });
    let mut seeds: Vec<Vec<u8>> = [unipen, inkml, csv].map(|text| text.into()).into();
    seeds.extend([little.train_file(false), big.train_file(false), little.train_file(true)]);
    seeds.extend([made::mcap(false), made::mcap(true)]);
    // Without checksums, so that damage reaches the decoders.
    for compression in [&["zstd"], &["lz4"]] {
        let layout = Layout { sums: false, compression, ..Layout::default() };
        seeds.push(rewritten(&made::mcap(true), &layout));
    }
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("a.doc"), ".PEN_UP\n4 4\n").unwrap();
    // The contents decide; where they do not tell, the name.
    let files = ["a.dat", "a.inkml", "a.mat", "a.csv", "a.mcap"].map(|name| folder.path().join(name));
    let mut which = 0;
    read_forged("forged::forged_recordings_are_refused_with_a_sentence", MIB, &seeds, |bytes| {
        which = (which + 1) % files.len();
        std::fs::write(&files[which], bytes).unwrap();
        if let Err(error) = load_recording(&files[which]) {
            let message = error.to_string();
            assert!(
                message.contains("/a.") && message.len() < 2000,
                "{} bytes: {message:.300}",
                message.len()
            );
        }
        // As records, whatever the container.
        if let Some((kind, body)) = bytes.split_first()
            && let Err(message) = parse_mcap_record(kind % 17, body)
        {
            assert!(message.len() < 2000, "{message:.300}");
        }
    });
}

#[test]
fn forged_tables_of_a_set_are_refused_with_a_sentence() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("a.csv"), "t_s,x_m,y_m,contact\n0,0,0,1\n0.01,0,0,1\n").unwrap();
    let seeds = ["set\twriter\tfile\ntrain\tA\ta.csv\ntest\tB\tb.csv\n", "file\tset\r\na.csv\tfold 1\r\n"];
    let seeds = seeds.map(|text| text.as_bytes().to_vec());
    read_forged("forged::forged_tables_of_a_set_are_refused_with_a_sentence", MIB, &seeds, |bytes| {
        std::fs::write(folder.path().join("split.tsv"), bytes).unwrap();
        if let Err(error) = DataSet::load(folder.path(), &Split::All, false) {
            assert!(error.to_string().len() < 20_000);
        }
    });
}

#[test]
fn files_without_an_end_and_files_of_a_gigabyte_are_refused_before_they_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    assert!(std::process::Command::new("mkfifo").arg(path("pipe.csv")).status().unwrap().success());
    std::os::unix::fs::symlink("/dev/zero", path("zero.dat")).unwrap();
    for extension in ["csv", "dat", "inkml", "mat"] {
        let large = std::fs::File::create(path(&format!("large.{extension}"))).unwrap();
        large.set_len(1 << 40).unwrap();
    }
    for (name, message) in [
        ("pipe.csv", "not a regular file"),
        ("zero.dat", "not a regular file"),
        ("large.csv", "1099511627776 bytes"),
        ("large.dat", "1099511627776 bytes"),
        ("large.inkml", "1099511627776 bytes"),
        ("large.mat", "1099511627776 bytes"),
    ] {
        let error = load_recording(&path(name)).unwrap_err().to_string();
        assert!(error.contains(message), "{name}: {error}");
    }
}
