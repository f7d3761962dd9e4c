//! Text that others wrote, made safe to print: file names, settings, robot descriptions, words of peers.
//!
//! A terminal obeys escape sequences and reorders text at bidirectional controls, so a name can hide the text
//! beside it, or forge a message. What is printed or logged goes through here, escaped as TOML and JSON do
//! (`\u001B`).

use std::borrow::Cow;
use std::fmt::Write;

/// `text` on one line, with every character escaped that a terminal would act on.
#[must_use]
pub fn plain(text: &str) -> Cow<'_, str> {
    escaped(text, acts)
}

/// The same for text of several lines: new lines and tabs stay.
#[must_use]
pub fn plain_lines(text: &str) -> Cow<'_, str> {
    escaped(text, |c| acts(c) && !matches!(c, '\n' | '\t'))
}

/// The same for a line of the log, whose colours (`ESC [ ... m`) the log itself has put there after escaping
/// the message.
#[must_use]
pub fn plain_log(text: &str) -> Cow<'_, str> {
    escaped(text, |c| acts(c) && !matches!(c, '\n' | '\t' | '\u{1b}'))
}

/// Control characters (C0, DEL, C1), line and paragraph separators, bidirectional controls, and what has no
/// width or shape.
fn acts(c: char) -> bool {
    c.is_control()
        || matches!(
            c,
            '\u{00ad}'
                | '\u{061c}'
                | '\u{180e}'
                | '\u{200b}'..='\u{200f}'
                | '\u{2028}'..='\u{202e}'
                | '\u{2060}'..='\u{206f}'
                | '\u{feff}'
                | '\u{fff9}'..='\u{fffb}'
                | '\u{e0000}'..='\u{e007f}'
        )
}

fn escaped(text: &str, hostile: impl Fn(char) -> bool) -> Cow<'_, str> {
    if !text.chars().any(&hostile) {
        return Cow::Borrowed(text);
    }
    let mut out = String::with_capacity(text.len() + 16);
    for c in text.chars() {
        if hostile(c) {
            // As UTF-16 units: what JSON and TOML read back as the same character.
            for unit in c.encode_utf16(&mut [0; 2]) {
                // Writing to a string does not fail.
                let _ = write!(out, "\\u{unit:04X}");
            }
        } else {
            out.push(c);
        }
    }
    Cow::Owned(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_that_a_terminal_acts_upon_is_left() {
        let hostile =
            "a\u{1b}[31mred\u{9b}2J\u{7}\u{8}\r\u{202e}fdp.exe\u{2066}\u{feff}\u{2028}\u{7f}\u{e0041}z";
        for safe in [plain(hostile), plain_lines(hostile)] {
            assert!(!safe.chars().any(acts), "{safe}");
            assert!(safe.starts_with("a\\u001B[31mred\\u009B2J\\u0007"), "{safe}");
            assert!(safe.ends_with('z'));
        }
        assert_eq!(plain("two\nlines\t."), "two\\u000Alines\\u0009.");
        assert_eq!(plain_lines("two\nlines\t."), "two\nlines\t.");
        assert_eq!(plain_log("\u{1b}[2mINFO\u{1b}[0m \u{202e}x\n"), "\u{1b}[2mINFO\u{1b}[0m \\u202Ex\n");
    }

    #[test]
    fn what_people_write_stays_as_it_is() {
        for text in ["", "Grüße", "手書き", "naïve ± 0.2 µs", "/tmp/a b/ü.toml", "שלום", "🖊"]
        {
            assert!(matches!(plain(text), Cow::Borrowed(same) if same == text), "{text}");
        }
    }

    #[test]
    fn settings_read_back_as_the_same_text() {
        let text = "\u{202e}\u{9b}é";
        let table: toml::Table = toml::from_str(&format!("a = \"{}\"", plain(text))).unwrap();
        assert_eq!(table["a"].as_str(), Some(text));
    }
}
