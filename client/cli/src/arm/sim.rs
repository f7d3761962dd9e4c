//! `foretrace arm sim`: a simulated UR5 controller as a process of its own.

use std::path::PathBuf;
use std::time::Duration;

use foretrace_arm::guide::{self, Guide};
use foretrace_arm::sim::{SimOptions, Simulation};
use foretrace_control::arm::JointLimits;
use foretrace_sim::arm::JOINTS;

use super::options::LagArgs;
use crate::attach::{attach_within, instance_of};
use crate::failure::Failure;
use crate::interrupt::Interrupt;
use crate::output::{JsonArgs, note, say_lines, tell};
use crate::settings::SettingsArgs;
use crate::terminal::TypedKeys;

/// Simulate a UR5 behind its controller: receive joint commands, move like the arm, report joint states
///
/// The controller takes one command per cycle, adds the pure delay asked for and one cycle, a critically
/// damped servo with the look-ahead as its group delay (servoj), a joint loop of 2 ms, and clamps at 3.34
/// rad/s and 40 rad/s². Its joints are ideal unless told otherwise. It brakes by itself when no commands
/// come. Every command received is checked against the settings' limits; the result is printed at the end.
#[derive(Debug, clap::Args)]
#[command(
    allow_negative_numbers = true,
    after_help = "Examples:\n  foretrace arm sim --lag-ms 66                  in all 100 ms late\n  \
                  foretrace arm sim --look-ahead-ms 0 --lag-ms 30  a pure delay\n  foretrace arm sim \
                  --lag-ms 20 --jitter-ms 5 --lag-change 20:60\n  foretrace arm sim --damping 0.52 \
                  --stiction-mrad 1:2,2:2 --gain 5:0.5"
)]
pub(crate) struct SimArgs {
    /// Cycles per second of the controller [default: robot.controller_rate_hz of the settings]
    #[arg(long, value_name = "HZ", value_parser = clap::value_parser!(u32).range(50..=2000))]
    rate: Option<u32>,

    #[command(flatten)]
    lag: LagArgs,

    /// End after this many seconds; otherwise on Ctrl-C
    #[arg(long, value_name = "S", value_parser = crate::values::lasting)]
    seconds: Option<f64>,

    /// Seconds to wait for the daemon to come up
    #[arg(long, value_name = "S", default_value_t = 0.0, value_parser = crate::values::wait)]
    wait: f64,

    /// Start at these joint positions, base first [rad], for example --from=0.5,-1.9,-1.7,-1.1,1.6,0
    /// [default: home]
    #[arg(long, value_name = "Q1,...,Q6", value_delimiter = ',', num_args = 1..)]
    from: Option<Vec<f64>>,

    /// Write every joint state as CSV: t_s (monotonic clock), q1..q6 [rad]
    #[arg(long, value_name = "FILE")]
    record: Option<PathBuf>,

    /// Move the arm by hand while it is not armed, with the keys of the terminal: to rehearse `foretrace
    /// calibrate plane` and `foretrace move home`
    #[arg(long)]
    guide: bool,

    /// Ask for no real-time priority
    #[arg(long)]
    no_rights: bool,

    /// Compute without a pause from so long after the first command on, as a broken arm's process might
    #[arg(long, value_name = "S", hide = true, value_parser = crate::values::lasting)]
    spin_after: Option<f64>,

    #[command(flatten)]
    settings: SettingsArgs,

    #[command(flatten)]
    json: JsonArgs,
}

pub(crate) fn run(args: &SimArgs) -> Result<(), Failure> {
    args.json.claim()?;
    let interrupt = Interrupt::listen()?;
    let config = args.settings.load()?;
    let (robot, settings) = (config.robot(), config.settings());
    let rate_hz = args.rate.unwrap_or(settings.robot.controller_rate_hz);
    let from = args.from.as_deref().map_or(Ok(robot.home), |from| standing(from, &robot.limits))?;
    let arm = args.lag.settings(1.0 / f64::from(rate_hz));
    let late_ms = arm.group_delay_s() * 1e3;
    let guide = || -> Result<Guide, Failure> {
        let mut keys = TypedKeys::listen().ok_or_else(|| {
            Failure::usage("stdin is no terminal, which has the keys for --guide", "start it in a terminal")
        })?;
        note!("arm: {}", guide::HELP);
        Ok(Guide::new(&robot.chain, &robot.limits, Box::new(move || keys.typed())))
    };
    let options = SimOptions {
        rate_hz,
        arm,
        from,
        record: args.record.clone(),
        guide: args.guide.then(guide).transpose()?,
        no_rights: args.no_rights,
        seconds: args.seconds,
        spin_after: args.spin_after,
    };
    let sim = Simulation::new(&config, options)?;
    let instance = instance_of(settings)?;
    let foretrace = attach_within(&instance, Duration::from_secs_f64(args.wait))?;
    note!(
        "arm: {rate_hz} Hz, look-ahead {} ms, in all {late_ms:.1} ms late, instance {}",
        args.lag.look_ahead_ms,
        instance.number()
    );
    let report = sim.run(foretrace, &|| interrupt.is_set(), &tell)?;
    say_lines(report.lines());
    args.json.write(&report)
}

/// Parses the joint positions of `--from` [rad].
fn standing(from: &[f64], limits: &JointLimits<JOINTS>) -> Result<[f64; JOINTS], Failure> {
    let wrong = |why: String| Failure::usage(why, "give --from=Q1,...,Q6, base first, in radians");
    let q: [f64; JOINTS] = from
        .try_into()
        .map_err(|_| wrong(format!("--from has {} numbers, the arm {JOINTS} joints", from.len())))?;
    for (joint, (q, [low, high])) in q.iter().zip(limits.position()).enumerate() {
        if !(*q >= *low && *q <= *high) {
            return Err(wrong(format!("--from puts joint {joint} at {q} rad, legal {low:.3} to {high:.3}")));
        }
    }
    Ok(q)
}
