//! Which commands the simulated arm refused, how many of each kind, and what the newest one was refused for.

use std::fmt;

use foretrace_shm::Rejection;
use serde::Serialize;

use foretrace_report::Tell;

/// A controller ignores targets that need more than this within one cycle \[rad/s\].
pub(crate) const JUMP_RADPS: f64 = 20.0;

/// Why one command was refused.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum CommandRefusal {
    /// Foreign boot, replayed, out of order, or stamped in the future.
    Header(Rejection),
    /// Numbers or flags that make no sense.
    Malformed(Rejection),
    /// Its validity had ended this long before the cycle that it came for \[s\].
    Stale { late_s: f64 },
    /// Too far from where the joint is wanted \[rad\].
    Jump { joint: usize, away: f64, reach: f64 },
}

impl fmt::Display for CommandRefusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Header(rejection) | Self::Malformed(rejection) => write!(f, "{rejection}"),
            Self::Stale { late_s } => write!(
                f,
                "its validity had ended {:.1} ms before its cycle: this process or the daemon got no \
                 processor for that long",
                late_s * 1e3
            ),
            Self::Jump { joint, away, reach } => write!(
                f,
                "joint {joint} is commanded {away:.4} rad away from its target, more than {reach:.4} \
                 rad, which is {JUMP_RADPS} rad/s for a cycle"
            ),
        }
    }
}

/// Commands refused, by reason.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct RefusedCommands {
    /// Foreign boot, replayed, out of order, or stamped in the future.
    pub header: u64,
    /// Numbers or flags that make no sense.
    pub malformed: u64,
    /// No longer valid on arrival.
    pub stale: u64,
    /// Too far from the present target.
    pub jump: u64,
    #[serde(skip)]
    newest: Option<CommandRefusal>,
}

impl RefusedCommands {
    pub(crate) fn note(&mut self, refusal: CommandRefusal) {
        let count = match refusal {
            CommandRefusal::Header(_) => &mut self.header,
            CommandRefusal::Malformed(_) => &mut self.malformed,
            CommandRefusal::Stale { .. } => &mut self.stale,
            CommandRefusal::Jump { .. } => &mut self.jump,
        };
        *count += 1;
        self.newest = Some(refusal);
    }

    /// Adds what the client library refused, which never came to the intake.
    pub(crate) fn with(mut self, count: u64, newest: Option<Rejection>) -> Self {
        self.header += count;
        self.newest = self.newest.or(newest.map(CommandRefusal::Header));
        self
    }

    pub(crate) fn total(&self) -> u64 {
        self.header + self.malformed + self.stale + self.jump
    }
}

/// `3 of another boot, replayed or out of order, 2 stale; newest: …`; without any, nothing.
impl fmt::Display for RefusedCommands {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let kinds = [
            (self.header, "with a foreign, replayed or future stamp"),
            (self.malformed, "malformed"),
            (self.stale, "past their validity"),
            (self.jump, "too far away"),
        ];
        let reasons: Vec<_> = kinds
            .iter()
            .filter(|(count, _)| *count > 0)
            .map(|(count, kind)| format!("{count} {kind}"))
            .collect();
        f.write_str(&reasons.join(", "))?;
        match self.newest {
            Some(newest) => write!(f, "; newest: {newest}"),
            None => Ok(()),
        }
    }
}

/// Reports refused commands: the first at once, then counts, at most every ten seconds.
#[derive(Debug, Default)]
pub(crate) struct RefusalReporter {
    reported: u64,
    reported_at_ns: Option<u64>,
}

impl RefusalReporter {
    const EVERY_NS: u64 = 10_000_000_000;

    pub(crate) fn look(&mut self, refused: &RefusedCommands, now_ns: u64, tell: Tell<'_>) {
        let total = refused.total();
        let soon = self.reported_at_ns.is_some_and(|at_ns| now_ns < at_ns + Self::EVERY_NS);
        if total > self.reported && !soon {
            tell(&format!("arm: {} commands refused since: {refused}", total - self.reported));
            (self.reported, self.reported_at_ns) = (total, Some(now_ns));
        }
    }
}
