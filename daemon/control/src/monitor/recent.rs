//! The newest joint states, for the measured speed of the joints: the speed that an arm reports may be wrong.

use crate::history::History;
use crate::state::state;
use crate::units::Stamp;

/// Joint states kept: 80 ms at 1 kHz.
const KEPT: usize = 96;

/// The newest joint states.
#[derive(Debug, Clone)]
pub(super) struct Recent<const J: usize> {
    states: History<(Stamp, [f64; J]), KEPT>,
}

state! { [const J: usize] Recent<J> { states } }

impl<const J: usize> Recent<J> {
    pub(super) const fn new() -> Self {
        Self { states: History::new((Stamp(0), [0.0; J])) }
    }

    pub(super) fn push(&mut self, stamp: Stamp, q: &[f64; J]) {
        self.states.push((stamp, *q));
    }

    pub(super) fn newest(&self) -> Option<Stamp> {
        self.states.back(0).map(|(stamp, _)| *stamp)
    }

    pub(super) fn last(&self) -> Option<&[f64; J]> {
        self.states.back(0).map(|(_, q)| q)
    }

    /// Mean speeds up to now, over the shortest known time of at least `over_ns` \[rad/s\].
    pub(super) fn speed(&self, over_ns: u64) -> Option<[f64; J]> {
        let (now, here) = self.states.back(0)?;
        let before = |(stamp, _): &&(Stamp, [f64; J])| now.0.saturating_sub(stamp.0) >= over_ns;
        let (then, there) = (1..KEPT as u64).map_while(|age| self.states.back(age)).find(before)?;
        let elapsed_s = now.seconds_since(*then);
        let mut speed = *here;
        for (speed, there) in speed.iter_mut().zip(there) {
            *speed = (*speed - there) / elapsed_s;
        }
        Some(speed)
    }
}
