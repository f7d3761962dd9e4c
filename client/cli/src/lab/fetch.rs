//! `foretrace lab fetch`: where the published sets are, and whether a folder has one as it was measured.

use std::path::PathBuf;

use foretrace_lab::sets::{CheckedSet, PublishedSet, SplitFound, check};
use serde_json::json;

use crate::failure::Failure;
use crate::output::{JsonArgs, say};

#[derive(Debug, clap::Args)]
#[command(
    after_help = "Example:\n  foretrace lab fetch unipen-tos\n  foretrace lab fetch unipen-tos --check \
                        unipen-tos"
)]
pub(crate) struct FetchArgs {
    /// Name of a published set [default: all, in short]
    #[arg(value_name = "SET", value_parser = published)]
    set: Option<&'static PublishedSet>,

    /// Check the files in FOLDER against their SHA-256, and write split.tsv there by the set's rule
    #[arg(long, value_name = "FOLDER", requires = "set")]
    check: Option<PathBuf>,

    #[command(flatten)]
    json: JsonArgs,
}

fn published(name: &str) -> Result<&'static PublishedSet, String> {
    PublishedSet::named(name).ok_or_else(|| {
        let known: Vec<&str> = PublishedSet::all().iter().map(|set| set.name).collect();
        format!("the sets are {}", known.join(", "))
    })
}

pub(super) fn run(args: &FetchArgs) -> Result<(), Failure> {
    args.json.claim()?;
    match (args.set, &args.check) {
        (Some(set), Some(folder)) => {
            let checked = check(set, folder)?;
            tell(set, &checked);
            args.json.write(&checked)
        }
        (Some(set), None) => {
            describe(set);
            args.json.write(&described(set))
        }
        (None, _) => {
            for set in PublishedSet::all() {
                say!("{:<24}{}\n{:<24}{}", set.name, set.what, "", set.source);
            }
            say!("\nforetrace lab fetch SET tells the rest; nothing is downloaded.");
            let sets: Vec<_> = PublishedSet::all().iter().map(described).collect();
            args.json.write(&json!({ "sets": sets }))
        }
    }
}

fn describe(set: &PublishedSet) {
    let PublishedSet { name, what, source, licence, .. } = set;
    say!("{name}: {what}\n");
    say!("where     {source}");
    say!("licence   {licence}");
    say!("download  by hand or with a program of yours, then, beside what was unpacked:");
    set.unpack.iter().for_each(|line| say!("          {line}"));
    say!("          foretrace lab fetch {name} --check {name}");
    say!("parts     {}", set.split_words);
    say!("sums      of {} files are known", set.sums().count());
    if let Some(unknown) = set.unknown {
        say!("          no sum is known of {unknown}");
    }
}

fn described(set: &PublishedSet) -> serde_json::Value {
    json!({
        "set": set.name,
        "what": set.what,
        "source": set.source,
        "licence": set.licence,
        "unpack": set.unpack,
        "parts": set.split_words,
        "writers": set.writers,
        "sha256": set.sums().collect::<std::collections::BTreeMap<_, _>>(),
        "unknown": set.unknown,
    })
}

fn tell(set: &PublishedSet, checked: &CheckedSet) {
    say!("files    {} are those that the results were measured with (SHA-256)", checked.same);
    if let Some(unknown) = checked.unknown {
        say!("         not checked, because no sum is known: {unknown}");
    }
    let split = match checked.split {
        SplitFound::Written => "split.tsv is written",
        SplitFound::Agrees => "split.tsv is there and agrees",
        SplitFound::NotNeeded => "no split.tsv is needed",
    };
    say!("parts    {split}: {}", set.split_words);
    say!("         --split takes {}", checked.parts.join(", "));
}
