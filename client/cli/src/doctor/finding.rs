//! One finding about the machine: what was found, whether that is good enough, and what to do if not.

use serde::Serialize;

use super::machine::Silent;

/// How good it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum Level {
    /// As it should be.
    Ok,
    /// Not tried, for a reason that is told; does not decide.
    Skipped,
    /// Could be better, or could not be seen; does not decide.
    Warning,
    /// The loop cannot be trusted at this rate: makes the machine unfit.
    Bad,
}

/// One line of the report; keys are stable.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub(super) struct Finding {
    pub(super) name: &'static str,
    /// Nothing to do: `level` is `ok`.
    pub(super) ok: bool,
    pub(super) level: Level,
    /// What was found.
    pub(super) value: String,
    /// What to do about it; empty only where `ok`.
    pub(super) fix: String,
}

impl Finding {
    pub(super) fn ok(name: &'static str, value: impl Into<String>) -> Self {
        Self { name, ok: true, level: Level::Ok, value: value.into(), fix: String::new() }
    }

    pub(super) fn skipped(name: &'static str, value: impl Into<String>, fix: impl Into<String>) -> Self {
        Self { name, ok: false, level: Level::Skipped, value: value.into(), fix: fix.into() }
    }

    pub(super) fn warning(name: &'static str, value: impl Into<String>, fix: impl Into<String>) -> Self {
        Self { name, ok: false, level: Level::Warning, value: value.into(), fix: fix.into() }
    }

    pub(super) fn bad(name: &'static str, value: impl Into<String>, fix: impl Into<String>) -> Self {
        Self { name, ok: false, level: Level::Bad, value: value.into(), fix: fix.into() }
    }

    /// What a file that says nothing means, where it ought to say something.
    pub(super) fn unseen(name: &'static str, path: &str, silent: Silent) -> Self {
        let value = match silent {
            Silent::Missing => format!("not known: there is no /{path}"),
            Silent::Wrong(what) => format!("not known: {what}"),
        };
        Self::warning(name, value, format!("look at /{path} by hand, or run where /proc and /sys are whole"))
    }
}

/// What the settings ask of the machine.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Need {
    /// Ticks per second.
    pub(super) rate_hz: u32,
    /// Between two ticks [µs].
    pub(super) period_us: u64,
    /// Spun before a tick [µs].
    pub(super) spin_us: u64,
    /// SCHED_FIFO.
    pub(super) priority: u32,
    /// Where the loop stays.
    pub(super) cpu: Option<u32>,
    /// Memory is to be locked.
    pub(super) lock_memory: bool,
}

#[cfg(test)]
impl Need {
    /// The presets'.
    pub(super) const USUAL: Self =
        Self { rate_hz: 500, period_us: 2000, spin_us: 50, priority: 80, cpu: None, lock_memory: true };
}
