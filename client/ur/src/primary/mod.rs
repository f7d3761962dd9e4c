//! Packages of the primary and secondary interfaces (ports 30001 and 30002), and a client that reads them.
//!
//! Contract: decoding is total and bounded: no package above 64 KiB, no more sub-packages than fit into it,
//! what is unknown is kept by number and passed over. Encoding gives the layout of CB3 3.15 and e-Series 5.x.
//! Rooms: `state` (sub-packages of a robot state), `codec` (their bytes), `message`, `client`.
//!
//! *Source*: client interface guide of Universal Robots (primary and secondary, data streaming).

pub mod state;
mod codec;
pub mod message;
pub mod client;

pub use client::{PrimaryClient, PrimaryError};
pub use message::{MessageContent, RobotMessage};
pub use state::{
    CartesianInfo, ConfigurationData, JointData, KinematicsInfo, MasterboardData, OneJoint, RobotModeData,
    RobotState, SubPackage, ToolData,
};

use crate::rtde::value::take;

/// Port of the primary interface.
pub const PRIMARY_PORT: u16 = 30001;

/// Longest package that is believed \[bytes\].
pub const LARGEST: usize = 65_536;
/// Bytes of a package's or sub-package's header: `i32` size, `u8` type.
const HEADER: usize = 5;

const STATE: u8 = 16;
const MESSAGE: u8 = 20;

#[derive(Debug, Clone, PartialEq)]
pub enum PrimaryPackage {
    /// Type 16: the robot's state.
    State(RobotState),
    /// Type 20: a message.
    Message(RobotMessage),
    /// Another type, passed over.
    Other(u8),
}

/// Bytes that are not a package.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum Malformed {
    /// A size that cannot be.
    #[error("a package of {0} bytes")]
    Size(i64),
    /// A payload that does not fit its type.
    #[error("a package of type {0} with a payload that does not fit it")]
    Payload(u8),
}

impl PrimaryPackage {
    /// As bytes, header included.
    #[must_use]
    pub fn encode(&self) -> Vec<u8> {
        match self {
            Self::State(state) => framed(STATE, &state.payload()),
            Self::Message(message) => framed(MESSAGE, &message.payload()),
            Self::Other(kind) => framed(*kind, &[]),
        }
    }

    /// Takes the first whole package from the front of `bytes`; `None` where the rest of it is still to come.
    ///
    /// # Errors
    ///
    /// [`Malformed`]; after a wrong size the stream cannot be read any further.
    pub fn take(bytes: &mut &[u8]) -> Result<Option<Self>, Malformed> {
        let Some((kind, payload)) = unframe(bytes)? else { return Ok(None) };
        Ok(Some(match kind {
            STATE => Self::State(RobotState::decode(payload)?),
            MESSAGE => Self::Message(RobotMessage::decode(payload).ok_or(Malformed::Payload(kind))?),
            kind => Self::Other(kind),
        }))
    }
}

/// Header and payload; a payload that is too long for [`LARGEST`] is cut, which no state or message here is.
fn framed(kind: u8, payload: &[u8]) -> Vec<u8> {
    let payload = payload.get(..payload.len().min(LARGEST - HEADER)).unwrap_or(&[]);
    let size = i32::try_from(payload.len() + HEADER).unwrap_or(i32::MAX);
    let mut bytes = Vec::with_capacity(payload.len() + HEADER);
    bytes.extend_from_slice(&size.to_be_bytes());
    bytes.push(kind);
    bytes.extend_from_slice(payload);
    bytes
}

/// Type and payload of the package or sub-package at the front of `bytes`, which moves behind it.
fn unframe<'a>(bytes: &mut &'a [u8]) -> Result<Option<(u8, &'a [u8])>, Malformed> {
    let mut rest = *bytes;
    let Some(size) = take(&mut rest).map(i32::from_be_bytes) else { return Ok(None) };
    let length = usize::try_from(size).ok().filter(|length| (HEADER..=LARGEST).contains(length));
    let Some(length) = length else { return Err(Malformed::Size(i64::from(size))) };
    let Some((package, after)) = bytes.split_at_checked(length) else { return Ok(None) };
    let Some((&kind, payload)) = package.get(HEADER - 1..).and_then(<[u8]>::split_first) else {
        return Ok(None);
    };
    *bytes = after;
    Ok(Some((kind, payload)))
}

#[cfg(test)]
mod tests;
