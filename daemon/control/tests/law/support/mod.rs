//! A UR5 above a table, a pen, and ideal joint states, shared by the whole-step tests.

pub(crate) mod dybm;
pub(crate) mod judging;
pub(crate) mod lagging;
pub(crate) mod limited;
pub(crate) mod own_rules;
pub(crate) mod reaching;
pub(crate) mod strokes;
pub(crate) mod touching;
pub(crate) mod writing;

use std::sync::Arc;

use foretrace_control::arm::lag::Following;
use foretrace_control::arm::{Chain, JointLimits, Payload};
use foretrace_control::contact::ContactSettings;
use foretrace_control::envelope::EnvelopeSettings;
use foretrace_control::follower::{
    Budget, Follower, FollowerSettings, JointCommand, JointReading, NoClock, Request, SafetySettings,
    StepInput, StepOutput,
};
use foretrace_control::guard::CommandChecker;
use foretrace_control::ik::{IkBackend, IkSettings};
use foretrace_control::learn::{Learner, LearnerSettings};
use foretrace_control::monitor::TrackingSettings;
use foretrace_control::mpc::{AxisLimits, Backend, Gains, MpcSettings, SoftPenalty};
use foretrace_control::pen::{PenReading, PenSettings};
use foretrace_control::plane::Plane;
use foretrace_control::predict::Networks;
use foretrace_control::predict::models::dybm::{DybmShape, TraceInput};
use foretrace_control::predict::models::lstm::{LstmSpec, LstmTensors, LstmWeights};
use foretrace_control::predict::refine::RefineParameters;
use foretrace_control::predict::{
    DybmWeights, InitialWeights, ModelSettings, Models, OnlineWeights, PredictorKind, PreviewSettings,
};
use foretrace_control::skill::SkillParameters;
use foretrace_control::trust::{TrustRequest, TrustSettings};
use foretrace_control::units::Stamp;
use nalgebra::{Matrix3, Rotation3, Vector3};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

pub(crate) const HOME: [f64; 6] = [0.0, -1.9, -1.7, -1.112_388_980_384_69, std::f64::consts::FRAC_PI_2, 0.0];
pub(crate) const PERIOD_NS: u64 = 2_000_000;
pub(crate) const STEP_NS: u64 = 10_000_000;

/// Settings of a UR5 that writes on a plane through its home pose.
pub(crate) fn settings(kind: PredictorKind) -> FollowerSettings<6> {
    let urdf = include_str!("../../../../../config/robots/ur5.urdf");
    let chain = Chain::<6>::from_urdf(urdf, None, None).unwrap();
    let home = chain.forward(&HOME);
    let z = -home.rotation.column(2).into_owned();
    let x = (Vector3::x() - z * z.x).normalize();
    let rotation = Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[x, z.cross(&x), z]));
    let period_s = PERIOD_NS as f64 * 1e-9;
    let tau = std::f64::consts::TAU;
    let limits = JointLimits::new([[-tau, tau]; 6], [3.0; 6], [30.0; 6])
        .unwrap()
        .with_stale_braking(5.0 * period_s, [20.0; 6])
        .unwrap();
    let axis = |half: f64| AxisLimits {
        jerk_mps3: 800.0,
        acceleration_mps2: 12.0,
        velocity_mps: 1.0,
        position_m: [-half, half],
    };
    let gains = Gains { position: 1.0, velocity: 0.2, acceleration: 0.01, decay: 1.0 };
    let mpc = MpcSettings {
        step_s: STEP_NS as f64 * 1e-9,
        gains_feedback: [gains; 3],
        gains_feedforward: [gains; 3],
        effort: 1e-3,
        axes: [axis(0.12), axis(0.12), axis(0.05)],
        soft_penalty: SoftPenalty::DEFAULT,
        backend: Backend::Exact,
        max_iterations: 200,
        servo_s: 0.0,
        unlimited: false,
    };
    FollowerSettings {
        payload: Payload { mass: 0.0, centre: [0.0, 0.0, 0.07] },
        period_ns: PERIOD_NS,
        pen: PenSettings { step_ns: STEP_NS, ..PenSettings::default() },
        preview: PreviewSettings { step_ns: STEP_NS, kind, ..PreviewSettings::default() },
        models: models(),
        weights: models().initial_weights(),
        refine: RefineParameters::SHIPPED,
        skill: SkillParameters::SHIPPED,
        trust: TrustSettings { step_ns: STEP_NS, ..TrustSettings::default() },
        trust_request: TrustRequest::Auto,
        mpc,
        plane: Plane {
            origin: home.position,
            rotation,
            pen_scale: 1.0,
            pen_origin: [0.0; 2],
            lift_height: 0.01,
            press_depth: 0.0,
        },
        chain,
        limits,
        ik: IkSettings::for_period(period_s, HOME),
        ik_backend: IkBackend::Exact,
        clearance: None,
        dead_time_ns: 0,
        following: Following::Fixed,
        response_ns: 0,
        velocity_lead_ns: 0,
        safety: SafetySettings {
            valid_periods: 5,
            latch_after_ns: 200_000_000,
            joint_state_timeout_ns: 100_000_000,
            enable_timeout_ns: 100_000_000,
            enable_required: false,
            hold_after_ns: 150_000_000,
            arm_max_speed: 0.05,
            arm_workspace_margin: 0.05,
            arm_max_tilt: 0.35,
            previous_plan_max_ns: 50_000_000,
            approach_distance: 0.01,
            tracking: TrackingSettings::default(),
            contact: ContactSettings::default(),
            envelope: EnvelopeSettings { margin_m: 0.003, max_tilt_rad: 0.4, max_speed_mps: None },
        },
    }
}

/// Those of the preset, but the linear DyBM starts as constant velocity.
pub(crate) fn models() -> Models {
    let mut settings = ModelSettings::preset(STEP_NS);
    settings.dybm.shape = DybmShape::new(2, &[0.5], TraceInput::Newest);
    settings.initial = InitialWeights::Persistent(1.0);
    Models::new(settings, networks(STEP_NS)).unwrap()
}

/// Untrained networks: one step ahead, and direct leads.
pub(crate) fn networks(step_ns: u64) -> Networks {
    Networks { lstm: Some(network(step_ns, 1)), mixture: Some(network(step_ns, 24)), foresight: None }
}

/// A network of 10 cells with small numbers from a fixed seed.
fn network(step_ns: u64, leads: usize) -> Arc<LstmWeights> {
    let spec =
        LstmSpec { residual: true, input_clip: Some(4.0), leads, ..LstmSpec::plain(10, 10.0, step_ns) };
    let mut tensors = LstmTensors::zero(spec.hidden, spec.leads);
    let mut rng = Pcg64::seed_from_u64(10);
    for value in tensors.all_mut().into_iter().flatten() {
        *value = rng.random_range(-0.3..0.3);
    }
    Arc::new(LstmWeights::new(spec, tensors).unwrap())
}

/// The models of the preset, and an untrained network.
pub(crate) fn models_with_network() -> Models {
    Models::new(ModelSettings::preset(STEP_NS), networks(STEP_NS)).unwrap()
}

/// A learner that compares over leads of 1 to 10 steps.
pub(crate) fn preset() -> LearnerSettings {
    LearnerSettings::preset(STEP_NS, 0)
}

pub(crate) fn learner() -> Learner {
    Learner::new(preset(), &models_with_network()).unwrap()
}

/// The initial weights with another linear DyBM.
pub(crate) fn with_dybm(dybm: DybmWeights) -> OnlineWeights {
    OnlineWeights { dybm, ..models_with_network().initial_weights() }
}

/// A follower, the arm that obeys it exactly, and an independent check of every command.
pub(crate) struct Bench {
    pub(crate) follower: Follower<10, 6>,
    pub(crate) checker: CommandChecker<6>,
    pub(crate) now: Stamp,
    pub(crate) joints: JointReading<6>,
    pub(crate) last: Option<JointCommand<6>>,
    /// The command of the last step was withheld.
    pub(crate) unsent: bool,
    /// Joint positions of recent readings: arming starts from one of them.
    shown: Vec<[f64; 6]>,
}

impl Bench {
    pub(crate) fn new(settings: FollowerSettings<6>) -> Self {
        let checker = CommandChecker::new(settings.limits);
        let now = Stamp(10_000_000_000);
        let joints = JointReading { stamp: now, q: HOME, qd: [0.0; 6], motion_allowed: true };
        Self {
            follower: Follower::new(settings).unwrap(),
            checker,
            now,
            joints,
            last: None,
            unsent: false,
            shown: Vec::new(),
        }
    }

    /// Armed and standing.
    pub(crate) fn armed(settings: FollowerSettings<6>) -> Self {
        let mut bench = Self::new(settings);
        let output = bench.tick_with(&[], Some(Request::Arm), Budget::default());
        assert_eq!(output.answer, Some(Ok(())));
        bench
    }

    pub(crate) fn tick(&mut self, pen: &[PenReading]) -> StepOutput<6> {
        self.tick_with(pen, None, Budget::default())
    }

    /// One period, with joint states that follow the commands exactly.
    pub(crate) fn tick_with(
        &mut self,
        pen: &[PenReading],
        request: Option<Request>,
        budget: Budget,
    ) -> StepOutput<6> {
        self.joints.stamp = self.now;
        let joints = self.joints;
        let input = StepInput { pen, joints: Some(&joints), request, ..StepInput::nothing(self.now) };
        self.step(&input, budget)
    }

    /// Any input; the command is checked in any case, then time advances by one period.
    pub(crate) fn step(&mut self, input: &StepInput<'_, 6>, budget: Budget) -> StepOutput<6> {
        self.shown.extend(input.joints.map(|joints| joints.q));
        let input = StepInput { unsent: std::mem::take(&mut self.unsent), ..*input };
        let output = self.follower.step(&input, budget, &mut NoClock);
        if let Some(command) = output.command {
            if output.begins {
                // Armed anew: continuity is with the arm, not with earlier commands.
                self.checker.restart();
                let distance = |q: &[f64; 6]| {
                    q.iter().zip(&command.q).fold(0.0f64, |worst, (a, b)| worst.max((a - b).abs()))
                };
                let jump = self.shown.iter().rev().take(60).map(distance).fold(f64::INFINITY, f64::min);
                assert!(jump < 1e-3, "arming jumps by {jump} rad");
            }
            let legal = self.checker.observe(command.stamp, command.valid_until, &command.q, &command.qd);
            assert!(legal, "illegal command {command:?} after {:?}", self.last);
            self.joints.q = command.q;
            self.joints.qd = command.qd;
        }
        self.last = output.command;
        self.now = self.now + PERIOD_NS;
        output
    }

    /// A step whose command reaches nobody; then time advances by one period.
    pub(crate) fn withhold(&mut self, input: &StepInput<'_, 6>, budget: Budget) -> StepOutput<6> {
        self.shown.extend(input.joints.map(|joints| joints.q));
        let input = StepInput { unsent: std::mem::take(&mut self.unsent), ..*input };
        let output = self.follower.step(&input, budget, &mut NoClock);
        self.unsent = output.command.is_some();
        self.now = self.now + PERIOD_NS;
        output
    }

    /// The pen at `position` at this very instant.
    pub(crate) fn pen(&self, position: [f64; 2]) -> PenReading {
        PenReading::new(self.now, position, true)
    }
}
