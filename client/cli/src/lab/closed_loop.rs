//! `foretrace lab closed-loop`: the benchmark of predictors and baselines in closed loop with simulated arms.

mod trial;

use std::path::{Path, PathBuf};

use foretrace_config::Config;
use foretrace_control::estimate::LawParameters;
use foretrace_lab::closed_loop::{
    BenchArm, Benchmark, Each, Flaws, HandOptions, HandsOfArms, MethodOutcome, ParetoPoint, Rival,
    hands_of_set, hands_of_texts, pictures, table_lines,
};
use foretrace_lab::shards::{ClosedLoopRun, Shard, closed_loop_part, digest, files_digest, own_hands};
use foretrace_sim::data::Split;
use foretrace_sim::path::Lift;
use serde_json::{Value, json};

use super::lab_run::{LabRun, SettingsSums};
use super::law::named_number;
use super::progress::StepProgress;
use super::shards::ShardArgs;
use super::{say_picture, shards};
use crate::arm::options::JointArgs;
use crate::failure::Failure;
use crate::output::{JsonArgs, note, say, say_lines, tell};
use crate::settings::SettingsArgs;
use crate::units::UnitArgs;
use crate::values::number;

#[derive(Debug, clap::Args)]
pub(crate) struct ClosedLoopArgs {
    /// Data-set folder
    #[arg(long, value_name = "DIR", required_unless_present = "text", conflicts_with = "text")]
    data: Option<PathBuf>,

    /// Instead of a set, this text in the hand of the built-in writer, hover included; may be given several
    /// times, each in another hand
    #[arg(long, value_name = "TEXT", conflicts_with_all = ["pareto", "split", "limit"])]
    text: Vec<String>,

    /// Part of the set: a word of its split.tsv, or all [default: test if there is one, else all]
    #[arg(long, value_name = "WORD")]
    split: Option<Split>,

    /// Predictors and baselines to run, comma-separated; a baseline with -legal behind its name keeps its
    /// commands inside the joints' limits; external:COMMAND is a predictor of your own in another program (a
    /// comma ends a name): docs/extend/process.md [default: all, none of them -legal]
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    predictors: Vec<String>,

    /// Arms to run them on, comma-separated
    #[arg(long, value_name = "NAMES", value_delimiter = ',', default_value = "ideal,delay30,ur5,slow")]
    arms: Vec<String>,

    /// Lifts without recorded hover: keep the jump of one sample, or insert a synthetic travel
    #[arg(long, value_name = "KIND", value_parser = ["leap", "travel"], default_value = "leap")]
    lifts: String,

    /// Age of every pen sample when it arrives, as behind a network [ms]
    #[arg(long, value_name = "MS", default_value_t = 0.0, value_parser = age,
        conflicts_with_all = ["arm_socket", "stop_at", "ticks"])]
    pen_age: f64,

    /// Another value of a number of the law, as `foretrace lab law` names it; may be given several times
    #[arg(long, value_name = "NAME=VALUE", conflicts_with_all = ["arm_socket", "stop_at", "ticks"])]
    law: Vec<String>,

    /// Plot error against jerk instead of the table: sweep every method over its tuning [default: hold,
    /// mixture and the baselines]
    #[arg(long, conflicts_with = "shard")]
    pareto: bool,

    /// At most this many sequences of each hand, every writer of every file, in the order of the file
    #[arg(long, value_name = "N", value_parser = super::count)]
    limit: Option<usize>,

    /// At most this many hands, in the order of the files
    #[arg(long, value_name = "N", value_parser = super::count)]
    hands: Option<usize>,

    /// Add every sequence's scores to the JSON, for paired comparisons
    #[arg(long, requires = "json", conflicts_with = "pareto")]
    each: bool,

    #[command(flatten)]
    unit: UnitArgs,

    /// Stop at a bad file instead of leaving it out
    #[arg(long)]
    strict: bool,

    /// Folder for the pictures and run.json, which tells how to repeat the run [default: a new one,
    /// foretrace-lab/closed-loop-SET-DATE]
    #[arg(long, value_name = "DIR", conflicts_with = "shard")]
    out: Option<PathBuf>,

    #[command(flatten)]
    shard: ShardArgs,

    #[command(flatten)]
    trial: trial::TrialArgs,

    #[command(flatten)]
    joints: JointArgs,

    #[command(flatten)]
    settings: SettingsArgs,

    #[command(flatten)]
    json: JsonArgs,
}

/// As shards of it are named.
pub(super) const NAME: &str = "closed-loop";

impl ClosedLoopArgs {
    /// What is wrong with ur5 and slow, and with the pen.
    fn flaws(&self) -> Flaws {
        Flaws {
            damping: self.joints.damping(),
            mechanics: self.joints.mechanics(),
            pen_age_ns: (self.pen_age * 1e6) as u64,
        }
    }
}

impl ClosedLoopArgs {
    /// The numbers of the law, with those asked for.
    fn law(&self) -> Result<LawParameters, Failure> {
        let mut law = LawParameters::SHIPPED;
        for asked in &self.law {
            let wrong = |what: String| Failure::usage(what, "give NAME=VALUE (--law)");
            let (name, text) = asked.split_once('=').unwrap_or((asked, ""));
            let (name, text) = (name.trim(), text.trim());
            let number = named_number(name)?;
            let [least, most] = number.range;
            let value: f64 = text.parse().unwrap_or(f64::NAN);
            if !(least..=most).contains(&value) {
                return Err(wrong(format!(
                    "{name} is {text:?}, legal are {least} to {most} {}",
                    number.unit
                )));
            }
            law = law.with(&number, value);
        }
        Ok(law)
    }
}

/// An age of pen samples [ms].
fn age(text: &str) -> Result<f64, String> {
    number(0.0..=1000.0, "a number of milliseconds from 0 to 1000")(text)
}

pub(super) fn run(args: &ClosedLoopArgs) -> Result<(), Failure> {
    let data: Vec<&Path> = args.data.iter().map(PathBuf::as_path).collect();
    let lab_run = LabRun::begin(NAME, &data, args.out.as_deref(), &args.json)?;
    let config = args.settings.load()?;
    let rivals = rivals(&args.predictors, args.pareto)?;
    let law = args.law()?;
    let arms = if args.trial.on_a_socket() { vec![BenchArm::Ur5] } else { arms(&args.arms)? };
    let (title, arms) = written(args, arms, &config)?;
    if args.trial.asked() {
        return trial::run(args, &config, &rivals, arms, &title);
    }
    if let Some(shard) = args.shard.shard {
        return write_shard(args, shard, &config, (rivals, law), (title, arms));
    }
    lab_run.try_folder()?;
    let benchmark = Benchmark { config: &config, arms, rivals, flaws: args.flaws(), law };
    if args.pareto {
        return pareto(args, &title, &benchmark, &lab_run);
    }
    let progress = StepProgress::of("lab closed-loop", benchmark.jobs());
    let outcomes = benchmark.run(|| progress.step()).map_err(|error| Failure::failed(error, ""))?;
    drop(progress);
    let names = args.each.then(|| benchmark.names());
    let each = names.as_ref().map(|names| MethodOutcome::each(names, &outcomes).collect());
    let result = result(&title, &args.lifts, &outcomes, each);
    let (out, heading) = show(&title, &outcomes, &lab_run, &args.json, &result)?;
    let letters = pictures::letters(&out, &heading, &benchmark, &outcomes)?;
    letters.iter().for_each(|file| say_picture(file));
    lab_run.finish(SettingsSums::of(&config))
}

/// The table, the result as JSON and the distributions of errors; returns folder and heading of pictures.
pub(super) fn show(
    title: &str,
    outcomes: &[MethodOutcome],
    lab_run: &LabRun,
    json: &JsonArgs,
    result: &Value,
) -> Result<(PathBuf, String), Failure> {
    let rows = MethodOutcome::table(outcomes);
    if rows.is_empty() {
        return Err(nothing(title));
    }
    let sequences = rows.iter().map(|row| row.sequences).max().unwrap_or(0);
    say!("{title}: {sequences} sequences\n");
    say_lines(table_lines(&rows));
    let heading = format!("{title}, {sequences} sequences");
    let out = lab_run.keep(json, result)?;
    say!("");
    say_picture(&pictures::distributions(&out, &heading, outcomes)?);
    Ok((out, heading))
}

/// The result as JSON, with every sequence where that was asked for.
pub(super) fn result(
    title: &str,
    lifts: &str,
    outcomes: &[MethodOutcome],
    each: Option<Vec<Each<'_>>>,
) -> Value {
    let mut result = json!({ "set": title, "lifts": lifts, "rows": MethodOutcome::table(outcomes) });
    if let Some(each) = each {
        result["sequences"] = json!(each);
    }
    result
}

/// Writes the shard's hands, and what the merge needs.
fn write_shard(
    args: &ClosedLoopArgs,
    shard: Shard,
    config: &Config,
    (rivals, law): (Vec<Rival>, LawParameters),
    (set, arms): (String, HandsOfArms),
) -> Result<(), Failure> {
    let flaws = args.flaws();
    let run = ClosedLoopRun {
        set,
        lifts: args.lifts.clone(),
        each: args.each,
        arms: arms.iter().map(|(arm, _)| arm.name().to_owned()).collect(),
        hands: arms.iter().map(|(_, hands)| hands.len()).collect(),
        predictors: rivals.iter().map(|rival| rival.name().to_owned()).collect(),
        options: format!("{flaws:?}\n{law:?}"),
        settings: config.meaning(),
        files: files_digest(config),
        data: digest(&arms),
    };
    let sequences = |arms: &HandsOfArms| {
        arms.iter().flat_map(|(_, hands)| hands).map(|hand| hand.sequences.len()).sum::<usize>()
    };
    let all = sequences(&arms);
    let (arms, places) = own_hands(arms, shard);
    let counts = [sequences(&arms), all];
    let benchmark = Benchmark { config, arms, rivals, flaws, law };
    let progress = StepProgress::of("lab closed-loop", benchmark.jobs());
    let outcomes = benchmark.run(|| progress.step()).map_err(|error| Failure::failed(error, ""))?;
    drop(progress);
    let part = closed_loop_part(&benchmark.names(), &places, &outcomes);
    shards::write(&args.json, NAME, shard, run, part, counts)
}

fn pareto(
    args: &ClosedLoopArgs,
    title: &str,
    benchmark: &Benchmark<'_>,
    lab_run: &LabRun,
) -> Result<(), Failure> {
    let sweep = benchmark.pareto_sweep();
    sweep.refused.iter().for_each(|refused| note!("lab: left out: {refused}"));
    let progress = StepProgress::of("lab closed-loop", sweep.jobs);
    let points = benchmark.pareto(sweep, || progress.step()).map_err(|error| Failure::failed(error, ""))?;
    drop(progress);
    if points.is_empty() {
        return Err(nothing(title));
    }
    say!("{title}: error against jerk\n");
    let wide = points.iter().map(|point| point.method.chars().count()).max().unwrap_or(0).max(18);
    say!("{:<wide$} {:<8} {:<34} {:>9} {:>10}", "method", "arm", "tuning", "rms mm", "rms jerk");
    for ParetoPoint { method, arm, label, rms_m, rms_jerk, .. } in &points {
        say!("{method:<wide$} {arm:<8} {label:<34} {:>9.3} {rms_jerk:>10.1}", rms_m * 1e3);
    }
    let result = json!({ "set": title, "lifts": args.lifts, "pareto": points });
    let out = lab_run.keep(&args.json, &result)?;
    say!("");
    say_picture(&pictures::pareto(&out, title, &points)?);
    lab_run.finish(SettingsSums::of(benchmark.config))
}

fn nothing(title: &str) -> Failure {
    let what = format_args!("{title}: nothing in this part can be scored");
    Failure::bad_input(what, "give a set with handwriting in it, or another part (--split)")
}

/// What every arm writes, and its name.
fn written(
    args: &ClosedLoopArgs,
    arms: Vec<BenchArm>,
    config: &Config,
) -> Result<(String, HandsOfArms), Failure> {
    let Some(folder) = &args.data else {
        return Ok(("built-in writer".to_owned(), hands_of_texts(&args.text, arms, config)?));
    };
    let options = HandOptions {
        split: args.split.clone(),
        strict: args.strict,
        lift: if args.lifts == "travel" { Lift::Travel } else { Lift::Leap },
        sequences: args.limit,
        hands: args.hands,
        units: args.unit.units(),
    };
    hands_of_set(folder, &options, arms, config, &tell)
}

fn rivals(names: &[String], pareto: bool) -> Result<Vec<Rival>, Failure> {
    if names.is_empty() {
        let swept = |rival: &Rival| matches!(*rival, Rival::HOLD | Rival::AS_SHIPPED | Rival::Baseline(_));
        return Ok(Rival::all().filter(|rival| !pareto || swept(rival)).collect());
    }
    let named = |name: &String| {
        Rival::named(name.trim()).map_err(|error| Failure::usage(error, "choose from them (--predictors)"))
    };
    let rivals: Vec<Rival> = names.iter().map(named).collect::<Result<_, _>>()?;
    match rivals.iter().enumerate().find(|(i, rival)| rivals.iter().take(*i).any(|r| r == *rival)) {
        Some((_, twice)) => Err(Failure::usage(
            format_args!("method {:?} is named twice", twice.name()),
            "name each once (--predictors)",
        )),
        None => Ok(rivals),
    }
}

pub(super) fn arms(names: &[String]) -> Result<Vec<BenchArm>, Failure> {
    let named = |name: &String| {
        BenchArm::ALL.into_iter().find(|arm| arm.name() == name.trim()).ok_or_else(|| {
            let known = BenchArm::ALL.map(BenchArm::name).join(" ");
            Failure::usage(
                format_args!("no arm is called {name:?}"),
                format_args!("choose from {known} (--arms)"),
            )
        })
    };
    names.iter().map(named).collect()
}
