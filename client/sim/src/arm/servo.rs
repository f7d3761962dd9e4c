//! One joint behind its controller: servo, joint loop and the clamps, each exact over one cycle.
//!
//! Contract: a stage whose time constant is 0 passes its input on; limits may be infinite. Absent: delay,
//! other joints.

/// Position \[rad\] and velocity \[rad/s\] of one joint.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct ServoState {
    pub(super) q: f64,
    pub(super) qd: f64,
}

/// Group delay of a servo \[s\] and its damping ratio ζ.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct ServoResponse {
    pub(super) look_ahead_s: f64,
    pub(super) damping: f64,
}

impl ServoResponse {
    /// The servo's own e and ė, `dt` \[s\] after `e` and `ed` at natural frequency `w`; exact for every ζ.
    fn decay(&self, e: f64, ed: f64, w: f64, dt: f64) -> (f64, f64) {
        let zeta = self.damping;
        if zeta == 1.0 {
            let decay = (-w * dt).exp();
            return ((e + (ed + w * e) * dt) * decay, (ed - w * (ed + w * e) * dt) * decay);
        }
        // e(t) = exp(−ζwt) (e₀ c + (ė₀ + ζw e₀) s), with s = sin(w_d t)/w_d and c = cos(w_d t) below ζ = 1,
        // sinh and cosh above, there with the exponential drawn in so that nothing overflows.
        let (c, s) = if zeta < 1.0 {
            let (decay, wd) = ((-zeta * w * dt).exp(), w * (1.0 - zeta * zeta).sqrt());
            (decay * (wd * dt).cos(), decay * (wd * dt).sin() / wd)
        } else {
            let root = (zeta * zeta - 1.0).sqrt();
            let (slow, wd) = ((-w * dt / (zeta + root)).exp(), w * root);
            (0.5 * slow * (1.0 + (-2.0 * wd * dt).exp()), -0.5 * slow * (-2.0 * wd * dt).exp_m1() / wd)
        };
        (e * c + (ed + zeta * w * e) * s, ed * c - (w * w * e + zeta * w * ed) * s)
    }
}

/// Second order with w = 2ζ/look-ahead behind a target going straight `from` → `to` within the cycle.
///
/// In the frame that follows the ramp with the steady lag `look_ahead`·slope the motion is homogeneous and
/// exact; for ζ = 1 it is e(t) = (e₀ + (ė₀ + w e₀) t) exp(−w t). Far from the target the closing speed is
/// bounded by the braking distance, so that a large step adds no overshoot of the acceleration clamp's to
/// the servo's own.
pub(super) fn follow(
    state: ServoState,
    from: f64,
    to: f64,
    response: ServoResponse,
    clamp: &Clamp,
) -> ServoState {
    let look_ahead_s = response.look_ahead_s;
    let dt = clamp.dt;
    let slope = (to - from) / dt;
    if look_ahead_s <= 0.0 {
        return pass(state, from, to, clamp);
    }
    let lag = look_ahead_s * slope;
    let w = 2.0 * response.damping / look_ahead_s;
    let (e, ed) = (state.q - (from - lag), state.qd - slope);
    let (e_next, mut ed_next) = response.decay(e, ed, w, dt);
    // Near the ramp the servo never asks for more than the acceleration limit, and is left alone.
    let far = e.abs() > clamp.a / (w * w);
    if far && e * ed_next < 0.0 {
        let most = clamp.brakeable((e.abs() - 0.5 * ed.abs() * dt).max(0.0));
        ed_next = ed_next.clamp(-most, most);
    }
    ServoState { q: to - lag + e_next, qd: slope + ed_next }
}

/// No servo: on the target where the limits let it be, else after it as fast as it can still be braked.
fn pass(state: ServoState, from: f64, to: f64, clamp: &Clamp) -> ServoState {
    let dt = clamp.dt;
    let slope = (to - from) / dt;
    let with = |qd: f64| ServoState { q: state.q + 0.5 * (state.qd + qd) * dt, qd };
    // Farther than this off the way between both velocities, no acceleration within the limit gets there in
    // one cycle.
    if !((to - with(slope).q).abs() > 0.25 * clamp.a * dt * dt) {
        return ServoState { q: to, qd: slope };
    }
    let gap = from - state.q;
    // The remainder after this cycle.
    let left = (gap.abs() - 0.5 * (state.qd - slope).abs() * dt).max(0.0);
    with(slope + gap.signum() * clamp.brakeable(left).min(gap.abs() / dt))
}

/// First order with time constant `tau` behind an input going straight `from` → `to` within the cycle; exact.
pub(super) fn settle(state: ServoState, from: f64, to: f64, tau: f64, dt: f64) -> ServoState {
    let slope = (to - from) / dt;
    if tau <= 0.0 {
        return ServoState { q: to, qd: slope };
    }
    let lag = tau * slope;
    let e_next = (state.q - (from - lag)) * (-dt / tau).exp();
    ServoState { q: to - lag + e_next, qd: slope - e_next / tau }
}

/// The velocity and acceleration clamps of one joint over one cycle.
pub(super) struct Clamp {
    pub(super) v: f64,
    pub(super) a: f64,
    pub(super) dt: f64,
}

impl Clamp {
    /// `wanted` if it is within reach of `state`, else the nearest velocity that is, with the position it
    /// leads to.
    pub(super) fn apply(&self, state: ServoState, wanted: ServoState) -> ServoState {
        let qd =
            wanted.qd.clamp(state.qd - self.a * self.dt, state.qd + self.a * self.dt).clamp(-self.v, self.v);
        let mean = (wanted.q - state.q) / self.dt;
        if qd == wanted.qd && mean.abs() <= self.v {
            wanted
        } else {
            ServoState { q: state.q + 0.5 * (state.qd + qd) * self.dt, qd }
        }
    }

    /// The speed \[rad/s\] from which a joint still stops within `distance` \[rad\], in steps of one cycle.
    fn brakeable(&self, distance: f64) -> f64 {
        let half = 0.5 * self.a * self.dt;
        (half * half + 2.0 * self.a * distance).sqrt() - half
    }
}
