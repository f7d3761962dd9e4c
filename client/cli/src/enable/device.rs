//! Buttons of Linux input devices (evdev): foot pedals, gamepads, keyboards, styluses.
//!
//! Contract: the state of a button is asked of the kernel at every look, so that no lost event can leave it
//! held. The device is not grabbed: other programs see it as before. Wired only: over radio a release that is
//! not received looks as a button that is held.

use std::io;
use std::path::{Path, PathBuf};

use evdevil::event::Key;
use evdevil::{Bus, Evdev};

use crate::failure::{Cause, Failure};

const RIGHTS: &str = "give your user the group `input`, or a udev rule with TAG+=\"uaccess\" for this \
                      device, \
                      then plug it in again";

/// A button of a device.
#[derive(Debug)]
pub(super) struct Button {
    device: Evdev,
    key: Key,
}

impl Button {
    /// # Errors
    ///
    /// No such device, no rights, no evdev device, one over Bluetooth, or it has no such button.
    pub(super) fn open(path: &Path, button: &str) -> Result<Self, Failure> {
        // The names in /dev/input/by-id are links, which the library does not take.
        let device =
            std::fs::canonicalize(path).and_then(Evdev::open).map_err(|error| unusable(path, &error))?;
        let bus = device.input_id().map_err(|error| unusable(path, &error))?.bus();
        if is_radio(bus) {
            return Err(radio(path));
        }
        let keys = device.supported_keys().map_err(|error| unusable(path, &error))?;
        let named = button.parse::<Key>().ok().filter(|key| keys.contains(*key));
        let key = named.ok_or_else(|| {
            let all: Vec<String> = keys.iter().map(|key| format!("{key:?}")).collect();
            let (first, more) = (all.iter().take(12).cloned().collect::<Vec<_>>(), all.len() > 12);
            let remedy = match (first.is_empty(), more) {
                (true, _) => "it has none: choose another device (`foretrace enable --list`)".to_owned(),
                (_, false) => format!("it has {}", first.join(", ")),
                (_, true) => format!("it has {}, and {} more", first.join(", "), all.len() - first.len()),
            };
            Failure::usage(format_args!("{} has no button {button:?}", path.display()), remedy)
        })?;
        Ok(Self { device, key })
    }

    /// Whether it is held now.
    ///
    /// # Errors
    ///
    /// The device was unplugged, or cannot be read.
    pub(super) fn held(&self) -> io::Result<bool> {
        Ok(self.device.key_state()?.contains(self.key))
    }

    /// The device's name, and the button's.
    pub(super) fn name(&self) -> String {
        let device = self.device.name().unwrap_or_else(|_| "a device without a name".to_owned());
        format!("{:?} of {}", self.key, foretrace_config::plain(&device))
    }
}

/// A device with buttons.
#[derive(Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Listed {
    pub(super) path: PathBuf,
    pub(super) name: String,
    pub(super) buttons: usize,
    /// Over Bluetooth: not to be used.
    pub(super) radio: bool,
}

/// Devices with buttons, and how many devices could not be opened.
///
/// # Errors
///
/// There is no folder `/dev/input`.
pub(super) fn list() -> Result<(Vec<Listed>, usize), Failure> {
    let devices = evdevil::enumerate().map_err(|error| {
        Failure::failed(
            format_args!("/dev/input cannot be read: {error}"),
            "see that this machine has input devices",
        )
    })?;
    let (mut found, mut closed) = (Vec::new(), 0);
    for device in devices {
        let Ok((path, device)) = device else {
            closed += 1;
            continue;
        };
        let buttons = device.supported_keys().map_or(0, |keys| keys.iter().count());
        if buttons > 0 {
            let radio = device.input_id().is_ok_and(|id| is_radio(id.bus()));
            found.push(Listed { path, name: device.name().unwrap_or_default(), buttons, radio });
        }
    }
    found.sort();
    Ok((found, closed))
}

/// A dongle of a maker's own calls itself USB and cannot be told from a wire.
fn is_radio(bus: Bus) -> bool {
    bus == Bus::BLUETOOTH
}

fn radio(path: &Path) -> Failure {
    let what = format!(
        "{} is a Bluetooth device, and a dead-man is wired only: a release that the radio loses would not stop \
         the arm",
        path.display()
    );
    Failure::bad_input(what, "choose a wired one of `foretrace enable --list`, and no wireless dongle either")
}

fn unusable(path: &Path, error: &io::Error) -> Failure {
    let remedy = match error.kind() {
        io::ErrorKind::PermissionDenied => RIGHTS,
        _ => "choose one of `foretrace enable --list`",
    };
    Failure::new(Cause::BadInput, format_args!("{}: {error}", path.display()), remedy)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_dead_man_over_bluetooth_is_refused_and_a_wired_one_is_not() {
        assert!(is_radio(Bus::BLUETOOTH));
        for wired in [Bus::USB, Bus::I8042, Bus::I2C, Bus::VIRTUAL] {
            assert!(!is_radio(wired), "{wired:?}");
        }
        let text = radio(Path::new("/dev/input/event9")).to_string();
        for part in ["/dev/input/event9", "wired only", "would not stop the arm", "--list"] {
            assert!(text.contains(part), "{text}");
        }
    }
}
