//! Where the published command puts the tool, and whether that is outside the envelope.

use super::{Envelope, SPEED_MARGIN, TILT_MARGIN_RAD};
use crate::arm::Kinematics;
use crate::state::state;
use crate::stop::{StopCause, StopDetail};

/// Rounding: a tool outside may move out by this much without being judged \[m, rad\].
const ROUNDING: f64 = 1e-6;

/// How far outside the envelope the tool may be because it was when it was armed; never grows.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Allowed {
    position: [f64; 3],
    tilt: f64,
}

state! { [] Allowed { position, tilt } }

/// Tool position, tilt and speed of one command.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct EnvelopeFigures {
    /// In the plane's frame \[m\].
    pub tool: [f64; 3],
    /// Angle between tool and normal \[rad\].
    pub tilt: f64,
    /// \[m/s\]
    pub speed: f64,
}

impl<const J: usize> Envelope<J> {
    /// Where the tool is.
    #[must_use]
    pub fn figures(&self, kinematics: &Kinematics<J>, speed: f64) -> EnvelopeFigures {
        let (tilt, _) = self.tilted(kinematics);
        EnvelopeFigures { tool: self.plane.point_from_base(&kinematics.position).into(), tilt, speed }
    }

    fn beyond(&self, figures: &EnvelopeFigures) -> Allowed {
        let mut position = [0.0; 3];
        for ((beyond, at), [low, high]) in position.iter_mut().zip(figures.tool).zip(self.outer) {
            *beyond = (low - at).max(at - high).max(0.0);
        }
        Allowed { position, tilt: (figures.tilt - self.tilt - TILT_MARGIN_RAD).max(0.0) }
    }

    /// Begins again where the arm stands; a tool that is outside may come in.
    pub fn begin(&mut self, kinematics: &Kinematics<J>) {
        self.allowed = self.beyond(&self.figures(kinematics, 0.0));
    }

    /// Which bound of the envelope a command violates, if any.
    #[must_use]
    pub fn judge(&mut self, figures: &EnvelopeFigures) -> Option<StopDetail> {
        let beyond = self.beyond(figures);
        let detail = |cause, amount, limit| {
            Some(StopDetail { cause, joint: None, amount, limit, at: Default::default() })
        };
        let axes =
            beyond.position.iter().zip(&mut self.allowed.position).zip(figures.tool.iter().zip(&self.outer));
        let mut found = None;
        for (axis, ((beyond, allowed), (at, [low, high]))) in axes.enumerate() {
            if !(*beyond <= *allowed + ROUNDING) && found.is_none() {
                let cause = if axis == 2 { StopCause::Height } else { StopCause::Workspace };
                found = detail(cause, *at, if at < low { *low } else { *high });
            }
            *allowed = allowed.min(*beyond);
        }
        if !(beyond.tilt <= self.allowed.tilt + ROUNDING) && found.is_none() {
            found = detail(StopCause::Tilt, figures.tilt, self.tilt + TILT_MARGIN_RAD);
        }
        self.allowed.tilt = self.allowed.tilt.min(beyond.tilt);
        let fastest = self.speed * (1.0 + SPEED_MARGIN);
        if !(figures.speed <= fastest) && found.is_none() {
            found = detail(StopCause::ToolSpeed, figures.speed, fastest);
        }
        found
    }
}
