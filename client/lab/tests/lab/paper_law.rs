//! The paper's law: a scalar trust over a plan on the predictor's own grid.

use foretrace_config::JOINTS;
use foretrace_control::follower::FollowerSettings;
use foretrace_control::mpc::Gains;
use foretrace_control::trust::TrustRequest;
use foretrace_control::units::Trust;

/// Trust per step shortens predictions that lead too far, and would hide the lead. No part of the plan
/// follows the preset.
pub(crate) fn set(settings: &mut FollowerSettings<JOINTS>) {
    settings.trust_request = TrustRequest::Manual(Trust::FULL);
    settings.mpc.step_s = 0.01;
    for axis in settings.mpc.axes.iter_mut().take(2) {
        (axis.velocity_mps, axis.acceleration_mps2, axis.jerk_mps3) = (1.0, 15.0, 4000.0);
    }
    settings.mpc.gains_feedback = [Gains::FEEDBACK; 3];
    settings.mpc.gains_feedforward = [Gains::FEEDFORWARD; 3];
    settings.mpc.effort = Gains::EFFORT;
}
