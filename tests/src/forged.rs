//! Files that somebody forged, for the tests of every reader of files: the families of a hostile test, drawn
//! from fixed seeds, read in a process with little memory.
//!
//! FORETRACE_FORGED_SECONDS=N goes on for N seconds instead of two; the first cases are always the same.

use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};

/// Longest forged file \[bytes\].
const LONGEST: usize = 6 << 20;
/// Longest time of the processor for one file, which a busy machine does not lengthen: seconds would be told,
/// minutes are a hang.
const PATIENCE: Duration = Duration::from_secs(20);
/// Says in which process a test runs, and where it notes what it is at.
const NOTES: &str = "FORETRACE_FORGED_NOTES";

/// A small generator of numbers (xorshift64*).
struct Draw(u64);

impl Draw {
    /// That of case `number`.
    fn of(number: u64) -> Self {
        Self(number.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1)
    }

    fn next(&mut self) -> u64 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        self.0.wrapping_mul(0x2545_f491_4f6c_dd1d)
    }

    /// A number below `bound`, which is not 0.
    fn below(&mut self, bound: usize) -> usize {
        (self.next() >> 11) as usize % bound.max(1)
    }

    /// A count of up to 2^`bits`, each size as likely as the others.
    fn size(&mut self, bits: usize) -> usize {
        let most = 1 << self.below(bits + 1);
        1 + self.below(most)
    }

    fn of_list<'a, T: ?Sized>(&mut self, list: &[&'a T]) -> &'a T {
        list[self.below(list.len())]
    }
}

/// What opens and closes in the formats that are read.
const NESTS: [[&str; 2]; 14] = [
    ["[", "]"],
    ["{", "}"],
    ["a = [", "]"],
    ["[[", "]]"],
    ["{a = ", "}"],
    ["{\"a\":", "}"],
    ["[{\"a\":[", "]}]"],
    ["<a>", "</a>"],
    ["<link>", "</link>"],
    ["<traceGroup>", "</traceGroup>"],
    ["<ink><trace>", "</trace></ink>"],
    ["<!--", "-->"],
    ["<![CDATA[", "]]>"],
    ["(", ")"],
];
/// What may stand in a row.
const ROWS: [&str; 26] = [
    "]",
    "[",
    "\"",
    "'",
    "<a/>",
    "<!---->",
    "[],",
    "1,",
    "9",
    "\n",
    "\t",
    " ",
    "\0",
    ".",
    "a.",
    "[a]\n",
    "[[a]]\n",
    "a=1\n",
    "-",
    "#",
    "&lt;",
    "&#65;",
    ".INCLUDE a\n",
    ".PEN_DOWN\n1 1\n.PEN_UP\n",
    "<trace>1 1</trace>",
    "1,1,1,1\n",
];
/// What stands where a number stood.
const NUMBERS: [&str; 12] = [
    "NaN",
    "inf",
    "-inf",
    "1e400",
    "-0",
    "1e-320",
    "99999999999999999999",
    "18446744073709551615",
    "4294967296",
    "-1",
    "",
    "0x",
];
/// Claimed lengths, counts and offsets.
const CLAIMS: [u64; 10] =
    [0, 1, 0x7fff_ffff, 0xefff_ffff, 0xffff_ffff, 1 << 32, 1 << 40, 1 << 62, u64::MAX - 7, u64::MAX];

/// Name and bytes of a forged file: one of `seeds`, damaged, or something that has their beginning.
fn forged(draw: &mut Draw, seeds: &[Vec<u8>]) -> (&'static str, Vec<u8>) {
    let mut bytes = seeds[draw.below(seeds.len())].clone();
    let at = draw.below(bytes.len() + 1);
    let family = match draw.below(14) {
        0 => {
            bytes.truncate(at);
            "truncated"
        }
        1 => {
            for _ in 0..draw.size(6) {
                let at = draw.below(bytes.len());
                bytes.iter_mut().skip(at).take(1).for_each(|byte| *byte ^= 1 << draw.below(8));
            }
            "bits flipped"
        }
        2 => {
            for _ in 0..draw.size(3) {
                let (claim, wide) = (CLAIMS[draw.below(CLAIMS.len())].to_le_bytes(), draw.below(2) == 0);
                let at = draw.below(bytes.len());
                let places = bytes.iter_mut().skip(at).take(if wide { 8 } else { 4 });
                places.zip(claim).for_each(|(byte, new)| *byte = new);
            }
            "lengths claimed"
        }
        3 => {
            let [open, close] = NESTS[draw.below(NESTS.len())];
            let depth = draw.size(19);
            let closed = if draw.below(3) == 0 { 0 } else { depth };
            let nested = [open.repeat(depth), close.repeat(closed)].concat();
            bytes.splice(at..at, nested.into_bytes());
            "nested"
        }
        4 => {
            let [open, close] = NESTS[draw.below(NESTS.len())];
            let depth = draw.size(19);
            bytes = [open.repeat(depth), close.repeat(depth)].concat().into_bytes();
            "nested alone"
        }
        5 => {
            let row = draw.of_list(&ROWS).repeat(draw.size(19));
            bytes.splice(at..at, row.into_bytes());
            "in a row"
        }
        6 => {
            let end = (at + draw.size(8)).min(bytes.len());
            let piece = bytes[at.min(end)..end].to_vec();
            let room = LONGEST / piece.len().max(1);
            let times = draw.size(16).min(room);
            bytes.splice(at..at, piece.repeat(times));
            "a piece many times"
        }
        7 => {
            bytes.drain(at..(at + draw.size(10)).min(bytes.len()));
            "a piece lost"
        }
        8 => {
            let other = &seeds[draw.below(seeds.len())];
            let from = draw.below(other.len());
            let piece = other[from..(from + draw.size(12)).min(other.len())].to_vec();
            bytes.splice(at..at, piece);
            "a piece of another"
        }
        9 => {
            for _ in 0..draw.size(3) {
                let Some(digit) = bytes.iter().skip(at).position(u8::is_ascii_digit) else { break };
                let number = draw.of_list(&NUMBERS).bytes();
                bytes.splice(at + digit..=at + digit, number);
            }
            "numbers"
        }
        10 => {
            let mark: &[&[u8]] =
                &[b"\xef\xbb\xbf", b"\xff\xfe", b"\xfe\xff", b"\0", b"\xc3", b"\x80\xbf", b"\r"];
            let at = if draw.below(2) == 0 { 0 } else { at };
            bytes.splice(at..at, draw.of_list(mark).iter().copied());
            "marks of text"
        }
        11 => {
            bytes = bytes.iter().flat_map(|byte| [*byte, 0]).collect();
            bytes.splice(0..0, [0xff, 0xfe]);
            "in two bytes each"
        }
        12 => {
            bytes = (0..draw.size(16)).map(|_| draw.next() as u8).collect();
            "noise"
        }
        _ => {
            bytes.clear();
            "empty"
        }
    };
    bytes.truncate(LONGEST);
    (family, bytes)
}

/// Calls `read` with forged files until the time is up, in a process that has at most `most_mib` of memory.
/// `test` is the test's own full name, of which there is one in its program.
pub(crate) fn read_forged(test: &str, most_mib: u64, seeds: &[Vec<u8>], mut read: impl FnMut(&[u8])) {
    let Some(notes) = std::env::var_os(NOTES) else { return confined(test, most_mib) };
    let seconds =
        std::env::var("FORETRACE_FORGED_SECONDS").map_or(2.0, |text| text.parse().expect("a number"));
    let begin = Instant::now();
    let mut number = 0;
    while begin.elapsed().as_secs_f64() < seconds || number < 300 {
        let (family, bytes) = forged(&mut Draw::of(number), seeds);
        std::fs::write(&notes, format!("case {number}, {family}, {} bytes", bytes.len()))
            .expect("own folder");
        let before = processor_time();
        read(&bytes);
        let took = processor_time() - before;
        assert!(took < PATIENCE, "case {number}, {family}: {took:?} of the processor");
        number += 1;
    }
    println!("forged: {test}: {number} files");
}

/// What all threads of this process have had of the processor.
fn processor_time() -> Duration {
    let stat = std::fs::read_to_string("/proc/self/stat").expect("Linux tells it");
    // The name before these fields, in brackets, may have any letters. utime and stime, in hundredths.
    let (_, fields) = stat.rsplit_once(") ").expect("a name in brackets");
    let ticks = fields.split(' ').skip(11).take(2).map(|ticks| ticks.parse::<u64>().expect("a number"));
    Duration::from_millis(10 * ticks.sum::<u64>())
}

/// Runs the test `test` of this program again, with less memory.
fn confined(test: &str, most_mib: u64) {
    let folder = tempfile::tempdir().expect("a folder");
    let notes = folder.path().join("notes");
    let program = std::env::current_exe().expect("a program");
    let mut command = Command::new("sh");
    command.args(["-c", "ulimit -v \"$0\" && exec \"$@\"", &(most_mib * 1024).to_string()]);
    command.arg(program).args([test, "--exact", "--nocapture", "--test-threads=1"]).env(NOTES, &notes);
    let output = command.output().expect("a shell");
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    let at = read_notes(&notes);
    let wrong = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "{} at {at}\n{said}\n{wrong}", output.status);
    // The harness says the test's name on the same line.
    let told = said.split_once("forged: ").unwrap_or_else(|| panic!("no test is called {test}: {said}"));
    println!("forged: {}", told.1.lines().next().unwrap_or_default());
}

fn read_notes(notes: &Path) -> String {
    std::fs::read_to_string(notes).unwrap_or_else(|_| "its start".to_owned())
}
