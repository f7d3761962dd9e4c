//! The channels of an InkML document: order, units, orientation, rate, resolution.

use std::rc::Rc;

const RATE: std::ops::RangeInclusive<f64> = 1e-3..=1e6;
const CHANNELS_MAX: usize = 64;

/// A `<traceFormat>`.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct TraceFormat {
    channels: Vec<TraceChannel>,
    /// How many of them every point has; intermittent ones may be left out.
    required: usize,
}

#[derive(Debug, Clone, PartialEq)]
struct TraceChannel {
    name: String,
    units: String,
    /// `orientation="-ve"`.
    reversed: bool,
    /// When its zero is \[ms\]: the timestamp of `respectTo`.
    begin_ms: Option<f64>,
}

/// An `<inkSource>`.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct InkSource {
    pub(super) format: Option<Rc<TraceFormat>>,
    /// \[Hz\]
    pub(super) rate_hz: Option<f64>,
    /// Of the X and Y channels: counts per metre; of T: counts per second; where stated.
    resolution: [Option<f64>; 3],
}

/// A `<context>`: what later traces are read with.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct InkContext {
    pub(super) format: Option<Rc<TraceFormat>>,
    pub(super) source: Option<Rc<InkSource>>,
    /// Time of its `<timestamp>` \[ms\].
    pub(super) begin_ms: Option<f64>,
}

/// Where the values of a point are.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct PointLayout {
    pub(super) channels: usize,
    pub(super) required: usize,
    pub(super) x: usize,
    pub(super) y: usize,
    pub(super) t: Option<usize>,
    /// Factors that turn x to the right and y upwards.
    pub(super) turn: [f64; 2],
    pub(super) units_per_m: Option<[f64; 2]>,
    /// Length of the unit of T \[s\].
    pub(super) t_unit_s: f64,
    /// What T counts from \[ms\].
    pub(super) t_begin_ms: f64,
}

impl PointLayout {
    /// Without a `<traceFormat>`: X and Y in units of the device, y downwards.
    pub(super) fn plain() -> Self {
        Self {
            channels: 2,
            required: 2,
            x: 0,
            y: 1,
            t: None,
            turn: [1.0, -1.0],
            units_per_m: None,
            t_unit_s: 1e-3,
            t_begin_ms: 0.0,
        }
    }
}

impl TraceFormat {
    pub(super) fn add(
        &mut self,
        name: Option<String>,
        units: Option<String>,
        orientation: Option<String>,
        begin_ms: Option<f64>,
        intermittent: bool,
    ) -> Result<(), String> {
        let name = name.ok_or("a channel without a name")?;
        if self.channels.len() == CHANNELS_MAX {
            return Err(format!("more than {CHANNELS_MAX} channels"));
        }
        let reversed = match orientation.as_deref() {
            None | Some("+ve") => false,
            Some("-ve") => true,
            Some(other) => return Err(format!("orientation is {other:?}; legal: +ve, -ve")),
        };
        self.channels.push(TraceChannel { name, units: units.unwrap_or_default(), reversed, begin_ms });
        if !intermittent {
            self.required = self.channels.len();
        }
        Ok(())
    }
}

impl InkSource {
    /// A `<sampleRate>` or `<channelProperty>` of this device.
    pub(super) fn state_rate(&mut self, value: Option<String>) -> Result<(), String> {
        let text = value.unwrap_or_default();
        let rate = text.trim().parse::<f64>().ok().filter(|r| RATE.contains(r));
        self.rate_hz = Some(
            rate.ok_or_else(|| format!("sampleRate is {text:?}; legal: a number from 0.001 to 1000000"))?,
        );
        Ok(())
    }

    /// `<channelProperty channel="X" name="resolution" value="100" units="1/mm"/>`: the scale of the values.
    /// Units `dev` and others without a length or duration say nothing.
    pub(super) fn state_resolution(&mut self, channel: &str, value: Option<String>, units: Option<String>) {
        let units = units.unwrap_or_default();
        let (axis, length): (usize, fn(&str) -> Option<f64>) = match channel {
            "X" => (0, metres),
            "Y" => (1, metres),
            "T" => (2, seconds),
            _ => return,
        };
        let Some(value) = value.as_deref().and_then(fraction) else { return };
        let counts = match units.trim() {
            "dpi" | "lpi" | "ppi" => Some(value / 0.0254),
            units => match units.split_once('/') {
                Some((_, unit)) => length(unit.trim()).map(|unit| value / unit),
                // "0.01 mm" is the length of a count, "100 mm" can only be counts.
                None => {
                    length(units).map(|unit| if value <= 1.0 { 1.0 / (value * unit) } else { value / unit })
                }
            },
        };
        let counts = counts.filter(|counts| counts.is_finite() && *counts > 0.0);
        if let (Some(counts), Some(slot)) = (counts, self.resolution.get_mut(axis)) {
            *slot = Some(counts);
        }
    }
}

/// `0.01` or `1/100`, positive and finite.
fn fraction(text: &str) -> Option<f64> {
    let number = |text: &str| text.trim().parse::<f64>().ok();
    let value = match text.split_once('/') {
        Some((above, below)) => number(above)? / number(below)?,
        None => number(text)?,
    };
    (value > 0.0 && value.is_finite()).then_some(value)
}

impl InkContext {
    /// # Errors
    ///
    /// A format without X or Y.
    pub(super) fn layout(&self) -> Result<PointLayout, String> {
        let source = self.source.as_deref();
        let of_source = source.and_then(|s| s.format.as_ref());
        let resolution = source.map_or([None; 3], |s| s.resolution);
        let plain = PointLayout::plain();
        let Some(format) = self.format.as_ref().or(of_source).filter(|f| !f.channels.is_empty()) else {
            let [x, y, _] = resolution;
            return Ok(PointLayout { units_per_m: x.zip(y).map(|(x, y)| [x, y]), ..plain });
        };
        let find = |name: &str| format.channels.iter().position(|c| c.name == name);
        let (Some(x), Some(y)) = (find("X"), find("Y")) else {
            let names: Vec<&str> = format.channels.iter().map(|c| c.name.as_str()).collect();
            return Err(format!("a traceFormat must have the channels X and Y, found {}", names.join(" ")));
        };
        let channel = |index: usize| format.channels.get(index);
        let reversed = |index: usize| channel(index).is_some_and(|c| c.reversed);
        // Word and Journal write both: counts, with their number per unit in the resolution.
        let per_m = |index: usize, axis: usize| {
            let stated = channel(index).and_then(|c| metres(&c.units)).map(|unit| 1.0 / unit);
            resolution.get(axis).copied().flatten().or(stated)
        };
        let t = find("T");
        let [_, _, t_resolution] = resolution;
        let t_unit_s = t.and_then(channel).and_then(|c| seconds(&c.units));
        let t_begin_ms = t.and_then(channel).and_then(|c| c.begin_ms).or(self.begin_ms);
        Ok(PointLayout {
            channels: format.channels.len(),
            required: format.required.max(x + 1).max(y + 1),
            x,
            y,
            t: t.filter(|t| *t < format.required),
            // Without a minus, x grows to the right and y downwards.
            turn: [if reversed(x) { -1.0 } else { 1.0 }, if reversed(y) { 1.0 } else { -1.0 }],
            units_per_m: per_m(x, 0).zip(per_m(y, 1)).map(|(x, y)| [x, y]),
            t_unit_s: t_resolution.map(|counts| 1.0 / counts).or(t_unit_s).unwrap_or(1e-3),
            t_begin_ms: t_begin_ms.unwrap_or_default(),
        })
    }

    pub(super) fn rate_hz(&self) -> Option<f64> {
        self.source.as_ref().and_then(|s| s.rate_hz)
    }
}

/// Length of a unit \[m\]; `None` for the device's own.
fn metres(unit: &str) -> Option<f64> {
    Some(match unit {
        "m" | "meter" | "metre" => 1.0,
        "cm" => 1e-2,
        "mm" => 1e-3,
        "um" | "µm" | "μm" | "micron" => 1e-6,
        "in" | "inch" => 0.0254,
        "pt" => 0.0254 / 72.0,
        "pc" => 0.0254 / 6.0,
        "himetric" | "HIMETRIC" => 1e-5,
        _ => return None,
    })
}

/// Length of a unit of time \[s\]; `None`: none is stated, which means milliseconds.
fn seconds(unit: &str) -> Option<f64> {
    Some(match unit {
        "s" | "sec" => 1.0,
        "ms" | "msec" => 1e-3,
        "us" | "µs" | "μs" => 1e-6,
        "ns" => 1e-9,
        _ => return None,
    })
}
