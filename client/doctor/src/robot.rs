//! Whether a Universal Robots controller is ready for the bridge.
//!
//! Contract: moves nothing, starts no program, changes no output; the registers that it tries belong to the
//! bridge anyway.

use std::time::Duration;

use foretrace_config::Config;
use foretrace_failure::Failure;
use foretrace_ur::bridge::address::Addresses;
use foretrace_ur::bridge::examine::{self, Grade, Timing};
use foretrace_ur::bridge::kinematics::Deviation;
use serde::Serialize;

use crate::finding::{CheckResult, Level};
use crate::{Fitness, lines, names, verdict};

/// The result; keys are stable.
#[derive(Debug, Serialize)]
pub struct RobotReport {
    pub verdict: Fitness,
    /// Name or address of the controller.
    pub host: String,
    pub settings: String,
    pub checks: Vec<CheckResult>,
    /// What was measured on the line; none where nothing came.
    pub timing: Option<Timing>,
    /// How far the tip is from where the settings' model believes it.
    pub deviation: Option<Deviation>,
}

impl RobotReport {
    /// One line per check, then the verdict.
    pub fn lines(&self) -> Vec<String> {
        let verdict = match self.verdict {
            Fitness::Fit => "\nready for `foretrace arm ur`".to_owned(),
            Fitness::Unfit => format!("\nNOT READY: {}", self.bad()),
        };
        lines(&self.checks).into_iter().chain([verdict]).collect()
    }

    /// The names of all bad findings.
    pub fn bad(&self) -> String {
        names(&self.checks, Level::Bad)
    }
}

/// Examines the controller `host` at `addresses`, listening to it for `lasts`.
///
/// # Errors
///
/// `Interrupted`, as soon as `interrupted` says so.
pub fn examine_robot(
    addresses: &Addresses,
    host: &str,
    config: &Config,
    lasts: Duration,
    interrupted: &dyn Fn() -> bool,
) -> Result<RobotReport, Failure> {
    let facts = examine::gather(addresses, config, lasts, &interrupted);
    if interrupted() {
        return Err(Failure::interrupted("interrupted", ""));
    }
    let findings = examine::judge(&facts, config);
    let checks: Vec<CheckResult> = findings.into_iter().map(CheckResult::from).collect();
    Ok(RobotReport {
        verdict: verdict(&checks),
        host: host.to_owned(),
        settings: config.name().to_owned(),
        checks,
        timing: facts.timing,
        deviation: facts.deviation,
    })
}

impl From<examine::Finding> for CheckResult {
    fn from(found: examine::Finding) -> Self {
        let level = match found.grade {
            Grade::Good => Level::Ok,
            Grade::Fair => Level::Warning,
            Grade::Bad => Level::Bad,
        };
        Self { name: found.name, ok: level == Level::Ok, level, value: found.value, fix: found.fix }
    }
}
