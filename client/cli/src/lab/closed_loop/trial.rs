//! The law in front of one arm, tick by tick: an arm behind a socket, or a built-in one; stops and ticks are
//! told.

use std::fmt::Write as _;
use std::io::Write as _;
use std::path::PathBuf;
use std::time::Duration;

use foretrace_config::Config;
use foretrace_control::stop::StopReason;
use foretrace_lab::closed_loop::{BenchArm, Flaws, Hand, Rival, Trial, Tried, rows};
use foretrace_lab::experiments::{DeskArm, LawEntrant, Watched};
use foretrace_lab::lockstep::{EffortUnit, LawHello, SocketArm, begin};
use serde_json::json;

use super::{ClosedLoopArgs, print};
use crate::failure::Failure;
use crate::output::{note, say};

#[derive(Debug, clap::Args)]
pub(crate) struct TrialArgs {
    /// Run the law in virtual time in lock-step with the arm that listens at this Unix socket, instead of a
    /// built-in one: docs/extend/judge.md
    #[arg(long, value_name = "PATH", conflicts_with_all = ["pareto", "each", "arms"])]
    arm_socket: Option<PathBuf>,

    /// The arm behind the socket may be silent for so long [s]
    #[arg(long, value_name = "S", default_value_t = 30.0, value_parser = crate::values::lasting)]
    arm_timeout: f64,

    /// Ask for a stop this many seconds after the run began, and end a while after it; one arm, one predictor
    #[arg(long, value_name = "S", value_parser = crate::values::lasting, conflicts_with_all = ["pareto", "each"])]
    stop_at: Option<f64>,

    /// After a stop, asked for or not, go on for so long [s]
    #[arg(long, value_name = "S", default_value_t = 1.0, value_parser = crate::values::wait)]
    after_stop: f64,

    /// Write every tick as CSV: pen, commands, what was measured, mode, stop; one arm, one predictor
    #[arg(long, value_name = "FILE", conflicts_with_all = ["pareto", "each"])]
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
    let mut table = trial.ticks.is_some().then(|| String::from(HEADING));
    let (mut scores, mut told, mut stops) = (Vec::new(), Vec::new(), Vec::new());
    for (place, hand) in hands.iter().enumerate() {
        let (arm, effort) = arm(trial, config, &args.flaws(), like)?;
        let what =
            Trial { config, like, law, hand, stop_at_s: trial.stop_at, after_stop_s: trial.after_stop };
        let mut see = |sequence: usize, tick: &Watched<'_>| {
            if let Some(table) = &mut table {
                row(table, place, sequence, tick);
            }
        };
        let tried: Tried = what.run(arm, &mut see).map_err(|error| {
            Failure::failed(format_args!("{}, writer {:?}: {error}", hand.file, hand.writer), "")
        })?;
        if let Some(stop) = &tried.stop {
            stops.push((hand, *stop));
        }
        scores.extend(tried.scores.iter().copied());
        told.push(json!({
            "file": hand.file, "writer": hand.writer, "effort": effort, "seconds": tried.seconds,
            "illegal": tried.illegal, "stop": tried.stop, "sequences": tried.scores,
        }));
    }
    let rival = Rival::Law(law);
    let rows: Vec<_> = rows(rival, name, &scores, None).into_iter().collect();
    say!("{title}: {} sequences in front of {name}\n", scores.len());
    print(&rows);
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
        foretrace_sim::whole::write(file, |out| out.write_all(table.as_bytes())).map_err(|error| {
            let what = format!("{} cannot be written: {error}", file.display());
            Failure::failed(what, "choose a file in an existing folder with room that you may write to")
        })?;
        say!("ticks    {}", file.display());
    }
    args.json.write(&json!({ "set": title, "arm": name, "rows": rows, "trials": told }))
}

fn one_law(rivals: &[Rival]) -> Result<LawEntrant, Failure> {
    match rivals {
        [Rival::Law(law)] => Ok(*law),
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
) -> Result<(Box<dyn DeskArm>, EffortUnit), Failure> {
    let home = config.robot().home;
    let Some(path) = &args.arm_socket else {
        return Ok((flaws.of(like.kind(config)).built(home), EffortUnit::None));
    };
    let period_ns = config.settings().period_ns();
    let hello = LawHello { period_ns, begin: begin(period_ns), home };
    let arm = SocketArm::connect(path, Duration::from_secs_f64(args.arm_timeout), &hello)
        .map_err(|error| Failure::failed(error, ""))?;
    let effort = arm.hello().effort;
    Ok((Box::new(arm), effort))
}

const HEADING: &str = "hand,sequence,t_s,measured_s,pen_x_m,pen_y_m,contact,mode,stop,enabled,alpha,\
    command_x_m,command_y_m,command_z_m,tool_x_m,tool_y_m,tool_z_m,\
    q1,q2,q3,q4,q5,q6,qd1,qd2,qd3,qd4,qd5,qd6,\
    measured_q1,measured_q2,measured_q3,measured_q4,measured_q5,measured_q6,\
    effort1,effort2,effort3,effort4,effort5,effort6\n";

/// A line of the table: numbers with all their digits, so that bits come back.
fn row(table: &mut String, hand: usize, sequence: usize, tick: &Watched<'_>) {
    let Watched { output, measured, .. } = tick;
    let command = output.command.as_ref();
    let (q, qd) = command.map_or(([f64::NAN; 6], [f64::NAN; 6]), |command| (command.q, command.qd));
    let enabled = command.is_some_and(|command| command.enabled);
    let measured_s = tick.t_s - tick.until.seconds_since(measured.stamp);
    // Into a string nothing fails.
    let _ = write!(
        table,
        "{hand},{sequence},{},{measured_s},{},{},{},{:?},{:?},{},{}",
        tick.t_s,
        output.pen_position[0],
        output.pen_position[1],
        u8::from(output.pen_contact),
        output.mode,
        output.stop_reason,
        u8::from(enabled),
        output.trust.alpha.alpha(),
    );
    let numbers = output.tool.iter().chain(&tick.tool).chain(&q).chain(&qd);
    for number in numbers.chain(&measured.q).chain(&measured.effort) {
        let _ = write!(table, ",{number}");
    }
    table.push('\n');
}
