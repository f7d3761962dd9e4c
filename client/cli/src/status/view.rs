//! A status message as text for people and as JSON for machines.

use std::fmt::Write as _;

use foretrace_shm::{FaultReason, Mode, PredictorId, Stage, Status, TrustReason, missing_rights};
use serde_json::{Map, Value, json};

use crate::ghost::Comparison;

/// One screen of text: mode, rates, spreads of every stage, what was lost, trust, learner, rights.
pub(crate) fn text(status: &Status, age_ns: u64) -> String {
    let mut page = String::new();
    // Writing to a String cannot fail.
    let mut line = |words: std::fmt::Arguments<'_>| {
        let _ = writeln!(page, "{words}");
    };
    let counts = &status.counters;
    line(format_args!(
        "mode        {}{}   daemon pid {}   up {}   status {} old",
        label::<Mode>(status.mode),
        if status.fault == 0 { String::new() } else { format!(" ({})", label::<FaultReason>(status.fault)) },
        status.pid,
        seconds(status.uptime_ns),
        milliseconds(age_ns),
    ));
    line(format_args!(
        "loop        {:.0} Hz set, {:.1} Hz measured   tick {}   {} overruns   {} periods skipped   {} shed",
        status.rate_hz,
        status.measured_rate_hz,
        status.tick,
        counts.overruns,
        counts.skipped_ticks,
        counts.shed_ticks
    ));
    line(format_args!("\n  µs          p50       p99     p99.9       max"));
    for stage in Stage::ALL {
        let spread = status.stage(*stage);
        let us = |ns: u32| f64::from(ns) / 1e3;
        line(format_args!(
            "  {:<8}{:>9.2} {:>9.2} {:>9.2} {:>9.2}",
            stage.label(),
            us(spread.p50_ns),
            us(spread.p99_ns),
            us(spread.p99_9_ns),
            us(spread.max_ns)
        ));
    }
    line(format_args!(
        "\npen         newest {} old   {} samples   {} dropped   {} rejected   {} outliers   {} gaps   {} out of order",
        milliseconds(status.pen_age_ns),
        counts.pen_received,
        counts.pen_dropped,
        counts.pen_rejected.total(),
        counts.pen_outliers,
        counts.pen_gaps,
        counts.pen_out_of_order
    ));
    line(format_args!(
        "arm         newest {} old   {} states   {} dropped   {} rejected   {} ticks stale   {} commands sent, {} failed",
        milliseconds(status.joint_state_age_ns),
        counts.joint_state_received,
        counts.joint_state_dropped,
        counts.joint_state_rejected.total(),
        counts.joint_state_stale,
        counts.commands_sent,
        counts.commands_failed
    ));
    line(format_args!("chain       {}", chain_text(status)));
    line(format_args!("lag         {}", lag_text(status)));
    line(format_args!("ghost       {}", Comparison::of(status).now()));
    line(format_args!(
        "trust       {:.2} -> {:.2} ({})   predictor {}{}",
        status.trust,
        status.trust_target,
        label::<TrustReason>(status.trust_reason),
        label::<PredictorId>(status.predictor),
        if status.predictor_rms_m < 0.0 {
            String::new()
        } else {
            format!(", one-step error {:.3} mm rms", status.predictor_rms_m * 1e3)
        } + &if status.predictor_band_m < 0.0 {
            String::new()
        } else {
            format!(", 90 % within {:.2} mm at the plan's first step", status.predictor_band_m * 1e3)
        }
    ));
    line(format_args!(
        "learner     weights {} ({} old)   {} updates   {} promoted   {} rolled back   {} refused",
        status.learner_version,
        milliseconds(status.learner_age_ns),
        status.learner_updates,
        status.learner_promotions,
        status.learner_rollbacks,
        status.learner_refused
    ));
    line(format_args!(
        "rings       {} telemetry and {} learner records dropped   {} weights refused, {} overtaken   {} events lost",
        counts.telemetry_ring_dropped,
        counts.learner_ring_dropped,
        counts.weights_refused,
        counts.weights_overtaken,
        counts.learner_events_lost
    ));
    line(format_args!(
        "memory      {:.3} allocations per tick ({} in {} connection ticks)   page faults {} minor, {} major",
        status.allocations_per_tick,
        counts.connection_allocations,
        counts.connection_ticks,
        counts.page_faults_minor,
        counts.page_faults_major
    ));
    let missing: Vec<&str> = missing_rights::labels(status.missing_rights).collect();
    let rights = if missing.is_empty() {
        "all granted".to_owned()
    } else {
        format!("missing: {}", missing.join(", "))
    };
    line(format_args!("rights      {rights}"));
    page
}

/// Everything in the status under stable keys.
pub(crate) fn json(status: &Status) -> Value {
    let counts = &status.counters;
    let stages: Map<String, Value> = Stage::ALL
        .iter()
        .map(|stage| {
            let spread = status.stage(*stage);
            let us = |ns: u32| f64::from(ns) / 1e3;
            let value = json!({
                "p50": us(spread.p50_ns), "p99": us(spread.p99_ns),
                "p99_9": us(spread.p99_9_ns), "max": us(spread.max_ns),
            });
            (stage.label().to_owned(), value)
        })
        .collect();
    let known = status.arm_lag.is_known();
    json!({
        "mode": label::<Mode>(status.mode),
        "fault": label::<FaultReason>(status.fault),
        "pid": status.pid,
        "daemon_id": format!("{:016x}", status.daemon_id),
        "uptime_s": status.uptime_ns as f64 * 1e-9,
        "missing_rights": missing_rights::labels(status.missing_rights).collect::<Vec<_>>(),
        "loop": {
            "rate_hz": status.rate_hz,
            "measured_rate_hz": status.measured_rate_hz,
            "tick": status.tick,
            "ticks": counts.ticks,
            "overruns": counts.overruns,
            "skipped_ticks": counts.skipped_ticks,
            "shed_ticks": counts.shed_ticks,
            "allocations_per_tick": status.allocations_per_tick,
            "connection_allocations": counts.connection_allocations,
        },
        "stage_us": stages,
        "pen": {
            "age_ms": age_ms(status.pen_age_ns),
            "samples": counts.pen_received,
            "dropped": counts.pen_dropped,
            "rejected": counts.pen_rejected.total(),
            "outliers": counts.pen_outliers,
            "gaps": counts.pen_gaps,
            "out_of_order": counts.pen_out_of_order,
        },
        "arm": {
            "age_ms": age_ms(status.joint_state_age_ns),
            "states": counts.joint_state_received,
            "dropped": counts.joint_state_dropped,
            "rejected": counts.joint_state_rejected.total(),
            "stale_ticks": counts.joint_state_stale,
            "commands_sent": counts.commands_sent,
            "commands_failed": counts.commands_failed,
        },
        "chain": {
            "pen_reader_ms": age_ms(status.chain.pen_reader_ns),
            "pen_transport_ms": age_ms(status.chain.pen_transport_ns),
            "pen_age_ms": age_ms(status.chain.pen_age_ns),
            "compute_ms": age_ms(status.chain.compute_ns),
            "command_transport_ms": age_ms(status.chain.command_transport_ns),
        },
        "arm_lag": {
            "lag_ms": known.then_some(status.arm_lag.lag_s * 1e3),
            "std_ms": known.then_some(status.arm_lag.std_s * 1e3),
            "shift_ms": known.then_some(status.arm_lag.shift_s * 1e3),
            "dead_time_ms": status.arm_lag.dead_time_ns as f64 * 1e-6,
        },
        "ghost": Comparison::of(status),
        "trust": {
            "value": status.trust,
            "target": status.trust_target,
            "reason": label::<TrustReason>(status.trust_reason),
        },
        "predictor": {
            "name": label::<PredictorId>(status.predictor),
            "rms_m": (status.predictor_rms_m >= 0.0).then_some(status.predictor_rms_m),
            "band_m": (status.predictor_band_m >= 0.0).then_some(status.predictor_band_m),
        },
        "learner": {
            "version": status.learner_version,
            "age_ms": age_ms(status.learner_age_ns),
            "updates": status.learner_updates,
            "promotions": status.learner_promotions,
            "rollbacks": status.learner_rollbacks,
            "refused": status.learner_refused,
        },
        "dropped": {
            "telemetry_ring": counts.telemetry_ring_dropped,
            "learner_ring": counts.learner_ring_dropped,
            "weights_overtaken": counts.weights_overtaken,
            "learner_events": counts.learner_events_lost,
        },
        "page_faults": { "minor": counts.page_faults_minor, "major": counts.page_faults_major },
    })
}

/// From the pen to the arm in one line; what is not known is left out.
fn chain_text(status: &Status) -> String {
    let chain = &status.chain;
    let part = |ns: u64, words: &dyn Fn(f64) -> String| age_ms(ns).map(words);
    let parts = [
        part(chain.pen_age_ns, &|ms| match (age_ms(chain.pen_reader_ns), age_ms(chain.pen_transport_ns)) {
            (Some(reader), Some(transport)) => {
                format!("pen {ms:.1} ms old ({reader:.1} in its reader, {transport:.1} on the way)")
            }
            _ => format!("pen {ms:.1} ms old"),
        }),
        part(chain.compute_ns, &|ms| format!("computed in {ms:.2}")),
        part(chain.command_transport_ns, &|ms| format!("sent to the arm in {ms:.1}")),
    ];
    let known: Vec<String> = parts.into_iter().flatten().collect();
    if known.is_empty() { "nothing to time yet".to_owned() } else { known.join(", ") }
}

/// How late the arm is, and what the plan makes of it.
fn lag_text(status: &Status) -> String {
    let lag = &status.arm_lag;
    let ms = |s: f64| s * 1e3;
    let planned = format!("planned for {:.1}", lag.dead_time_ns as f64 * 1e-6);
    if lag.is_known() {
        let (lag, std, shift) = (ms(lag.lag_s), ms(lag.std_s), ms(lag.shift_s));
        format!("arm lag {lag:.1} ± {std:.1} ms, in this motion {shift:.1}, {planned}")
    } else {
        format!("arm lag not measured yet, {planned} ms")
    }
}

/// The word for a number on the wire.
fn label<E: TryFrom<u32> + ToString>(value: u32) -> String {
    E::try_from(value).map_or_else(|_| format!("unknown ({value})"), |known| known.to_string())
}

fn age_ms(ns: u64) -> Option<f64> {
    (ns != u64::MAX).then_some(ns as f64 * 1e-6)
}

fn milliseconds(ns: u64) -> String {
    match age_ms(ns) {
        None => "never".to_owned(),
        Some(ms) if ms < 10_000.0 => format!("{ms:.1} ms"),
        Some(_) => seconds(ns),
    }
}

fn seconds(ns: u64) -> String {
    format!("{:.1} s", ns as f64 * 1e-9)
}

#[cfg(test)]
mod tests {
    use super::*;
    use foretrace_shm::{ArmLag, Chain};

    #[test]
    fn text_names_mode_stages_trust_and_missing_rights() {
        let mut status = Status {
            mode: Mode::Following.into(),
            missing_rights: missing_rights::FIFO,
            trust: 0.5,
            trust_reason: TrustReason::Ramp.into(),
            pen_age_ns: u64::MAX,
            ..Status::default()
        };
        status.stages[Stage::Mpc as usize].p99_ns = 12_340;
        let page = text(&status, 3_000_000);
        for words in ["following", "real-time scheduling", "12.34", "0.50", "ramp", "newest never old"] {
            assert!(page.contains(words), "{words} missing in\n{page}");
        }
    }

    #[test]
    fn the_chain_is_one_line_and_leaves_out_what_is_not_known() {
        let mut status = Status { chain: Chain::UNKNOWN, ..Status::default() };
        assert!(text(&status, 0).contains("chain       nothing to time yet\n"));
        assert!(json(&status)["chain"]["compute_ms"].is_null());
        status.chain.pen_age_ns = 3_100_000;
        status.chain.command_transport_ns = 400_000;
        let page = text(&status, 0);
        assert!(page.contains("chain       pen 3.1 ms old, sent to the arm in 0.4\n"), "{page}");
        status.chain =
            Chain { pen_reader_ns: 100_000, pen_transport_ns: 1_200_000, compute_ns: 20_000, ..status.chain };
        let page = text(&status, 0);
        assert!(
            page.contains("3.1 ms old (0.1 in its reader, 1.2 on the way), computed in 0.02, "),
            "{page}"
        );
        let age_ms = json(&status)["chain"]["pen_age_ms"].as_f64().unwrap();
        assert!((age_ms - 3.1).abs() < 1e-9, "{age_ms}");
    }

    #[test]
    fn the_lag_is_told_with_its_spread_and_what_is_planned_for() {
        let mut status = Status { arm_lag: ArmLag::unknown(42_000_000), ..Status::default() };
        assert!(text(&status, 0).contains("arm lag not measured yet, planned for 42.0 ms\n"));
        assert!(json(&status)["arm_lag"]["lag_ms"].is_null());
        status.arm_lag = ArmLag { dead_time_ns: 33_200_000, lag_s: 0.0341, std_s: 0.0006, shift_s: 0.0332 };
        let page = text(&status, 0);
        assert!(page.contains("arm lag 34.1 ± 0.6 ms, in this motion 33.2, planned for 33.2\n"), "{page}");
        let near = |key: &str, ms: f64| (json(&status)["arm_lag"][key].as_f64().unwrap() - ms).abs() < 1e-9;
        assert!(near("lag_ms", 34.1) && near("std_ms", 0.6) && near("dead_time_ms", 33.2));
    }

    #[test]
    fn json_carries_unknown_ages_as_null_and_every_stage() {
        let status = Status { pen_age_ns: u64::MAX, predictor_rms_m: -1.0, ..Status::default() };
        let value = json(&status);
        assert!(value["pen"]["age_ms"].is_null() && value["predictor"]["rms_m"].is_null());
        assert_eq!(value["stage_us"].as_object().unwrap().len(), Stage::ALL.len());
    }
}
