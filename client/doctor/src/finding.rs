//! One finding about the machine: what was found, whether that is good enough, and what to do if not.

use serde::Serialize;

use crate::machine::Silent;

/// How good it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Level {
    /// As it should be.
    Ok,
    /// Not tried, for a reason that is given; does not decide.
    Skipped,
    /// Could be better, or could not be seen; does not decide.
    Warning,
    /// The loop cannot be trusted at this rate: makes the machine unfit.
    Bad,
}

/// One line of the report; keys are stable.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct CheckResult {
    pub name: &'static str,
    /// Nothing to do: `level` is `ok`.
    pub ok: bool,
    pub level: Level,
    pub value: String,
    /// What to do about it; empty only where `ok`.
    pub fix: String,
}

impl CheckResult {
    pub(crate) fn ok(name: &'static str, value: impl Into<String>) -> Self {
        Self { name, ok: true, level: Level::Ok, value: value.into(), fix: String::new() }
    }

    pub(crate) fn skipped(name: &'static str, value: impl Into<String>, fix: impl Into<String>) -> Self {
        Self { name, ok: false, level: Level::Skipped, value: value.into(), fix: fix.into() }
    }

    pub(crate) fn warning(name: &'static str, value: impl Into<String>, fix: impl Into<String>) -> Self {
        Self { name, ok: false, level: Level::Warning, value: value.into(), fix: fix.into() }
    }

    pub(crate) fn bad(name: &'static str, value: impl Into<String>, fix: impl Into<String>) -> Self {
        Self { name, ok: false, level: Level::Bad, value: value.into(), fix: fix.into() }
    }

    /// What a file that says nothing means, where it ought to say something.
    pub(crate) fn unseen(name: &'static str, path: &str, silent: Silent) -> Self {
        let value = match silent {
            Silent::Missing => format!("not known: there is no /{path}"),
            Silent::Wrong(what) => format!("not known: {what}"),
        };
        Self::warning(name, value, format!("look at /{path} by hand, or run where /proc and /sys are whole"))
    }
}

/// What the settings ask of the machine.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Need {
    /// Ticks per second.
    pub(crate) rate_hz: u32,
    /// Between two ticks \[µs\].
    pub(crate) period_us: u64,
    /// Spun before a tick \[µs\].
    pub(crate) spin_us: u64,
    /// SCHED_FIFO.
    pub(crate) priority: u32,
    /// Where the loop stays.
    pub(crate) cpu: Option<u32>,
    /// Memory is to be locked.
    pub(crate) lock_memory: bool,
}

#[cfg(test)]
impl Need {
    pub(crate) const USUAL: Self =
        Self { rate_hz: 500, period_us: 2000, spin_us: 50, priority: 80, cpu: None, lock_memory: true };
}
