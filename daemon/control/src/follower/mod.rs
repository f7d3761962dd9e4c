//! `Follower::step`: one tick of the control law, from pen samples to a legal joint command.
//!
//! Contract: pure and total. It knows no clock (`now` is an argument), allocates nothing, never fails: whatever the
//! inputs, predictor or solver do, it returns a command that is finite, inside all limits and continuous with the last
//! one, and a health word that says what degraded. The same build and inputs give the same outputs, bit for bit.
//!
//! Time: at `now` the commanded state is the one published last. The step plans from it and publishes the joints for
//! `now` + dt with the mean velocity over that period, so that a consumer who follows q + q̇·(t − stamp) moves in
//! straight pieces from command to command.

mod answer;
mod home;
mod io;
mod motion;
mod plane;
mod plans;
mod reference;
mod request;
mod settings;
mod tracking;
mod watch;

pub use io::{
    Budget, EnableReading, Health, HomeProgress, JointCommand, JointReading, MAX_STEPS_PER_TICK, Mode,
    NoClock, Refusal, Request, Rung, Stage, StageClock, StepInput, StepOutput, StopCause, StopDetail,
    StopReason,
};
pub use plane::Plane;
pub use request::WayBlocked;
pub use settings::{FollowerError, FollowerSettings, SafetySettings, Would};

use motion::{Motion, Moved, Mover};
use plans::Plans;
use reference::Preview;
use watch::Watch;

use crate::lag::{Aim, DeadTime, LagEstimator};
use crate::learn::LearnStep;
use crate::monitor::Monitor;
use crate::pen::{PenOrigin, PenReading, PenTracker};
use crate::predict::bands::BAND_LEADS;
use crate::predict::{OnlineWeights, Oracle, PredictorKind, Previewer};
use crate::trust::{Evidence, Outcome, TrustControl, TrustInputs, TrustReport, TrustRequest};
use crate::units::{Stamp, Trust};

/// The control law of one arm: horizon of `N` steps, `J` joints.
#[derive(Debug)]
pub struct Follower<const N: usize, const J: usize> {
    settings: FollowerSettings<J>,
    watch: Watch<J>,
    pen: PenTracker,
    previewer: Previewer,
    preview: Preview,
    pending_predictor: Option<PredictorKind>,
    evidence: Box<Evidence>,
    trust: TrustControl,
    trust_request: TrustRequest,
    plans: Plans,
    /// See [`TrustInputs::overtaxed`].
    overtaxed: Option<bool>,
    outcome: Box<Outcome>,
    /// For so long the learner is not trusted after a set of its was refused [ns]: by then evidence has judged the set in force.
    learner_doubt_ns: u64,
    lag: Box<LagEstimator<J>>,
    dead_time: DeadTime,
    monitor: Box<Monitor<J>>,
    mover: Mover<N, J>,
}

/// Leads whose evidence decides, from the first that the plan looks at: what comes later weighs little in a plan that is made
/// anew in every tick.
const LEADS_JUDGED: usize = 2;

/// How long a refused set of weights counts against the learner, unless a sound one follows: the memory of the evidence.
const LEARNER_DOUBT_NS: u64 = 5_000_000_000;

/// What the pen gave in one tick.
struct PenNews {
    learn: [LearnStep; MAX_STEPS_PER_TICK],
    count: usize,
    jumped: bool,
    error: Option<f64>,
}

impl<const N: usize, const J: usize> Follower<N, J> {
    /// Builds everything that a tick will need; later steps allocate nothing.
    ///
    /// *Errors*: settings that are illegal or do not fit together, each with value and legal range.
    pub fn new(settings: FollowerSettings<J>) -> Result<Self, FollowerError> {
        let steps = settings.preview_steps(N)?;
        let step_ns = settings.pen.step_ns;
        let mut mover = Mover::new(&settings)?;
        let feedback_lag_s = mover.feedback_lag_s();
        let evidence = Evidence::new(step_ns as f64 * 1e-9, settings.trust.per_step);
        let aim = if settings.servo_ns() > 0 { Aim::GroupDelay } else { Aim::Shift };
        Ok(Self {
            watch: Watch::new(settings.safety),
            pen: PenTracker::new(settings.pen)?,
            previewer: Previewer::new(settings.preview, &settings.models, &settings.weights)?,
            preview: Preview::new(step_ns, steps).leading(settings.velocity_lead_ns),
            pending_predictor: None,
            evidence: Box::new(evidence.beside_feedback(feedback_lag_s)),
            trust: TrustControl::new(settings.trust)?,
            trust_request: settings.trust_request,
            plans: Plans::default(),
            overtaxed: None,
            // The tool is the command's, which a plan that reckons with its servo has ahead of the arm.
            outcome: Box::new(Outcome::new(settings.period_ns, feedback_lag_s - settings.mpc.servo_s)),
            learner_doubt_ns: 0,
            lag: Box::new(LagEstimator::new()),
            dead_time: DeadTime::new(settings.dead_time_ns, settings.following).aiming_at(aim),
            monitor: Monitor::boxed(settings.safety.tracking, settings.longest_lag_ns()),
            mover,
            settings,
        })
    }

    /// Gives the recorded future to the oracle and makes it the predictor (experiments only).
    pub fn use_oracle(&mut self, oracle: Oracle) {
        self.previewer.load_recording(oracle);
        // A recording was just loaded, the only thing `choose` can miss.
        let _ = self.previewer.choose(PredictorKind::Oracle);
    }

    /// What it was built from.
    #[must_use]
    pub fn settings(&self) -> &FollowerSettings<J> {
        &self.settings
    }

    /// The weights in use.
    #[must_use]
    pub fn weights(&self) -> OnlineWeights {
        self.previewer.weights()
    }

    /// Takes charge of an arm that stands at `q` [rad], whoever had it before: for a loop that runs beside the real one.
    ///
    /// *Errors*: the joints or the tool are where no arm may be armed.
    pub(crate) fn take_over(&mut self, now: Stamp, q: &[f64; J]) -> Result<(), Refusal> {
        self.mover.seed(now, q)?;
        self.monitor.begin(now);
        self.watch.arm(now);
        Ok(())
    }

    /// One tick. `budget` was decided by the caller from its own clock; `clock` is told when a stage ends.
    pub fn step(
        &mut self,
        input: &StepInput<'_, J>,
        budget: Budget,
        clock: &mut impl StageClock,
    ) -> StepOutput<J> {
        let now = input.now;
        let mut health = Health::default();

        let lost_ns = self.mover.catch_up(now, &mut health);
        if lost_ns > self.settings.safety.latch_after_ns {
            self.watch.latch(now, StopReason::TimeLost);
        }
        if let Some((reason, detail)) = input.halt {
            self.watch.latch_with(now, reason, detail);
        }
        self.watch.observe(now, input.joints, input.enable, &mut health);
        if let Some(joints) = input.joints.filter(|_| !health.has(Health::JOINTS_REJECTED)) {
            self.lag.measured(joints.stamp, &joints.q);
            self.monitor_joints(now, joints);
        }
        self.dead_time.advance(self.lag.estimate().as_ref(), self.settings.period_ns);
        let answer = input.request.map(|request| self.answer(now, request));
        let begins =
            matches!((input.request, answer), (Some(Request::Arm | Request::MoveHome), Some(Ok(()))));
        self.watch.check(now, &mut health);
        let news = self.read_pen(now, input.pen, &mut health);
        let pen_age = self.pen.age_ns(now);
        if pen_age.is_none_or(|age| age > self.settings.trust.stale_after_ns) {
            health.set(Health::PEN_STALE);
        }
        self.watch.heed_pen(pen_age);
        clock.lap(Stage::Pen);

        if let Some(weights) = input.weights {
            self.learner_doubt_ns = 0;
            if self.previewer.set_weights(weights).is_err() {
                health.set(Health::WEIGHTS_REFUSED);
                self.learner_doubt_ns = LEARNER_DOUBT_NS;
            }
        }
        let trust = self.believe(pen_age, news.jumped);
        if news.count > 0 || input.weights.is_some() || trust.switched {
            let steps = self.settings.steps_for(N, self.dead_time.ns());
            self.preview.refresh(&self.previewer, steps);
            if trust.switched {
                self.evidence.forget();
            }
            if news.count > 0 {
                let velocity = self.previewer.newest().map_or([0.0; 2], |step| step.displacement);
                self.evidence.shoot(self.preview.base_position(), velocity, self.preview.predicted());
                let nearest = self.nearest_lead();
                if let Some(radius) = self.preview.claimed(nearest) {
                    self.evidence.claim(nearest, radius);
                }
            }
        }
        if let Some(newest) = self.pen.newest() {
            let per_step =
                self.settings.trust.per_step && !matches!(self.trust_request, TrustRequest::Manual(_));
            self.evidence.observe(newest.stamp, newest.position);
            self.preview.correct(&newest, &mut self.evidence, per_step);
        }
        if !self.preview.is_finite() {
            health.set(Health::PREDICTOR_INVALID);
        }
        clock.lap(Stage::Predict);

        let wanted = self.wanted(now, trust.report.alpha);
        self.mover.pace_mps = self.monitor.allowed_mps();
        let moved = self.mover.advance(wanted.as_ref(), budget, &mut health, clock);
        if let Some(detail) = moved.breach {
            self.watch.latch_with(now, StopReason::Envelope, detail);
        }
        let way = self.heed_home(now, moved.home);
        self.overtaxed = self.overtaxed_by(&moved, now, lost_ns);
        self.evidence.drove(moved.at_limit, self.settings.period_ns);
        if matches!(wanted, Some(Motion::Follow { .. })) {
            self.plans.see(moved.rung, health);
        }
        if moved.at_rest && self.watch.stopped() && self.watch.came_to_rest() {
            self.mover.let_go();
        }
        match &moved.command {
            Some(command) => {
                self.lag.commanded(command.stamp, &command.q);
                self.monitor.commanded(command.stamp, &command.q, &moved.tool);
            }
            None => self.lag.released(),
        }
        clock.lap(Stage::Guard);

        let newest = self.pen.newest();
        StepOutput {
            command: moved
                .command
                .map(|command| JointCommand { enabled: !(self.watch.stopped() && moved.at_rest), ..command }),
            begins,
            mode: self.watch.mode(),
            stop_reason: self.watch.reason(),
            stop_detail: self.watch.detail(),
            arm_speed_share: self.monitor.speed_share(),
            answer,
            home: (self.watch.mode() == Mode::Homing).then(|| self.mover.home_progress()),
            way,
            rung: moved.rung,
            health,
            trust: trust.report,
            predictor: self.previewer.active(),
            weights_version: self.previewer.version(),
            pen_stamp: newest.map(|pen| pen.stamp),
            pen_origin: newest.map_or_else(PenOrigin::default, |pen| pen.origin),
            pen_position: newest.map_or([0.0; 2], |pen| pen.position),
            pen_contact: newest.is_some_and(|pen| pen.contact),
            pen_counters: self.pen.counters(),
            pen_refused: self.pen.refused(),
            predictor_error: news.error,
            predictor_band: self.preview.band(now, self.ahead_ns()),
            dead_time_ns: self.dead_time.ns(),
            lag: self.lag.estimate(),
            reference: moved.reference,
            setpoint: moved.setpoint,
            tool: moved.tool,
            axes: moved.axes,
            ik: moved.ik,
            guard_altered: moved.guard_altered,
            learn: news.learn,
            learn_count: news.count,
        }
    }

    /// Takes in the pen samples and the grid steps that they close.
    fn read_pen(&mut self, now: Stamp, samples: &[PenReading], health: &mut Health) -> PenNews {
        let before = self.pen.counters().rejected();
        for sample in samples {
            let position = self.settings.plane.from_pen(sample.position);
            self.pen.ingest(now, &PenReading { position, ..*sample });
        }
        if self.pen.counters().rejected() > before {
            health.set(Health::PEN_REJECTED);
        }
        let mut news = PenNews {
            learn: [LearnStep::default(); MAX_STEPS_PER_TICK],
            count: 0,
            jumped: false,
            error: None,
        };
        let mut expected = self.preview.next_displacement();
        for slot in &mut news.learn {
            let Some(step) = self.pen.next_step() else { break };
            *slot = self.previewer.observe(&step);
            news.count += 1;
            match slot.motion {
                crate::pen::Motion::Continues => {
                    self.evidence.realise(step.position, slot.scale_m);
                    // Only the first step of a tick was predicted from the step just before it.
                    if let Some([x, y]) = expected.take() {
                        let [dx, dy] = step.displacement;
                        news.error = Some((dx - x).hypot(dy - y));
                    }
                }
                crate::pen::Motion::Jump => {
                    news.jumped = true;
                    self.evidence.interrupt();
                    expected = None;
                }
                crate::pen::Motion::Start => {
                    self.evidence.interrupt();
                    expected = None;
                }
            }
        }
        if news.jumped {
            health.set(Health::PEN_JUMP);
        }
        news
    }

    fn believe(&mut self, pen_age: Option<u64>, jumped: bool) -> Believed {
        let nearest = self.nearest_lead();
        let report = self.trust.update(
            &TrustInputs {
                request: self.trust_request,
                armed: self.watch.follows(),
                history: self.previewer.history(),
                pen_age_ns: pen_age,
                jumped,
                preview_finite: self.preview.is_finite(),
                switching: self.pending_predictor.is_some(),
                unplanned: self.plans.stopped,
                failed: self.plans.failed,
                overtaxed: self.overtaxed,
                reaction_ns: self.outcome.reaction_ns(self.dead_time.ns()),
                weights_refused: self.learner_doubt_ns > 0,
                record: self.evidence.record(nearest, nearest + LEADS_JUDGED - 1),
            },
            self.settings.period_ns,
        );
        self.learner_doubt_ns = self.learner_doubt_ns.saturating_sub(self.settings.period_ns);
        let mut switched = false;
        if report.alpha.alpha() <= 0.0
            && let Some(kind) = self.pending_predictor.take()
        {
            switched = self.previewer.choose(kind).is_ok();
            self.learner_doubt_ns = 0;
        }
        Believed { report, switched }
    }

    /// See [`TrustInputs::overtaxed`].
    fn overtaxed_by(&mut self, moved: &Moved<J>, now: Stamp, lost_ns: u64) -> Option<bool> {
        if lost_ns > 0 {
            self.outcome.break_off();
        }
        let Some(pen) = self.pen.newest().filter(|_| moved.follows) else {
            self.outcome.forget();
            return None;
        };
        let [x, y, _] = moved.tool;
        let sample = (pen.stamp, self.settings.mpc.inside(pen.position));
        self.outcome.see(now, [x, y], sample, self.dead_time.ns());
        moved.at_limit.map(|at_limit| at_limit && self.outcome.is_poor())
    }

    /// The nearest lead that a plan looks at, as far as there are bands [steps].
    fn nearest_lead(&self) -> usize {
        ((self.ahead_ns() / self.settings.pen.step_ns) as usize + 1).min(BAND_LEADS)
    }

    /// How far ahead references lie: the dead time, without the servo that the plan reckons with, and the plan's response.
    fn ahead_ns(&self) -> u64 {
        self.dead_time.ns().saturating_sub(self.settings.servo_ns()).saturating_add(self.settings.response_ns)
    }

    /// What the plan should follow; `None` while the arm is not to follow the pen.
    fn wanted(&self, now: Stamp, trust: Trust) -> Option<Motion<N>> {
        match self.watch.mode() {
            Mode::Idle => return None,
            Mode::Homing => return Some(Motion::Home),
            Mode::Armed | Mode::Stopped | Mode::Fault => return Some(Motion::Stop),
            Mode::Following | Mode::Holding => {}
        }
        let pen = self.pen.newest()?;
        let preview = self.preview.references(now, self.ahead_ns(), self.settings.mpc.step_s);
        Some(Motion::Follow { pen, holding: self.watch.mode() == Mode::Holding, preview, trust })
    }
}

/// Trust after one tick, and whether another predictor took over.
struct Believed {
    report: TrustReport,
    switched: bool,
}
