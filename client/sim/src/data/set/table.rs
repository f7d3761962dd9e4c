//! `split.tsv`: tab-separated, a header that names at least the columns `set` and `file` (optional `writer`).
//!
//! Any word may stand in `set`; `file` is relative to the folder. Further columns are ignored.

use super::{ListedFile, SetError};
use crate::data::foreign::foreign;
use crate::data::shortened;
use foretrace_config::files::{read_text, shortened_path};
use std::path::{Component, Path};

/// A hundred thousand files.
const BYTES_MAX: u64 = 8 << 20;
/// The longest path of Linux.
const CELL_MAX: usize = 4096;
/// Characters of foreign text in a message.
const TOLD: usize = 200;

/// The rows of the table at `path`, in order.
pub(super) fn read(path: &Path) -> Result<Vec<ListedFile>, SetError> {
    let unreadable = |why: String| SetError::Unreadable {
        path: path.to_path_buf(),
        why: format!("cannot read the split table: {why}"),
    };
    let text = read_text(path, BYTES_MAX).map_err(|e| unreadable(e.to_string()))?;
    parse(&text).map_err(|(line, why)| match foreign(text.as_bytes(), text.len() as u64) {
        // Whatever its first line lacks then.
        Some(what) if !text.is_empty() => unreadable(what),
        _ => SetError::Row { file: path.to_path_buf(), line, why },
    })
}

fn parse(text: &str) -> Result<Vec<ListedFile>, (usize, String)> {
    let mut lines = text.trim_start_matches('\u{feff}').lines().enumerate().map(|(i, l)| (i + 1, l));
    let header: Vec<&str> =
        lines.next().map(|(_, l)| l.split('\t').map(str::trim).collect()).unwrap_or_default();
    let column = |name: &str| header.iter().position(|h| *h == name);
    let (Some(set), Some(file)) = (column("set"), column("file")) else {
        let found = shortened(&format!("{header:?}"), TOLD);
        return Err((1, format!("the header must name the columns set and file, found {found}")));
    };
    let mut rows = Vec::new();
    for (line, text) in lines.filter(|(_, l)| !l.trim().is_empty()) {
        let cells: Vec<&str> = text.split('\t').map(str::trim).collect();
        if let Some(long) = cells.iter().find(|cell| cell.len() > CELL_MAX) {
            return Err((line, format!("a cell of {} bytes; legal: at most {CELL_MAX}", long.len())));
        }
        let cell = |i: usize| cells.get(i).copied().unwrap_or_default();
        let (word, file) = (cell(set), cell(file));
        if word.is_empty() {
            return Err((
                line,
                "the column set is empty; write a word, for example train or test".to_owned(),
            ));
        }
        if file.is_empty() || !Path::new(file).components().all(|p| matches!(p, Component::Normal(_))) {
            let file = shortened_path(file, TOLD);
            return Err((line, format!("file {file:?} is not a path below the set's folder")));
        }
        let writer = column("writer").map(cell).unwrap_or_default().to_owned();
        rows.push(ListedFile { file: file.to_owned(), word: Some(word.to_owned()), writer, format: None });
    }
    Ok(rows)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn any_word_may_stand_in_any_column_order() {
        let rows = parse("file\tnote\tset\r\na/b.dat\tx\tvalidation\r\n\nc.dat\t\tfold 3\n").unwrap();
        let seen: Vec<_> = rows.iter().map(|r| (r.file.as_str(), r.word.as_deref())).collect();
        assert_eq!(seen, [("a/b.dat", Some("validation")), ("c.dat", Some("fold 3"))]);
    }

    #[test]
    fn what_does_not_fit_is_named_with_its_line() {
        for (text, wanted) in [
            ("", (1, "the header must name the columns set and file, found []")),
            (
                "set\twriter\n",
                (1, "the header must name the columns set and file, found [\"set\", \"writer\"]"),
            ),
            ("set\tfile\ntrain\t../x\n", (2, "file \"../x\" is not a path below the set's folder")),
            ("set\tfile\ntrain\n", (2, "file \"\" is not a path below the set's folder")),
            (
                "set\tfile\na\tb\n\tx\n",
                (3, "the column set is empty; write a word, for example train or test"),
            ),
        ] {
            assert_eq!(parse(text).unwrap_err(), (wanted.0, wanted.1.to_owned()));
        }
    }
}
