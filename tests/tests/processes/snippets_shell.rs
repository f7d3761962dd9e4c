//! Checks every shell line of the documents: syntax, and known programs only.
//!
//! Blocks go through `bash -n`. Lines of cargo, in blocks and in the text, name packages, tests, examples and
//! programs of this workspace, and filters that its sources have; scripts exist. Lines of foretrace go
//! through its own parser (`client/cli/src/documented_tests.rs`); nothing is run.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::snippets::{blocks_of, documents};

/// What a line may begin with besides cargo, python3 and scripts of the repository.
const PROGRAMS: [&str; 11] =
    ["foretrace", "sudo", "mkdir", "cyclictest", "xacro", "mdbook", "docker", "nice", "ssh", "adb", "pip"];

/// The crates of the workspace: their folder, and their targets by kind.
fn packages() -> BTreeMap<String, (PathBuf, BTreeSet<(String, String)>)> {
    let out = Command::new(env!("CARGO"))
        .args(["metadata", "--no-deps", "--offline", "--format-version", "1"])
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .output()
        .unwrap();
    let metadata: serde_json::Value = serde_json::from_slice(&out.stdout).unwrap();
    let text = |value: &serde_json::Value| value.as_str().unwrap().to_owned();
    let of = |package: &serde_json::Value| {
        let targets = package["targets"].as_array().unwrap().iter();
        let targets = targets.map(|target| (text(&target["kind"][0]), text(&target["name"]))).collect();
        let folder = Path::new(package["manifest_path"].as_str().unwrap()).parent().unwrap().to_owned();
        (text(&package["name"]), (folder, targets))
    };
    metadata["packages"].as_array().unwrap().iter().map(of).collect()
}

/// All Rust text and file names below a folder.
fn sources(folder: &Path) -> String {
    let mut all = String::new();
    for path in std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()) {
        if path.is_dir() && !path.ends_with("target") {
            all.push_str(&sources(&path));
        } else if path.extension().is_some_and(|ending| ending == "rs") {
            all.push_str(&path.file_stem().unwrap().to_string_lossy());
            all.push_str(&std::fs::read_to_string(&path).unwrap());
        }
    }
    all
}

/// What is wrong with a line of cargo: names that the workspace does not have, filters that match nothing.
fn wrong_with_cargo(words: &[&str]) -> Option<String> {
    let packages = packages();
    let verbs = [
        "test",
        "run",
        "check",
        "build",
        "install",
        "clippy",
        "doc",
        "fmt",
        "demo",
        "console",
        "foretrace",
        "deny",
        "metadata",
        "tree",
    ];
    let [verb, rest @ ..] = words else { return Some("no subcommand".to_owned()) };
    if !verbs.contains(verb) {
        return Some(format!("there is no cargo {verb}"));
    }
    let all: BTreeSet<&(String, String)> = packages.values().flat_map(|(_, targets)| targets).collect();
    let has = |kind: &str, name: &str| all.contains(&(kind.to_owned(), name.to_owned()));
    let (mut chosen, mut filters): (Vec<&Path>, Vec<&str>) = (Vec::new(), Vec::new());
    let mut words = rest.iter().copied();
    let mut ours = true;
    while let Some(word) = words.next() {
        let known = match word {
            "--" => {
                ours = false;
                true
            }
            _ if !ours && *verb != "test" => return None,
            "-p" | "--package" => {
                let package = packages.get(words.next()?);
                chosen.extend(package.map(|(folder, _)| folder.as_path()));
                package.is_some()
            }
            "--test" | "--example" | "--bin" => has(word.trim_start_matches('-'), words.next()?),
            "--path" => Path::new(env!("CARGO_MANIFEST_DIR"))
                .join("..")
                .join(words.next()?)
                .join("Cargo.toml")
                .is_file(),
            "--target-dir" => words.next().is_some(),
            _ if word.starts_with('-') => true,
            filter if *verb == "test" => {
                filters.push(filter);
                true
            }
            _ => true,
        };
        if !known {
            return Some(format!("{word} names something that the workspace does not have"));
        }
    }
    if chosen.is_empty() {
        chosen.extend(packages.values().map(|(folder, _)| folder.as_path()));
    }
    let sources: String = chosen.into_iter().map(sources).collect();
    let missing = filters.iter().flat_map(|filter| filter.split("::")).find(|part| !sources.contains(part));
    missing.map(|part| format!("no test is called {part}"))
}

/// The line with what stands in quotes as one word, whatever is in it.
fn unquoted(line: &str) -> String {
    let mut quote = None;
    let mut closed = |character: char| match quote {
        Some(end) if character == end => {
            quote = None;
            '_'
        }
        Some(_) => '_',
        None if matches!(character, '\'' | '"') => {
            quote = Some(character);
            '_'
        }
        None => character,
    };
    line.chars().map(&mut closed).collect()
}

/// What is wrong with one command, without the variables before it and what the shell does around it.
fn wrong_with(command: &str) -> Option<String> {
    let command = unquoted(command);
    let command = command.split(" #").next()?.split([';', '|', '>', '&']).next()?;
    let mut words: Vec<&str> = command.split_whitespace().collect();
    let variables =
        words.iter().take_while(|word| word.split_once('=').is_some_and(|(name, _)| name.len() > 2)).count();
    words.drain(..variables);
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    match words.as_slice() {
        [] => None,
        ["cargo", rest @ ..] => wrong_with_cargo(rest),
        ["python3", "-m", module, ..] => {
            let path = format!("client/python/python/{}.py", module.replace('.', "/"));
            (!root.join(&path).is_file()).then(|| format!("there is no {path}"))
        }
        ["python3", script, ..] => (!root.join(script).is_file()).then(|| format!("there is no {script}")),
        [script, ..] if [".ci/", "tests/", "client/"].iter().any(|folder| script.starts_with(folder)) => {
            (!root.join(script).is_file()).then(|| format!("there is no {script}"))
        }
        [program, ..] => {
            (!PROGRAMS.contains(program)).then(|| format!("{program} is not known here; see PROGRAMS"))
        }
    }
}

#[test]
fn every_shell_block_of_the_documents_is_taken_by_a_shell_and_names_what_there_is() {
    let (mut lines, mut wrong) = (0, Vec::new());
    for (path, block) in blocks_of("sh") {
        let judged = Command::new("bash").args(["-n", "-c", &block]).output().unwrap();
        if !judged.status.success() {
            wrong.push(format!("{}: {}\n{block}", path.display(), String::from_utf8_lossy(&judged.stderr)));
        }
        for line in block.replace("\\\n", " ").lines().filter(|line| !line.trim_start().starts_with('#')) {
            lines += 1;
            wrong.extend(wrong_with(line).map(|why| format!("{}: {line}\n  {why}", path.display())));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    assert!(lines >= 100, "only {lines} lines were found");
}

#[test]
fn every_cargo_line_in_the_text_of_the_documents_names_what_there_is() {
    let (mut count, mut wrong) = (0, Vec::new());
    for (path, text) in documents() {
        let mut fenced = false;
        for line in text.lines() {
            fenced ^= line.trim_start().starts_with("```");
            let spans = line.split('`').skip(1).step_by(2).filter(|_| !fenced);
            for span in spans.filter(|span| span.contains("cargo ") && !span.ends_with("cargo ")) {
                count += 1;
                wrong.extend(wrong_with(span).map(|why| format!("{}: {span}\n  {why}", path.display())));
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    assert!(count >= 20, "only {count} lines were found");
}

#[test]
fn wrong_lines_are_found() {
    for line in [
        "cargo test -p foretrace-nobody",
        "cargo test -p foretrace-tests --test nobody",
        "cargo test -p foretrace-shm --test wire nobody_is_called_this",
        "cargo run -p foretrace-client --example nobody",
        "cargo tset",
        "python3 .ci/nobody.py",
        "python3 -m foretrace.nobody",
        "FORETRACE_X=1 nobody",
    ] {
        assert!(wrong_with(line).is_some(), "{line}");
    }
    for line in [
        "FORETRACE_X=1 cargo test -p foretrace-tests --test processes snippets",
        "sudo install a b",
        ".ci/long",
    ] {
        assert_eq!(wrong_with(line), None, "{line}");
    }
}
