//! What a replay came to, in words: the same for the command and for whoever calls the library.

use std::fmt;

use crate::replay::{Difference, ReplayEnd, ReplayOutcome, ReplayStart};

/// Why a replay does not show that the law did the same, and what to do.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Unequal {
    pub what: String,
    pub remedy: &'static str,
}

impl fmt::Display for Unequal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}; {}", self.what, self.remedy)
    }
}

impl ReplayOutcome {
    /// How much was run again, from where to where.
    #[must_use]
    pub fn summary(&self) -> String {
        let from = match self.start {
            ReplayStart::FirstTick => "the first tick",
            ReplayStart::State => "a state",
        };
        let end = match &self.end {
            ReplayEnd::OfRecording => "the end of the recording".to_owned(),
            ReplayEnd::Gap { next } => format!("a gap: tick {next} is the next one there"),
            ReplayEnd::Incomplete => "a tick whose pen samples are missing".to_owned(),
            ReplayEnd::NoPreview { tick } => {
                format!("tick {tick}, whose preview of another process is missing")
            }
            ReplayEnd::NoWeights { version } => {
                format!("a tick that was offered weights {version}, which are missing")
            }
            ReplayEnd::OtherDaemon => "where another daemon took over".to_owned(),
            ReplayEnd::Damaged { .. } => "where the file is damaged".to_owned(),
        };
        let (ticks, seconds, first) = (self.ticks, self.seconds, self.first_tick);
        format!("{ticks} ticks ({seconds:.1} s) from tick {first}, {from}, to {end}")
    }

    /// That every command is the same.
    ///
    /// # Errors
    ///
    /// Anything differs, or nothing was compared although the file is whole.
    pub fn verdict(&self) -> Result<&'static str, Unequal> {
        let Some(Difference { tick, field, recorded, replayed }) = &self.difference else {
            return match (self.ticks, &self.damage) {
                // The damage is told instead.
                (0, Some(_)) => Ok(""),
                (0, None) => {
                    let what = "no tick could be run again".to_owned();
                    Err(Unequal { what, remedy: "record for a second at least" })
                }
                _ => Ok("every command is the same, bit for bit"),
            };
        };
        let what = format!(
            "tick {tick} differs first: {field} was {recorded}, is {replayed}; {} of {} ticks differ, joints by \
             up to {:.3e} rad",
            self.different_ticks, self.ticks, self.largest_rad
        );
        let remedy = match self.same_build {
            Some(true) => {
                "the law has the same build: on the same kind of processor this is a fault, please report it \
                 with the recording"
            }
            Some(false) => "the daemon's law had another build: replay with the program of that daemon",
            None => "the build of the daemon's law is unknown: replay with the program of that daemon",
        };
        Err(Unequal { what, remedy })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn outcome() -> ReplayOutcome {
        ReplayOutcome {
            start: ReplayStart::State,
            first_tick: 7,
            ticks: 5,
            seconds: 0.01,
            end: ReplayEnd::Gap { next: 20 },
            damage: None,
            gone: Vec::new(),
            difference: None,
            different_ticks: 0,
            largest_rad: 0.0,
            recorded_build: None,
            same_build: None,
        }
    }

    #[test]
    fn a_replay_says_from_where_to_where_and_what_differs_first() {
        let same = outcome();
        assert_eq!(
            same.summary(),
            "5 ticks (0.0 s) from tick 7, a state, to a gap: tick 20 is the next one there"
        );
        assert_eq!(same.verdict(), Ok("every command is the same, bit for bit"));
        let text = |value: &str| value.to_owned();
        let difference =
            Difference { tick: 9, field: text("q[0]"), recorded: text("0.5"), replayed: text("0.6") };
        let other = ReplayOutcome { difference: Some(difference), different_ticks: 2, ..outcome() };
        let said = other.verdict().unwrap_err().to_string();
        assert!(
            said.starts_with("tick 9 differs first: q[0] was 0.5, is 0.6; 2 of 5 ticks differ"),
            "{said}"
        );
        assert!(said.ends_with("replay with the program of that daemon"), "{said}");
    }

    #[test]
    fn a_replay_of_nothing_is_no_success_and_damage_is_told_by_itself() {
        let nothing = ReplayOutcome { ticks: 0, ..outcome() };
        assert_eq!(nothing.verdict().unwrap_err().what, "no tick could be run again");
        let damaged = ReplayOutcome { damage: Some("at byte 9".to_owned()), ..nothing };
        assert_eq!(damaged.verdict(), Ok(""));
    }
}
