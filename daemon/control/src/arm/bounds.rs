//! How large, deep and full a robot description may be, before anything recursive reads it.
//!
//! Contract: counted with the reader of XML that `urdf-rs` builds its tree with, so that no comment, quote or
//! CDATA is read in two ways. That reader is a loop; the tree is copied, written and dropped by recursion.

use xml::{Event, Parser};

use super::urdf::ChainError;

/// Longest description \[bytes\]: a hundred times that of a UR.
pub const LONGEST_BYTES: usize = 4 << 20;
/// Elements inside each other at most; URDF has six, with what simulators add a dozen.
const DEEPEST: usize = 64;
/// Elements at most: fifty times those of a UR.
const MOST_ELEMENTS: usize = 20_000;
const MOST_ATTRIBUTES: usize = 100_000;
/// Longest attribute \[bytes\]: an error may show it.
const LONGEST_ATTRIBUTE: usize = 1000;
/// Tags, comments and pieces of text at most: each becomes a node in memory.
const MOST_NODES: usize = 5 * MOST_ELEMENTS;
/// `]` in a row at most: the reader counts them in a byte.
const MOST_BRACKETS: usize = 64;
/// Bytes that the reader is given at a time: it keeps four times as many.
const PIECE_BYTES: usize = 4096;

/// Refuses a description beyond one of the bounds, which the error names. Malformed ones pass: what is wrong
/// with them is reported by their reader.
///
/// # Errors
/// [`ChainError::Bound`].
pub(super) fn bounded(text: &str) -> Result<(), ChainError> {
    let beyond = |what, found, most| Err(ChainError::Bound { what, found, most });
    if text.len() > LONGEST_BYTES {
        return beyond("bytes", text.len(), LONGEST_BYTES);
    }
    // Before the reader collects those of one tag: an attribute has an equals sign.
    let equals = text.bytes().filter(|byte| *byte == b'=').count();
    if equals > MOST_ATTRIBUTES {
        return beyond("attributes", equals, MOST_ATTRIBUTES);
    }
    let mut brackets = 0;
    for byte in text.bytes() {
        brackets = if byte == b']' { brackets + 1 } else { 0 };
        if brackets > MOST_BRACKETS {
            return beyond("closing brackets in a row", brackets, MOST_BRACKETS);
        }
    }
    let (mut depth, mut elements, mut nodes) = (0_usize, 0, 0);
    let (mut parser, mut rest) = (Parser::new(), text);
    while !rest.is_empty() {
        let cut = (PIECE_BYTES..).find(|cut| *cut >= rest.len() || rest.is_char_boundary(*cut));
        let (chunk, after) = rest.split_at_checked(cut.unwrap_or(rest.len())).unwrap_or((rest, ""));
        parser.feed_str(chunk);
        rest = after;
        for event in &mut parser {
            nodes += 1;
            match event {
                Ok(Event::ElementStart(tag)) => {
                    (depth, elements) = (depth + 1, elements + 1);
                    let longest = tag.attributes.values().map(String::len).max().unwrap_or_default();
                    if longest > LONGEST_ATTRIBUTE {
                        return beyond("bytes in one attribute", longest, LONGEST_ATTRIBUTE);
                    }
                }
                // The reader has no place for an end without a beginning, and stops at the end of the root.
                Ok(Event::ElementEnd(_)) if depth <= 1 => return Ok(()),
                Ok(Event::ElementEnd(_)) => depth -= 1,
                Ok(_) => {}
                Err(_) => return Ok(()),
            }
            if depth > DEEPEST {
                return beyond("elements inside each other", depth, DEEPEST);
            }
            if elements > MOST_ELEMENTS {
                return beyond("elements", elements, MOST_ELEMENTS);
            }
            if nodes > MOST_NODES {
                return beyond("tags, comments and pieces of text", nodes, MOST_NODES);
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::arm::description;

    /// What the bounds say, and that the whole reader says the same.
    fn refusal(text: &str) -> String {
        let why = bounded(text).unwrap_err();
        assert_eq!(description(text).unwrap_err(), why);
        why.to_string()
    }

    fn nested(depth: usize) -> String {
        format!("<robot name=\"x\">{}{}</robot>", "<link>".repeat(depth), "</link>".repeat(depth))
    }

    #[test]
    fn a_description_beyond_a_bound_is_refused_before_it_is_read() {
        for depth in [DEEPEST, 20_000, 60_000, 300_000] {
            let refusal = refusal(&nested(depth));
            assert!(refusal.contains("65 elements inside each other, 64 are the most"), "{refusal}");
        }
        assert!(bounded(&nested(DEEPEST - 1)).is_ok());
        // Never closed, and with comments and quotes that hide nothing.
        let open = "<a b='</a>'><!-- </a> --><![CDATA[</a>]]>".repeat(1000);
        assert!(refusal(&open).contains("inside each other"));
        let tiny = format!("<robot>{}</robot>", "<a/>".repeat(10_000_000));
        assert!(refusal(&tiny).contains("40000015 bytes, 4194304 are the most"), "{}", refusal(&tiny));
        let tiny = format!("<robot>{}</robot>", "<a/>".repeat(1_000_000));
        assert!(refusal(&tiny).contains("20001 elements, 20000 are the most"), "{}", refusal(&tiny));
        let comments = format!("<robot>{}</robot>", "<!---->".repeat(500_000));
        assert!(refusal(&comments).contains("tags, comments and pieces of text"));
        let attributes: String = (0..150_000).map(|n| format!(" a{n}=''")).collect();
        assert!(refusal(&format!("<robot{attributes}/>")).contains("150000 attributes"));
        let long = |bytes| format!("<robot name=\"{}\"/>", "[".repeat(bytes));
        assert!(refusal(&long(1001)).contains("1001 bytes in one attribute, 1000 are the most"));
        assert!(bounded(&long(1000)).is_ok());
        // 256 in a row overflow the reader's count.
        let brackets = format!("<robot><![CDATA[{}]]></robot>", "]".repeat(3_000_000));
        assert!(refusal(&brackets).contains("closing brackets in a row"));
    }

    #[test]
    fn what_is_no_element_does_not_count_as_one() {
        let hidden = "<!-- <a> --><b c=\"<a>\"/><![CDATA[<a>]]><?a <a>?>".repeat(DEEPEST * 2);
        assert_eq!(bounded(&format!("<robot>{hidden}</robot>")), Ok(()));
        // After the root nothing is read; before it, an end has no beginning.
        assert_eq!(bounded(&format!("<robot/>{}", "<a>".repeat(DEEPEST * 2))), Ok(()));
        assert_eq!(bounded("</a></a><b c=''/>"), Ok(()));
        assert!(description("</a></a><b c=''/>").is_err());
    }

    #[test]
    fn pieces_are_cut_between_characters() {
        let wide = format!("<robot>{}</robot>", "<a b='äöü€𝄞'/>é".repeat(2000));
        assert_eq!(bounded(&wide), Ok(()));
    }
}
