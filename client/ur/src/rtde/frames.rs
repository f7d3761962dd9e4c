//! RTDE packages cut out of a stream of bytes.
//!
//! Contract: nothing is read past a package's size, nothing grows beyond 65535 bytes, whatever the bytes are.
//! Header: `u16` size of the whole package, `u8` type.

/// Bytes of the header.
pub const HEADER: usize = 3;
/// Longest package: what the size field can say.
pub const LARGEST: usize = u16::MAX as usize;

/// Bytes that are not a package, or a package that does not fit into bytes.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum RtdeWireError {
    /// A size that cannot be.
    #[error("a package of {0} bytes, which is less than its header")]
    Size(usize),
    /// Too long for the size field.
    #[error("a package of {0} bytes; at most {LARGEST} are possible")]
    TooLong(usize),
    /// A type that the protocol does not have, or not in this direction.
    #[error("no package has the type {0}")]
    Type(u8),
    /// A payload that is too short, too long, or not what its type says.
    #[error("a package of type '{0}' with a payload that does not fit it")]
    Payload(char),
}

/// Cuts a stream of bytes into packages.
#[derive(Debug, Default)]
pub struct Frames {
    bytes: Vec<u8>,
    read: usize,
}

impl Frames {
    /// Appends what came. Whoever feeds it takes packages out before feeding more: what is kept is less than
    /// a package then.
    pub fn feed(&mut self, bytes: &[u8]) {
        self.bytes.drain(..self.read.min(self.bytes.len()));
        self.read = 0;
        self.bytes.extend_from_slice(bytes);
    }

    /// Type and payload of the next whole package, if there is one.
    ///
    /// # Errors
    ///
    /// [`RtdeWireError::Size`]: the stream cannot be read any further.
    pub fn next_package(&mut self) -> Result<Option<(u8, &[u8])>, RtdeWireError> {
        let Some(rest) = self.bytes.get(self.read..) else { return Ok(None) };
        let Some((&[high, low, kind], _)) = rest.split_first_chunk::<HEADER>() else { return Ok(None) };
        let size = usize::from(u16::from_be_bytes([high, low]));
        if size < HEADER {
            return Err(RtdeWireError::Size(size));
        }
        let Some(payload) = rest.get(HEADER..size) else { return Ok(None) };
        self.read += size;
        Ok(Some((kind, payload)))
    }

    /// Bytes that wait for the rest of their package.
    #[cfg(test)]
    pub(super) fn waiting(&self) -> usize {
        self.bytes.len().saturating_sub(self.read)
    }
}

/// A package with this payload.
///
/// # Errors
///
/// [`RtdeWireError::TooLong`].
pub(super) fn package(kind: u8, payload: &[u8]) -> Result<Vec<u8>, RtdeWireError> {
    let size = payload.len().saturating_add(HEADER);
    let Ok(size_field) = u16::try_from(size) else { return Err(RtdeWireError::TooLong(size)) };
    let mut bytes = Vec::with_capacity(size);
    bytes.extend_from_slice(&size_field.to_be_bytes());
    bytes.push(kind);
    bytes.extend_from_slice(payload);
    Ok(bytes)
}
