//! The commands of the lab on the pages of results run, cut short, on sets that the built-in writer wrote:
//! all but `fetch`, which is about published files, and without models of other programs.

use foretrace_tests::{World, told};

use crate::PROGRAM;
use crate::snippets::blocks_of;

/// Sets that the pages name, and what stands for any other.
const SETS: [&str; 6] =
    ["unipen-tos", "unipen-ced", "pendigits-orig", "character-trajectories", "my-tablet", "SET"];

/// The lines of `foretrace lab` on the pages of results, in words.
fn commands() -> Vec<Vec<String>> {
    let pages =
        blocks_of("sh").into_iter().filter(|(path, _)| path.to_string_lossy().contains("docs/results/"));
    let mut found = Vec::new();
    for (_, block) in pages {
        for line in block.replace("\\\n", " ").lines() {
            let line = line.split(" #").next().unwrap_or_default();
            let words = shell_words(line);
            let downloads = words.iter().any(|word| word == "fetch");
            if words.starts_with(&["foretrace".to_owned(), "lab".to_owned()]) && !downloads {
                found.push(words[1..].to_vec());
            }
        }
    }
    found
}

/// Words of a line, in which single quotes hold spaces.
fn shell_words(line: &str) -> Vec<String> {
    let (mut words, mut quoted) = (Vec::new(), false);
    let mut word = String::new();
    for c in line.chars().chain([' ']) {
        match c {
            '\'' => quoted = !quoted,
            c if c.is_whitespace() && !quoted => {
                if !word.is_empty() {
                    words.push(std::mem::take(&mut word));
                }
            }
            c => word.push(c),
        }
    }
    words
}

/// Models without those of other programs, which need numpy and weights.
fn built_in(models: &str) -> String {
    models.split(',').filter(|model| !model.starts_with("external:")).collect::<Vec<_>>().join(",")
}

/// The same with placeholders filled in, and with as little work as each command allows.
fn small(mut words: Vec<String>) -> Vec<String> {
    let limits: &[(&str, &str)] = match words[1].as_str() {
        "closed-loop" => &[("--limit", "1")],
        "generate" => &[("--writers", "2"), ("--text", "Ka")],
        "inputs" => &[("--epochs", "1")],
        "law" => &[("--hands", "1"), ("--limit", "1"), ("--numbers", "onset_first")],
        "pictures" => &[("--only", "fig3-unipen-ced.svg,leadtime.svg"), ("--out", ".")],
        _ => &[],
    };
    for (option, value) in limits {
        match words.iter().position(|word| word == option) {
            Some(at) => words[at + 1] = (*value).to_owned(),
            None => words.extend([(*option).to_owned(), (*value).to_owned()]),
        }
    }
    let filled = |word: String| match word.as_str() {
        "DIR" => ".".to_owned(),
        "FILE" => "result.json".to_owned(),
        models if models.contains("external:") => built_in(models),
        _ => word,
    };
    words.into_iter().map(filled).collect()
}

#[test]
fn every_command_of_the_lab_on_the_pages_of_results_runs_on_generated_sets() {
    let world = World::new(PROGRAM);
    for (seed, set) in SETS.iter().enumerate() {
        let seed = (10 * seed + 1).to_string();
        let words = ["lab", "generate", set, "--writers", "2", "--text", "Ka", "--seed", &seed];
        let out = world.run_plain(&words);
        assert!(out.status.success(), "{}", told(&out));
    }
    let commands = commands();
    assert!(commands.len() >= 25, "only {} commands were found", commands.len());
    for words in commands {
        let words = small(words);
        let words: Vec<&str> = words.iter().map(String::as_str).collect();
        let out = world.run_plain(&words);
        assert!(out.status.success() && !out.stdout.is_empty(), "{}: {}", words.join(" "), told(&out));
    }
}
