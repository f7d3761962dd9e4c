//! `foretrace doctor --robot HOST`: whether a Universal Robots controller is ready for the bridge.
//!
//! Contract: moves nothing, starts no program, changes no output; the registers that it tries belong to the
//! bridge anyway.

use std::time::Duration;

use foretrace_config::Config;
use foretrace_ur::bridge::examine::{self, Grade, Timing};
use foretrace_ur::bridge::kinematics::Deviation;
use serde::Serialize;

use super::finding::{Finding, Level};
use super::{Verdict, lines, names, verdict};
use crate::failure::{Cause, Failure};
use crate::interrupt::Interrupt;
use crate::output::{JsonArgs, say};
use crate::robot::addresses;

/// The result; keys are stable.
#[derive(Debug, Serialize)]
struct RobotReport {
    verdict: Verdict,
    host: String,
    settings: String,
    checks: Vec<Finding>,
    /// What was measured on the line; none where nothing came.
    timing: Option<Timing>,
    /// How far the tip is from where the settings' model believes it.
    deviation: Option<Deviation>,
}

/// Examines the controller at `host`, listening to it for `seconds`.
pub(super) fn run(host: &str, config: &Config, seconds: f64, json: &JsonArgs) -> Result<(), Failure> {
    let interrupt = Interrupt::listen()?;
    let addresses = addresses(host)?;
    say!("controller at {host}, settings {}; listening for {seconds} s\n", config.name());
    let facts = examine::gather(&addresses, config, Duration::from_secs_f64(seconds), &|| interrupt.is_set());
    interrupt.check()?;
    let findings = examine::judge(&facts, config.settings(), config.robot().limits.position());
    let checks: Vec<Finding> = findings.into_iter().map(Finding::from).collect();
    let report = RobotReport {
        verdict: verdict(&checks),
        host: host.to_owned(),
        settings: config.name().to_owned(),
        checks,
        timing: facts.timing,
        deviation: facts.deviation,
    };
    for line in lines(&report.checks) {
        say!("{line}");
    }
    let bad = names(&report.checks, Level::Bad);
    say!(
        "\n{}",
        if bad.is_empty() { "ready for `foretrace arm ur`".to_owned() } else { format!("NOT READY: {bad}") }
    );
    json.write(&report)?;
    match report.verdict {
        Verdict::Fit => Ok(()),
        Verdict::Unfit => {
            let what = format!("the controller at {host} is not ready: {bad}");
            Err(Failure::new(Cause::Unfit, what, "do what stands beneath each, then run again"))
        }
    }
}

impl From<examine::Finding> for Finding {
    fn from(found: examine::Finding) -> Self {
        let level = match found.grade {
            Grade::Good => Level::Ok,
            Grade::Fair => Level::Warning,
            Grade::Bad => Level::Bad,
        };
        Self { name: found.name, ok: level == Level::Ok, level, value: found.value, fix: found.fix }
    }
}
