//! The pen: irregular stamped samples in, closed steps of a uniform absolute grid out.
//!
//! Contract: grid point k is the time k·Δ of the monotonic clock. It is closed by the first sample stamped at
//! or after it, by linear interpolation between the two samples around it, so nothing newer than the newest
//! sample is ever used and a regular sample is never delayed. Work per call is bounded by the queue; nothing
//! allocates. Absent: prediction, contact height, calibration (positions are already in plane metres).

mod queue;
mod silence;
mod tracker;
mod scale;

use crate::state::{choices, state};
pub use queue::STEP_QUEUE_CAPACITY;
pub use scale::{REST, SpeedScale, SpeedScaleSettings, TARGET_RMS, rests};
pub(crate) use silence::PenSilence;
pub use tracker::{PenCounters, PenTracker};

use thiserror::Error;

use crate::units::Stamp;

/// Origin of a reading, passed through unchanged: the number and the reading's stamp identify a sample from
/// the device to the joint command and back.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct PenOrigin {
    /// Number in its sender's sequence, from 1; 0: unknown.
    pub sequence: u64,
    /// When it was sent; 0: unknown.
    pub sent: Stamp,
    /// When it was received; 0: unknown.
    pub received: Stamp,
}

state! { whole [] PenOrigin { sequence, sent, received } }

/// One reading of the pen in the writing plane's frame.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct PenReading {
    /// When the pen was there, on the host's monotonic clock.
    pub stamp: Stamp,
    /// Position in the writing plane \[m\].
    pub position: [f64; 2],
    /// The pen touches the paper.
    pub contact: bool,
    /// Where it comes from.
    pub origin: PenOrigin,
}

state! { whole [] PenReading { stamp, position, contact, origin } }

impl PenReading {
    /// A reading of unknown origin.
    #[must_use]
    pub const fn new(stamp: Stamp, position: [f64; 2], contact: bool) -> Self {
        let origin = PenOrigin { sequence: 0, sent: Stamp(0), received: Stamp(0) };
        Self { stamp, position, contact, origin }
    }
}

/// How a grid step relates to the one before it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Motion {
    /// First step after a start, a gap or lost steps: no displacement, history begins here.
    #[default]
    Start,
    /// Ordinary motion: `displacement` may be observed and learned.
    Continues,
    /// The pen jumped: `displacement` is not motion, history begins here.
    Jump,
}

choices! { Motion { Start, Continues, Jump } }

/// One closed step of the pen grid.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct GridStep {
    /// k: this grid point is the instant k·Δ of the monotonic clock.
    pub index: u64,
    /// Position at k·Δ in the writing plane \[m\].
    pub position: [f64; 2],
    /// Position now minus position at k−1 \[m\]; zero for `Start`, to be ignored as motion for `Jump`.
    pub displacement: [f64; 2],
    /// Its part in the first half of the step \[m\]: half of it where the pen was not seen between.
    pub half: [f64; 2],
    /// From k·Δ to the sample that closed the step \[m\]; zero for all but the newest of several steps that
    /// one sample closed, and after a jump.
    pub ahead: [f64; 2],
    /// How long after k·Δ that sample is stamped \[ns\]; zero where `ahead` is not known.
    pub ahead_ns: u64,
    /// Whether the displacement is motion.
    pub motion: Motion,
    /// The samples on both sides of k·Δ touch the paper.
    pub contact: bool,
    /// Steps since the pen came to touch the paper or left it; counted again from a start or a jump.
    pub contact_steps: u32,
}

/// Whether the pen touches the paper, and since when: hover is motion of its own kind.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Touch {
    /// The pen touches the paper.
    pub contact: bool,
    /// Steps since it came to touch the paper or left it; [`u32::MAX`]: since the history began.
    pub steps: u32,
}

state! { whole [] Touch { contact, steps } }

impl Touch {
    /// Of recordings that hold ink only.
    pub const INK: Self = Self { contact: true, steps: u32::MAX };
}

impl GridStep {
    /// Whether the pen touches the paper, and since when.
    #[must_use]
    pub const fn touch(&self) -> Touch {
        Touch { contact: self.contact, steps: self.contact_steps }
    }
}

state! {
    whole [] GridStep { index, position, displacement, half, ahead, ahead_ns, motion, contact, contact_steps }
}

/// Why a reading was refused.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PenRejection {
    /// A coordinate is NaN or infinite.
    NonFinite,
    /// Outside the position bounds.
    OutOfRange,
    /// Stamped further ahead of now than clocks may differ.
    FromFuture,
    /// Same stamp as the newest reading.
    Repeat,
    /// Stamped before the newest reading.
    TimeBackwards,
    /// Faster than a hand can move, and not (yet) confirmed by a second reading at the same place.
    Outlier,
}

choices! { PenRejection { NonFinite, OutOfRange, FromFuture, Repeat, TimeBackwards, Outlier } }

/// The evidence behind a refusal.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PenRefusal {
    /// Why it was decided so.
    pub why: PenRejection,
    /// Coordinate 0 or 1, if one caused it.
    pub axis: Option<u8>,
    /// The coordinate \[m\], or the error of the stamp \[s\].
    pub value: f64,
    /// The bound that was broken, in the same unit.
    pub bound: f64,
    /// The tick that refused it.
    pub at: Stamp,
}

state! { whole [] PenRefusal { why, axis, value, bound, at } }

/// The verdict on one reading.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Receipt {
    /// Taken into the grid.
    Accepted,
    /// Refused and counted; otherwise without effect (an `Outlier` is remembered as a suspect).
    Rejected(PenRejection),
}

/// Limits of a pen. The defaults suit handwriting enlarged to a few centimetres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PenSettings {
    /// Grid step Δ \[ns\].
    pub step_ns: u64,
    /// Samples further apart than this restart the grid \[ns\]; at most half the step queue.
    pub max_gap_ns: u64,
    /// A sample may be stamped this far ahead of now \[ns\]. It also bounds how long a wrong stamp can lock
    /// the pen out.
    pub max_future_ns: u64,
    /// Jump gate: a sample further from the last one than this speed allows is a jump or a glitch \[m/s\].
    pub max_speed_mps: f64,
    /// Samples closer in time than this are judged by the gate as if this far apart \[ns\]: stamps jitter,
    /// and one count of the digitiser within a microsecond is no speed.
    pub min_interval_ns: u64,
    /// Smallest legal position \[m\].
    pub position_min_m: [f64; 2],
    /// Largest legal position \[m\].
    pub position_max_m: [f64; 2],
}

impl Default for PenSettings {
    fn default() -> Self {
        Self {
            step_ns: 10_000_000,
            max_gap_ns: 100_000_000,
            max_future_ns: 20_000_000,
            max_speed_mps: 4.0,
            min_interval_ns: 2_000_000,
            position_min_m: [-1.0; 2],
            position_max_m: [1.0; 2],
        }
    }
}

/// A setting that cannot work.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum PenError {
    /// Δ outside its bounds.
    #[error("grid step is {got_ns} ns, legal are 1_000_000 to 1_000_000_000 ns: use 10_000_000")]
    Step {
        /// As given \[ns\].
        got_ns: u64,
    },
    /// The gap would overflow the step queue, or is shorter than two steps.
    #[error("largest pen gap is {got_ns} ns, legal are {min_ns} to {max_ns} ns (2 to {steps} grid steps)")]
    Gap {
        /// As given \[ns\].
        got_ns: u64,
        /// Smallest legal value \[ns\].
        min_ns: u64,
        /// Largest legal value \[ns\].
        max_ns: u64,
        /// Largest legal number of steps.
        steps: u64,
    },
    /// A clock difference of more than a second is an error of the clock.
    #[error("largest lead of a pen stamp is {got_ns} ns, legal are 0 to 1_000_000_000 ns: use 20_000_000")]
    Future {
        /// As given \[ns\].
        got_ns: u64,
    },
    /// The jump gate is not a speed.
    #[error("jump gate is {got_mps} m/s, it must be above 0 and finite: use 4.0 for enlarged handwriting")]
    Speed {
        /// As given \[m/s\].
        got_mps: f64,
    },
    /// A smallest interval longer than a step would make the gate too tolerant.
    #[error(
        "smallest pen interval is {got_ns} ns, legal are 1 to the grid step ({step_ns} ns): use 2_000_000"
    )]
    Interval {
        /// As given \[ns\].
        got_ns: u64,
        /// Δ \[ns\].
        step_ns: u64,
    },
    /// Empty or infinite position range.
    #[error("pen position range on axis {axis} is [{min_m}, {max_m}] m: it must be finite and not empty")]
    Bounds {
        /// 0 = x, 1 = y.
        axis: usize,
        /// As given \[m\].
        min_m: f64,
        /// As given \[m\].
        max_m: f64,
    },
    /// The speed scale's numbers do not fit together.
    #[error(
        "speed scale initial {initial_m}, smallest {min_m}, largest {max_m} m per unit, memory \
         {memory_steps} steps: \
         needs 0 < smallest <= initial <= largest, memory of at least 10"
    )]
    Scale {
        /// Initial scale \[m per unit\].
        initial_m: f64,
        /// Smallest \[m per unit\].
        min_m: f64,
        /// Largest \[m per unit\].
        max_m: f64,
        /// Memory \[steps\].
        memory_steps: f64,
    },
}

impl PenSettings {
    /// Checks every bound.
    ///
    /// # Errors
    ///
    /// The first bound that is broken, with its value, limits and remedy.
    pub fn validate(&self) -> Result<(), PenError> {
        if !(1_000_000..=1_000_000_000).contains(&self.step_ns) {
            return Err(PenError::Step { got_ns: self.step_ns });
        }
        let steps = STEP_QUEUE_CAPACITY as u64 / 2;
        let (min_ns, max_ns) = (2 * self.step_ns, steps * self.step_ns);
        if !(min_ns..=max_ns).contains(&self.max_gap_ns) {
            return Err(PenError::Gap { got_ns: self.max_gap_ns, min_ns, max_ns, steps });
        }
        if self.max_future_ns > 1_000_000_000 {
            return Err(PenError::Future { got_ns: self.max_future_ns });
        }
        if !(self.max_speed_mps > 0.0 && self.max_speed_mps.is_finite()) {
            return Err(PenError::Speed { got_mps: self.max_speed_mps });
        }
        if !(1..=self.step_ns).contains(&self.min_interval_ns) {
            return Err(PenError::Interval { got_ns: self.min_interval_ns, step_ns: self.step_ns });
        }
        for (axis, (&min_m, &max_m)) in self.position_min_m.iter().zip(&self.position_max_m).enumerate() {
            if !(min_m < max_m && min_m.is_finite() && max_m.is_finite()) {
                return Err(PenError::Bounds { axis, min_m, max_m });
            }
        }
        Ok(())
    }
}
