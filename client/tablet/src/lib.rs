//! Pens, touchscreens and mice of Linux (evdev) as pen readings, and its buttons as a dead-man switch.
//!
//! Contract: what the kernel says becomes readings in metres and radians, stamped by the kernel on the
//! monotonic clock. Lost events are noticed and the state is asked for again; a device that goes is reported,
//! and found again. `decoder`, `pressure`, `rate` and `hand` are pure: events and time are arguments.

#![forbid(unsafe_code)]

mod event;
mod pressure;
mod decoder;
mod rate;
mod hand;
mod device;
mod reader;
mod button;
mod switch;

pub use button::{Button, ButtonDevice, ButtonIdentity, list_buttons};
pub use decoder::{Axis, Decoded, Decoder, DeviceState, Geometry};
pub use device::{Device, DeviceError, DeviceKind, FoundDevices, ListedDevice, list};
pub use event::{Class, Event};
pub use hand::{MappedHand, Mapping, NotClutched, PlaneAxis};
pub use pressure::Pressure;
pub use rate::{MeasuredRate, Rate};
pub use reader::{Input, TabletReader};
pub use switch::{HoldSwitch, SwitchSignal};

/// A udev rule that lets whoever sits at the machine read pen tablets, and nobody else anything else. Systemd
/// ignores groups of people in rules since version 258, hence the tag.
pub const UDEV_RULE: &str = "\
# /etc/udev/rules.d/70-foretrace-tablet.rules: pen tablets for the person at the machine.
KERNEL==\"event*\", SUBSYSTEM==\"input\", ENV{ID_INPUT_TABLET}==\"1\", TAG+=\"uaccess\"
";
