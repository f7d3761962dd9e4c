//! Numbers in files with every bit, and what tells one set of numbers from another.

use std::fmt;
use std::fs::File;
use std::io::{self, Read as _};
use std::path::Path;

use data_encoding::BASE64;
use serde::de::Error as _;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// Doubles as base64 of their little-endian bytes: infinities and NaN come back as they were.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Exact(pub Vec<f64>);

impl Serialize for Exact {
    fn serialize<S: Serializer>(&self, out: S) -> Result<S::Ok, S::Error> {
        let bytes: Vec<u8> = self.0.iter().flat_map(|number| number.to_le_bytes()).collect();
        out.serialize_str(&BASE64.encode(&bytes))
    }
}

impl<'de> Deserialize<'de> for Exact {
    fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        let text = String::deserialize(from)?;
        let bytes = BASE64
            .decode(text.as_bytes())
            .map_err(|error| D::Error::custom(format_args!("numbers are no base64: {error}")))?;
        let (numbers, rest) = bytes.as_chunks::<8>();
        if !rest.is_empty() {
            let count = bytes.len();
            return Err(D::Error::custom(format_args!("{count} bytes are no whole doubles")));
        }
        Ok(Self(numbers.iter().map(|number| f64::from_le_bytes(*number)).collect()))
    }
}

/// Sums up data, so that shards of other data are told apart. Against accidents, not against forgers.
#[derive(Debug, Default)]
pub struct Digest(crc32fast::Hasher);

impl Digest {
    pub fn text(&mut self, text: &str) {
        self.0.update(&(text.len() as u64).to_le_bytes());
        self.0.update(text.as_bytes());
    }

    pub fn numbers(&mut self, numbers: impl IntoIterator<Item = f64>) {
        numbers.into_iter().for_each(|number| self.0.update(&number.to_le_bytes()));
    }

    /// What the file `path` holds, read piece by piece.
    ///
    /// # Errors
    /// It cannot be read.
    pub fn of_file(path: &Path) -> io::Result<String> {
        let mut digest = Self::default();
        let mut file = File::open(path)?;
        let mut piece = vec![0; 1 << 20];
        loop {
            match file.read(&mut piece)? {
                0 => return Ok(digest.finish()),
                count => digest.0.update(piece.get(..count).unwrap_or_default()),
            }
        }
    }

    /// What `thing` is, as its `Debug` tells it.
    #[must_use]
    pub fn of(thing: &impl fmt::Debug) -> String {
        let mut digest = Self::default();
        // Into a sum nothing fails.
        let _ = fmt::write(&mut digest, format_args!("{thing:?}"));
        digest.finish()
    }

    #[must_use]
    pub fn finish(self) -> String {
        format!("{:08x}", self.0.finalize())
    }
}

impl fmt::Write for Digest {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        self.0.update(text.as_bytes());
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_bit_comes_back() {
        let negative_nan = f64::from_bits(0xfff8_0000_0000_0001);
        let numbers = vec![0.1, -0.0, f64::INFINITY, f64::NAN, negative_nan, 5e-324, 1.0 / 3.0];
        let text = serde_json::to_string(&Exact(numbers.clone())).unwrap();
        let back: Exact = serde_json::from_str(&text).unwrap();
        let bits = |numbers: &[f64]| numbers.iter().map(|number| number.to_bits()).collect::<Vec<_>>();
        assert_eq!(bits(&back.0), bits(&numbers));
    }

    #[test]
    fn broken_numbers_are_named() {
        for (text, word) in [("\"AAAA\"", "3 bytes"), ("\"?\"", "base64"), ("7", "string")] {
            let error = serde_json::from_str::<Exact>(text).unwrap_err().to_string();
            assert!(error.contains(word), "{text}: {error}");
        }
    }

    #[test]
    fn other_data_has_another_digest() {
        let of = |texts: &[&str], numbers: &[f64]| {
            let mut digest = Digest::default();
            texts.iter().for_each(|text| digest.text(text));
            digest.numbers(numbers.iter().copied());
            digest.finish()
        };
        let all =
            [of(&["ab", "c"], &[1.0]), of(&["a", "bc"], &[1.0]), of(&["ab", "c"], &[1.5]), of(&[], &[])];
        assert!((0..4).all(|a| (0..a).all(|b| all[a] != all[b])), "{all:?}");
    }
}
