//! The table of a demo for people: each quantity once, under one name, with the ghost's value beside it.

use foretrace_record::page::late_words;
use serde_json::Value;

use super::figures::Figures;
use foretrace_sim::spread::Quantiles;

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
    figures.tracking.as_ref().map(|score| Against {
        rms_m: told("/tracking/rms_m", Some(score.rms_m)),
        max_m: told("/tracking/max_m", score.max_m),
        lag_ms: told("/tracking/lag_ms", score.lag_ms),
    })
}

/// The ghost, where it could be compared.
pub(crate) fn ghost(figures: &Figures) -> Option<Against> {
    let score = figures.tracking.as_ref()?;
    score.ghost_rms_m.map(|rms_m| Against {
        rms_m: told("/tracking/ghost_rms_m", Some(rms_m)),
        max_m: told("/tracking/ghost_max_m", score.ghost_max_m),
        lag_ms: told("/tracking/ghost_lag_ms", score.ghost_lag_ms),
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

/// Why ticks ended too late; none if none did.
pub(crate) fn late(figures: &Figures) -> Option<String> {
    let looped = &figures.control_loop;
    let told = late_words(looped.overruns_by_wakeup, looped.overruns_by_work);
    let others = match figures.overruns_unexplained() {
        0 => String::new(),
        others => format!("{others} before the arm was armed, or without a record"),
    };
    let words = [told, others].into_iter().filter(|words| !words.is_empty()).collect::<Vec<_>>().join(", ");
    (!words.is_empty()).then_some(words)
}

/// Label and value.
pub(crate) fn rows(figures: &Figures) -> Vec<(&'static str, String)> {
    let Figures { control_loop, envelope, commands, joints, pen, learner, trust, .. } = figures;
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
            || format!("; without prediction: not compared ({})", figures.ghost.state),
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
                "{} received, {} limit violations; at most {:.0} % of a joint's velocity limit, {:.0} % of its \
                 acceleration limit",
                number("count"),
                figures.limit_violations(),
                100.0 * Figures::largest_share(&joints.velocity_share),
                100.0 * Figures::largest_share(&joints.acceleration_share)
            ),
        ),
        ("tool", envelope.as_ref().map_or_else(|| "not measured".to_owned(), ToString::to_string)),
        (
            "loop",
            format!(
                "{:.0} Hz, {} ticks, {} ended too late{}, {} periods skipped",
                control_loop.rate_hz,
                control_loop.ticks,
                control_loop.overruns,
                late(figures).map_or_else(String::new, |words| format!(" ({words})")),
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
