//! Every loader against many thousands of mutated files: no panic, no non-finite point, no unbounded memory.
//!
//! Deterministic: the same number of cases is the same cases. FORETRACE_FUZZ_CASES=N runs N cases per format.

use crate::made::{self, Mat};
use foretrace_sim::data::{DataSet, Recording, Split, parse_recording};
use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

const CASES: usize = 10_000;
/// Mutated files never grow beyond this \[bytes\].
const SIZE_MAX: usize = 8192;
/// Far above what the test runner needs, far below what an unbounded reader would take.
const PEAK_MAX_KIB: u64 = 1 << 20;

fn cases() -> usize {
    match std::env::var("FORETRACE_FUZZ_CASES") {
        Ok(text) => text.parse().expect("FORETRACE_FUZZ_CASES must be a whole number"),
        Err(_) => CASES,
    }
}

/// Replacements: bytes and words that are hard for parsers.
const WORDS: [&[u8]; 44] = [
    b"NaN",
    b"inf",
    b"-inf",
    b"1e400",
    b"-",
    b"+",
    b"e",
    b".",
    b"0",
    b"-1",
    b"4294967295",
    b"18446744073709551616",
    b"99999999999999999999999",
    b"\"",
    b"'",
    b"!",
    b"*",
    b"?",
    b",",
    b"#",
    b":",
    b"\n",
    b"\r\n",
    b"\t",
    b"\0",
    b"\xff\xff\xff\xff",
    b"\x7f\xff\xff\xff",
    b"\0\0\0\x80",
    b"\x0e\0\0\0",
    b"\x0f\0\0\0\xff\xff\xff\x7f",
    b"</trace>",
    b"<trace>",
    b"<traceGroup>",
    b"</traceGroup>",
    b"<traceView traceDataRef=\"#g\"/>",
    b"&#0;",
    b".PEN_DOWN\n",
    b".PEN_UP\n",
    b".DT ",
    b".SEGMENT CHARACTER 0-1",
    b".SEGMENT DIGIT 0 ? \"1\"\n",
    b".COORD X Y T\n",
    b".INCLUDE a.doc\n",
    b".POINTS_PER_SECOND ",
];

const NUMBERS: [u32; 12] = [0, 1, 2, 3, 9, 14, 15, 18, 0x0004_0001, 0x0000_ffff, 0x7fff_ffff, 0xffff_ffff];

fn mutate(seeds: &[Vec<u8>], random: &mut Pcg64) -> Vec<u8> {
    let mut file = seeds[random.random_range(0..seeds.len())].clone();
    for _ in 0..random.random_range(1..6) {
        let length = file.len();
        let at = random.random_range(0..=length);
        let end = (at + random.random_range(0..24)).min(length);
        match random.random_range(0..10) {
            0 => file.truncate(at),
            1 => file.drain(at..end).for_each(drop),
            2 => {
                let piece = file[at..end].to_vec();
                let times = random.random_range(1..4);
                file.splice(at..at, piece.repeat(times));
            }
            3 => {
                let other = &seeds[random.random_range(0..seeds.len())];
                let from = random.random_range(0..=other.len());
                let to = (from + random.random_range(0..200)).min(other.len());
                file.splice(at..end, other[from..to].iter().copied());
            }
            4 => {
                let word = WORDS[random.random_range(0..WORDS.len())];
                file.splice(at..end, word.iter().copied());
            }
            5 => {
                let word = WORDS[random.random_range(0..WORDS.len())];
                file.splice(at..at, word.iter().copied());
            }
            6 => file.iter_mut().skip(at).take(1).for_each(|b| *b = random.random()),
            7 => file.iter_mut().skip(at).take(1).for_each(|b| *b ^= 1 << random.random_range(0..8)),
            8 => {
                // A tag, count or class of a binary format.
                let number = NUMBERS[random.random_range(0..NUMBERS.len())];
                file.iter_mut().skip(at / 4 * 4).zip(number.to_le_bytes()).for_each(|(to, from)| *to = from);
            }
            _ => {
                let to = random.random_range(0..=length);
                let piece: Vec<u8> = file.drain(at..end).collect();
                let to = to.min(file.len());
                file.splice(to..to, piece);
            }
        }
        file.truncate(SIZE_MAX);
    }
    file
}

fn check(recording: &Recording, bytes: usize) {
    assert!((1e-3..=1e6).contains(&recording.rate_hz), "rate {}", recording.rate_hz);
    assert!(recording.units_per_m.is_none_or(|u| u.iter().all(|u| *u > 0.0 && u.is_finite())));
    let mut points = 0;
    for character in &recording.segments {
        for component in &character.components {
            assert!(!component.points.is_empty(), "an empty component");
            let stamps = &component.stamps_s;
            assert!(stamps.is_empty() || stamps.len() == component.points.len(), "stamps without points");
            assert!(stamps.windows(2).all(|w| w[0] < w[1]), "stamps that do not rise");
            assert!(component.even_points(recording.rate_hz).iter().flatten().all(|v| v.is_finite()));
            assert!(component.points.iter().flatten().all(|v| v.is_finite()), "a point that is not finite");
            assert!(component.dt_before_s.is_none_or(|gap| gap >= 0.0 && gap.is_finite()), "an illegal gap");
            points += component.points.len();
        }
    }
    // Segments and views may repeat ink, each at the cost of a few bytes.
    assert!(points <= bytes * bytes, "{points} points from {bytes} bytes");
}

fn fuzz(name: &str, seeds: &[Vec<u8>]) {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join(name);
    std::fs::write(folder.path().join("a.doc"), ".PEN_UP\n4 4\n").unwrap();
    for seed in seeds {
        assert!(read(seed, &file), "the seed must be a good file: {}", seed.escape_ascii());
    }
    let mut random = Pcg64::seed_from_u64(1);
    let mut good = 0;
    for case in 0..cases() {
        let bytes = mutate(seeds, &mut random);
        let read = catch_unwind(AssertUnwindSafe(|| read(&bytes, &file)));
        let read = read.unwrap_or_else(|_| panic!("{name}, case {case}: {}", bytes.escape_ascii()));
        good += usize::from(read);
    }
    // Some mutated files must load and some must be refused, or the test proves nothing.
    assert!(good > cases() / 100 && good < cases(), "{name}: {good} of {} files were still good", cases());
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let peak =
        status.lines().find_map(|line| line.strip_prefix("VmHWM:")?.split_whitespace().next()?.parse().ok());
    assert!(peak.is_none_or(|kib: u64| kib < PEAK_MAX_KIB), "{name}: a peak of {peak:?} KiB");
}

/// Whether the bytes are a recording; checks it, or that the refusal names the file.
fn read(bytes: &[u8], file: &Path) -> bool {
    match parse_recording(bytes, file) {
        Ok(recording) => check(&recording, bytes.len()),
        Err(error) => {
            assert!(error.to_string().contains("/a."), "{error}");
            return false;
        }
    }
    true
}

#[test]
fn unipen() {
    let head = ".COORD X Y\n.POINTS_PER_SECOND 200\n.X_POINTS_PER_MM 10\n.Y_POINTS_PER_MM 10\n.WRITER_ID w\n";
    let ink =
        ".PEN_DOWN\n1 2\n1 2\n3 4\n.PEN_UP\n.DT 40\n.PEN_UP\n5 6\n.PEN_DOWN\n0 0\n.PEN_DOWN\n7 8\n9 9\n";
    let unipen = format!(
        "{head}{ink}.SEGMENT CHARACTER 0-1:0,3 ? \"a\\\"\"\n.INCLUDE a.doc\n.SEGMENT CHARACTER 4 OK \"b\"\n"
    );
    let digits = ".INCLUDE dene.doc\n.HIERARCHY DIGIT\n.SEGMENT DIGIT 0-1 ? \"4\"\n.COMMENT 4 12 \
                  224\n.PEN_DOWN\n 1 2\n 3 4\n\
                  .PEN_UP\n.DT 100\n.PEN_DOWN\n 5 6\n.PEN_UP\n.SEGMENT DIGIT 2 ? \"1\"\n.PEN_DOWN\n7 \
                  7\n.PEN_UP\n";
    fuzz("a.dat", &[unipen.into_bytes(), digits.into()]);
}

#[test]
fn inkml() {
    let plain = "<ink><trace>1125 18432,'23'43,\"7\"-8,3-5,7 -3,6 2,6 8,3 6,2 4,*6,3*</trace></ink>";
    let full = r##"<?xml version="1.0" encoding="UTF-8"?>
<i:ink xmlns:i="http://www.w3.org/2003/InkML"><i:annotation type="writer">w&amp;</i:annotation><i:definitions>
<i:inkSource xml:id="s"><i:sampleRate value="100"/><i:traceFormat><i:channel name="X" units="mm"/>
<i:channel name="Y" units="mm" orientation="-ve"/><i:channel name="T" units="ms"/></i:traceFormat></i:inkSource>
<i:context xml:id="c" inkSourceRef="#s"/></i:definitions><!-- c -->
<i:traceGroup xml:id="g" contextRef="#c"><i:annotation type="truth">a</i:annotation><i:trace xml:id="t">1 2 0,3 4 10,'1'1'10
</i:trace><i:trace type="penUp" continuation="end" priorRef="#t">1 2 90</i:trace></i:traceGroup>
<i:traceGroup><i:annotation type="label"><![CDATA[b]]></i:annotation><i:traceView traceDataRef="#t"/>
<i:traceView><i:traceView traceDataRef="#g"></i:traceView></i:traceView></i:traceGroup></i:ink>"##;
    let wide: Vec<u8> =
        std::iter::once(0xfeff).chain(plain.encode_utf16()).flat_map(u16::to_le_bytes).collect();
    fuzz("a.inkml", &[plain.into(), full.into(), full.into(), wide]);
}

#[test]
fn mat() {
    let [little, big] = [false, true].map(|big_endian| Mat { big_endian });
    let consts =
        [("key", little.cells("", &[little.text("", "ab")])), ("charlabels", little.bytes("", &[1]))];
    let letter = little.numbers("", [3, 2], &[1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
    let published = little.file(&[
        little.cells("mixout", &[letter]),
        little.fields("consts", &consts),
        little.fields("none", &[]),
    ]);
    let plain = [little.train_file(false), big.train_file(false), published];
    fuzz("a.mat", &[&plain[..], &[little.train_file(true)]].concat());
    // Damages data before they are compressed, so that the checksum is right.
    let variable = plain[0][128..].to_vec();
    let mut random = Pcg64::seed_from_u64(2);
    for _ in 0..cases() / 4 {
        let bytes = mutate(std::slice::from_ref(&variable), &mut random);
        read(&little.file(&[little.compressed(&bytes)]), Path::new("/a.mat"));
    }
}

#[test]
fn csv() {
    let plain =
        "# note\n\nx_m, t_s,contact,y_m\n0.1,0,1,0.2\n0.3,0.005,false,0.4\n0.3,0.01,1,0.4\n0.3,0.5,1,0.4\n";
    let own = "# foretrace-pen version=1 unit=m rate_hz=200.000        writer=anna\nt_s,x_m,y_m,contact\n\
               0.000000,0.1000000,0.0500000,1\n0.005000,0.1000000,0.0500000,1\n\
               0.010000,0.1000000,0.0500000,0\n";
    let pointer = "type,timeStamp,clientX,clientY,pressure,pointerId\npointerdown,10,1,2,0.1,1\npointermove,18,2,2,0.1,1\n\
                   pointermove,30,2,3,0.1,1\npointerup,38,,,0,1\n";
    let comma = "sep=;\n\"t_ms\";x_mm;y_mm;hover\n0;\"0,1\";0,2;0\n5;0,1;0,2;1\n5;0,1;0,2;1\n17;0,3;0,2;0\n";
    fuzz("a.csv", &[plain.into(), own.into(), pointer.into(), comma.into()]);
}

#[test]
fn mcap() {
    // Without checksums damage reaches what reads the messages.
    fuzz("a.mcap", &[made::mcap(false), made::mcap(false), made::mcap(true)]);
}

#[test]
fn split_tables() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("a.csv"), "t_s,x_m,y_m,contact\n0,0,0,1\n0.01,0,0,1\n").unwrap();
    let seeds: [Vec<u8>; 2] = [
        "set\twriter\tfile\ntrain\tA\ta.csv\ntest\tB\tdata/b.dat\n".into(),
        "file\tset\r\na.csv\tfold 1\r\na.csv\tall\r\n".into(),
    ];
    let mut random = Pcg64::seed_from_u64(3);
    for case in 0..cases() / 20 {
        let table = mutate(&seeds, &mut random);
        std::fs::write(folder.path().join("split.tsv"), &table).unwrap();
        for split in [Split::All, Split::train()] {
            if let Ok(set) = DataSet::load(folder.path(), &split, false) {
                assert!(set.files.len() == 1 && set.files[0].file.ends_with("a.csv"), "case {case}");
            }
        }
    }
}
