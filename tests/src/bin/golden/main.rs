//! Regression check for changes that must not alter behaviour: the law's decisions over a fixed corpus, bit
//! for bit.
//!
//! `golden record OUT [--shared DIR]` writes every field of [`fields::NAMES`] of every tick of every scene
//! ([`scenes`]), and the figures of the lab's experiments where the shared data are. `golden compare A B`
//! names the first difference with both values. Recordings are compared on the machine that made them: other
//! processors and libraries round differently.

mod fields;
mod figures;
mod file;
mod scenes;

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use file::Golden;

const USAGE: &str = "usage: golden record OUT [--shared DIR]\n       golden compare A B";

fn main() -> ExitCode {
    // The lab's figures come from the program `foretrace`, which is this one.
    if std::env::args().nth(1).as_deref() == Some("lab") {
        return foretrace::main();
    }
    let words: Vec<String> = std::env::args().skip(1).collect();
    let words: Vec<&str> = words.iter().map(String::as_str).collect();
    let done = match *words {
        ["record", out] => record(Path::new(out), &default_shared()),
        ["record", out, "--shared", shared] => record(Path::new(out), Path::new(shared)),
        ["compare", a, b] => compare(Path::new(a), Path::new(b)),
        _ => Err(USAGE.to_owned()),
    };
    match done {
        Ok(equal) => ExitCode::from(u8::from(!equal)),
        Err(error) => {
            eprintln!("golden: {error}");
            ExitCode::from(2)
        }
    }
}

fn default_shared() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../shared")
}

fn record(out: &Path, shared: &Path) -> Result<bool, String> {
    let mut golden = Golden { scenes: scenes::all()?, figures: Vec::new() };
    for scene in &golden.scenes {
        println!("{:016x} {} ({} ticks)", scene.digest(), scene.name, scene.ticks());
    }
    let sets = figures::sets(shared);
    if sets.is_empty() {
        println!("skipped: the lab's figures, {} has no data sets", shared.display());
    }
    for set in sets {
        golden.figures.extend(figures::of(&set)?);
    }
    println!("{:016x} {} figures of the lab", golden.figures_digest(), golden.figures.len());
    golden.write(out)?;
    Ok(true)
}

fn compare(a: &Path, b: &Path) -> Result<bool, String> {
    let differences = Golden::read(a)?.differences(&Golden::read(b)?);
    for difference in differences.iter().take(20) {
        println!("{difference}");
    }
    println!("{} of the parts differ", differences.len());
    Ok(differences.is_empty())
}
