//! `Refused`: the newest message of a kind that the daemon refused, and why.

use std::fmt;

use iceoryx2::prelude::ZeroCopySend;

use super::check::Rejection;
use super::layout::wire;
use super::vocabulary::{RejectReason, UnknownValue, wire_enum};

wire_enum! {
    /// The fields that a refusal may name; labels are the fields' names.
    pub enum RejectField: u32 {
        /// A field without a number here.
        Other = 0 => "another field",
        /// Joint positions.
        Q = 1 => "q",
        /// Joint velocities.
        Qd = 2 => "qd",
        /// Joint currents or torques.
        Effort = 3 => "effort",
        /// Safety mode of the arm.
        SafetyMode = 4 => "safety_mode",
        /// Robot mode of the arm.
        RobotMode = 5 => "robot_mode",
        /// Pen position.
        X = 6 => "x_m",
        /// Pen position.
        Y = 7 => "y_m",
        /// Pen pressure.
        Pressure = 8 => "pressure",
        /// Pen tilt.
        TiltX = 9 => "tilt_x_rad",
        /// Pen tilt.
        TiltY = 10 => "tilt_y_rad",
        /// Flag word.
        Flags = 11 => "flags",
        /// Stamp of the header.
        Stamp = 12 => "stamp_ns",
        /// Sequence number of the header.
        Sequence = 13 => "sequence",
        /// Boot of the header.
        Boot = 14 => "boot_id",
        /// When the pen was sampled.
        DeviceStamp = 15 => "device_stamp_ns",
        /// Echoed tick.
        CommandTick = 16 => "command_tick",
        /// Echoed pen sample.
        PenSequence = 17 => "pen_sequence",
        /// Echoed time of acceptance.
        CommandAccepted = 18 => "command_accepted_ns",
        /// Unit of the joint currents or torques.
        EffortUnit = 19 => "effort_unit",
    }
}

wire! {
    /// The newest refusal of one kind of message.
    "foretrace.RefusedV1"
    pub struct Refused {
        /// [`RejectReason`].
        pub reason: u32,
        /// [`RejectField`].
        pub field: u32,
        /// Element of the field, if it is an array; −1: none.
        pub index: i32,
        /// Zero.
        pub reserved: u32,
        /// The value found, in the field's unit; for stamps the distance from the expected value \[s\].
        pub value: f64,
        /// The bound that was broken, in the same unit; NaN: none.
        pub bound: f64,
        /// When it was refused \[ns\]; 0: nothing was refused yet.
        pub at_ns: u64,
    }
}

impl Refused {
    /// Nothing was refused.
    pub const NONE: Self =
        Self { reason: 0, field: 0, index: -1, reserved: 0, value: 0.0, bound: f64::NAN, at_ns: 0 };

    /// `rejection` as it happened at `at_ns`.
    #[must_use]
    pub fn of(rejection: &Rejection, at_ns: u64) -> Self {
        Self {
            reason: rejection.reason.into(),
            field: RejectField::from_label(rejection.field).unwrap_or(RejectField::Other).into(),
            index: rejection.index.map_or(-1, i32::from),
            reserved: 0,
            value: rejection.value,
            bound: rejection.bound,
            at_ns,
        }
    }

    /// The refusal; `None` if nothing was refused or the numbers are unknown.
    #[must_use]
    pub fn rejection(&self) -> Option<Rejection> {
        let reason = RejectReason::try_from(self.reason).ok().filter(|_| self.at_ns != 0)?;
        let field = RejectField::try_from(self.field).ok()?.label();
        let index = u8::try_from(self.index).ok();
        Some(Rejection { index, ..Rejection::new(reason, field).because(self.value, self.bound) })
    }
}

/// Field, value, bound and likely cause; empty if nothing was refused.
impl fmt::Display for Refused {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.rejection().map_or(Ok(()), |rejection| rejection.fmt(f))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wire::check::Validate;
    use crate::wire::joints::JointState;
    use crate::wire::pen::PenSample;

    #[test]
    fn refusals_survive_the_wire_with_their_evidence() {
        let mut state = JointState::default();
        state.q[2] = 57.3;
        let pen = PenSample { x_m: 152.0, ..PenSample::default() };
        for rejection in [state.validate().unwrap_err(), pen.validate().unwrap_err()] {
            let refused = Refused::of(&rejection, 5);
            assert_eq!(refused.to_string(), rejection.to_string());
            assert_eq!(
                refused.rejection().map(|it| (it.index, it.value)),
                Some((rejection.index, rejection.value))
            );
        }
        assert_eq!(Refused::NONE.to_string(), "");
    }

    #[test]
    fn every_field_that_is_checked_has_a_number() {
        for field in [
            "q",
            "qd",
            "effort",
            "effort_unit",
            "safety_mode",
            "robot_mode",
            "x_m",
            "y_m",
            "pressure",
            "flags",
            "stamp_ns",
        ] {
            assert!(
                RejectField::from_label(field).is_some_and(|known| known != RejectField::Other),
                "{field}"
            );
        }
    }

    #[test]
    fn nothing_refused_and_unknown_numbers_are_no_refusal() {
        let refused = Refused::of(&Rejection::new(RejectReason::TooOld, "stamp_ns").at(4), 9);
        assert_eq!((refused.reason, refused.field, refused.index, refused.at_ns), (8, 12, 4, 9));
        assert_eq!(Refused::of(&Rejection::new(RejectReason::TooOld, "no such field"), 9).field, 0);
        assert_eq!(refused.rejection().unwrap().index, Some(4));
        let unknown = [
            Refused { at_ns: 0, ..refused },
            Refused { reason: 99, ..refused },
            Refused { field: 99, ..refused },
        ];
        assert!(unknown.iter().all(|refused| refused.rejection().is_none()));
        assert_eq!(Refused { index: -1, ..refused }.rejection().unwrap().index, None);
    }
}
