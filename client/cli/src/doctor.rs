//! `foretrace doctor`: whether this machine is fit for the loop at its rate, and what to do where it is not.

use std::time::Duration;

use foretrace_config::Config;
use foretrace_doctor::{Doctor, Fitness, Removed, examine_robot};

use crate::attach::instance_of;
use crate::failure::{Cause, Failure};
use crate::interrupt::Interrupt;
use crate::output::{JsonArgs, say};
use crate::robot::addresses;
use crate::settings::{SettingsArgs, judged};
use crate::values;

/// Check whether this machine is fit for the loop at its rate, or a robot's controller for the bridge, and
/// say what to do where it is not
///
/// Checks the kernel, the rights of this user, processors, shared memory and leftovers of dead instances,
/// then runs the loop's clock on a real-time thread for a few seconds and measures its wake-up latency. Run
/// it as the user of the daemon, with the other programs of the machine running and no daemon. Exit code 6:
/// unfit.
///
/// With --robot it checks a Universal Robots controller instead: its ports one by one, version, remote
/// control, safety, program, payload and tool, registers, calibration, jitter and round trip. It moves
/// nothing.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:\n  foretrace doctor\n  \
                  foretrace doctor --rate 1000 --seconds 60 --json doctor.json\n  \
                  foretrace doctor --clean\n  \
                  foretrace doctor --robot 192.168.0.9")]
pub(crate) struct DoctorArgs {
    /// How long to measure wake-ups, or to listen to a robot [default: 5, with --robot 10]
    #[arg(long, value_name = "S", value_parser = seconds)]
    seconds: Option<f64>,

    /// Look at the Universal Robots controller of this name or IP address instead of this machine
    #[arg(long, value_name = "HOST", conflicts_with_all = ["clean", "no_rights", "rate"])]
    robot: Option<String>,

    /// Rate of the loop instead of the settings' [Hz]: 125, 250, 500 or 1000
    #[arg(long, value_name = "HZ", value_parser = foretraced::options::rate)]
    rate: Option<u32>,

    /// First remove what dead instances of this user left behind (with --root: that instance only); never
    /// touches living ones
    #[arg(long)]
    clean: bool,

    /// Measure without real-time rights; the verdict is then unfit
    #[arg(long)]
    no_rights: bool,

    #[command(flatten)]
    settings: SettingsArgs,

    #[command(flatten)]
    json: JsonArgs,
}

pub(crate) fn run(args: &DoctorArgs) -> Result<(), Failure> {
    args.json.claim()?;
    let mut source = args.settings.source()?;
    source.rate_hz = args.rate;
    let config = judged(&source)?;
    let interrupt = Interrupt::listen()?;
    if let Some(host) = &args.robot {
        return of_robot(host, &config, args.seconds.unwrap_or(10.0), &interrupt, &args.json);
    }
    let seconds = args.seconds.unwrap_or(5.0);
    let settings = config.settings();
    let doctor = Doctor::new(&config, instance_of(settings)?);
    let tell = |removed: &Removed| say!("{}", removed.words());
    let removed = args.clean.then(|| doctor.clean(tell)).transpose()?;
    if removed.as_ref().is_some_and(Vec::is_empty) {
        say!("nothing to remove: no leftovers of dead instances");
    }
    say!(
        "{} Hz, a period of {} µs, settings {}; measuring wake-ups for {} s\n",
        settings.control_loop.rate_hz,
        settings.period_ns() / 1000,
        config.name(),
        seconds
    );
    let mut report = doctor.examine(seconds, !args.no_rights, &|| interrupt.is_set())?;
    report.removed = removed;
    for line in report.lines() {
        say!("{line}");
    }
    args.json.write(&report)?;
    if report.verdict == Fitness::Fit {
        return Ok(());
    }
    let what = format!("this machine is unfit for {} Hz: {}", report.rate_hz, report.bad());
    Err(Failure::new(Cause::Unfit, what, "apply the remedy below each finding, then run again"))
}

/// Examines the controller at `host`, listening to it for `seconds`.
fn of_robot(
    host: &str,
    config: &Config,
    seconds: f64,
    interrupt: &Interrupt,
    json: &JsonArgs,
) -> Result<(), Failure> {
    let addresses = addresses(host)?;
    say!("controller at {host}, settings {}; listening for {seconds} s\n", config.name());
    let lasts = Duration::from_secs_f64(seconds);
    let report = examine_robot(&addresses, host, config, lasts, &|| interrupt.is_set())?;
    for line in report.lines() {
        say!("{line}");
    }
    json.write(&report)?;
    if report.verdict == Fitness::Fit {
        return Ok(());
    }
    let what = format!("the controller at {host} is not ready: {}", report.bad());
    Err(Failure::new(Cause::Unfit, what, "do what stands beneath each, then run again"))
}

fn seconds(text: &str) -> Result<f64, String> {
    values::number(0.5..=3600.0, "a number from 0.5 to 3600")(text)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn seconds_out_of_range_are_refused_with_the_range() {
        assert_eq!(seconds("2.5"), Ok(2.5));
        for text in ["0", "-1", "nan", "inf", "1e9", "x", ""] {
            assert!(seconds(text).unwrap_err().contains("0.5 to 3600"), "{text}");
        }
    }
}
