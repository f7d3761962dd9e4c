//! Bytes of a connection to programs: a client sends a program in one piece or in many, and one after the
//! other.
//!
//! A program is what stands from a line that begins with `def` or `sec` to the `end` that closes it; any
//! other line is a program of its own (`stopj(2)`). Only words at the beginning of lines are looked at,
//! because blocks begin and end there; whether the text means something is for `Program::parse` to say.

use super::limits;

/// What a connection has sent and no program has been made of yet.
#[derive(Debug, Default)]
pub struct Uploads {
    /// The beginning of a line.
    line: Vec<u8>,
    /// The lines of a program whose `end` has not come.
    program: String,
    /// Blocks that are open in it.
    open: usize,
}

/// A program longer than a controller takes; the connection that sent it is not worth reading on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("a program longer than {} bytes", limits::TEXT_BYTES)]
pub struct TooLong;

impl Uploads {
    /// Takes what came and gives the programs that are complete with it, in order.
    ///
    /// # Errors
    /// A program or a line is too long. What had come of it is forgotten.
    pub fn take(&mut self, bytes: &[u8]) -> Result<Vec<String>, TooLong> {
        let mut complete = Vec::new();
        for part in bytes.split_inclusive(|&byte| byte == b'\n') {
            if self.line.len().saturating_add(self.program.len()).saturating_add(part.len())
                > limits::TEXT_BYTES
            {
                *self = Self::default();
                return Err(TooLong);
            }
            self.line.extend_from_slice(part);
            if part.ends_with(b"\n") {
                complete.extend(self.end_of_line());
            }
        }
        Ok(complete)
    }

    /// Gives what has come and is not complete, as when the connection ends.
    pub fn finish(&mut self) -> Option<String> {
        let complete = self.end_of_line();
        let open = std::mem::take(&mut self.program);
        self.open = 0;
        complete.or_else(|| Some(open).filter(|text| !text.is_empty()))
    }

    fn end_of_line(&mut self) -> Option<String> {
        let line = String::from_utf8_lossy(&std::mem::take(&mut self.line)).into_owned();
        let code = line.split('#').next().unwrap_or_default().trim();
        let is_letter = |c: char| c.is_ascii_alphanumeric() || c == '_';
        let mut words = code.split(|c| !is_letter(c)).filter(|word| !word.is_empty());
        let first = words.next();
        let opens = match first {
            Some("def" | "sec" | "thread") => true,
            Some("if" | "while") => self.open > 0,
            _ => false,
        };
        // `if x: end` is closed on its own line.
        let closes =
            first == Some("end") || opens && code.ends_with("end") && words.next_back() == Some("end");
        self.open = self.open.saturating_add(usize::from(opens)).saturating_sub(usize::from(closes));
        if self.program.is_empty() && first.is_none() {
            return None;
        }
        self.program += &line;
        (self.open == 0).then(|| std::mem::take(&mut self.program))
    }
}
