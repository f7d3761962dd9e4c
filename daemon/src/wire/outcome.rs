//! The law's output in a tick, part by part as in records and status.

use foretrace_control::arm::lag::LagEstimate;
use foretrace_control::extent::Extent;
use foretrace_control::follower::{Health, Mode, Rung, StepOutput};
use foretrace_control::ghost::{GhostFigures, Tracking};
use foretrace_control::guard::Reasons;
use foretrace_control::ik::{IkReport, IkSource};
use foretrace_control::mpc::SolvePath;
use foretrace_shm as shm;
use foretrace_shm::SolverPath;

use super::words::ghost_state;
use super::{JOINTS, flag};

/// Stands for an unknown age or a residual that was not computed.
pub const UNKNOWN: f64 = -1.0;

/// Extremes of the measured tool.
#[must_use]
pub const fn extent(extent: &Extent) -> shm::ToolExtent {
    let [height_min_m, height_max_m] = extent.height_m;
    shm::ToolExtent {
        height_min_m,
        height_max_m,
        outside_max_m: extent.outside_m,
        tilt_max_rad: extent.tilt_rad,
    }
}

/// The lag of the arm, and the plan's dead time.
#[must_use]
pub fn arm_lag(output: &StepOutput<JOINTS>) -> shm::ArmLag {
    let unknown = shm::ArmLag::unknown(output.dead_time_ns);
    output.lag.map_or(unknown, |LagEstimate { lag_s, std_s, shift_s }| shm::ArmLag {
        lag_s,
        std_s,
        shift_s,
        ..unknown
    })
}

/// Fills in the gain of the prediction.
pub fn ghost_figures(status: &mut shm::Status, figures: &GhostFigures, cost_ns: u32) {
    status.tracking = tracking(&figures.real);
    status.ghost = tracking(&figures.ghost);
    status.compared_s = figures.seconds;
    status.ghost_state = ghost_state(figures.state).into();
    status.ghost_cost_ns = cost_ns;
}

fn tracking(tracking: &Tracking) -> shm::Tracking {
    let metres = |value: Option<f64>| value.unwrap_or(UNKNOWN);
    let seconds = |value: Option<f64>| value.unwrap_or(f64::NAN);
    shm::Tracking {
        recent_rms_m: metres(tracking.recent_rms),
        session_rms_m: metres(tracking.session_rms),
        hover_rms_m: metres(tracking.hover_rms),
        recent_lag_s: seconds(tracking.recent_lag),
        session_lag_s: seconds(tracking.session_lag),
    }
}

/// Fills in how the joints were solved.
pub fn ik_report(record: &mut shm::TickRecord, report: &IkReport, output: &StepOutput<JOINTS>) {
    let planned = solves(output);
    record.ik_active = report.active.lower | report.active.upper;
    record.ik_iterations = report.iterations;
    record.ik_residual = known(report.kkt_residual);
    record.ik_path = match report.source {
        _ if !planned => SolverPath::NotRun,
        IkSource::Optimum if report.iterations == 0 => SolverPath::Gain,
        IkSource::Optimum => SolverPath::ActiveSet,
        IkSource::Clamped | IkSource::Brake => SolverPath::Fallback,
    }
    .into();
}

/// Whether plan and joints of this tick were solved in it.
fn solves(output: &StepOutput<JOINTS>) -> bool {
    output.command.is_some() && output.mode != Mode::Homing && matches!(output.rung, Rung::FreshPlan)
}

/// How each axis of the plan was solved.
#[must_use]
pub fn mpc_path(output: &StepOutput<JOINTS>) -> [u32; shm::AXES] {
    let run = matches!(output.mode, Mode::Following | Mode::Holding);
    output.axes.map(|axis| {
        match axis.path {
            _ if !run => SolverPath::NotRun,
            _ if !solves(output) => SolverPath::Fallback,
            SolvePath::Gain => SolverPath::Gain,
            SolvePath::ActiveSet => SolverPath::ActiveSet,
            SolvePath::Other => SolverPath::Clarabel,
            SolvePath::Failed => SolverPath::Fallback,
        }
        .into()
    })
}

/// Health of the law.
#[must_use]
pub fn health(health: Health) -> u32 {
    use shm::health as wire;
    let of = |bit, wire| flag(health.has(bit), wire);
    of(Health::PEN_STALE, wire::PEN_STALE)
        | of(Health::PEN_REJECTED, wire::PEN_REJECTED)
        | of(Health::PEN_JUMP, wire::PEN_JUMP)
        | of(Health::PREDICTOR_INVALID, wire::PREDICTOR_UNHEALTHY)
        | of(Health::WEIGHTS_REFUSED, wire::WEIGHTS_REFUSED)
        | of(Health::MPC_FAILED, wire::MPC_CAP)
        | of(Health::FALLBACK, wire::MPC_FALLBACK)
        | of(Health::IK_FAILED, wire::IK_CAP)
        | of(Health::IK_LIMITED, wire::IK_CLIPPED)
        | of(Health::GUARD_ALTERED, wire::GUARD_CLIPPED)
        | of(Health::CLEARANCE, wire::CLEARANCE)
        | of(Health::PATH_LOST, wire::STOP_OFF_PATH)
        | of(Health::RESYNCHRONISED, wire::RESYNCHRONISED)
        | of(Health::SHED, wire::SHED)
        | of(Health::JOINTS_STALE, wire::JOINT_STATE_STALE)
        | of(Health::ENABLE_MISSING, wire::DEAD_MAN)
        | of(Health::TIME_LOST, wire::TIME_LOST)
}

/// Why the guard altered a command.
#[must_use]
pub fn guard_mask(reasons: u32) -> u32 {
    use shm::guard_mask as wire;
    let of = |reason: Reasons, bit| flag(reasons & u32::from(reason.bits()) != 0, bit);
    of(Reasons::NOT_FINITE, wire::NOT_FINITE)
        | of(Reasons::POSITION, wire::POSITION)
        | of(Reasons::VELOCITY, wire::VELOCITY)
        | of(Reasons::ACCELERATION, wire::ACCELERATION)
        | of(Reasons::JERK, wire::JERK)
        | of(Reasons::STAMP, wire::DISCONTINUOUS)
        | of(Reasons::GAP, wire::DISCONTINUOUS)
}

/// The number; `UNKNOWN` if NaN.
#[must_use]
pub const fn known(value: f64) -> f64 {
    if value.is_nan() { UNKNOWN } else { value }
}
