//! What lies between the joint loop and the encoder of a joint that is not ideal: friction, gain, backlash,
//! payload sag, encoder steps. All off by default; an arm without them keeps its bits.
//!
//! Contract: total and deterministic; values that make no sense count as off. Models, per joint:
//!
//! - *Stiction and Coulomb friction*, as a position loop of stiffness K feels them, in radians of lead
//!   (torque / K). A joint that rests stays until the setpoint of its joint loop leads it by more than
//!   the breakaway threshold; then it slips behind the setpoint less the Coulomb threshold. It sticks
//!   again when its speed falls below [`STRIBECK_RADPS`], or when the lead no longer exceeds the
//!   Coulomb threshold.
//! - *Gain* k: the joint goes the share k of the way that its motor goes, from where both began.
//! - *Backlash* b: a dead band between motor and joint (the play operator): the joint rests while the
//!   motor crosses it, and is pushed at its ends, b/2 either way of the middle in which it begins.
//! - *Payload sag*: a steady deflection of shoulder lift and elbow, gravity torque / stiffness, with
//!   the torque of a point mass at the wrist of a UR5 that stands upright and both stiffnesses equal.
//!   The law knows no dynamics, no wrist and no tool; other arms sag by the same formula.
//! - *Encoder step*: reported positions are whole multiples of it. The reported velocity is not
//!   quantised: a controller has better ones than differences of two steps.

use super::servo::ServoState;
use super::{JOINTS, Joints};

/// A slipping joint that is slower than this sticks \[rad/s\].
pub const STRIBECK_RADPS: f64 = 0.01;
/// Lengths of upper arm and forearm of a UR5 \[m\].
const UPPER_ARM_M: f64 = 0.425;
const FOREARM_M: f64 = 0.392_25;

/// Imperfections of joints; per joint from the base. [`Self::IDEAL`] is off.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mechanics {
    /// Breakaway threshold: a joint that rests does not move until the setpoint leads it by more \[rad\]. At
    /// least the Coulomb threshold is taken.
    pub stiction_rad: [f64; JOINTS],
    /// Coulomb threshold: how far a joint that moves stays behind its setpoint \[rad\].
    pub coulomb_rad: [f64; JOINTS],
    /// Width of the dead band between motor and measured joint \[rad\].
    pub backlash_rad: [f64; JOINTS],
    /// Share of the motor's way that the joint goes; 1 is ideal.
    pub gain: [f64; JOINTS],
    /// Step of the reported position \[rad\]; 0: none.
    pub encoder_step_rad: [f64; JOINTS],
    /// Sag of the shoulder lift with the arm stretched out level \[rad\]; the elbow sags by its share.
    pub sag_rad: f64,
}

impl Default for Mechanics {
    fn default() -> Self {
        Self::IDEAL
    }
}

impl Mechanics {
    pub const IDEAL: Self = Self {
        stiction_rad: [0.0; JOINTS],
        coulomb_rad: [0.0; JOINTS],
        backlash_rad: [0.0; JOINTS],
        gain: [1.0; JOINTS],
        encoder_step_rad: [0.0; JOINTS],
        sag_rad: 0.0,
    };

    /// The friction of joint `axis`.
    pub(super) fn friction(&self, axis: usize) -> Friction {
        Friction::new(self.stiction_rad[axis], self.coulomb_rad[axis])
    }

    /// What is reported of a joint at `q` \[rad\].
    pub(super) fn encoded(&self, axis: usize, q: f64) -> f64 {
        let step = positive(self.encoder_step_rad[axis]);
        if step > 0.0 { (q / step).round() * step } else { q }
    }

    /// Deflection under the payload of an arm at `joints`, and its rate.
    fn sag(&self, joints: &Joints) -> Joints {
        let mut out = Joints::default();
        let Joints { q, qd } = joints;
        let (lift, elbow) = (q[1], q[1] + q[2]);
        let (lift_rate, elbow_rate) = (qd[1], qd[1] + qd[2]);
        let most = self.sag_rad / (UPPER_ARM_M + FOREARM_M);
        let (upper, fore) = (UPPER_ARM_M * lift.cos(), FOREARM_M * elbow.cos());
        let upper_rate = -UPPER_ARM_M * lift.sin() * lift_rate;
        let fore_rate = -FOREARM_M * elbow.sin() * elbow_rate;
        (out.q[1], out.qd[1]) = (most * (upper + fore), most * (upper_rate + fore_rate));
        (out.q[2], out.qd[2]) = (most * fore, most * fore_rate);
        out
    }
}

fn positive(value: f64) -> f64 {
    if value > 0.0 && value.is_finite() { value } else { 0.0 }
}

/// Friction of one joint.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Friction {
    breakaway: f64,
    coulomb: f64,
    slips: bool,
}

impl Friction {
    pub(super) fn new(stiction_rad: f64, coulomb_rad: f64) -> Self {
        let coulomb = positive(coulomb_rad);
        Self { breakaway: positive(stiction_rad).max(coulomb), coulomb, slips: false }
    }

    /// What the joint loop follows within a cycle in which its setpoint goes `from` → `to`; `None`: the joint
    /// rests.
    pub(super) fn drive(&mut self, q: f64, from: f64, to: f64) -> Option<(f64, f64)> {
        if self.breakaway <= 0.0 {
            return Some((from, to));
        }
        let lead = to - q;
        self.slips = lead.abs() > if self.slips { self.coulomb } else { self.breakaway };
        let held = self.coulomb * lead.signum();
        self.slips.then_some((from - held, to - held))
    }

    /// The joint after a cycle of slipping: at rest where it sticks.
    pub(super) fn stick(&mut self, joint: ServoState) -> ServoState {
        if self.breakaway > 0.0 && joint.qd.abs() < STRIBECK_RADPS {
            self.slips = false;
            return ServoState { q: joint.q, qd: 0.0 };
        }
        joint
    }
}

/// The joints behind gain, backlash and sag of their motors.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Transmission {
    mechanics: Mechanics,
    /// Where gains begin, and where the backlash has the joints \[rad\].
    origin: [f64; JOINTS],
    pushed: [f64; JOINTS],
    out: Joints,
}

impl Transmission {
    /// `None` where motors and joints are the same; motors at rest at `q` \[rad\], in the middle of the
    /// backlash.
    pub(super) fn new(mechanics: Mechanics, q: [f64; JOINTS]) -> Option<Self> {
        let mechanics = Mechanics {
            backlash_rad: mechanics.backlash_rad.map(positive),
            gain: mechanics.gain.map(|gain| if gain.is_finite() { gain } else { 1.0 }),
            sag_rad: if mechanics.sag_rad.is_finite() { mechanics.sag_rad } else { 0.0 },
            ..Mechanics::IDEAL
        };
        if mechanics == Mechanics::IDEAL {
            return None;
        }
        let mut new = Self { mechanics, origin: q, pushed: q, out: Joints::default() };
        new.pass(&q.map(|q| ServoState { q, qd: 0.0 }));
        Some(new)
    }

    /// The motors have moved.
    pub(super) fn pass(&mut self, motors: &[ServoState; JOINTS]) {
        let mut turned = Joints::default();
        for (axis, motor) in motors.iter().enumerate() {
            let gain = self.mechanics.gain[axis];
            let q = self.origin[axis] + gain * (motor.q - self.origin[axis]);
            let half = 0.5 * self.mechanics.backlash_rad[axis];
            let before = self.pushed[axis];
            let after = before.clamp(q - half, q + half);
            let rests = half > 0.0 && after == before;
            self.pushed[axis] = after;
            turned.q[axis] = after;
            turned.qd[axis] = if rests { 0.0 } else { gain * motor.qd };
        }
        let sag = self.mechanics.sag(&turned);
        for axis in 0..JOINTS {
            turned.q[axis] += sag.q[axis];
            turned.qd[axis] += sag.qd[axis];
        }
        self.out = turned;
    }

    pub(super) fn joints(&self) -> Joints {
        self.out
    }
}
