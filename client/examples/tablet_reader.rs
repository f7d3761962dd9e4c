//! Tablet reader: sends the pen of a Linux input device, or of lines on standard input.
//!
//! `cargo run -p foretrace-client --example tablet_reader -- /dev/input/event7 [UNITS_PER_MM] [INSTANCE]`
//! `… tablet_reader -- -` reads lines `x_m y_m contact`, each stamped when it is read; the pen rests there
//! until the next line.
//!
//! It needs `foretrace daemon`, and that nobody else holds the pen (`foretrace tablet`, `foretrace play`). It
//! goes on with the next daemon when that one ends, repeats a pen at rest, and gives way to whoever asks for
//! the pen.
//!
//! Positions of the device are divided by its resolution (most pen tablets: 100 units per millimetre;
//! `evtest` shows it). The kernel stamps events with wall time; it is mapped to the monotonic clock through
//! the difference of both at the moment of reading, so that the event's time in the queue is accounted for.

use std::error::Error;
use std::fs::File;
use std::io::{BufRead, Read};
use std::process::ExitCode;
use std::sync::mpsc::{self, Receiver, RecvTimeoutError, Sender};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use foretrace_client::wire::pen_flags;
use foretrace_client::{FeedError, Foretrace, Instance, Lasting, PenFeed, PenReading, monotonic_now_ns};

/// A pen at rest is sent again after this time: silence means that it is gone.
const REPEAT: Duration = Duration::from_millis(20);
/// A repeated reading is stamped this long ago \[ns\], so that an event which is still on its way stays later
/// than it.
const MARGIN_NS: u64 = 5_000_000;

/// What the device says: a reading, or none where the pen left its range. An error ends the program.
type Told = Result<Option<PenReading>, String>;

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

fn run() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let device = arguments.next().ok_or("which device? give /dev/input/eventN, or - for standard input")?;
    let units_per_mm: f64 = arguments.next().map_or(Ok(100.0), |text| text.parse())?;
    let number = arguments.next().map_or(Ok(0), |text| text.parse())?;

    let foretrace = Foretrace::attach_within(&Instance::new(number)?, Duration::from_secs(2))?;
    let feed = foretrace.pen_feed()?;
    let (tell, told) = mpsc::channel();
    // Devices say nothing while the pen rests, and reading waits. The feed stays in the thread that made it.
    std::thread::spawn(move || {
        let read = match device.as_str() {
            "-" => read_lines(&tell),
            path => read_device(path, units_per_mm * 1e3, &tell),
        };
        if let Err(error) = read {
            // The receiver may be gone.
            let _ = tell.send(Err(error.to_string()));
        }
    });
    lead(Lasting::new(foretrace, feed), &told)
}

/// Sends what the device says, until it ends or somebody takes the pen over.
fn lead(mut pen: Lasting<PenFeed>, told: &Receiver<Told>) -> Result<(), Box<dyn Error>> {
    let mut newest: Option<PenReading> = None;
    let (mut last_ns, mut heard) = (0, true);
    loop {
        match told.recv_timeout(REPEAT) {
            Ok(reading) => newest = reading?,
            Err(RecvTimeoutError::Timeout) => {
                if let Some(reading) = &mut newest {
                    reading.device_stamp_ns = monotonic_now_ns().saturating_sub(MARGIN_NS);
                }
            }
            Err(RecvTimeoutError::Disconnected) => return Ok(()),
        }
        // A few times per second: is the daemon gone, back, or another?
        match pen.look(Foretrace::pen_feed) {
            (_, Some(error)) => eprintln!("{error}"),
            (change, None) => {
                if let Some(words) = change.words("waiting for the next") {
                    eprintln!("{words}");
                }
            }
        }
        // None while the next daemon's could not be made.
        let Some(feed) = &mut pen.handle else { continue };
        if let Some(asker) = feed.handed_to() {
            return Err(format!("the pen went to {asker}").into());
        }
        let Some(mut reading) = newest else { continue };
        // The daemon refuses a stamp that is not later than the one before.
        reading.device_stamp_ns = reading.device_stamp_ns.max(last_ns + 1);
        last_ns = reading.device_stamp_ns;
        match feed.send(reading) {
            Ok(now_heard) => {
                if heard && !now_heard {
                    eprintln!("no daemon receives the pen");
                }
                heard = now_heard;
            }
            // The next round says to whom.
            Err(FeedError::HandedOver) => {}
            // A single bad reading must not end the session; it is not repeated either.
            Err(error) => {
                eprintln!("reading left out: {error}");
                newest = None;
            }
        }
    }
}

fn read_lines(tell: &Sender<Told>) -> Result<(), Box<dyn Error>> {
    for line in std::io::stdin().lock().lines() {
        let line = line?;
        let device_stamp_ns = monotonic_now_ns();
        let fields: Vec<f64> = line.split_whitespace().map(str::parse).collect::<Result<_, _>>()?;
        let &[x_m, y_m, contact] = fields.as_slice() else {
            return Err(format!("`{line}`: three numbers are needed: x_m y_m contact").into());
        };
        let contact = contact != 0.0;
        tell.send(Ok(Some(PenReading { device_stamp_ns, x_m, y_m, contact, ..Default::default() })))?;
    }
    Ok(())
}

fn read_device(path: &str, units_per_m: f64, tell: &Sender<Told>) -> Result<(), Box<dyn Error>> {
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
                tell.send(Ok(Some(PenReading { more_flags: reading.more_flags | near, ..reading })))?;
            }
            // Out of range: the pen falls silent.
            (EV_SYN, SYN_REPORT) => tell.send(Ok(None))?,
            _ => {}
        }
    }
}
