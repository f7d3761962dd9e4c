//! What this program is.

use std::sync::LazyLock;

/// Its version, and its commit where `FORETRACE_COMMIT` was set for the compiler: `0.1.0 (1a2b3c4)`.
pub(crate) fn program() -> &'static str {
    static PROGRAM: LazyLock<String> = LazyLock::new(|| told(option_env!("FORETRACE_COMMIT")));
    &PROGRAM
}

/// The version, and the layout of the messages of shared memory: programs of another layout are refused.
pub(crate) fn line() -> &'static str {
    static LINE: LazyLock<String> =
        LazyLock::new(|| format!("{}, messages {:016x}", program(), foretrace_shm::C_LAYOUT_HASH));
    &LINE
}

fn told(commit: Option<&str>) -> String {
    let version = env!("CARGO_PKG_VERSION");
    match commit.map(str::trim).filter(|commit| !commit.is_empty()) {
        Some(commit) => format!("{version} ({commit})"),
        None => version.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::told;

    #[test]
    fn the_commit_is_told_where_the_build_knows_it() {
        let version = env!("CARGO_PKG_VERSION");
        assert_eq!((told(None), told(Some(" "))), (version.to_owned(), version.to_owned()));
        assert_eq!(told(Some("1a2b3c4")), format!("{version} (1a2b3c4)"));
    }
}
