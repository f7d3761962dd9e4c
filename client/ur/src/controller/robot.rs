//! The robot: modes, safety, motion and the arm, one control cycle at a time.
//!
//! Contract: total; whatever a program or a client asks for, the arm obeys its speed and acceleration limits.
//! The arm is `foretrace_sim`'s: a cycle of delay, `servoj`'s look-ahead, 2 ms of joint loop. A safety stop
//! brakes as a stop of category 2 does and ends the program.

use foretrace_sim::arm::{ArmModel, ArmSettings, FaultKind};

use super::kinematics::{Dh, chain, frame, pose};
use super::motion::{Motion, Point};
use super::options::Options;
use super::safety::{RobotMode, Safety, Stopped};

/// Farther than this \[rad/s\] a target may not jump in a cycle: C204.
const MOST_STEP_RADPS: f64 = 20.0;
/// Farther than this \[rad\] the arm may not be from where its targets led: C153.
const MOST_DEVIATION_RAD: f64 = 0.5;
/// Position limits \[rad\]: 363 degrees.
pub const POSITION_LIMIT_RAD: f64 = 6.336;
/// Largest joint speed \[rad/s\].
pub const SPEED_LIMIT_RADPS: f64 = 3.342;
/// Deceleration of stops \[rad/s²\].
const STOP_RADPS2: f64 = 20.0;
/// From full speed to a pause, and back \[1/s\].
const SCALE_RATE: f64 = 5.0;

/// The robot.
#[derive(Debug)]
pub struct Robot {
    /// What it is.
    pub options: Options,
    /// Cycles since it booted.
    pub cycle: u64,
    /// Power and brakes.
    pub mode: RobotMode,
    /// Safety.
    pub safety: Safety,
    /// Its own kinematics.
    pub dh: Dh,
    /// What moves it.
    pub motion: Motion,
    /// Where the motion has led.
    pub target: Point,
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
    /// From the flange: place \[m\], rotation vector \[rad\].
    pub tcp_offset: [f64; 6],
    /// Standard 0 to 7, configurable 8 to 15, tool 16 and 17.
    pub digital_outputs: u64,
    /// As the outputs.
    pub digital_inputs: u64,
    /// Analog outputs \[A\] or \[V\].
    pub analog_outputs: [f64; 2],
    arm: ArmModel,
    tcp_before: [f64; 6],
    tcp_speed: [f64; 6],
}

impl Robot {
    /// As the options have it, at rest.
    #[must_use]
    pub fn new(options: Options) -> Self {
        let q = options.q;
        let dh = Dh::calibrated(options.series, options.calibration_error_m, options.seed, &q);
        let arm = ArmModel::at_rest(ArmSettings::ur5(options.series.cycle_s(), 0.0), q);
        let mut robot = Self {
            options,
            cycle: 0,
            mode: if options.running { RobotMode::Running } else { RobotMode::PowerOff },
            safety: Safety::new(options.series.rate_hz()),
            dh,
            motion: Motion::Rest,
            target: Point { q, qd: [0.0; 6] },
            target_qdd: [0.0; 6],
            slider: 1.0,
            speed_scaling: 1.0,
            paused: false,
            payload: (0.0, [0.0; 3]),
            tcp_offset: [0.0; 6],
            digital_outputs: 0,
            digital_inputs: 0,
            analog_outputs: [0.0; 2],
            arm,
            tcp_before: [0.0; 6],
            tcp_speed: [0.0; 6],
        };
        robot.tcp_before = robot.tcp_pose(&q);
        robot
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
    pub fn actual(&self) -> Point {
        let joints = self.arm.joints();
        Point { q: joints.q, qd: joints.qd }
    }

    /// The tool centre point at `q`.
    #[must_use]
    pub fn tcp_pose(&self, q: &[f64; 6]) -> [f64; 6] {
        pose(&chain(&self.dh.flange(q), &frame(&self.tcp_offset)))
    }

    /// Its speed \[m/s\], \[rad/s\].
    #[must_use]
    pub const fn tcp_speed(&self) -> [f64; 6] {
        self.tcp_speed
    }

    /// Velocity \[m/s\] and place \[m\] of the elbow.
    #[must_use]
    pub fn elbow(&self) -> ([f64; 3], [f64; 3]) {
        let Point { q, qd } = self.actual();
        let place = |q: &[f64; 6]| self.dh.elbow(q);
        let (now, step) = (place(&q), 1e-6);
        let mut moved = q;
        moved.iter_mut().zip(qd).for_each(|(q, qd)| *q += qd * step);
        let mut velocity = place(&moved);
        velocity.iter_mut().zip(now).for_each(|(v, now)| *v = (*v - now) / step);
        (velocity, now)
    }

    /// It may move: brakes released, nothing stops it.
    #[must_use]
    pub fn ready(&self) -> bool {
        self.mode == RobotMode::Running && self.safety.clear()
    }

    /// Nothing moves.
    #[must_use]
    pub fn steady(&self) -> bool {
        matches!(self.motion, Motion::Rest | Motion::Servo { .. })
            && self.actual().qd.iter().all(|qd| qd.abs() < 1e-4)
    }

    /// Begins `servoj` or goes on with it.
    pub fn servo(&mut self, target: [f64; 6], look_ahead_s: f64) {
        if !matches!(self.motion, Motion::Servo { .. }) {
            self.take_over();
        }
        let far = |(to, from): (&f64, &f64)| !((to - from).abs() <= MOST_STEP_RADPS * self.dt());
        if target.iter().zip(&self.target.q).any(far) {
            self.protective_stop(Stopped::SuddenChange);
            return;
        }
        self.arm.set_look_ahead_s(look_ahead_s);
        self.motion = Motion::Servo { target };
    }

    /// Begins a motion that the controller plans itself, from where the arm is.
    pub fn plan(&mut self, motion: impl FnOnce(&Point) -> Motion) {
        let servo = matches!(self.motion, Motion::Servo { .. });
        if servo {
            self.take_over();
        }
        self.arm.set_look_ahead_s(0.0);
        self.motion = motion(&self.target);
    }

    /// Brakes; the leading joint with `deceleration` \[rad/s²\].
    pub fn brake(&mut self, deceleration: f64) {
        if matches!(self.motion, Motion::Rest | Motion::Brake { .. }) {
            return;
        }
        let deceleration = deceleration.clamp(0.01, 40.0);
        self.plan(|_| Motion::Brake { deceleration });
    }

    /// What the joints are sent to begins where the servo is: what it had not come to is forgotten.
    fn take_over(&mut self) {
        let servo = self.arm.servo();
        self.target = Point { q: servo.q, qd: servo.qd };
    }

    /// A protective stop.
    pub fn protective_stop(&mut self, why: Stopped) {
        self.safety.protective_stop(self.cycle, why);
        self.brake(STOP_RADPS2);
    }

    /// An emergency stop: brakes, then power off.
    pub fn emergency_stop(&mut self) {
        self.safety.emergency = true;
        self.brake(STOP_RADPS2);
    }

    /// A safeguard stop: brakes; the program is paused.
    pub fn safeguard_stop(&mut self) {
        self.safety.safeguard = true;
        self.paused = true;
    }

    /// Power off; the brakes engage at once.
    pub fn power_off(&mut self) {
        self.mode = RobotMode::PowerOff;
        self.halt();
    }

    fn halt(&mut self) {
        self.place(self.arm.joints().q);
    }

    /// At rest at `q` \[rad\], whatever was before.
    pub fn place(&mut self, q: [f64; 6]) {
        self.arm = ArmModel::at_rest(*self.arm.settings(), q);
        self.tcp_before = self.tcp_pose(&q);
        self.motion = Motion::Rest;
        self.target = Point { q, qd: [0.0; 6] };
    }

    /// Breaks the arm.
    pub fn break_now(&mut self, kind: FaultKind) {
        self.arm.break_now(kind);
    }

    /// One cycle: the motion, the arm, the checks.
    pub fn step(&mut self) {
        self.cycle = self.cycle.saturating_add(1);
        let dt = self.dt();
        self.mode.step(self.cycle, self.options.series.rate_hz());
        let wanted = if self.paused { 0.0 } else { self.slider };
        let change = (wanted - self.speed_scaling).clamp(-SCALE_RATE * dt, SCALE_RATE * dt);
        self.speed_scaling = (self.speed_scaling + change).clamp(0.0, 1.0);
        let servo = matches!(self.motion, Motion::Servo { .. });
        // Planned motions go slower in their own time; streamed targets are followed slower.
        self.arm.set_speed_scaling(if servo { self.speed_scaling } else { 1.0 });
        let before = self.target;
        if self.motion.step(&mut self.target, dt, self.speed_scaling) {
            self.motion = Motion::Rest;
        }
        let accelerations = self.target.qd.iter().zip(before.qd).map(|(after, before)| (after - before) / dt);
        self.target_qdd.iter_mut().zip(accelerations).for_each(|(qdd, a)| *qdd = a);
        if self.mode.brakes_released() {
            self.arm.cycle(self.target.q);
        }
        self.check();
        let tcp = self.tcp_pose(&self.arm.joints().q);
        let speeds = tcp.iter().zip(self.tcp_before).map(|(now, before)| (now - before) / dt);
        self.tcp_speed.iter_mut().zip(speeds).for_each(|(speed, is)| *speed = is);
        self.tcp_before = tcp;
    }

    fn check(&mut self) {
        let actual = self.actual();
        if self.safety.emergency && self.steady() && self.mode.brakes_released() {
            self.power_off();
        }
        if !self.ready() {
            return;
        }
        let limit = MOST_DEVIATION_RAD + SPEED_LIMIT_RADPS * self.arm.settings().look_ahead_s;
        let slowed = self.speed_scaling < 1.0;
        let deviates = actual.q.iter().zip(self.target.q).any(|(is, to)| !((is - to).abs() <= limit));
        if deviates && !slowed {
            self.protective_stop(Stopped::Deviation);
        } else if actual.q.iter().any(|q| !(q.abs() <= POSITION_LIMIT_RAD)) {
            self.protective_stop(Stopped::PositionLimit);
        }
    }
}

#[cfg(test)]
#[path = "robot_tests.rs"]
mod tests;
