//! A UR5 above a table, a pen, and ideal joint states, shared by the whole-step tests.

pub(crate) mod dybm;
pub(crate) mod hostile;
pub(crate) mod judging;
pub(crate) mod lagging;
pub(crate) mod limited;
pub(crate) mod own_rules;
pub(crate) mod reaching;
pub(crate) mod strokes;
pub(crate) mod touching;
pub(crate) mod writing;
#[path = "../../../examples/ur5/settings.in"]
mod ur5;

use std::sync::Arc;

use foretrace_control::follower::{
    Budget, Follower, FollowerSettings, JointCommand, JointReading, NoClock, Request, StepInput, StepOutput,
};
use foretrace_control::guard::CommandChecker;
use foretrace_control::learn::{Learner, LearnerSettings};
use foretrace_control::pen::PenReading;
use foretrace_control::predict::models::dybm::{DybmShape, TraceInput};
use foretrace_control::predict::models::lstm::{LstmSpec, LstmTensors, LstmWeights};
use foretrace_control::predict::{
    DybmWeights, InitialWeights, ModelSettings, Models, Networks, OnlineWeights, PredictorKind,
};
use foretrace_control::units::Stamp;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

pub(crate) use ur5::{HOME, PERIOD_NS, STEP_NS};

/// Settings of a UR5 that writes on a plane through its home pose.
pub(crate) fn settings(kind: PredictorKind) -> FollowerSettings<6> {
    ur5::settings(kind, models())
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
