//! Pens that send forged samples.

use std::error::Error;
use std::f64::consts::TAU;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use foretrace_shm::{Header, PenSample, host_boot_id, monotonic_now_ns, pen_flags};
use serde_json::{Value, json};

use super::{Forge, boot, earlier, later, pace};

/// What a pen forges.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    /// Nothing.
    Honest,
    /// Numbers, between valid samples.
    Values,
    /// Numbers, always.
    Poison,
    /// Headers and stamps, between valid samples.
    Headers,
    /// The clock: the time of day.
    WallClock,
    /// The unit: pixels.
    Pixels,
    /// How many there are: 20 000 per second.
    Flood,
    /// Each sample is valid, the sequence is not: noise as fast as the gate for jumps allows, jumps across
    /// the device.
    Mad,
}

const FLOOD_PER_MS: u64 = 20;

impl Kind {
    pub(super) fn from_word(word: &str) -> Option<Self> {
        Some(match word {
            "honest" => Self::Honest,
            "values" => Self::Values,
            "poison" => Self::Poison,
            "headers" => Self::Headers,
            "wall-clock" => Self::WallClock,
            "pixels" => Self::Pixels,
            "flood" => Self::Flood,
            "mad" => Self::Mad,
            _ => return None,
        })
    }
}

/// The pen's own clock and count.
struct Pen {
    sequence: u64,
    begin_ns: u64,
    random: u64,
}

impl Pen {
    /// On a circle of 3 cm, one turn per second.
    fn sample(&self, stamp_ns: u64) -> PenSample {
        let angle = TAU * (stamp_ns - self.begin_ns) as f64 * 1e-9;
        PenSample {
            header: Header { sequence: self.sequence + 1, stamp_ns, boot_id: host_boot_id() },
            device_stamp_ns: stamp_ns,
            x_m: 0.03 * angle.cos(),
            y_m: 0.03 * angle.sin(),
            pressure: 0.5,
            flags: pen_flags::CONTACT | pen_flags::IN_RANGE,
            ..PenSample::default()
        }
    }

    /// Uniform in [-1, 1]: a linear congruential generator (Knuth, MMIX).
    fn noise(&mut self) -> f64 {
        self.random =
            self.random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.random >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    }
}

/// Sends for `time`; returns how many of what.
pub(super) fn forge(
    forge: &mut Forge<PenSample>,
    kind: Kind,
    time: Duration,
) -> Result<Value, Box<dyn Error>> {
    let begin = Instant::now();
    let mut pen = Pen { sequence: 0, begin_ns: monotonic_now_ns(), random: 1 };
    let period_ns = if kind == Kind::Flood { 1_000_000 } else { 5_000_000 };
    for turn in 0.. {
        pace(begin, turn * period_ns);
        if begin.elapsed() >= time {
            break;
        }
        for _ in 0..if kind == Kind::Flood { FLOOD_PER_MS } else { 1 } {
            let good = pen.sample(monotonic_now_ns());
            if kind != Kind::Poison {
                let (what, sample) = match kind {
                    Kind::Mad => mad(&mut pen, turn, good),
                    Kind::WallClock => ("wall clock", wall_clock(good)?),
                    Kind::Pixels => ("pixels", PenSample { x_m: 2e4 * good.x_m + 960.0, y_m: 540.0, ..good }),
                    _ => ("good", good),
                };
                pen.sequence += 1;
                forge.send(what, sample)?;
            }
            match kind {
                Kind::Values | Kind::Poison => bad_value(forge, &mut pen, turn)?,
                Kind::Headers => bad_header(forge, &mut pen, turn)?,
                Kind::Honest | Kind::Flood | Kind::Mad | Kind::WallClock | Kind::Pixels => {}
            }
        }
    }
    Ok(json!(forge.sent))
}

/// Stamped by the time of day, as `SystemTime` gives it.
fn wall_clock(good: PenSample) -> Result<PenSample, Box<dyn Error>> {
    let stamp_ns = u64::try_from(SystemTime::now().duration_since(UNIX_EPOCH)?.as_nanos())?;
    Ok(PenSample { header: Header { stamp_ns, ..good.header }, device_stamp_ns: stamp_ns, ..good })
}

fn mad(pen: &mut Pen, turn: u64, good: PenSample) -> (&'static str, PenSample) {
    let (x, y) = (pen.noise(), pen.noise());
    match turn % 100 {
        // Legal on the wire, far outside the device.
        50 => ("far", PenSample { x_m: 9.9, y_m: -9.9, ..good }),
        60..65 => ("jump", PenSample { x_m: 0.4 * x.signum(), y_m: 0.4 * y.signum(), ..good }),
        _ => ("noise", PenSample { x_m: good.x_m + 4e-3 * x, y_m: good.y_m + 4e-3 * y, ..good }),
    }
}

/// A valid header with invalid numbers.
fn bad_value(forge: &mut Forge<PenSample>, pen: &mut Pen, turn: u64) -> Result<(), Box<dyn Error>> {
    let good = pen.sample(monotonic_now_ns());
    pen.sequence += 1;
    let bad = [
        PenSample { x_m: f64::NAN, ..good },
        PenSample { y_m: f64::INFINITY, ..good },
        PenSample { x_m: f64::NEG_INFINITY, ..good },
        PenSample { y_m: 1e300, ..good },
        PenSample { x_m: -10.1, ..good },
        PenSample { pressure: f32::NAN, ..good },
        PenSample { pressure: 2.0, ..good },
        PenSample { tilt_x_rad: 1e30, ..good },
        PenSample { tilt_y_rad: f32::INFINITY, ..good },
        PenSample { flags: 1 << 20, ..good },
    ];
    forge.send("bad", bad[turn as usize % bad.len()])
}

/// Valid numbers with an invalid header or device stamp.
fn bad_header(forge: &mut Forge<PenSample>, pen: &mut Pen, turn: u64) -> Result<(), Box<dyn Error>> {
    let now_ns = monotonic_now_ns();
    let good = pen.sample(now_ns);
    // A refused header is not remembered: the next valid sample has the same number.
    match turn % 8 {
        0 => forge.send("foreign boot", PenSample { header: boot(good.header), ..good }),
        1 => forge.send("future", PenSample { header: later(good.header), ..good }),
        2 => forge.send("backwards", PenSample { header: earlier(good.header), ..good }),
        3 => {
            let header = Header { sequence: pen.sequence.saturating_sub(3), ..earlier(good.header) };
            forge.send("replayed", PenSample { header, ..good })
        }
        4 => {
            pen.sequence += 5;
            *forge.sent.entry("left out").or_default() += 5;
            Ok(())
        }
        5 => {
            pen.sequence += 1;
            forge.send("device back", PenSample { device_stamp_ns: now_ns - 500_000_000, ..good })
        }
        6 => {
            pen.sequence += 1;
            forge.send("device future", PenSample { device_stamp_ns: now_ns + 500_000_000, ..good })
        }
        _ => Ok(()),
    }
}
