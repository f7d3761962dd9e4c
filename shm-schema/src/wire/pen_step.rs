//! `PenStep` and `PenPreview`: what a predictor in another process is told, and what it answers.
//!
//! Contract: the daemon sends every grid step that closes while predictor `external` is chosen. A preview
//! names the step after which it predicts; the daemon takes the newest that came since its last tick and
//! judges it anew in every step ([`crate::wire::status::ExternalState`]). Frames: positions are in the
//! plane's frame.

use std::fmt;

use iceoryx2::prelude::ZeroCopySend;

use super::check::{Rejection, Validate, flags, known, number};
use super::flags::preview_flags;
use super::header::Header;
use super::layout::wire;
use super::pen::PEN_POSITION_LIMIT_M;
use super::vocabulary::{RejectReason, UnknownValue, wire_enum};

/// Positions of a preview at most.
pub const PREVIEW_STEPS: usize = 64;

wire_enum! {
    /// How a grid step joins the one before.
    pub enum PenMotion: u32 {
        /// The pen began: nothing before this step belongs to it.
        Start = 0 => "start",
        /// The step before led here.
        Continues = 1 => "continues",
        /// The pen jumped: nothing before this step belongs to it.
        Jump = 2 => "jump",
    }
}

wire! {
    /// A closed step of the pen's grid.
    "foretrace.PenStepV1"
    pub struct PenStep {
        /// Stamp: when the tick that closed it ended.
        pub header: Header,
        /// Its number on the grid, one more per step.
        pub index: u64,
        /// The instant at its end \[ns\].
        pub time_ns: u64,
        /// Length of a step \[ns\].
        pub step_ns: u64,
        /// Position at its end \[m\].
        pub x_m: f64,
        /// Position at its end \[m\].
        pub y_m: f64,
        /// Displacement since the step before \[m\]; 0 unless the motion continues.
        pub dx_m: f64,
        /// Displacement since the step before \[m\]; 0 unless the motion continues.
        pub dy_m: f64,
        /// Running scale \[m per unit\]: of normalised displacements the root mean square is 10 per axis.
        pub scale_m: f64,
        /// Longest displacement per step that is taken over \[m\]; longer ones are shortened to it, and four
        /// times as long ones refused.
        pub longest_m: f64,
        /// [`PenMotion`].
        pub motion: u32,
        /// 1: the pen touches the paper.
        pub contact: u32,
        /// Positions that a preview should have: as many as the plan looks at, and more for a late one.
        pub wanted: u32,
        /// Zero.
        pub reserved: u32,
    }
}

wire! {
    /// Where the pen will be after a grid step.
    "foretrace.PenPreviewV1"
    pub struct PenPreview {
        /// Stamp: when it was sent.
        pub header: Header,
        /// Number of the step after which it predicts ([`PenStep::index`]).
        pub base_index: u64,
        /// Positions that count, at most [`PREVIEW_STEPS`]; see `PenStep::wanted`.
        pub count: u32,
        /// [`mod@preview_flags`].
        pub flags: u32,
        /// Position i + 1 steps after the base \[m\].
        pub x_m: [f64; PREVIEW_STEPS],
        /// Position i + 1 steps after the base \[m\].
        pub y_m: [f64; PREVIEW_STEPS],
        /// Radius about it in which the pen is expected in nine of ten cases \[m\]; see `flags`.
        pub radius_m: [f64; PREVIEW_STEPS],
    }
}

impl Validate for PenStep {
    fn validate(&self) -> Result<(), Rejection> {
        known::<_, PenMotion>("motion", self.motion)?;
        number("x_m", self.x_m, PEN_POSITION_LIMIT_M)?;
        number("y_m", self.y_m, PEN_POSITION_LIMIT_M)?;
        number("dx_m", self.dx_m, PEN_POSITION_LIMIT_M)?;
        number("dy_m", self.dy_m, PEN_POSITION_LIMIT_M)
    }
}

/// The law judges the numbers: a refusal there is counted with its reason.
impl Validate for PenPreview {
    fn validate(&self) -> Result<(), Rejection> {
        flags("flags", self.flags, preview_flags::ALL)?;
        let (count, most) = (f64::from(self.count), PREVIEW_STEPS as f64);
        if count <= most {
            return Ok(());
        }
        Err(Rejection::new(RejectReason::OutOfRange, "count").because(count, most))
    }
}
