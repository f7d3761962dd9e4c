//! Events of a device into pen readings.
//!
//! Contract: pure, no allocation. A reading is made at the end of a group of events, of a pen that is in
//! range, and once more when it leaves. After lost events nothing is believed until the whole state came
//! again. Positions are metres from the middle of the active area, x to the right, y away from the writer.

use foretrace_client::PenReading;
use foretrace_client::wire::pen_flags;

use crate::event::{
    ABS_PRESSURE, ABS_TILT_X, ABS_TILT_Y, ABS_X, ABS_Y, BTN_LEFT, BTN_MIDDLE, BTN_RIGHT, BTN_STYLUS,
    BTN_STYLUS2, BTN_STYLUS3, BTN_TOOL_AIRBRUSH, BTN_TOOL_BRUSH, BTN_TOOL_PEN, BTN_TOOL_PENCIL,
    BTN_TOOL_RUBBER, BTN_TOUCH, Class, Event, REL_X, REL_Y, SYN_DROPPED, SYN_REPORT,
};
use crate::pressure::Pressure;

/// A device without a contact button touches from this share of its pressure on.
const TOUCH_SHARE: f32 = 0.02;

#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Axis {
    /// Middle of its range.
    pub middle: f64,
    /// Metres per unit; radians for a tilt.
    pub per_unit: f64,
}

impl Axis {
    fn of(self, value: i32) -> f64 {
        (f64::from(value) - self.middle) * self.per_unit
    }
}

/// How a device tells its pen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Geometry {
    /// A pen tablet, or a touchscreen (`tools` false): it says where the tip is.
    Absolute {
        x: Axis,
        y: Axis,
        /// Where the device tells pressure.
        pressure: Option<Pressure>,
        /// Tilt towards x and towards the writer, where the device tells it.
        tilt: Option<[Axis; 2]>,
        /// It tells whether a pen is in range.
        tools: bool,
        /// It has a button for contact.
        touch: bool,
    },
    /// A mouse: it says how far it moved.
    Relative { per_count_m: f64 },
}

/// The buttons that count, as bits.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
struct Buttons(u16);

const TOOLS: u16 = 1;
const RUBBER: u16 = 1 << 1;
const TOUCH: u16 = 1 << 2;
const STYLUS: [u16; 3] = [1 << 3, 1 << 4, 1 << 5];
const LEFT: u16 = 1 << 6;

impl Buttons {
    const fn bit(code: u16) -> u16 {
        match code {
            BTN_TOOL_PEN | BTN_TOOL_BRUSH | BTN_TOOL_PENCIL | BTN_TOOL_AIRBRUSH => TOOLS,
            BTN_TOOL_RUBBER => RUBBER,
            BTN_TOUCH => TOUCH,
            BTN_STYLUS | BTN_RIGHT => STYLUS[0],
            BTN_STYLUS2 | BTN_MIDDLE => STYLUS[1],
            BTN_STYLUS3 => STYLUS[2],
            BTN_LEFT => LEFT,
            _ => 0,
        }
    }

    fn set(&mut self, code: u16, held: bool) {
        let bit = Self::bit(code);
        self.0 = if held { self.0 | bit } else { self.0 & !bit };
    }

    const fn has(self, bits: u16) -> bool {
        self.0 & bits != 0
    }
}

/// The whole state of a device, asked of the kernel.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct DeviceState {
    /// Codes and values of its absolute axes.
    pub axes: Vec<(u16, i32)>,
    /// Codes of the buttons that are held.
    pub held: Vec<u16>,
}

/// What an event led to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Decoded {
    Nothing,
    /// A reading of a pen in range.
    Reading(PenReading),
    /// The pen left the range.
    Gone {
        /// When \[ns\].
        stamp_ns: u64,
    },
    /// Events were lost: ask the kernel for the state and give it to [`Decoder::resync`].
    Lost,
}

/// Turns events into readings.
#[derive(Debug, Clone)]
pub struct Decoder {
    geometry: Geometry,
    buttons: Buttons,
    /// Raw axes, of a mouse the counts.
    x: i64,
    y: i64,
    pressure: i32,
    tilt: [i32; 2],
    /// Which coordinates are known.
    known: [bool; 2],
    in_range: bool,
    /// Events were lost; everything up to the next report is of unknown order.
    lost: bool,
}

impl Decoder {
    /// Knows nothing of the device's state yet.
    #[must_use]
    pub fn new(geometry: Geometry) -> Self {
        let known = [matches!(geometry, Geometry::Relative { .. }); 2];
        Self {
            geometry,
            buttons: Buttons::default(),
            x: 0,
            y: 0,
            pressure: 0,
            tilt: [0; 2],
            known,
            in_range: false,
            lost: false,
        }
    }

    pub fn take(&mut self, event: Event) -> Decoded {
        match (event.class, event.code) {
            (Class::Syn, SYN_DROPPED) => self.lost = true,
            (Class::Syn, SYN_REPORT) if self.lost => {
                self.lost = false;
                return Decoded::Lost;
            }
            (Class::Syn, SYN_REPORT) => return self.report(event.stamp_ns),
            _ if self.lost => {}
            (Class::Key, code) => self.buttons.set(code, event.value != 0),
            (Class::Abs, code) => self.axis(code, event.value),
            (Class::Rel, REL_X) => self.x = self.x.saturating_add(i64::from(event.value)),
            (Class::Rel, REL_Y) => self.y = self.y.saturating_add(i64::from(event.value)),
            _ => {}
        }
        Decoded::Nothing
    }

    fn axis(&mut self, code: u16, value: i32) {
        match code {
            ABS_X => (self.x, self.known[0]) = (i64::from(value), true),
            ABS_Y => (self.y, self.known[1]) = (i64::from(value), true),
            ABS_PRESSURE => self.pressure = value,
            ABS_TILT_X => self.tilt[0] = value,
            ABS_TILT_Y => self.tilt[1] = value,
            _ => {}
        }
    }

    /// The whole state, after lost events and at the beginning; read at `now_ns`.
    pub fn resync(&mut self, state: &DeviceState, now_ns: u64) -> Decoded {
        self.lost = false;
        self.buttons = Buttons::default();
        state.held.iter().for_each(|code| self.buttons.set(*code, true));
        state.axes.iter().for_each(|(code, value)| self.axis(*code, *value));
        self.report(now_ns)
    }

    fn report(&mut self, stamp_ns: u64) -> Decoded {
        let was_in_range = self.in_range;
        self.in_range = match self.geometry {
            Geometry::Absolute { tools: true, .. } => self.buttons.has(TOOLS | RUBBER),
            Geometry::Absolute { .. } => self.buttons.has(TOUCH),
            Geometry::Relative { .. } => true,
        } && self.known == [true; 2];
        if !self.in_range {
            return if was_in_range { Decoded::Gone { stamp_ns } } else { Decoded::Nothing };
        }
        Decoded::Reading(self.reading(stamp_ns))
    }

    fn reading(&mut self, stamp_ns: u64) -> PenReading {
        let mut reading = PenReading { device_stamp_ns: stamp_ns, ..PenReading::default() };
        reading.more_flags = pen_flags::IN_RANGE;
        let flags = [pen_flags::BUTTON_1, pen_flags::BUTTON_2, pen_flags::BUTTON_3];
        for (bit, flag) in STYLUS.into_iter().zip(flags) {
            if self.buttons.has(bit) {
                reading.more_flags |= flag;
            }
        }
        match &mut self.geometry {
            Geometry::Absolute { x, y, pressure, tilt, touch, .. } => {
                // An axis is an i32 in the kernel.
                reading.x_m = x.of(self.x as i32);
                reading.y_m = -y.of(self.y as i32);
                reading.pressure = pressure.as_mut().map(|pressure| pressure.share(self.pressure));
                let pressed = reading.pressure.is_some_and(|share| share > TOUCH_SHARE);
                reading.contact = if *touch { self.buttons.has(TOUCH) } else { pressed };
                reading.tilt_rad = tilt.map(|[x, y]| {
                    let [tilt_x, tilt_y] = self.tilt;
                    [x.of(tilt_x) as f32, -y.of(tilt_y) as f32]
                });
                if self.buttons.has(RUBBER) {
                    reading.more_flags |= pen_flags::ERASER;
                }
            }
            Geometry::Relative { per_count_m } => {
                reading.x_m = self.x as f64 * *per_count_m;
                reading.y_m = -(self.y as f64) * *per_count_m;
                reading.contact = self.buttons.has(LEFT);
            }
        }
        reading
    }
}

#[cfg(test)]
mod tests;
