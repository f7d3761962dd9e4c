//! Every command line of the documents is one that the program takes.
//!
//! Lines of shell blocks must parse as they stand. Mentions in the text may leave out what is required (`foretrace request`), but
//! not name commands or options that do not exist. Placeholders in capitals are filled in.

use std::path::Path;

use clap::Parser;
use clap::error::ErrorKind;

use crate::Arguments;

/// A line, where it stands, and whether it is to be run as it is.
struct Line {
    place: String,
    words: String,
    whole: bool,
}

fn documents() -> Vec<(String, String)> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let mut found = Vec::new();
    for folder in ["", "docs", "docs/connect", "config", "config/models"] {
        for entry in std::fs::read_dir(root.join(folder)).unwrap() {
            let path = entry.unwrap().path();
            if path.extension().is_some_and(|ending| ending == "md") {
                let name = path.file_name().unwrap().to_string_lossy().into_owned();
                found.push((format!("{folder}/{name}"), std::fs::read_to_string(&path).unwrap()));
            }
        }
    }
    found
}

/// The part of a line that this program takes, `foretrace` first; comments and what the shell does are left out.
fn of_this_program(line: &str) -> Option<String> {
    let line = line.trim().trim_start_matches("sudo ").split(" #").next()?.trim();
    let line = line.split(['|', '>', ';']).next()?.trim_end_matches('&').trim();
    let at_our_aliases = line.strip_prefix("cargo foretrace ").or_else(|| line.strip_prefix("foretrace "));
    let demo = || (line == "cargo demo").then_some("").or_else(|| line.strip_prefix("cargo demo "));
    at_our_aliases
        .map(|rest| format!("foretrace {rest}"))
        .or_else(|| demo().map(|rest| format!("foretrace demo {rest}")))
}

fn lines(place: &str, text: &str) -> Vec<Line> {
    let mut found = Vec::new();
    let (mut block, mut carried): (Option<&str>, String) = (None, String::new());
    for (number, line) in text.lines().enumerate() {
        let place = format!("{place}:{}", number + 1);
        if let Some(kind) = line.trim().strip_prefix("```") {
            block = if block.is_some() { None } else { Some(kind) };
        } else if block == Some("sh") {
            carried.push_str(line.trim_end_matches('\\'));
            if !line.ends_with('\\')
                && let Some(words) = of_this_program(&std::mem::take(&mut carried))
            {
                found.push(Line { place, words, whole: true });
            }
        } else if block.is_none() {
            let mentions = line.split('`').skip(1).step_by(2).filter_map(of_this_program);
            found.extend(mentions.map(|words| Line { place: place.clone(), words, whole: false }));
        }
    }
    found
}

/// What a reader would put in the place of a word in capitals.
fn filled(word: &str) -> &str {
    match word {
        "NAME" => "mixture",
        "WORD" => "test",
        "N" | "S" | "MS" => "1",
        "N,M" => "1,2",
        "..." | "ARGUMENTS" => "--help",
        other => other,
    }
}

#[test]
fn every_documented_command_line_is_one_that_the_program_takes() {
    let (mut whole, mut mentioned, mut wrong) = (0, 0, Vec::new());
    for (name, text) in documents() {
        for line in lines(&name, &text) {
            *if line.whole { &mut whole } else { &mut mentioned } += 1;
            let words = line.words.split_whitespace().map(filled);
            let Err(error) = Arguments::try_parse_from(words) else { continue };
            let told = matches!(error.kind(), ErrorKind::DisplayHelp | ErrorKind::DisplayVersion);
            let short = matches!(
                error.kind(),
                ErrorKind::MissingRequiredArgument
                    | ErrorKind::MissingSubcommand
                    | ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand
                    | ErrorKind::InvalidValue
            ) && !line.whole;
            if !told && !short {
                wrong.push(format!("{}: {}\n  {}", line.place, line.words, error.to_string().trim()));
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    assert!(whole >= 20 && mentioned >= 30, "found {whole} lines and {mentioned} mentions");
}
