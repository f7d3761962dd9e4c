//! The calls that move the robot: `servoj`, `movej`, `movel`, `speedj`, `stopj`, `stopl`.

use super::inverse::{PoseTolerance, Straight};
use super::machine::{Hands, MovingThread, Result, joints, number_or};
use super::motion::{RobotMotion, Trapezoid};
use super::robot::{ACCELERATION_LIMIT_RADPS2, SPEED_LIMIT_RADPS, within_limits};
use super::safety::ProtectiveReason;
use crate::script::{Called, MachineCall, Value};

/// Of a motion that the thread waits for.
const fn done_if(over: bool) -> Called {
    if over { Called::Value(Value::None) } else { Called::Wait }
}

impl Hands<'_> {
    /// A planned motion is over once the arm rests, or something else moves it; also when it was braked.
    fn planned_is_over(&self) -> bool {
        !matches!(
            self.robot.motion,
            RobotMotion::Line(_) | RobotMotion::Straight { .. } | RobotMotion::Brake { .. }
        )
    }

    /// Joints as a call gives them, or those for the pose that it gives instead, near where the arm is sent.
    fn aim(&mut self, value: Option<&Value>, name: &str) -> Result<[f64; 6]> {
        let Some(Value::Pose(pose)) = value else { return joints(value, name) };
        let (tcp, near) = (self.robot.tcp_offset, self.robot.target.q);
        let found = self.joints_for(&tcp, pose, &near, PoseTolerance::TIGHT);
        found.ok_or_else(|| "finds no joints for this pose: it is out of reach".to_owned())
    }

    /// A call that moves the robot, which one thread does at a time: while its call goes on, and in the cycle
    /// that a call has used up, those of other threads end the program, as on a controller.
    pub(super) fn moving(&mut self, call: &MachineCall<'_>) -> Result<Called> {
        if !self.robot.ready() {
            // The program is about to be stopped.
            return Ok(Called::Wait);
        }
        let now = self.robot.cycle;
        let other = self.mover.filter(|mover| mover.thread != call.thread);
        if other.is_some_and(|mover| mover.until.is_some_and(|until| until >= now)) {
            return Err("fails: Another thread is already controlling the robot".to_owned());
        }
        let called = self.motion(call)?;
        let until = match called {
            Called::Wait => Some(u64::MAX),
            Called::Cycle(_) => Some(now),
            _ => None,
        };
        *self.mover = Some(MovingThread { thread: call.thread, until });
        Ok(called)
    }

    fn motion(&mut self, call: &MachineCall<'_>) -> Result<Called> {
        let arguments = call.arguments;
        match call.name {
            "servoj" => {
                let names = ["q", "a", "v", "t", "lookahead_time", "gain"];
                let [q, _, _, t, look_ahead, gain] = arguments.bind(names)?;
                let dt = self.robot.dt();
                // The pose of a call that is being waited for was looked at when it began.
                let q = if call.first { self.aim(q, "q")? } else { self.robot.target.q };
                let t = number_or(t, "t", dt)?;
                let look_ahead = number_or(look_ahead, "lookahead_time", 0.1)?;
                let gain = number_or(gain, "gain", 300.0)?;
                if !(0.03..=0.2).contains(&look_ahead) {
                    return Err("lookahead_time must be from 0.03 to 0.2".to_owned());
                }
                if !(100.0..=2000.0).contains(&gain) {
                    return Err("gain must be from 100 to 2000".to_owned());
                }
                if call.first {
                    self.robot.servo(q, look_ahead);
                }
                let cycles = self.cycles(t);
                Ok(self.wait(call, cycles))
            }
            "movej" => {
                if !call.first {
                    return Ok(done_if(self.planned_is_over()));
                }
                let [q, a, v, t, _] = arguments.bind(["q", "a", "v", "t", "r"])?;
                let q = self.aim(q, "q")?;
                let (a, v) = (number_or(a, "a", 1.4)?, number_or(v, "v", 1.05)?);
                let t = number_or(t, "t", 0.0)?;
                if q.iter().any(|q| !q.is_finite()) || !(a > 0.0 && v > 0.0 && t >= 0.0) {
                    return Err("wants finite targets, a > 0, v > 0, t >= 0".to_owned());
                }
                if !within_limits(&q) {
                    self.robot.protective_stop(ProtectiveReason::PositionLimit);
                    return Ok(Called::Wait);
                }
                let (v, a) = (v.min(SPEED_LIMIT_RADPS), a.min(ACCELERATION_LIMIT_RADPS2));
                self.robot.plan(|point| RobotMotion::Line(Trapezoid::new(point.q, q, v, a, t)));
                Ok(Called::Wait)
            }
            "movel" => {
                let [to, a, v, t, _] = arguments.bind(["pose", "a", "v", "t", "r"])?;
                let (a, v, t) = (number_or(a, "a", 1.2)?, number_or(v, "v", 0.25)?, number_or(t, "t", 0.0)?);
                if !(a > 0.0 && v > 0.0 && t >= 0.0) {
                    return Err("wants a > 0, v > 0, t >= 0".to_owned());
                }
                if !call.first {
                    if std::mem::take(&mut self.robot.unreached) {
                        return Err("cannot go on: the straight line leaves the reach of the arm".to_owned());
                    }
                    return Ok(done_if(self.planned_is_over()));
                }
                let (dh, tcp) = (self.robot.dh, self.robot.tcp_offset);
                let pose = match to {
                    Some(Value::Pose(pose)) => *pose,
                    q => self.robot.tcp_pose(&joints(q, "pose")?),
                };
                self.aim(Some(&Value::Pose(pose)), "pose")?;
                self.robot.plan(|point| {
                    let way = Straight::new(dh, tcp, &point.q, &pose);
                    // As shares of the way; a way of no length ends at once.
                    let length = way.length().max(1e-9);
                    let one = [1.0, 0.0, 0.0, 0.0, 0.0, 0.0];
                    let share = Trapezoid::new([0.0; 6], one, v.min(3.0) / length, a.min(150.0) / length, t);
                    RobotMotion::Straight { way, share }
                });
                Ok(Called::Wait)
            }
            "speedj" => {
                let [qd, a, t] = arguments.bind(["qd", "a", "t"])?;
                let (qd, a, t) = (joints(qd, "qd")?, number_or(a, "a", 1.4)?, number_or(t, "t", 0.0)?);
                if qd.iter().any(|qd| !qd.is_finite()) || !(a > 0.0 && t >= 0.0) {
                    return Err("wants finite speeds, a > 0, t >= 0".to_owned());
                }
                let limit = SPEED_LIMIT_RADPS;
                let (qd, a) = (qd.map(|qd| qd.clamp(-limit, limit)), a.min(ACCELERATION_LIMIT_RADPS2));
                let cycles = self.cycles(t);
                // One cycle more, in which the program may renew it.
                let left = if cycles == 0 { 2 } else { cycles.saturating_add(1) };
                if call.first || cycles == 0 {
                    self.robot.plan(|_| RobotMotion::Speed { qd, acceleration: a, left });
                }
                if cycles > 0 {
                    return Ok(self.wait(call, cycles));
                }
                let there = self.robot.motion.at_speed(&self.robot.target);
                Ok(if there { Called::Cycle(Value::None) } else { Called::Wait })
            }
            // stopj and stopl: this arm brakes all joints together in either case.
            _ => {
                let [a] = arguments.bind(["a"])?;
                let a = number_or(a, "a", 10.0)?;
                if !(a > 0.0) {
                    return Err("wants a > 0".to_owned());
                }
                if call.first {
                    self.robot.brake(a);
                }
                Ok(done_if(!matches!(self.robot.motion, RobotMotion::Brake { .. })))
            }
        }
    }
}
