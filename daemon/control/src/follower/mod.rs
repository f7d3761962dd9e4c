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

mod aim;
mod answer;
mod foresee;
mod home;
mod intake;
mod io;
mod motion;
mod plans;
mod report;
mod request;
mod settings;
mod stock;
mod tracking;
mod watch;

use crate::state::state;
pub use io::{
    Budget, EnableReading, Health, HomeProgress, JointCommand, JointReading, MAX_STEPS_PER_TICK, Mode,
    NoClock, PATH_POINTS, PreviewPath, Refusal, Request, Rung, Stage, StageClock, StepInput, StepOutput,
};
pub use request::WayBlocked;
pub use settings::{FollowerError, FollowerSettings, SafetySettings, Would};

use foresee::Left;
use motion::{Mover, Wanted};
use plans::Plans;
use report::Outcomes;
use watch::Watch;

use crate::arm::lag::{Aim, DeadTime, LagEstimator};
use crate::contact::Contact;
use crate::monitor::Monitor;
use crate::pen::{PenTracker, Silence};
use crate::predict::refine::{Preview, Refiner};
use crate::predict::{OnlineWeights, Oracle, PredictorKind, Previewer};
use crate::reference::Reference;
use crate::skill::Skill;
use crate::trust::{Outcome, TrustControl, TrustRequest};
use crate::units::Stamp;

/// The control law of one arm: horizon of `N` steps, `J` joints.
#[derive(Debug)]
pub struct Follower<const N: usize, const J: usize> {
    settings: FollowerSettings<J>,
    watch: Watch<J>,
    pen: PenTracker,
    silence: Silence,
    previewer: Previewer,
    preview: Preview,
    refiner: Box<Refiner>,
    pending_predictor: Option<PredictorKind>,
    skill: Box<Skill>,
    /// What the last tick left for the skill to judge.
    left: Left,
    reference: Reference,
    trust: TrustControl,
    trust_request: TrustRequest,
    plans: Plans,
    /// See [`crate::trust::TrustInputs::overtaxed`].
    overtaxed: Option<bool>,
    outcome: Box<Outcome>,
    /// How long the learner is not trusted after one of its sets was refused \[ns\]; by then the record
    /// judges the set in force.
    learner_doubt_ns: u64,
    lag: Box<LagEstimator<J>>,
    dead_time: DeadTime,
    monitor: Box<Monitor<J>>,
    contact: Box<Contact<J>>,
    mover: Mover<N, J>,
}

state! {
    [const N: usize, const J: usize] Follower<N, J> {
        watch, pen, silence, previewer, preview, refiner, pending_predictor, skill, left, trust,
        trust_request, plans, overtaxed, outcome, learner_doubt_ns, lag, dead_time, monitor, contact, mover,
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
        let step_ns = settings.pen.step_ns;
        let mut mover = Mover::new(&settings)?;
        let feedback_lag_s = mover.feedback_lag_s();
        let skill = Skill::tuned(step_ns as f64 * 1e-9, settings.trust.per_step, settings.skill);
        let aim = if settings.servo_ns() > 0 { Aim::GroupDelay } else { Aim::Shift };
        Ok(Self {
            watch: Watch::new(settings.safety),
            pen: PenTracker::new(settings.pen)?,
            silence: Silence::new(step_ns),
            previewer: Previewer::new(settings.preview, &settings.models, &settings.weights)?,
            preview: Preview::new(step_ns, steps),
            refiner: Box::new(Refiner::tuned(step_ns as f64 * 1e-9, settings.refine)),
            pending_predictor: None,
            skill: Box::new(skill.beside_feedback(feedback_lag_s)),
            left: Left::default(),
            reference: Reference::leading(step_ns, settings.velocity_lead_ns),
            trust: TrustControl::new(settings.trust)?,
            trust_request: settings.trust_request,
            plans: Plans::new(settings.period_ns, &settings.trust.parameters),
            overtaxed: None,
            // The tool is the command's; a plan that models the servo puts that ahead of the arm.
            outcome: Box::new(Outcome::new(
                settings.period_ns,
                feedback_lag_s - settings.mpc.servo_s,
                &settings.trust.parameters,
            )),
            learner_doubt_ns: 0,
            lag: Box::new(LagEstimator::new()),
            dead_time: DeadTime::new(settings.dead_time_ns, settings.following).aiming_at(aim),
            monitor: Monitor::boxed(
                settings.safety.tracking,
                settings.longest_lag_ns(),
                *settings.limits.velocity(),
            ),
            contact: Contact::boxed(settings.safety.contact, &settings.chain, &settings.payload),
            mover,
            settings,
        })
    }

    /// Gives the recorded future to the oracle and makes it the predictor (experiments only).
    pub fn use_oracle(&mut self, oracle: Oracle) {
        self.previewer.load_recording(oracle);
        // The recording was just loaded, the only thing `choose` can miss.
        let _ = self.previewer.choose(PredictorKind::ORACLE);
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
        self.previewer.tell_weights(&mut weights);
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
        self.contact.begin();
        self.watch.arm(now);
        Ok(())
    }

    /// One tick. The caller decides `budget` from its own clock; `clock` is told when a stage ends.
    ///
    /// The stages stand in the order in which they run, which is the order of the data. What a stage needs of
    /// a later one is that stage's result of the tick before.
    pub fn step(
        &mut self,
        input: &StepInput<'_, J>,
        budget: Budget,
        clock: &mut impl StageClock,
    ) -> StepOutput<J> {
        let now = input.now;
        let mut health = Health::default();

        // Watch and monitor: what arrived, whether the arm is where it was told to be, what the operator
        // wants.
        let seen = self.take_in(input, &mut health);
        // Pen: samples onto the grid.
        let pen = self.read_pen(now, input.pen, &mut health);
        clock.lap(Stage::Pen);

        // Skill: how good past previews were.
        self.judge_past_previews(&pen);
        // Predict, with the weights that the learner promoted and the predictor that the operator chose.
        self.adopt(input.weights, &mut health);
        let switched = self.switch();
        if pen.count > 0 || input.weights.is_some() || switched {
            self.predict(&pen);
        }
        // Refine by samples newer than the grid, as far as past previews justify.
        let skill = self.skill();
        self.refine(&skill, &mut health);
        // Trust: how much of the preview to use.
        let trust = self.believe(&pen, skill.record);
        clock.lap(Stage::Predict);

        // Reference: where the pen will be when the arm gets there.
        let wanted = self.wanted(now, trust.alpha);
        self.mover.pace_mps = self.monitor.allowed_mps();
        // Plan, solve, keep the envelope, guard: the plan's first step as joints that may be published.
        let moved = self.mover.advance(wanted.as_ref(), budget, &mut health, clock);
        let followed = matches!(wanted, Some(Wanted::Follow { .. }));
        // Take stock: what the tick came to, for lag, monitor and the next tick.
        let way = self.record_outcome(now, seen.lost_ns, followed, &moved, health);
        clock.lap(Stage::Guard);

        self.report(now, Outcomes { health, seen, pen, trust, moved, way })
    }
}
