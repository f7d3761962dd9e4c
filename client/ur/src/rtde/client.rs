//! A blocking RTDE client: set up recipes, receive the newest output package, send input packages.
//!
//! Contract: every wait is bounded. After an error other than [`RtdeError::NotFound`], [`RtdeError::InUse`]
//! and [`RtdeError::Misfit`] the connection is of no use any more. 64 messages are kept.

use std::collections::VecDeque;
use std::io::{ErrorKind, Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::time::{Duration, Instant};

use super::frames::{Frames, WireError};
use super::recipe::{Misfit, Recipe};
use super::value::Value;
use super::wire::{Answer, ControllerVersion, Message, ProtocolVersion, Reply, Request};

/// Messages that are kept.
const MOST_MESSAGES: usize = 64;
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
    Wire(#[from] WireError),
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

/// Inputs that were set up, for [`Client::send`].
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct InputRecipe(Recipe);

impl InputRecipe {
    /// Number and types.
    #[must_use]
    pub const fn recipe(&self) -> &Recipe {
        &self.0
    }
}

/// An output package.
#[derive(Debug, Clone, PartialEq)]
pub struct Package {
    /// In the order in which the outputs were set up.
    pub values: Vec<Value>,
    /// Older packages that came with it and were passed over.
    pub passed: usize,
}

/// A connection to RTDE.
#[derive(Debug)]
pub struct Client {
    stream: TcpStream,
    frames: Frames,
    piece: Vec<u8>,
    version: ProtocolVersion,
    outputs: Option<Recipe>,
    messages: VecDeque<Message>,
    patience: Duration,
}

impl Client {
    /// Connects and agrees on version 2 of the protocol, else 1. `patience` bounds this and every reply.
    ///
    /// # Errors
    ///
    /// See [`RtdeError`].
    pub fn connect(address: SocketAddr, patience: Duration) -> Result<Self, RtdeError> {
        let stream = TcpStream::connect_timeout(&address, patience).map_err(RtdeError::Connect)?;
        stream.set_nodelay(true).map_err(RtdeError::Connect)?;
        stream.set_write_timeout(Some(patience)).map_err(RtdeError::Connect)?;
        let mut client = Self {
            stream,
            frames: Frames::default(),
            piece: vec![0; PIECE],
            version: ProtocolVersion::V1,
            outputs: None,
            messages: VecDeque::new(),
            patience,
        };
        for version in [ProtocolVersion::V2, ProtocolVersion::V1] {
            client.ask(&Request::Protocol(version.number()))?;
            let accepted = client.reply(|reply| match reply {
                Reply::Protocol(accepted) => Some(accepted),
                _ => None,
            })?;
            if accepted {
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
        self.ask(&Request::ControllerVersion)?;
        self.reply(|reply| match reply {
            Reply::ControllerVersion(version) => Some(version),
            _ => None,
        })
    }

    /// Sets up the outputs, in place of those before, at `frequency_hz` (the control rate in version 1).
    ///
    /// # Errors
    ///
    /// [`RtdeError::NotFound`] with the first such field; see [`RtdeError`].
    pub fn set_up_outputs(&mut self, names: &[&str], frequency_hz: f64) -> Result<(), RtdeError> {
        self.outputs = None;
        let owned = names.iter().map(|name| (*name).to_owned()).collect();
        self.ask(&Request::Outputs { frequency: Some(frequency_hz), names: owned })?;
        let (recipe, answers) = self.reply(|reply| match reply {
            Reply::Outputs { recipe, answers } => Some((recipe, answers)),
            _ => None,
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
        self.ask(&Request::Inputs { names: owned })?;
        let (recipe, answers) = self.reply(|reply| match reply {
            Reply::Inputs { recipe, answers } => Some((recipe, answers)),
            _ => None,
        })?;
        agreed(names, &answers, Some(recipe)).map(InputRecipe)
    }

    /// Lets outputs begin.
    ///
    /// # Errors
    ///
    /// See [`RtdeError`].
    pub fn start(&mut self) -> Result<(), RtdeError> {
        self.ask(&Request::Start)?;
        let started = self.reply(|reply| match reply {
            Reply::Start(accepted) => Some(accepted),
            _ => None,
        })?;
        if started { Ok(()) } else { Err(RtdeError::Refused("start")) }
    }

    /// Lets outputs pause.
    ///
    /// # Errors
    ///
    /// See [`RtdeError`].
    pub fn pause(&mut self) -> Result<(), RtdeError> {
        self.ask(&Request::Pause)?;
        let paused = self.reply(|reply| match reply {
            Reply::Pause(accepted) => Some(accepted),
            _ => None,
        })?;
        if paused { Ok(()) } else { Err(RtdeError::Refused("pause")) }
    }

    /// The newest package that has come, waiting for one until `timeout` has gone by; `None` then.
    ///
    /// # Errors
    ///
    /// See [`RtdeError`].
    pub fn receive(&mut self, timeout: Duration) -> Result<Option<Package>, RtdeError> {
        let end = Instant::now() + timeout;
        let mut newest: Option<Package> = None;
        let mut full = false;
        loop {
            while let Some(reply) = self.next_reply()? {
                let Reply::Data { recipe, fields } = reply else { continue };
                let Some(outputs) = &self.outputs else { continue };
                // A package of the recipe before, still on its way.
                if recipe.unwrap_or(0) != outputs.id {
                    continue;
                }
                let values = outputs.read(&fields)?;
                let passed = newest.map_or(0, |older| older.passed.saturating_add(1));
                newest = Some(Package { values, passed });
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
    pub fn send(&mut self, inputs: &InputRecipe, values: &[Value]) -> Result<(), RtdeError> {
        let fields = inputs.0.write(values)?;
        self.ask(&Request::Data { recipe: inputs.0.id, fields })
    }

    /// The oldest message of the controller that was not taken yet.
    pub fn message(&mut self) -> Option<Message> {
        self.messages.pop_front()
    }

    fn ask(&mut self, request: &Request) -> Result<(), RtdeError> {
        let bytes = request.encode(self.version)?;
        self.stream.write_all(&bytes).map_err(RtdeError::Broken)
    }

    /// The next reply that `pick` takes; packages on their way are passed over.
    fn reply<T>(&mut self, pick: impl Fn(Reply) -> Option<T>) -> Result<T, RtdeError> {
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

    /// The next whole package but messages, which are kept.
    fn next_reply(&mut self) -> Result<Option<Reply>, RtdeError> {
        while let Some((kind, payload)) = self.frames.next_package()? {
            match Reply::decode(kind, payload, self.version)? {
                Reply::Message(message) => {
                    if self.messages.len() == MOST_MESSAGES {
                        self.messages.pop_front();
                    }
                    self.messages.push_back(message);
                }
                reply => return Ok(Some(reply)),
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
fn agreed(names: &[&str], answers: &[Answer], id: Option<u8>) -> Result<Recipe, RtdeError> {
    let mut types = Vec::with_capacity(answers.len());
    for (name, answer) in names.iter().zip(answers) {
        match answer {
            Answer::Type(kind) => types.push(*kind),
            Answer::NotFound => return Err(RtdeError::NotFound((*name).to_owned())),
            Answer::InUse => return Err(RtdeError::InUse((*name).to_owned())),
        }
    }
    if id == Some(0) || answers.len() != names.len() {
        return Err(RtdeError::Refused("a recipe"));
    }
    Ok(Recipe { id: id.unwrap_or(0), types })
}

#[cfg(test)]
#[path = "client_tests.rs"]
mod tests;
