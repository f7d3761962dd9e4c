//! What counts as touching.

use crate::state::{choices, state};
use crate::units::Stamp;

/// What an arm reports as its joints' effort.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum EffortUnit {
    /// Torque \[Nm\].
    #[default]
    NewtonMetres,
    /// Motor current \[A\].
    Amperes,
    /// Share of the joint's effort limit, −1 to 1.
    Share,
}

choices! { EffortUnit { NewtonMetres, Amperes, Share } }

/// The efforts of one joint state.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EffortReading<const J: usize> {
    /// When they were measured, on the host's monotonic clock.
    pub stamp: Stamp,
    /// Of every joint, positive along its axis.
    pub effort: [f64; J],
    /// Unit of all these numbers.
    pub unit: EffortUnit,
}

state! { whole [const J: usize] EffortReading<J> { stamp, effort, unit } }

/// When an arm that reports efforts counts as touching something.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ContactSettings {
    /// Whether efforts are judged at all.
    pub judged: bool,
    /// Torque beyond what is expected, as a share of the joint's effort limit, that an arm in free space may
    /// show for ever \[1\], 0.02 to 1.
    pub torque_share: f64,
    /// How long twice that torque may last \[ns\], at most 5 s; three times it, half as long.
    pub hold_ns: u64,
    /// Motion in free space after which the expectation counts \[ns\], at most 60 s.
    pub learn_ns: u64,
}

impl ContactSettings {
    /// See docs/decisions/0028-contact-from-efforts.md.
    pub const DEFAULT: Self =
        Self { judged: true, torque_share: 0.07, hold_ns: 400_000_000, learn_ns: 1_000_000_000 };

    /// Name, value, legal range and unit of each number.
    pub(crate) fn numbers(&self) -> [(&'static str, f64, f64, f64, &'static str); 3] {
        [
            ("torque share of a contact", self.torque_share, 0.02, 1.0, "1"),
            ("hold time of a contact", self.hold_ns as f64 * 1e-9, 0.0, 5.0, "s"),
            ("motion before contact is judged", self.learn_ns as f64 * 1e-9, 0.5, 60.0, "s"),
        ]
    }
}

impl Default for ContactSettings {
    fn default() -> Self {
        Self::DEFAULT
    }
}
