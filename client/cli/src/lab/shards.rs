//! `--shard I/N` of the lab's long commands.

use std::path::Path;

use foretrace_lab::shards::{Digest, LONGEST, Shard, ShardFile};
use serde::Serialize;

use crate::failure::Failure;
use crate::output::{JsonArgs, say};

#[derive(Debug, clap::Args)]
pub(crate) struct ShardArgs {
    /// Compute only part I of N, some of the hands, for `foretrace lab merge`: no table and no pictures, all
    /// numbers go to --json FILE
    #[arg(long, value_name = "I/N", requires = "json")]
    pub(super) shard: Option<Shard>,
}

/// Of the file of this program, also where that was replaced since it was started.
fn own_file() -> Result<String, Failure> {
    Digest::of_file(Path::new("/proc/self/exe")).map_err(|error| {
        Failure::failed(format_args!("the file of this program cannot be read: {error}"), "")
    })
}

/// Writes what a shard found, and says how much of `what` it was.
pub(super) fn write<R: Serialize, P: Serialize>(
    json: &JsonArgs,
    command: &str,
    shard: Shard,
    run: R,
    part: P,
    [own, all]: [usize; 2],
) -> Result<(), Failure> {
    let file = ShardFile::new((crate::version::program(), own_file()?), command, shard, run, part);
    json.write_dense(&file, LONGEST)?;
    say!(
        "shard {} of {}: {own} of {all} sequences; with all of them: foretrace lab merge FILES",
        shard.index,
        shard.count
    );
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_part_that_no_merge_would_read_is_not_written() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("part.json");
        let json = JsonArgs { json: Some(file.clone()) };
        let run = |most| json.write_dense(&["12345"; 5], most);
        // 41 bytes, and the end of the line.
        let said = run(41).unwrap_err().to_string();
        assert!(said.contains("41 bytes") && said.contains("more shards"), "{said}");
        assert!(!file.exists());
        run(42).unwrap();
        assert_eq!(std::fs::read(&file).unwrap().len(), 42);
    }
}
