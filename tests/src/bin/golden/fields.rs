//! The fields that are compared, in the order in which they are written. Wall times and names are not
//! compared.

use foretrace_control::follower::{Refusal, StepOutput};
use foretrace_control::units::AxisState;

use crate::file::digest;

macro_rules! names {
    ($($name:literal),* $(,)?) => { &[$($name),*] };
}

pub(crate) const NAMES: &[&str] = names![
    "command",
    "command.stamp",
    "command.valid_until",
    "command.enabled",
    "q0",
    "q1",
    "q2",
    "q3",
    "q4",
    "q5",
    "qd0",
    "qd1",
    "qd2",
    "qd3",
    "qd4",
    "qd5",
    "begins",
    "mode",
    "stop_reason",
    "stop_detail.cause",
    "stop_detail.joint",
    "stop_detail.amount",
    "stop_detail.limit",
    "stop_detail.at",
    "arm_speed_share",
    "answer",
    "home.moving",
    "home.share",
    "home.left_s",
    "way",
    "rung",
    "health",
    "trust.alpha",
    "trust.target",
    "trust.reason",
    "predictor",
    "weights_version",
    "pen_stamp",
    "pen_origin.sequence",
    "pen_origin.sent",
    "pen_origin.received",
    "pen_x",
    "pen_y",
    "pen_contact",
    "pen_counters",
    "pen_refused.why",
    "pen_refused.axis",
    "pen_refused.value",
    "pen_refused.bound",
    "pen_refused.at",
    "predictor_error",
    "predictor_band",
    "dead_time_ns",
    "lag_s",
    "lag.std_s",
    "lag.shift_s",
    "reference.x",
    "reference.y",
    "reference.z",
    "setpoint.x",
    "setpoint.x.velocity",
    "setpoint.x.acceleration",
    "setpoint.y",
    "setpoint.y.velocity",
    "setpoint.y.acceleration",
    "setpoint.z",
    "setpoint.z.velocity",
    "setpoint.z.acceleration",
    "tool.x",
    "tool.y",
    "tool.z",
    "axis.x.path",
    "axis.x.status",
    "axis.x.iterations",
    "axis.x.active",
    "axis.x.kkt",
    "axis.y.path",
    "axis.y.status",
    "axis.y.iterations",
    "axis.y.active",
    "axis.y.kkt",
    "axis.z.path",
    "axis.z.status",
    "axis.z.iterations",
    "axis.z.active",
    "axis.z.kkt",
    "ik.source",
    "ik.status",
    "ik.iterations",
    "ik.lower",
    "ik.upper",
    "ik.kkt",
    "ik.error.x",
    "ik.error.y",
    "ik.error.z",
    "ik.tilt_error",
    "ik.damping",
    "ik.singularity",
    "ik.clearance",
    "ik.envelope",
    "guard_altered",
    "learn",
];
pub(crate) const COUNT: usize = NAMES.len();

/// Bits of a number; all NaNs alike.
fn bits(value: f64) -> u64 {
    if value.is_nan() { f64::NAN.to_bits() } else { value.to_bits() }
}

/// The value for an absent field.
fn maybe(value: Option<f64>) -> u64 {
    value.map_or(u64::MAX, bits)
}

/// The refusals without data, by their index here: their names may change.
const PLAIN: [Refusal; 16] = [
    Refusal::NoJointState,
    Refusal::JointStateStale,
    Refusal::MotionNotAllowed,
    Refusal::ArmMoves,
    Refusal::OutsideJointLimits,
    Refusal::ToolOutsideWorkspace,
    Refusal::ToolNotAligned,
    Refusal::EnableMissing,
    Refusal::StillStopping,
    Refusal::AlreadyArmed,
    Refusal::DisarmFirst,
    Refusal::MovesHome,
    Refusal::NotFollowing,
    Refusal::StopCame,
    Refusal::BadValue,
    Refusal::PredictorUnavailable,
];

fn refusal(answer: Option<Result<(), Refusal>>) -> u64 {
    match answer {
        None => 0,
        Some(Ok(())) => 1,
        Some(Err(Refusal::WayBlocked(blocked))) => digest(
            [u64::from(blocked.pair), u64::from(blocked.percent), blocked.distance_um as u64].into_iter(),
        ),
        Some(Err(refusal)) => {
            let place = PLAIN.iter().position(|plain| *plain == refusal);
            2 + place.unwrap_or_else(|| panic!("{refusal:?} is not in the list")) as u64
        }
    }
}

/// Appends the values of one tick, in the order of [`NAMES`].
pub(crate) fn append(output: &StepOutput<6>, values: &mut Vec<u64>) {
    let before = values.len();
    let command = output.command;
    values.push(u64::from(command.is_some()));
    values.push(command.map_or(0, |command| command.stamp.0));
    values.push(command.map_or(0, |command| command.valid_until.0));
    values.push(command.map_or(0, |command| u64::from(command.enabled)));
    for joints in [command.map(|command| command.q), command.map(|command| command.qd)] {
        values.extend(joints.map_or([u64::MAX; 6], |joints| joints.map(bits)));
    }
    values.extend([u64::from(output.begins), output.mode as u64, output.stop_reason as u64]);
    let detail = output.stop_detail;
    values.extend([detail.cause as u64, detail.joint.map_or(u64::MAX, u64::from)]);
    values.extend([bits(detail.amount), bits(detail.limit), detail.at.0]);
    values.extend([maybe(output.arm_speed_share), refusal(output.answer)]);
    values.push(output.home.map_or(u64::MAX, |home| u64::from(home.moving)));
    values.extend([maybe(output.home.map(|home| home.share)), maybe(output.home.map(|home| home.left_s))]);
    values.extend([refusal(output.way), output.rung as u64, u64::from(output.health.0)]);
    let trust = output.trust;
    values.extend([bits(trust.alpha.alpha()), bits(trust.target.alpha()), trust.reason as u64]);
    values.extend([output.predictor.index() as u64, output.weights_version]);
    let origin = output.pen_origin;
    values.push(output.pen_stamp.map_or(u64::MAX, |stamp| stamp.0));
    values.extend([origin.sequence, origin.sent.0, origin.received.0]);
    values.extend([output.pen_position.map(bits)[0], output.pen_position.map(bits)[1]]);
    values.push(u64::from(output.pen_contact));
    let pen = output.pen_counters;
    values.push(digest(
        [
            pen.received,
            pen.accepted,
            pen.non_finite,
            pen.out_of_range,
            pen.from_future,
            pen.repeats,
            pen.time_backwards,
            pen.outliers,
            pen.jumps,
            pen.restarts,
            pen.overwritten,
        ]
        .into_iter(),
    ));
    values.push(output.pen_refused.map_or(u64::MAX, |refused| refused.why as u64));
    values.push(output.pen_refused.and_then(|refused| refused.axis).map_or(u64::MAX, u64::from));
    values.push(maybe(output.pen_refused.map(|refused| refused.value)));
    values.push(maybe(output.pen_refused.map(|refused| refused.bound)));
    values.push(output.pen_refused.map_or(u64::MAX, |refused| refused.at.0));
    values.extend([maybe(output.predictor_error), maybe(output.predictor_band), output.dead_time_ns]);
    let lag = output.lag.map(|lag| [lag.lag_s, lag.std_s, lag.shift_s]);
    values.extend(lag.map_or([u64::MAX; 3], |lag| lag.map(bits)));
    values.extend(output.reference.map(bits));
    for AxisState { position, velocity, acceleration } in output.setpoint {
        values.extend([position, velocity, acceleration].map(bits));
    }
    values.extend(output.tool.map(bits));
    for axis in &output.axes {
        let active = &axis.active;
        let counts = [active.jerk, active.acceleration, active.velocity, active.position, active.saturated];
        values.extend([axis.path as u64, axis.status as u64, u64::from(axis.iterations)]);
        values.extend([digest(counts.into_iter().map(u64::from)), bits(axis.kkt_residual)]);
    }
    let ik = &output.ik;
    values.extend([ik.source as u64, ik.status as u64, u64::from(ik.iterations)]);
    values.extend([u64::from(ik.active.lower), u64::from(ik.active.upper), bits(ik.kkt_residual)]);
    values.extend(ik.velocity_error.iter().copied().map(bits));
    values.extend([ik.tilt_error, ik.damping, ik.singularity].map(bits));
    let clearance = [ik.clearance.rows, ik.clearance.held, ik.clearance.yielded];
    values.extend([
        digest(clearance.into_iter().map(u64::from)),
        digest(ik.envelope.into_iter().map(u64::from)),
    ]);
    let steps = output.learn.iter().take(output.learn_count);
    let learn = steps.flat_map(|step| {
        let numbers = [step.pen.x[0], step.pen.x[1], step.scale_m, step.limit, step.level].map(bits);
        [step.index, step.motion as u64, u64::from(step.pen.touch.contact)].into_iter().chain(numbers)
    });
    values.extend([u64::from(output.guard_altered), digest(learn)]);
    assert_eq!(values.len() - before, COUNT, "one value for each name");
}
