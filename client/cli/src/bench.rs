//! `foretrace bench`: what the parts of a tick cost on this machine, the exact path beside Clarabel.

use foretrace_config::Config;

use crate::failure::Failure;
use crate::output::{JsonArgs, note, say};
use crate::play::source::PathArgs;
use crate::settings::{SettingsArgs, judged};

/// Time the parts of a tick on this machine, the exact path beside Clarabel
///
/// Runs a loop on handwriting (the settings' horizon, DyBM at trust 1), then times every problem that
/// occurred in it with each backend in turn: planning without and with 3 to 8 active limits, one step of
/// inverse kinematics, one roll-out of the predictor, and the whole step from pen samples to a legal command.
/// Only release builds give meaningful figures.
#[derive(Debug, clap::Args)]
pub(crate) struct BenchArgs {
    /// Instances per row
    #[arg(long, value_name = "N", default_value_t = 2000, value_parser = clap::value_parser!(u32)
        .range(50..=1_000_000))]
    samples: u32,

    /// Handwriting to follow: UNIPEN file, data-set folder, CSV, or glyphs:TEXT
    #[arg(long, value_name = "SOURCE", default_value = "glyphs:Kx4 Rg8 Sy2 mB5")]
    pen: String,

    #[command(flatten)]
    settings: SettingsArgs,

    #[command(flatten)]
    json: JsonArgs,
}

pub(crate) fn run(args: &BenchArgs) -> Result<(), Failure> {
    args.json.claim()?;
    if cfg!(debug_assertions) {
        note!(
            "foretrace: built for a quick start; for numbers that mean something: `cargo run --release -p foretrace \
             --bin foretrace -- bench`, or the installed program"
        );
    }
    let config = configured(&args.settings)?;
    let path = PathArgs::default().load(std::slice::from_ref(&args.pen), config.settings())?.path;
    let report = foretrace_bench::measure(&config, &path, args.samples)?;
    for line in report.lines() {
        say!("{line}");
    }
    args.json.write(&report)
}

/// The settings, but for what the bench fixes; a setting that differs is reported.
fn configured(args: &SettingsArgs) -> Result<Config, Failure> {
    for (key, value) in foretrace_bench::FIXED {
        if args.set.iter().any(|pair| pair.split_once('=').is_some_and(|(asked, _)| asked.trim() == key)) {
            note!("bench: --set {key} changes nothing here: the loop that is timed has {key} = {value}");
        }
    }
    let fixed = foretrace_bench::FIXED.iter();
    judged(&fixed.fold(args.source()?, |source, (key, value)| source.with(key, value)))
}
