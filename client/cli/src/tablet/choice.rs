//! Which device is meant, and what to do where none can be used.

use std::path::{Path, PathBuf};

use foretrace_config::plain;
use foretrace_tablet::{DeviceError, DeviceKind, FoundDevices, ListedDevice};

use crate::failure::{Cause, Failure};
use crate::output::{note, say};

const RULE: &str = "let your user read tablets: `foretrace tablet --udev-rule | sudo tee \
                    /etc/udev/rules.d/70-foretrace-tablet.rules && sudo udevadm control --reload && sudo \
                    udevadm trigger`";

/// The only pen tablet; with `pointers` the only touchscreen or mouse where there is no tablet.
pub(super) fn only(found: &FoundDevices, pointers: bool) -> Result<&ListedDevice, Failure> {
    let of = |wanted: fn(DeviceKind) -> bool| -> Vec<&ListedDevice> {
        found.devices.iter().filter(|device| wanted(device.kind)).collect()
    };
    let pens = of(|kind| kind == DeviceKind::Pen);
    let chosen = if pens.is_empty() && pointers { of(|kind| kind != DeviceKind::Pen) } else { pens };
    match chosen[..] {
        [device] => Ok(device),
        [] => Err(nothing(found)),
        _ => {
            let all: Vec<String> = chosen.iter().map(|device| device.path.display().to_string()).collect();
            let what = format!("{} devices could be the pen: {}", all.len(), all.join(", "));
            Err(Failure::usage(what, "choose one with --device FILE; see `foretrace tablet --list`"))
        }
    }
}

fn nothing(found: &FoundDevices) -> Failure {
    if found.forbidden > 0 {
        let what =
            format!("{} input devices may not be read by this user, and no other is a pen", found.forbidden);
        return Failure::failed(what, RULE);
    }
    let remedy = if found.devices.is_empty() {
        "plug one in, or write in a browser or with `foretrace play`"
    } else {
        "plug one in, or use a mouse or touchscreen with --pointer"
    };
    Failure::failed("no pen tablet was found", remedy)
}

/// Where the same device is now, which may have another number after it was plugged in again.
pub(super) fn again(found: &FoundDevices, path: &Path, name: &str, kind: DeviceKind) -> Option<PathBuf> {
    let same = |device: &&ListedDevice| device.name == name && device.kind == kind;
    let mut same = found.devices.iter().filter(same);
    let first = same.next()?;
    // Two of one name: only its own file says which.
    match same.next() {
        None => Some(first.path.clone()),
        Some(_) => found.devices.iter().find(|device| device.path == path).map(|device| device.path.clone()),
    }
}

pub(super) fn tell(found: &FoundDevices) -> Result<(), Failure> {
    for ListedDevice { path, name, kind, size_mm } in &found.devices {
        let size = match (kind, size_mm) {
            (DeviceKind::Mouse, _) => String::new(),
            (_, Some([width, height])) => format!(", {width:.0} x {height:.0} mm"),
            (_, None) => ", does not tell its size: give --mm WIDTHxHEIGHT".to_owned(),
        };
        say!("{:<24}{} ({}{size})", path.display(), plain(name), kind.label());
    }
    if found.forbidden > 0 {
        note!("tablet: {} more devices may not be read by this user; {RULE}", found.forbidden);
    }
    if found.devices.is_empty() { Err(nothing(found)) } else { Ok(()) }
}

/// Why a device cannot be used, with the remedy.
pub(super) fn unusable(error: &DeviceError) -> Failure {
    let remedy = match error {
        _ if error.is_forbidden() => RULE,
        DeviceError::Closed { .. } | DeviceError::NoPen { .. } => "choose one of `foretrace tablet --list`",
        _ => "",
    };
    let cause = if matches!(error, DeviceError::NoDevices(_)) { Cause::Failed } else { Cause::BadInput };
    Failure::new(cause, error, remedy)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn device(number: u32, name: &str, kind: DeviceKind) -> ListedDevice {
        let path = PathBuf::from(format!("/dev/input/event{number}"));
        ListedDevice { path, name: name.to_owned(), kind, size_mm: None }
    }

    fn found(devices: Vec<ListedDevice>) -> FoundDevices {
        FoundDevices { devices, forbidden: 0 }
    }

    #[test]
    fn the_only_pen_is_taken_and_a_pointer_only_on_request() {
        let all = found(vec![device(3, "mouse", DeviceKind::Mouse), device(7, "Wacom", DeviceKind::Pen)]);
        assert_eq!(only(&all, false).unwrap().name, "Wacom");
        assert_eq!(only(&all, true).unwrap().name, "Wacom");
        let mouse = found(vec![device(3, "mouse", DeviceKind::Mouse)]);
        assert!(only(&mouse, false).unwrap_err().to_string().contains("--pointer"));
        assert_eq!(only(&mouse, true).unwrap().name, "mouse");
    }

    #[test]
    fn several_are_named_and_a_lack_of_rights_is_answered_with_the_rule() {
        let two = found(vec![device(7, "a", DeviceKind::Pen), device(9, "b", DeviceKind::Pen)]);
        let message = only(&two, false).unwrap_err().to_string();
        assert!(
            message.contains("/dev/input/event7, /dev/input/event9") && message.contains("--device"),
            "{message}"
        );
        let message =
            only(&FoundDevices { forbidden: 4, ..FoundDevices::default() }, false).unwrap_err().to_string();
        assert!(
            message.contains("4 input devices may not be read") && message.contains("--udev-rule"),
            "{message}"
        );
        assert!(foretrace_tablet::UDEV_RULE.contains("TAG+=\"uaccess\""));
    }

    #[test]
    fn a_device_that_was_plugged_in_again_is_found_under_its_new_number() {
        let path = Path::new("/dev/input/event7");
        let now = |devices| again(&found(devices), path, "Wacom", DeviceKind::Pen);
        assert_eq!(now(vec![device(3, "mouse", DeviceKind::Mouse)]), None);
        let moved = device(12, "Wacom", DeviceKind::Pen);
        assert_eq!(now(vec![moved.clone()]), Some(moved.path.clone()));
        // Another one of the same make is not taken for it.
        assert_eq!(now(vec![moved.clone(), device(13, "Wacom", DeviceKind::Pen)]), None);
        assert_eq!(now(vec![moved, device(7, "Wacom", DeviceKind::Pen)]), Some(path.to_owned()));
    }
}
