//! A status message as text for people and as JSON for machines.

use std::fmt::Write as _;

use foretrace_shm::{FaultReason, Mode, Refused, Stage, Status, StopCause, TrustReason, missing_rights};
use serde_json::{Map, Value, json};

use super::chain::{self, latency};
use super::holders::{self, Holders};
use super::{arm_line, bearing, external, way_home};
use crate::extent::ExtentFigures;
use crate::ghost::Comparison;
use crate::stopped;

/// The stages of this daemon: trust and preview are one, shown as `predict`.
const SHOWN: [Stage; 9] = [
    Stage::Wakeup,
    Stage::Receive,
    Stage::Pen,
    Stage::Predict,
    Stage::Mpc,
    Stage::Ik,
    Stage::Guard,
    Stage::Send,
    Stage::Step,
];

/// All there is, as text: mode, rates, spreads of every stage, what was lost, trust, learner, rights; lines
/// of at most `columns`, where a break is possible.
pub fn text_within(columns: usize, status: &Status, holders: &Holders, age_ns: u64) -> String {
    text(status, holders, age_ns)
        .lines()
        .flat_map(|line| folded(line, columns))
        .collect::<Vec<_>>()
        .join("\n")
}

/// Breaks a line between its parts, which three spaces divide, or else between words; what goes on is
/// indented below the first part.
fn folded(line: &str, columns: usize) -> Vec<String> {
    const INDENT: usize = 12;
    let (mut lines, mut left) = (Vec::new(), line.to_owned());
    while left.chars().count() > columns.max(2 * INDENT) {
        let most = left.char_indices().nth(columns.max(2 * INDENT)).map_or(left.len(), |(at, _)| at);
        let head = left.get(..most).unwrap_or(&left);
        let place =
            head.rfind("   ").filter(|at| *at > INDENT).or_else(|| head.rfind(' ').filter(|at| *at > INDENT));
        let Some(at) = place else { break };
        let rest = format!("{:INDENT$}{}", "", left.get(at..).unwrap_or_default().trim_start());
        lines.push(left.get(..at).unwrap_or_default().trim_end().to_owned());
        left = rest;
    }
    lines.push(left);
    lines
}

/// The same in lines as long as they come.
fn text(status: &Status, holders: &Holders, age_ns: u64) -> String {
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
    if let Some(words) = way_home::words(status) {
        line(format_args!("way home    {words}"));
    }
    if matches!(Mode::try_from(status.mode), Ok(Mode::Stopped | Mode::Fault)) {
        let (why, to_do) = stopped::explained(status);
        line(format_args!("stopped     {why}"));
        line(format_args!("to do       {to_do}"));
    } else if status.stop.cause != 0 {
        // Of a past stop only its evidence is shown.
        line(format_args!("last stop   {}", status.stop));
    }
    if let Some(words) = bearing::note(status) {
        line(format_args!("arm says    {words}"));
    }
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
    for stage in SHOWN {
        let spread = status.stage(stage);
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
        "\npen         newest {}   {} samples   {} dropped   {} rejected   {} outliers   {} gaps   {} out of \
         order   {} ticks left some",
        age(status.pen_age_ns),
        counts.pen_received,
        counts.pen_dropped,
        counts.pen_rejected.total(),
        counts.pen_outliers,
        counts.pen_gaps,
        counts.pen_out_of_order,
        counts.pen_deferred_ticks
    ));
    line(format_args!("            {}", holders::words(holders.pen.as_ref())));
    line(format_args!(
        "arm         newest {}   {} states   {} dropped   {} rejected   {} ticks stale   {} commands sent, \
         {} failed",
        age(status.joint_state_age_ns),
        counts.joint_state_received,
        counts.joint_state_dropped,
        counts.joint_state_rejected.total(),
        counts.joint_state_stale,
        counts.commands_sent,
        counts.commands_failed
    ));
    if let (Some(joints), Some(pose)) = (bearing::joints(status), bearing::pose(status)) {
        line(format_args!("joints      {joints}"));
        line(format_args!("pose        {pose}"));
    }
    if let Some(words) = arm_line::words(&status.arm_line) {
        line(format_args!("line        {words}"));
    }
    line(format_args!(
        "dead man    {}   {} messages dropped   {} rejected",
        holders::words(holders.dead_man.as_ref()),
        counts.enable_dropped,
        counts.enable_rejected
    ));
    for (who, refused) in refusals(status) {
        let ago = status.header.stamp_ns.saturating_sub(refused.at_ns);
        line(format_args!("refused     {who}: {refused}   ({} ago)", milliseconds(ago)));
    }
    if let Some(extent) = ExtentFigures::reported(&status.extent) {
        line(format_args!("tool        {extent}{}", slow(status.arm_speed_share)));
    }
    line(format_args!("chain       {}", chain::text(status)));
    line(format_args!("ghost       {}", Comparison::of(status).now()));
    line(format_args!(
        "trust       {:.2} -> {:.2} ({})   predictor {}{}",
        status.trust,
        status.trust_target,
        label::<TrustReason>(status.trust_reason),
        status.predictor,
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
    if let Some(words) = external::text(&status.external) {
        line(format_args!("external    {words}"));
    }
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
        "rings       {} telemetry and {} learner records dropped   {} weights refused, {} overtaken   {} \
         events lost",
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
    } else if status.missing_rights == missing_rights::NOT_ASKED {
        "none asked for (--no-rights)".to_owned()
    } else {
        format!("missing: {}", missing.join(", "))
    };
    line(format_args!("rights      {rights}"));
    if let Some(flight) = &holders.flight {
        line(format_args!("flight      {}", holders::flight_words(flight)));
    }
    page
}

/// Everything in the status under stable keys.
pub fn json(status: &Status, holders: &Holders) -> Value {
    let counts = &status.counters;
    let stages: Map<String, Value> = SHOWN
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
    let mut value = json!({
        "mode": label::<Mode>(status.mode),
        "fault": label::<FaultReason>(status.fault),
        "way_home": way_home::value(&status.way_home),
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
            "holder": holders::value(holders.pen.as_ref()),
            "age_ms": age_ms(status.pen_age_ns),
            "samples": counts.pen_received,
            "dropped": counts.pen_dropped,
            "rejected": counts.pen_rejected.total(),
            "outliers": counts.pen_outliers,
            "gaps": counts.pen_gaps,
            "out_of_order": counts.pen_out_of_order,
            "deferred_ticks": counts.pen_deferred_ticks,
        },
        "flight": holders.flight.as_ref().map_or(Value::Null, holders::flight_value),
        "dead_man": {
            "holder": holders::value(holders.dead_man.as_ref()),
            "dropped": counts.enable_dropped,
            "rejected": counts.enable_rejected,
        },
        "arm": {
            "age_ms": age_ms(status.joint_state_age_ns),
            "states": counts.joint_state_received,
            "dropped": counts.joint_state_dropped,
            "rejected": counts.joint_state_rejected.total(),
            "stale_ticks": counts.joint_state_stale,
            "commands_sent": counts.commands_sent,
            "commands_failed": counts.commands_failed,
            "line": arm_line::json(&status.arm_line),
        },
        "stop": {
            "reason": label::<FaultReason>(status.fault),
            "cause": label::<StopCause>(status.stop.cause),
            "joint": (status.stop.joint >= 0).then_some(status.stop.joint),
            "amount": status.stop.amount,
            "limit": status.stop.limit,
            "at_ns": (status.stop.at_ns != 0).then_some(status.stop.at_ns),
            "detail": status.stop.to_string(),
        },
        "refused": refusals(status).map(|(who, refused)| json!({
            "what": who,
            "why": refused.rejection().map(|rejection| rejection.to_string()),
            "reason": refused.rejection().map(|rejection| rejection.reason.label()),
            "field": refused.rejection().map(|rejection| rejection.field),
            "index": refused.rejection().and_then(|rejection| rejection.index),
            "value": refused.rejection().map(|rejection| rejection.value),
            "bound": refused.rejection().map(|rejection| rejection.bound),
            "age_ms": age_ms(status.header.stamp_ns.saturating_sub(refused.at_ns)),
        })).collect::<Vec<_>>(),
        "envelope": ExtentFigures::reported(&status.extent),
        "arm_speed_share": (status.arm_speed_share >= 0.0).then_some(status.arm_speed_share),
        "chain": chain::json(status),
        "pen_to_command": latency(&status.pen_to_command),
        "command_to_motion": latency(&status.command_to_motion),
        "arm_lag": chain::lag_json(status),
        "ghost": Comparison::of(status),
        "trust": {
            "value": status.trust,
            "target": status.trust_target,
            "reason": label::<TrustReason>(status.trust_reason),
        },
        "predictor": {
            "name": status.predictor.as_str(),
            "rms_m": (status.predictor_rms_m >= 0.0).then_some(status.predictor_rms_m),
            "band_m": (status.predictor_band_m >= 0.0).then_some(status.predictor_band_m),
            "external": external::json(&status.external),
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
            "telemetry_failed": counts.telemetry_failed,
            "receives_failed": counts.receive_failures,
        },
        "page_faults": { "minor": counts.page_faults_minor, "major": counts.page_faults_major },
    });
    if let Some(Value::Object(arm)) = value.get_mut("arm") {
        arm.extend(bearing::json(status).map(|(key, value)| (key.to_owned(), value)));
    }
    value
}

/// The word for a number on the wire.
pub(crate) fn label<E: TryFrom<u32> + ToString>(value: u32) -> String {
    E::try_from(value).map_or_else(|_| format!("unknown ({value})"), |known| known.to_string())
}

/// The newest refusal of each kind of message of which there was one.
pub(crate) fn refusals(status: &Status) -> impl Iterator<Item = (&'static str, &Refused)> {
    let all = [
        ("pen", &status.pen_refused),
        ("joint state", &status.joints_refused),
        ("dead man", &status.enable_refused),
        ("echo", &status.echo_refused),
    ];
    all.into_iter().filter(|(_, refused)| refused.at_ns != 0)
}

/// An arm that moves less than it is commanded to.
fn slow(share: f64) -> String {
    if (0.0..0.95).contains(&share) {
        format!("   the arm moves at about {:.0} % of the commanded speed", share * 100.0)
    } else {
        String::new()
    }
}

pub(crate) fn age_ms(ns: u64) -> Option<f64> {
    (ns != u64::MAX).then_some(ns as f64 * 1e-6)
}

/// How old the newest message is, in words.
pub(crate) fn age(ns: u64) -> String {
    if ns == u64::MAX { "none yet".to_owned() } else { format!("{} old", milliseconds(ns)) }
}

pub(crate) fn milliseconds(ns: u64) -> String {
    match age_ms(ns) {
        None => "never".to_owned(),
        Some(ms) if ms < 10_000.0 => format!("{ms:.1} ms"),
        Some(_) => seconds(ns),
    }
}

pub(crate) fn seconds(ns: u64) -> String {
    format!("{:.1} s", ns as f64 * 1e-9)
}

#[cfg(test)]
mod tests {
    use foretrace_shm::{StopDetail, ToolExtent};

    use super::*;

    #[test]
    fn text_names_mode_stages_trust_and_missing_rights() {
        let mut status = Status {
            mode: Mode::Following.into(),
            missing_rights: missing_rights::FIFO,
            trust: 0.5,
            trust_reason: TrustReason::Evidence.into(),
            pen_age_ns: u64::MAX,
            ..Status::default()
        };
        status.stages[Stage::Mpc as usize].p99_ns = 12_340;
        let page = text(&status, &Holders::default(), 3_000_000);
        for words in ["following", "real-time scheduling", "12.34", "0.50", "evidence", "newest none yet"] {
            assert!(page.contains(words), "{words} missing in\n{page}");
        }
    }

    #[test]
    fn stop_is_told_with_evidence_and_remedy_and_later_as_the_last_one() {
        let stop = StopDetail {
            cause: StopCause::Height.into(),
            joint: -1,
            amount: -0.04,
            limit: -0.0025,
            at_ns: 7,
        };
        let extent =
            ToolExtent { height_min_m: -0.04, height_max_m: 0.01, outside_max_m: 0.0, tilt_max_rad: 0.1 };
        let (mode, fault) = (Mode::Stopped.into(), FaultReason::Envelope.into());
        let mut status = Status { mode, fault, stop, extent, arm_speed_share: 0.3, ..Status::default() };
        let page = text(&status, &Holders::default(), 0);
        for words in [
            "stopped     tool envelope: the tool is -40.0 mm",
            "to do ",
            "tool        -40.0 to 10.0 mm",
            "30 % of",
        ] {
            assert!(page.contains(words), "{words} missing in\n{page}");
        }
        let value = json(&status, &Holders::default());
        assert_eq!(
            (&value["stop"]["cause"], &value["stop"]["joint"]),
            (&json!("height over the paper"), &Value::Null)
        );
        assert_eq!(value["envelope"]["height_min_m"], -0.04);
        status.mode = Mode::Following.into();
        let page = text(&status, &Holders::default(), 0);
        assert!(page.contains("last stop   the tool is") && !page.contains("to do"), "{page}");
    }

    #[test]
    fn no_line_is_wider_than_it_may_be_and_nothing_is_lost() {
        let status = Status { pen_age_ns: 7, joint_state_age_ns: 7, ..Status::default() };
        let whole = text(&status, &Holders::default(), 0);
        for columns in [60, 80, 120, 400] {
            let page = text_within(columns, &status, &Holders::default(), 0);
            assert!(page.lines().all(|line| line.chars().count() <= columns), "{page}");
            let words = |text: &str| text.split_whitespace().map(str::to_owned).collect::<Vec<_>>();
            assert_eq!(words(&page), words(&whole));
        }
    }

    #[test]
    fn json_carries_unknown_ages_as_null_and_every_stage() {
        let status = Status { pen_age_ns: u64::MAX, predictor_rms_m: -1.0, ..Status::default() };
        let value = json(&status, &Holders::default());
        assert!(value["pen"]["age_ms"].is_null() && value["predictor"]["rms_m"].is_null());
        assert_eq!(value["stage_us"].as_object().unwrap().len(), SHOWN.len());
    }
}
