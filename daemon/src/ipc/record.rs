//! Ticks on the wire: records, counters and the newest tick's part of the status.

use foretrace_control::ghost::GhostReport;
use foretrace_control::mpc::AxisReport;
use foretrace_control::units::Stamp;
use foretrace_shm as shm;
use foretrace_shm::Stage;

use super::chain::Parts;
use super::refused;
use crate::ports::PortTally;
use crate::rt::facts::{LoopTally, StageTimes, TickFacts};
use crate::wire::{self, JOINTS, UNKNOWN, flag, known};

/// Counts of the ipc thread, and additions to counts of the loop.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct IpcTally {
    /// Records that could not be published.
    pub telemetry_failed: u64,
    pub requests: u64,
    /// Requests answered with a refusal.
    pub requests_refused: u64,
    /// Allocations of the loop after warm-up without a connection to explain them.
    pub allocations: u64,
    /// Allocations of the loop explained by a connection.
    pub connection_allocations: u64,
    /// Changes of the set of connected ports.
    pub connection_ticks: u64,
    /// Sets of weights overtaken before they were in the ring.
    pub weights_overtaken: u64,
    /// Events of the learner that were lost.
    pub learner_events_lost: u64,
}

/// All counters as on the wire.
#[must_use]
pub fn counters(facts: &TickFacts, ipc: &IpcTally) -> shm::Counters {
    let (
        LoopTally { ticks, overruns, skipped, shed, joints_stale, evidence_dropped, learn_dropped, .. },
        PortTally { pen_received, pen_dropped, joints_received, joints_dropped, commands_sent, .. },
    ) = (facts.tally, facts.ports);
    let pen = &facts.output.pen_counters;
    shm::Counters {
        ticks,
        overruns,
        skipped_ticks: skipped,
        shed_ticks: shed,
        commands_sent,
        commands_failed: facts.ports.commands_failed,
        pen_received,
        pen_dropped,
        pen_out_of_order: pen.repeats + pen.time_backwards,
        pen_outliers: pen.outliers,
        // The very first sample starts the grid too, without a gap.
        pen_gaps: pen.restarts.saturating_sub(1),
        pen_deferred_ticks: facts.ports.pen_deferred,
        pen_rejected: pen_rejected(facts),
        joint_state_received: joints_received,
        joint_state_dropped: joints_dropped,
        joint_state_stale: joints_stale,
        joint_state_rejected: shm::Rejections { by_reason: facts.ports.joints_rejected },
        enable_rejected: facts.ports.enable_rejected,
        enable_dropped: facts.ports.enable_dropped,
        receive_failures: facts.ports.receive_failures,
        telemetry_ring_dropped: evidence_dropped,
        telemetry_failed: ipc.telemetry_failed,
        learner_ring_dropped: learn_dropped + pen.overwritten,
        weights_refused: facts.tally.weights_refused,
        weights_overtaken: facts.tally.weights_overtaken + ipc.weights_overtaken,
        learner_events_lost: ipc.learner_events_lost,
        requests: ipc.requests,
        requests_refused: ipc.requests_refused,
        allocations: ipc.allocations,
        connection_allocations: ipc.connection_allocations,
        connection_ticks: ipc.connection_ticks,
        page_faults_minor: facts.tally.faults_minor,
        page_faults_major: facts.tally.faults_major,
    }
}

/// Refusals by port and pen grid together; out-of-order samples and outliers have their own counters.
fn pen_rejected(facts: &TickFacts) -> shm::Rejections {
    let pen = &facts.output.pen_counters;
    let mut rejected = shm::Rejections { by_reason: facts.ports.pen_rejected };
    let by_grid = [
        (shm::RejectReason::NotFinite, pen.non_finite),
        (shm::RejectReason::OutOfRange, pen.out_of_range),
        (shm::RejectReason::FromTheFuture, pen.from_future),
    ];
    for (reason, count) in by_grid {
        if let Some(total) = rejected.by_reason.get_mut(reason as usize) {
            *total = total.saturating_add(count);
        }
    }
    rejected
}

/// One tick's facts as published; `before` are those of the last tick that is known.
#[must_use]
pub fn tick_record(
    (before, facts): (Option<&TickFacts>, &TickFacts),
    parts: &Parts,
    ghost: &GhostReport,
    ipc: &IpcTally,
) -> shm::TickRecord {
    let output = &facts.output;
    let (q, qd) = output.command.map_or(([0.0; JOINTS], [0.0; JOINTS]), |command| (command.q, command.qd));
    let [pen_x, pen_y] = output.pen_position;
    let now = facts.wake.release;
    let mut record = shm::TickRecord {
        tick: facts.tick,
        release_ns: facts.wake.release.0,
        command_stamp_ns: output.command.map_or(0, |command| command.stamp.0),
        slack_ns: facts.deadline.since(facts.finished),
        budget_mpc_iterations: facts.given.budget.max_iterations,
        budget_ik_iterations: facts.given.budget.max_iterations,
        shed: facts.given.budget.shed.into(),
        skipped_ticks: u32::try_from(facts.wake.skipped).unwrap_or(u32::MAX),
        pen_sequence: output.pen_origin.sequence,
        pen_stamp_ns: output.pen_stamp.map_or(0, |stamp| stamp.0),
        chain: chain(parts),
        pen_m: [pen_x, pen_y, 0.0],
        pen_samples: facts.given.pen_samples,
        pen_flags: flag(output.pen_contact, shm::pen_flags::CONTACT),
        joint_state_age_ns: age_ns(now, facts.measured.map(|(stamp, _)| stamp)),
        measured_q: facts.measured.map_or([0.0; JOINTS], |(_, q)| q),
        echo_tick: facts.echo.map_or(0, |echo| echo.tick),
        echo_pen_sequence: facts.echo.map_or(0, |echo| echo.pen_sequence),
        echo_pen_stamp_ns: facts.echo.and_then(|echo| echo.pen_stamp).map_or(0, |stamp| stamp.0),
        reference_m: output.reference,
        setpoint_m: output.setpoint.map(|axis| axis.position),
        setpoint_mps: output.setpoint.map(|axis| axis.velocity),
        setpoint_mps2: output.setpoint.map(|axis| axis.acceleration),
        jerk_mps3: jerk(before, facts),
        tool_m: output.tool,
        q,
        qd,
        trust: output.trust.alpha.alpha(),
        trust_target: output.trust.target.alpha(),
        confidence: output.external.map_or(UNKNOWN, |external| external.weight),
        trust_reason: wire::trust_reason(output.trust.reason, output.governor).into(),
        rung: wire::rung(output.rung).into(),
        mode: wire::mode(output.mode).into(),
        fault: wire::fault(output.stop_reason).into(),
        health: health(facts),
        guard_mask: wire::guard_mask(output.guard_altered),
        mpc_active: output.axes.map(|axis| axis.active.total()),
        mpc_iterations: output.axes.map(|axis| axis.iterations),
        mpc_path: wire::mpc_path(output),
        mpc_residual: output.axes.map(|axis: AxisReport| known(axis.kkt_residual)),
        predictor_error_m: output.predictor_error.map_or(UNKNOWN, known),
        predictor_band_m: output.predictor_band.map_or(UNKNOWN, known),
        learner_version: output.weights_version,
        learner_age_ns: facts.weights_since.map_or(0, |since| age_ns(now, Some(since))),
        predictor: wire::predictor(output.predictor),
        allocations: facts.port_allocations.saturating_add(facts.law_allocations),
        connections_changed: (facts.port_allocations > 0).into(),
        counters: counters(facts, ipc),
        arm_lag: wire::arm_lag(output),
        ghost_tool_m: ghost.tool.unwrap_or_default(),
        ghost_state: wire::ghost_state(ghost.state).into(),
        error_m: UNKNOWN,
        ghost_error_m: UNKNOWN,
        stop: wire::stop_detail(&output.stop_detail),
        arm_speed_share: output.arm_speed_share.unwrap_or(UNKNOWN),
        arm_line: facts.ports.arm_line,
        path_points: output.path.points().len() as u32,
        path_m: path(output.path.points()),
        ..Default::default()
    };
    if let Some(compared) = ghost.compared {
        record.compared_ns = compared.instant.0;
        record.error_m = compared.error_m;
        record.ghost_error_m = compared.ghost_error_m;
        record.compared_contact = compared.contact.into();
    }
    wire::ik_report(&mut record, &output.ik, output);
    for (stage, ns) in stages(&facts.times) {
        record.set_stage(stage, ns);
    }
    record
}

const _: () = assert!(shm::PATH_POINTS == foretrace_control::follower::PATH_POINTS);

/// Points as x and y in turn.
fn path(points: &[[f32; 2]]) -> [f32; 2 * shm::PATH_POINTS] {
    let mut numbers = points.as_flattened().iter();
    std::array::from_fn(|_| numbers.next().copied().unwrap_or(0.0))
}

/// Jerk of the setpoint over this tick \[m/s³\]; 0 where the tick before sent nothing or is not known.
fn jerk(before: Option<&TickFacts>, facts: &TickFacts) -> [f64; shm::AXES] {
    let sent = |facts: &TickFacts| facts.output.command.map(|command| command.stamp);
    let follows = |before: &&TickFacts| before.tick.checked_add(1) == Some(facts.tick);
    let Some(before) = before.filter(follows) else { return [0.0; shm::AXES] };
    let elapsed_s = match (sent(before), sent(facts)) {
        (Some(earlier), Some(now)) if now > earlier => now.since(earlier) as f64 * 1e-9,
        _ => return [0.0; shm::AXES],
    };
    let mut axes = facts.output.setpoint.iter().zip(&before.output.setpoint);
    std::array::from_fn(|_| {
        axes.next().map_or(0.0, |(now, before)| (now.acceleration - before.acceleration) / elapsed_s)
    })
}

/// Parts of the latency as on the wire.
#[must_use]
pub fn chain(parts: &Parts) -> shm::Chain {
    let known = |ns: Option<u64>| ns.unwrap_or(u64::MAX);
    shm::Chain {
        pen_reader_ns: known(parts.pen_reader),
        pen_transport_ns: known(parts.pen_transport),
        pen_age_ns: known(parts.pen_age),
        compute_ns: known(parts.compute),
        command_transport_ns: known(parts.command_transport),
    }
}

/// Fills in the status about the newest tick; ages are relative to `now`.
pub fn newest_tick(status: &mut shm::Status, newest: &TickFacts, ipc: &IpcTally, now: Stamp) {
    let output = &newest.output;
    status.mode = wire::mode(output.mode).into();
    status.fault = wire::fault(output.stop_reason).into();
    status.tick = newest.tick;
    status.counters = counters(newest, ipc);
    status.trust = output.trust.alpha.alpha();
    status.trust_target = output.trust.target.alpha();
    status.trust_reason = wire::trust_reason(output.trust.reason, output.governor).into();
    status.predictor = wire::predictor(output.predictor);
    status.predictor_band_m = output.predictor_band.map_or(UNKNOWN, known);
    let previews = &newest.previews;
    status.external = shm::ExternalState {
        share: if previews.steps > 0 { (previews.weights / previews.steps as f64) as f32 } else { -1.0 },
        steps: wire::saturated(previews.steps),
        hits: wire::saturated(previews.hits),
        taken: wire::saturated(previews.taken),
        lost: wire::saturated(newest.ports.previews_lost),
        unsent: wire::saturated(newest.ports.steps_failed),
        refused: refused_previews(newest),
        latency: status.external.latency,
        ..wire::external_state(output.external.as_ref())
    };
    status.pen_age_ns = age_ns(now, output.pen_stamp);
    status.joint_state_age_ns = age_ns(now, newest.measured.map(|(stamp, _)| stamp));
    status.pen_refused = wire::refused(refused::pen(newest));
    status.joints_refused = wire::refused(newest.ports.joints_refused);
    status.enable_refused = wire::refused(newest.ports.enable_refused);
    status.arm_lag = wire::arm_lag(output);
    status.stop = wire::stop_detail(&output.stop_detail);
    status.arm_speed_share = output.arm_speed_share.unwrap_or(UNKNOWN);
    status.arm_line = newest.ports.arm_line;
    status.learner_version = output.weights_version;
    status.learner_age_ns = newest.weights_since.map_or(0, |since| age_ns(now, Some(since)));
}

/// Previews refused by reason; the last is the port's.
fn refused_previews(facts: &TickFacts) -> [u32; shm::PREVIEW_REFUSALS] {
    let mut counts = facts.previews.refused.into_iter().chain([facts.ports.previews_rejected]);
    std::array::from_fn(|_| wire::saturated(counts.next().unwrap_or(0)))
}

/// Stage times by their names on the wire. Trust and preview are one stage in this daemon: `Trust` stays 0.
#[must_use]
pub const fn stages(times: &StageTimes) -> [(Stage, u64); 10] {
    [
        (Stage::Wakeup, times.wakeup),
        (Stage::Receive, times.receive),
        (Stage::Pen, times.pen),
        (Stage::Predict, times.predict),
        (Stage::Trust, 0),
        (Stage::Mpc, times.mpc),
        (Stage::Ik, times.ik),
        (Stage::Guard, times.guard),
        (Stage::Send, times.send),
        (Stage::Step, times.step),
    ]
}

fn health(facts: &TickFacts) -> u32 {
    wire::health(facts.output.health)
        | flag(facts.finished > facts.deadline, shm::health::OVERRUN)
        | flag(facts.not_sent, shm::health::COMMAND_NOT_SENT)
        | flag(facts.port_allocations > 0 || facts.law_allocations > 0, shm::health::ALLOCATED)
}

fn age_ns(now: Stamp, stamp: Option<Stamp>) -> u64 {
    stamp.map_or(u64::MAX, |stamp| now.0.saturating_sub(stamp.0))
}

#[cfg(test)]
mod tests {
    use super::jerk;
    use crate::ipc::tests::{commanding, facts};

    #[test]
    fn the_jerk_is_the_change_of_the_setpoints_acceleration_per_second() {
        let with = |tick, acceleration: f64| {
            let mut facts = commanding(tick);
            facts.output.setpoint[1].acceleration = acceleration;
            facts
        };
        // Ticks of 2 ms.
        let [x, y, z] = jerk(Some(&with(7, 0.25)), &with(8, 0.5));
        assert!((y - 125.0).abs() < 1e-9 && [x, z] == [0.0; 2], "{y}");
        // Nothing is known over a gap, from the first tick on, or where nothing was sent.
        assert_eq!(jerk(Some(&with(6, 0.25)), &with(8, 0.5)), [0.0; 3]);
        assert_eq!(jerk(None, &with(8, 0.5)), [0.0; 3]);
        assert_eq!(jerk(Some(&facts(7)), &with(8, 0.5)), [0.0; 3]);
    }
}
