//! The newest joint states, for the measured speed of the joints: the speed that an arm reports may be wrong.

use crate::state::state;
use crate::units::Stamp;

/// Joint states kept: 80 ms at 1 kHz.
const KEPT: usize = 96;

/// A ring of joint states.
#[derive(Debug, Clone)]
pub(super) struct Recent<const J: usize> {
    ring: [(Stamp, [f64; J]); KEPT],
    count: usize,
}

state! { [const J: usize] Recent<J> { ring, count } }

impl<const J: usize> Recent<J> {
    pub(super) const fn new() -> Self {
        Self { ring: [(Stamp(0), [0.0; J]); KEPT], count: 0 }
    }

    pub(super) fn push(&mut self, stamp: Stamp, q: &[f64; J]) {
        if let Some(slot) = self.ring.get_mut(self.count % KEPT) {
            *slot = (stamp, *q);
        }
        self.count = self.count.wrapping_add(1);
    }

    pub(super) fn newest(&self) -> Option<Stamp> {
        self.back(0).map(|(stamp, _)| *stamp)
    }

    pub(super) fn last(&self) -> Option<&[f64; J]> {
        self.back(0).map(|(_, q)| q)
    }

    /// Mean speeds up to now, over the shortest known time of at least `over_ns` \[rad/s\].
    pub(super) fn speed(&self, over_ns: u64) -> Option<[f64; J]> {
        let (now, here) = self.back(0)?;
        let before = |(stamp, _): &&(Stamp, [f64; J])| now.0.saturating_sub(stamp.0) >= over_ns;
        let (then, there) = (1..KEPT).map_while(|age| self.back(age)).find(before)?;
        let elapsed_s = now.seconds_since(*then);
        let mut speed = *here;
        for (speed, there) in speed.iter_mut().zip(there) {
            *speed = (*speed - there) / elapsed_s;
        }
        Some(speed)
    }

    /// The joint state `age` states before the newest.
    fn back(&self, age: usize) -> Option<&(Stamp, [f64; J])> {
        let index = self.count.checked_sub(age + 1)?;
        if age < KEPT { self.ring.get(index % KEPT) } else { None }
    }
}
