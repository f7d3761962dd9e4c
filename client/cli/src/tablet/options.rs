//! The options of `foretrace tablet`, as values.

use foretrace_client::wire::pen_flags;
use foretrace_tablet::{Mapping, PlaneAxis};

use crate::values::{number, word};

/// How the hand moves the pen.
#[derive(Debug, Clone, Copy, clap::Args)]
pub(super) struct HandArgs {
    /// Move the pen this many times as far as the hand, before plane.scale
    #[arg(long, value_name = "FACTOR", default_value_t = 1.0, value_parser = scale)]
    pub(super) scale: f64,

    /// Reverse an axis: x, y or xy
    #[arg(long, value_name = "AXES", value_parser = mirror)]
    mirror: Option<[bool; 2]>,

    /// Turn the tablet by this angle, counter-clockwise [degrees]
    #[arg(long, value_name = "DEG", default_value_t = 0.0, value_parser = degrees)]
    rotate: f64,

    /// Keep this coordinate of the pen where it begins: x or y
    #[arg(long, value_name = "AXIS", value_parser = axis)]
    pub(super) lock: Option<PlaneAxis>,

    /// While this button of the pen is held the hand moves and the arm stays: 1, 2 or 3
    #[arg(long, value_name = "BUTTON", value_parser = button)]
    pub(super) clutch: Option<u32>,
}

impl HandArgs {
    pub(super) fn mapping(&self) -> Mapping {
        Mapping {
            scale: self.scale,
            rotation_rad: self.rotate.to_radians(),
            mirror: self.mirror.unwrap_or_default(),
        }
    }
}

/// `WIDTHxHEIGHT` [mm].
pub(super) fn millimetres(text: &str) -> Result<[f64; 2], String> {
    let sides = text.split_once('x').and_then(|(width, height)| {
        let side = |text: &str| text.trim().parse().ok().filter(|mm| (10.0..=3000.0).contains(mm));
        Some([side(width)?, side(height)?])
    });
    sides.ok_or_else(|| "WIDTHxHEIGHT in mm, each from 10 to 3000, for example 216x135".to_owned())
}

/// A factor by which the pen moves farther than the hand.
pub(super) fn scale(text: &str) -> Result<f64, String> {
    number(0.01..=100.0, "a number from 0.01 to 100")(text)
}

fn degrees(text: &str) -> Result<f64, String> {
    number(-360.0..=360.0, "a number of degrees from -360 to 360")(text)
}

fn mirror(text: &str) -> Result<[bool; 2], String> {
    word([("x", [true, false]), ("y", [false, true]), ("xy", [true; 2]), ("yx", [true; 2])], "x, y or xy")(
        text,
    )
}

/// An axis of the pen's plane.
pub(super) fn axis(text: &str) -> Result<PlaneAxis, String> {
    word([("x", PlaneAxis::X), ("y", PlaneAxis::Y)], "x or y")(text)
}

/// A side button, as its flag.
fn button(text: &str) -> Result<u32, String> {
    word([("1", pen_flags::BUTTON_1), ("2", pen_flags::BUTTON_2), ("3", pen_flags::BUTTON_3)], "1, 2 or 3")(
        text,
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_legal_is_taken_and_what_is_not_is_told_the_form() {
        assert_eq!(millimetres("216x135.5"), Ok([216.0, 135.5]));
        for wrong in ["", "216", "216x", "0x135", "nanx10", "216x135x3", "1e9x10"] {
            assert!(millimetres(wrong).unwrap_err().contains("216x135"), "{wrong}");
        }
        assert_eq!((mirror("x"), mirror("xy")), (Ok([true, false]), Ok([true, true])));
        assert!(mirror("z").is_err() && axis("xy").is_err() && button("4").is_err());
        for wrong in ["0", "-1", "inf", "nan", "101"] {
            assert!(scale(wrong).is_err(), "{wrong}");
        }
        assert!(degrees("400").is_err() && degrees("-90").is_ok());
    }
}
