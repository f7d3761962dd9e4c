//! Pens, touchscreens and mice of Linux (evdev) as pen readings.
//!
//! Contract: what the kernel says becomes readings in metres and radians, stamped by the kernel on the
//! monotonic clock. Lost events are noticed and the state is asked for anew; a device that goes is told, and
//! found again. `decoder`, `pressure`, `rate` and `hand` are pure: events and time are arguments.

#![forbid(unsafe_code)]

mod event;
mod pressure;
mod decoder;
mod rate;
mod hand;
mod device;
mod reader;

pub use decoder::{Axis, Decoded, Decoder, Geometry, State};
pub use device::{Device, DeviceError, Found, Kind, Listed, list};
pub use event::{Class, Event};
pub use hand::{Hand, Mapping, NotClutched, PlaneAxis};
pub use pressure::Pressure;
pub use rate::{Rate, Told};
pub use reader::{Input, Reader};

/// A udev rule that lets whoever sits at the machine read pen tablets, and nobody else anything else. Systemd
/// ignores groups of people in rules since version 258, hence the tag.
pub const UDEV_RULE: &str = "\
# /etc/udev/rules.d/70-foretrace-tablet.rules: pen tablets for the person at the machine.
KERNEL==\"event*\", SUBSYSTEM==\"input\", ENV{ID_INPUT_TABLET}==\"1\", TAG+=\"uaccess\"
";
