//! `foretrace bench`: what the parts of a tick cost on this machine, the exact path beside Clarabel, or this
//! program beside another.

use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

use foretrace_bench::BenchPart;
use foretrace_bench::against::{AgainstPlan, compare};
use foretrace_config::Config;

use crate::failure::Failure;
use crate::output::{JsonArgs, note, say, say_lines, write_file};
use crate::play::source::PathArgs;
use crate::run_folder::new_run_folder;
use crate::settings::{SettingsArgs, judged};
use crate::values::number;

/// Time the parts of a tick on this machine, the exact path beside Clarabel, or this program beside another
///
/// Runs a loop on handwriting (the settings' horizon, DyBM at trust 1), then times every problem that
/// occurred in it with each backend in turn: planning without and with 3 to 8 active limits, one step of
/// inverse kinematics, one roll-out of the predictor, and the whole step from pen samples to a legal command.
/// Only release builds give meaningful figures.
#[derive(Debug, clap::Args)]
#[command(after_help = "Example, with the program as it was before a change:\n  \
    foretrace bench --against ~/before/foretrace --rounds 20")]
pub(crate) struct BenchArgs {
    /// Instances per row
    #[arg(long, value_name = "N", default_value_t = 2000, value_parser = clap::value_parser!(u32)
        .range(50..=1_000_000))]
    samples: u32,

    /// Handwriting to follow: UNIPEN file, data-set folder, CSV, or glyphs:TEXT
    #[arg(long, value_name = "SOURCE", default_value = "glyphs:Kx4 Rg8 Sy2 mB5")]
    pen: String,

    /// Only these parts, comma-separated: plan, ik, predict, step, step-by-predictor, lag, evidence,
    /// predictors
    #[arg(long, value_name = "PARTS", value_delimiter = ',')]
    part: Vec<BenchPart>,

    /// Compare with this other foretrace: both in turn, every part and round in fresh processes, who begins
    /// alternating; prints the median of the rounds' own ratios, other over this, with the 95 % interval that
    /// the ranks of these ratios give (sign test), from 6 rounds on
    #[arg(long, value_name = "BINARY")]
    against: Option<PathBuf>,

    /// Rounds of a comparison
    #[arg(long, value_name = "N", default_value_t = 10, requires = "against", value_parser =
        clap::value_parser!(u32).range(2..=1000))]
    rounds: u32,

    /// How long one process of a comparison may take [s]
    #[arg(long, value_name = "S", default_value_t = 600.0, requires = "against", value_parser = patience)]
    cell_limit: f64,

    /// Folder for what every process of a comparison printed, and for comparison.json; it must be new or
    /// empty [default: a new one in foretrace-bench/]
    #[arg(long, value_name = "DIR", requires = "against")]
    out: Option<PathBuf>,

    #[command(flatten)]
    settings: SettingsArgs,

    #[command(flatten)]
    json: JsonArgs,
}

fn patience(text: &str) -> Result<f64, String> {
    number(0.1..=86_400.0, "a number of seconds from 0.1 to 86400")(text)
}

pub(crate) fn run(args: &BenchArgs) -> Result<(), Failure> {
    for part in BenchPart::ALL {
        if args.part.iter().filter(|named| **named == part).count() > 1 {
            let what = format_args!("part {} is named twice (--part)", part.name());
            return Err(Failure::usage(what, "name each part once"));
        }
    }
    args.json.claim()?;
    if cfg!(debug_assertions) {
        note!(
            "foretrace: built for a quick start; for numbers that mean something: `cargo run --release -p foretrace \
             --bin foretrace -- bench`, or the installed program"
        );
    }
    crate::interrupt::ends_at_once()?;
    let config = configured(&args.settings)?;
    if let Some(other) = &args.against {
        return against(args, other);
    }
    let path = PathArgs::default().load(std::slice::from_ref(&args.pen), config.settings())?.path;
    let report = foretrace_bench::measure(&config, &path, args.samples, parts(args))?;
    for line in report.lines() {
        say!("{line}");
    }
    args.json.write(&report)
}

/// Those asked for; without any, all.
fn parts(args: &BenchArgs) -> &[BenchPart] {
    if args.part.is_empty() { &BenchPart::ALL } else { &args.part }
}

/// This program and `other` in turn.
fn against(args: &BenchArgs, other: &Path) -> Result<(), Failure> {
    let this = std::env::current_exe().map_err(|error| {
        Failure::failed(format_args!("the path of this program cannot be found: {error}"), "")
    })?;
    let folder = match &args.out {
        Some(folder) => empty(folder)?,
        None => new_run_folder(Path::new("foretrace-bench"), "against", SystemTime::now())?,
    };
    let options = options(args);
    let plan = AgainstPlan {
        programs: [&this, other],
        options: &options,
        parts: parts(args),
        rounds: args.rounds,
        patience: Duration::from_secs_f64(args.cell_limit),
        folder: &folder,
    };
    let compared = compare(&plan, |round| note!("bench: round {round} of {}", args.rounds));
    let comparison = compared.inspect_err(|_| {
        // Kept where a process printed something whole; a folder with nothing in it goes again.
        let _ = std::fs::remove_dir(&folder);
    })?;
    say_lines(comparison.lines());
    let file = folder.join("comparison.json");
    let text = serde_json::to_string_pretty(&comparison).map_err(|error| {
        Failure::failed(format_args!("the comparison cannot be written as JSON: {error}"), "")
    })?;
    write_file(&file, &(text + "\n"), "--out")?;
    say!("\ncells    {}", folder.display());
    args.json.write(&comparison)
}

/// `folder`, made where it is not there; cells of an earlier comparison would be mistaken for this one's.
fn empty(folder: &Path) -> Result<PathBuf, Failure> {
    let refused = |why: &dyn std::fmt::Display| {
        let what = format!("cells cannot be kept in {}: {why}", folder.display());
        Failure::bad_input(what, "give a new or empty folder (--out DIR)")
    };
    std::fs::create_dir_all(folder).map_err(|error| refused(&error))?;
    let mut files = std::fs::read_dir(folder).map_err(|error| refused(&error))?;
    match files.next() {
        None => Ok(folder.to_owned()),
        Some(_) => Err(refused(&"it has files")),
    }
}

/// The words of this command line that both programs get.
fn options(args: &BenchArgs) -> Vec<String> {
    let mut words =
        vec!["--samples".to_owned(), args.samples.to_string(), "--pen".to_owned(), args.pen.clone()];
    let mut add = |option: &str, value: &OsStr| {
        words.extend([option.to_owned(), value.to_string_lossy().into_owned()]);
    };
    let settings = &args.settings;
    match &settings.config {
        Some(file) => add("--config", file.as_os_str()),
        None => add("--preset", settings.preset.as_ref()),
    }
    settings.set.iter().for_each(|pair| add("--set", pair.as_ref()));
    words
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
