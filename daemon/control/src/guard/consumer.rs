//! What a consumer does with its last command: the one rule shared by the arm and by the daemon after a
//! stall.
//!
//! Contract: pure and closed-form for any instant, so that both sides agree without communication. Between
//! ticks it is linear interpolation towards the command; past its stamp extrapolation until `valid_until`,
//! then braking to rest.

use super::Commanded;
use crate::arm::limits::JointMotion;
use crate::units::Stamp;

/// Joint motion at `now` of a consumer whose last command is `command`, valid until `valid_until`.
///
/// t = now − stamp: q + q̇·t up to `valid_until`; from there every joint brakes at `deceleration` \[rad/s²\]
/// and stays at rest. Before the stamp t is bounded by the length of validity: older positions belong to
/// older commands.
#[must_use]
pub fn consumer_state<const J: usize>(
    command: &Commanded<J>,
    valid_until: Stamp,
    deceleration: &[f64; J],
    now: Stamp,
) -> JointMotion<J> {
    let hold = valid_until.seconds_since(command.stamp()).max(0.0);
    let t = now.seconds_since(command.stamp());
    let gliding = t.min(hold).max(-hold);
    let braking = (t - hold).max(0.0);
    let mut motion = JointMotion { qdd: [0.0; J], ..*command.motion() };
    let joints = motion.q.iter_mut().zip(&mut motion.qd).zip(&mut motion.qdd);
    for (((q, qd), qdd), decel) in joints.zip(deceleration) {
        *q += *qd * gliding;
        if braking > 0.0 {
            let until_rest = qd.abs() / decel;
            let rate = -decel.copysign(*qd);
            if braking < until_rest {
                *q += braking * (*qd + 0.5 * rate * braking);
                *qd += rate * braking;
                *qdd = rate;
            } else {
                *q += 0.5 * *qd * until_rest;
                *qd = 0.0;
            }
        }
    }
    motion
}
