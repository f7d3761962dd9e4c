//! The table of a demo for people: each quantity once, under one name, with the ghost's value beside it.

use foretrace_record::page::late_words;
use serde_json::Value;

use super::figures::RunFigures;
use foretrace_sim::spread::Quantiles;

/// One tool against the pen: where each figure stands in the JSON, and the figure.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Against {
    /// Root mean square distance from the pen while it wrote \[m\].
    pub rms_m: ReportedFigure,
    /// Largest distance \[m\].
    pub max_m: ReportedFigure,
    /// How late \[ms\].
    pub lag_ms: ReportedFigure,
}

/// A figure and its path in the JSON.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct ReportedFigure {
    pub at: &'static str,
    pub value: Option<f64>,
}

impl ReportedFigure {
    /// In `unit`, of which there are `factor` in the unit of the JSON.
    pub(super) fn words(&self, factor: f64, digits: usize, unit: &str) -> String {
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

pub(super) const fn at(at: &'static str, value: Option<f64>) -> ReportedFigure {
    ReportedFigure { at, value }
}

/// The arm. Scored together with its ghost where one ran, else from the records of arm and pen alone.
pub(super) fn arm(figures: &RunFigures) -> Option<Against> {
    figures.tracking.as_ref().map(|score| Against {
        rms_m: at("/tracking/rms_m", Some(score.rms_m)),
        max_m: at("/tracking/max_m", score.max_m),
        lag_ms: at("/tracking/lag_ms", score.lag_ms),
    })
}

/// The ghost, where it could be compared.
pub(super) fn ghost(figures: &RunFigures) -> Option<Against> {
    let score = figures.tracking.as_ref()?;
    score.ghost_rms_m.map(|rms_m| Against {
        rms_m: at("/tracking/ghost_rms_m", Some(rms_m)),
        max_m: at("/tracking/ghost_max_m", score.ghost_max_m),
        lag_ms: at("/tracking/ghost_lag_ms", score.ghost_lag_ms),
    })
}

/// What became of the counters on the way to a controller, beside a bare echo pair; none with another arm.
fn counters(figures: &RunFigures) -> Option<String> {
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
pub(super) fn late(figures: &RunFigures) -> Option<String> {
    let looped = &figures.control_loop;
    let late = late_words(looped.overruns_by_wakeup, looped.overruns_by_work);
    let others = match figures.overruns_unexplained() {
        0 => String::new(),
        others => format!("{others} before the arm was armed, or without a record"),
    };
    let words = [late, others].into_iter().filter(|words| !words.is_empty()).collect::<Vec<_>>().join(", ");
    (!words.is_empty()).then_some(words)
}

pub(super) fn rows(figures: &RunFigures) -> Vec<(&'static str, String)> {
    let RunFigures { control_loop, envelope, commands, joints, pen, learner, trust, .. } = figures;
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
                100.0 * RunFigures::largest_share(&joints.velocity_share),
                100.0 * RunFigures::largest_share(&joints.acceleration_share)
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
