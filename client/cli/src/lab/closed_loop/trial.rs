//! The law in front of one arm, tick by tick: an arm behind a socket, or a built-in one; stops and ticks are
//! reported.

use std::path::PathBuf;
use std::time::Duration;

use foretrace_config::Config;
use foretrace_control::stop::StopReason;
use foretrace_lab::closed_loop::{BenchArm, Flaws, Hand, Rival, TickTable, Trial, Tried, rows, table_lines};
use foretrace_lab::experiments::{DeskArm, LawEntrant, Watched};
use foretrace_lab::lockstep::{ArmEffortUnit, LawHello, SocketArm, begin};
use serde_json::json;

use super::ClosedLoopArgs;
use crate::failure::Failure;
use crate::output::{note, say, say_lines};

#[derive(Debug, clap::Args)]
pub(crate) struct TrialArgs {
    /// Run the law in virtual time in lock-step with the arm that listens at this Unix socket, instead of a
    /// built-in one: docs/extend/judge.md
    #[arg(long, value_name = "PATH", conflicts_with_all = ["pareto", "each", "arms", "shard"])]
    arm_socket: Option<PathBuf>,

    /// The arm behind the socket may be silent for so long [s]
    #[arg(long, value_name = "S", default_value_t = 30.0, value_parser = crate::values::lasting)]
    arm_timeout: f64,

    /// Ask for a stop this many seconds after the run began, and end a while after it; one arm, one predictor
    #[arg(long, value_name = "S", value_parser = crate::values::lasting,
        conflicts_with_all = ["pareto", "each", "shard"])]
    stop_at: Option<f64>,

    /// After a stop, asked for or not, go on for so long [s]
    #[arg(long, value_name = "S", default_value_t = 1.0, value_parser = crate::values::wait)]
    after_stop: f64,

    /// Write every tick as CSV: pen, commands, what was measured, mode, stop; one arm, one predictor
    #[arg(long, value_name = "FILE", conflicts_with_all = ["pareto", "each", "shard"])]
    ticks: Option<PathBuf>,
}

impl TrialArgs {
    /// The arm is behind a socket.
    pub(super) fn on_a_socket(&self) -> bool {
        self.arm_socket.is_some()
    }

    /// One of them is asked for.
    pub(super) fn asked(&self) -> bool {
        self.arm_socket.is_some() || self.stop_at.is_some() || self.ticks.is_some()
    }
}

pub(super) fn run(
    args: &ClosedLoopArgs,
    config: &Config,
    rivals: &[Rival],
    arms: Vec<(BenchArm, Vec<Hand>)>,
    title: &str,
) -> Result<(), Failure> {
    let trial = &args.trial;
    let law = one_law(rivals)?;
    let Ok([(like, hands)]) = <[_; 1]>::try_from(arms) else {
        return Err(Failure::usage(
            "--stop-at and --ticks are for one arm",
            "name one (--arms), for example --arms ur5",
        ));
    };
    let name = if trial.arm_socket.is_some() { "socket" } else { like.name() };
    let mut table = trial.ticks.is_some().then(TickTable::default);
    let (mut scores, mut trials, mut stops) = (Vec::new(), Vec::new(), Vec::new());
    for (index, hand) in hands.iter().enumerate() {
        let (arm, effort) = arm(trial, config, &args.flaws(), like)?;
        let what =
            Trial { config, like, law, hand, stop_at_s: trial.stop_at, after_stop_s: trial.after_stop };
        let mut see = |sequence: usize, tick: &Watched<'_>| {
            if let Some(table) = &mut table {
                table.add(index, sequence, tick);
            }
        };
        let tried: Tried = what.run(arm, &mut see).map_err(|error| {
            Failure::failed(format_args!("{}, writer {:?}: {error}", hand.file, hand.writer), "")
        })?;
        if let Some(stop) = &tried.stop {
            stops.push((hand, *stop));
        }
        scores.extend(tried.scores.iter().copied());
        trials.push(json!({
            "file": hand.file, "writer": hand.writer, "effort": effort, "seconds": tried.seconds,
            "illegal": tried.illegal, "stop": tried.stop, "sequences": tried.scores,
        }));
    }
    let rival = Rival::Law(law);
    let rows: Vec<_> = rows(rival, name, &scores, None).into_iter().collect();
    say!("{title}: {} sequences in front of {name}\n", scores.len());
    say_lines(table_lines(&rows));
    for (hand, stop) in &stops {
        let detail = &stop.detail;
        let who = if hand.writer.is_empty() { hand.file.clone() } else { hand.writer.clone() };
        let asked = if stop.reason == StopReason::Requested { " (asked for)" } else { "" };
        note!(
            "lab: {who}: stop after {:.3} s{asked}: {:?}, {:?} {:.4} over {:.4}",
            stop.t_s,
            stop.reason,
            detail.cause,
            detail.amount,
            detail.limit
        );
    }
    if let (Some(file), Some(table)) = (&trial.ticks, &table) {
        super::super::write_text(file, table.text())?;
        say!("ticks    {}", file.display());
    }
    args.json.write(&json!({ "set": title, "arm": name, "rows": rows, "trials": trials }))
}

fn one_law(rivals: &[Rival]) -> Result<LawEntrant, Failure> {
    match rivals {
        [Rival::Law(law)] => Ok(*law),
        [Rival::External(name)] => Err(Failure::usage(
            format_args!("{name}: --arm-socket, --stop-at and --ticks take no predictor of another program"),
            "leave them out, or name hold or mixture",
        )),
        [_] => Err(Failure::usage("a baseline has no stops and no ticks of the law", "name hold or mixture")),
        _ => Err(Failure::usage(
            "--arm-socket, --stop-at and --ticks are for one predictor",
            "name it, for example --predictors mixture",
        )),
    }
}

/// The arm of one hand, at rest, and the unit of its effort.
fn arm(
    args: &TrialArgs,
    config: &Config,
    flaws: &Flaws,
    like: BenchArm,
) -> Result<(Box<dyn DeskArm>, ArmEffortUnit), Failure> {
    let home = config.robot().home;
    let Some(path) = &args.arm_socket else {
        return Ok((flaws.of(like.kind(config)).built(home), ArmEffortUnit::None));
    };
    let period_ns = config.settings().period_ns();
    let hello = LawHello { period_ns, begin: begin(period_ns), home };
    let arm = SocketArm::connect(path, Duration::from_secs_f64(args.arm_timeout), &hello)
        .map_err(|error| Failure::failed(error, ""))?;
    let effort = arm.hello().effort;
    Ok((Box::new(arm), effort))
}
