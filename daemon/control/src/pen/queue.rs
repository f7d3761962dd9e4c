//! A ring of closed grid steps with a fixed capacity: when full, the oldest step is dropped and counted.

use super::{GridStep, Motion};
use crate::state::state;

/// Most closed steps that wait for the follower.
pub const STEP_QUEUE_CAPACITY: usize = 64;

#[derive(Debug, Clone, Copy)]
pub(super) struct StepQueue {
    slots: [GridStep; STEP_QUEUE_CAPACITY],
    head: usize,
    len: usize,
}

state! { [] StepQueue { slots, head, len } }

impl StepQueue {
    pub(super) fn new() -> Self {
        Self { slots: [GridStep::default(); STEP_QUEUE_CAPACITY], head: 0, len: 0 }
    }

    /// Appends; returns how many steps (0 or 1) were lost to make room.
    pub(super) fn push(&mut self, step: GridStep) -> u64 {
        let lost = u64::from(self.len == STEP_QUEUE_CAPACITY);
        if lost == 1 {
            self.pop();
            // The step after a lost one has no known predecessor.
            if let Some(oldest) = self.slots.get_mut(self.head)
                && oldest.motion == Motion::Continues
            {
                oldest.motion = Motion::Start;
                (oldest.displacement, oldest.half) = ([0.0; 2], [0.0; 2]);
            }
        }
        if let Some(slot) = self.slots.get_mut((self.head + self.len) % STEP_QUEUE_CAPACITY) {
            *slot = step;
            self.len += 1;
        }
        lost
    }

    pub(super) fn pop(&mut self) -> Option<GridStep> {
        if self.len == 0 {
            return None;
        }
        let step = self.slots.get(self.head).copied();
        self.head = (self.head + 1) % STEP_QUEUE_CAPACITY;
        self.len -= 1;
        step
    }

    pub(super) fn len(&self) -> usize {
        self.len
    }
}
