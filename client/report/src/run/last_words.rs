//! The last lines of a process of a run, and what they say of a stop.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use foretrace_client::wire::{FaultReason, StopDetail};

use crate::stopped::STARVED;

const TAIL_LINES: usize = 20;
/// What an arm says of a pause of its own comes within this time of the stop \[ns\].
const SAME_NS: u64 = 2_000_000_000;

/// The last lines of a process on stderr, and when they came on the monotonic clock \[ns\].
#[derive(Debug, Clone, Default)]
pub struct LastWords(Arc<Mutex<VecDeque<(u64, String)>>>);

impl LastWords {
    fn lines(&self) -> MutexGuard<'_, VecDeque<(u64, String)>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub fn push(&self, at_ns: u64, line: String) {
        let mut lines = self.lines();
        if lines.len() >= TAIL_LINES {
            lines.pop_front();
        }
        lines.push_back((at_ns, line));
    }

    pub fn texts(&self) -> Vec<String> {
        self.lines().iter().map(|(_, line)| line.clone()).collect()
    }

    /// What a simulated arm said of its own want of CPU when this stop latched for want of its joint state.
    pub fn starved(&self, fault: FaultReason, stop: &StopDetail) -> Option<String> {
        if fault != FaultReason::JointStateStale {
            return None;
        }
        let lines = self.lines();
        let mut then = lines.iter().rev().filter(|(came_ns, _)| came_ns.abs_diff(stop.at_ns) <= SAME_NS);
        then.find_map(|(_, line)| Some(line.get(line.find(STARVED)?..)?.to_owned()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stopped::starved;

    #[test]
    fn an_arm_that_got_no_cpu_says_so_for_the_stop_at_that_time_only() {
        let words = LastWords::default();
        let at = |at_ns| StopDetail { at_ns, ..StopDetail::NONE };
        assert_eq!(words.starved(FaultReason::JointStateStale, &at(0)), None);
        words.push(10_000_000_000, format!("foretrace: arm: {}", starved(83_000_000)));
        words.push(10_100_000_000, "arm: something else".to_owned());
        let said = words.starved(FaultReason::JointStateStale, &at(9_950_000_000)).unwrap();
        assert!(said.starts_with(STARVED) && said.ends_with(" 83 ms"), "{said}");
        assert_eq!(words.starved(FaultReason::JointStateStale, &at(60_000_000_000)), None);
        assert_eq!(words.starved(FaultReason::TrackingError, &at(9_950_000_000)), None);
        (0..TAIL_LINES).for_each(|_| words.push(11_000_000_000, String::new()));
        assert_eq!(words.starved(FaultReason::JointStateStale, &at(9_950_000_000)), None, "forgotten");
    }
}
