//! What came through the gateway and what did not, by reason.

use std::collections::BTreeMap;
use std::fmt::{self, Display};

use serde::Serialize;

/// Counts by reason. The reasons are words of this program, so there are few.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize)]
#[serde(transparent)]
pub struct RefusalCounts(BTreeMap<&'static str, u64>);

impl RefusalCounts {
    pub fn count(&mut self, reason: &'static str) {
        let counter = self.0.entry(reason).or_default();
        *counter = counter.saturating_add(1);
    }

    #[cfg(test)]
    pub fn of(&self, reason: &str) -> u64 {
        self.0.get(reason).copied().unwrap_or(0)
    }

    pub fn total(&self) -> u64 {
        self.0.values().fold(0, |sum, count| sum.saturating_add(*count))
    }
}

impl Display for RefusalCounts {
    /// Nothing, or ` (reason count, reason count)`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (index, (reason, count)) in self.0.iter().enumerate() {
            write!(f, "{}{reason} {count}", if index == 0 { " (" } else { ", " })?;
        }
        f.write_str(if self.0.is_empty() { "" } else { ")" })
    }
}

/// Samples by what became of them.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize)]
pub struct Samples {
    /// Passed on to the loop.
    pub passed: u64,
    /// Passed on, but no daemon listened.
    pub unheard: u64,
    /// Sane, but the shared memory did not take them.
    pub failed: u64,
    /// Refused, by reason.
    pub refused: RefusalCounts,
}

impl Display for Samples {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} samples passed on", self.passed)?;
        if self.unheard > 0 {
            write!(f, ", {} of them unheard", self.unheard)?;
        }
        if self.failed > 0 {
            write!(f, ", {} failed", self.failed)?;
        }
        write!(f, ", {} refused{}", self.refused.total(), self.refused)
    }
}

/// Everything since the gateway opened; keys are stable.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize)]
pub struct GatewayTally {
    pub clients: u64,
    /// Clients turned away, by reason.
    pub turned_away: RefusalCounts,
    /// Ends of connections, by reason.
    pub ended: RefusalCounts,
    /// Samples of all clients.
    pub samples: Samples,
}

impl Display for GatewayTally {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { clients, turned_away, ended, samples } = self;
        write!(f, "{clients} clients let in, {} turned away{turned_away}", turned_away.total())?;
        write!(f, ", {} ended{ended}; {samples}", ended.total())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_line_tells_every_count_with_its_reason_and_nothing_that_is_zero() {
        let mut tally = GatewayTally { clients: 2, ..GatewayTally::default() };
        assert_eq!(
            tally.to_string(),
            "2 clients let in, 0 turned away, 0 ended; 0 samples passed on, 0 refused"
        );
        tally.turned_away.count("user not allowed");
        tally.samples.passed = 7;
        tally.samples.unheard = 1;
        tally.samples.refused.count("too old");
        tally.samples.refused.count("not finite");
        tally.samples.refused.count("too old");
        assert_eq!(
            tally.to_string(),
            "2 clients let in, 1 turned away (user not allowed 1), 0 ended; 7 samples passed on, 1 of them \
             unheard, \
             3 refused (not finite 1, too old 2)"
        );
    }
}
