//! Samples from a pipe: one per line, sent when it arrives.
//!
//! Contract: a line is `x_m,y_m,contact`, by commas or blanks, in metres of the pen's plane, contact 0 or 1;
//! its stamp is when it was read. A line that is none is counted and reported once. Ends with the pipe.

use std::fs::File;
use std::io::{self, Read};
use std::os::fd::AsFd;

use foretrace_client::monotonic_now_ns;
use foretrace_sim::path::PathSample;
use rustix::event::{PollFd, PollFlags, Timespec, poll};

use super::Player;
use crate::failure::Failure;
use crate::interrupt::Interrupt;
use crate::output::note;

/// Bytes of the longest line.
const LONGEST: usize = 256;

/// Sends what comes until the pipe ends, `seconds` are over, or the user ends it.
pub(super) fn run(player: &mut Player, seconds: Option<f64>, interrupt: &Interrupt) -> Result<(), Failure> {
    let unreadable =
        |error: io::Error| Failure::failed(format_args!("stdin: {error}"), "give samples by a pipe");
    let mut input = File::from(io::stdin().as_fd().try_clone_to_owned().map_err(unreadable)?);
    let (begin, mut lines) = (monotonic_now_ns(), PipedLines::default());
    let mut buffer = [0; 4096];
    loop {
        let elapsed_s = monotonic_now_ns().saturating_sub(begin) as f64 * 1e-9;
        if interrupt.is_set() || seconds.is_some_and(|seconds| elapsed_s >= seconds) {
            break;
        }
        let mut looked = [PollFd::new(&input, PollFlags::IN)];
        let patience = Timespec { tv_sec: 0, tv_nsec: 50_000_000 };
        if !poll(&mut looked, Some(&patience)).is_ok_and(|ready| ready > 0) {
            player.route.look();
            continue;
        }
        let read = input.read(&mut buffer).map_err(unreadable)?;
        // The last line need not have an end.
        let chunk =
            if read == 0 && lines.has_begun() { b"\n" } else { buffer.get(..read).unwrap_or_default() };
        for line in lines.take(chunk) {
            player.report.seconds = monotonic_now_ns().saturating_sub(begin) as f64 * 1e-9;
            player.take_line(line)?;
        }
        if read == 0 {
            break;
        }
        player.route.look();
    }
    Ok(())
}

impl Player {
    fn take_line(&mut self, line: Result<(u64, String), u64>) -> Result<(), Failure> {
        match line {
            Ok((number, text)) => match sample(&text) {
                Ok(Some(sample)) => self.send(monotonic_now_ns(), &sample)?,
                // A heading.
                Ok(None) if number == 1 => {}
                Ok(None) => self.refuse(&format!("line {number} of stdin is no sample: {text:?}")),
                Err(why) => self.refuse(&format!("line {number} of stdin: {why}")),
            },
            Err(number) => self.refuse(&format!("line {number} of stdin has more than {LONGEST} bytes")),
        }
        Ok(())
    }

    fn refuse(&mut self, why: &str) {
        if self.report.failed == 0 {
            note!("play: {why}; a line is x_m,y_m,contact in metres");
        }
        self.report.failed += 1;
    }
}

/// Whole lines of what comes in chunks.
#[derive(Default)]
struct PipedLines {
    begun: Vec<u8>,
    /// The line that has begun is too long: what comes up to its end belongs to it.
    overlong: bool,
    count: u64,
}

impl PipedLines {
    fn has_begun(&self) -> bool {
        self.overlong || !self.begun.is_empty()
    }

    /// The lines that end in `chunk`, with their numbers; of one that is too long only that.
    fn take(&mut self, chunk: &[u8]) -> Vec<Result<(u64, String), u64>> {
        let mut lines = Vec::new();
        for byte in chunk {
            if *byte != b'\n' {
                self.overlong |= self.begun.len() >= LONGEST;
                if !self.overlong {
                    self.begun.push(*byte);
                }
                continue;
            }
            self.count += 1;
            let begun = std::mem::take(&mut self.begun);
            lines.push(if std::mem::take(&mut self.overlong) {
                Err(self.count)
            } else {
                Ok((self.count, String::from_utf8_lossy(&begun).into_owned()))
            });
        }
        lines
    }
}

/// The sample of a line; `None`: it has no three numbers.
fn sample(line: &str) -> Result<Option<PathSample>, String> {
    let words = line.split(|c: char| c == ',' || c.is_whitespace()).filter(|word| !word.is_empty());
    let numbers: Option<Vec<f64>> = words.map(|word| word.parse().ok()).collect();
    let Some(&[x_m, y_m, contact]) = numbers.as_deref() else { return Ok(None) };
    if contact != 0.0 && contact != 1.0 {
        return Err(format!("contact is {contact}, legal 0 or 1"));
    }
    Ok(Some(PathSample { t_s: 0.0, x_m, y_m, contact: contact == 1.0 }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_is_a_place_and_contact() {
        for line in ["0.01,-0.02,1", " 0.01 -0.02 1 ", "0.01,\t-0.02, 1\r"] {
            let found = sample(line).unwrap().unwrap();
            assert_eq!((found.x_m, found.y_m, found.contact), (0.01, -0.02, true), "{line:?}");
        }
        for none in ["", "x_m,y_m,contact", "1,2", "1,2,1,5", "1;2;1"] {
            assert_eq!(sample(none), Ok(None), "{none:?}");
        }
        assert!(sample("0,0,2").unwrap_err().contains("legal 0 or 1"));
    }

    #[test]
    fn lines_come_whole_from_pieces_and_overlong_ones_are_told() {
        let mut lines = PipedLines::default();
        assert_eq!(lines.take(b"a\nb"), [Ok((1, "a".to_owned()))]);
        assert_eq!(lines.take(b"c\n\n"), [Ok((2, "bc".to_owned())), Ok((3, String::new()))]);
        assert_eq!(lines.take(&[b'x'; 1000]), []);
        assert_eq!(lines.take(b"\nd\n"), [Err(4), Ok((5, "d".to_owned()))]);
        assert_eq!(lines.take(&[b'y'; LONGEST]), []);
        assert!(matches!(&lines.take(b"\n")[..], [Ok((6, text))] if text.len() == LONGEST));
    }
}
