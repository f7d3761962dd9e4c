//! `foretrace doctor`: whether this machine is fit for the loop at its rate, and what to do where it is not.
//!
//! Contract: read-only but for `--clean`, which removes what dead instances left. Every finding that is not
//! ok says what to do. The verdict is unfit when one finding is bad; warnings do not decide.

mod machine;
mod finding;
mod kernel;
mod rights;
mod cpu;
mod load;
mod memory;
mod leftovers;
mod rehearsal;
mod robot;
mod torque;

use foretrace_config::Settings;
use serde::Serialize;

use crate::attach::instance_of;
use crate::failure::{Cause, Failure};
use crate::interrupt::Interrupt;
use crate::output::{JsonArgs, say};
use crate::settings::{SettingsArgs, judged};
use finding::{Finding, Level, Need};
use leftovers::{Removed, Scope};
use load::Snapshot;
use machine::Machine;
use rehearsal::{Lateness, Restraint, Shown};

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

#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
enum Verdict {
    Fit,
    Unfit,
}

/// The result; keys are stable.
#[derive(Debug, Serialize)]
struct DoctorReport {
    verdict: Verdict,
    rate_hz: u32,
    period_us: u64,
    seconds: f64,
    settings: String,
    checks: Vec<Finding>,
    /// How late the ticks began [us].
    lateness_us: Lateness,
    /// With `--clean` only.
    #[serde(skip_serializing_if = "Option::is_none")]
    removed: Option<Vec<Removed>>,
}

pub(crate) fn run(args: &DoctorArgs) -> Result<(), Failure> {
    args.json.claim()?;
    let mut source = args.settings.source()?;
    source.rate_hz = args.rate;
    let config = judged(&source)?;
    if let Some(host) = &args.robot {
        return robot::run(host, &config, args.seconds.unwrap_or(10.0), &args.json);
    }
    let seconds = args.seconds.unwrap_or(5.0);
    let settings = config.settings();
    let own = instance_of(settings)?;
    let interrupt = Interrupt::listen()?;

    let instances = leftovers::in_sight(&own);
    let scope = Scope::new(&own, &instances, settings.instance.root_dir.is_some());
    let tell = |removed: &leftovers::Removed| say!("{}", removed.told());
    let removed = args.clean.then(|| leftovers::clean(&scope, tell)).transpose()?;
    if removed.as_ref().is_some_and(Vec::is_empty) {
        say!("nothing to remove: no leftovers of dead instances");
    }

    let need = need(settings);
    let daemon = leftovers::daemon(&instances).map(|(number, pid)| Restraint::Daemon(number, pid));
    let restraint = daemon.or(args.no_rights.then_some(Restraint::Asked));
    say!(
        "{} Hz, a period of {} µs, settings {}; measuring wake-ups for {} s\n",
        need.rate_hz,
        need.period_us,
        config.name(),
        seconds
    );
    let machine = Machine::here();
    let before = Snapshot::take(&machine);
    let shown = rehearsal::run(settings, restraint.as_ref(), seconds, &interrupt)?;
    let after = Snapshot::take(&machine);

    let Shown { lateness, missing } = shown;
    let checks = vec![
        kernel::preemption(&machine),
        kernel::throttling(&machine, &need),
        kernel::clock(&machine),
        rights::priority(&machine, &need),
        rights::memory(&machine, &need, &missing),
        cpu::governor(&machine, &need),
        cpu::idle(&machine, &need),
        cpu::isolation(&machine, &need),
        load::irqs(&machine, &need, &before, &after, seconds),
        load::steal(&machine, &need, &before, &after),
        memory::shared(&machine, &own),
        leftovers::judge(&machine, &scope),
        rehearsal::thread(&need, restraint.as_ref(), &missing),
        rehearsal::lateness(&need, &lateness, matches!(restraint, Some(Restraint::Daemon(..)))),
        rehearsal::law(&config)?,
        torque::judge(&config),
    ];
    let report = DoctorReport {
        verdict: verdict(&checks),
        rate_hz: need.rate_hz,
        period_us: need.period_us,
        seconds,
        settings: config.name().to_owned(),
        checks,
        lateness_us: lateness,
        removed,
    };
    for line in table(&report) {
        say!("{line}");
    }
    args.json.write(&report)?;
    match report.verdict {
        Verdict::Fit => Ok(()),
        Verdict::Unfit => {
            let bad = names(&report.checks, Level::Bad);
            let what = format!("this machine is unfit for {} Hz: {bad}", report.rate_hz);
            Err(Failure::new(Cause::Unfit, what, "apply the remedy below each finding, then run again"))
        }
    }
}

fn need(settings: &Settings) -> Need {
    let section = &settings.control_loop;
    Need {
        rate_hz: section.rate_hz,
        period_us: settings.period_ns() / 1000,
        spin_us: u64::from(section.spin_us),
        priority: section.priority,
        cpu: section.cpu,
        lock_memory: section.lock_memory,
    }
}

fn verdict(checks: &[Finding]) -> Verdict {
    if checks.iter().any(|check| check.level == Level::Bad) { Verdict::Unfit } else { Verdict::Fit }
}

fn names(checks: &[Finding], level: Level) -> String {
    let names: Vec<&str> =
        checks.iter().filter(|check| check.level == level).map(|check| check.name).collect();
    names.join(", ")
}

/// One line per check, its fix beneath where there is one.
fn lines(checks: &[Finding]) -> Vec<String> {
    let width = checks.iter().map(|check| check.name.len()).max().unwrap_or(0);
    let mut lines = Vec::new();
    for check in checks {
        let level = match check.level {
            Level::Ok => "ok",
            Level::Skipped => "skipped",
            Level::Warning => "warning",
            Level::Bad => "BAD",
        };
        lines.push(format!("{level:<7}  {:<width$}  {}", check.name, check.value));
        if !check.ok {
            lines.push(format!("{:7}  {:width$}  -> {}", "", "", check.fix));
        }
    }
    lines
}

/// Every check, then the verdict.
fn table(report: &DoctorReport) -> Vec<String> {
    let mut lines = lines(&report.checks);
    lines.push(String::new());
    lines.push(match report.verdict {
        Verdict::Fit => {
            let told = |what: &str, level| match names(&report.checks, level).as_str() {
                "" => String::new(),
                these => format!("; {what}: {these}"),
            };
            let better = told("could be better", Level::Warning);
            format!("fit for {} Hz{better}{}", report.rate_hz, told("not tried", Level::Skipped))
        }
        Verdict::Unfit => format!("UNFIT for {} Hz: {}", report.rate_hz, names(&report.checks, Level::Bad)),
    });
    lines
}

fn seconds(text: &str) -> Result<f64, String> {
    let seconds = text.parse().ok().filter(|seconds| (0.5..=3600.0).contains(seconds));
    seconds.ok_or_else(|| "a number from 0.5 to 3600".to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spread::Quantiles;

    fn report(checks: Vec<Finding>) -> DoctorReport {
        let lateness_us = Lateness {
            ticks: 1,
            missed: 0,
            quantiles: Quantiles::default(),
            histogram: Vec::new(),
            page_faults: 0,
        };
        DoctorReport {
            verdict: verdict(&checks),
            rate_hz: 500,
            period_us: 2000,
            seconds: 5.0,
            settings: "ur5".to_owned(),
            checks,
            lateness_us,
            removed: None,
        }
    }

    #[test]
    fn one_bad_finding_makes_the_machine_unfit_and_warnings_do_not() {
        let (good, poor) =
            (Finding::ok("clock", "tsc"), Finding::warning("governor", "powersave", "do this"));
        assert_eq!(report(vec![good.clone(), poor.clone()]).verdict, Verdict::Fit);
        assert_eq!(
            report(vec![good, Finding::bad("kernel", "none", "do that"), poor]).verdict,
            Verdict::Unfit
        );
    }

    #[test]
    fn every_check_is_one_aligned_line_with_its_fix_beneath() {
        let lines =
            table(&report(vec![Finding::ok("clock", "tsc"), Finding::bad("governor", "slow", "do this")]));
        assert_eq!(lines[0], "ok       clock     tsc");
        assert_eq!(lines[1], "BAD      governor  slow");
        assert_eq!(lines[2].trim(), "-> do this");
        assert_eq!(lines[4], "UNFIT for 500 Hz: governor");
    }

    #[test]
    fn keys_of_the_report_are_those_that_were_promised() {
        let json = serde_json::to_value(report(vec![Finding::bad("governor", "slow", "do this")])).unwrap();
        assert_eq!(json["verdict"], "unfit");
        let check = serde_json::json!({"name": "governor", "ok": false, "level": "bad", "value": "slow",
            "fix": "do this"});
        assert_eq!(json["checks"], serde_json::json!([check]));
        assert!(json["lateness_us"]["p99_9"].is_number() && json.get("removed").is_none());
    }

    #[test]
    fn seconds_out_of_range_are_refused_with_the_range() {
        assert_eq!(seconds("2.5"), Ok(2.5));
        for text in ["0", "-1", "nan", "inf", "1e9", "x", ""] {
            assert!(seconds(text).unwrap_err().contains("0.5 to 3600"), "{text}");
        }
    }
}
