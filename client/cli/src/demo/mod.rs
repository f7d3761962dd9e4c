//! `foretrace demo`: the whole loop on this machine, every part a process of its own.
//!
//! Contract: private instance and folder, so that nothing else is disturbed; all children are ended and
//! everything is cleaned up whatever happens. The numbers come from the processes' own records
//! (`foretrace_report::run`).

pub(crate) mod scratch;
mod children;
pub(crate) mod crew;
mod ur;

use std::path::PathBuf;

use foretrace_config::Config;
use foretrace_control::predict::PredictorKind;
use foretrace_report::run::{Gathered, RunReport, RunWatch, SettingFigures, folder};
use foretraced::Source;

use crate::arm::options::StartedArmArgs;
use crate::attach::{instance_of, unattached};
use crate::failure::Failure;
use crate::interrupt::Interrupt;
use crate::output::{JsonArgs, note, say};
use crate::play::source::PathArgs;
use crate::settings::{SettingsArgs, judged};
use crate::values;
use crew::{Crew, Followed, settings_arguments, words};
use scratch::{PrivateFiles, Scratch};

/// Run everything together: daemon, simulated arm and handwriting, then show how it went
///
/// Starts the daemon, a simulated UR5 and a pen player as separate processes on a private instance, arms the
/// loop, lets the arm follow the pen, and ends by itself. Prints a short table and writes a report: one HTML
/// file, and JSON.
#[derive(Debug, clap::Args)]
#[command(
    allow_negative_numbers = true,
    after_help = "Examples:\n  foretrace demo\n  foretrace demo --pen glyphs:Hello --seconds 10 --trust 1\n  \
                  foretrace demo --pen data/unipen-ced --label K --rate 1000 --json -"
)]
pub(crate) struct DemoArgs {
    /// How long the arm follows [s]
    #[arg(long, value_name = "S", default_value_t = 20.0, value_parser = values::number(1.0..=3600.0, "a number of seconds from 1 to 3600"))]
    seconds: f64,

    /// Handwriting to follow, over and over: recording, data-set folder, CSV, or glyphs:TEXT
    #[arg(long, value_name = "SOURCE", default_value = "glyphs:foretrace")]
    pen: String,

    #[arg(
        long,
        value_name = "NAME",
        help = format!("Predictor: {} [default: as in the settings]", values::predictors()),
        value_parser = values::predictor
    )]
    predictor: Option<PredictorKind>,

    /// Trust in the prediction: 0 (hold only) to 1 (prediction only), or auto [default: as in the settings]
    #[arg(long, value_name = "V|auto", value_parser = values::trust)]
    trust: Option<String>,

    /// Ticks per second: 125, 250, 500 or 1000 [default: as in the settings]
    #[arg(long, value_name = "HZ", value_parser = foretraced::options::rate)]
    rate: Option<u32>,

    /// The arm: "sim", the simulated one, or "ur", the bridge to a simulated Universal Robots controller
    #[arg(long = "arm", value_name = "KIND", default_value = "sim", value_parser = ["sim", "ur"])]
    kind: String,

    /// With --arm ur: CB3 (a UR5, 125 Hz) or e (a UR5e, 500 Hz) [default: as in the settings]
    #[arg(long, value_name = "SERIES", value_parser = ["cb3", "e"])]
    series: Option<String>,

    /// Cycles per second of the simulated arm's controller [default: as in the settings]
    #[arg(long, value_name = "HZ", value_parser = clap::value_parser!(u32).range(50..=2000))]
    arm_rate: Option<u32>,

    #[command(flatten)]
    arm: StartedArmArgs,

    /// Ask for no real-time rights
    #[arg(long)]
    no_rights: bool,

    /// Folder for the report
    #[arg(long, value_name = "DIR", default_value = "foretrace-report")]
    out: PathBuf,

    #[command(flatten)]
    path: PathArgs,

    #[command(flatten)]
    settings: SettingsArgs,

    #[command(flatten)]
    json: JsonArgs,
}

pub(crate) fn run(args: &DemoArgs) -> Result<(), Failure> {
    args.json.claim_beside(&args.out)?;
    let plan = DemoPlan::of(args)?;
    // Checks before the run that the folder can be written; it is made only if it is needed.
    folder::prepare(&args.out)?;
    let report = plan.performed(args)?;
    for (name, value) in report.rows() {
        say!("{name:<10}{value}");
    }
    args.json.write(&report.figures)?;
    folder::write(&args.out, &report)?;
    say!("{:<10}{}", "report", args.out.join("report.html").display());
    let Some((worst, others)) = report.findings.split_first() else { return Ok(()) };
    for other in others {
        note!("demo: {}", other.what);
    }
    Err(worst.failure())
}

/// What is known before anything runs.
pub(crate) struct DemoPlan {
    interrupt: Interrupt,
    scratch: Scratch,
    source: Source,
    config: Config,
    /// One repetition of the pen's path [s].
    turn_s: f64,
}

impl DemoPlan {
    pub(crate) fn of(args: &DemoArgs) -> Result<Self, Failure> {
        let interrupt = Interrupt::listen()?;
        let scratch = Scratch::create()?;
        let (source, config) = settings(args, &scratch)?;
        let played = args.path.load(std::slice::from_ref(&args.pen), config.settings())?;
        Ok(Self { interrupt, scratch, source, config, turn_s: played.path.closed().duration_s() })
    }

    /// Figures, pictures and findings of a run, without a report.
    ///
    /// Everything else is cleaned up by now: printing to a closed pipe ends the program.
    pub(crate) fn performed(self, args: &DemoArgs) -> Result<RunReport, Failure> {
        let Self { interrupt, scratch, source, config, turn_s } = self;
        let gathered = evidence_of(args, &source, &config, &scratch, &interrupt)?;
        let setting = SettingFigures {
            pen: args.pen.clone(),
            predictor: config.settings().predictor.kind.name(),
            seconds: args.seconds,
            settings: config.name().to_owned(),
            optimised_build: !cfg!(debug_assertions),
        };
        RunReport::of(&gathered, &config, setting, turn_s)
    }
}

/// The settings of all processes: as asked for, on a private instance.
fn settings(args: &DemoArgs, scratch: &Scratch) -> Result<(Source, Config), Failure> {
    let mut source = args.settings.source()?;
    if args.kind == "ur" {
        ur::check(args)?;
        source = ur::fitting(source, args.series.as_deref());
    } else if args.series.is_some() {
        return Err(Failure::usage("--series is about Universal Robots controllers", "add --arm ur"));
    }
    source.rate_hz = args.rate.or(source.rate_hz);
    if let Some(predictor) = args.predictor {
        source = source.with("predictor.kind", predictor.name());
    }
    source = match args.trust.as_deref() {
        None => source,
        Some("auto") => source.with("trust.mode", "auto"),
        Some(value) => source.with("trust.mode", "manual").with("trust.value", value),
    };
    let root = format!("\"{}\"", scratch.root().display());
    let source = source.with("instance.root_dir", root);
    let config = judged(&source)?;
    Ok((source, config))
}

/// Runs the processes and collects what they leave behind.
fn evidence_of(
    args: &DemoArgs,
    source: &Source,
    config: &Config,
    scratch: &Scratch,
    interrupt: &Interrupt,
) -> Result<Gathered, Failure> {
    let instance = instance_of(config.settings())?;
    // Declared first, so that it goes last.
    let _files = PrivateFiles(instance.clone());
    let common = settings_arguments(source);
    let file = |name: &str| scratch.file(name).display().to_string();
    let mut crew = Crew::new(interrupt.clone(), args.seconds);

    let mut daemon = words(&["daemon", "--log", "warn"]);
    if args.no_rights {
        daemon.push("--no-rights".to_owned());
    }
    daemon.extend(option("--rate", source.rate_hz));
    daemon.extend(common.iter().cloned());
    crew.start("daemon", &daemon)?;
    let foretrace = crew.attached(&instance)?;
    let mut watch = RunWatch::open(&foretrace).map_err(unattached)?;

    let mut arm = match args.kind.as_str() {
        "ur" => {
            let robot = ur::controller(&mut crew, config, args.no_rights)?;
            ur::echo(&mut crew, config, args.no_rights, &file("echo.json"))?;
            let mut arm = words(&["arm", "ur", "--robot", &robot]);
            arm.extend(option("--rate", source.rate_hz));
            arm
        }
        _ => words(&["arm", "sim"]),
    };
    if args.no_rights {
        arm.push("--no-rights".to_owned());
    }
    arm.extend(words(&["--record", &file("arm.csv"), "--json", &file("arm.json")]));
    arm.extend(option("--rate", args.arm_rate));
    arm.extend(args.arm.arguments());
    arm.extend(common.iter().cloned());
    crew.start("arm", &arm)?;
    crew.arm(&mut watch.requests)?;
    watch.begin();

    let mut player = words(&["play", "--loop", "--record", &file("pen.csv"), "--json", &file("pen.json")]);
    player.extend(path_arguments(&args.path));
    player.extend(common.iter().cloned());
    player.extend(words(&["--", &args.pen]));
    crew.start("player", &player)?;
    let followed = crew.follow(&mut watch, args.seconds)?;
    // After a stop the records count: a failure to disarm in order must not cost the report.
    let let_go = |crew: &mut Crew, watch: &mut RunWatch| match (followed, crew.let_go(watch)) {
        (Followed::Whole, Err(failure)) => Err(failure),
        _ => Ok(()),
    };

    crew.end("player")?;
    let_go(&mut crew, &mut watch)?;
    let arm_words = crew.words("arm");
    crew.end("arm")?;
    crew.end(ur::CONTROLLER)?;
    ur::echo_ends(&mut crew)?;
    let mut gathered = watch.last_words();
    drop(foretrace);
    crew.end("daemon")?;
    drop(crew);

    gathered.arm_words = arm_words;
    gathered.read(scratch.folder(), config, args.kind == "ur")?;
    Ok(gathered)
}

fn path_arguments(path: &PathArgs) -> Vec<String> {
    let mut out = Vec::new();
    out.extend(option("--height", Some(path.height)));
    out.extend(option("--scale", Some(path.scale)));
    out.extend(option("--speed", Some(path.speed)));
    out.extend(option("--style", Some(path.style)));
    out.extend(option("--label", path.label.as_ref()));
    out.extend(option("--segments", path.segments.map(|(first, last)| format!("{first}-{last}"))));
    out.extend(option("--unit", path.unit.unit.as_ref()));
    out
}

fn option(name: &str, value: Option<impl ToString>) -> Vec<String> {
    value.map_or_else(Vec::new, |value| vec![format!("{name}={}", value.to_string())])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::units::UnitArgs;
    use clap::Parser;

    #[derive(Debug, Parser)]
    struct Line {
        #[command(flatten)]
        settings: SettingsArgs,
        #[command(flatten)]
        path: PathArgs,
    }

    #[test]
    fn children_get_the_settings_and_the_path_that_were_asked_for() {
        let source =
            Source::preset("ur5e").with("instance.root_dir", "\"/tmp/x y\"").with("trust.value", "0.5");
        let path = PathArgs {
            height: 0.02,
            label: Some("K".to_owned()),
            segments: Some((3, 9)),
            unit: UnitArgs { unit: Some("mm,us".to_owned()) },
            ..PathArgs::default()
        };
        let arguments = [words(&["child"]), settings_arguments(&source), path_arguments(&path)].concat();
        let line = Line::try_parse_from(arguments).unwrap();
        assert_eq!(line.settings.source().unwrap(), source);
        assert_eq!(
            (line.path.height, line.path.label, line.path.segments, line.path.unit),
            (path.height, path.label, path.segments, path.unit)
        );
    }
}
