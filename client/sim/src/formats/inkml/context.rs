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
}

/// An `<inkSource>`.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct InkSource {
    pub(super) format: Option<Rc<TraceFormat>>,
    /// \[Hz\]
    pub(super) rate_hz: Option<f64>,
    /// Of the X and Y channels: samples per metre, where stated.
    resolution_per_m: [Option<f64>; 2],
}

/// A `<context>`: what later traces are read with.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct InkContext {
    pub(super) format: Option<Rc<TraceFormat>>,
    pub(super) source: Option<Rc<InkSource>>,
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
        }
    }
}

impl TraceFormat {
    pub(super) fn add(
        &mut self,
        name: Option<String>,
        units: Option<String>,
        orientation: Option<String>,
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
        self.channels.push(TraceChannel { name, units: units.unwrap_or_default(), reversed });
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

    /// `<channelProperty channel="X" name="resolution" value="100" units="1/mm"/>`.
    pub(super) fn state_resolution(&mut self, channel: &str, value: Option<String>, units: Option<String>) {
        let value = value.and_then(|v| v.trim().parse::<f64>().ok()).filter(|v| *v > 0.0 && v.is_finite());
        let units = units.unwrap_or_default();
        let per = units.split_once('/').and_then(|(_, unit)| metres(unit.trim()));
        let axis = match channel {
            "X" => 0,
            "Y" => 1,
            _ => return,
        };
        if let (Some(value), Some(per), Some(slot)) = (value, per, self.resolution_per_m.get_mut(axis)) {
            *slot = Some(value / per);
        }
    }
}

impl InkContext {
    /// # Errors
    ///
    /// A format without X or Y.
    pub(super) fn layout(&self) -> Result<PointLayout, String> {
        let source = self.source.as_deref();
        let of_source = source.and_then(|s| s.format.as_ref());
        let resolution = source.map_or([None; 2], |s| s.resolution_per_m);
        let plain = PointLayout::plain();
        let Some(format) = self.format.as_ref().or(of_source).filter(|f| !f.channels.is_empty()) else {
            let [x, y] = resolution;
            return Ok(PointLayout { units_per_m: x.zip(y).map(|(x, y)| [x, y]), ..plain });
        };
        let find = |name: &str| format.channels.iter().position(|c| c.name == name);
        let (Some(x), Some(y)) = (find("X"), find("Y")) else {
            let names: Vec<&str> = format.channels.iter().map(|c| c.name.as_str()).collect();
            return Err(format!("a traceFormat must have the channels X and Y, found {}", names.join(" ")));
        };
        let channel = |index: usize| format.channels.get(index);
        let reversed = |index: usize| channel(index).is_some_and(|c| c.reversed);
        let per_m = |index: usize, axis: usize| {
            let stated = channel(index).and_then(|c| metres(&c.units)).map(|unit| 1.0 / unit);
            stated.or_else(|| resolution.get(axis).copied().flatten())
        };
        let t = find("T");
        let t_units = t.and_then(channel).map_or("", |c| c.units.as_str());
        Ok(PointLayout {
            channels: format.channels.len(),
            required: format.required.max(x + 1).max(y + 1),
            x,
            y,
            t: t.filter(|t| *t < format.required),
            // Without a minus, x grows to the right and y downwards.
            turn: [if reversed(x) { -1.0 } else { 1.0 }, if reversed(y) { 1.0 } else { -1.0 }],
            units_per_m: per_m(x, 0).zip(per_m(y, 1)).map(|(x, y)| [x, y]),
            t_unit_s: seconds(t_units),
        })
    }

    pub(super) fn rate_hz(&self) -> Option<f64> {
        self.source.as_ref().and_then(|s| s.rate_hz)
    }
}

/// Length of a unit \[m\]; `None` for the device's own.
fn metres(unit: &str) -> Option<f64> {
    Some(match unit {
        "m" => 1.0,
        "cm" => 1e-2,
        "mm" => 1e-3,
        "um" | "µm" => 1e-6,
        "in" => 0.0254,
        "pt" => 0.0254 / 72.0,
        "pc" => 0.0254 / 6.0,
        "himetric" => 1e-5,
        _ => return None,
    })
}

/// Length of a unit of time \[s\]; milliseconds where none is stated.
fn seconds(unit: &str) -> f64 {
    match unit {
        "s" => 1.0,
        "us" | "µs" => 1e-6,
        "ns" => 1e-9,
        _ => 1e-3,
    }
}
