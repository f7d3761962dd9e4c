//! `foretrace lab generate`: a small set in the hands of the built-in writer.

use std::path::PathBuf;

use foretrace_lab::sets::GeneratedSet;

use crate::failure::Failure;
use crate::output::say;

#[derive(Debug, clap::Args)]
#[command(after_help = "Example:\n  foretrace lab generate writers\n  foretrace lab leadtime --data writers")]
pub(crate) struct GenerateArgs {
    /// Folder for the set; it must be new or empty
    #[arg(value_name = "DIR")]
    folder: PathBuf,

    /// Writers, half of them for each part
    #[arg(long, value_name = "N", default_value_t = 6, value_parser = clap::value_parser!(u32).range(2..=99))]
    writers: u32,

    /// What each of them writes, one character after the other
    #[arg(long, value_name = "TEXT", default_value = "KaegosR28K")]
    text: String,

    /// Seed of the first writer's hand; the others count on
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
}

pub(super) fn run(args: &GenerateArgs) -> Result<(), Failure> {
    let set = GeneratedSet { writers: args.writers, text: args.text.clone(), seed: args.seed };
    let files = set.write(&args.folder)?;
    say!("set      {}: {} files, parts train and test", args.folder.display(), files.len());
    say!("         written by the built-in writer: what predictors score on it says nothing about people");
    Ok(())
}
