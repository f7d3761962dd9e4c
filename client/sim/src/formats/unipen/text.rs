//! The lines of a UNIPEN file: Latin-1 unless a mark says otherwise, keywords in column one, arguments up to
//! the next keyword.

use crate::data::{FileError, decoded, foreign};
use foretrace_config::files::{read_regular, shortened_path};
use std::borrow::Cow;
use std::path::{Component as Part, Path, PathBuf};

const FILE_BYTES_MAX: u64 = 64 << 20;

/// A line of a file, from which errors are made.
#[derive(Debug, Clone)]
pub(super) struct At {
    file: PathBuf,
    line: usize,
}

impl At {
    pub(super) fn new(file: &Path, line: usize) -> Self {
        Self { file: file.to_path_buf(), line }
    }

    pub(super) fn line(&self, line: usize) -> Self {
        Self { file: self.file.clone(), line }
    }

    pub(super) fn fails(&self, reason: &str) -> FileError {
        FileError::at(&self.file, self.line, reason)
    }
}

/// A keyword and the lines of its arguments.
pub(super) struct Statement<'t> {
    /// With its dot, as written.
    pub(super) keyword: &'t str,
    /// Line of the keyword, from 1.
    pub(super) line: usize,
    body: Vec<&'t str>,
}

impl<'t> Statement<'t> {
    /// The argument lines with their numbers; the first is the rest of the keyword's own line.
    pub(super) fn lines(&self) -> impl Iterator<Item = (usize, &'t str)> + '_ {
        self.body.iter().enumerate().map(|(i, text)| (self.line + i, *text))
    }

    /// The first argument; empty without any.
    pub(super) fn first(&self) -> &'t str {
        self.tokens().next().map(|(_, t)| t).unwrap_or_default()
    }

    /// The arguments separated by white space, with their lines.
    pub(super) fn tokens(&self) -> impl Iterator<Item = (usize, &'t str)> + '_ {
        self.lines().flat_map(|(line, text)| text.split_whitespace().map(move |t| (line, t)))
    }
}

/// Splits text into statements; lines before the first keyword are dropped.
pub(super) fn read_statements(text: &str) -> Vec<Statement<'_>> {
    let mut statements: Vec<Statement<'_>> = Vec::new();
    for (i, line) in text.lines().enumerate() {
        if line.starts_with('.') {
            let end = line.find(char::is_whitespace).unwrap_or(line.len());
            let (keyword, rest) = line.split_at(end);
            statements.push(Statement { keyword, line: i + 1, body: vec![rest] });
        } else if let Some(last) = statements.last_mut() {
            last.body.push(line);
        }
    }
    statements
}

/// The bytes of a file that another one includes.
///
/// # Errors
/// It cannot be read, is too long, or is known to be something else.
pub(super) fn read_included(path: &Path) -> Result<Vec<u8>, FileError> {
    let unreadable = |e: std::io::Error| FileError::whole(path, format!("cannot read the file: {e}"));
    let bytes = read_regular(path, FILE_BYTES_MAX).map_err(unreadable)?;
    match foreign(&bytes, bytes.len() as u64).filter(|_| !bytes.is_empty()) {
        Some(what) => Err(FileError::whole(path, format!("not UNIPEN: {what}"))),
        None => Ok(bytes),
    }
}

/// By its mark UTF-8 or UTF-16, else Latin-1, in which every byte is a character.
pub(super) fn text_of(bytes: &[u8]) -> Cow<'_, str> {
    match bytes {
        [0xef, 0xbb, 0xbf, rest @ ..] => String::from_utf8_lossy(rest),
        [0xff, 0xfe, ..] | [0xfe, 0xff, ..] => {
            Cow::Owned(decoded(bytes).trim_start_matches('\u{feff}').to_owned())
        }
        _ => Cow::Owned(bytes.iter().copied().map(char::from).collect()),
    }
}

/// Looks for `wanted` below `include/` beside each folder above `root` (nearest first), then beside `root`.
pub(super) fn resolve_include(root: &Path, wanted: &str) -> Result<Option<PathBuf>, String> {
    let relative = Path::new(wanted);
    let below = relative.components().all(|part| matches!(part, Part::Normal(_) | Part::CurDir));
    if !below || wanted.contains('\0') {
        let wanted = shortened_path(wanted, 60);
        return Err(format!(
            "include {wanted:?} leads out of the include folder; only paths below it are read"
        ));
    }
    if wanted.is_empty() {
        return Ok(None);
    }
    // `ancestors` of a relative path ends with "", which stands for the working directory.
    let absolute = std::path::absolute(root).unwrap_or_else(|_| root.to_path_buf());
    let beside = absolute.parent().map(|folder| folder.join(relative));
    let below_include = absolute.ancestors().skip(1).map(|folder| folder.join("include").join(relative));
    Ok(below_include.chain(beside).find(|candidate| candidate.is_file()))
}

/// Foreign text for a message.
pub(super) fn shortened(text: &str) -> String {
    crate::data::shortened(text, 40)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arguments_run_on_until_the_next_keyword_in_column_one() {
        let statements = read_statements("junk\n.A 1\n 2\n .b 3\n.C\n");
        let seen: Vec<_> = statements.iter().map(|s| (s.keyword, s.line, s.tokens().count())).collect();
        assert_eq!(seen, [(".A", 2, 4), (".C", 5, 0)]);
    }

    #[test]
    fn a_mark_is_no_part_of_the_first_keyword_and_tells_the_letters() {
        let wide: Vec<u8> = "\u{feff}.A é".encode_utf16().flat_map(u16::to_le_bytes).collect();
        for bytes in [&b".A \xe9"[..], b"\xef\xbb\xbf.A \xc3\xa9", &wide] {
            let text = text_of(bytes);
            let [only] = &read_statements(&text)[..] else { panic!("{text}") };
            assert_eq!((only.keyword, only.first()), (".A", "é"));
        }
    }

    #[test]
    fn includes_may_not_leave_their_folder() {
        for wanted in ["/etc/passwd", "../x", "a/../../x"] {
            assert!(resolve_include(Path::new("/tmp/a.dat"), wanted).is_err(), "{wanted}");
        }
    }
}
