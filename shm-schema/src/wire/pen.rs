//! `PenSample`: one reading of the pen, as a tablet reader, a browser pad or a player sends it.

use iceoryx2::prelude::ZeroCopySend;

use super::check::{Rejection, Validate, flags, number};
use super::flags::pen_flags;
use super::header::Header;
use super::layout::wire;

wire! {
    /// One reading of the pen. Positions are in metres in the device's plane, x right, y away from the
    /// writer.
    "foretrace.PenSampleV1"
    pub struct PenSample {
        /// Stamp: when it was sent.
        pub header: Header,
        /// When the pen was there \[ns\], mapped by the reader to this host's monotonic clock.
        pub device_stamp_ns: u64,
        /// Position \[m\].
        pub x_m: f64,
        /// Position \[m\].
        pub y_m: f64,
        /// 0 to 1; negative: unknown.
        pub pressure: f32,
        /// Tilt towards x from the plane's normal \[rad\].
        pub tilt_x_rad: f32,
        /// Tilt towards y from the plane's normal \[rad\].
        pub tilt_y_rad: f32,
        /// [`pen_flags`].
        pub flags: u32,
    }
}

/// Largest position a tablet may report \[m\].
pub const PEN_POSITION_LIMIT_M: f64 = 10.0;

impl PenSample {
    /// Whether the pen touches the surface.
    pub fn contact(&self) -> bool {
        self.flags & pen_flags::CONTACT != 0
    }
}

impl Validate for PenSample {
    fn validate(&self) -> Result<(), Rejection> {
        number("x_m", self.x_m, PEN_POSITION_LIMIT_M)?;
        number("y_m", self.y_m, PEN_POSITION_LIMIT_M)?;
        // Any negative number stands for unknown.
        let unknown = self.pressure < 0.0 && self.pressure.is_finite();
        number("pressure", if unknown { 0.0 } else { f64::from(self.pressure) }, 1.0)?;
        number("tilt_x_rad", f64::from(self.tilt_x_rad), std::f64::consts::PI)?;
        number("tilt_y_rad", f64::from(self.tilt_y_rad), std::f64::consts::PI)?;
        flags("flags", self.flags, pen_flags::ALL)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wire::vocabulary::RejectReason;

    fn good() -> PenSample {
        PenSample {
            x_m: 0.1,
            y_m: -0.2,
            pressure: 0.5,
            flags: pen_flags::CONTACT | pen_flags::IN_RANGE,
            ..Default::default()
        }
    }

    #[test]
    fn a_plausible_sample_passes_and_unknown_pressure_is_negative() {
        assert_eq!(good().validate(), Ok(()));
        assert_eq!(PenSample { pressure: -1.0, ..good() }.validate(), Ok(()));
        assert!(good().contact());
    }

    #[test]
    fn each_bad_field_is_named() {
        let cases = [
            (PenSample { x_m: f64::NAN, ..good() }, RejectReason::NotFinite, "x_m"),
            (PenSample { y_m: f64::INFINITY, ..good() }, RejectReason::NotFinite, "y_m"),
            (PenSample { x_m: 10.1, ..good() }, RejectReason::OutOfRange, "x_m"),
            (PenSample { pressure: 1.5, ..good() }, RejectReason::OutOfRange, "pressure"),
            (PenSample { pressure: f32::NAN, ..good() }, RejectReason::NotFinite, "pressure"),
            (PenSample { tilt_x_rad: 4.0, ..good() }, RejectReason::OutOfRange, "tilt_x_rad"),
            (PenSample { tilt_y_rad: f32::NEG_INFINITY, ..good() }, RejectReason::NotFinite, "tilt_y_rad"),
            (PenSample { flags: 1 << 20, ..good() }, RejectReason::UnknownFlags, "flags"),
        ];
        for (sample, reason, field) in cases {
            assert_eq!(sample.validate(), Err(Rejection::new(reason, field)));
        }
    }

    #[test]
    fn bounds_are_legal_themselves_and_contact_is_one_bit() {
        let edge = PenSample {
            x_m: PEN_POSITION_LIMIT_M,
            y_m: -PEN_POSITION_LIMIT_M,
            pressure: 1.0,
            tilt_x_rad: 3.1,
            tilt_y_rad: -3.1,
            ..good()
        };
        assert_eq!(edge.validate(), Ok(()));
        assert_eq!(PenSample { tilt_y_rad: 3.2, ..good() }.validate().unwrap_err().field, "tilt_y_rad");
        assert_eq!(
            PenSample { pressure: f32::NEG_INFINITY, ..good() }.validate().unwrap_err().field,
            "pressure"
        );
        assert_eq!(PenSample { pressure: 0.0, ..good() }.validate(), Ok(()));
        assert!(!PenSample { flags: pen_flags::ALL & !pen_flags::CONTACT, ..good() }.contact());
    }
}
