//! XML files in other encodings than UTF-8, as text.
//!
//! Contract: UTF-8 is taken as it is, whatever the file declares. Else a mark or the first characters tell
//! UTF-16, and a declaration ISO-8859-1. All else is refused with the line of the first byte that is wrong.

use std::io::{Error, ErrorKind, Result};

/// Bytes in which a declaration of the encoding is looked for.
const DECLARATION: usize = 200;

/// The text of the XML file with these bytes.
///
/// # Errors
///
/// It is not in UTF-8, UTF-16 or ISO-8859-1.
pub(crate) fn xml_text(bytes: Vec<u8>) -> Result<String> {
    if let Some(units) = utf16(&bytes) {
        let wrong = |what: &str| {
            let remedy = "save it as UTF-8";
            Error::new(ErrorKind::InvalidData, format!("it begins as UTF-16 and {what}: {remedy}"))
        };
        if bytes.len() % 2 == 1 {
            return Err(wrong("has half a character at its end"));
        }
        return String::from_utf16(&units).map_err(|_| wrong("has half of a pair of characters"));
    }
    let error = match String::from_utf8(bytes) {
        Ok(text) => return Ok(text),
        Err(error) => error,
    };
    let (at, bytes) = (error.utf8_error().valid_up_to(), error.into_bytes());
    let declared = declared(&bytes);
    let known = ["iso-8859-1", "iso8859-1", "iso_8859-1", "latin1", "latin-1", "l1"];
    if declared.as_deref().is_some_and(|name| known.contains(&name)) {
        return Ok(bytes.into_iter().map(char::from).collect());
    }
    let line = 1 + bytes.iter().take(at).filter(|byte| **byte == b'\n').count();
    let byte = bytes.get(at).copied().unwrap_or_default();
    let says = declared.map_or_else(
        || "it declares no other encoding".to_owned(),
        |name| format!("it declares {name:?}, which is not read"),
    );
    Err(Error::new(
        ErrorKind::InvalidData,
        format!("line {line}: byte 0x{byte:02X} is not UTF-8, and {says}: save it as UTF-8"),
    ))
}

/// The units of a file that begins as UTF-16 does: with its mark, or with `<` of two bytes.
fn utf16(bytes: &[u8]) -> Option<Vec<u16>> {
    let (skipped, unit): (usize, fn([u8; 2]) -> u16) = match bytes {
        [0xff, 0xfe, ..] => (2, u16::from_le_bytes),
        [0xfe, 0xff, ..] => (2, u16::from_be_bytes),
        [b'<', 0, ..] => (0, u16::from_le_bytes),
        [0, b'<', ..] => (0, u16::from_be_bytes),
        _ => return None,
    };
    let pairs = bytes.get(skipped..).unwrap_or_default().chunks_exact(2);
    Some(pairs.filter_map(|pair| pair.try_into().ok()).map(unit).collect())
}

/// What `<?xml ... encoding="NAME"?>` at the beginning says, in small letters.
fn declared(bytes: &[u8]) -> Option<String> {
    let head: String = bytes.iter().take(DECLARATION).copied().map(char::from).collect();
    let (declaration, _) = head.trim_start().strip_prefix("<?xml")?.split_once("?>")?;
    let (_, rest) = declaration.split_once("encoding")?;
    let rest = rest.trim_start().strip_prefix('=')?.trim_start();
    let quote = rest.chars().next().filter(|quote| ['"', '\''].contains(quote))?;
    let (name, _) = rest.get(1..)?.split_once(quote)?;
    Some(name.to_ascii_lowercase())
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = "<?xml version='1.0' encoding = 'ISO-8859-1'?>\n<!-- Größe -->\n<robot/>";

    fn latin1(text: &str) -> Vec<u8> {
        text.chars().map(|character| u8::try_from(u32::from(character)).unwrap()).collect()
    }

    #[test]
    fn utf_8_latin_1_and_utf_16_give_the_same_text() {
        let units = || TEXT.encode_utf16();
        let little = |mark: &[u8]| [mark, &units().flat_map(u16::to_le_bytes).collect::<Vec<_>>()].concat();
        let big = |mark: &[u8]| [mark, &units().flat_map(u16::to_be_bytes).collect::<Vec<_>>()].concat();
        // The last of them declares what it is not, as editors leave it behind.
        let all =
            [latin1(TEXT), little(&[0xff, 0xfe]), big(&[0xfe, 0xff]), little(&[]), big(&[]), TEXT.into()];
        for bytes in all {
            assert_eq!(xml_text(bytes).unwrap(), TEXT);
        }
    }

    #[test]
    fn what_is_in_no_known_encoding_is_refused_with_its_line_and_what_to_do() {
        let refusal = |bytes: Vec<u8>| xml_text(bytes).unwrap_err().to_string();
        let bare = TEXT.replace(" encoding = 'ISO-8859-1'", "");
        assert_eq!(
            refusal(latin1(&bare)),
            "line 2: byte 0xF6 is not UTF-8, and it declares no other encoding: save it as UTF-8"
        );
        let other = refusal(latin1(&TEXT.replace("ISO-8859-1", "Shift_JIS")));
        assert!(other.contains("line 2") && other.contains("\"shift_jis\", which is not read"), "{other}");
        assert!(refusal(vec![0xff, 0xfe, b'<']).contains("half a character"));
        assert!(refusal(vec![0xff, 0xfe, 0x00, 0xd8]).contains("half of a pair"));
        // A declaration counts in the first place of the file only.
        assert!(refusal(latin1(&format!("{bare}{TEXT}"))).contains("no other encoding"));
    }
}
