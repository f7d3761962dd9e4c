//! `foretrace calibrate lag`: a small test motion, and the lag with which the arm follows it.

use std::path::PathBuf;
use std::time::Duration;

use foretrace_calibrate::lag::{LagOptions, measure};

use crate::attach::{attach_within, instance_of};
use crate::failure::Failure;
use crate::interrupt::Interrupt;
use crate::output::{JsonArgs, note, note_replaced, say_lines, tell};
use crate::settings::SettingsArgs;
use crate::values;

/// Measure the arm's lag: make a small test motion and compare commands with joint states
///
/// Plays a gentle, hovering pen motion around the tool's position, a few frequencies at once, from rest to
/// rest. The daemon must be armed (or give --arm). Fits a pure delay and a delay with a servo behind it to
/// all joints that move, and says which one the arm is, how certain that is, and what to write into the
/// settings. No pen may be feeding the loop. Needs the settings that the daemon runs with.
#[derive(Debug, clap::Args)]
#[command(
    allow_negative_numbers = true,
    after_help = "Examples:\n  foretrace calibrate lag --arm\n  foretrace calibrate lag --amplitude-mm 5 \
                  --seconds 10 --json lag.json"
)]
pub(crate) struct LagMeasureArgs {
    /// Arm the daemon for the motion, and disarm it at the end
    #[arg(long)]
    arm: bool,

    /// Amplitude of the motion along each axis, at the tool [mm], 1 to 50
    #[arg(long, value_name = "MM", default_value_t = 10.0, value_parser = values::number(1.0..=50.0, "a number of millimetres from 1 to 50"))]
    amplitude_mm: f64,

    /// Length of the motion [s], 2 to 120
    #[arg(long, value_name = "S", default_value_t = 6.0, value_parser = values::number(2.0..=120.0, "a number of seconds from 2 to 120"))]
    seconds: f64,

    /// File for the picture
    #[arg(long, value_name = "FILE.svg", default_value = "foretrace-lag.svg")]
    plot: PathBuf,

    #[command(flatten)]
    settings: SettingsArgs,

    #[command(flatten)]
    json: JsonArgs,
}

pub(crate) fn run(args: &LagMeasureArgs) -> Result<(), Failure> {
    args.json.claim()?;
    let interrupt = Interrupt::listen()?;
    let config = args.settings.load()?;
    let foretrace = attach_within(&instance_of(config.settings())?, Duration::ZERO)?;
    let options = LagOptions { arm: args.arm, amplitude_mm: args.amplitude_mm, seconds: args.seconds };
    let measured = measure(&foretrace, &config, options, &|| interrupt.is_set(), &tell)?;
    note_replaced(&args.plot, "--plot FILE.svg");
    measured.draw(&args.plot)?;
    say_lines(measured.report.lines(&args.plot));
    let refused = measured.report.heard.commands_refused_by_arm;
    if refused > 0 {
        note!("calibrate: the arm refused {refused} commands meanwhile");
    }
    args.json.write(&measured.report)
}
