//! `Follower::step`: one tick of the control law, from pen samples to a legal joint command.
//!
//! Contract: pure and total. It knows no clock (`now` is an argument), allocates nothing, never fails:
//! whatever the inputs, predictor or solver do, it returns a command that is finite, inside all limits and
//! continuous with the last one, and a health word that says what degraded. The same build and inputs give
//! the same outputs, bit for bit.
//!
//! Time: at `now` the commanded state is the one published last. The step plans from it and publishes the
//! joints for `now` + dt with the mean velocity over that period, so that a consumer which follows q + q̇·(t
//! − stamp) moves on straight segments from command to command.

mod io;
mod settings;
mod request;
mod watch;
mod monitor;
mod home;
mod answer;
mod pen;
mod predict;
mod plans;
mod trust;
mod motion;
mod report;

use crate::state::state;
pub use io::{
    Budget, EnableReading, Health, HomeProgress, JointCommand, JointReading, MAX_STEPS_PER_TICK, Mode,
    NoClock, PATH_POINTS, PreviewPath, Refusal, Request, Rung, Stage, StageClock, StepInput, StepOutput,
};
pub use request::WayBlocked;
pub use settings::{FollowerError, FollowerSettings, RestRemedy, SafetySettings};

use answer::answer;
use monitor::ArmMonitor;
use motion::{Followed, Governor, MotionGoal, Mover, Saturation};
use pen::PenIntake;
use predict::{Prediction, PredictionInput};
use report::TickReport;
use trust::{Evidence, TrustStage};
use watch::ModeWatch;

use crate::estimate::{Estimate, Estimates, RefinedPreview};
use crate::predict::{OnlineWeights, Oracle, PlanLeads, Previewer};
use crate::reference::Reference;
use crate::units::Stamp;

/// The control law of one arm: horizon of `N` steps, `J` joints. Its fields are the stages of a tick, in
/// their order; `preview` is what prediction, estimate and reference hand on.
#[derive(Debug)]
pub struct Follower<const N: usize, const J: usize> {
    settings: FollowerSettings<J>,
    watch: ModeWatch<J>,
    monitor: ArmMonitor<J>,
    pen: PenIntake,
    prediction: Prediction,
    preview: RefinedPreview,
    estimate: Estimates,
    trust: TrustStage,
    governor: Governor,
    saturation: Saturation,
    reference: Reference,
    mover: Mover<N, J>,
}

state! {
    [const N: usize, const J: usize] Follower<N, J> {
        watch, monitor, pen, prediction, preview, estimate, trust, governor, saturation, mover,
    }
    fixed { settings, reference }
}

impl<const N: usize, const J: usize> Follower<N, J> {
    /// Builds everything that a tick will need; later steps allocate nothing.
    ///
    /// # Errors
    ///
    /// Settings that are illegal or do not fit together, each with value and legal range.
    pub fn new(settings: FollowerSettings<J>) -> Result<Self, FollowerError> {
        let steps = settings.preview_steps(N)?;
        let mut mover = Mover::new(&settings)?;
        let feedback_lag_s = mover.feedback_lag_s();
        let (step_ns, plan_step_s) = (settings.pen.step_ns, settings.mpc.step_s);
        let preview = RefinedPreview::new(step_ns, steps);
        let per_step = settings.trust.per_step;
        let estimate = Estimate::new(step_ns, per_step, feedback_lag_s, &settings.law, &settings.prior);
        Ok(Self {
            watch: ModeWatch::new(&settings),
            monitor: ArmMonitor::new(&settings),
            pen: PenIntake::new(&settings)?,
            prediction: Prediction::new(Previewer::new(
                settings.preview,
                &settings.models,
                &settings.weights,
            )?),
            estimate: Estimates::new(estimate, &preview),
            preview,
            trust: TrustStage::new(&settings)?,
            // The tool is the command's; a plan that models the servo puts that ahead of the arm.
            governor: Governor::new(settings.period_ns, feedback_lag_s - settings.mpc.servo_s, &settings.law),
            saturation: Saturation::new(settings.period_ns, &settings.law),
            reference: Reference::leading(step_ns, settings.velocity_lead_ns, plan_step_s),
            mover,
            settings,
        })
    }

    /// Gives the recorded future to the oracle and makes it the predictor (experiments only).
    pub fn use_oracle(&mut self, oracle: Oracle) {
        self.prediction.use_oracle(oracle);
    }

    /// The settings it was built from.
    #[must_use]
    pub fn settings(&self) -> &FollowerSettings<J> {
        &self.settings
    }

    /// The weights in use.
    #[must_use]
    pub fn weights(&self) -> OnlineWeights {
        let mut weights = self.settings.weights;
        self.prediction.previewer().tell_weights(&mut weights);
        weights
    }

    /// Takes charge of an arm that stands at `q` \[rad\], without a request: for a loop that runs beside the
    /// real one.
    ///
    /// # Errors
    ///
    /// The arm may not be armed there.
    pub(crate) fn take_over(&mut self, now: Stamp, q: &[f64; J]) -> Result<(), Refusal> {
        self.mover.seed(now, q)?;
        self.monitor.begin(now);
        self.watch.arm(now);
        Ok(())
    }

    /// One tick. The caller decides `budget` from its own clock; `clock` hears when a stage ends.
    ///
    /// The stages stand in the order in which they run, which is the order of the data. What a stage needs of
    /// a later one is that stage's result of the tick before.
    pub fn step(
        &mut self,
        input: &StepInput<'_, J>,
        budget: Budget,
        clock: &mut impl StageClock,
    ) -> StepOutput<J> {
        let (now, mut health) = (input.now, Health::default());

        // Watch and monitor: what arrived, whether the arm is where it was commanded to be, what the operator
        // wants.
        let gap = self.mover.begin(now, input.unsent, &mut health);
        let joints = self.watch.observe(input, gap.lost_ns, &mut health);
        self.monitor.catch_up(&gap);
        let stop = self.monitor.observe(joints, input.effort, self.watch.engaged());
        self.watch.latch_found(now, stop);
        let Self { watch, monitor, prediction, trust, mover, .. } = self;
        let request = input.request;
        let answer = request.map(|asked| answer(now, asked, watch, monitor, prediction, trust, mover));
        self.watch.check(now, &mut health);

        // Pen: samples onto the grid.
        let pen = self.pen.read(now, input.pen, &mut health);
        self.watch.observe_pen(pen.silent_ns, pen.late_ns);
        let closed = self.prediction.observe(pen.steps(), &self.preview, &mut health);
        clock.lap(Stage::Pen);

        // Predict, with the weights that the learner promoted and the predictor that the operator chose.
        let ahead = self.settings.lookahead(N, self.monitor.dead_time_ns());
        let news = PredictionInput {
            closed: closed.count > 0,
            weights: input.weights,
            external: input.preview,
            trust: self.trust.alpha(),
            leads: PlanLeads { nearest: ahead.nearest_lead, last: ahead.last_lead, farthest: ahead.steps },
        };
        let predicted = self.prediction.update(&mut self.preview, &news, &mut health);
        // Estimate: what past previews were worth, and what the newest sample changes in this one.
        let (steps, nearest) = (closed.steps(), ahead.nearest_lead);
        let saturated = self.saturation.share();
        let (source, previewer) = (predicted.source(), self.prediction.previewer());
        let made = (&self.preview, ahead.steps, predicted.renewed);
        let worth = self.estimate.update(steps, source, previewer, made, nearest, saturated);
        let follows = self.watch.follows();
        // No part of a preview is in use.
        if !follows || predicted.switched {
            self.governor.release();
        }
        let governor = self.governor.share();
        let per_step = self.trust.per_step();
        self.estimate.refine(&mut self.preview, pen.newest.as_ref(), per_step, governor);
        // Trust: how much of the preview to use.
        let (pen_age_ns, record) = (pen.age_ns, worth.record);
        let trust = self.trust.update(&Evidence { follows, pen_age_ns, predicted, record });
        clock.lap(Stage::Predict);

        // Reference: where the pen will be when the arm gets there.
        let references = || self.reference.of_pen(&self.preview, pen.resting_at, now, ahead.ahead_ns);
        let pace_mps = self.monitor.allowed_mps();
        let wanted = MotionGoal::of(self.watch.mode(), pen.newest, references, trust.alpha, pace_mps);
        // Plan, solve, keep the envelope, guard: the plan's first step as joints that may be published.
        let moved = self.mover.advance(wanted.as_ref(), budget, &mut health, clock);

        // What the tick came to, for the next one.
        let (way, lets_go) = self.watch.record(now, &moved);
        if lets_go {
            self.mover.let_go();
        }
        self.saturation.record(moved.at_limit);
        if wanted.is_some_and(|wanted| wanted.follows()) {
            self.trust.record(moved.rung);
        }
        if gap.lost_ns > 0 {
            self.governor.break_off();
        }
        let followed = pen.newest.filter(|_| moved.follows).map(|pen| {
            let ([x, y, _], at) = (moved.tool, self.settings.mpc.inside(pen.position));
            let (dead_time_ns, saturated) =
                (ahead.dead_time_ns, moved.at_limit.map(|_| self.saturation.share()));
            Followed { now, tool: [x, y], pen: (pen.stamp, at), dead_time_ns, saturated }
        });
        self.governor.record(followed.as_ref(), &record, self.trust.is_automatic());
        self.monitor.record(&moved);
        clock.lap(Stage::Guard);

        self.report(TickReport {
            request,
            answer,
            gap,
            health,
            pen,
            closed,
            ahead,
            trust,
            external: predicted.external,
            governor,
            way,
            moved,
        })
    }
}
