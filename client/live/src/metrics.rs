//! The status as Prometheus text; [`serve`] hands it out.
//!
//! Contract: text of the exposition format 0.0.4: counters end in `_total`, durations are in seconds, unknown
//! numbers are left out.
//!
//! Source: Prometheus, "Exposition formats", "Metric and label naming".

mod server;
pub use server::{MetricsBoard, serve};

use std::fmt::{Display, Write as _};

use foretrace_shm::{
    Counters, ExternalState, FaultReason, LATENCY_BINS, Latency, Mode, PreviewRefusal, REJECT_REASONS,
    RejectReason, Stage, Status, TrustReason, Wire,
};

use crate::stages::Stages;

/// Adds a metric with its help, and one line per sample.
fn metric(text: &mut String, name: &str, kind: &str, help: &str, samples: &[(String, f64)]) {
    let known: Vec<_> = samples.iter().filter(|(_, value)| !value.is_nan()).collect();
    if known.is_empty() {
        return;
    }
    let _ = writeln!(text, "# HELP foretrace_{name} {help}\n# TYPE foretrace_{name} {kind}");
    for (labels, value) in known {
        let _ = writeln!(text, "foretrace_{name}{labels} {value}");
    }
}

fn gauge(text: &mut String, name: &str, help: &str, value: f64) {
    metric(text, name, "gauge", help, &[(String::new(), value)]);
}

fn counter(text: &mut String, name: &str, help: &str, value: u64) {
    metric(text, &format!("{name}_total"), "counter", help, &[(String::new(), value as f64)]);
}

/// One sample for each of `all` under `label`: 1 for the one with the number `now`.
fn one_of<T: Copy + Display + Into<u32>>(
    text: &mut String,
    (name, label, help): (&str, &str, &str),
    all: &[T],
    now: u32,
) {
    let sample = |one: &T| (format!("{{{label}=\"{one}\"}}"), f64::from(u8::from((*one).into() == now)));
    metric(text, name, "gauge", help, &all.iter().map(sample).collect::<Vec<_>>());
}

/// NaN for what stands for unknown on the wire.
fn known(value: f64) -> f64 {
    if value < 0.0 { f64::NAN } else { value }
}

fn seconds(ns: u64) -> f64 {
    if ns == u64::MAX { f64::NAN } else { ns as f64 * 1e-9 }
}

/// `status`, received at `now_ns`, as text; `None`: no daemon. `stages`, where tick records come: what they
/// cost, since this began to count.
#[must_use]
pub fn text(status: Option<&Status>, stages: Option<&Stages>, now_ns: u64) -> String {
    let mut text = String::new();
    gauge(&mut text, "up", "1: a daemon sends its status.", f64::from(u8::from(status.is_some())));
    if let Some(stages) = stages {
        stages.write(&mut text);
        let help = "Tick records lost on their way to these metrics.";
        counter(&mut text, "metrics_ticks_lost", help, stages.lost);
    }
    let Some(status) = status else { return text };
    let t = &mut text;
    gauge(t, "status_age_seconds", "Age of the newest status.", seconds(status.header.age_ns(now_ns)));
    gauge(t, "uptime_seconds", "Since the daemon started.", seconds(status.uptime_ns));
    gauge(t, "rate_hertz", "Ticks per second, measured over the last second.", status.measured_rate_hz);
    gauge(t, "rate_wanted_hertz", "Ticks per second, as set.", status.rate_hz);
    one_of(t, ("mode", "mode", "1 for the mode that the loop is in."), Mode::ALL, status.mode);
    let stopped = ("stopped", "reason", "1 for the reason of the latched stop.");
    one_of(t, stopped, FaultReason::ALL, status.fault);
    gauge(t, "trust", "Share of the preview that the plan follows.", status.trust);
    gauge(t, "trust_target", "Where trust is heading.", status.trust_target);
    let reason = ("trust_reason", "reason", "1 for the reason of the trust.");
    one_of(t, reason, TrustReason::ALL, status.trust_reason);
    gauge(t, "pen_age_seconds", "Age of the newest pen sample.", seconds(status.pen_age_ns));
    gauge(t, "joint_state_age_seconds", "Age of the newest joint state.", seconds(status.joint_state_age_ns));
    let lag = &status.arm_lag;
    let lag_s = if lag.is_known() { lag.lag_s } else { f64::NAN };
    gauge(t, "arm_lag_seconds", "The arm's measured lag.", lag_s);
    gauge(t, "dead_time_seconds", "The plan's dead time.", seconds(lag.dead_time_ns));
    for (name, help, metres) in [
        ("error", "Distance of the tool from the pen, recent rms.", status.tracking.recent_rms_m),
        ("ghost_error", "The same with feedback only.", status.ghost.recent_rms_m),
        ("predictor_error", "One-step error of the predictor, recent rms.", status.predictor_rms_m),
    ] {
        gauge(t, &format!("{name}_metres"), help, known(metres));
    }
    gauge(t, "weights_age_seconds", "Age of the weights in use.", seconds(status.learner_age_ns));
    gauge(t, "allocations_per_tick", "Heap allocations per tick after warm-up.", status.allocations_per_tick);

    let stages = Stage::ALL.iter().zip(&status.stages).flat_map(|(stage, spread)| {
        let of = [
            ("0.5", spread.p50_ns),
            ("0.99", spread.p99_ns),
            ("0.999", spread.p99_9_ns),
            ("1", spread.max_ns),
        ];
        of.map(|(quantile, ns)| {
            (format!("{{stage=\"{stage}\",quantile=\"{quantile}\"}}"), f64::from(ns) * 1e-9)
        })
    });
    let help = "Cost of each stage of a tick since the start.";
    metric(t, "stage_seconds", "summary", help, &stages.collect::<Vec<_>>());
    for (name, help, latency) in [
        ("pen_to_command_seconds", "From a pen sample to the first command with it.", &status.pen_to_command),
        ("command_to_motion_seconds", "From a command to its motion.", &status.command_to_motion),
    ] {
        histogram(t, name, help, latency);
    }

    counter(t, "learner_updates", "Grid steps learned from.", status.learner_updates);
    counter(t, "learner_promotions", "Sets of weights handed to the loop.", status.learner_promotions);
    counter(t, "learner_rollbacks", "Sets of weights rolled back.", status.learner_rollbacks);
    counter(t, "learner_refused", "Sets of weights not handed over.", status.learner_refused);
    external(t, &status.external);
    counters(t, &status.counters);
    text
}

/// A histogram whose sum is not known: Prometheus takes it without.
fn histogram(text: &mut String, name: &str, help: &str, latency: &Latency) {
    let _ = writeln!(text, "# HELP foretrace_{name} {help}\n# TYPE foretrace_{name} histogram");
    let mut below = 0_u64;
    for (index, count) in latency.bins.iter().enumerate() {
        below += u64::from(*count);
        let edge = Latency::edge_us(index) * 1e-6;
        let edge = if index + 1 < LATENCY_BINS { edge.to_string() } else { "+Inf".to_owned() };
        let _ = writeln!(text, "foretrace_{name}_bucket{{le=\"{edge}\"}} {below}");
    }
    let _ = writeln!(text, "foretrace_{name}_count {below}");
}

/// The predictor of another process.
fn external(text: &mut String, state: &ExternalState) {
    let chosen = state.weight >= 0.0;
    let weight = if chosen { f64::from(state.weight) } else { f64::NAN };
    gauge(text, "external_weight", "Part of another process's predictor in the preview.", weight);
    let share = if state.share >= 0.0 { f64::from(state.share) } else { f64::NAN };
    gauge(text, "external_share", "Mean of external_weight over the steps that closed.", share);
    let evidence = if chosen { f64::from(state.evidence) } else { f64::NAN };
    gauge(text, "external_evidence", "Evidence that it is better than the fallback, -10 to 10.", evidence);
    let late_ns = state.latency.p50_ns;
    let latency = if chosen && late_ns > 0 { f64::from(late_ns) * 1e-9 } else { f64::NAN };
    gauge(text, "external_latency_seconds", "From a grid step to its preview, recent median.", latency);
    counter(text, "external_steps", "Grid steps that closed while it was chosen.", state.steps.into());
    counter(text, "external_taken", "Previews of it that were taken.", state.taken.into());
    counter(text, "external_lost", "Previews of it that were replaced or found no room.", state.lost.into());
    counter(text, "external_unsent", "Grid steps that could not be sent to it.", state.unsent.into());
    counter(text, "external_hits", "Grid steps that it answered in time.", state.hits.into());
    let refused = (1..).zip(state.refused).filter_map(|(number, count)| {
        let why = PreviewRefusal::try_from(number).ok()?;
        Some((format!("{{reason=\"{why}\"}}"), f64::from(count)))
    });
    let help = "Previews of it that were refused.";
    metric(text, "external_refused_total", "counter", help, &refused.collect::<Vec<_>>());
}

/// Every counter of the wire under its own name.
fn counters(text: &mut String, counters: &Counters) {
    let mut bytes = Vec::new();
    counters.put(&mut bytes);
    for field in Counters::FIELDS {
        let mut part = bytes.get(field.offset..field.offset + field.size).unwrap_or_default();
        let help = "See `Counters` of foretrace-shm.";
        if field.size == size_of::<u64>() {
            counter(text, field.name, help, u64::get(&mut part).unwrap_or(0));
        } else {
            let by_reason = <[u64; REJECT_REASONS]>::get(&mut part).unwrap_or_default();
            let samples = RejectReason::ALL
                .iter()
                .zip(by_reason)
                .map(|(reason, count)| (format!("{{reason=\"{reason}\"}}"), count as f64));
            metric(text, &format!("{}_total", field.name), "counter", help, &samples.collect::<Vec<_>>());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn full() -> Status {
        let mut status = Status { mode: Mode::Following.into(), ..Status::default() };
        status.counters.pen_rejected.by_reason[RejectReason::OutOfRange as usize] = 3;
        status.counters.overruns = 7;
        (status.external.weight, status.external.share, status.external.evidence) = (0.5, 0.25, 7.0);
        status.pen_to_command.bins[2] = 4;
        status.pen_to_command.bins[LATENCY_BINS - 1] = 1;
        status
    }

    #[test]
    fn every_line_is_a_comment_or_a_sample_and_every_metric_has_its_type_once() {
        let text = text(Some(&full()), Some(&Stages::default()), 0);
        let mut types = Vec::new();
        for line in text.lines() {
            if let Some(typed) = line.strip_prefix("# TYPE ") {
                types.push(typed.split(' ').next().unwrap().to_owned());
            } else if !line.starts_with("# HELP ") {
                let (name, value) = line.rsplit_once(' ').unwrap();
                assert!(name.starts_with("foretrace_") && value.parse::<f64>().is_ok(), "{line}");
            }
        }
        let count = types.len();
        types.sort();
        types.dedup();
        assert_eq!(types.len(), count);
        for wanted in [
            "foretrace_overruns_total 7",
            "foretrace_external_weight 0.5",
            "foretrace_external_share 0.25",
            "foretrace_external_evidence 7",
            "foretrace_pen_rejected_total{reason=\"out of range\"} 3",
            "foretrace_mode{mode=\"following\"} 1",
            "foretrace_pen_to_command_seconds_bucket{le=\"+Inf\"} 5",
            "foretrace_pen_to_command_seconds_count 5",
            "foretrace_up 1",
        ] {
            assert!(text.lines().any(|line| line == wanted), "{wanted} in {text}");
        }
        assert_eq!(super::text(None, None, 0).lines().last(), Some("foretrace_up 0"));
    }

    #[test]
    fn rules_and_dashboard_name_metrics_that_there_are() {
        let text = text(Some(&full()), Some(&Stages::default()), 0);
        for file in ["alerts.yml", "dashboard.json"] {
            let path = format!("{}/../../docs/operate/metrics/{file}", env!("CARGO_MANIFEST_DIR"));
            let content = std::fs::read_to_string(path).unwrap();
            let words = content.split(|c: char| !(c.is_ascii_alphanumeric() || c == '_'));
            let named: Vec<_> = words.filter(|word| word.starts_with("foretrace_")).collect();
            assert!(named.len() > 4, "{file}");
            for name in named {
                assert!(text.contains(&format!("\n{name}")) || text.starts_with(name), "{name} of {file}");
            }
        }
    }
}
