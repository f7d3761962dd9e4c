//! `TickInput`: everything that one tick of the law was given, and the command that it made of it: with the
//! settings and a state to start from, the tick can be run again.
//!
//! Contract: as in `TickRecord`, numbers may be anything, NaN included: a replay needs what the loop saw, not
//! what it should have seen. Only enumerations and flags are checked. A tick with more pen samples than one
//! message holds is sent as several parts, which differ in `part` and `pen`.

use iceoryx2::prelude::ZeroCopySend;

use super::JOINTS;
use super::check::{Rejection, Validate, flags, known};
use super::flags::input_flags;
use super::header::Header;
use super::layout::wire;
use super::predictor_name::PredictorName;
use super::stop_detail::{StopCause, StopDetail};
use super::vocabulary::{ControlOp, EffortUnit, FaultReason, Mode, Rung};

/// Pen samples in one part.
pub const PEN_PER_PART: usize = 8;

wire! {
    /// A pen sample as the law saw it.
    "foretrace.PenInputV1"
    pub struct PenInput {
        /// When the pen was there \[ns\].
        pub stamp_ns: u64,
        /// Position in the pen's plane \[m\].
        pub x_m: f64,
        /// Position in the pen's plane \[m\].
        pub y_m: f64,
        /// Its number in its publisher's sequence.
        pub sequence: u64,
        /// When it was sent \[ns\].
        pub sent_ns: u64,
        /// When a tick received it \[ns\].
        pub received_ns: u64,
        /// 1: the pen touches the paper.
        pub contact: u32,
        /// 0.
        pub reserved: u32,
    }
}

wire! {
    /// One tick's input and its command.
    "foretrace.TickInputV2"
    pub struct TickInput {
        /// Stamp: end of the tick.
        pub header: Header,
        /// The start of the daemon that ran it, as in `Status`.
        pub daemon_id: u64,
        /// Number of the tick, from 1 without gaps.
        pub tick: u64,
        /// Its nominal release, the law's only clock \[ns\].
        pub now_ns: u64,
        /// Number of this part, from 0.
        pub part: u32,
        /// Parts of the tick, at least 1.
        pub parts: u32,
        /// Pen samples of the whole tick.
        pub pen_samples: u32,
        /// [`mod@input_flags`].
        pub flags: u32,
        /// Iteration cap of each solver.
        pub budget_iterations: u32,
        /// [`ControlOp`] of the request, if there was one.
        pub request: u32,
        /// Value of the request.
        pub request_value: f64,
        /// Predictor of the request.
        pub request_predictor: PredictorName,
        /// [`FaultReason`] of a halt, if there was one.
        pub halt: u32,
        /// Evidence of the halt.
        pub halt_detail: StopDetail,
        /// Stamp of the newest joint state, if one arrived \[ns\].
        pub joints_ns: u64,
        /// Joint positions \[rad\].
        pub joints_q: [f64; JOINTS],
        /// Joint velocities \[rad/s\].
        pub joints_qd: [f64; JOINTS],
        /// Joint efforts, in `effort_unit`.
        pub joints_effort: [f64; JOINTS],
        /// [`EffortUnit`]; 0: none.
        pub effort_unit: u32,
        /// Zero.
        pub reserved: u32,
        /// Stamp of the newest dead-man message, if one arrived \[ns\].
        pub enable_ns: u64,
        /// Version of the weights offered, if there were any.
        pub weights_version: u64,

        /// The time at which the command holds \[ns\]; 0: no command.
        pub command_ns: u64,
        /// Until when it is valid \[ns\].
        pub valid_until_ns: u64,
        /// Published joint positions \[rad\].
        pub q: [f64; JOINTS],
        /// Published joint velocities \[rad/s\].
        pub qd: [f64; JOINTS],
        /// Trust α.
        pub trust: f64,
        /// Version of the weights in use after the tick.
        pub weights_used: u64,
        /// [`Mode`] after the tick.
        pub mode: u32,
        /// [`Rung`] that made the command.
        pub rung: u32,
        /// [`FaultReason`] after the tick.
        pub fault: u32,
        /// Bits of `TickRecord::health` that the law sets.
        pub health: u32,
        /// Pen samples of this part, oldest first.
        pub pen: [PenInput; PEN_PER_PART],
    }
}

const _: () = assert!(size_of::<TickInput>() <= 1024);

impl TickInput {
    /// The pen samples of this part.
    pub fn pen(&self) -> &[PenInput] {
        let before = self.part as usize * PEN_PER_PART;
        let here = (self.pen_samples as usize).saturating_sub(before).min(PEN_PER_PART);
        self.pen.get(..here).unwrap_or_default()
    }

    /// Parts that a tick with `pen_samples` needs.
    #[must_use]
    pub const fn parts_for(pen_samples: usize) -> usize {
        if pen_samples == 0 { 1 } else { pen_samples.div_ceil(PEN_PER_PART) }
    }
}

impl Validate for TickInput {
    fn validate(&self) -> Result<(), Rejection> {
        flags("flags", self.flags, input_flags::ALL)?;
        known::<_, ControlOp>("request", self.request)?;
        known::<_, FaultReason>("halt", self.halt)?;
        known::<_, StopCause>("halt_detail.cause", self.halt_detail.cause)?;
        known::<_, EffortUnit>("effort_unit", self.effort_unit)?;
        known::<_, Mode>("mode", self.mode)?;
        known::<_, Rung>("rung", self.rung)?;
        known::<_, FaultReason>("fault", self.fault)?;
        self.request_predictor.check("request_predictor")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pen_samples_fill_one_part_after_the_other() {
        let counts = [0, 1, 8, 9, 16, 17];
        assert_eq!(counts.map(TickInput::parts_for), [1, 1, 1, 2, 2, 3]);
        let here = |part, pen_samples| TickInput { part, pen_samples, ..TickInput::default() }.pen().len();
        assert_eq!([here(0, 0), here(0, 5), here(0, 8), here(0, 11)], [0, 5, 8, 8]);
        assert_eq!([here(1, 8), here(1, 11), here(2, 17), here(u32::MAX, 17)], [0, 3, 1, 0]);
        assert_eq!(here(0, u32::MAX), PEN_PER_PART);
    }

    #[test]
    fn every_number_of_a_vocabulary_is_checked_by_name() {
        type Spoil = fn(&mut TickInput);
        let cases: [(&str, Spoil); 9] = [
            ("flags", |input| input.flags = 1 << 31),
            ("request", |input| input.request = 99),
            ("halt", |input| input.halt = 99),
            ("halt_detail.cause", |input| input.halt_detail.cause = 99),
            ("effort_unit", |input| input.effort_unit = 99),
            ("mode", |input| input.mode = 99),
            ("rung", |input| input.rung = 99),
            ("fault", |input| input.fault = 99),
            ("request_predictor", |input| input.request_predictor.bytes[0] = 0xff),
        ];
        assert_eq!(TickInput::default().validate(), Ok(()));
        for (field, spoil) in cases {
            let mut input = TickInput::default();
            spoil(&mut input);
            assert_eq!(input.validate().unwrap_err().field, field);
        }
    }
}
