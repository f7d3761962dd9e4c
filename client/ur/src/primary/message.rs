//! Robot messages (package type 20): version, text, codes, run-time errors of programs.

use crate::rtde::value::take;

#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RobotMessage {
    /// \[µs\]
    pub timestamp_us: u64,
    /// −1 for none in particular, −2 safety, −3 … of other units (guide).
    pub source: i8,
    pub content: MessageContent,
}

/// What a message says, by its kind.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum MessageContent {
    /// 0: `textmsg` of a program.
    Text(String),
    /// 3: first on every connection.
    Version {
        /// `URControl`
        project: String,
        major: u8,
        minor: u8,
        bugfix: i32,
        build: i32,
        /// Date of the build.
        date: String,
    },
    /// 6: a code, as C153A0.
    Code {
        /// The number behind the C.
        code: i32,
        /// The number behind the A.
        argument: i32,
        /// 0 debug, 1 information, 2 warning, 3 violation, 4 fault.
        level: i32,
        text: String,
    },
    /// 7: what happened to a program: `PROGRAM_XXX_STARTED` and the like.
    Key {
        /// A code, or 0.
        code: i32,
        argument: i32,
        title: String,
        /// Name of the program.
        text: String,
    },
    /// 10: a program ended by an error.
    RuntimeException {
        /// From 1.
        line: i32,
        /// From 1.
        column: i32,
        text: String,
    },
    /// Another kind, passed over.
    Other(u8),
}

impl RobotMessage {
    pub(super) fn payload(&self) -> Vec<u8> {
        let mut b = self.timestamp_us.to_be_bytes().to_vec();
        b.extend_from_slice(&self.source.to_be_bytes());
        let integers = |b: &mut Vec<u8>, numbers: &[i32]| {
            numbers.iter().for_each(|number| b.extend_from_slice(&number.to_be_bytes()));
        };
        match &self.content {
            MessageContent::Text(text) => {
                b.push(0);
                b.extend_from_slice(text.as_bytes());
            }
            MessageContent::Version { project, major, minor, bugfix, build, date } => {
                b.push(3);
                // The length is signed in some clients.
                let project = project.get(..project.len().min(127)).unwrap_or("");
                b.push(u8::try_from(project.len()).unwrap_or(0));
                b.extend_from_slice(project.as_bytes());
                b.extend_from_slice(&[*major, *minor]);
                integers(&mut b, &[*bugfix, *build]);
                b.extend_from_slice(date.as_bytes());
            }
            MessageContent::Code { code, argument, level, text } => {
                b.push(6);
                // Type and value of the data that a code may have: none.
                integers(&mut b, &[*code, *argument, *level, 0, 0]);
                b.extend_from_slice(text.as_bytes());
            }
            MessageContent::Key { code, argument, title, text } => {
                b.push(7);
                integers(&mut b, &[*code, *argument]);
                let title = title.get(..title.len().min(255)).unwrap_or("");
                b.push(u8::try_from(title.len()).unwrap_or(0));
                b.extend_from_slice(title.as_bytes());
                b.extend_from_slice(text.as_bytes());
            }
            MessageContent::RuntimeException { line, column, text } => {
                b.push(10);
                integers(&mut b, &[*line, *column]);
                b.extend_from_slice(text.as_bytes());
            }
            MessageContent::Other(kind) => b.push(*kind),
        }
        b
    }

    pub(super) fn decode(mut payload: &[u8]) -> Option<Self> {
        let rest = &mut payload;
        let timestamp_us = take(rest).map(u64::from_be_bytes)?;
        let source = take(rest).map(i8::from_be_bytes)?;
        let [kind] = take(rest)?;
        let content = match kind {
            0 => MessageContent::Text(text(rest)),
            3 => {
                let project = counted(rest)?;
                let [major, minor] = take(rest)?;
                let (bugfix, build) = (integer(rest)?, integer(rest)?);
                MessageContent::Version { project, major, minor, bugfix, build, date: text(rest) }
            }
            6 => {
                let (code, argument, level) = (integer(rest)?, integer(rest)?, integer(rest)?);
                integer(rest)?;
                integer(rest)?;
                MessageContent::Code { code, argument, level, text: text(rest) }
            }
            7 => {
                let (code, argument) = (integer(rest)?, integer(rest)?);
                MessageContent::Key { code, argument, title: counted(rest)?, text: text(rest) }
            }
            10 => {
                let (line, column) = (integer(rest)?, integer(rest)?);
                MessageContent::RuntimeException { line, column, text: text(rest) }
            }
            kind => MessageContent::Other(kind),
        };
        Some(Self { timestamp_us, source, content })
    }
}

fn integer(bytes: &mut &[u8]) -> Option<i32> {
    take(bytes).map(i32::from_be_bytes)
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// A string behind a byte with its length.
fn counted(bytes: &mut &[u8]) -> Option<String> {
    let [length] = take(bytes)?;
    let (string, rest) = bytes.split_at_checked(usize::from(length))?;
    *bytes = rest;
    Some(text(string))
}
