//! How the points of a document pass in time: by T, by stated rates, by the lengths of traces.

use super::context::{InkContext, PointLayout};
use super::document::{Document, Trace};
use crate::data::{Cadence, Remark};
use std::rc::Rc;

/// The time base of a document.
pub(super) struct InkClock {
    /// As stated by the contexts in use, each once.
    rates_hz: Vec<f64>,
    /// The rhythm of T where that alone stamps points, and rises in even steps.
    even: Option<Cadence>,
    /// What stamps count from: the begin of the first trace with T \[ms\], and its first T, in a unit of so
    /// many seconds.
    origin_ms: f64,
    origin_t: (f64, f64),
}

impl InkClock {
    /// # Errors
    /// A format without X or Y.
    pub(super) fn of(document: &Document) -> Result<Self, String> {
        let mut rates_hz: Vec<f64> = Vec::new();
        for rate_hz in contexts(document).filter_map(|context| context.rate_hz()) {
            if !rates_hz.contains(&rate_hz) {
                rates_hz.push(rate_hz);
            }
        }
        let mut clock = Self { rates_hz, even: None, origin_ms: 0.0, origin_t: (0.0, 1.0) };
        let mut begun = false;
        // Each step in the unit of T: stamps in seconds since 1970 are rounded to a quarter of a microsecond.
        let mut steps_s: Vec<f64> = Vec::new();
        for trace in &document.traces {
            let times = &trace.points.times;
            let Some(first) = times.first() else { continue };
            let layout = trace.context.layout()?;
            if !std::mem::replace(&mut begun, true) {
                clock.origin_ms = begin_ms(trace, &layout);
                clock.origin_t = (*first, layout.t_unit_s);
            }
            steps_s.extend(times.windows(2).map(|w| (w[1] - w[0]) * layout.t_unit_s));
        }
        let mut others = document.traces.iter().filter(|trace| trace.points.times.is_empty());
        let only_t = !others.any(|trace| clock.step_s(trace).is_some());
        if only_t && steps_s.iter().all(|step_s| *step_s > 0.0) {
            clock.even = Cadence::of(steps_s, clock.only_rate_hz()).filter(|cadence| cadence.even);
        }
        Ok(clock)
    }

    /// The rate to read the stamps by.
    pub(super) fn stated_hz(&self) -> Option<f64> {
        self.even.map(|cadence| cadence.rate_hz).or(self.only_rate_hz())
    }

    /// The rate of a document without stamps.
    pub(super) fn first_rate_hz(&self) -> Option<f64> {
        self.rates_hz.first().copied()
    }

    fn only_rate_hz(&self) -> Option<f64> {
        self.first_rate_hz().filter(|_| self.rates_hz.len() == 1)
    }

    /// What even stamps tell otherwise than the document.
    pub(super) fn remark(&self) -> Option<Remark> {
        self.even?.apart_from(self.only_rate_hz()?)
    }

    /// Stamps of the points of `trace`: of its T channel, else by its own rate or duration where that tells
    /// more than the rate of the file; empty where nothing does.
    pub(super) fn stamps_s(&self, trace: &Trace, layout: &PointLayout) -> Vec<f64> {
        let count = trace.points.xy.len();
        if trace.points.times.is_empty() {
            let begin_s = trace.offset_ms.unwrap_or_default() * 1e-3;
            let stamped = |step_s: f64| (0..count).map(|k| begin_s + k as f64 * step_s).collect();
            return self.step_s(trace).map_or(Vec::new(), stamped);
        }
        let begin_s = (begin_ms(trace, layout) - self.origin_ms) * 1e-3;
        // Of even stamps only the gaps stay, which are those of T as it stands, to the last digit.
        let (origin, unit_s) = if self.even.is_some() { (0.0, 1.0) } else { self.origin_t };
        let origin = origin * (unit_s / layout.t_unit_s);
        trace.points.times.iter().map(|t| begin_s + (t - origin) * layout.t_unit_s).collect()
    }

    /// Time between the points of a trace without T, where something tells more than the rate of the file.
    fn step_s(&self, trace: &Trace) -> Option<f64> {
        let count = trace.points.xy.len();
        let rate_hz =
            trace.context.rate_hz().filter(|_| self.rates_hz.len() > 1 || trace.offset_ms.is_some());
        let lasting = trace.duration_s.filter(|_| self.rates_hz.is_empty() && count > 1);
        rate_hz.map(|hz| 1.0 / hz).or(lasting.map(|s| s / (count - 1) as f64))
    }
}

/// What the T of a trace counts from. A channel that begins at zero counts from where the trace does.
fn begin_ms(trace: &Trace, layout: &PointLayout) -> f64 {
    let at_zero = trace.points.times.first().is_some_and(|first| *first == 0.0);
    trace.offset_ms.filter(|_| at_zero).unwrap_or(layout.t_begin_ms)
}

/// The contexts of traces with points, each where another comes before it.
pub(super) fn contexts(document: &Document) -> impl Iterator<Item = &Rc<InkContext>> {
    let mut last: Option<&Rc<InkContext>> = None;
    let traces = document.traces.iter().filter(|t| !t.points.xy.is_empty());
    traces.map(|t| &t.context).filter(move |context| {
        let other = last.is_none_or(|last| !Rc::ptr_eq(last, context));
        last = Some(context);
        other
    })
}
