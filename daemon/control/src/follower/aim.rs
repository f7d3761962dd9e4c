//! The reference: what the plan is to follow, and how far ahead of the pen.

use super::Follower;
use super::io::Mode;
use super::motion::Wanted;
use crate::predict::bands::BAND_LEADS;
use crate::reference::resting;
use crate::units::{Stamp, Trust};

impl<const N: usize, const J: usize> Follower<N, J> {
    /// The nearest lead that a plan uses, as far as there are error bands \[steps\].
    pub(super) fn nearest_lead(&self) -> usize {
        ((self.ahead_ns() / self.settings.pen.step_ns) as usize + 1).min(BAND_LEADS)
    }

    /// How far ahead references lie: the dead time without the servo that the plan models, plus the plan's
    /// response.
    pub(super) fn ahead_ns(&self) -> u64 {
        self.dead_time.ns().saturating_sub(self.settings.servo_ns()).saturating_add(self.settings.response_ns)
    }

    /// What the plan should follow; `None` while the arm is not to follow the pen.
    pub(super) fn wanted(&self, now: Stamp, trust: Trust) -> Option<Wanted<N>> {
        match self.watch.mode() {
            Mode::Idle => return None,
            Mode::Homing => return Some(Wanted::Home),
            Mode::Armed | Mode::Stopped | Mode::Fault => return Some(Wanted::Stop),
            Mode::Following | Mode::Holding => {}
        }
        let pen = self.pen.newest()?;
        let preview = match self.silence.resting_at(now) {
            Some(position) => self.preview.base().map(|_| resting(position)),
            None => self.reference.references(&self.preview, now, self.ahead_ns(), self.settings.mpc.step_s),
        };
        Some(Wanted::Follow { pen, holding: self.watch.mode() == Mode::Holding, preview, trust })
    }
}
