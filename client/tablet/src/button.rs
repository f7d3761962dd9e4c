//! Buttons of Linux input devices (evdev): foot pedals, gamepads, keyboards, styluses.
//!
//! Contract: the state of a button is asked of the kernel at every look, so that no lost event can leave it
//! held. The device is not grabbed: other programs see it as before. Wired only: over radio a release that is
//! not received looks as a button that is held.

use std::borrow::Cow;
use std::io;
use std::path::{Path, PathBuf};

use evdevil::event::Key;
use evdevil::{Bus, Evdev, InputId};
use foretrace_config::plain;

use foretrace_failure::Failure;

const RIGHTS: &str = "give your user the group `input`, or a udev rule with TAG+=\"uaccess\" for this \
                      device, \
                      then plug it in again";

/// A button of a device.
#[derive(Debug)]
pub struct Button {
    device: Evdev,
    key: Key,
    identity: ButtonIdentity,
}

/// What tells a device from another one that later has the same path.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ButtonIdentity {
    name: String,
    /// Bus, vendor, product, version.
    id: InputId,
    /// The plug that it is in.
    plug: Option<String>,
    /// Serial number or address.
    serial: Option<String>,
}

impl ButtonIdentity {
    fn of(device: &Evdev) -> io::Result<Self> {
        Ok(Self {
            name: device.name()?,
            id: device.input_id()?,
            plug: device.phys()?,
            serial: device.unique_id()?,
        })
    }

    /// How `found` differs; `None`: it is the same device.
    fn difference(&self, found: &Self) -> Option<String> {
        let changed = |what: &str, old: &str, new: &str| Some(format!("its {what} is {new}, not {old}"));
        if self.name != found.name {
            changed("name", &plain(&self.name), &plain(&found.name))
        } else if self.id != found.id {
            changed("maker and product", &format!("{:?}", self.id), &format!("{:?}", found.id))
        } else if self.serial != found.serial {
            changed("serial number", &shown(self.serial.as_deref()), &shown(found.serial.as_deref()))
        } else if self.plug != found.plug {
            changed("plug", &shown(self.plug.as_deref()), &shown(found.plug.as_deref()))
        } else {
            None
        }
    }
}

impl Button {
    /// # Errors
    ///
    /// No such device, no rights, no evdev device, one over Bluetooth, or it has no such button.
    pub fn open(path: &Path, button: &str) -> Result<Self, Failure> {
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
        let identity = ButtonIdentity::of(&device).map_err(|error| unusable(path, &error))?;
        Ok(Self { device, key, identity })
    }

    /// The device again after it was unplugged; only the one of `known`.
    ///
    /// # Errors
    ///
    /// As [`Button::open`], or another device has the path.
    pub fn open_again(path: &Path, button: &str, known: &ButtonIdentity) -> Result<Self, Failure> {
        let found = Self::open(path, button)?;
        match known.difference(&found.identity) {
            None => Ok(found),
            Some(difference) => Err(another(path, &difference)),
        }
    }

    pub const fn identity(&self) -> &ButtonIdentity {
        &self.identity
    }

    /// Whether it is held now.
    ///
    /// # Errors
    ///
    /// The device was unplugged, or cannot be read.
    pub fn held(&self) -> io::Result<bool> {
        Ok(self.device.key_state()?.contains(self.key))
    }

    /// The device's name, and the button's.
    pub fn name(&self) -> String {
        let device = self.device.name().unwrap_or_else(|_| "a device without a name".to_owned());
        format!("{:?} of {}", self.key, plain(&device))
    }
}

/// A device with buttons.
#[derive(Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct ButtonDevice {
    pub path: PathBuf,
    pub name: String,
    pub buttons: usize,
    /// Over Bluetooth: not to be used.
    pub radio: bool,
}

/// Devices with buttons, and how many devices could not be opened.
///
/// # Errors
///
/// There is no folder `/dev/input`.
pub fn list_buttons() -> Result<(Vec<ButtonDevice>, usize), Failure> {
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
            found.push(ButtonDevice { path, name: device.name().unwrap_or_default(), buttons, radio });
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

fn shown(text: Option<&str>) -> Cow<'_, str> {
    text.map_or(Cow::Borrowed("none"), plain)
}

fn another(path: &Path, difference: &str) -> Failure {
    let what = format!("{} is another device than before: {difference}", path.display());
    Failure::bad_input(
        what,
        "plug the first one into its old place, or start `foretrace enable` again with this one",
    )
}

fn unusable(path: &Path, error: &io::Error) -> Failure {
    let remedy = match error.kind() {
        io::ErrorKind::PermissionDenied => RIGHTS,
        _ => "choose one of `foretrace enable --list`",
    };
    Failure::bad_input(format_args!("{}: {error}", path.display()), remedy)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn another_device_at_the_same_path_is_told_by_what_differs() {
        let known = ButtonIdentity {
            name: "Foot Pedal".to_owned(),
            id: InputId::new(Bus::USB, 1, 2, 3),
            plug: Some("usb-1/input0".to_owned()),
            serial: None,
        };
        assert_eq!(known.difference(&known.clone()), None);
        for (found, words) in [
            (
                ButtonIdentity { name: "Keyboard".to_owned(), ..known.clone() },
                "its name is Keyboard, not Foot Pedal",
            ),
            (ButtonIdentity { id: InputId::new(Bus::USB, 9, 2, 3), ..known.clone() }, "maker and product"),
            (
                ButtonIdentity { plug: Some("usb-2/input0".to_owned()), ..known.clone() },
                "its plug is usb-2/input0",
            ),
            (
                ButtonIdentity { serial: Some("A1".to_owned()), ..known.clone() },
                "its serial number is A1, not none",
            ),
        ] {
            let difference = known.difference(&found).unwrap();
            assert!(difference.contains(words), "{difference}");
            let told = another(Path::new("/dev/input/event9"), &difference).to_string();
            assert!(told.contains("another device than before") && told.contains(words), "{told}");
        }
    }

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
