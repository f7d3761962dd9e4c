//! The table of a demo for people: each quantity once, under one name, with the ghost's value beside it.

use serde_json::Value;

use super::figures::Figures;
use crate::spread::Quantiles;

/// One tool against the pen: where each figure stands in the JSON, and the figure.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Against {
    /// Root mean square distance from the pen while it wrote [m].
    pub(crate) rms_m: Told,
    /// Largest distance [m].
    pub(crate) max_m: Told,
    /// How late [ms].
    pub(crate) lag_ms: Told,
}

/// A figure and its place in the JSON.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Told {
    pub(crate) at: &'static str,
    pub(crate) value: Option<f64>,
}

impl Told {
    /// In `unit`, of which there are `factor` in the unit of the JSON.
    pub(crate) fn words(&self, factor: f64, digits: usize, unit: &str) -> String {
        match self.value.filter(|value| value.is_finite()) {
            // Rounded first, so that no minus stands before a zero.
            Some(value) => {
                let shift = 10f64.powi(digits as i32);
                format!("{:.digits$} {unit}", (value * factor * shift).round() / shift + 0.0)
            }
            None => "unknown".to_owned(),
        }
    }
}

const fn told(at: &'static str, value: Option<f64>) -> Told {
    Told { at, value }
}

/// The arm. Scored together with its ghost where one ran, else from the records of arm and pen alone.
pub(crate) fn arm(figures: &Figures) -> Option<Against> {
    let (ghost, tracking) = (&figures.ghost, &figures.tracking);
    let session = &ghost.comparison.session;
    if session.rms_m.is_some() {
        return Some(Against {
            rms_m: told("/ghost/session/rms_m", session.rms_m),
            max_m: told("/ghost/max_m", ghost.max_m),
            lag_ms: told("/ghost/session/lag_ms", session.lag_ms),
        });
    }
    tracking.as_ref().map(|score| Against {
        rms_m: told("/tracking/rmse_m", Some(score.rmse_m)),
        max_m: told("/tracking/max_m", Some(score.max_m)),
        lag_ms: told("/tracking/lag_ms", Some(score.lag_ms)),
    })
}

/// The ghost, where it could be compared.
pub(crate) fn ghost(figures: &Figures) -> Option<Against> {
    let ghost = &figures.ghost;
    let session = &ghost.comparison.session;
    session.ghost_rms_m.map(|rms_m| Against {
        rms_m: told("/ghost/session/ghost_rms_m", Some(rms_m)),
        max_m: told("/ghost/ghost_max_m", ghost.ghost_max_m),
        lag_ms: told("/ghost/session/ghost_lag_ms", session.ghost_lag_ms),
    })
}

/// What became of the counters on the way to a controller, beside a bare echo pair; none with another arm.
fn counters(figures: &Figures) -> Option<String> {
    let words = |value: &Value, cycles: &str| {
        let count = |key: &str| value.get(key).and_then(Value::as_u64);
        let (cycles, late, lost) = (count(cycles)?, count("late_cycles")?, count("lost_counters")?);
        Some(format!("{lost} lost, {late} of {cycles} cycles without a fresh one"))
    };
    let bridge = words(figures.arm.get("link")?, "states")?;
    let pair = words(&figures.echo, "cycles")?;
    Some(format!("bridge: {bridge}; a bare echo pair beside it: {pair}"))
}

/// Label and value.
pub(crate) fn rows(figures: &Figures) -> Vec<(&'static str, String)> {
    let Figures { control_loop, envelope, commands, pen, learner, trust, .. } = figures;
    let spread = |q: &Quantiles| {
        format!("p50 {:.1}, p99 {:.1}, p99.9 {:.1}, max {:.1} µs", q.p50, q.p99, q.p99_9, q.max)
    };
    let number = |key: &str| commands.get(key).and_then(Value::as_f64).unwrap_or(f64::NAN);
    let (arm, ghost) = (arm(figures), ghost(figures));
    let mm = |of: &Against| {
        format!("{} rms, {} at most", of.rms_m.words(1e3, 2, "mm"), of.max_m.words(1e3, 1, "mm"))
    };
    let ms = |of: &Against| of.lag_ms.words(1.0, 1, "ms");
    let without = |words: &dyn Fn(&Against) -> String| {
        ghost.as_ref().map_or_else(
            || format!("; without prediction: not compared ({})", figures.ghost.comparison.state),
            |ghost| format!("; without prediction (the ghost): {}", words(ghost)),
        )
    };
    let against = |words: &dyn Fn(&Against) -> String| match &arm {
        Some(arm) => format!("{}{}", words(arm), without(words)),
        None => "not scored: the arm never came near a writing pen".to_owned(),
    };
    let mut rows = vec![
        ("error", against(&mm)),
        ("lag", against(&ms)),
        (
            "commands",
            format!(
                "{} received, {} limit violations; at most {:.3} rad/s, {:.2} rad/s²",
                number("count"),
                figures.limit_violations(),
                number("max_velocity_radps"),
                number("max_acceleration_radps2")
            ),
        ),
        ("tool", envelope.as_ref().map_or_else(|| "not measured".to_owned(), ToString::to_string)),
        (
            "loop",
            format!(
                "{:.0} Hz, {} ticks, {} ended too late ({} by late wake-up), {} periods skipped",
                control_loop.rate_hz,
                control_loop.ticks,
                control_loop.overruns,
                control_loop.overruns_by_wakeup,
                control_loop.skipped_ticks
            ),
        ),
        ("step", spread(&control_loop.step_us)),
        ("wake-up", spread(&control_loop.wakeup_us)),
        (
            "memory",
            format!(
                "{:.4} allocations per tick, {} when ports connected",
                control_loop.allocations_per_tick, control_loop.connection_allocations
            ),
        ),
        ("pen", format!("{} samples, {} rejected, {} dropped", pen.samples, pen.rejected, pen.dropped)),
        (
            "learner",
            format!(
                "{} updates, new weights taken into use {} times, taken back {} times",
                learner.updates, learner.promotions, learner.rollbacks
            ),
        ),
        ("trust", format!("{:.2} on average (1: the prediction counts fully, 0: not at all)", trust.mean)),
    ];
    for stop in &control_loop.stops {
        rows.push(("stopped", format!("after {:.1} s: {}", stop.at_s, stop.words())));
    }
    rows.extend(counters(figures).map(|words| ("counters", words)));
    if !control_loop.missing_rights.is_empty() {
        rows.push(("rights", format!("missing: {}", control_loop.missing_rights.join(", "))));
    }
    rows
}
