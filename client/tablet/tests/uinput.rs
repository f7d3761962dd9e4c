//! Virtual pens through the real kernel, where /dev/uinput can be opened; skipped, and said so, elsewhere.

use std::io::{self, Write};
use std::time::{Duration, Instant};

use evdevil::AbsInfo;
use evdevil::event::{Abs, AbsEvent, InputEvent, Key, KeyEvent, KeyState};
use evdevil::uinput::{AbsSetup, UinputDevice};
use foretrace_client::{PenReading, monotonic_now_ns};
use foretrace_tablet::{Decoded, Decoder, Device, DeviceKind, Input, ListedDevice, TabletReader, list};

const PATIENCE: Duration = Duration::from_secs(10);

/// A pen tablet of 216 by 135 mm; none where there is no uinput.
fn tablet(name: &str) -> Option<UinputDevice> {
    let axis =
        |abs, maximum, resolution| AbsSetup::new(abs, AbsInfo::new(0, maximum).with_resolution(resolution));
    let build = || -> io::Result<UinputDevice> {
        UinputDevice::builder()?
            .with_keys([Key::BTN_TOOL_PEN, Key::BTN_TOUCH, Key::BTN_STYLUS])?
            .with_abs_axes([
                axis(Abs::X, 21_600, 100),
                axis(Abs::Y, 13_500, 100),
                axis(Abs::PRESSURE, 8191, 0),
            ])?
            .build(name)
    };
    build()
        .map_err(|error| {
            let reported = format!("skipped: a virtual tablet needs /dev/uinput: {error}\n");
            // Not captured by the test runner.
            let _ = io::stderr().write_all(reported.as_bytes());
        })
        .ok()
}

/// The device as it is listed, which takes the system a moment.
fn listed(name: &str) -> ListedDevice {
    let deadline = Instant::now() + PATIENCE;
    loop {
        let found = list().unwrap().devices.into_iter().find(|device| device.name == name);
        if let Some(device) = found {
            return device;
        }
        assert!(Instant::now() < deadline, "{name} is not listed");
        std::thread::sleep(Duration::from_millis(20));
    }
}

fn key(key: Key, pressed: bool) -> InputEvent {
    KeyEvent::new(key, if pressed { KeyState::PRESSED } else { KeyState::RELEASED }).into()
}

fn place(x: i32, y: i32, pressure: i32) -> [InputEvent; 3] {
    [(Abs::X, x), (Abs::Y, y), (Abs::PRESSURE, pressure)].map(|(abs, value)| AbsEvent::new(abs, value).into())
}

fn next(reader: &TabletReader) -> Decoded {
    match reader.next(PATIENCE) {
        Input::Decoded(decoded) => decoded,
        other => panic!("{other:?}"),
    }
}

/// The next reading with this contact. The state at the start may come before the events that led to it.
fn reading(reader: &TabletReader, contact: bool) -> PenReading {
    loop {
        match next(reader) {
            Decoded::Reading(reading) if reading.contact == contact => return reading,
            Decoded::Reading(_) => {}
            other => panic!("{other:?}"),
        }
    }
}

#[test]
fn a_stroke_comes_through_the_kernel_with_its_place_its_contact_and_monotonic_stamps() {
    let Some(pen) = tablet("foretrace test pen") else { return };
    let found = listed("foretrace test pen");
    assert_eq!((found.kind, found.size_mm), (DeviceKind::Pen, Some([216.0, 135.0])));
    let reader = TabletReader::start(Device::open(&found.path, None, false).unwrap()).unwrap();
    let before = monotonic_now_ns();
    pen.write_events(&[&[key(Key::BTN_TOOL_PEN, true)][..], &place(10_800, 6_750, 0)].concat()).unwrap();
    let hover = reading(&reader, false);
    assert!(hover.x_m.abs() < 1e-9 && hover.y_m.abs() < 1e-9 && !hover.contact);
    pen.write_events(&[&[key(Key::BTN_TOUCH, true)][..], &place(11_800, 5_750, 8191)].concat()).unwrap();
    let down = reading(&reader, true);
    assert!((down.x_m - 0.01).abs() < 1e-9 && (down.y_m - 0.01).abs() < 1e-9 && down.contact, "{down:?}");
    let stamps = [before, hover.device_stamp_ns, down.device_stamp_ns, monotonic_now_ns()];
    // The kernel stamps in microseconds.
    assert!(stamps.windows(2).all(|pair| pair[0] <= pair[1] + 1000), "{stamps:?}");
    pen.write_events(&[key(Key::BTN_TOUCH, false), key(Key::BTN_TOOL_PEN, false)]).unwrap();
    assert!(matches!(next(&reader), Decoded::Gone { .. }));
}

#[test]
fn an_unplugged_tablet_is_reported_and_found_again() {
    let name = "foretrace test unplugged";
    let Some(pen) = tablet(name) else { return };
    let reader = TabletReader::start(Device::open(&listed(name).path, None, false).unwrap()).unwrap();
    drop(pen);
    assert!(matches!(reader.next(PATIENCE), Input::Unplugged));
    let Some(_pen) = tablet(name) else { panic!("uinput was there a moment ago") };
    Device::open(&listed(name).path, None, false).unwrap();
}

#[test]
fn events_that_the_kernel_drops_are_noticed_and_the_state_is_asked_for() {
    let name = "foretrace test dropped";
    let Some(pen) = tablet(name) else { return };
    let device = Device::open(&listed(name).path, None, false).unwrap();
    pen.write_events(&[key(Key::BTN_TOOL_PEN, true), key(Key::BTN_TOUCH, true)]).unwrap();
    // Nobody reads meanwhile, as when a program stands still.
    for step in 0..5000 {
        pen.write_events(&place(step, 13_500 - step, step)).unwrap();
    }
    let (mut decoder, mut lost) = (Decoder::new(device.geometry()), 0);
    while lost == 0 {
        device.read(|event| lost += u32::from(decoder.take(event) == Decoded::Lost)).unwrap();
    }
    let Decoded::Reading(reading) = decoder.resync(&device.state().unwrap(), monotonic_now_ns()) else {
        panic!("the pen is on the tablet");
    };
    assert!((reading.x_m - (4999.0 - 10_800.0) * 1e-5).abs() < 1e-9 && reading.contact, "{reading:?}");
}

#[test]
fn two_tablets_are_both_listed() {
    let (Some(_one), Some(_two)) = (tablet("foretrace test one"), tablet("foretrace test two")) else {
        return;
    };
    assert_ne!(listed("foretrace test one").path, listed("foretrace test two").path);
}
