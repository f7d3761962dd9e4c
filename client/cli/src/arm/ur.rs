//! `foretrace arm ur`: the bridge to a Universal Robots controller, as a process of its own.

use std::path::PathBuf;
use std::time::Duration;

use foretrace_arm::ur::{JudgedBridge, UrOptions};

use crate::attach::{attach_within, instance_of};
use crate::failure::Failure;
use crate::interrupt::Interrupt;
use crate::output::{JsonArgs, say_lines, tell};
use crate::robot::HostArgs;
use crate::settings::{SettingsArgs, judged};

/// Drive a Universal Robots arm: joint commands to its controller, its joints back
///
/// For CB3 from PolyScope 3.9 and e-Series from 5.3, or `foretrace ur-sim`. Uses RTDE registers 24 to 41 and
/// a program of its own that stops the arm by itself when commands stay away. Checks version, model, payload
/// and tool first; nothing moves before somebody arms the daemon, which has to run with the same settings.
/// Never ends a protective stop: that is done
/// on the pendant.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:\n  foretrace arm ur --robot 127.0.0.1    beside foretrace ur-sim\n  \
                  foretrace arm ur --robot 192.168.0.9 --preset ur5-first-run")]
pub(crate) struct UrArgs {
    #[command(flatten)]
    host: HostArgs,

    /// Move an arm on another machine although safety.enable_required is false: without a dead-man nobody but
    /// the emergency stop can stop it at once
    #[arg(long)]
    without_dead_man: bool,

    /// Lower the pen as far as the settings say although the model is not the arm's factory calibration
    #[arg(long)]
    uncalibrated: bool,

    /// The rate that the daemon was given by --rate [Hz]; its settings have to be these
    #[arg(long, value_name = "HZ", value_parser = foretraced::options::rate)]
    rate: Option<u32>,

    /// Ask for no real-time priority
    #[arg(long)]
    no_rights: bool,

    /// End after this many seconds; otherwise on Ctrl-C
    #[arg(long, value_name = "S", value_parser = crate::values::lasting)]
    seconds: Option<f64>,

    /// Write every joint state as CSV: t_s (monotonic clock), q1..q6 [rad]
    #[arg(long, value_name = "FILE")]
    record: Option<PathBuf>,

    /// Seconds to wait for the daemon to come up
    #[arg(long, value_name = "S", default_value_t = 0.0, value_parser = crate::values::wait)]
    wait: f64,

    #[command(flatten)]
    settings: SettingsArgs,

    #[command(flatten)]
    json: JsonArgs,
}

pub(crate) fn run(args: &UrArgs) -> Result<(), Failure> {
    args.json.claim()?;
    let interrupt = Interrupt::listen()?;
    let mut source = args.settings.source()?;
    source.rate_hz = args.rate;
    let config = judged(&source)?;
    let options = UrOptions {
        host: args.host.robot.clone(),
        without_dead_man: args.without_dead_man,
        uncalibrated: args.uncalibrated,
        no_rights: args.no_rights,
        seconds: args.seconds,
        record: args.record.clone(),
    };
    let bridge = JudgedBridge::new(&config, args.host.addresses()?, options, &tell)?;
    let foretrace = attach_within(&instance_of(config.settings())?, Duration::from_secs_f64(args.wait))?;
    let (report, over) = bridge.run(foretrace, &|| interrupt.is_set(), &tell)?;
    say_lines(report.lines());
    args.json.write(&report)?;
    over.map_or(Ok(()), |reason| Err(Failure::failed(reason.text(), reason.remedy())))
}
