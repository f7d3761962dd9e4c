//! The headers say what the library does.

use foretrace_c::ErrorCode;

/// Made by `foretrace schema c`; `FORETRACE_BLESS=1` writes it anew.
#[test]
fn the_header_of_messages_is_that_of_the_tables() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/include/foretrace/messages.h");
    let now = foretrace_shm::c_header();
    if std::env::var_os("FORETRACE_BLESS").is_some() {
        std::fs::write(path, &now).unwrap();
    }
    let there = std::fs::read_to_string(path).unwrap_or_default();
    let same = there == now;
    assert!(
        same,
        "messages.h is of other messages: FORETRACE_BLESS=1 cargo test -p foretrace-c --test headers"
    );
}

#[test]
fn error_codes_of_header_and_library_are_the_same() {
    let header = include_str!("../include/foretrace/foretrace.h");
    let codes =
        header.split("enum foretrace_error {").nth(1).and_then(|rest| rest.split("};").next()).unwrap();
    let written: Vec<(String, i32)> = codes
        .lines()
        .filter_map(|line| line.trim().trim_end_matches(',').split_once(" = "))
        .map(|(name, number)| (name.replace("FORETRACE_", ""), number.parse().unwrap()))
        .collect();
    let screaming = |name: String| {
        name.chars().enumerate().fold(String::new(), |words, (at, letter)| {
            let gap = if letter.is_uppercase() && at > 0 { "_" } else { "" };
            words + gap + &letter.to_uppercase().to_string()
        })
    };
    let ours = ErrorCode::ALL.iter().map(|code| (screaming(format!("{code:?}")), *code as i32));
    let ours: Vec<_> = std::iter::once(("OK".to_owned(), 0)).chain(ours).collect();
    assert_eq!(written, ours);
}
