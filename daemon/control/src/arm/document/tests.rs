//! Documents of arms as others write them.

use super::*;
use crate::arm::description;

/// What the bounds say, and that the whole reader says the same.
fn refusal(text: &str) -> String {
    let why = document(text, false).map(|_| ()).unwrap_err();
    assert_eq!(description(text).map(|_| ()).unwrap_err(), why);
    why.to_string()
}

fn nested(depth: usize) -> String {
    format!("<robot name=\"x\">{}{}</robot>", "<link>".repeat(depth), "</link>".repeat(depth))
}

#[test]
fn a_description_beyond_a_bound_is_refused_before_it_is_read() {
    for depth in [DEEPEST, 20_000, 60_000, 300_000] {
        let unnamed = nested(depth).replacen("<link>", "<gazebo>", 1);
        let refusal = refusal(&unnamed);
        assert!(refusal.contains("65 elements inside each other (line 1), 64 are the most"), "{refusal}");
    }
    let open = "<a b='</a>'><!-- </a> --><![CDATA[</a>]]>".repeat(1000);
    let refused = refusal(&format!("<robot>{open}"));
    assert!(refused.contains("inside each other"), "{refused}");
    let tiny = format!("<robot>{}</robot>", "<a/>".repeat(10_000_000));
    assert!(refusal(&tiny).contains("40000015 bytes, 4194304 are the most"), "{}", refusal(&tiny));
    let links: String = (0..30_000).map(|n| format!("<link name='{n}'/>")).collect();
    let refused = refusal(&format!("<robot>{links}</robot>"));
    assert!(refused.contains("20001 elements (line 1), 20000 are the most"), "{refused}");
    let deep = format!("<robot>\n\n{}", "<a>".repeat(DEEPEST));
    assert!(refusal(&deep).contains("(line 3)"), "{}", refusal(&deep));
    // An attribute that is too long counts where it is used.
    let long = |bytes| format!("<robot><link name=\"{}\"/></robot>", "[".repeat(bytes));
    let refused = description(&long(1001)).map(|_| ()).unwrap_err().to_string();
    assert!(refused.contains("1001 bytes in one attribute, 1000 are the most"), "{refused}");
    assert!(description(&long(1000)).is_ok());
}

/// Nothing that is not used is copied, counted or looked into: it ends in time whatever it is.
#[test]
fn what_is_not_used_costs_a_scan_only() {
    let attributes: String = (0..150_000).map(|n| format!(" a{n}=''")).collect();
    for unused in [
        "<a/>".repeat(100_000),
        "<!---->".repeat(50_000),
        format!("<a{attributes}/>"),
        format!("<![CDATA[{}]]>", "]".repeat(3_000_000)),
        format!("<plugin filename='{}'/>", "x".repeat(3_000_000)),
        "<a b='äöü€𝄞'/>é &amp; & &nothing;".repeat(5_000),
    ] {
        let found = document(&format!("<robot><link name='l'/>{unused}<link name='m'/></robot>"), false);
        let found = found.unwrap_or_else(|why| panic!("{unused:.60}: {why}"));
        assert_eq!(found.links.iter().map(|link| link.name.as_str()).collect::<Vec<_>>(), ["l", "m"]);
    }
}

#[test]
fn what_is_no_element_does_not_count_as_one() {
    let hidden = "<!-- <a> --><b c=\"<a>\"/><![CDATA[<a>]]><?a <a>?>".repeat(DEEPEST * 2);
    assert!(document(&format!("<robot>{hidden}</robot>"), false).is_ok());
    // After the root nothing is read; before it, an end has no beginning.
    assert!(document(&format!("<robot/>{}", "<a>".repeat(DEEPEST * 2)), false).is_ok());
    assert!(document("</a></a><b c=''/>", false).is_err());
}

#[test]
fn text_that_is_no_urdf_names_the_line_and_what_is_wrong() {
    for (text, line, words) in [
        ("", 1, "no element <robot>"),
        ("\n\n  nothing", 1, "text where <robot> should begin"),
        ("<?xml version='1.0'?>\n<!-- a\n -->\n<sdf version='1.6'>", 4, "its root is <sdf>"),
        ("<robot name='a'>\n<link name='b'>\n", 3, "2 elements open"),
        ("<robot>\n<link name='b'>\n</joint></robot>", 3, "link"),
        ("<robot>\n\n<link/></robot>", 3, "a <link> has no name"),
        ("<robot>\n<link name='a' name='b'/></robot>", 2, "<link name>: it stands there twice"),
        ("<robot>\n<link name='a\u{1b}b'/></robot>", 2, "U+001B is a character that XML forbids"),
        ("<robot>\n<link name='a&#27;b'/></robot>", 2, "U+001B is a character that XML forbids"),
        ("<robot>\n<link name='\u{fffe}'/></robot>", 2, "U+FFFE is a character that XML forbids"),
        ("<!--a\n\n--><robot version='x&#0;'><link name='a'/></robot>", 3, "<robot version>"),
        ("<!--\r\r-->\r<robot>\r<link/></robot>", 5, "a <link> has no name"),
        ("<!--\r\n-->\r\n<robot>\r<link/></robot>", 4, "a <link> has no name"),
        ("version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 9\n", 1, "pointer of Git LFS"),
        ("<robot>\n<link name='&mine;'/></robot>", 2, "<link name>"),
        ("<robot>\n<link name=b/></robot>", 2, "<link>"),
    ] {
        let why = description(text).map(|_| ()).unwrap_err().to_string();
        assert!(why.contains(&format!("line {line}: ")) && why.contains(words), "{text}: {why}");
    }
}
