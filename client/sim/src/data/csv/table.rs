//! The rows of a text with separators: which separator it has, where its header is, numbers of every writing.
//!
//! Contract: separators `,` `;` tab; quotes as in RFC 4180, line breaks in them too; a decimal comma where it
//! cannot be a separator. Lines that begin with `#` and empty ones are passed over, unless nothing else names
//! the columns; a few lines of other text may stand above the header.

use super::names::{Columns, Lacking};
use super::number::number;
use super::record::{COLUMNS_MAX, RowCells, Walk};

/// Lines above the header at most: exports begin with the device's name and settings.
const PREAMBLE_MAX: usize = 100;
/// Rows that tell a table from a text that speaks of one.
const ROWS_SEEN: usize = 20;
/// Characters of a header in a message.
const TOLD: usize = 80;

/// A header that was found.
pub(super) struct Header<'t> {
    pub(super) columns: Columns,
    /// Lines of other text above it.
    pub(super) above: usize,
    /// It is a comment, as numpy writes headers.
    commented: bool,
    separator: char,
    /// What is below it.
    rows: Walk<'t>,
}

/// The cells of a row, without blanks around them.
pub(super) struct Row<'r> {
    cells: RowCells<'r>,
}

impl Row<'_> {
    pub(super) fn cell(&self, column: usize) -> &str {
        self.cells.get(column).map_or("", |cell| cell.trim())
    }

    /// RowCells, those at the end without contents left out.
    fn width(&self) -> usize {
        self.cells.iter().rposition(|cell| !cell.trim().is_empty()).map_or(0, |last| last + 1)
    }

    fn fits(&self, count: usize) -> bool {
        self.width() <= count && (count..=COLUMNS_MAX).contains(&self.cells.len())
    }
}

/// Whether the text, or the first part of one, is a table of pen samples: its first line with contents is a
/// header, or a later one is, and rows stand below it.
pub(super) fn begins(text: &str) -> bool {
    let Ok(mut header) = find_header(text) else { return false };
    if header.above == 0 && !header.commented {
        return true;
    }
    let cut = !text.ends_with(['\n', '\r']);
    let mut seen = 0;
    while seen < ROWS_SEEN {
        let Some(record) = header.rows.next_record(header.separator) else { break };
        let whole = !(cut && header.rows.is_at_end()) || seen == 0;
        let is_row = record.cells.is_ok_and(|cells| {
            let row = Row { cells };
            row.fits(header.columns.count) && number(row.cell(header.columns.t)).is_some()
        });
        if whole && !is_row {
            return false;
        }
        seen += 1;
    }
    seen > 0
}

/// Whether any of the first lines names time, x and y.
pub(super) fn has_header(text: &str) -> bool {
    find_header(text).is_ok()
}

fn columns(row: &Row<'_>) -> Result<Columns, Lacking> {
    if row.cells.len() > COLUMNS_MAX {
        return Err(Lacking::Time);
    }
    let names: Vec<&str> = (0..row.width()).map(|column| row.cell(column)).collect();
    Columns::of(&names)
}

/// The separator that a line has most of.
fn separator_of(line: &str) -> char {
    let count = |separator: &char| line.matches(*separator).count();
    ['\t', ';', ','].into_iter().max_by_key(count).unwrap_or(',')
}

/// Finds the header among the first lines.
///
/// # Errors
/// Line and reason: nothing among the first lines names time, x and y.
pub(super) fn find_header(text: &str) -> Result<Header<'_>, (usize, String)> {
    let mut first = None;
    let mut comment = None;
    let mut walk = Walk::new(text);
    let mut above = 0;
    while above < PREAMBLE_MAX {
        let here = walk;
        let Some((line, content)) = walk.next_line() else { break };
        let trimmed = content.trim();
        if trimmed.is_empty() {
            continue;
        }
        if let Some(words) = trimmed.strip_prefix('#') {
            comment = Some(words.trim_start_matches('#'));
            continue;
        }
        let separator = separator_of(content);
        let mut rows = here;
        let cells = rows.next_record(separator).and_then(|record| record.cells.ok());
        let row = Row { cells: cells.unwrap_or_default() };
        match columns(&row) {
            Ok(columns) => return Ok(Header { columns, above, commented: false, separator, rows }),
            Err(lacking) => {
                if let Some(columns) = comment.take().and_then(|words| commented(words, &row, separator)) {
                    return Ok(Header { columns, above, commented: true, separator, rows: here });
                }
                let told = || crate::data::shortened(trimmed, TOLD);
                let wrong = || {
                    format!(
                        "expected a header like {} (other names, units and columns are known too), which needs \
                         {lacking}; found {:?}",
                        super::lines::HEADER,
                        told()
                    )
                };
                first.get_or_insert_with(|| (line, wrong()));
            }
        }
        above += 1;
    }
    Err(first.unwrap_or_else(|| {
        (0, "the file has no line with contents; it needs a header and samples".to_owned())
    }))
}

/// The columns that the comment above `row`, the first with numbers, names.
fn commented(words: &str, row: &Row<'_>, separator: char) -> Option<Columns> {
    let cells = Walk::new(words).next_record(separator)?.cells.ok()?;
    let columns = columns(&Row { cells }).ok()?;
    let numbers = [columns.t, columns.place[0], columns.place[1]];
    let is_row = row.fits(columns.count) && numbers.iter().all(|column| number(row.cell(*column)).is_some());
    is_row.then_some(columns)
}

/// Calls `use_row` with every row below the header.
///
/// # Errors
/// Line and reason: of `use_row`, or a row of another width.
pub(super) fn each_row(
    header: &Header<'_>,
    mut use_row: impl FnMut(&Row<'_>) -> Result<(), String>,
) -> Result<(), (usize, String)> {
    let count = header.columns.count;
    let mut walk = header.rows;
    while let Some(record) = walk.next_record(header.separator) {
        let at = |why| (record.line, why);
        let row = Row { cells: record.cells.map_err(at)? };
        if !row.fits(count) {
            let found = match row.cells.len() {
                found if found > COLUMNS_MAX => format!("more than {COLUMNS_MAX}"),
                found => found.to_string(),
            };
            return Err(at(format!("expected {count} fields, found {found}")));
        }
        use_row(&row).map_err(at)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rows(text: &str) -> Result<Vec<String>, (usize, String)> {
        let header = find_header(text)?;
        let mut rows = Vec::new();
        each_row(&header, |row| {
            let cells: Vec<&str> = (0..header.columns.count).map(|column| row.cell(column)).collect();
            rows.push(cells.join("|"));
            Ok(())
        })?;
        Ok(rows)
    }

    #[test]
    fn separators_quotes_marks_and_comments_are_no_part_of_a_cell() {
        let wanted = vec!["0,5|1|2".to_owned(), "1|a \"b\"|3".to_owned()];
        for text in [
            "\u{feff}# c\n\nt;x;y\r\n0,5; 1;2;\r\n # c;\n1;\"a \"\"b\"\"\";3\r\n",
            "#\n#\nt\tx\ty\n0,5\t1\t2\n\n1\ta \"b\"\t3",
            "# t,x\n\n\"t\",\"x\",\"y\"\n\"0,5\",1,2,,\n\n1,\"a \"\"b\"\"\",3\n",
            "\"t\", \"x\", \"y\"\r\"0,5\", 1, 2\r1 , \"a \"\"b\"\"\" ,3\r",
            "# t, x, y\n\"0,5\",1,2\n1,\"a \"\"b\"\"\",3\n",
        ] {
            assert_eq!(rows(text), Ok(wanted.clone()), "{text:?}");
        }
    }

    #[test]
    fn text_above_a_header_is_passed_over_and_counted() {
        let header = find_header("sep=;\nDevice: A, 200 Hz\nt;x;y\n1;2;3\n").ok().unwrap();
        assert_eq!((header.above, header.rows.line(), header.separator), (2, 4, ';'));
        let (line, why) = rows("\nx;y;p\n1;2;3\n").unwrap_err();
        assert!(
            line == 2 && why.contains("needs a column of time") && why.ends_with("found \"x;y;p\""),
            "{why}"
        );
        assert_eq!(rows("# only\n").unwrap_err().0, 0);
        assert_eq!(rows("t,x,y\n1,2\n").unwrap_err(), (2, "expected 3 fields, found 2".to_owned()));
        assert_eq!(rows("t,x,y\n1,2,3,4\n").unwrap_err(), (2, "expected 3 fields, found 4".to_owned()));
        let wide = format!("t,x,y\n1,2,3{}\n", ",".repeat(5000));
        assert_eq!(rows(&wide).unwrap_err(), (2, "expected 3 fields, found more than 1000".to_owned()));
    }

    #[test]
    fn a_line_break_in_quotes_is_part_of_a_cell_and_lines_are_counted_by_it() {
        let text = "t,x,y,\"a\nnote\"\n0,1,2,\"one\r\n\r\ntwo\"\n1,3,4,five\n2,3\n";
        assert_eq!(rows(text).unwrap_err(), (7, "expected 4 fields, found 2".to_owned()));
        let whole = text.strip_suffix("2,3\n").unwrap();
        assert_eq!(rows(whole), Ok(vec!["0|1|2|one\r\n\r\ntwo".to_owned(), "1|3|4|five".to_owned()]));
        let (line, why) = rows("t,x,y,note\n0,1,2,\"open\n1,2,3,a\n").unwrap_err();
        assert!(line == 2 && why.contains("no closing quote"), "{why}");
    }

    #[test]
    fn a_table_below_text_is_told_from_a_text_that_speaks_of_a_table() {
        for table in [
            "t,x,y\n",
            "Wacom\nRate: 200 Hz\n\nt;x;y\n0;1;2\n",
            "[Recording]\nDevice=A\nt,x,y\n0,1,2\n1,2,3\n2,3",
            "# t,x,y\n0,1,2\n",
        ] {
            assert!(begins(table), "{table}");
        }
        for text in [
            "Give columns such as\nt,x,y\nin this order\n",
            "Names:\nt,x,y\n",
            "As in\n\nt,x,y\n0,1,2\n\nwhich is a sample\n",
            "# t,x,y\nare the names\n",
        ] {
            assert!(!begins(text), "{text}");
        }
    }
}
