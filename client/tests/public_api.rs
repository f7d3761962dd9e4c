//! The public interface in docs/extend/public-api/: it is the code's, and none of its types is a dead end.

use std::collections::BTreeSet;
use std::path::Path;
use std::process::Command;

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap()
}

/// The segments of every path in `line` that begins with `krate`.
fn paths<'a>(line: &'a str, krate: &'a str) -> impl Iterator<Item = Vec<&'a str>> {
    let words = line.split(|c: char| !(c.is_alphanumeric() || c == '_' || c == ':'));
    words.map(|path| path.split("::").collect::<Vec<_>>()).filter(move |path| path[0] == krate)
}

/// Needs cargo-public-api; building its input takes minutes, so where it is not asked for it is left out.
#[test]
fn a_change_of_the_public_interface_is_shown() {
    if std::env::var_os("FORETRACE_PUBLIC_API").is_none_or(|value| value != "1") {
        eprintln!("skipped: FORETRACE_PUBLIC_API=1 compares the public interface with the one in the tree");
        return;
    }
    let shown = Command::new(root().join(".ci/public-api")).output().unwrap();
    let text = String::from_utf8_lossy(&shown.stdout);
    if text.starts_with("skipped: ") {
        eprintln!("{text}");
    }
    assert!(shown.status.success(), "{text}{}", String::from_utf8_lossy(&shown.stderr));
}

#[test]
fn every_type_that_a_public_signature_names_can_be_named_by_its_user() {
    let Ok(text) = std::fs::read_to_string(root().join("docs/extend/public-api/client.txt")) else {
        eprintln!("skipped: .ci/public-api --write has not made docs/extend/public-api/client.txt yet");
        return;
    };
    let (exports, signatures): (Vec<_>, Vec<_>) = text.lines().partition(|line| line.starts_with("pub use "));
    let last = |path: Vec<&str>| path.last().map(ToString::to_string);
    let exported: BTreeSet<_> =
        exports.iter().flat_map(|line| paths(line, "foretrace_client")).filter_map(last).collect();
    let named: BTreeSet<_> =
        signatures.iter().flat_map(|line| paths(line, "foretrace_shm")).filter_map(last).collect();
    assert!(named.len() > 10 && exported.len() > 50, "{named:?} {exported:?}");
    let dead_ends: Vec<_> = named.difference(&exported).collect();
    assert!(dead_ends.is_empty(), "{dead_ends:?}");
}
