//! Whether a machine is fit for the loop at its rate, or a robot's controller ready for the bridge, and what
//! to do where it is not.
//!
//! Contract: read-only but for [`Doctor::clean`], which removes what dead instances left. Every finding that
//! is not ok says what to do. The verdict is unfit when one finding is bad; warnings do not decide.
//!
//! In order: `machine` (files of the kernel), `finding`, then one module per subject: `kernel`, `rights`,
//! `cpu`, `load`, `memory`, `leftovers`, `rehearsal`, `torque`; `robot` is the other question.

#![forbid(unsafe_code)]

pub mod bounded;
mod machine;
mod finding;
mod kernel;
mod rights;
mod cpu;
mod load;
mod memory;
mod leftovers;
mod rehearsal;
mod torque;
mod robot;

use foretrace_client::Instance;
use foretrace_config::{Config, Settings};
use foretrace_failure::Failure;
use serde::Serialize;

use finding::Need;
pub use finding::{CheckResult, Level};
use leftovers::CleanScope;
pub use leftovers::Removed;
use load::Snapshot;
use machine::KernelFiles;
pub use rehearsal::Lateness;
use rehearsal::{RehearsalResult, Restraint};
pub use robot::{RobotReport, examine_robot};

/// Whether everything that decides is as it should be.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Fitness {
    /// No finding is bad.
    Fit,
    Unfit,
}

/// The result; keys are stable.
#[derive(Debug, Serialize)]
pub struct Report {
    pub verdict: Fitness,
    pub rate_hz: u32,
    /// Between two ticks \[us\].
    pub period_us: u64,
    /// How long wake-ups were measured.
    pub seconds: f64,
    pub settings: String,
    pub checks: Vec<CheckResult>,
    /// How late the ticks began \[us\].
    pub lateness_us: Lateness,
    /// By [`Doctor::clean`] before; none without it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub removed: Option<Vec<Removed>>,
}

impl Report {
    /// One line per check, then the verdict.
    pub fn lines(&self) -> Vec<String> {
        table(self)
    }

    /// The names of all bad findings.
    pub fn bad(&self) -> String {
        names(&self.checks, Level::Bad)
    }
}

/// Looks at this machine for the loop of some settings.
#[derive(Debug)]
pub struct Doctor<'a> {
    config: &'a Config,
    own: Instance,
    instances: Vec<Instance>,
    scope: CleanScope,
}

impl<'a> Doctor<'a> {
    /// For the loop of `config`, whose instance is `own`.
    pub fn new(config: &'a Config, own: Instance) -> Self {
        let instances = leftovers::in_sight(&own);
        let scope = CleanScope::new(&own, &instances, config.settings().instance.root_dir.is_some());
        Self { config, own, instances, scope }
    }

    /// Removes what dead instances of this user left behind; `tell` hears of each at once: a later one may
    /// fail.
    ///
    /// # Errors
    ///
    /// `Failed`: an instance cannot be cleaned.
    pub fn clean(&self, tell: impl FnMut(&Removed)) -> Result<Vec<Removed>, Failure> {
        leftovers::clean(&self.scope, tell)
    }

    /// Looks at everything, and measures wake-ups for `seconds`, with real-time rights only where
    /// `with_rights` says so.
    ///
    /// # Errors
    ///
    /// `Interrupted`, as soon as `interrupted` says so; `Failed`.
    pub fn examine(
        &self,
        seconds: f64,
        with_rights: bool,
        interrupted: &dyn Fn() -> bool,
    ) -> Result<Report, Failure> {
        let Self { config, own, instances, scope } = self;
        let settings = config.settings();
        let need = need(settings);
        let daemon = leftovers::daemon(instances).map(|(number, pid)| Restraint::Daemon(number, pid));
        let restraint = daemon.or((!with_rights).then_some(Restraint::Asked));
        let machine = KernelFiles::here();
        let before = Snapshot::take(&machine);
        let shown = rehearsal::run(settings, restraint.as_ref(), seconds, interrupted)?;
        let after = Snapshot::take(&machine);

        let RehearsalResult { lateness, missing } = shown;
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
            memory::shared(&machine, own),
            leftovers::judge(&machine, scope),
            rehearsal::thread(&need, restraint.as_ref(), &missing),
            rehearsal::lateness(&need, &lateness, matches!(restraint, Some(Restraint::Daemon(..)))),
            rehearsal::law(config)?,
            torque::judge(config),
        ];
        Ok(Report {
            verdict: verdict(&checks),
            rate_hz: need.rate_hz,
            period_us: need.period_us,
            seconds,
            settings: config.name().to_owned(),
            checks,
            lateness_us: lateness,
            removed: None,
        })
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

fn verdict(checks: &[CheckResult]) -> Fitness {
    if checks.iter().any(|check| check.level == Level::Bad) { Fitness::Unfit } else { Fitness::Fit }
}

fn names(checks: &[CheckResult], level: Level) -> String {
    let names: Vec<&str> =
        checks.iter().filter(|check| check.level == level).map(|check| check.name).collect();
    names.join(", ")
}

/// One line per check, its fix beneath where there is one.
fn lines(checks: &[CheckResult]) -> Vec<String> {
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
fn table(report: &Report) -> Vec<String> {
    let mut lines = lines(&report.checks);
    lines.push(String::new());
    lines.push(match report.verdict {
        Fitness::Fit => {
            let besides = |what: &str, level| match names(&report.checks, level).as_str() {
                "" => String::new(),
                these => format!("; {what}: {these}"),
            };
            let better = besides("could be better", Level::Warning);
            format!("fit for {} Hz{better}{}", report.rate_hz, besides("not tried", Level::Skipped))
        }
        Fitness::Unfit => format!("UNFIT for {} Hz: {}", report.rate_hz, names(&report.checks, Level::Bad)),
    });
    lines
}

#[cfg(test)]
mod tests {
    use super::*;
    use foretrace_sim::spread::Quantiles;

    fn report(checks: Vec<CheckResult>) -> Report {
        let lateness_us = Lateness {
            ticks: 1,
            missed: 0,
            quantiles: Quantiles::default(),
            histogram: Vec::new(),
            page_faults: 0,
        };
        Report {
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
            (CheckResult::ok("clock", "tsc"), CheckResult::warning("governor", "powersave", "do this"));
        assert_eq!(report(vec![good.clone(), poor.clone()]).verdict, Fitness::Fit);
        assert_eq!(
            report(vec![good, CheckResult::bad("kernel", "none", "do that"), poor]).verdict,
            Fitness::Unfit
        );
    }

    #[test]
    fn every_check_is_one_aligned_line_with_its_fix_beneath() {
        let lines = table(&report(vec![
            CheckResult::ok("clock", "tsc"),
            CheckResult::bad("governor", "slow", "do this"),
        ]));
        assert_eq!(lines[0], "ok       clock     tsc");
        assert_eq!(lines[1], "BAD      governor  slow");
        assert_eq!(lines[2].trim(), "-> do this");
        assert_eq!(lines[4], "UNFIT for 500 Hz: governor");
    }

    #[test]
    fn keys_of_the_report_are_those_that_were_promised() {
        let json =
            serde_json::to_value(report(vec![CheckResult::bad("governor", "slow", "do this")])).unwrap();
        assert_eq!(json["verdict"], "unfit");
        let check = serde_json::json!({"name": "governor", "ok": false, "level": "bad", "value": "slow",
            "fix": "do this"});
        assert_eq!(json["checks"], serde_json::json!([check]));
        assert!(json["lateness_us"]["p99_9"].is_number() && json.get("removed").is_none());
    }
}
