//! The moving half of a tick: plan, inverse kinematics, guard, and the ladder of fallbacks between them.
//!
//! Contract: owns the commanded state. Whatever is asked for, the state after `advance` is legal and
//! continuous with the state before. Rungs: fresh plan → previous plan at the true elapsed time →
//! jerk-limited stop → hold.

mod setup;
mod arming;
mod takeover;
mod references;
mod plan;
mod home;
mod kept;
mod solve;
mod publish;
mod governor;
mod outcome;
mod saturation;

use crate::state::state;
use arming::Arming;
pub(super) use governor::{Followed, Governor};
pub(super) use home::HomeNews;
use home::Homing;
use kept::KeptPath;
pub(super) use saturation::Saturation;
pub(super) use setup::paced;
use setup::{comes_to_rest, inverse_kinematics, planner};

use super::Budget;
use super::io::{Health, JointCommand, Mode, PreviewPath, Rung, Stage, StageClock};
use super::settings::{FollowerError, FollowerSettings};
use crate::arm::servo::ServoModel;
use crate::arm::{Chain, Kinematics};
use crate::guard::{Commanded, Guard, StopProfile};
use crate::ik::{Ik, IkReport};
use crate::mpc::{AxisLimits, AxisReport, Mpc, Plan};
use crate::pen::PenReading;
use crate::plane::Plane;
use crate::stop::StopDetail;
use crate::units::{AxisState, Stamp, Trust};

/// Below this speed along both axes of the plane \[m/s\] saturation is not reported.
const MOVING_MPS: f64 = 0.05;

/// What the arm is to do in a tick.
#[derive(Debug, Clone)]
pub(super) enum MotionGoal<const N: usize> {
    Follow {
        /// Newest pen sample, plane frame.
        pen: PenReading,
        /// The pen is silent.
        holding: bool,
        /// References of x and y at i = 1..N.
        preview: Option<[[AxisState; N]; 2]>,
        /// How much of the preview to use.
        trust: Trust,
        /// Speed limit of the references \[m/s\], for an arm that is slow.
        pace_mps: Option<f64>,
    },
    /// Come to rest, and stay there.
    Stop,
    /// Go on with the way home.
    Home,
}

impl<const N: usize> MotionGoal<N> {
    /// What `mode` asks for, with the `pen` and its references; `None` while the arm is not to be moved.
    pub(super) fn of(
        mode: Mode,
        pen: Option<PenReading>,
        preview: impl FnOnce() -> Option<[[AxisState; N]; 2]>,
        trust: Trust,
        pace_mps: Option<f64>,
    ) -> Option<Self> {
        match mode {
            Mode::Idle => None,
            Mode::Homing => Some(Self::Home),
            Mode::Armed | Mode::Stopped | Mode::Fault => Some(Self::Stop),
            Mode::Following | Mode::Holding => {
                let holding = mode == Mode::Holding;
                Some(Self::Follow { pen: pen?, holding, preview: preview(), trust, pace_mps })
            }
        }
    }

    /// The pen is to be followed.
    pub(super) const fn follows(&self) -> bool {
        matches!(self, Self::Follow { .. })
    }
}

/// What passed between the last tick and this one.
#[derive(Debug, Clone, Copy)]
pub(super) struct Gap<const J: usize> {
    /// Nominal release time of this tick.
    pub(super) now: Stamp,
    /// Time without ticks before it \[ns\].
    pub(super) lost_ns: u64,
    /// Joints \[rad\] and tool \[m\], plane frame, that consumers were carried to meanwhile.
    pub(super) carried: Option<([f64; J], [f64; 3])>,
    /// The command that begins where the arm stands was not sent.
    pub(super) begins: bool,
}

/// What the motion of one tick came to.
#[derive(Debug, Clone, Default)]
pub(super) struct MotionReport<const J: usize> {
    pub(super) command: Option<JointCommand<J>>,
    pub(super) rung: Rung,
    pub(super) at_rest: bool,
    pub(super) reference: [f64; 3],
    pub(super) path: PreviewPath,
    pub(super) setpoint: [AxisState; 3],
    pub(super) tool: [f64; 3],
    pub(super) axes: [AxisReport; 3],
    pub(super) ik: IkReport,
    pub(super) guard_altered: u32,
    /// Which bound of the tool's envelope the command violates, if any.
    pub(super) breach: Option<StopDetail>,
    /// The tool moves by a plan.
    pub(super) follows: bool,
    /// Joints, acceleration or speed were saturated; `None` unless the tool followed a fresh plan in motion.
    pub(super) at_limit: Option<bool>,
    /// What the way home came to.
    pub(super) home: HomeNews,
}

/// The plan's tool state at the end of the period.
struct PlannedStep {
    /// First reference of the plan \[m\], plane frame.
    reference: [f64; 3],
    path: PreviewPath,
    /// The tool's state; `None` where there is no plan to follow.
    next: Option<[AxisState; 3]>,
    rung: Rung,
}

/// The joint velocities for it.
struct JointStep<const J: usize> {
    /// Joint velocities over the period \[rad/s\].
    qd: [f64; J],
    /// They follow the plan or the way home; else they are the next step of a stop.
    follows: bool,
    rung: Rung,
    home: HomeNews,
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
    held: Option<CommandedArm<J>>,
    /// What the stop that goes on keeps; `None`: no stop goes on.
    kept: Option<KeptPath<J>>,
    /// Stamp of the newest command; stamps never decrease, not even across an arming.
    issued: Stamp,
    reports: Reports,
    /// Commanded tool state in the plane frame: x₀ of the plan.
    tool: [AxisState; 3],
    /// Model of the arm's servo, if it is a filter, and the modelled tool state of the arm.
    servo: Option<ServoModel>,
    arm: [AxisState; 3],
    plan: Plan<N>,
    /// When `plan` begins; `None` while there is none to fall back to.
    plan_start: Option<Stamp>,
    /// The tool has left `plan`, to remain able to stop.
    bent: bool,
    /// Fraction of full reach that a plan is asked for.
    reach: f64,
    /// The tool has not come near the pen, or has lost it, and stays lifted.
    approaching: bool,
    height: f64,
}

state! {
    [const N: usize, const J: usize] Mover<N, J> {
        mpc, ik, homing, held, kept, issued, reports, tool, arm, plan, plan_start, bent, reach, approaching,
        height,
    }
    fixed {
        period_ns, period_s, valid_ns, previous_plan_max_ns, approach_distance, limits, arming, plane,
        chain, guard, stop, servo,
    }
}

/// The last command, and where it puts the arm.
#[derive(Debug, Clone)]
struct CommandedArm<const J: usize> {
    command: Commanded<J>,
    valid_until: Stamp,
    kinematics: Kinematics<J>,
    /// What the last step made, and what consumers have for sure: the one before until that one was sent.
    made: SentCommand<J>,
    sent: SentCommand<J>,
    /// Nothing was sent since the arm was taken over.
    fresh: bool,
}

state! { whole [const J: usize] CommandedArm<J> { command, valid_until, kinematics, made, sent, fresh } }

impl<const J: usize> CommandedArm<J> {
    /// An arm that is taken over.
    const fn new(command: Commanded<J>, valid_until: Stamp, kinematics: Kinematics<J>) -> Self {
        let made = SentCommand { command, valid_until };
        Self { command, valid_until, kinematics, made, sent: made, fresh: true }
    }
}

/// A command as it leaves a step.
#[derive(Debug, Clone, Copy)]
struct SentCommand<const J: usize> {
    command: Commanded<J>,
    valid_until: Stamp,
}

state! { whole [const J: usize] SentCommand<J> { command, valid_until } }

/// Evidence of the last solves, repeated where a tick solved nothing.
#[derive(Debug, Clone, Copy, Default)]
struct Reports {
    axes: [AxisReport; 3],
    ik: IkReport,
}

state! { [] Reports { axes, ik } }

impl<const N: usize, const J: usize> Mover<N, J> {
    pub(super) fn new(settings: &FollowerSettings<J>) -> Result<Self, FollowerError> {
        let mover = Self::built(settings)?;
        comes_to_rest::<N, J>(settings)?;
        Ok(mover)
    }

    /// Builds it without the check that it comes to rest.
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
            kept: None,
            issued: Stamp(0),
            reports: Reports::default(),
            tool: [AxisState::default(); 3],
            servo: ServoModel::new(settings.servo_ns()),
            arm: [AxisState::default(); 3],
            plan: Plan::resting(settings.mpc.step_s),
            plan_start: None,
            bent: false,
            reach: 1.0,
            approaching: true,
            height: settings.plane.lift_height,
        })
    }

    /// See [`Mpc::feedback_lag_s`].
    pub(super) fn feedback_lag_s(&mut self) -> f64 {
        self.mpc.feedback_lag_s(self.period_s)
    }

    /// One period of motion, stage by stage. Where the joints did not do what was planned, x₀ comes from what
    /// is really published, so that nothing winds up.
    pub(super) fn advance(
        &mut self,
        wanted: Option<&MotionGoal<N>>,
        budget: Budget,
        health: &mut Health,
        clock: &mut impl StageClock,
    ) -> MotionReport<J> {
        let (Some(held), Some(wanted)) = (&self.held, wanted) else { return self.nothing(clock) };
        let start = held.command.stamp();
        if budget.shed {
            health.set(Health::SHED);
        }
        let planned = self.plan(start, wanted, budget, health);
        clock.lap(Stage::Mpc);

        let solved = self.solve(start, wanted, &planned, health);
        clock.lap(Stage::Ik);

        let from = self.commanded_tool();
        let guard_altered = self.publish(start + self.period_ns, &solved.qd, health);
        let limited = health.has(Health::IK_LIMITED | Health::GUARD_ALTERED);
        let at_limit = self.at_limit(limited, &planned, solved.rung);
        self.keep_up(&planned, solved.follows, limited, &from, health);

        let (at_rest, tool) = (self.at_rest(), self.commanded_tool());
        let breach = self.breach((tool - from).norm() / self.period_s);
        MotionReport {
            command: self.held.as_ref().map(|held| JointCommand {
                stamp: held.command.stamp(),
                valid_until: held.valid_until,
                q: *held.command.q(),
                qd: *held.command.qd(),
                enabled: true,
            }),
            rung: if solved.rung == Rung::Stop && at_rest { Rung::Hold } else { solved.rung },
            at_rest,
            reference: planned.reference,
            path: planned.path,
            setpoint: self.tool,
            tool: [tool.x, tool.y, tool.z],
            axes: self.reports.axes,
            ik: self.reports.ik,
            guard_altered,
            breach,
            follows: solved.follows && planned.next.is_some(),
            at_limit,
            home: solved.home,
        }
    }

    /// Whether joints, acceleration or speed are saturated in this tick; `None` unless the tool follows a
    /// fresh plan in motion.
    fn at_limit(&self, limited: bool, planned: &PlannedStep, rung: Rung) -> Option<bool> {
        let moving = self.tool.iter().take(2).any(|axis| axis.velocity.abs() > MOVING_MPS);
        // A saturated jerk is normal for an aggressive plan and costs little; the workspace is no weakness of
        // the arm.
        let hurries = |axis: &AxisReport| axis.active.acceleration > 0 || axis.active.velocity > 0;
        let at_limit = limited || self.reports.axes.iter().take(2).any(hurries);
        (rung == Rung::FreshPlan && moving && planned.next.is_some()).then_some(at_limit)
    }

    /// Which bound of the tool's envelope the command violates at `speed` \[m/s\], if any.
    fn breach(&mut self, speed: f64) -> Option<StopDetail> {
        let (held, envelope) = self.held.as_ref().zip(self.ik.envelope())?;
        envelope.judge(&envelope.figures(&held.kinematics, speed))
    }

    fn nothing(&self, clock: &mut impl StageClock) -> MotionReport<J> {
        clock.lap(Stage::Mpc);
        clock.lap(Stage::Ik);
        let Reports { axes, ik } = self.reports;
        MotionReport { rung: Rung::Hold, at_rest: true, axes, ik, ..MotionReport::default() }
    }
}
