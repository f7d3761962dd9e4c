//! A blocking RTDE client: set up recipes, receive the newest output package, send input packages.
//!
//! Contract: every wait is bounded. After an error other than [`RtdeError::NotFound`], [`RtdeError::InUse`]
//! and [`RtdeError::Misfit`] the connection is of no use any more. Messages are passed over.

use std::io::{ErrorKind, Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::time::{Duration, Instant};

use super::frames::{Frames, RtdeWireError};
use super::recipe::{Misfit, RtdeRecipe};
use super::value::RtdeValue;
use super::wire::{ControllerVersion, FieldAnswer, ProtocolVersion, RtdeReply, RtdeRequest};

/// Most packages that are passed over while waiting for a reply.
const MOST_PASSED: usize = 10_000;
/// Bytes that are read at once.
const PIECE: usize = 16_384;

/// Why RTDE does not go on.
#[derive(Debug, thiserror::Error)]
pub enum RtdeError {
    /// No connection; the kind tells refusal from silence.
    #[error("no connection to RTDE: {0}")]
    Connect(std::io::Error),
    /// The connection broke.
    #[error("the RTDE connection broke: {0}")]
    Broken(std::io::Error),
    /// It was closed from the other side.
    #[error("the controller closed the RTDE connection")]
    Closed,
    /// No reply in time.
    #[error("RTDE gave no reply within {0:?}")]
    Silent(Duration),
    /// What came is not RTDE.
    #[error("not RTDE: {0}")]
    Wire(#[from] RtdeWireError),
    /// The controller knows no version of the protocol that this client knows.
    #[error("the controller takes neither version 2 nor version 1 of the protocol")]
    Protocol,
    /// A field that this version of the controller does not have.
    #[error("the controller has no field {0:?}")]
    NotFound(String),
    /// An input that another client or a fieldbus owns.
    #[error("the input {0:?} is in use by another client or a fieldbus adapter")]
    InUse(String),
    /// The controller refused without a reason.
    #[error("the controller refused: {0}")]
    Refused(&'static str),
    /// Values that do not fit their recipe.
    #[error("{0}")]
    Misfit(#[from] Misfit),
}

/// Inputs that were set up, for [`RtdeClient::send`].
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct InputRecipe(RtdeRecipe);

#[derive(Debug, Clone, PartialEq)]
pub struct OutputPackage {
    /// In the order in which the outputs were set up.
    pub values: Vec<RtdeValue>,
    /// Older packages that came with it and were passed over.
    pub passed: usize,
}

/// A connection to RTDE.
#[derive(Debug)]
pub struct RtdeClient {
    stream: TcpStream,
    frames: Frames,
    piece: Vec<u8>,
    version: ProtocolVersion,
    outputs: Option<RtdeRecipe>,
    patience: Duration,
}

impl RtdeClient {
    /// Connects and agrees on version 2 of the protocol, else 1. `patience` bounds this and every reply.
    ///
    /// # Errors
    ///
    /// See [`RtdeError`].
    pub fn connect(address: SocketAddr, patience: Duration) -> Result<Self, RtdeError> {
        let stream = crate::connect(address, patience).map_err(RtdeError::Connect)?;
        let mut client = Self {
            stream,
            frames: Frames::default(),
            piece: vec![0; PIECE],
            version: ProtocolVersion::V1,
            outputs: None,
            patience,
        };
        for version in [ProtocolVersion::V2, ProtocolVersion::V1] {
            client.ask(&RtdeRequest::Protocol(version.number()))?;
            let accepted =
                |reply| if let RtdeReply::Protocol(accepted) = reply { Some(accepted) } else { None };
            if client.reply(accepted)? {
                client.version = version;
                return Ok(client);
            }
        }
        Err(RtdeError::Protocol)
    }

    /// Version of the protocol that was agreed on.
    #[must_use]
    pub const fn protocol(&self) -> ProtocolVersion {
        self.version
    }

    /// The controller's version.
    ///
    /// # Errors
    ///
    /// See [`RtdeError`].
    pub fn controller_version(&mut self) -> Result<ControllerVersion, RtdeError> {
        self.ask(&RtdeRequest::ControllerVersion)?;
        self.reply(
            |reply| if let RtdeReply::ControllerVersion(version) = reply { Some(version) } else { None },
        )
    }

    /// Sets up the outputs, in place of those before, at `frequency_hz` (the control rate in version 1).
    ///
    /// # Errors
    ///
    /// [`RtdeError::NotFound`] with the first such field; see [`RtdeError`].
    pub fn set_up_outputs(&mut self, names: &[&str], frequency_hz: f64) -> Result<(), RtdeError> {
        self.outputs = None;
        let owned = names.iter().map(|name| (*name).to_owned()).collect();
        self.ask(&RtdeRequest::Outputs { frequency: Some(frequency_hz), names: owned })?;
        let (recipe, answers) = self.reply(|reply| {
            if let RtdeReply::Outputs { recipe, answers } = reply { Some((recipe, answers)) } else { None }
        })?;
        let id = if self.version == ProtocolVersion::V1 { None } else { Some(recipe.unwrap_or(0)) };
        self.outputs = Some(agreed(names, &answers, id)?);
        Ok(())
    }

    /// Sets up inputs, beside those before.
    ///
    /// # Errors
    ///
    /// [`RtdeError::NotFound`] and [`RtdeError::InUse`] with the first such field; see [`RtdeError`].
    pub fn set_up_inputs(&mut self, names: &[&str]) -> Result<InputRecipe, RtdeError> {
        let owned = names.iter().map(|name| (*name).to_owned()).collect();
        self.ask(&RtdeRequest::Inputs { names: owned })?;
        let (recipe, answers) = self.reply(|reply| {
            if let RtdeReply::Inputs { recipe, answers } = reply { Some((recipe, answers)) } else { None }
        })?;
        agreed(names, &answers, Some(recipe)).map(InputRecipe)
    }

    /// Lets outputs begin.
    ///
    /// # Errors
    ///
    /// See [`RtdeError`].
    pub fn start(&mut self) -> Result<(), RtdeError> {
        self.ask(&RtdeRequest::Start)?;
        let started =
            self.reply(|reply| if let RtdeReply::Start(started) = reply { Some(started) } else { None })?;
        if started { Ok(()) } else { Err(RtdeError::Refused("start")) }
    }

    /// The newest package that has come, waiting for one until `timeout` has gone by; `None` then.
    ///
    /// # Errors
    ///
    /// See [`RtdeError`].
    pub fn receive(&mut self, timeout: Duration) -> Result<Option<OutputPackage>, RtdeError> {
        let end = Instant::now() + timeout;
        let mut newest: Option<OutputPackage> = None;
        let mut full = false;
        loop {
            while let Some(reply) = self.next_reply()? {
                let RtdeReply::Data { recipe, fields } = reply else { continue };
                let Some(outputs) = &self.outputs else { continue };
                // A package of the recipe before, still on its way.
                if recipe.unwrap_or(0) != outputs.id {
                    continue;
                }
                let values = outputs.read(&fields)?;
                let passed = newest.map_or(0, |older| older.passed.saturating_add(1));
                newest = Some(OutputPackage { values, passed });
            }
            let now = Instant::now();
            if now >= end || (newest.is_some() && !full) {
                return Ok(newest);
            }
            // A full piece: a newer package may wait in the socket.
            full = self.read_more(end.duration_since(now))? == PIECE;
        }
    }

    /// Sends one input package.
    ///
    /// # Errors
    ///
    /// [`RtdeError::Misfit`] where `values` are not those of the recipe, else [`RtdeError::Broken`].
    pub fn send(&mut self, inputs: &InputRecipe, values: &[RtdeValue]) -> Result<(), RtdeError> {
        let fields = inputs.0.write(values)?;
        self.ask(&RtdeRequest::Data { recipe: inputs.0.id, fields })
    }

    fn ask(&mut self, request: &RtdeRequest) -> Result<(), RtdeError> {
        let bytes = request.encode(self.version)?;
        self.stream.write_all(&bytes).map_err(RtdeError::Broken)
    }

    /// The next reply that `pick` takes; packages on their way are passed over.
    fn reply<T>(&mut self, pick: impl Fn(RtdeReply) -> Option<T>) -> Result<T, RtdeError> {
        let end = Instant::now() + self.patience;
        for _ in 0..MOST_PASSED {
            while let Some(reply) = self.next_reply()? {
                if let Some(picked) = pick(reply) {
                    return Ok(picked);
                }
            }
            let now = Instant::now();
            if now >= end {
                break;
            }
            self.read_more(end.duration_since(now))?;
        }
        Err(RtdeError::Silent(self.patience))
    }

    /// The next whole package; messages, which repeat what the primary interface tells, are passed over.
    fn next_reply(&mut self) -> Result<Option<RtdeReply>, RtdeError> {
        while let Some((kind, payload)) = self.frames.next_package()? {
            let reply = RtdeReply::decode(kind, payload, self.version)?;
            if !matches!(reply, RtdeReply::Message(_)) {
                return Ok(Some(reply));
            }
        }
        Ok(None)
    }

    /// Reads what is there, waiting for `timeout` at most; how many bytes.
    fn read_more(&mut self, timeout: Duration) -> Result<usize, RtdeError> {
        // No wait at all would be a wait for ever.
        let timeout = timeout.max(Duration::from_micros(100));
        self.stream.set_read_timeout(Some(timeout)).map_err(RtdeError::Broken)?;
        match self.stream.read(&mut self.piece) {
            Ok(0) => Err(RtdeError::Closed),
            Ok(length) => {
                self.frames.feed(self.piece.get(..length).unwrap_or(&[]));
                Ok(length)
            }
            Err(error) => match error.kind() {
                ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted => Ok(0),
                _ => Err(RtdeError::Broken(error)),
            },
        }
    }
}

/// The recipe, if every field has a type. `id` is `None` where the protocol has none.
fn agreed(names: &[&str], answers: &[FieldAnswer], id: Option<u8>) -> Result<RtdeRecipe, RtdeError> {
    let mut types = Vec::with_capacity(answers.len());
    for (name, answer) in names.iter().zip(answers) {
        match answer {
            FieldAnswer::Type(kind) => types.push(*kind),
            FieldAnswer::NotFound => return Err(RtdeError::NotFound((*name).to_owned())),
            FieldAnswer::InUse => return Err(RtdeError::InUse((*name).to_owned())),
        }
    }
    if id == Some(0) || answers.len() != names.len() {
        return Err(RtdeError::Refused("a recipe"));
    }
    Ok(RtdeRecipe { id: id.unwrap_or(0), types })
}

#[cfg(test)]
#[path = "client_tests.rs"]
mod tests;
