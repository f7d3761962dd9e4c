//! The decoder on recorded lists of events: `seconds.micros type code value`, as the kernel tells them.

use super::*;

/// A pen tablet of 216 x 135 mm at 100 units per mm, with 8192 levels and tilt in degrees.
fn tablet() -> Geometry {
    let degrees = std::f64::consts::PI / 180.0;
    Geometry::Absolute {
        x: Axis { middle: 10_800.0, per_unit: 1e-5 },
        y: Axis { middle: 6_750.0, per_unit: 1e-5 },
        pressure: Pressure::new(0, 8191),
        tilt: Some([Axis { middle: 0.0, per_unit: degrees }; 2]),
        tools: true,
        touch: true,
    }
}

fn events(list: &str) -> Vec<Event> {
    let lines = list.lines().map(str::trim).filter(|line| !line.is_empty());
    lines
        .map(|line| {
            let (stamp, rest) = line.split_once(' ').unwrap();
            let (seconds, micros) = stamp.split_once('.').unwrap();
            let numbers: Vec<i64> = rest.split(' ').map(|word| word.parse().unwrap()).collect();
            let stamp_us = seconds.parse::<u64>().unwrap() * 1_000_000 + micros.parse::<u64>().unwrap();
            Event {
                stamp_ns: stamp_us * 1000,
                class: Class::of(numbers[0] as u16),
                code: numbers[1] as u16,
                value: numbers[2] as i32,
            }
        })
        .collect()
}

fn decode(decoder: &mut Decoder, list: &str) -> Vec<Decoded> {
    let told = events(list).into_iter().map(|event| decoder.take(event));
    told.filter(|decoded| *decoded != Decoded::Nothing).collect()
}

fn readings(told: &[Decoded]) -> Vec<PenReading> {
    told.iter()
        .filter_map(|decoded| match decoded {
            Decoded::Reading(reading) => Some(*reading),
            _ => None,
        })
        .collect()
}

const STROKE: &str = "
    12.000000 1 320 1
    12.000000 3 0 10800
    12.000000 3 1 6750
    12.000000 3 26 30
    12.000000 3 27 -45
    12.000000 0 0 0
    12.005000 3 0 11800
    12.005000 1 330 1
    12.005000 3 24 8191
    12.005000 0 0 0
    12.010000 3 1 5750
    12.010000 1 331 1
    12.010000 0 0 0
    12.015000 1 330 0
    12.015000 3 24 0
    12.015000 1 331 0
    12.015000 0 0 0
    12.020000 1 320 0
    12.020000 0 0 0
    12.025000 3 40 7
    12.025000 0 0 0
";

#[test]
fn a_stroke_comes_in_metres_from_the_middle_with_hover_contact_tilt_and_buttons() {
    let mut decoder = Decoder::new(tablet());
    let told = decode(&mut decoder, STROKE);
    let [hover, down, button, up] = readings(&told)[..] else { panic!("{told:?}") };
    assert_eq!(
        (hover.x_m, hover.y_m, hover.contact, hover.device_stamp_ns),
        (0.0, 0.0, false, 12_000_000_000)
    );
    assert_eq!(hover.more_flags, pen_flags::IN_RANGE);
    // To the right by 10 mm, then away from the writer by 10 mm.
    assert!((down.x_m - 0.01).abs() < 1e-12 && down.contact && down.pressure == Some(1.0));
    assert!((button.y_m - 0.01).abs() < 1e-12, "{button:?}");
    assert_eq!(button.more_flags, pen_flags::IN_RANGE | pen_flags::BUTTON_1);
    let [tilt_x, tilt_y] = down.tilt_rad.unwrap();
    let degrees = [tilt_x, tilt_y].map(f32::to_degrees);
    assert!((degrees[0] - 30.0).abs() < 1e-3 && (degrees[1] - 45.0).abs() < 1e-3);
    assert!(!up.contact && up.pressure == Some(0.0));
    assert_eq!(told.last(), Some(&Decoded::Gone { stamp_ns: 12_020_000_000 }));
}

#[test]
fn the_eraser_end_is_reported() {
    let list = "1.000000 1 321 1
        1.000000 3 0 10800
        1.000000 3 1 6750
        1.000000 0 0 0";
    let told = decode(&mut Decoder::new(tablet()), list);
    assert_eq!(readings(&told)[0].more_flags, pen_flags::IN_RANGE | pen_flags::ERASER);
}

#[test]
fn nothing_is_reported_of_a_place_that_is_not_known() {
    let list = "1.000000 1 320 1
        1.000000 3 0 10800
        1.000000 0 0 0";
    assert_eq!(decode(&mut Decoder::new(tablet()), list), []);
}

#[test]
fn lost_events_are_forgotten_with_what_follows_and_the_state_is_asked_for() {
    let mut decoder = Decoder::new(tablet());
    decode(&mut decoder, STROKE);
    let list = "13.000000 1 320 1
        13.000000 0 3 0
        13.000000 3 0 999
        13.000000 1 330 1
        13.000000 0 0 0";
    assert_eq!(decode(&mut decoder, list), [Decoded::Lost]);
    let state = DeviceState { axes: vec![(ABS_X, 11_800), (ABS_Y, 6_750)], held: vec![BTN_TOOL_PEN] };
    let Decoded::Reading(reading) = decoder.resync(&state, 13_001_000_000) else { panic!("in range") };
    assert_eq!((reading.contact, reading.device_stamp_ns), (false, 13_001_000_000));
    assert!((reading.x_m - 0.01).abs() < 1e-12);
    // The pen was lifted away while events were lost.
    let list = "14.000000 0 3 0
        14.000000 0 0 0";
    assert_eq!(decode(&mut decoder, list), [Decoded::Lost]);
    let gone = decoder.resync(&DeviceState::default(), 14_000_500_000);
    assert_eq!(gone, Decoded::Gone { stamp_ns: 14_000_500_000 });
}

#[test]
fn without_a_contact_button_pressure_is_contact() {
    let Geometry::Absolute { x, y, pressure, tilt, tools, .. } = tablet() else { unreachable!() };
    let mut decoder = Decoder::new(Geometry::Absolute { x, y, pressure, tilt, tools, touch: false });
    let list = "1.000000 1 320 1
        1.000000 3 0 10800
        1.000000 3 1 6750
        1.000000 0 0 0
        1.005000 3 24 500
        1.005000 0 0 0";
    let contacts: Vec<bool> = readings(&decode(&mut decoder, list)).iter().map(|r| r.contact).collect();
    assert_eq!(contacts, [false, true]);
}

#[test]
fn a_touchscreen_is_in_range_while_it_is_touched() {
    let axis = Axis { middle: 500.0, per_unit: 1e-4 };
    let mut decoder = Decoder::new(Geometry::Absolute {
        x: axis,
        y: axis,
        pressure: None,
        tilt: None,
        tools: false,
        touch: true,
    });
    let list = "1.000000 3 0 600
        1.000000 3 1 500
        1.000000 1 330 1
        1.000000 0 0 0
        1.010000 1 330 0
        1.010000 0 0 0";
    let told = decode(&mut decoder, list);
    assert_eq!(told.last(), Some(&Decoded::Gone { stamp_ns: 1_010_000_000 }));
    let reading = readings(&told)[0];
    assert!(reading.contact && reading.pressure.is_none() && (reading.x_m - 0.01).abs() < 1e-12);
}

#[test]
fn a_mouse_adds_up_and_writes_with_its_left_button() {
    let mut decoder = Decoder::new(Geometry::Relative { per_count_m: 1e-4 });
    let list = "1.000000 2 0 50
        1.000000 2 1 -20
        1.000000 0 0 0
        1.008000 1 272 1
        1.008000 2 0 50
        1.008000 0 0 0";
    let told = readings(&decode(&mut decoder, list));
    assert!((told[1].x_m - 0.01).abs() < 1e-12 && (told[1].y_m - 0.002).abs() < 1e-12);
    assert!(!told[0].contact && told[1].contact);
}

#[test]
fn whatever_events_come_readings_are_finite_and_only_of_pens_in_range() {
    // xorshift64*: the same events in every run.
    let mut state = 0x007a_b1e7_u64;
    let mut dice = || {
        state ^= state >> 12;
        state ^= state << 25;
        state ^= state >> 27;
        state.wrapping_mul(0x2545_f491_4f6c_dd1d)
    };
    for geometry in [tablet(), Geometry::Relative { per_count_m: 1e-4 }] {
        let (mut decoder, mut told) = (Decoder::new(geometry), 0);
        for stamp_ns in 0..100_000 {
            let class = Class::of((dice() >> 61) as u16);
            let code = match (class, dice() >> 62) {
                (Class::Syn, any) => any as u16,
                (_, 0) => (dice() >> 48) as u16,
                (_, 1) => 0x140 + (dice() >> 60) as u16,
                _ => (dice() >> 59) as u16,
            };
            let value = if dice() >> 63 == 0 { (dice() >> 32) as i32 } else { (dice() >> 62) as i32 };
            match decoder.take(Event { stamp_ns, class, code, value }) {
                Decoded::Reading(reading) => {
                    told += 1;
                    assert!(reading.x_m.is_finite() && reading.y_m.is_finite());
                    assert!(reading.pressure.is_none_or(|share| (0.0..=1.0).contains(&share)));
                    assert_ne!(reading.more_flags & pen_flags::IN_RANGE, 0);
                }
                Decoded::Lost => {
                    decoder.resync(&DeviceState::default(), stamp_ns);
                }
                _ => {}
            }
        }
        assert!(told > 100, "{told}");
    }
}
