//! The moving half of a tick: plan, inverse kinematics, guard, and the ladder of fallbacks between them.
//!
//! Contract: owns the commanded state. Whatever is asked for, the state after `advance` is legal and continuous with the
//! state before. Rungs: fresh plan → previous plan at the true elapsed time → jerk-limited stop → hold.

mod arming;
mod charge;
mod glide;
mod home;
mod next;
mod paper;
mod asked;
mod parts;
mod rest;

use nalgebra::Vector3;

use arming::Arming;
pub(super) use home::HomeNews;
use home::Homing;
pub(super) use parts::paced;
use parts::{inverse_kinematics, planner};

use super::Budget;
use super::io::{Health, JointCommand, Rung, Stage, StageClock};
use super::settings::{FollowerError, FollowerSettings};
use crate::arm::servo::Servo;
use crate::arm::{Chain, Kinematics};
use crate::guard::{Commanded, Guard, StopProfile};
use crate::ik::{Ik, IkReport, IkSource, ToolTarget};
use crate::mpc::{AxisLimits, AxisReport, Mpc, Plan};
use crate::pen::PenReading;
use crate::plane::Plane;
use crate::stop::StopDetail;
use crate::units::{AxisState, Stamp, Trust};

/// Tool velocity that the IK may miss without the plan being told [m/s]; what remains is removed as pose error.
const IK_TOLERANCE_MPS: f64 = 1e-3;

/// A tool slower than this along both axes of the plane [m/s] rests, and limits say nothing.
const MOVING_MPS: f64 = 0.05;

/// What the arm is to do in a tick.
#[derive(Debug, Clone)]
pub(super) enum Motion<const N: usize> {
    /// Follow the pen.
    Follow {
        /// Newest pen sample, plane frame.
        pen: PenReading,
        /// The pen fell silent.
        holding: bool,
        /// References of x and y at i = 1..N.
        preview: Option<[[AxisState; N]; 2]>,
        /// How much of the preview to believe.
        trust: Trust,
    },
    /// Come to rest, and stay there.
    Stop,
    /// Go on with the way home.
    Home,
}

/// What came of it.
#[derive(Debug, Clone)]
pub(super) struct Moved<const J: usize> {
    pub(super) command: Option<JointCommand<J>>,
    pub(super) rung: Rung,
    pub(super) at_rest: bool,
    pub(super) reference: [f64; 3],
    pub(super) setpoint: [AxisState; 3],
    pub(super) tool: [f64; 3],
    pub(super) axes: [AxisReport; 3],
    pub(super) ik: IkReport,
    pub(super) guard_altered: u32,
    /// How the command leaves the tool's envelope, if it does.
    pub(super) breach: Option<StopDetail>,
    /// The tool moves by a plan.
    pub(super) follows: bool,
    /// Joints, acceleration or speed were at their limits; `None` unless the tool followed a fresh plan in motion.
    pub(super) at_limit: Option<bool>,
    /// What the way home came to.
    pub(super) home: HomeNews,
}

/// The commanded state and everything that changes it.
#[derive(Debug)]
pub(super) struct Mover<const N: usize, const J: usize> {
    period_ns: u64,
    period_s: f64,
    valid_ns: u64,
    previous_plan_max_ns: u64,
    approach_distance: f64,
    limits: [AxisLimits; 3],
    arming: Arming,
    plane: Plane,
    chain: Chain<J>,
    mpc: Mpc<N>,
    ik: Ik<J>,
    guard: Guard<J>,
    stop: StopProfile<J>,
    homing: Box<Homing<J>>,
    held: Option<Held<J>>,
    /// Stamp of the newest command; stamps never go back, not even over an arming.
    issued: Stamp,
    reports: Reports,
    /// Commanded tool state in the plane frame: x₀ of the plan.
    tool: [AxisState; 3],
    /// What the arm makes of commands, if it is a filter, and where it gets to with them.
    servo: Option<Servo>,
    arm: [AxisState; 3],
    plan: Plan<N>,
    /// When `plan` begins; `None` while there is none to fall back to.
    plan_start: Option<Stamp>,
    /// The tool has left `plan`, because it had to be able to stop.
    bent: bool,
    /// Share of its full reach that a plan is asked for.
    reach: f64,
    /// No faster than this [m/s], where the arm is slow.
    pub(super) pace_mps: Option<f64>,
    /// The tool has not come near the pen, or has lost it, and stays lifted.
    approaching: bool,
    height: f64,
}

/// The last command, and where it puts the arm.
#[derive(Debug, Clone)]
struct Held<const J: usize> {
    command: Commanded<J>,
    valid_until: Stamp,
    kinematics: Kinematics<J>,
}

/// Evidence of the last solves, repeated where a tick solved nothing.
#[derive(Debug, Clone, Copy, Default)]
struct Reports {
    axes: [AxisReport; 3],
    ik: IkReport,
}

impl<const N: usize, const J: usize> Mover<N, J> {
    pub(super) fn new(settings: &FollowerSettings<J>) -> Result<Self, FollowerError> {
        let mover = Self::built(settings)?;
        rest::comes_to_rest::<N, J>(settings)?;
        Ok(mover)
    }

    /// The same, whether it comes to rest or not.
    fn built(settings: &FollowerSettings<J>) -> Result<Self, FollowerError> {
        let safety = &settings.safety;
        let ik = inverse_kinematics(settings)?;
        Ok(Self {
            period_ns: settings.period_ns,
            period_s: settings.period_ns as f64 * 1e-9,
            valid_ns: settings.valid_ns(),
            previous_plan_max_ns: safety.previous_plan_max_ns,
            approach_distance: safety.approach_distance,
            limits: paced::<N, J>(settings).limits(),
            arming: Arming::new(settings),
            plane: settings.plane,
            chain: settings.chain.clone(),
            mpc: planner(settings)?,
            homing: Box::new(Homing::new(settings, ik.clearance().cloned())),
            ik,
            guard: Guard::new(settings.limits),
            stop: StopProfile::new(settings.limits),
            held: None,
            issued: Stamp(0),
            reports: Reports::default(),
            tool: [AxisState::default(); 3],
            servo: Servo::new(settings.servo_ns()),
            arm: [AxisState::default(); 3],
            plan: Plan::resting(settings.mpc.step_s),
            plan_start: None,
            bent: false,
            reach: 1.0,
            pace_mps: None,
            approaching: true,
            height: settings.plane.lift_height,
        })
    }

    /// See [`Mpc::feedback_lag_s`].
    pub(super) fn feedback_lag_s(&mut self) -> f64 {
        self.mpc.feedback_lag_s(self.period_s)
    }

    /// One period of motion. Where the joints did not do what was planned, x₀ comes from what is really published, so that
    /// nothing winds up.
    pub(super) fn advance(
        &mut self,
        wanted: Option<&Motion<N>>,
        budget: Budget,
        health: &mut Health,
        clock: &mut impl StageClock,
    ) -> Moved<J> {
        let start = match (&self.held, wanted) {
            (Some(held), Some(_)) => held.command.stamp(),
            _ => return self.nothing(clock),
        };
        let reach = start + self.period_ns;
        if budget.shed {
            health.set(Health::SHED);
        }
        let (reference, next, mut rung) = match wanted {
            Some(Motion::Follow { pen, holding, preview, trust }) => {
                let (references, conservative, trust) = self.references(pen, *holding, preview, *trust);
                let first = references.map(|axis| axis.first().map_or(0.0, |state| state.position));
                let (next, rung) = self.plan_next(start, &conservative, &references, trust, budget, health);
                (first, next, rung)
            }
            _ => (self.tool.map(|axis| axis.position), None, Rung::Stop),
        };
        clock.lap(Stage::Mpc);

        let (qd, home) = match wanted {
            Some(Motion::Home) => self.homeward(start, health),
            _ => (next.and_then(|next| self.joint_velocities(&next, health)), HomeNews::None),
        };
        if next.is_some() != qd.is_some() {
            rung = if qd.is_some() { Rung::FreshPlan } else { Rung::Stop };
        }
        if matches!(wanted, Some(Motion::Follow { .. })) && rung == Rung::Stop {
            health.set(Health::FALLBACK);
        }
        clock.lap(Stage::Ik);

        let follows_plan = qd.is_some();
        let from = self.commanded_tool();
        let guard_altered = self.publish(reach, qd, health);
        let limited = health.has(Health::IK_LIMITED | Health::GUARD_ALTERED);
        let moving = self.tool.iter().take(2).any(|axis| axis.velocity.abs() > MOVING_MPS);
        // Jerk at its limit is how plans that are in a hurry look, and costs little; the workspace is no weakness of the arm.
        let hurries = |axis: &AxisReport| axis.active.acceleration > 0 || axis.active.velocity > 0;
        let at_limit = limited || self.reports.axes.iter().take(2).any(hurries);
        if let Some(servo) = self.servo {
            self.trail(&servo, &from);
        }
        match next {
            Some(next) if follows_plan && !limited => self.tool = next,
            planned => {
                health.set(Health::RESYNCHRONISED);
                match planned.filter(|_| follows_plan) {
                    Some(planned) => self.fall_behind(&planned),
                    None => self.resynchronise(),
                }
            }
        }
        if !follows_plan {
            self.plan_start = None;
        }
        let at_rest = self.at_rest();
        if rung == Rung::Stop && at_rest {
            rung = Rung::Hold;
        }
        let tool = self.commanded_tool();
        let speed = (tool - from).norm() / self.period_s;
        let breach = self
            .held
            .as_ref()
            .zip(self.ik.envelope())
            .and_then(|(held, envelope)| envelope.judge(&envelope.figures(&held.kinematics, speed)));
        Moved {
            command: self.held.as_ref().map(|held| JointCommand {
                stamp: held.command.stamp(),
                valid_until: held.valid_until,
                q: *held.command.q(),
                qd: *held.command.qd(),
                enabled: true,
            }),
            rung,
            at_rest,
            reference,
            setpoint: self.tool,
            tool: [tool.x, tool.y, tool.z],
            axes: self.reports.axes,
            ik: self.reports.ik,
            guard_altered,
            breach,
            follows: follows_plan && next.is_some(),
            at_limit: (rung == Rung::FreshPlan && moving && next.is_some()).then_some(at_limit),
            home,
        }
    }

    fn nothing(&self, clock: &mut impl StageClock) -> Moved<J> {
        clock.lap(Stage::Mpc);
        clock.lap(Stage::Ik);
        Moved {
            command: None,
            rung: Rung::Hold,
            at_rest: true,
            reference: [0.0; 3],
            setpoint: [AxisState::default(); 3],
            tool: [0.0; 3],
            axes: self.reports.axes,
            ik: self.reports.ik,
            guard_altered: 0,
            breach: None,
            follows: false,
            at_limit: None,
            home: HomeNews::None,
        }
    }

    /// Joint velocities that carry the tool from its commanded state to `next` in one period.
    fn joint_velocities(&mut self, next: &[AxisState; 3], health: &mut Health) -> Option<[f64; J]> {
        let held = self.held.as_ref()?;
        let here: Vector3<f64> = self.tool.map(|axis| axis.position).into();
        let there: Vector3<f64> = next.map(|axis| axis.position).into();
        let target = ToolTarget {
            position: self.plane.point_to_base(&here),
            velocity: self.plane.vector_to_base(&((there - here) / self.period_s)),
            axis: self.plane.tool_axis(),
            spin: None,
        };
        let step = self.ik.step(&held.kinematics, held.command.motion(), &target, self.period_s);
        self.reports.ik = step.report;
        if step.report.source != IkSource::Optimum {
            health.set(Health::IK_FAILED);
        }
        let (clearance, [held, yielded]) = (step.report.clearance, step.report.envelope);
        if clearance.held | clearance.yielded | held | yielded != 0 {
            health.set(Health::CLEARANCE);
        }
        if !(step.report.velocity_error.norm() <= IK_TOLERANCE_MPS) {
            health.set(Health::IK_LIMITED);
        }
        (step.report.source != IkSource::Brake).then_some(step.qd)
    }

    /// Lets the guard judge the step with `qd`, or the next step of a stop, and makes the result the commanded state.
    fn publish(&mut self, reach: Stamp, qd: Option<[f64; J]>, health: &mut Health) -> u32 {
        let Some(held) = &mut self.held else { return 0 };
        let qd = qd.unwrap_or_else(|| {
            let wanted = self.stop.next(&held.command, reach);
            let motion = held.command.motion();
            let step = self.ik.stopping(&held.kinematics, motion, &wanted, self.period_s);
            let [held, yielded] = step.envelope;
            if step.clearance.held | step.clearance.yielded | held | yielded != 0 {
                health.set(Health::CLEARANCE);
            }
            step.qd
        });
        let mut q = *held.command.q();
        for (q, qd) in q.iter_mut().zip(&qd) {
            *q += qd * self.period_s;
        }
        let verdict = self.guard.clamp(&held.command, &q, reach);
        if verdict.altered != 0 {
            health.set(Health::GUARD_ALTERED);
        }
        held.command = verdict.command;
        self.issued = held.command.stamp();
        held.valid_until = held.command.stamp() + self.valid_ns;
        held.kinematics = self.chain.forward(held.command.q());
        u32::from(verdict.reasons.bits())
    }

    /// Where the published joints put the tool [m], plane frame.
    fn commanded_tool(&self) -> Vector3<f64> {
        let tool = self.held.as_ref().map_or_else(Vector3::zeros, |held| held.kinematics.position);
        self.plane.point_from_base(&tool)
    }

    /// Lets the modelled arm follow the command from where it was to where it is.
    fn trail(&mut self, servo: &Servo, from: &Vector3<f64>) {
        let to = self.commanded_tool();
        for ((axis, from), to) in self.arm.iter_mut().zip(from.iter()).zip(to.iter()) {
            *axis = servo.follow(axis, *from, *to, self.period_s);
        }
    }

    /// Takes the tool state from joints that were limited on their way to what was `planned`.
    ///
    /// Commands tell the mean velocity of the step that ended and the acceleration at its beginning. Taken for those at its
    /// end, half of the acceleration would be lost in every limited step. At its end the acceleration is the planned one,
    /// moved by half of what was wrong at the beginning: the whole of it would swing, and none of it would wind up.
    fn fall_behind(&mut self, planned: &[AxisState; 3]) {
        let assumed = self.tool;
        self.resynchronise();
        for ((axis, planned), assumed) in self.tool.iter_mut().zip(planned).zip(&assumed) {
            let wrong = axis.acceleration - assumed.acceleration;
            axis.acceleration = planned.acceleration + 0.5 * wrong;
            axis.velocity += 0.5 * self.period_s * axis.acceleration;
        }
    }

    /// Takes the tool state from the commanded joints.
    fn resynchronise(&mut self) {
        let Some(held) = &self.held else { return };
        let tool = held.kinematics.tool_motion(held.command.qd(), held.command.qdd());
        self.tool = self.plane.axes_from_base(&tool.position, &tool.velocity, &tool.acceleration);
    }
}
