//! Cuts what comes in at ports 30001 to 30003 into programs: from `def` or `sec` to its `end`, or single
//! lines.

/// Longest program \[bytes\], as the interpreter's.
const LONGEST: usize = 1 << 20;

/// Text that has come so far.
#[derive(Debug, Default)]
pub struct ScriptText {
    /// The line that is not at its end yet.
    line: Vec<u8>,
    /// The program that is not at its end yet, and how many `end`s it lacks.
    program: String,
    depth: usize,
}

/// More text than a program may have.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TooLong;

impl ScriptText {
    /// Takes what came; the programs that are whole now.
    ///
    /// # Errors
    ///
    /// [`TooLong`]: the connection is of no use any more.
    pub fn feed(&mut self, bytes: &[u8]) -> Result<Vec<String>, TooLong> {
        let mut programs = Vec::new();
        for byte in bytes {
            if *byte != b'\n' {
                self.line.push(*byte);
                if self.line.len() + self.program.len() > LONGEST {
                    return Err(TooLong);
                }
                continue;
            }
            let line = std::mem::take(&mut self.line);
            let line = String::from_utf8_lossy(&line).into_owned();
            self.take_line(line.trim_end_matches('\r'), &mut programs);
        }
        Ok(programs)
    }

    fn take_line(&mut self, line: &str, programs: &mut Vec<String>) {
        let code = line.split('#').next().unwrap_or("").trim();
        let first = code.split(|c: char| !c.is_ascii_alphanumeric() && c != '_').next().unwrap_or("");
        let opens = match first {
            "def" | "sec" | "thread" | "if" | "while" => code.ends_with(':'),
            _ => false,
        };
        if self.depth == 0 && code.is_empty() {
            return;
        }
        self.program.push_str(line);
        self.program.push('\n');
        if opens {
            self.depth += 1;
        } else if code == "end" {
            self.depth = self.depth.saturating_sub(1);
        }
        if self.depth == 0 {
            programs.push(std::mem::take(&mut self.program));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PROGRAM: &str =
        "def a():\n  # if no end:\n  while True:\n    if 1 < 2: # why\n      sync()\n    end\n  end\nend\n";

    #[test]
    fn programs_and_lines_are_cut_out_of_any_pieces() {
        let text = format!("\nstopj(2)\r\n{PROGRAM}# nothing\n{PROGRAM}set_tcp(p[0,0,0,0,0,0])\ndef b():\n");
        for piece in [1, 7, text.len()] {
            let mut script = ScriptText::default();
            let mut programs = Vec::new();
            for bytes in text.as_bytes().chunks(piece) {
                programs.extend(script.feed(bytes).unwrap());
            }
            assert_eq!(programs, ["stopj(2)\n", PROGRAM, PROGRAM, "set_tcp(p[0,0,0,0,0,0])\n"], "{piece}");
        }
    }

    #[test]
    fn endless_text_is_refused() {
        let mut script = ScriptText::default();
        let refused = (0..100).any(|_| script.feed(&[b'x'; 20_000]).is_err());
        assert!(refused && script.line.len() <= LONGEST + 1);
        let mut script = ScriptText::default();
        let refused = (0..100_000).any(|_| script.feed(b"while True:\n  sync()\n").is_err());
        assert!(refused);
    }
}
