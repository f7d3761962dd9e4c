//! The calls that move the robot: `servoj`, `movej`, `movel`, `speedj`, `stopj`, `stopl`.

use super::inverse::Straight;
use super::machine::{Hands, Result, joints, number_or};
use super::motion::{RobotMotion, Trapezoid};
use super::robot::SPEED_LIMIT_RADPS;
use crate::script::{Called, MachineCall, Value};

/// Of a motion that the thread waits for.
const fn done_if(over: bool) -> Called {
    if over { Called::Value(Value::None) } else { Called::Wait }
}

impl Hands<'_> {
    pub(super) fn motion(&mut self, call: &MachineCall<'_>) -> Result<Called> {
        let arguments = call.arguments;
        if !self.robot.ready() {
            // The program is about to be stopped.
            return Ok(Called::Wait);
        }
        *self.mover = Some(call.thread);
        match call.name {
            "servoj" => {
                let names = ["q", "a", "v", "t", "lookahead_time", "gain"];
                let [q, _, _, t, look_ahead, gain] = arguments.bind(names)?;
                let dt = self.robot.dt();
                let (q, t) = (joints(q, "q")?, number_or(t, "t", dt)?);
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
                    return Ok(done_if(!matches!(self.robot.motion, RobotMotion::Line(_))));
                }
                let [q, a, v, t, _] = arguments.bind(["q", "a", "v", "t", "r"])?;
                let q = match q {
                    Some(Value::Pose(pose)) => {
                        let (tcp, near) = (self.robot.tcp_offset, self.robot.target.q);
                        self.joints_for(&tcp, pose, &near).ok_or("finds no joints for this pose")?
                    }
                    q => joints(q, "q")?,
                };
                let (a, v) = (number_or(a, "a", 1.4)?, number_or(v, "v", 1.05)?);
                let t = number_or(t, "t", 0.0)?;
                if q.iter().any(|q| !q.is_finite()) || !(a > 0.0 && v > 0.0 && t >= 0.0) {
                    return Err("wants finite targets, a > 0, v > 0, t >= 0".to_owned());
                }
                let (v, a) = (v.min(SPEED_LIMIT_RADPS), a.min(40.0));
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
                    return Ok(done_if(!matches!(self.robot.motion, RobotMotion::Straight { .. })));
                }
                let (dh, tcp) = (self.robot.dh, self.robot.tcp_offset);
                let pose = match to {
                    Some(Value::Pose(pose)) => *pose,
                    q => self.robot.tcp_pose(&joints(q, "pose")?),
                };
                let target = self.robot.target.q;
                if self.joints_for(&tcp, &pose, &target).is_none() {
                    return Err("finds no joints for this pose".to_owned());
                }
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
                let (qd, a) = (qd.map(|qd| qd.clamp(-limit, limit)), a.min(40.0));
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
