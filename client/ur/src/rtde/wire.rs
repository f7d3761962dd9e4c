//! RTDE packages and their payloads, in both directions.
//!
//! Contract: total, whatever the bytes are. Numbers are big-endian, strings not terminated.

use super::frames::{RtdeWireError, package};
use super::value::{FieldType, take};

const PROTOCOL: u8 = b'V';
const CONTROLLER_VERSION: u8 = b'v';
const MESSAGE: u8 = b'M';
const DATA: u8 = b'U';
const OUTPUTS: u8 = b'O';
const INPUTS: u8 = b'I';
const START: u8 = b'S';
const PAUSE: u8 = b'P';

/// The two versions of the protocol. A connection begins with 1.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ProtocolVersion {
    /// Outputs at the control rate, without a recipe number.
    V1,
    /// Outputs at a frequency of the client's, with one.
    V2,
}

impl ProtocolVersion {
    /// 1 or 2.
    #[must_use]
    pub const fn number(self) -> u16 {
        match self {
            Self::V1 => 1,
            Self::V2 => 2,
        }
    }

    /// The version with this number.
    #[must_use]
    pub const fn from_number(number: u16) -> Option<Self> {
        match number {
            1 => Some(Self::V1),
            2 => Some(Self::V2),
            _ => None,
        }
    }
}

/// The version of a controller's software.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct ControllerVersion {
    /// 3 is CB3, 5 e-Series, 10 PolyScope X.
    pub major: u32,
    pub minor: u32,
    pub bugfix: u32,
    pub build: u32,
}

impl std::fmt::Display for ControllerVersion {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}.{}.{}.{}", self.major, self.minor, self.bugfix, self.build)
    }
}

/// A text message, from either side.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RtdeMessage {
    /// 0 exception, 1 error, 2 warning, 3 information.
    pub level: u8,
    /// What is said; at most 255 bytes in version 2.
    pub text: String,
    /// Who says it; empty in version 1.
    pub source: String,
}

/// What the controller made of a name in a recipe.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FieldAnswer {
    /// The field exists, with this type.
    Type(FieldType),
    /// No such field in this version.
    NotFound,
    /// An input that another connection, or a fieldbus, owns.
    InUse,
}

impl FieldAnswer {
    /// As a reply has it.
    #[must_use]
    pub const fn word(self) -> &'static str {
        match self {
            Self::Type(kind) => kind.word(),
            Self::NotFound => "NOT_FOUND",
            Self::InUse => "IN_USE",
        }
    }

    fn from_word(word: &str) -> Option<Self> {
        match word {
            "NOT_FOUND" => Some(Self::NotFound),
            "IN_USE" => Some(Self::InUse),
            word => FieldType::from_word(word).map(Self::Type),
        }
    }
}

/// From a client to the controller.
#[derive(Debug, Clone, PartialEq)]
pub enum RtdeRequest {
    /// Asks for a version of the protocol, by number.
    Protocol(u16),
    /// Asks for the controller's version.
    ControllerVersion,
    /// A message for the controller's log.
    Message(RtdeMessage),
    /// Sets up the outputs; the frequency \[Hz\] is `None` in version 1.
    Outputs {
        /// \[Hz\]
        frequency: Option<f64>,
        /// Names as they came, an empty last one left out.
        names: Vec<String>,
    },
    Inputs {
        /// Names as they came, an empty last one left out.
        names: Vec<String>,
    },
    Start,
    Pause,
    Data {
        recipe: u8,
        fields: Vec<u8>,
    },
}

/// From the controller to a client.
#[derive(Debug, Clone, PartialEq)]
pub enum RtdeReply {
    /// Whether the version of the protocol is taken.
    Protocol(bool),
    ControllerVersion(ControllerVersion),
    Message(RtdeMessage),
    /// Types of the outputs; the recipe is 0 where one is not possible, and `None` in version 1.
    Outputs {
        /// Number of the recipe.
        recipe: Option<u8>,
        /// In the order of the names.
        answers: Vec<FieldAnswer>,
    },
    /// Types of the inputs; the recipe is 0 where one is not possible.
    Inputs {
        /// Number of the recipe.
        recipe: u8,
        /// In the order of the names.
        answers: Vec<FieldAnswer>,
    },
    Start(bool),
    Pause(bool),
    /// An output package; the recipe is `None` in version 1.
    Data {
        recipe: Option<u8>,
        fields: Vec<u8>,
    },
}

impl RtdeRequest {
    /// As bytes.
    ///
    /// # Errors
    ///
    /// [`RtdeWireError::TooLong`].
    pub fn encode(&self, version: ProtocolVersion) -> Result<Vec<u8>, RtdeWireError> {
        match self {
            Self::Protocol(number) => package(PROTOCOL, &number.to_be_bytes()),
            Self::ControllerVersion => package(CONTROLLER_VERSION, &[]),
            Self::Message(message) => package(MESSAGE, &message.payload(version)),
            Self::Outputs { frequency, names } => {
                let mut payload = Vec::new();
                if version == ProtocolVersion::V2 {
                    payload.extend_from_slice(&frequency.unwrap_or(0.0).to_be_bytes());
                }
                payload.extend_from_slice(names.join(",").as_bytes());
                package(OUTPUTS, &payload)
            }
            Self::Inputs { names } => package(INPUTS, names.join(",").as_bytes()),
            Self::Start => package(START, &[]),
            Self::Pause => package(PAUSE, &[]),
            Self::Data { recipe, fields } => {
                let mut payload = vec![*recipe];
                payload.extend_from_slice(fields);
                package(DATA, &payload)
            }
        }
    }

    /// From the type and payload that `Frames` gave.
    ///
    /// # Errors
    ///
    /// [`RtdeWireError::Type`], [`RtdeWireError::Payload`].
    pub fn decode(kind: u8, payload: &[u8], version: ProtocolVersion) -> Result<Self, RtdeWireError> {
        let wrong = RtdeWireError::Payload(char::from(kind));
        let mut rest = payload;
        let request = match kind {
            PROTOCOL => Self::Protocol(u16::from_be_bytes(take(&mut rest).ok_or(wrong.clone())?)),
            CONTROLLER_VERSION => Self::ControllerVersion,
            MESSAGE => {
                return RtdeMessage::decode(payload, ProtocolVersion::V2).map(Self::Message).ok_or(wrong);
            }
            OUTPUTS => {
                let frequency = match version {
                    ProtocolVersion::V1 => None,
                    ProtocolVersion::V2 => Some(f64::from_be_bytes(take(&mut rest).ok_or(wrong.clone())?)),
                };
                return Ok(Self::Outputs { frequency, names: names(rest) });
            }
            INPUTS => return Ok(Self::Inputs { names: names(rest) }),
            START => Self::Start,
            PAUSE => Self::Pause,
            DATA => {
                let [recipe] = take(&mut rest).ok_or(wrong)?;
                return Ok(Self::Data { recipe, fields: rest.to_vec() });
            }
            other => return Err(RtdeWireError::Type(other)),
        };
        if rest.is_empty() { Ok(request) } else { Err(wrong) }
    }
}

/// Comma-separated; some clients end the list with a comma.
fn names(text: &[u8]) -> Vec<String> {
    let text = String::from_utf8_lossy(text);
    let text = text.strip_suffix(',').unwrap_or(&text);
    if text.is_empty() { Vec::new() } else { text.split(',').map(str::to_owned).collect() }
}

impl RtdeReply {
    /// As bytes.
    ///
    /// # Errors
    ///
    /// [`RtdeWireError::TooLong`].
    pub fn encode(&self, version: ProtocolVersion) -> Result<Vec<u8>, RtdeWireError> {
        let setup = |kind, recipe: Option<u8>, answers: &[FieldAnswer]| {
            let mut payload: Vec<u8> = recipe.into_iter().collect();
            let words: Vec<&str> = answers.iter().map(|answer| answer.word()).collect();
            payload.extend_from_slice(words.join(",").as_bytes());
            package(kind, &payload)
        };
        match self {
            Self::Protocol(accepted) => package(PROTOCOL, &[u8::from(*accepted)]),
            Self::ControllerVersion(ControllerVersion { major, minor, bugfix, build }) => {
                let numbers = [major, minor, bugfix, build].map(|number| number.to_be_bytes());
                package(CONTROLLER_VERSION, numbers.as_flattened())
            }
            Self::Message(message) => package(MESSAGE, &message.payload(version)),
            Self::Outputs { recipe, answers } => setup(OUTPUTS, *recipe, answers),
            Self::Inputs { recipe, answers } => setup(INPUTS, Some(*recipe), answers),
            Self::Start(accepted) => package(START, &[u8::from(*accepted)]),
            Self::Pause(accepted) => package(PAUSE, &[u8::from(*accepted)]),
            Self::Data { recipe, fields } => {
                let mut payload: Vec<u8> = recipe.iter().copied().collect();
                payload.extend_from_slice(fields);
                package(DATA, &payload)
            }
        }
    }

    /// From the type and payload that `Frames` gave.
    ///
    /// # Errors
    ///
    /// [`RtdeWireError::Type`], [`RtdeWireError::Payload`].
    pub fn decode(kind: u8, payload: &[u8], version: ProtocolVersion) -> Result<Self, RtdeWireError> {
        let wrong = RtdeWireError::Payload(char::from(kind));
        let second = version == ProtocolVersion::V2;
        let mut rest = payload;
        let mut byte = |wanted: bool| -> Result<Option<u8>, RtdeWireError> {
            if !wanted {
                return Ok(None);
            }
            let [byte] = take(&mut rest).ok_or(RtdeWireError::Payload(char::from(kind)))?;
            Ok(Some(byte))
        };
        match kind {
            PROTOCOL | START | PAUSE => {
                let accepted = byte(true)? == Some(1);
                Ok(match kind {
                    PROTOCOL => Self::Protocol(accepted),
                    START => Self::Start(accepted),
                    _ => Self::Pause(accepted),
                })
            }
            CONTROLLER_VERSION => {
                let mut number = || take(&mut rest).map(u32::from_be_bytes).ok_or(wrong.clone());
                Ok(Self::ControllerVersion(ControllerVersion {
                    major: number()?,
                    minor: number()?,
                    bugfix: number()?,
                    build: number()?,
                }))
            }
            MESSAGE => RtdeMessage::decode(payload, version).map(Self::Message).ok_or(wrong),
            OUTPUTS => {
                let recipe = byte(second)?;
                Ok(Self::Outputs { recipe, answers: answers(rest).ok_or(wrong)? })
            }
            INPUTS => {
                let recipe = byte(true)?.unwrap_or(0);
                Ok(Self::Inputs { recipe, answers: answers(rest).ok_or(wrong)? })
            }
            DATA => {
                let recipe = byte(second)?;
                Ok(Self::Data { recipe, fields: rest.to_vec() })
            }
            other => Err(RtdeWireError::Type(other)),
        }
    }
}

fn answers(text: &[u8]) -> Option<Vec<FieldAnswer>> {
    names(text).iter().map(|word| FieldAnswer::from_word(word)).collect()
}

impl RtdeMessage {
    fn payload(&self, version: ProtocolVersion) -> Vec<u8> {
        match version {
            ProtocolVersion::V1 => {
                let mut payload = vec![self.level];
                payload.extend_from_slice(self.text.as_bytes());
                payload
            }
            ProtocolVersion::V2 => {
                let mut payload = Vec::new();
                for text in [&self.text, &self.source] {
                    let short = short(text);
                    payload.push(u8::try_from(short.len()).unwrap_or(u8::MAX));
                    payload.extend_from_slice(short.as_bytes());
                }
                payload.push(self.level);
                payload
            }
        }
    }

    fn decode(mut payload: &[u8], version: ProtocolVersion) -> Option<Self> {
        let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
        match version {
            ProtocolVersion::V1 => {
                let [level] = take(&mut payload)?;
                Some(Self { level, text: text(payload), source: String::new() })
            }
            ProtocolVersion::V2 => {
                let mut string = || {
                    let [length] = take(&mut payload)?;
                    let (string, rest) = payload.split_at_checked(usize::from(length))?;
                    payload = rest;
                    Some(text(string))
                };
                let (text, source) = (string()?, string()?);
                let [level] = take(&mut payload)?;
                Some(Self { level, text, source })
            }
        }
    }
}

/// As much of `text` as a length byte can say.
fn short(text: &str) -> &str {
    let mut end = text.len().min(usize::from(u8::MAX));
    while !text.is_char_boundary(end) {
        end -= 1;
    }
    text.get(..end).unwrap_or("")
}

#[cfg(test)]
#[path = "wire_tests.rs"]
mod tests;
