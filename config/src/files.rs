//! Files that settings name: read whole, if they are ordinary ones of a bounded size.
//!
//! Contract: settings may come from a recording of somebody else, so that no path makes a program wait or
//! fill its memory: devices and pipes are refused before they are opened.

use std::fs::File;
use std::io::{Error, ErrorKind, Read as _, Result};
use std::path::Path;

/// The bytes of the ordinary file `path`, which has at most `most`.
pub(crate) fn read_regular(path: &Path, most: u64) -> Result<Vec<u8>> {
    // A pipe without a writer blocks whoever opens it.
    if !std::fs::metadata(path)?.is_file() {
        return Err(Error::new(ErrorKind::InvalidInput, "it is no ordinary file"));
    }
    let mut bytes = Vec::new();
    File::open(path)?.take(most.saturating_add(1)).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > most {
        return Err(Error::new(ErrorKind::InvalidData, format!("it is longer than {most} bytes")));
    }
    Ok(bytes)
}

/// As [`read_regular`], as UTF-8.
pub(crate) fn read_text(path: &Path, most: u64) -> Result<String> {
    String::from_utf8(read_regular(path, most)?)
        .map_err(|error| Error::new(ErrorKind::InvalidData, error.utf8_error().to_string()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn devices_folders_and_long_files_are_refused_with_a_reason() {
        let told = |path: &str, most| read_text(Path::new(path), most).unwrap_err().to_string();
        assert_eq!(told("/dev/zero", 10), "it is no ordinary file");
        assert_eq!(told("/", 10), "it is no ordinary file");
        let own = concat!(env!("CARGO_MANIFEST_DIR"), "/Cargo.toml");
        assert_eq!(told(own, 10), "it is longer than 10 bytes");
        assert!(read_text(Path::new(own), 1 << 20).unwrap().contains("foretrace-config"));
    }
}
