//! A mathematical model of a UR5 controller: the response of its joints to a stream of joint targets.
//!
//! Contract: one call of [`ArmModel::cycle`] is one controller cycle. The target given in one cycle, pure
//! delay first ([`DelaySettings`]), takes effect in the next (one cycle of delay, reached along a
//! straight line), passes a second-order servo whose group delay is the look-ahead, critically damped
//! unless set otherwise, and then a first-order joint loop. Both stages obey the velocity and
//! acceleration clamps. What follows is ideal unless set otherwise ([`Mechanics`]). Absent: clock,
//! commands and their age (the consumer of commands keeps that), inertia, elasticity. Source: UR10e,
//! servoj with look-ahead 0.03 s and gain 1200: about 34 ms between command and motion.
//!
//! Speed scaling s < 1 (a UR's speed slider) is modelled by two effects that users of streamed targets
//! report: a target meant for one cycle takes 1/s cycles, and the next one comes before it is reached, so
//! that the joint moves only the share s of each step and skips the rest (a lag of (1/s − 1) cycles that
//! slowly decays at the end); and no joint is faster than s times its limit, so that the arm falls behind a
//! fast path. Not modelled: how a controller scales the acceleration. s = 0 is a paused program: the arm
//! stays.

mod delay;
mod fault;
mod mechanics;
mod servo;

pub use delay::{DelayChange, DelaySettings, MAX_DELAY_S};
pub use fault::{Fault, FaultKind, NoFault};
pub use mechanics::{Mechanics, STRIBECK_RADPS};

use delay::DelayLine;
use fault::Broken;
use mechanics::{Friction, Transmission};
use servo::{Clamp, ServoResponse, ServoState, follow, settle};

/// Joints of the simulated arm.
pub const JOINTS: usize = 6;

/// Parameters of the arm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ArmSettings {
    /// Controller cycle \[s\]: 0.002 for e-series, 0.008 for CB3.
    pub cycle_s: f64,
    /// How late targets reach the servo.
    pub delay: DelaySettings,
    /// Speed scaling s in \[0, 1\], 1: none. A value outside counts as the nearest legal one, NaN as 1.
    pub speed_scaling: f64,
    /// Group delay of the servo, servoj's `lookahead_time` \[s\]; 0: no servo filter.
    pub look_ahead_s: f64,
    /// Damping ratio ζ of the servo at the same group delay, 0.05 to 20; 1: critically damped. Its natural
    /// frequency is 2ζ/look-ahead. A value outside counts as the nearest legal one, NaN as 1.
    pub damping: f64,
    /// Time constant of the joint loop \[s\]; 0: none.
    pub joint_loop_s: f64,
    /// Largest joint speed \[rad/s\], per joint; may be infinite.
    pub velocity_radps: [f64; JOINTS],
    /// Largest joint acceleration \[rad/s²\], per joint; may be infinite.
    pub acceleration_radps2: [f64; JOINTS],
    /// Friction, gain, backlash, sag and encoder steps.
    pub mechanics: Mechanics,
    /// What breaks, and when.
    pub fault: Option<Fault>,
}

/// Fastest joint of a UR5 \[rad/s\].
const UR5_RADPS: f64 = 3.342;

impl ArmSettings {
    /// A UR5 behind servoj at `cycle_s` with the given look-ahead: 3.342 rad/s and 40 rad/s², 2 ms of joint
    /// loop.
    #[must_use]
    pub fn ur5(cycle_s: f64, look_ahead_s: f64) -> Self {
        Self {
            cycle_s,
            delay: DelaySettings::default(),
            speed_scaling: 1.0,
            look_ahead_s,
            damping: 1.0,
            joint_loop_s: 0.002,
            velocity_radps: [UR5_RADPS; JOINTS],
            acceleration_radps2: [40.0; JOINTS],
            mechanics: Mechanics::IDEAL,
            fault: None,
        }
    }

    /// An arm that is a pure delay of `lag_s`: no servo, no joint loop, no limits.
    ///
    /// The cycle of delay that every arm here has is part of `lag_s`, which therefore is at least one cycle.
    #[must_use]
    pub fn delayed(cycle_s: f64, lag_s: f64) -> Self {
        Self {
            cycle_s,
            delay: DelaySettings::constant(lag_s - cycle_s),
            speed_scaling: 1.0,
            look_ahead_s: 0.0,
            damping: 1.0,
            joint_loop_s: 0.0,
            velocity_radps: [f64::INFINITY; JOINTS],
            acceleration_radps2: [f64::INFINITY; JOINTS],
            mechanics: Mechanics::IDEAL,
            fault: None,
        }
    }

    /// Time from a target to the motion it asks for, at low frequency, when the run begins \[s\]:
    /// [`Self::group_delay_at`] 0.
    #[must_use]
    pub fn group_delay_s(&self) -> f64 {
        self.group_delay_at(0.0)
    }

    /// Time from a target to the motion it asks for, at low frequency and speeds within the limits, `t_s`
    /// after the arm began to cycle \[s\]: pure delay (without jitter), cycle, speed scaling, servo (of any
    /// damping) and joint loop; without what [`Mechanics`] adds. Infinite where speed scaling is 0.
    #[must_use]
    pub fn group_delay_at(&self, t_s: f64) -> f64 {
        let scaling = self.scaling();
        let skipped_s = self.cycle_s * (1.0 - scaling) / scaling;
        let skipped_s = if scaling < 1.0 { skipped_s } else { 0.0 };
        self.cycle_s + self.look_ahead_s + self.joint_loop_s + self.delay.at(t_s) + skipped_s
    }

    fn response(&self) -> ServoResponse {
        let damping = if self.damping.is_nan() { 1.0 } else { self.damping.clamp(0.05, 20.0) };
        ServoResponse { look_ahead_s: self.look_ahead_s, damping }
    }

    fn scaling(&self) -> f64 {
        if self.speed_scaling.is_nan() { 1.0 } else { self.speed_scaling.clamp(0.0, 1.0) }
    }
}

/// Joint positions \[rad\] and velocities \[rad/s\].
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Joints {
    /// \[rad\]
    pub q: [f64; JOINTS],
    /// \[rad/s\]
    pub qd: [f64; JOINTS],
}

/// The arm: six independent joints and the targets in transport to them.
#[derive(Debug, Clone)]
pub struct ArmModel {
    settings: ArmSettings,
    delay: Option<DelayLine>,
    /// The last one that was given.
    newest_target: [f64; JOINTS],
    /// Target of the servo in the previous cycle.
    previous_target: [f64; JOINTS],
    servo: [ServoState; JOINTS],
    joint: [ServoState; JOINTS],
    friction: [Friction; JOINTS],
    /// From the joint loops' motors to the joints, where they are not the same.
    transmission: Option<Transmission>,
    clamped: bool,
    cycles: u64,
    broken: Option<Broken>,
}

impl ArmModel {
    /// An arm at rest at `q` \[rad\].
    #[must_use]
    pub fn at_rest(settings: ArmSettings, q: [f64; JOINTS]) -> Self {
        let still = q.map(|q| ServoState { q, qd: 0.0 });
        Self {
            settings,
            delay: DelayLine::new(settings.delay, settings.cycle_s, q),
            newest_target: q,
            previous_target: q,
            servo: still,
            joint: still,
            friction: std::array::from_fn(|axis| settings.mechanics.friction(axis)),
            transmission: Transmission::new(settings.mechanics, q),
            clamped: false,
            cycles: 0,
            broken: None,
        }
    }

    /// Moves through one controller cycle with `target` \[rad\], where the joints ought to be when the cycle
    /// starts, and returns the joints at its end. A non-finite target counts as a repetition of the last one.
    pub fn cycle(&mut self, target: [f64; JOINTS]) -> Joints {
        let dt = self.settings.cycle_s;
        self.break_down();
        for (newest, target) in self.newest_target.iter_mut().zip(target) {
            if target.is_finite() {
                *newest = target;
            }
        }
        let target = match &mut self.delay {
            None => self.newest_target,
            Some(line) => line.pass(self.newest_target),
        };
        self.clamped = false;
        let scaling = self.scaling();
        for axis in 0..JOINTS {
            let from = self.previous_target[axis];
            let mut to = target[axis];
            let mut v = self.settings.velocity_radps[axis];
            if scaling < 1.0 {
                to = from + scaling * (to - from);
                // A paused arm never moves; and 0 times an infinite limit is NaN.
                v = if scaling > 0.0 { v * scaling } else { v };
            }
            if let Some(share) = self.broken.and_then(|broken| broken.ceiling(axis)) {
                v = share * v.min(UR5_RADPS);
            }
            let clamp = Clamp { v, a: self.settings.acceleration_radps2[axis], dt };
            let before = self.servo[axis];
            let wanted = follow(before, from, to, self.settings.response(), &clamp);
            let servo = clamp.apply(before, wanted);
            let joint = self.joint[axis];
            self.clamped |= servo != wanted;
            self.joint[axis] = match self.friction[axis].drive(joint.q, before.q, servo.q) {
                None => ServoState { q: joint.q, qd: 0.0 },
                Some((from, to)) => {
                    let settled = settle(joint, from, to, self.settings.joint_loop_s, dt);
                    let moved = clamp.apply(joint, settled);
                    self.clamped |= moved != settled;
                    self.friction[axis].stick(moved)
                }
            };
            self.servo[axis] = servo;
            self.previous_target[axis] = to;
        }
        if let Some(broken) = &mut self.broken {
            broken.cycle(dt, &mut [&mut self.servo, &mut self.joint]);
        }
        if let Some(transmission) = &mut self.transmission {
            transmission.pass(&self.joint);
        }
        self.joints()
    }

    /// Begins the fault when its time has come.
    fn break_down(&mut self) {
        let t_s = self.cycles as f64 * self.settings.cycle_s;
        self.cycles += 1;
        let Some(fault) = self.settings.fault.filter(|fault| self.broken.is_none() && t_s >= fault.at_s)
        else {
            return;
        };
        if let FaultKind::Stiction(axis, stiction_rad) = fault.kind
            && let Some(friction) = self.friction.get_mut(axis)
        {
            *friction = Friction::new(stiction_rad, 0.0);
        }
        self.broken = Some(Broken::new(fault.kind, &self.obeying(), self.joint.map(|motor| motor.q)));
    }

    /// Speed scaling in force: a slider takes nothing back from a fault.
    fn scaling(&self) -> f64 {
        let asked = self.settings.scaling();
        self.broken.and_then(|broken| broken.scaling()).map_or(asked, |share| share.min(asked))
    }

    /// The joints as the controller would report them now.
    #[must_use]
    pub fn joints(&self) -> Joints {
        let really = self.really();
        let mut joints = self.broken.map_or(really, |broken| broken.reported(really));
        for (axis, q) in joints.q.iter_mut().enumerate() {
            *q = self.settings.mechanics.encoded(axis, *q);
        }
        joints
    }

    /// True positions of the joints, whatever is reported.
    #[must_use]
    pub fn really(&self) -> Joints {
        let obeying = self.obeying();
        self.broken.map_or(obeying, |broken| broken.really(obeying))
    }

    /// Positions of the joints of the same arm without its fault.
    fn obeying(&self) -> Joints {
        if let Some(transmission) = &self.transmission {
            return transmission.joints();
        }
        self.motors()
    }

    /// Where the joint loops have their motors.
    fn motors(&self) -> Joints {
        Joints { q: self.joint.map(|joint| joint.q), qd: self.joint.map(|joint| joint.qd) }
    }

    /// Age of the target that the servo read in the last cycle \[s\]: the pure delay, with its jitter.
    #[must_use]
    pub fn delay_s(&self) -> f64 {
        self.delay.as_ref().map_or(0.0, DelayLine::age_s)
    }

    /// A velocity or acceleration clamp shaped the last cycle.
    #[must_use]
    pub fn clamped(&self) -> bool {
        self.clamped
    }

    /// Another look-ahead from the next cycle on \[s\], as a program's `servoj` may ask for. Without one,
    /// targets that the servo had not come to are forgotten: it goes on from where it is.
    pub fn set_look_ahead_s(&mut self, look_ahead_s: f64) {
        if look_ahead_s <= 0.0 && self.settings.look_ahead_s > 0.0 {
            self.forget_targets();
        }
        self.settings.look_ahead_s = look_ahead_s;
    }

    /// Forgets the targets that the servo had not come to: it goes on from where it is, at its speed, to the
    /// next one.
    pub fn forget_targets(&mut self) {
        self.previous_target = self.servo.map(|servo| servo.q);
    }

    /// Where the servo is, which the joint loop follows \[rad\], \[rad/s\].
    #[must_use]
    pub fn servo(&self) -> Joints {
        Joints { q: self.servo.map(|servo| servo.q), qd: self.servo.map(|servo| servo.qd) }
    }

    /// Another speed scaling from the next cycle on, as by the slider; see [`ArmSettings::speed_scaling`].
    pub fn set_speed_scaling(&mut self, speed_scaling: f64) {
        self.settings.speed_scaling = speed_scaling;
    }

    /// Breaks the arm from the next cycle on; a fault that it has already is mended first.
    pub fn break_now(&mut self, kind: FaultKind) {
        self.mend();
        let at_s = self.cycles as f64 * self.settings.cycle_s;
        self.settings.fault = Some(Fault { kind, at_s });
    }

    /// Without a fault from the next cycle on, at the speed and from the position that its joints
    /// really have.
    pub fn mend(&mut self) {
        self.settings.fault = None;
        if self.broken.is_none() {
            return;
        }
        let Joints { mut q, mut qd } = self.really();
        for (qd, most) in qd.iter_mut().zip(self.settings.velocity_radps) {
            *qd = qd.clamp(-most, most);
        }
        // What lies between motor and joint stays between them.
        let (obeying, motors) = (self.obeying(), self.motors());
        for axis in 0..JOINTS {
            q[axis] -= obeying.q[axis] - motors.q[axis];
        }
        self.broken = None;
        self.friction = std::array::from_fn(|axis| self.settings.mechanics.friction(axis));
        self.begin_at(Joints { q, qd });
    }

    /// At rest where its joints stand, as when the brakes close; a fault stays.
    pub fn stand(&mut self) {
        self.begin_at(Joints { qd: [0.0; JOINTS], ..self.motors() });
    }

    fn begin_at(&mut self, joints: Joints) {
        self.joint = std::array::from_fn(|axis| ServoState { q: joints.q[axis], qd: joints.qd[axis] });
        self.servo = self.joint;
        if let Some(transmission) = &mut self.transmission {
            transmission.pass(&self.joint);
        }
        self.newest_target = joints.q;
        self.previous_target = joints.q;
        if let Some(line) = &mut self.delay {
            line.fill(joints.q);
        }
    }

    /// The settings in force.
    #[must_use]
    pub fn settings(&self) -> &ArmSettings {
        &self.settings
    }
}

#[cfg(test)]
mod mechanics_tests;
#[cfg(test)]
mod tests;
