//! RTDE as a client speaks it, as far as the bridge needs: protocol 2, one recipe of outputs, one of inputs.
//!
//! Contract: every size is bounded and every wait ends; what the other side sends is never trusted. All
//! numbers are big-endian.
//!
//! *Source*: RTDE guide of Universal Robots.

use std::io::{ErrorKind, Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::time::{Duration, Instant};

use super::check::Version;

const REQUEST_PROTOCOL: u8 = b'V';
const GET_VERSION: u8 = b'v';
const SETUP_OUTPUTS: u8 = b'O';
const SETUP_INPUTS: u8 = b'I';
const START: u8 = b'S';
const DATA: u8 = b'U';

/// Packages that may come before the answer to a request: data and messages under way.
const PATIENT_PACKAGES: usize = 10_000;
/// Most that is kept unread: a dozen of the largest packages.
const MOST_UNREAD: usize = 1 << 19;

/// Why RTDE did not do what it was asked.
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
    /// No answer in time.
    #[error("RTDE gave no answer within {0:?}")]
    Silent(Duration),
    /// Protocol 2 is refused.
    #[error("the controller does not speak RTDE protocol 2")]
    Protocol,
    /// Not what RTDE sends.
    #[error("this is no RTDE: {0}")]
    Strange(&'static str),
    /// Fields that are not there, or that others hold.
    #[error("RTDE fields: {}", told(not_found, in_use))]
    Fields {
        /// The controller does not know these.
        not_found: Vec<String>,
        /// Other clients or a fieldbus hold these.
        in_use: Vec<String>,
    },
    /// It refuses to send.
    #[error("the controller refuses to start sending")]
    NotStarted,
}

fn told(not_found: &[String], in_use: &[String]) -> String {
    let part = |words: &str, names: &[String]| match names {
        [] => None,
        names => Some(format!("{words}: {}", names.join(", "))),
    };
    let parts = [part("NOT_FOUND", not_found), part("IN_USE", in_use)];
    parts.into_iter().flatten().collect::<Vec<_>>().join("; ")
}

/// Type of a field.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    Double,
    Doubles(usize),
    Int32,
    Uint32,
    Uint64,
    Uint8,
    Ints6,
    Uints6,
}

impl Kind {
    fn named(word: &str) -> Option<Self> {
        Some(match word {
            "DOUBLE" => Self::Double,
            "VECTOR3D" => Self::Doubles(3),
            "VECTOR6D" => Self::Doubles(6),
            "INT32" => Self::Int32,
            "UINT32" => Self::Uint32,
            "UINT64" => Self::Uint64,
            "UINT8" | "BOOL" => Self::Uint8,
            "VECTOR6INT32" => Self::Ints6,
            "VECTOR6UINT32" => Self::Uints6,
            _ => return None,
        })
    }

    const fn size(self) -> usize {
        match self {
            Self::Double | Self::Uint64 => 8,
            Self::Doubles(count) => 8 * count,
            Self::Int32 | Self::Uint32 => 4,
            Self::Uint8 => 1,
            Self::Ints6 | Self::Uints6 => 24,
        }
    }

    /// The numbers of a field of exactly this size; every integer but very large UINT64 is a double exactly.
    fn numbers(self, bytes: &[u8]) -> Vec<f64> {
        let eight = |bytes: &[u8]| <[u8; 8]>::try_from(bytes).unwrap_or_default();
        let four = |bytes: &[u8]| <[u8; 4]>::try_from(bytes).unwrap_or_default();
        match self {
            Self::Double | Self::Doubles(_) => {
                bytes.chunks_exact(8).map(|chunk| f64::from_be_bytes(eight(chunk))).collect()
            }
            Self::Uint64 => {
                bytes.chunks_exact(8).map(|chunk| u64::from_be_bytes(eight(chunk)) as f64).collect()
            }
            Self::Int32 | Self::Ints6 => {
                bytes.chunks_exact(4).map(|chunk| f64::from(i32::from_be_bytes(four(chunk)))).collect()
            }
            Self::Uint32 | Self::Uints6 => {
                bytes.chunks_exact(4).map(|chunk| f64::from(u32::from_be_bytes(four(chunk)))).collect()
            }
            Self::Uint8 => bytes.iter().map(|byte| f64::from(*byte)).collect(),
        }
    }
}

/// One value to be sent.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Sent {
    /// INT32.
    Int(i32),
    /// DOUBLE.
    Double(f64),
}

/// One package of outputs: the numbers of each field, in the order in which they were asked for.
pub type Fields = Vec<Vec<f64>>;

/// A connection to RTDE.
#[derive(Debug)]
pub struct Rtde {
    stream: TcpStream,
    unread: Vec<u8>,
    patience: Duration,
    outputs: Vec<Kind>,
    recipe: u8,
}

impl Rtde {
    /// Connects and asks for protocol 2; each step for `patience` at most.
    ///
    /// # Errors
    ///
    /// See [`RtdeError`].
    pub fn connect(address: SocketAddr, patience: Duration) -> Result<Self, RtdeError> {
        let stream = TcpStream::connect_timeout(&address, patience).map_err(RtdeError::Connect)?;
        stream.set_nodelay(true).map_err(RtdeError::Connect)?;
        stream.set_write_timeout(Some(patience)).map_err(RtdeError::Connect)?;
        let mut rtde = Self { stream, unread: Vec::new(), patience, outputs: Vec::new(), recipe: 0 };
        match rtde.ask(REQUEST_PROTOCOL, &[0, 2])?.first() {
            Some(1) => Ok(rtde),
            _ => Err(RtdeError::Protocol),
        }
    }

    /// The controller's software.
    ///
    /// # Errors
    ///
    /// See [`RtdeError`].
    pub fn version(&mut self) -> Result<Version, RtdeError> {
        let answer = self.ask(GET_VERSION, &[])?;
        let mut words = answer
            .chunks_exact(4)
            .map(|chunk| u32::from_be_bytes(<[u8; 4]>::try_from(chunk).unwrap_or_default()));
        let mut word = || words.next().ok_or(RtdeError::Strange("a version without four numbers"));
        Ok(Version { major: word()?, minor: word()?, bugfix: word()?, build: word()? })
    }

    /// Asks for these outputs, `rate_hz` times a second.
    ///
    /// # Errors
    ///
    /// [`RtdeError::Fields`] names the ones that there are not.
    pub fn outputs(&mut self, rate_hz: f64, names: &[String]) -> Result<(), RtdeError> {
        let mut request = rate_hz.to_be_bytes().to_vec();
        request.extend(names.join(",").bytes());
        let answer = self.ask(SETUP_OUTPUTS, &request)?;
        (self.recipe, self.outputs) = recipe(&answer, names)?;
        Ok(())
    }

    /// Claims these inputs, and returns the recipe's number.
    ///
    /// # Errors
    ///
    /// [`RtdeError::Fields`] names the ones that others hold.
    pub fn inputs(&mut self, names: &[String]) -> Result<u8, RtdeError> {
        let answer = self.ask(SETUP_INPUTS, names.join(",").as_bytes())?;
        recipe(&answer, names).map(|(id, _)| id)
    }

    /// Begins to receive.
    ///
    /// # Errors
    ///
    /// See [`RtdeError`].
    pub fn start(&mut self) -> Result<(), RtdeError> {
        match self.ask(START, &[])?.first() {
            Some(1) => Ok(()),
            _ => Err(RtdeError::NotStarted),
        }
    }

    /// The newest package there is, waiting for one for `wait` at most; `None` when none came.
    ///
    /// # Errors
    ///
    /// See [`RtdeError`].
    pub fn receive(&mut self, wait: Duration) -> Result<Option<Fields>, RtdeError> {
        let end = Instant::now() + wait;
        loop {
            let mut newest = None;
            while let Some((kind, payload)) = self.package()? {
                if kind == DATA {
                    newest = Some(payload);
                }
            }
            if let Some(payload) = newest {
                return self.fields(&payload).map(Some);
            }
            if !self.read_until(end)? {
                return Ok(None);
            }
        }
    }

    /// Sends the values of an input recipe.
    ///
    /// # Errors
    ///
    /// See [`RtdeError`].
    pub fn send(&mut self, recipe: u8, values: &[Sent]) -> Result<(), RtdeError> {
        let mut payload = Vec::with_capacity(1 + 8 * values.len());
        payload.push(recipe);
        for value in values {
            match value {
                Sent::Int(value) => payload.extend(value.to_be_bytes()),
                Sent::Double(value) => payload.extend(value.to_be_bytes()),
            }
        }
        self.put(DATA, &payload)
    }

    fn fields(&self, payload: &[u8]) -> Result<Fields, RtdeError> {
        let (id, mut rest) = payload.split_first().ok_or(RtdeError::Strange("an empty package"))?;
        if *id != self.recipe {
            return Err(RtdeError::Strange("a package of a recipe that nobody asked for"));
        }
        let mut fields = Vec::with_capacity(self.outputs.len());
        for kind in &self.outputs {
            let (field, after) =
                rest.split_at_checked(kind.size()).ok_or(RtdeError::Strange("a package too short"))?;
            fields.push(kind.numbers(field));
            rest = after;
        }
        Ok(fields)
    }

    fn ask(&mut self, kind: u8, payload: &[u8]) -> Result<Vec<u8>, RtdeError> {
        self.put(kind, payload)?;
        let end = Instant::now() + self.patience;
        for _ in 0..PATIENT_PACKAGES {
            match self.package()? {
                Some((answered, payload)) if answered == kind => return Ok(payload),
                Some(_) => {}
                None if self.read_until(end)? => {}
                None => return Err(RtdeError::Silent(self.patience)),
            }
        }
        Err(RtdeError::Silent(self.patience))
    }

    fn put(&mut self, kind: u8, payload: &[u8]) -> Result<(), RtdeError> {
        let size = u16::try_from(payload.len() + 3).map_err(|_| RtdeError::Strange("a request too large"))?;
        let mut package = size.to_be_bytes().to_vec();
        package.push(kind);
        package.extend(payload);
        self.stream.write_all(&package).map_err(RtdeError::Broken)
    }

    /// The next whole package that has been read: its kind and what is in it.
    fn package(&mut self) -> Result<Option<(u8, Vec<u8>)>, RtdeError> {
        let [high, low, kind, ..] = self.unread.as_slice() else { return Ok(None) };
        let size = usize::from(u16::from_be_bytes([*high, *low]));
        if size < 3 {
            return Err(RtdeError::Strange("a package shorter than its own header"));
        }
        if self.unread.len() < size {
            return Ok(None);
        }
        let kind = *kind;
        let package: Vec<u8> = self.unread.drain(..size).collect();
        Ok(Some((kind, package.into_iter().skip(3).collect())))
    }

    /// Reads what there is; false when nothing came until `end`.
    fn read_until(&mut self, end: Instant) -> Result<bool, RtdeError> {
        if self.unread.len() > MOST_UNREAD {
            return Err(RtdeError::Strange("more than anybody asked for"));
        }
        let mut some = [0; 8192];
        loop {
            let left = end.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return Ok(false);
            }
            self.stream.set_read_timeout(Some(left)).map_err(RtdeError::Broken)?;
            match self.stream.read(&mut some) {
                Ok(0) => return Err(RtdeError::Closed),
                Ok(count) => {
                    self.unread.extend(some.iter().take(count));
                    return Ok(true);
                }
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {}
                Err(error) => return Err(RtdeError::Broken(error)),
            }
        }
    }
}

/// Number and types of a recipe by the answer to `names`.
fn recipe(answer: &[u8], names: &[String]) -> Result<(u8, Vec<Kind>), RtdeError> {
    let (id, types) = answer.split_first().ok_or(RtdeError::Strange("an empty recipe"))?;
    let types = std::str::from_utf8(types).map_err(|_| RtdeError::Strange("types that are no text"))?;
    let types: Vec<&str> = types.trim_end_matches(',').split(',').map(str::trim).collect();
    if types.len() != names.len() {
        return Err(RtdeError::Strange("a recipe with another number of types than names"));
    }
    let of = |word: &str| {
        let pairs = names.iter().zip(&types);
        pairs.filter(|(_, kind)| **kind == word).map(|(name, _)| name.clone()).collect::<Vec<_>>()
    };
    let (not_found, in_use) = (of("NOT_FOUND"), of("IN_USE"));
    if !not_found.is_empty() || !in_use.is_empty() {
        return Err(RtdeError::Fields { not_found, in_use });
    }
    let kinds = types.iter().map(|word| Kind::named(word)).collect::<Option<Vec<_>>>();
    Ok((*id, kinds.ok_or(RtdeError::Strange("a type that nobody knows"))?))
}
