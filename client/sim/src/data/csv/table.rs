//! The rows of a text with separators: which separator it has, where its header is, numbers of every writing.
//!
//! Contract: separators `,` `;` tab; quotes as in RFC 4180; a decimal comma where it cannot be a separator.
//! Lines that begin with `#` and empty ones are passed over; a few lines of other text may stand above the
//! header.

use super::names::{Columns, Lacking};
use csv::{ReaderBuilder, StringRecord};
use std::borrow::Cow;

/// Lines above the header at most: exports begin with the device's name and settings.
const PREAMBLE_MAX: usize = 100;
const COLUMNS_MAX: usize = 1000;
/// Characters of a header in a message.
const TOLD: usize = 80;

/// A header that was found.
pub(super) struct Header {
    pub(super) columns: Columns,
    /// Lines of other text above it.
    pub(super) above: usize,
    separator: char,
    /// Its line, from 1.
    line: usize,
}

/// The cells of a row, without blanks around them.
pub(super) struct Row<'r> {
    cells: Vec<Cow<'r, str>>,
}

impl Row<'_> {
    pub(super) fn cell(&self, column: usize) -> &str {
        self.cells.get(column).map_or("", |cell| cell.trim())
    }

    /// Cells, those at the end without contents left out.
    fn width(&self) -> usize {
        self.cells.iter().rposition(|cell| !cell.trim().is_empty()).map_or(0, |last| last + 1)
    }
}

/// Whether the first line with contents is a header of pen samples.
pub(super) fn begins(text: &str) -> bool {
    lines(text).find(|(_, line)| !skipped(line)).is_some_and(|(_, line)| header(line).is_ok())
}

fn skipped(line: &str) -> bool {
    let line = line.trim();
    line.is_empty() || line.starts_with('#')
}

/// Number and text of each line.
fn lines(text: &str) -> impl Iterator<Item = (usize, &str)> {
    text.trim_start_matches('\u{feff}').lines().enumerate().map(|(index, line)| (index + 1, line))
}

fn cells(line: &str, separator: char) -> Vec<Cow<'_, str>> {
    if !line.contains('"') {
        return line.split(separator).map(Cow::Borrowed).collect();
    }
    let mut builder = ReaderBuilder::new();
    builder.delimiter(separator as u8).has_headers(false).flexible(true);
    let mut record = StringRecord::new();
    // The text is UTF-8 and in memory: there is nothing that could fail but a line without cells.
    match builder.from_reader(line.trim().as_bytes()).read_record(&mut record) {
        Ok(true) => record.iter().map(|cell| Cow::Owned(cell.to_owned())).collect(),
        _ => Vec::new(),
    }
}

fn header(line: &str) -> Result<(Columns, char), Lacking> {
    let separator = ['\t', ';', ','].into_iter().max_by_key(|separator| line.matches(*separator).count());
    let separator = separator.unwrap_or(',');
    let row = Row { cells: cells(line, separator) };
    if row.width() > COLUMNS_MAX {
        return Err(Lacking::Time);
    }
    let names: Vec<&str> = (0..row.width()).map(|column| row.cell(column)).collect();
    Ok((Columns::of(&names)?, separator))
}

/// Finds the header among the first lines.
///
/// # Errors
/// Line and reason: nothing among the first lines names time, x and y.
pub(super) fn find_header(text: &str) -> Result<Header, (usize, String)> {
    let mut first = None;
    let contents = lines(text).filter(|(_, line)| !skipped(line)).take(PREAMBLE_MAX);
    for (above, (line, content)) in contents.enumerate() {
        match header(content) {
            Ok((columns, separator)) => {
                return Ok(Header { columns, above, separator, line });
            }
            Err(lacking) => {
                let told = || crate::data::shortened(content.trim(), TOLD);
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
    }
    Err(first.unwrap_or_else(|| {
        (0, "the file has no line with contents; it needs a header and samples".to_owned())
    }))
}

/// Calls `use_row` with every row below the header.
///
/// # Errors
/// Line and reason: of `use_row`, or a row of another width.
pub(super) fn each_row(
    text: &str,
    header: &Header,
    mut use_row: impl FnMut(&Row<'_>) -> Result<(), String>,
) -> Result<(), (usize, String)> {
    let count = header.columns.count;
    for (line, content) in lines(text).skip(header.line).filter(|(_, line)| !skipped(line)) {
        let row = Row { cells: cells(content, header.separator) };
        let width = row.width();
        if width > count || row.cells.len() < count {
            return Err((line, format!("expected {count} fields, found {}", row.cells.len())));
        }
        use_row(&row).map_err(|why| (line, why))?;
    }
    Ok(())
}

/// A finite number, with a point or a comma before its fraction.
pub(super) fn number(text: &str) -> Option<f64> {
    let value: f64 = match text.matches(',').count() {
        0 => text.parse().ok()?,
        1 if !text.contains('.') => text.replace(',', ".").parse().ok()?,
        _ => return None,
    };
    value.is_finite().then_some(value)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rows(text: &str) -> Result<Vec<String>, (usize, String)> {
        let header = find_header(text)?;
        let mut rows = Vec::new();
        each_row(text, &header, |row| {
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
        ] {
            assert_eq!(rows(text), Ok(wanted.clone()), "{text:?}");
        }
    }

    #[test]
    fn text_above_a_header_is_passed_over_and_counted() {
        let header = find_header("sep=;\nDevice: A, 200 Hz\nt;x;y\n1;2;3\n").ok().unwrap();
        assert_eq!((header.above, header.line, header.separator), (2, 3, ';'));
        let (line, why) = rows("\nx;y;p\n1;2;3\n").unwrap_err();
        assert!(
            line == 2 && why.contains("needs a column of time") && why.ends_with("found \"x;y;p\""),
            "{why}"
        );
        assert_eq!(rows("# only\n").unwrap_err().0, 0);
        assert_eq!(rows("t,x,y\n1,2\n").unwrap_err(), (2, "expected 3 fields, found 2".to_owned()));
        assert_eq!(rows("t,x,y\n1,2,3,4\n").unwrap_err(), (2, "expected 3 fields, found 4".to_owned()));
    }

    #[test]
    fn a_comma_may_stand_before_the_fraction() {
        for (text, wanted) in
            [("0,25", Some(0.25)), ("-1e-3", Some(-1e-3)), ("1,000.5", None), ("1,0,0", None), ("inf", None)]
        {
            assert_eq!(number(text), wanted, "{text}");
        }
    }
}
