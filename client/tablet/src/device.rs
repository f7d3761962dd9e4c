//! Devices that can be a pen: what they are, how large, and their events.
//!
//! Contract: a device is opened for reading, stamps by the monotonic clock, and is not grabbed unless that is
//! asked for. Sizes come from the kernel's resolution or from the user, and are never guessed.

use std::io;
use std::path::{Path, PathBuf};

use evdevil::Evdev;
use evdevil::event::{Abs, InputEvent, Key, Rel};

use crate::decoder::{Axis, DeviceState, Geometry};
use crate::event::{
    ABS_PRESSURE, ABS_TILT_X, ABS_TILT_Y, ABS_X, ABS_Y, BTN_LEFT, BTN_TOOL_PEN, BTN_TOUCH, Class, Event,
    REL_X, REL_Y,
};
use crate::pressure::Pressure;

/// Sizes of an active area that can be written on \[mm\]; anything else is a wrong resolution.
const SIZE_MM: std::ops::RangeInclusive<f64> = 10.0..=3000.0;
/// A mouse of 1000 counts per inch.
const MOUSE_COUNT_M: f64 = 25.4e-6;

/// What a device is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DeviceKind {
    /// A pen tablet or pen display.
    Pen,
    /// A touchscreen or touchpad.
    Touch,
    Mouse,
}

impl DeviceKind {
    /// The word for it.
    #[must_use]
    pub const fn label(self) -> &'static str {
        match self {
            Self::Pen => "pen",
            Self::Touch => "touch",
            Self::Mouse => "mouse",
        }
    }
}

/// A device that was found.
#[derive(Debug, Clone, PartialEq)]
pub struct ListedDevice {
    /// Its file in /dev/input.
    pub path: PathBuf,
    /// Its name, as it says.
    pub name: String,
    pub kind: DeviceKind,
    /// Size of the active area \[mm\], where the device tells it.
    pub size_mm: Option<[f64; 2]>,
}

/// What a search found.
#[derive(Debug, Clone, Default)]
pub struct FoundDevices {
    /// Devices that can be a pen, in the order of their files.
    pub devices: Vec<ListedDevice>,
    /// Devices that this user may not open.
    pub forbidden: usize,
}

/// Why a device cannot be a pen.
#[derive(thiserror::Error)]
pub enum DeviceError {
    /// It cannot be opened.
    #[error("{}: {source}", path.display())]
    Closed { path: PathBuf, source: io::Error },
    /// It has no axes of a pen.
    #[error("{}: neither pen, touchscreen nor mouse", path.display())]
    NoPen { path: PathBuf },
    /// It does not tell its size.
    #[error(
        "{}: the device does not tell its size ({found}): measure its active area and give --mm WIDTHxHEIGHT",
        path.display()
    )]
    NoSize { path: PathBuf, found: String },
    /// There is no folder of input devices.
    #[error("/dev/input cannot be read: {0}: see that this machine has input devices")]
    NoDevices(io::Error),
}

impl std::fmt::Debug for DeviceError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        std::fmt::Display::fmt(self, f)
    }
}

impl DeviceError {
    /// The user lacks the right to open it.
    #[must_use]
    pub fn is_forbidden(&self) -> bool {
        matches!(self, Self::Closed { source, .. } if source.kind() == io::ErrorKind::PermissionDenied)
    }
}

/// All devices that can be a pen.
///
/// # Errors
///
/// `NoDevices`.
pub fn list() -> Result<FoundDevices, DeviceError> {
    let mut found = FoundDevices::default();
    for device in evdevil::enumerate().map_err(DeviceError::NoDevices)? {
        match device {
            Ok((path, device)) => {
                // A device may go while it is asked.
                if let Ok(Some(kind)) = kind(&device) {
                    let name = device.name().unwrap_or_default();
                    let size_mm = reported_size_mm(&device).ok().flatten();
                    found.devices.push(ListedDevice { path, name, kind, size_mm });
                }
            }
            Err(error) if error.kind() == io::ErrorKind::PermissionDenied => found.forbidden += 1,
            Err(_) => {}
        }
    }
    found.devices.sort_by(|a, b| a.path.cmp(&b.path));
    Ok(found)
}

#[derive(Debug)]
pub struct Device {
    evdev: Evdev,
    name: String,
    kind: DeviceKind,
    geometry: Geometry,
}

impl Device {
    /// Opens `path`. `size_mm`: size of the active area, in the stead of what the device tells. `grab`: no
    /// other program hears the device.
    ///
    /// # Errors
    ///
    /// See [`DeviceError`].
    pub fn open(path: &Path, size_mm: Option<[f64; 2]>, grab: bool) -> Result<Self, DeviceError> {
        let closed = |source| DeviceError::Closed { path: path.to_owned(), source };
        // Names below /dev/input/by-id are links, which the library does not take.
        let evdev = std::fs::canonicalize(path).and_then(Evdev::open).map_err(closed)?;
        let kind =
            kind(&evdev).map_err(closed)?.ok_or_else(|| DeviceError::NoPen { path: path.to_owned() })?;
        let geometry = match kind {
            DeviceKind::Mouse => Geometry::Relative { per_count_m: MOUSE_COUNT_M },
            _ => absolute(&evdev, kind, size_mm)
                .map_err(closed)?
                .map_err(|found| DeviceError::NoSize { path: path.to_owned(), found })?,
        };
        evdev.set_clockid(libc::CLOCK_MONOTONIC).map_err(closed)?;
        if grab {
            evdev.grab().map_err(closed)?;
        }
        let name = evdev.name().map_err(closed)?;
        Ok(Self { evdev, name, kind, geometry })
    }

    /// The name, as it says.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    #[must_use]
    pub const fn kind(&self) -> DeviceKind {
        self.kind
    }

    /// How it tells its pen.
    #[must_use]
    pub const fn geometry(&self) -> Geometry {
        self.geometry
    }

    /// Waits for events and passes them on, oldest first.
    ///
    /// # Errors
    ///
    /// The device is gone.
    pub fn read(&self, mut use_event: impl FnMut(Event)) -> io::Result<()> {
        let mut events = [InputEvent::zeroed(); 64];
        let count = self.evdev.read_events(&mut events)?;
        if count == 0 {
            return Err(io::ErrorKind::UnexpectedEof.into());
        }
        for event in events.iter().take(count) {
            // The kernel counts the monotonic clock's seconds where it usually counts those since 1970.
            let since = event.time().duration_since(std::time::UNIX_EPOCH).unwrap_or_default();
            use_event(Event {
                stamp_ns: u64::try_from(since.as_nanos()).unwrap_or(u64::MAX),
                class: Class::of(event.event_type().raw()),
                code: event.raw_code(),
                value: event.raw_value(),
            });
        }
        Ok(())
    }

    /// The whole state.
    ///
    /// # Errors
    ///
    /// The device is gone.
    pub fn state(&self) -> io::Result<DeviceState> {
        let held = self.evdev.key_state()?.iter().map(Key::raw).collect();
        let has = self.evdev.supported_abs_axes()?;
        let mut axes = Vec::new();
        for code in [ABS_X, ABS_Y, ABS_PRESSURE, ABS_TILT_X, ABS_TILT_Y] {
            let axis = Abs::from_raw(code);
            if has.contains(axis) {
                axes.push((code, self.evdev.abs_info(axis)?.raw_value()));
            }
        }
        Ok(DeviceState { axes, held })
    }
}

fn kind(device: &Evdev) -> io::Result<Option<DeviceKind>> {
    let (keys, axes, rel) =
        (device.supported_keys()?, device.supported_abs_axes()?, device.supported_rel_axes()?);
    let key = |code| keys.contains(Key::from_raw(code));
    let positions = axes.contains(Abs::X) && axes.contains(Abs::Y);
    let moves = rel.contains(Rel::from_raw(REL_X)) && rel.contains(Rel::from_raw(REL_Y));
    Ok(if positions && key(BTN_TOOL_PEN) {
        Some(DeviceKind::Pen)
    } else if positions && key(BTN_TOUCH) {
        Some(DeviceKind::Touch)
    } else if moves && key(BTN_LEFT) {
        Some(DeviceKind::Mouse)
    } else {
        None
    })
}

/// The size that the device tells \[mm\]; `None`: it tells none that can be.
fn reported_size_mm(device: &Evdev) -> io::Result<Option<[f64; 2]>> {
    let size = |axis| -> io::Result<f64> {
        let info = device.abs_info(axis)?;
        let range = f64::from(info.maximum()) - f64::from(info.minimum());
        Ok(range / f64::from(info.resolution()))
    };
    let axes = device.supported_abs_axes()?;
    if !(axes.contains(Abs::X) && axes.contains(Abs::Y)) {
        return Ok(None);
    }
    let reported = [size(Abs::X)?, size(Abs::Y)?];
    Ok(reported.iter().all(|mm| SIZE_MM.contains(mm)).then_some(reported))
}

/// The geometry; the inner error tells what the device says of its size.
fn absolute(
    device: &Evdev,
    kind: DeviceKind,
    size_mm: Option<[f64; 2]>,
) -> io::Result<Result<Geometry, String>> {
    let (x, y) = (device.abs_info(Abs::X)?, device.abs_info(Abs::Y)?);
    let Some([width, height]) = size_mm.or(reported_size_mm(device)?) else {
        return Ok(Err(format!(
            "resolution {} and {} units/mm over {} and {} units",
            x.resolution(),
            y.resolution(),
            i64::from(x.maximum()) - i64::from(x.minimum()),
            i64::from(y.maximum()) - i64::from(y.minimum()),
        )));
    };
    let axis = |info: &evdevil::AbsInfo, mm: f64| {
        let (low, high) = (f64::from(info.minimum()), f64::from(info.maximum()));
        // A range of nothing was refused with its size, unless the user gave one.
        Axis { middle: 0.5 * (low + high), per_unit: mm * 1e-3 / (high - low).max(1.0) }
    };
    let axes = device.supported_abs_axes()?;
    let has = |axis| axes.contains(axis);
    let pressure = has(Abs::PRESSURE).then(|| device.abs_info(Abs::PRESSURE)).transpose()?;
    let pressure = pressure.and_then(|info| Pressure::new(info.minimum(), info.maximum()));
    let tilt = |axis| -> io::Result<Axis> {
        let resolution = device.abs_info(axis)?.resolution();
        // Units per radian; drivers that tell none mean degrees.
        let per_unit = if resolution > 0 { 1.0 / f64::from(resolution) } else { 1_f64.to_radians() };
        Ok(Axis { middle: 0.0, per_unit })
    };
    let tilted = has(Abs::TILT_X) && has(Abs::TILT_Y);
    let tilt = if tilted { Some([tilt(Abs::TILT_X)?, tilt(Abs::TILT_Y)?]) } else { None };
    Ok(Ok(Geometry::Absolute {
        x: axis(&x, width),
        y: axis(&y, height),
        pressure,
        tilt,
        tools: kind == DeviceKind::Pen,
        touch: device.supported_keys()?.contains(Key::from_raw(BTN_TOUCH)),
    }))
}
