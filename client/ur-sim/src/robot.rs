//! The robot: modes, safety, motion and the arm, one control cycle at a time.
//!
//! Contract: total; whatever a program or a client asks for, the arm obeys its speed and acceleration limits,
//! until its power goes: then the brakes hold it at once. The arm is `foretrace_sim`'s: a cycle of delay,
//! `servoj`'s look-ahead, 2 ms of joint loop. A protective stop brakes as one of category 2 does and ends the
//! program; an emergency stop brakes and takes the power, at last after `MOST_STOP_S`.

use foretrace_sim::arm::{ArmModel, ArmSettings, FaultKind};

use super::current::Motors;
use super::kinematics::{ArmDh, POSITION_LIMIT_RAD, calibrated};
use super::motion::{JointPoint, RobotMotion};
use super::options::ControllerOptions;
use super::pose::{frame, pose};
use super::safety::{ProtectiveReason, RobotMode, Safety, SafetyBreach};
use super::setup::ProgramSetup;

/// Farther than this \[rad/s\] a target may not jump in a cycle: C204.
const MOST_STEP_RADPS: f64 = 20.0;
/// Farther than this \[rad\] the arm may not be from where its targets led: C153.
const MOST_DEVIATION_RAD: f64 = 0.5;
/// Largest joint speed \[rad/s\].
pub const SPEED_LIMIT_RADPS: f64 = 3.342;
/// Largest joint acceleration \[rad/s²\].
pub const ACCELERATION_LIMIT_RADPS2: f64 = 40.0;
/// Farther than this \[rad\] from where a planned motion has led, the servo did not keep up with it.
const BEHIND_RAD: f64 = 1e-6;
/// Deceleration of stops \[rad/s²\].
const STOP_RADPS2: f64 = 20.0;
/// An emergency stop waits no longer than this for the arm to stand \[s\]: three times what full speed takes.
const MOST_STOP_S: f64 = 0.5;
/// A joint slower than this outside its range stands \[rad/s\].
const CREEPS_RADPS: f64 = 1e-3;
/// So long it stands until it is steady \[s\].
const STEADY_AFTER_S: f64 = 0.5;
/// From full speed to a pause, and back \[1/s\].
const SCALE_RATE: f64 = 5.0;

/// Over which velocities of the tool and the elbow are taken \[s\].
const MOMENT_S: f64 = 1e-6;

/// The joints of `point` a moment later \[rad\].
fn moved(point: &JointPoint) -> [f64; 6] {
    let mut moved = point.q;
    moved.iter_mut().zip(point.qd).for_each(|(q, qd)| *q += qd * MOMENT_S);
    moved
}

#[derive(Debug)]
pub struct SimulatedRobot {
    pub options: ControllerOptions,
    /// Cycles since it booted.
    pub cycle: u64,
    pub mode: RobotMode,
    pub safety: Safety,
    pub dh: ArmDh,
    pub motion: RobotMotion,
    /// Where the motion has led.
    pub target: JointPoint,
    /// The last straight way led out of reach: the arm has braked on it.
    pub unreached: bool,
    /// Acceleration asked for by the motion in the last cycle \[rad/s²\].
    pub target_qdd: [f64; 6],
    /// Of the speed slider, in \[0, 1\].
    pub slider: f64,
    /// In force, in \[0, 1\].
    pub speed_scaling: f64,
    /// The program is paused.
    pub paused: bool,
    /// Mass \[kg\] and centre of gravity \[m\].
    pub payload: (f64, [f64; 3]),
    /// About the centre of gravity, axes as the flange's \[kg m²\]: Ixx, Iyy, Izz, Ixy, Ixz, Iyz.
    pub payload_inertia: [f64; 6],
    /// From the flange: position \[m\], rotation vector \[rad\].
    pub tcp_offset: [f64; 6],
    /// Standard 0 to 7, configurable 8 to 15, tool 16 and 17.
    pub digital_outputs: u64,
    pub digital_inputs: u64,
    /// Analog outputs \[A\] or \[V\].
    pub analog_outputs: [f64; 2],
    /// What programs have set beside.
    pub setup: ProgramSetup,
    /// For how many cycles the arm and its targets have stood.
    still_cycles: u64,
    /// Of the arm in the last cycle \[rad/s²\].
    qdd: [f64; 6],
    motors: Motors,
    arm: ArmModel,
    /// The same arm without its fault.
    sound: ArmModel,
}

impl SimulatedRobot {
    /// As the options have it, at rest.
    #[must_use]
    pub fn new(options: ControllerOptions) -> Self {
        let q = options.q;
        let dh = calibrated(options.series, options.calibration_error_m, options.seed, &q);
        let (damping, mechanics) = (options.damping, options.mechanics);
        let plain = ArmSettings::ur5(options.series.cycle_s(), 0.0);
        let arm = ArmModel::at_rest(ArmSettings { damping, mechanics, ..plain }, q);
        Self {
            options,
            cycle: 0,
            mode: if options.running { RobotMode::Running } else { RobotMode::PowerOff },
            safety: Safety::new(options.series.rate_hz()),
            dh,
            motion: RobotMotion::Rest,
            target: JointPoint { q, qd: [0.0; 6] },
            unreached: false,
            target_qdd: [0.0; 6],
            // It stood long before.
            still_cycles: u64::from(options.series.rate_hz()),
            qdd: [0.0; 6],
            motors: Motors::of(options.series),
            slider: 1.0,
            speed_scaling: 1.0,
            paused: false,
            payload: (0.0, [0.0; 3]),
            payload_inertia: [0.0; 6],
            tcp_offset: [0.0; 6],
            digital_outputs: 0,
            digital_inputs: 0,
            analog_outputs: [0.0; 2],
            setup: ProgramSetup::default(),
            sound: arm.clone(),
            arm,
        }
    }

    /// Control cycle \[s\].
    #[must_use]
    pub const fn dt(&self) -> f64 {
        self.options.series.cycle_s()
    }

    /// Time since it booted \[s\].
    #[must_use]
    pub fn timestamp(&self) -> f64 {
        self.cycle as f64 * self.dt()
    }

    /// The joints as measured.
    #[must_use]
    pub fn actual(&self) -> JointPoint {
        let joints = self.arm.joints();
        // Closed brakes hold an arm that runs away, too.
        let qd = if self.mode.brakes_released() { joints.qd } else { [0.0; 6] };
        JointPoint { q: joints.q, qd }
    }

    /// Currents of the joints \[A\]; none while the brakes hold.
    #[must_use]
    pub fn currents(&self) -> [f64; 6] {
        if !self.mode.brakes_released() {
            return [0.0; 6];
        }
        let JointPoint { q, qd } = self.actual();
        self.motors.currents(&q, &qd, &self.qdd, self.payload)
    }

    /// The tool centre point at `q`.
    #[must_use]
    pub fn tcp_pose(&self, q: &[f64; 6]) -> [f64; 6] {
        pose(&(self.dh.flange(q) * frame(&self.tcp_offset)))
    }

    /// Its speed in the base frame while the joints move as `point` says \[m/s\], and its angular velocity
    /// \[rad/s\].
    #[must_use]
    pub fn tcp_speed(&self, point: &JointPoint) -> [f64; 6] {
        let at = |q: &[f64; 6]| self.dh.flange(q) * frame(&self.tcp_offset);
        let (before, after) = (at(&point.q), at(&moved(point)));
        let way = after.translation.vector - before.translation.vector;
        let turn = (after.rotation * before.rotation.inverse()).scaled_axis();
        [way.x, way.y, way.z, turn.x, turn.y, turn.z].map(|by| by / MOMENT_S)
    }

    /// Velocity \[m/s\] and position \[m\] of the elbow.
    #[must_use]
    pub fn elbow(&self) -> ([f64; 3], [f64; 3]) {
        let actual = self.actual();
        let (now, later) = (self.dh.elbow(&actual.q), self.dh.elbow(&moved(&actual)));
        (((later - now) / MOMENT_S).into(), now.into())
    }

    /// It may move: brakes released, nothing stops it.
    #[must_use]
    pub fn ready(&self) -> bool {
        self.mode == RobotMode::Running && self.safety.clear()
    }

    /// Whether it has stood for half a second with targets that stand.
    #[must_use]
    pub fn steady(&self) -> bool {
        self.still_cycles as f64 * self.dt() >= STEADY_AFTER_S - 1e-9
    }

    /// Whether it stands now.
    #[must_use]
    pub fn stands(&self) -> bool {
        matches!(self.motion, RobotMotion::Rest | RobotMotion::Servo { .. })
            && self.actual().qd.iter().all(|qd| qd.abs() < 1e-4)
    }

    /// Begins `servoj` or goes on with it.
    pub fn servo(&mut self, target: [f64; 6], look_ahead_s: f64) {
        if !matches!(self.motion, RobotMotion::Servo { .. }) {
            self.take_over();
        }
        if jumped(&self.target.q, &target, MOST_STEP_RADPS * self.dt()) {
            self.protective_stop(ProtectiveReason::SuddenChange);
            return;
        }
        if !within_limits(&target) {
            self.protective_stop(ProtectiveReason::PositionLimit);
            return;
        }
        self.look_ahead(look_ahead_s);
        self.motion = RobotMotion::Servo { target };
    }

    /// Begins a motion that the controller plans itself, from where the arm is.
    pub fn plan(&mut self, motion: impl FnOnce(&JointPoint) -> RobotMotion) {
        let servo = matches!(self.motion, RobotMotion::Servo { .. });
        if servo {
            self.take_over();
        }
        self.look_ahead(0.0);
        self.unreached = false;
        self.motion = motion(&self.target);
    }

    fn look_ahead(&mut self, look_ahead_s: f64) {
        self.arm.set_look_ahead_s(look_ahead_s);
        self.sound.set_look_ahead_s(look_ahead_s);
    }

    /// Brakes; the leading joint with `deceleration` \[rad/s²\], or harder where it brakes harder already or
    /// where a joint would leave its range.
    pub fn brake(&mut self, deceleration: f64) {
        let asked = deceleration.clamp(0.01, ACCELERATION_LIMIT_RADPS2);
        if matches!(self.motion, RobotMotion::Rest) {
            return;
        }
        if !matches!(self.motion, RobotMotion::Brake { .. }) {
            // A path that asks for more than the arm can do is not where the arm is: it brakes from there.
            if self.is_behind() {
                self.take_over();
            }
            self.plan(|_| RobotMotion::Brake { deceleration: asked });
        }
        let needed = needed_to_stay(&self.target, self.dt());
        if let RobotMotion::Brake { deceleration } = &mut self.motion {
            *deceleration = deceleration.max(asked).max(needed);
        }
    }

    fn is_behind(&self) -> bool {
        let servo = self.arm.servo();
        self.target.q.iter().zip(servo.q).any(|(led, is)| !((led - is).abs() <= BEHIND_RAD))
    }

    /// What the joints are sent to begins where the servo is: what it had not come to is forgotten.
    fn take_over(&mut self) {
        let servo = self.arm.servo();
        self.target = JointPoint { q: servo.q, qd: servo.qd };
        self.arm.forget_targets();
        self.sound.forget_targets();
    }

    pub fn protective_stop(&mut self, why: ProtectiveReason) {
        self.safety.protective_stop(self.cycle, why);
        self.brake(STOP_RADPS2);
    }

    /// An emergency stop: brakes, then power off, also where the button is let go of at once.
    pub fn emergency_stop(&mut self) {
        self.safety.emergency_stop(self.cycle);
        self.brake(STOP_RADPS2);
    }

    /// A safeguard stop: the program is paused, if one runs.
    pub fn safeguard_stop(&mut self) {
        self.safety.safeguard = true;
    }

    /// The safety system finds that it cannot vouch for the arm: the power goes at once.
    pub fn breach(&mut self, breach: SafetyBreach) {
        self.safety.breach = Some(breach);
        if breach == SafetyBreach::Recovery {
            self.brake(STOP_RADPS2);
        } else {
            self.power_off();
        }
    }

    /// Power off; the brakes engage at once.
    pub fn power_off(&mut self) {
        self.mode = RobotMode::PowerOff;
        self.safety.power_is_off();
        self.halt();
    }

    /// Closed brakes, or none but a hand: nothing of what was going on is left.
    pub fn halt(&mut self) {
        self.arm.stand();
        self.motion = RobotMotion::Rest;
        self.target = JointPoint { q: self.arm.servo().q, qd: [0.0; 6] };
        self.sound = self.arm.clone();
        self.sound.mend();
    }

    /// As after a reboot: power off, time 0. The arm with its fault, buttons, wires and the settings of the
    /// pendant stay.
    pub fn reboot(&mut self) {
        let mut again = Self::new(ControllerOptions { running: false, ..self.options });
        again.arm = self.arm.clone();
        again.safety.emergency = self.safety.emergency;
        again.safety.safeguard = self.safety.safeguard;
        again.digital_inputs = self.digital_inputs;
        again.tcp_offset = self.tcp_offset;
        again.payload = self.payload;
        again.payload_inertia = self.payload_inertia;
        again.halt();
        *self = again;
    }

    /// Breaks the arm; a fault that it has already is mended first.
    pub fn break_now(&mut self, kind: FaultKind) {
        self.arm.break_now(kind);
    }

    /// Mends the arm; it brakes from where it really is.
    pub fn mend(&mut self) {
        self.arm.mend();
        if !self.mode.brakes_released() {
            self.halt();
            return;
        }
        self.take_over();
        self.arm.set_look_ahead_s(0.0);
        self.sound = self.arm.clone();
        self.motion = RobotMotion::Brake { deceleration: STOP_RADPS2 };
    }

    /// One cycle: the motion, the arm, the checks.
    pub fn step(&mut self) {
        self.cycle = self.cycle.saturating_add(1);
        let dt = self.dt();
        self.mode.step(self.cycle, self.options.series.rate_hz());
        let wanted = if self.paused { 0.0 } else { self.slider };
        let change = (wanted - self.speed_scaling).clamp(-SCALE_RATE * dt, SCALE_RATE * dt);
        self.speed_scaling = (self.speed_scaling + change).clamp(0.0, 1.0);
        // Planned motions go slower in their own time; streamed targets are followed slower.
        let servo = matches!(self.motion, RobotMotion::Servo { .. });
        let scaling = if servo { self.speed_scaling } else { 1.0 };
        let before = self.target;
        let straight = matches!(self.motion, RobotMotion::Straight { .. });
        let mut over = self.motion.step(&mut self.target, dt, self.speed_scaling);
        if straight && !matches!(self.motion, RobotMotion::Straight { .. }) {
            self.unreached = true;
        } else if straight && jumped(&before.q, &self.target.q, MOST_STEP_RADPS * dt) {
            self.target = before;
            self.protective_stop(ProtectiveReason::SuddenChange);
            over = self.motion.step(&mut self.target, dt, self.speed_scaling);
        }
        if over {
            self.motion = RobotMotion::Rest;
        }
        let accelerations = self.target.qd.iter().zip(before.qd).map(|(after, before)| (after - before) / dt);
        self.target_qdd.iter_mut().zip(accelerations).for_each(|(qdd, a)| *qdd = a);
        let qd = self.arm.joints().qd;
        if self.mode.brakes_released() {
            for arm in [&mut self.arm, &mut self.sound] {
                arm.set_speed_scaling(scaling);
                arm.cycle(self.target.q);
            }
        }
        let changes = self.arm.joints().qd.into_iter().zip(qd);
        self.qdd.iter_mut().zip(changes).for_each(|(qdd, (after, before))| *qdd = (after - before) / dt);
        let still = self.stands() && self.target.qd.iter().all(|qd| qd.abs() < 1e-4);
        self.still_cycles = if still { self.still_cycles.saturating_add(1) } else { 0 };
        self.check(scaling);
    }

    fn check(&mut self, scaling: f64) {
        let overdue = self.safety.braking_for(self.cycle).map(|cycles| cycles as f64 * self.dt());
        let stands = !self.mode.brakes_released() || self.stands();
        if overdue.is_some_and(|since_s| stands || since_s >= MOST_STOP_S) {
            self.power_off();
        }
        if !self.ready() {
            return;
        }
        let q = self.actual().q;
        let off = |to: &[f64; 6], most: f64| q.iter().zip(to).any(|(is, to)| !((is - to).abs() <= most));
        // Targets that are followed slower leave every arm behind: what it is measured by is a sound one.
        let behind = MOST_DEVIATION_RAD + SPEED_LIMIT_RADPS * self.arm.settings().look_ahead_s;
        let deviates =
            off(&self.sound.joints().q, MOST_DEVIATION_RAD) || scaling >= 1.0 && off(&self.target.q, behind);
        if deviates {
            self.protective_stop(ProtectiveReason::Deviation);
        } else if self.leaves_range() {
            self.protective_stop(ProtectiveReason::PositionLimit);
        }
    }

    /// Whether a joint goes on outside its range, or would not stay inside if it were not braked now. Where
    /// it stands outside, it may come back.
    fn leaves_range(&self) -> bool {
        let actual = self.actual();
        let outside = |(q, qd): (&f64, &f64)| {
            !q.is_finite() || q.abs() > POSITION_LIMIT_RAD && q * qd > 0.0 && qd.abs() > CREEPS_RADPS
        };
        // The end of a line was looked at when it began, and it brakes by itself.
        let ends = !matches!(
            self.motion,
            RobotMotion::Speed { .. } | RobotMotion::Straight { .. } | RobotMotion::Servo { .. }
        );
        let servo = self.arm.servo();
        let too_late = |(q, qd): (&f64, &f64)| {
            let stands = q + 2.0 * qd * self.dt() + 0.5 * qd * qd.abs() / ACCELERATION_LIMIT_RADPS2;
            stands.abs() > POSITION_LIMIT_RAD && stands * qd > 0.0 && q.abs() <= POSITION_LIMIT_RAD
        };
        actual.q.iter().zip(&actual.qd).any(outside) || !ends && servo.q.iter().zip(&servo.qd).any(too_late)
    }
}

/// Whether a joint is farther than `most` \[rad\] from where it was; also where it is no number.
fn jumped(from: &[f64; 6], to: &[f64; 6], most: f64) -> bool {
    from.iter().zip(to).any(|(from, to)| !((to - from).abs() <= most))
}

/// Whether all joints are inside their range.
#[must_use]
pub fn within_limits(q: &[f64; 6]) -> bool {
    q.iter().all(|q| q.abs() <= POSITION_LIMIT_RAD)
}

/// The deceleration of the leading joint with which all joints, braking together, rest inside their range
/// \[rad/s²\]; at most what the arm can do.
fn needed_to_stay(point: &JointPoint, dt: f64) -> f64 {
    let fastest = point.qd.iter().fold(0.0, |most, qd| f64::max(most, qd.abs()));
    let joints = point.q.iter().zip(point.qd);
    joints.fold(0.0, |needed, (q, qd)| {
        // Braking begins with the next cycle.
        let room = POSITION_LIMIT_RAD - q * qd.signum() - qd.abs() * dt;
        // A joint that is outside already has no room to be kept to.
        let wanted = if room > 0.0 { 0.5 * fastest * qd.abs() / room } else { 0.0 };
        f64::max(needed, wanted.min(ACCELERATION_LIMIT_RADPS2))
    })
}

#[cfg(test)]
#[path = "robot_tests.rs"]
mod tests;
