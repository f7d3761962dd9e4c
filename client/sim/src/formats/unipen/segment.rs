//! `.SEGMENT CHARACTER delimiter quality "label"`: which ink belongs to which character.
//!
//! Delimiter: comma list of `a` (component a), `a-b` (components a to b inclusive), `a:i-b:j` (point i of a
//! to point j of b inclusive; either point may be left out). Everything counts from 0.

use super::text::{Statement, shortened};
use crate::data::Component;

/// A parsed `.SEGMENT CHARACTER`.
pub(super) struct InkSegment {
    pub(super) label: String,
    /// Empty until something names it.
    pub(super) writer: String,
    ranges: Vec<Range>,
}

/// From a point of one component to a point of another, both inclusive.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Range {
    first: (usize, Option<usize>),
    last: (usize, Option<usize>),
}

/// `None` for the hierarchies above characters (words, lines, ...).
pub(super) fn parse_segment(statement: &Statement<'_>) -> Result<Option<InkSegment>, String> {
    // DIGIT is what pendigits calls its characters.
    if !matches!(statement.first(), "CHARACTER" | "DIGIT") {
        return Ok(None);
    }
    let whole: Vec<&str> = statement.lines().map(|(_, text)| text).collect();
    let whole = whole.join(" ");
    // The label may hold anything, blanks and commas too: cut it off before splitting the rest.
    let (head, label) = match whole.find('"') {
        Some(quote) => (whole.get(..quote), unquoted(whole.get(quote + 1..).unwrap_or_default())?),
        None => (Some(whole.as_str()), String::new()),
    };
    let mut tokens = head.unwrap_or_default().split_whitespace().skip(1);
    let mut delimiter = tokens.next().unwrap_or_default().to_owned();
    while delimiter.ends_with(',') {
        let Some(more) = tokens.next() else { break };
        delimiter.push_str(more);
    }
    let ranges = delimiter.split(',').map(range).collect::<Result<_, _>>()?;
    Ok(Some(InkSegment { label, writer: String::new(), ranges }))
}

impl InkSegment {
    /// The segment's ink; a gap stays with the component that begins inside it.
    pub(super) fn cut(&self, ink: &[Component], budget: &mut usize) -> Result<Vec<Component>, String> {
        let mut cut = Vec::new();
        for Range { first, last } in &self.ranges {
            for index in [first.0, last.0] {
                if index >= ink.len() {
                    return Err(out_of_range("component", index, ink.len()));
                }
            }
            let span = last.0 + 1 - first.0;
            for (index, whole) in ink.iter().enumerate().skip(first.0).take(span) {
                let from = first.1.filter(|_| index == first.0).unwrap_or(0);
                let to = last.1.filter(|_| index == last.0).unwrap_or(whole.points.len() - 1);
                let count = whole.points.len();
                let points = whole.points.get(from..=to);
                let points = points.ok_or_else(|| out_of_range("point", from.max(to), count))?;
                let cost = points.len() + super::COMPONENT_COST;
                *budget = budget.checked_sub(cost).ok_or_else(|| {
                    format!("the segments together have more than {} points", super::SEGMENT_POINTS_MAX)
                })?;
                cut.push(Component {
                    contact: whole.contact,
                    points: points.to_vec(),
                    dt_before_s: whole.dt_before_s.filter(|_| from == 0),
                });
            }
        }
        Ok(cut)
    }
}

fn out_of_range(what: &str, index: usize, count: usize) -> String {
    format!("segment out of range: {what} {index} of {count} (counted from 0)")
}

fn malformed(why: &str) -> String {
    format!("malformed segment: {why} (expected: .SEGMENT CHARACTER a-b[:j],... quality \"label\")")
}

fn range(text: &str) -> Result<Range, String> {
    let (first, last) = match text.split_once('-') {
        Some((first, last)) => (end(first)?, end(last)?),
        None => (end(text)?, end(text)?),
    };
    let reversed =
        first.0 > last.0 || (first.0 == last.0 && matches!((first.1, last.1), (Some(i), Some(j)) if i > j));
    if reversed {
        return Err(malformed(&format!("{:?} runs backwards", shortened(text))));
    }
    Ok(Range { first, last })
}

fn end(text: &str) -> Result<(usize, Option<usize>), String> {
    let index =
        |digits: &str| {
            digits.parse::<usize>().ok().filter(|&n| n < usize::MAX).ok_or_else(|| {
                malformed(&format!("{:?} is not a component or component:point", shortened(text)))
            })
        };
    match text.split_once(':') {
        Some((component, point)) => Ok((index(component)?, Some(index(point)?))),
        None => Ok((index(text)?, None)),
    }
}

/// The text up to the closing quote; `\"` and `\\` (and any other `\c`) stand for the second character.
fn unquoted(text: &str) -> Result<String, String> {
    let mut label = String::new();
    let mut characters = text.chars();
    while let Some(c) = characters.next() {
        match c {
            '"' => return Ok(label),
            '\\' => label.extend(characters.next()),
            _ => label.push(c),
        }
    }
    Err(malformed("the label has no closing quote"))
}

#[cfg(test)]
mod tests {
    use super::super::text::read_statements;
    use super::*;

    fn parsed(line: &str) -> Result<Option<InkSegment>, String> {
        parse_segment(&read_statements(line)[0])
    }

    #[test]
    fn every_form_of_the_delimiter_is_read() {
        let s = parsed(".SEGMENT CHARACTER 34-34:28,34:48-34:88,41, 7:2-9 ? \"b\"").unwrap().unwrap();
        let r = |first, last| Range { first, last };
        assert_eq!(
            s.ranges,
            [
                r((34, None), (34, Some(28))),
                r((34, Some(48)), (34, Some(88))),
                r((41, None), (41, None)),
                r((7, Some(2)), (9, None))
            ]
        );
    }

    #[test]
    fn quotes_and_backslashes_in_labels_are_unescaped() {
        for (written, meant) in [(r#""\"""#, "\""), (r#""\\""#, "\\"), (r#""a b""#, "a b"), (r#"",""#, ",")] {
            let s = parsed(&format!(".SEGMENT CHARACTER 0 OK {written}")).unwrap().unwrap();
            assert_eq!(s.label, meant);
        }
    }

    #[test]
    fn a_segment_spread_over_lines_reads_like_one_on_a_line() {
        let s = parsed(".SEGMENT CHARACTER\n 1-2,\n 4 OK\n \"q\"\n").unwrap().unwrap();
        assert_eq!((s.ranges.len(), s.label.as_str()), (2, "q"));
    }

    #[test]
    fn malformed_segments_are_refused() {
        for line in
            ["5-3 ? \"a\"", "1:9-1:2 ? \"a\"", "x ? \"a\"", "", "1- ? \"a\"", "1 ? \"a", "1,,2 ? \"a\""]
        {
            assert!(parsed(&format!(".SEGMENT CHARACTER {line}")).is_err(), "{line}");
        }
    }

    #[test]
    fn words_and_lines_are_passed_over() {
        assert!(parsed(".SEGMENT WORD 0-9 ? \"and\"").unwrap().is_none());
    }
}
