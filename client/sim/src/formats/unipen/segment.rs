//! `.SEGMENT type delimiter quality "label"`: which ink belongs to what was written.
//!
//! Delimiter: comma list of `a` (component a), `a-b` (components a to b inclusive), `a:i-b:j` (point i of a
//! to point j of b inclusive; either point may be left out). Everything counts from 0. Without a delimiter
//! the segment has the components up to the next one that counts; where ink stands above the first of them
//! and none below the last, it has those since the one before.

use super::text::{Statement, shortened};
use crate::data::Component;
use std::collections::HashMap;

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
const KINDS: [&[&str]; 7] = [
    // DIGIT is what pendigits calls its characters.
    &["CHARACTER", "DIGIT"],
    // Parts of characters or others for them, beside those.
    &["SYMBOL", "GLYPH"],
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

/// How fine types of segments are.
pub(super) struct Levels<'h>(HashMap<&'h str, usize>);

impl<'h> Levels<'h> {
    /// `hierarchy` is what the file says of its types, from coarse to fine; it orders those that are not
    /// known here.
    pub(super) fn new(hierarchy: &'h [String]) -> Self {
        let told = hierarchy.iter().enumerate();
        Self(told.map(|(index, kind)| (kind.as_str(), KINDS.len() + hierarchy.len() - 1 - index)).collect())
    }

    /// The less, the finer.
    pub(super) fn of(&self, kind: &str) -> usize {
        let known = KINDS.iter().position(|kinds| kinds.contains(&kind));
        known.or_else(|| self.0.get(kind).copied()).unwrap_or(usize::MAX)
    }
}

/// Keeps the finest segments: characters, else words, else lines and so on; with their level.
pub(super) fn finest<T>(
    mut segments: Vec<(T, InkSegment)>,
    levels: &Levels<'_>,
) -> (Vec<(T, InkSegment)>, usize) {
    let of_each: Vec<usize> = segments.iter().map(|(_, segment)| levels.of(&segment.kind)).collect();
    let finest = of_each.iter().copied().min().unwrap_or(usize::MAX);
    let mut level = of_each.into_iter();
    segments.retain(|_| level.next() == Some(finest));
    (segments, finest)
}

/// Gives segments without a delimiter the components between them. `inked`: which components are ink.
pub(super) fn delimit<T>(segments: &mut [(T, InkSegment)], inked: &[bool]) {
    let components = inked.len();
    let begins: Vec<usize> = segments.iter().map(|(_, segment)| segment.begins).collect();
    let below = stand_below(segments, inked);
    let mut covered = 0;
    for (index, (_, segment)) in segments.iter_mut().enumerate() {
        if segment.ranges.is_empty() {
            let next = begins.get(index + 1).copied().unwrap_or(components);
            let behind = !below && segment.begins < next;
            let (first, end) = if behind { (segment.begins, next) } else { (covered, segment.begins) };
            if first < end {
                segment.ranges.push(Range { first: (first, None), last: (end - 1, None) });
            }
        }
        covered = covered.max(segment.end());
    }
}

/// Whether segments without a delimiter stand below their ink: the first has ink above it that is nobody's,
/// and the last has none below it.
fn stand_below<T>(segments: &[(T, InkSegment)], inked: &[bool]) -> bool {
    let ink = |from: usize, to: usize| inked.get(from..to).unwrap_or_default().contains(&true);
    let bare = |(_, segment): &&(T, InkSegment)| segment.ranges.is_empty();
    let (Some((_, first)), Some((_, last))) = (segments.iter().find(bare), segments.iter().rev().find(bare))
    else {
        return false;
    };
    let before = segments.iter().take_while(|segment| !bare(segment));
    let covered = before.map(|(_, segment)| segment.end()).max().unwrap_or_default();
    ink(covered, first.begins) && !ink(last.begins, inked.len())
}

/// Whether this type is of single characters.
pub(super) fn is_character(kind: &str) -> bool {
    KINDS.first().is_some_and(|kinds| kinds.contains(&kind.to_ascii_uppercase().as_str()))
}

impl InkSegment {
    /// Components up to the last one of the delimiter.
    fn end(&self) -> usize {
        self.ranges.iter().map(|range| range.last.0.saturating_add(1)).max().unwrap_or_default()
    }

    /// Marks its components in `taken`.
    pub(super) fn mark(&self, taken: &mut [bool]) {
        for Range { first, last } in &self.ranges {
            taken.get_mut(first.0..=last.0).unwrap_or_default().fill(true);
        }
    }

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
        let (mut segments, _) = finest(segments, &Levels::new(&hierarchy));
        delimit(&mut segments, &vec![true; begins]);
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
        let pairs = ["2", "CHARACTER \"a\"", "3", "CHARACTER \"b\"", "1", "CHARACTER \"c\""];
        let each =
            [wanted("CHARACTER", "a", 0, 1), wanted("CHARACTER", "b", 2, 4), wanted("CHARACTER", "c", 5, 5)];
        assert_eq!(left(&pairs, &[]), each);
        // Above their ink, the first two components are nobody's.
        assert_eq!(left(&[&pairs[..4], &["1"]].concat(), &[])[0], wanted("CHARACTER", "a", 2, 4));
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
        // Parts of characters are no characters beside them, and digits are.
        let parts = ["GLYPH 0 ? \"g\"", "CHARACTER 0-1 ? \"a\"", "SYMBOL 1 ? \"s\"", "DIGIT 2 ? \"7\"", "3"];
        assert_eq!(left(&parts, &[]), [wanted("CHARACTER", "a", 0, 1), wanted("DIGIT", "7", 2, 2)]);
        assert_eq!(left(&parts[..1], &[]), [wanted("GLYPH", "g", 0, 0)]);
    }
}
