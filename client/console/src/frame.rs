//! What a page is told many times per second: the arm, the traces, the state.
//!
//! Contract: a frame is whole by itself but for the traces, which overlap, so that a page that misses a frame
//! misses no point unless it misses many.

use std::collections::VecDeque;

use foretrace_client::wire::{
    ExternalState, FaultReason, GhostState, Latency, PreviewRefusal, StopDetail, Tracking, TrustReason,
    pen_flags,
};
use foretrace_client::{Mode, Stage, Status, TickRecord, monotonic_now_ns};
use foretrace_config::Config;
use serde_json::{Value, json};

use crate::scene::placed;

/// One of so many ticks is a point of the traces.
const STRIDE: u64 = 5;
/// Points that a frame carries: 0.4 s at 500 Hz.
const POINTS: usize = 40;
/// Comparisons with the ghost that a frame carries.
const ERRORS: usize = 20;

/// What to do about a stop, in words.
pub(crate) type Remedy = dyn Fn(FaultReason, &StopDetail) -> String + Send + Sync;

/// What frames are made of.
pub(crate) struct PageFrames {
    config: Config,
    newest: Option<TickRecord>,
    points: VecDeque<Value>,
    errors: VecDeque<Value>,
}

impl PageFrames {
    pub(crate) fn new(config: Config) -> Self {
        Self { config, newest: None, points: VecDeque::new(), errors: VecDeque::new() }
    }

    /// Takes in the record of a tick.
    pub(crate) fn take(&mut self, record: &TickRecord) {
        if record.tick.is_multiple_of(STRIDE) {
            let point = json!([
                record.tick,
                metres(record.pen_m[0]),
                metres(record.pen_m[1]),
                record.pen_flags & (pen_flags::CONTACT | pen_flags::IN_RANGE),
                metres(record.tool_m[0]),
                metres(record.tool_m[1]),
                metres(record.tool_m[2]),
                metres(record.ghost_tool_m[0]),
                metres(record.ghost_tool_m[1]),
            ]);
            push(&mut self.points, point, POINTS);
        }
        if record.compared_ns != 0 && record.error_m >= 0.0 {
            let error = json!([record.tick, micro(record.error_m), micro(record.ghost_error_m)]);
            push(&mut self.errors, error, ERRORS);
        }
        self.newest = Some(*record);
    }

    /// A daemon went, or another came.
    pub(crate) fn restart(&mut self) {
        self.newest = None;
        self.points.clear();
        self.errors.clear();
    }

    /// The frame of this moment; `here` is what only the link knows.
    pub(crate) fn frame(&self, status: Option<&Status>, here: Value, remedy: &Remedy) -> Value {
        let chain = &self.config.robot().chain;
        let arm = self.newest.map(|record| {
            json!({
                "aim": aim(&record),
                "path": path(&record),
                "measured": placed(chain, &record.measured_q),
                "commanded": placed(chain, &record.q),
                "known": record.joint_state_age_ns != u64::MAX,
            })
        });
        json!({ "frame": {
            "arm": arm,
            "points": self.points,
            "errors": self.errors,
            "state": status.map(|status| state(status, remedy)),
            "here": here,
        } })
    }
}

/// Where the preview leads the plan: its first reference in the plane, and the radius about it in which the
/// pen is expected in nine of ten cases; `None` while the plan follows no pen.
fn aim(record: &TickRecord) -> Option<[Option<f64>; 3]> {
    let [x, y, _] = record.reference_m;
    let follows = Mode::try_from(record.mode) == Ok(Mode::Following) && x.is_finite() && y.is_finite();
    let band = (record.predictor_band_m >= 0.0).then(|| metres(record.predictor_band_m));
    follows.then(|| [Some(metres(x)), Some(metres(y)), band])
}

/// The previewed path in the plane, from soon to late; empty while the plan follows no pen.
fn path(record: &TickRecord) -> Vec<[f64; 2]> {
    let follows = Mode::try_from(record.mode) == Ok(Mode::Following);
    let points = record.path().filter(|_| follows).map(|at| at.map(|m| metres(m.into())));
    points.filter(|at| at.iter().all(|m| m.is_finite())).collect()
}

fn push(list: &mut VecDeque<Value>, value: Value, most: usize) {
    if list.len() == most {
        list.pop_front();
    }
    list.push_back(value);
}

/// Metres to a hundredth of a millimetre; what is not finite is null in JSON.
fn metres(value: f64) -> f64 {
    (value * 1e5).round() / 1e5
}

/// Radians to a millionth.
fn micro_rad(value: f64) -> f64 {
    (value * 1e6).round() / 1e6
}

/// Metres in whole micrometres; none below zero.
fn micro(value: f64) -> Option<f64> {
    (value >= 0.0).then_some((value * 1e6).round())
}

fn state(status: &Status, remedy: &Remedy) -> Value {
    let mode = Mode::try_from(status.mode).ok();
    let fault = FaultReason::try_from(status.fault).unwrap_or(FaultReason::Internal);
    let stopped = matches!(mode, Some(Mode::Stopped | Mode::Fault));
    let ms = |ns: u64| (ns != u64::MAX).then_some(ns as f64 * 1e-6);
    let stages = [Stage::Wakeup, Stage::Predict, Stage::Mpc, Stage::Ik, Stage::Step].map(|stage| {
        let spread = status.stage(stage);
        json!([stage.label(), f64::from(spread.p50_ns) * 1e-3, f64::from(spread.p99_ns) * 1e-3])
    });
    let refusals = [
        ("pen", &status.pen_refused),
        ("joint state", &status.joints_refused),
        ("dead man", &status.enable_refused),
        ("echo", &status.echo_refused),
    ];
    let now_ns = monotonic_now_ns();
    let refused: Vec<Value> = refusals
        .into_iter()
        .filter(|(_, refused)| refused.at_ns != 0)
        .map(|(who, refused)| {
            json!({
                "who": who,
                "why": refused.to_string(),
                "ago_s": now_ns.saturating_sub(refused.at_ns) as f64 * 1e-9,
            })
        })
        .collect();
    json!({
        "mode": mode.map(|mode| mode.to_string()),
        "stopped": stopped.then(|| json!({
            "why": fault.to_string(),
            "evidence": status.stop.to_string(),
            "remedy": remedy(fault, &status.stop),
        })),
        "age_ms": ms(status.header.age_ns(now_ns)),
        "rate_hz": status.measured_rate_hz,
        "overruns": status.counters.overruns,
        "skipped": status.counters.skipped_ticks,
        "shed": status.counters.shed_ticks,
        "trust": status.trust,
        "trust_target": status.trust_target,
        "trust_reason": TrustReason::try_from(status.trust_reason).map(|reason| reason.to_string()).ok(),
        "predictor": status.predictor.as_str(),
        "external": external(&status.external),
        "pen_age_ms": ms(status.pen_age_ns),
        "pen_samples": status.counters.pen_received,
        "pen_rejected": status.counters.pen_rejected.total(),
        "arm_age_ms": ms(status.joint_state_age_ns),
        "joints_rad": ms(status.joint_state_age_ns).map(|_| status.joints_q.map(micro_rad)),
        "tool_m": ms(status.joint_state_age_ns).map(|_| status.tool_plane_m.map(metres)),
        "arm_note": status.note.text().map(|text| json!({
            "text": text,
            "to_do": status.note.to_do(),
            "age_s": now_ns.saturating_sub(status.note_since_ns) as f64 * 1e-9,
        })),
        "chain_ms": {
            "reader": ms(status.chain.pen_reader_ns),
            "transport": ms(status.chain.pen_transport_ns),
            "compute": ms(status.chain.compute_ns),
            "to_arm": ms(status.chain.command_transport_ns),
            "lag": status.arm_lag.is_known().then_some(status.arm_lag.lag_s * 1e3),
        },
        "pen_to_command_ms": median(&status.pen_to_command),
        "command_to_motion_ms": median(&status.command_to_motion),
        "stages_us": stages,
        "error_mm": rms(&status.tracking),
        "ghost_mm": rms(&status.ghost),
        "ghost_state": GhostState::try_from(status.ghost_state).map(|state| state.to_string()).ok(),
        "refused": refused,
    })
}

fn median(latency: &Latency) -> Option<f64> {
    (latency.count > 0).then(|| f64::from(latency.percentiles.p50_ns) * 1e-6)
}

fn rms(tracking: &Tracking) -> Option<f64> {
    let rms = tracking.recent_rms_m;
    (rms >= 0.0).then_some(rms * 1e3)
}

/// The predictor of another process, with the refusals that there were by reason; null: it is not chosen.
fn external(state: &ExternalState) -> Value {
    if !(state.weight >= 0.0) {
        return Value::Null;
    }
    let refused = (1..).zip(state.refused).filter(|(_, count)| *count > 0).filter_map(|(number, count)| {
        let why = PreviewRefusal::try_from(number).ok()?;
        Some((why.to_string(), Value::from(count)))
    });
    json!({
        "weight": state.weight,
        "share": state.share,
        "evidence": state.evidence,
        "hits": state.hits,
        "steps": state.steps,
        "refused": refused.collect::<serde_json::Map<_, _>>(),
        "latency_ms": (state.latency.p50_ns > 0).then(|| f64::from(state.latency.p50_ns) * 1e-6),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_predictor_of_another_process_is_shown_with_what_was_refused_of_it() {
        assert_eq!(external(&ExternalState::NONE), Value::Null);
        let mut state = ExternalState { weight: 0.5, share: 0.25, evidence: 7.0, ..ExternalState::NONE };
        (state.refused[1], state.refused[6]) = (2, 7);
        let shown = external(&state);
        assert_eq!((&shown["share"], &shown["evidence"]), (&json!(0.25), &json!(7.0)));
        assert_eq!(shown["refused"], json!({ "non-finite": 2, "wild": 7 }));
    }

    #[test]
    fn the_path_is_that_of_the_record_and_there_is_none_while_nothing_is_followed() {
        let mut record = TickRecord { mode: Mode::Following.into(), path_points: 2, ..TickRecord::default() };
        record.path_m[..4].copy_from_slice(&[0.01, -0.02, 0.03, f32::NAN]);
        assert_eq!(path(&record), [[0.01, -0.02]]);
        record.path_m[3] = 0.04;
        assert_eq!(path(&record), [[0.01, -0.02], [0.03, 0.04]]);
        assert!(path(&TickRecord { mode: Mode::Stopped.into(), ..record }).is_empty());
        assert!(path(&TickRecord { path_points: 0, ..record }).is_empty());
    }

    #[test]
    fn the_aim_is_the_first_reference_with_its_band_and_only_while_the_plan_follows() {
        let following = TickRecord {
            mode: Mode::Following.into(),
            reference_m: [0.012_345_6, -0.02, 0.0],
            predictor_band_m: 0.003,
            ..TickRecord::default()
        };
        let reported = aim(&following).unwrap().map(|m| (m.unwrap() * 1e5).round() as i32);
        assert_eq!(reported, [1235, -2000, 300]);
        assert_eq!(aim(&TickRecord { predictor_band_m: -1.0, ..following }).unwrap()[2], None);
        assert_eq!(aim(&TickRecord { mode: Mode::Stopped.into(), ..following }), None);
        assert_eq!(aim(&TickRecord { reference_m: [f64::NAN, 0.0, 0.0], ..following }), None);
    }
}
