//! Checks that the program accepts every command line in the documents.
//!
//! Lines of shell blocks must parse as they stand. Mentions in the text may leave out what is required
//! (`foretrace request`), but not name commands or options that do not exist. Placeholders in capitals are
//! filled in.

use std::path::Path;

use clap::Parser;
use clap::error::ErrorKind;

use crate::CommandLine;

/// A line, where it stands, and whether it is to be run as it is.
struct DocumentedLine {
    position: String,
    words: Vec<String>,
    whole: bool,
}

/// Every page of the documents, with its path below the repository.
pub(crate) fn documents() -> Vec<(String, String)> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let (mut found, mut folders) = (Vec::new(), vec!["docs".to_owned(), "config/models".to_owned()]);
    let pages_of =
        |folder: &str| std::fs::read_dir(root.join(folder)).unwrap().map(|entry| entry.unwrap().path());
    let mut add = |folder: &str, path: &Path| {
        let name = format!("{folder}/{}", path.file_name().unwrap().to_string_lossy());
        if path.extension().is_some_and(|ending| ending == "md") {
            found.push((name, std::fs::read_to_string(path).unwrap()));
        }
    };
    pages_of("").for_each(|path| add(".", &path));
    while let Some(folder) = folders.pop() {
        for path in pages_of(&folder) {
            if path.is_dir() {
                folders.push(format!("{folder}/{}", path.file_name().unwrap().to_string_lossy()));
            } else {
                add(&folder, &path);
            }
        }
    }
    found
}

/// The words of a line as a shell splits it: quotes make one word; a comment, pipe or redirection ends it.
fn words(line: &str) -> Vec<String> {
    let (mut words, mut word, mut quote) = (Vec::new(), String::new(), None);
    for character in line.chars() {
        match (quote, character) {
            (Some(end), _) if character == end => quote = None,
            (Some(_), _) => word.push(character),
            (None, '\'' | '"') => quote = Some(character),
            (None, '|' | '>' | ';' | '&') => break,
            (None, '#') if word.is_empty() => break,
            (None, _) if character.is_whitespace() => words.push(std::mem::take(&mut word)),
            (None, _) => word.push(character),
        }
    }
    words.push(word);
    words.retain(|word| !word.is_empty());
    words
}

/// The part of a line that this program takes, `foretrace` first; comments and what the shell does are left
/// out.
fn of_this_program(line: &str) -> Option<Vec<String>> {
    let words = words(line.trim().trim_start_matches("sudo "));
    let parts: Vec<&str> = words.iter().map(String::as_str).collect();
    let (first, rest): (&[&str], _) = match parts.as_slice() {
        ["cargo", "demo", rest @ ..] => (&["foretrace", "demo"], rest),
        ["cargo", "console", rest @ ..] => (&["foretrace", "console", "--sim"], rest),
        ["cargo", "foretrace", rest @ ..] => (&["foretrace"], rest),
        ["foretrace", rest @ ..] if !rest.is_empty() => (&["foretrace"], rest),
        _ => return None,
    };
    Some(first.iter().chain(rest).map(|&word| word.to_owned()).collect())
}

fn lines(position: &str, text: &str) -> Vec<DocumentedLine> {
    let mut found = Vec::new();
    let (mut block, mut carried): (Option<&str>, String) = (None, String::new());
    for (number, line) in text.lines().enumerate() {
        let position = format!("{position}:{}", number + 1);
        if let Some(kind) = line.trim().strip_prefix("```") {
            block = if block.is_some() { None } else { Some(kind) };
        } else if block == Some("sh") {
            carried.push_str(line.trim_end_matches('\\'));
            if !line.ends_with('\\')
                && let Some(words) = of_this_program(&std::mem::take(&mut carried))
            {
                found.push(DocumentedLine { position, words, whole: true });
            }
        } else if block.is_none() {
            let mentions = line.split('`').skip(1).step_by(2).filter_map(of_this_program);
            found.extend(mentions.map(|words| DocumentedLine {
                position: position.clone(),
                words,
                whole: false,
            }));
        }
    }
    found
}

/// An example value for a placeholder in capitals.
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
            let words = line.words.iter().map(|word| filled(word));
            let Err(error) = CommandLine::try_parse_from(words) else { continue };
            let answered = matches!(error.kind(), ErrorKind::DisplayHelp | ErrorKind::DisplayVersion);
            let short = matches!(
                error.kind(),
                ErrorKind::MissingRequiredArgument
                    | ErrorKind::MissingSubcommand
                    | ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand
                    | ErrorKind::InvalidValue
            ) && !line.whole;
            if !answered && !short {
                wrong.push(format!(
                    "{}: {}\n  {}",
                    line.position,
                    line.words.join(" "),
                    error.to_string().trim()
                ));
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    assert!(whole >= 70 && mentioned >= 50, "found {whole} lines and {mentioned} mentions");
}
