//! Tablet reader: sends the pen of a Linux input device, or of lines on standard input.
//!
//! `cargo run -p foretrace-client --example tablet_reader -- /dev/input/event7 [UNITS_PER_MM] [INSTANCE]`
//! `… tablet_reader -- -` reads lines `x_m y_m contact`, each stamped when it is read.
//!
//! Positions of the device are divided by its resolution (most pen tablets: 100 units per millimetre;
//! `evtest` shows it). The kernel stamps events with wall time; it is mapped to the monotonic clock through
//! the difference of both at the moment of reading, so that the event's time in the queue is accounted for.

use std::fs::File;
use std::io::{BufRead, Read};
use std::process::ExitCode;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use foretrace_client::wire::pen_flags;
use foretrace_client::{FeedError, Foretrace, Instance, PenFeed, PenReading, monotonic_now_ns};

// Numbers of linux/input-event-codes.h.
const EV_SYN: u16 = 0;
const EV_KEY: u16 = 1;
const EV_ABS: u16 = 3;
const SYN_REPORT: u16 = 0;
const ABS_X: u16 = 0;
const ABS_Y: u16 = 1;
const BTN_TOOL_PEN: u16 = 0x140;
const BTN_TOUCH: u16 = 0x14a;
const BTN_STYLUS: u16 = 0x14b;
/// `struct input_event` of a 64-bit kernel: seconds, microseconds (i64), type, code (u16), value (i32).
const EVENT_BYTES: usize = 24;

fn main() -> ExitCode {
    match run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("{error}");
            ExitCode::FAILURE
        }
    }
}

fn run() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let device = arguments.next().ok_or("which device? give /dev/input/eventN, or - for standard input")?;
    let units_per_mm: f64 = arguments.next().map_or(Ok(100.0), |text| text.parse())?;
    let number = arguments.next().map_or(Ok(0), |text| text.parse())?;

    let foretrace = Foretrace::attach_within(&Instance::new(number)?, Duration::from_secs(2))?;
    let feed = foretrace.pen_feed()?;
    if device == "-" { read_lines(feed) } else { read_device(feed, &device, units_per_mm * 1e3) }
}

fn read_lines(mut feed: PenFeed) -> Result<(), Box<dyn std::error::Error>> {
    for line in std::io::stdin().lock().lines() {
        let line = line?;
        let fields: Vec<f64> = line.split_whitespace().map(str::parse).collect::<Result<_, _>>()?;
        let &[x_m, y_m, contact] = fields.as_slice() else {
            return Err(format!("`{line}`: three numbers are needed: x_m y_m contact").into());
        };
        let device_stamp_ns = monotonic_now_ns();
        send(
            &mut feed,
            PenReading { device_stamp_ns, x_m, y_m, contact: contact != 0.0, ..Default::default() },
        )?;
    }
    Ok(())
}

fn read_device(mut feed: PenFeed, path: &str, units_per_m: f64) -> Result<(), Box<dyn std::error::Error>> {
    let mut device =
        File::open(path).map_err(|error| format!("{path}: {error} (member of group `input`?)"))?;
    let mut reading = PenReading::default();
    let mut in_range = false;
    let mut event = [0; EVENT_BYTES];
    loop {
        device.read_exact(&mut event)?;
        let [seconds, micros] = [0, 8].map(|at| u64::from_ne_bytes(std::array::from_fn(|i| event[at + i])));
        let [kind, code] = [16, 18].map(|at| u16::from_ne_bytes([event[at], event[at + 1]]));
        let value = i32::from_ne_bytes(std::array::from_fn(|i| event[20 + i]));
        match (kind, code) {
            (EV_ABS, ABS_X) => reading.x_m = f64::from(value) / units_per_m,
            // A tablet counts downwards, towards the writer.
            (EV_ABS, ABS_Y) => reading.y_m = -f64::from(value) / units_per_m,
            (EV_KEY, BTN_TOUCH) => reading.contact = value != 0,
            (EV_KEY, BTN_TOOL_PEN) => in_range = value != 0,
            (EV_KEY, BTN_STYLUS) => reading.more_flags = if value != 0 { pen_flags::BUTTON_1 } else { 0 },
            (EV_SYN, SYN_REPORT) if in_range || reading.contact => {
                let happened = Duration::from_secs(seconds) + Duration::from_micros(micros);
                let waited = SystemTime::now().duration_since(UNIX_EPOCH + happened).unwrap_or_default();
                reading.device_stamp_ns = monotonic_now_ns().saturating_sub(waited.as_nanos() as u64);
                let near = if in_range { pen_flags::IN_RANGE } else { 0 };
                send(&mut feed, PenReading { more_flags: reading.more_flags | near, ..reading })?;
            }
            _ => {}
        }
    }
}

/// A single bad reading must not end the session: report it and go on.
fn send(feed: &mut PenFeed, reading: PenReading) -> Result<(), FeedError> {
    match feed.send(reading) {
        Ok(true) => Ok(()),
        Ok(false) => {
            eprintln!("no daemon receives the pen; is it up?");
            Ok(())
        }
        Err(FeedError::Invalid(why)) => {
            eprintln!("reading left out: {why}");
            Ok(())
        }
        Err(error) => Err(error),
    }
}
