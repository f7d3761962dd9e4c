//! What a child that checks settings says: the files that it read, or why they are refused.
//!
//! Contract: any bytes give an answer or none; lengths are checked before they are used.

use std::ffi::OsString;
use std::os::unix::ffi::{OsStrExt as _, OsStringExt as _};
use std::path::PathBuf;

use foretrace_config::files::Taken;

/// Longest answer \[bytes\]: settings, a URDF, three networks and a prior, each of the largest size, fit.
pub(super) const LONGEST: usize = 64 << 20;
/// Longest reason \[bytes\].
const LONGEST_REASON: usize = 64 << 10;
/// The first bytes of an answer, and the last ones: a child that dies has not sent the latter.
const BEGIN: &[u8] = b"foretrace settings ";
const END: &[u8] = b" all";

/// The outcome of a check.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum CheckAnswer {
    /// Good settings: what was read for them.
    Good(Taken),
    /// Why they cannot be used.
    Refused(String),
}

impl CheckAnswer {
    pub(super) fn to_bytes(&self) -> Vec<u8> {
        let mut bytes = BEGIN.to_vec();
        let mut field = |field: &[u8]| {
            bytes.extend((field.len() as u64).to_le_bytes());
            bytes.extend(field);
        };
        match self {
            Self::Refused(why) => {
                field(b"refused");
                field(why.as_bytes().get(..LONGEST_REASON).unwrap_or(why.as_bytes()));
            }
            Self::Good(taken) => {
                field(b"good");
                for (path, file) in taken {
                    field(path.as_os_str().as_bytes());
                    field(file);
                }
            }
        }
        bytes.extend(END);
        bytes
    }

    pub(super) fn from_bytes(bytes: &[u8]) -> Option<Self> {
        let mut rest = bytes.strip_prefix(BEGIN)?.strip_suffix(END)?;
        let mut fields = Vec::new();
        while !rest.is_empty() {
            let (length, after) = rest.split_first_chunk()?;
            let (field, after) =
                after.split_at_checked(usize::try_from(u64::from_le_bytes(*length)).ok()?)?;
            fields.push(field);
            rest = after;
        }
        match fields.as_slice() {
            [b"refused", why] => Some(Self::Refused(String::from_utf8_lossy(why).into_owned())),
            [b"good", files @ ..] if files.len() % 2 == 0 => {
                let path = |bytes: &[u8]| PathBuf::from(OsString::from_vec(bytes.to_vec()));
                let files = files.chunks_exact(2).filter_map(|pair| match pair {
                    [name, bytes] => Some((path(name), bytes.to_vec())),
                    _ => None,
                });
                Some(Self::Good(files.collect()))
            }
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn answers_are_read_back_and_every_cut_or_wrong_length_gives_none() {
        let files = [("/a", b"one".to_vec()), ("b c", vec![]), ("/a.bin", vec![0; 300])];
        let good = CheckAnswer::Good(files.map(|(path, bytes)| (path.into(), bytes)).into());
        for answer in [good, CheckAnswer::Refused("é: no".to_owned()), CheckAnswer::Good(Taken::new())] {
            let bytes = answer.to_bytes();
            assert_eq!(CheckAnswer::from_bytes(&bytes), Some(answer));
            for cut in 0..bytes.len() {
                assert_eq!(CheckAnswer::from_bytes(&bytes[..cut]), None, "{cut}");
            }
            let mut forged = bytes.clone();
            forged[BEGIN.len()..BEGIN.len() + 8].copy_from_slice(&u64::MAX.to_le_bytes());
            assert_eq!(CheckAnswer::from_bytes(&forged), None);
        }
        let long = CheckAnswer::Refused("x".repeat(1 << 20)).to_bytes();
        assert!(long.len() < 2 * LONGEST_REASON && CheckAnswer::from_bytes(&long).is_some());
    }
}
