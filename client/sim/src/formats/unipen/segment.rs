//! `.SEGMENT type delimiter quality "label"`: which ink belongs to what was written.
//!
//! Delimiter: comma list of `a` (component a), `a-b` (components a to b inclusive), `a:i-b:j` (point i of a
//! to point j of b inclusive; either point may be left out). Everything counts from 0. Without a delimiter
//! the segment has the components up to the next one of its type; at the end of a file, those since the last.

use super::text::{Statement, shortened};
use crate::data::Component;

pub(super) struct InkSegment {
    pub(super) kind: String,
    pub(super) label: String,
    /// Empty until something names it.
    pub(super) writer: String,
    /// Empty where there is no delimiter.
    ranges: Vec<Range>,
    /// Components before the statement.
    begins: usize,
}

/// From a point of one component to a point of another, both inclusive.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Range {
    first: (usize, Option<usize>),
    last: (usize, Option<usize>),
}

/// Segments from fine to coarse; those that a file names no finer ones beside are its characters.
const KINDS: [&[&str]; 6] = [
    // DIGIT is what pendigits calls its characters.
    &["CHARACTER", "DIGIT", "SYMBOL", "GLYPH"],
    &["WORD"],
    &["SENTENCE", "LINE", "PHRASE", "TEXT_LINE", "FORMULA"],
    &["PARAGRAPH", "TEXT"],
    &["PAGE", "DOCUMENT"],
    &["SET"],
];
/// What may stand where the quality does.
const QUALITIES: [&str; 9] = ["?", "OK", "GOOD", "BAD", "FAIR", "LABELED", "UNLABELED", "UNKNOWN", "NONE"];

/// Parses a `.SEGMENT` behind `begins` components.
pub(super) fn parse_segment(statement: &Statement<'_>, begins: usize) -> Result<InkSegment, String> {
    let whole: Vec<&str> = statement.lines().map(|(_, text)| text).collect();
    let whole = whole.join(" ");
    // The label may hold anything, blanks and commas too: cut it off before splitting the rest.
    let (head, label) = match whole.find('"') {
        Some(quote) => (whole.get(..quote), unquoted(whole.get(quote + 1..).unwrap_or_default())?),
        None => (Some(whole.as_str()), String::new()),
    };
    let mut tokens = head.unwrap_or_default().split_whitespace();
    let kind = tokens.next().unwrap_or_default().to_ascii_uppercase();
    let mut delimiter = tokens.next().unwrap_or_default().to_owned();
    while delimiter.ends_with(',') {
        let Some(more) = tokens.next() else { break };
        delimiter.push_str(more);
    }
    let bare = delimiter.is_empty() || QUALITIES.contains(&delimiter.to_ascii_uppercase().as_str());
    let ranges = if bare { Vec::new() } else { delimiter.split(',').map(range).collect::<Result<_, _>>()? };
    Ok(InkSegment { kind, label, writer: String::new(), ranges, begins })
}

/// Keeps the finest segments: characters, else words, else lines and so on. `hierarchy` is what the file says
/// of its types, from coarse to fine; it orders those that are not known here.
pub(super) fn finest<T>(segments: Vec<(T, InkSegment)>, hierarchy: &[String]) -> Vec<(T, InkSegment)> {
    let level = |kind: &str| {
        let known = KINDS.iter().position(|kinds| kinds.contains(&kind));
        let told = hierarchy.iter().rev().position(|told| told == kind);
        known.unwrap_or(KINDS.len() + told.unwrap_or(hierarchy.len()))
    };
    let least = segments.iter().map(|(_, segment)| level(&segment.kind)).min();
    segments.into_iter().filter(|(_, segment)| Some(level(&segment.kind)) == least).collect()
}

/// Gives segments without a delimiter the components between them.
pub(super) fn delimit<T>(segments: &mut [(T, InkSegment)], components: usize) {
    let begins: Vec<usize> = segments.iter().map(|(_, segment)| segment.begins).collect();
    let mut covered = 0;
    for (index, (_, segment)) in segments.iter_mut().enumerate() {
        if segment.ranges.is_empty() {
            let next = begins.get(index + 1).copied().unwrap_or(components);
            // Where segments stand below their ink, the last one has nothing behind it.
            let (first, end) =
                if segment.begins < next { (segment.begins, next) } else { (covered, segment.begins) };
            if first < end {
                segment.ranges.push(Range { first: (first, None), last: (end - 1, None) });
            }
        }
        let last = segment.ranges.iter().map(|range| range.last.0 + 1).max();
        covered = covered.max(last.unwrap_or_default());
    }
}

/// Whether this type is of single characters.
pub(super) fn is_character(kind: &str) -> bool {
    KINDS.first().is_some_and(|kinds| kinds.contains(&kind.to_ascii_uppercase().as_str()))
}

impl InkSegment {
    pub(super) fn has_ink(&self) -> bool {
        !self.ranges.is_empty()
    }

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
                    stamps_s: whole.stamps_s.get(from..=to).unwrap_or_default().to_vec(),
                    dt_before_s: whole.dt_before_s.filter(|_| from == 0),
                    continues: false,
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

    fn parsed(line: &str) -> Result<InkSegment, String> {
        parse_segment(&read_statements(line)[0], 0)
    }

    #[test]
    fn every_form_of_the_delimiter_is_read() {
        let s = parsed(".SEGMENT CHARACTER 34-34:28,34:48-34:88,41, 7:2-9 ? \"b\"").unwrap();
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
            let s = parsed(&format!(".SEGMENT CHARACTER 0 OK {written}")).unwrap();
            assert_eq!(s.label, meant);
        }
    }

    #[test]
    fn a_segment_spread_over_lines_reads_like_one_on_a_line() {
        let s = parsed(".SEGMENT CHARACTER\n 1-2,\n 4 OK\n \"q\"\n").unwrap();
        assert_eq!((s.ranges.len(), s.label.as_str()), (2, "q"));
    }

    #[test]
    fn malformed_segments_are_refused() {
        for line in ["5-3 ? \"a\"", "1:9-1:2 ? \"a\"", "x ? \"a\"", "1- ? \"a\"", "1 ? \"a", "1,,2 ? \"a\""] {
            assert!(parsed(&format!(".SEGMENT CHARACTER {line}")).is_err(), "{line}");
        }
    }

    /// Kinds, labels, and first and last component, of what is left of `lines`; a number is ink.
    fn left(lines: &[&str], hierarchy: &[&str]) -> Vec<(String, String, usize, usize)> {
        let mut begins = 0;
        let mut segments = Vec::new();
        for line in lines {
            match line.parse::<usize>() {
                Ok(components) => begins += components,
                Err(_) => segments.push((
                    (),
                    parse_segment(&read_statements(&format!(".SEGMENT {line}"))[0], begins).unwrap(),
                )),
            }
        }
        let hierarchy: Vec<String> = hierarchy.iter().map(|kind| (*kind).to_owned()).collect();
        let mut segments = finest(segments, &hierarchy);
        delimit(&mut segments, begins);
        let of = |(_, s): ((), InkSegment)| (s.kind, s.label, s.ranges[0].first.0, s.ranges[0].last.0);
        segments.into_iter().map(of).collect()
    }

    fn wanted(kind: &str, label: &str, first: usize, last: usize) -> (String, String, usize, usize) {
        (kind.to_owned(), label.to_owned(), first, last)
    }

    #[test]
    fn a_segment_without_delimiter_has_the_ink_up_to_the_next() {
        let three = ["CHARACTER", "3", "CHARACTER ? ? \"b\"", "2"];
        assert_eq!(left(&three, &[]), [wanted("CHARACTER", "", 0, 2), wanted("CHARACTER", "b", 3, 4)]);
        let below = ["2", "CHARACTER \"a\""];
        assert_eq!(left(&below, &[]), [wanted("CHARACTER", "a", 0, 1)]);
        let mixed = ["4", "CHARACTER 0-1 OK \"a\"", "CHARACTER OK \"b\""];
        assert_eq!(left(&mixed, &[]), [wanted("CHARACTER", "a", 0, 1), wanted("CHARACTER", "b", 2, 3)]);
    }

    #[test]
    fn without_characters_words_count_and_without_those_sentences() {
        let page = ["PAGE 0-8", "SENTENCE 0-5 ? \"a b\"", "WORD 0-2 ? \"a\"", "word 3-5 ? \"b\"", "9"];
        assert_eq!(left(&page, &[]), [wanted("WORD", "a", 0, 2), wanted("WORD", "b", 3, 5)]);
        assert_eq!(left(&page[..2], &[]), [wanted("SENTENCE", "a b", 0, 5)]);
        // Types that only the file itself orders.
        let own = ["SHEET 0-3", "FIELD 0-1 OK \"7\"", "4"];
        assert_eq!(left(&own, &["SHEET", "FIELD"]), [wanted("FIELD", "7", 0, 1)]);
    }
}
