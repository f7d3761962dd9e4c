//! Online learning: candidates learn from the pen, the live weights are frozen, evidence decides.
//!
//! Contract: one call per grid step, no clock and no allocation after construction, so that the learner
//! thread, the lab and replay make the same weights. What reaches the loop is complete, finite and was not
//! worse than the live weights on recent motion; weights that turn out worse than their predecessor are
//! rolled back. Parameters persist from stroke to stroke, memory does not. One course per model, the same
//! rules for all.

mod shadow;
mod course;
mod calibration;

pub use calibration::{Calibration, Factor};
pub use course::{CourseCounters, CourseErrors, Rule};
pub use shadow::{Leads, LeadsError, MAX_LEAD, Versus};

use thiserror::Error;

use crate::pen::Motion;

use crate::predict::models::for_each_taught;
use crate::predict::{LearnStep, Models, OnlineWeights, PredictorKind, WeightsError, models};
use course::{AnyCourse, Course};

/// How the learner learns, and when it promotes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LearnerSettings {
    /// Leads over which weights are compared: those that the plan uses, see [`Leads::of_loop`].
    pub leads: Leads,
    /// When live weights may change.
    pub rule: Rule,
    /// Longer displacements enter the memory but are not learned from \[in the plane; an ordinary step has
    /// length 14, that is 10 per axis\].
    pub max_learned: f64,
}

impl LearnerSettings {
    /// The learner of the preset loop with a dead time of `dead_time_ns` and a plan of 10 steps.
    ///
    /// Chosen on train writers of UNIPEN (20 of TOS with hover path, 18 of CED with lift-and-travel) and on
    /// synthetic smooth strokes, all at 10 ms, one fresh learner per writer. Evidence, memory and ratios
    /// matter little within a factor of two. Note: learning the *change* on top of `Persistent` is an
    /// addition to the paper; `Zero` is the paper's start.
    #[must_use]
    pub fn preset(step_ns: u64, dead_time_ns: u64) -> Self {
        Self {
            leads: Leads::of_loop(step_ns, dead_time_ns, 10),
            rule: Rule {
                memory_steps: 300.0,
                min_evidence: 100,
                promote_ratio: 0.95,
                rollback_ratio: 1.1,
                follow_steps: 10,
            },
            max_learned: 60.0,
        }
    }
}

/// A setting that cannot work.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum LearnError {
    /// A model's weights.
    #[error(transparent)]
    Weights(#[from] WeightsError),
    /// A number of the promotion rule.
    #[error("learner setting {name} is {got}, legal are {min} to {max}")]
    Rule {
        /// Name of the number, as in the message.
        name: &'static str,
        /// The refused value, as it was given.
        got: f64,
        /// Smallest value that is legal, itself included.
        min: f64,
        /// Largest value that is legal, itself included.
        max: f64,
    },
}

/// Why a model's live weights change.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PromotionCause {
    /// The candidate did better.
    Improved,
    /// The candidate, which the live weights follow, did no worse.
    Followed,
    /// The live weights did worse than those before them, which come back.
    RolledBack,
}

/// New live weights of one model; the whole set is [`Learner::weights`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Promotion {
    /// Which predictor it is about.
    pub model: PredictorKind,
    /// Their version, never used before.
    pub version: u64,
    /// Why it was decided so.
    pub cause: PromotionCause,
    /// Grid index of the step that decided.
    pub index: u64,
    /// Recent roll-out error of the old weights (mean squared) \[in the plane, per step, squared\].
    pub error_leaving: f64,
    /// Recent roll-out error of the new weights.
    pub error_coming: f64,
}

macro_rules! courses {
    ($($(#[doc = $doc:literal])+ $(#[cfg($when:meta)])? $part:ident: $room:ident::{$model:ident,
        $weights:ident}),+ $(,)?) => {
        /// Models that learn online.
        const MODELS: usize = [$($(#[cfg($when)])? stringify!($part)),+].len();

        /// A course for each of them.
        fn courses(
            models: &Models,
            live: &OnlineWeights,
            rule: Rule,
            leads: Leads,
        ) -> Result<[Box<dyn AnyCourse>; MODELS], WeightsError> {
            Ok([$($(#[cfg($when)])? Box::new(Course::<models::$room::$model>::new(models, live, rule,
                leads)?)),+])
        }
    };
}

for_each_taught!(courses);

/// Result of one step.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Lesson {
    changes: [Option<Promotion>; MODELS],
    /// The set of weights has changed and should be handed to the loop.
    pub hand_over: bool,
}

impl Lesson {
    /// Changes of live weights, at most one per model.
    pub fn promotions(&self) -> impl Iterator<Item = &Promotion> {
        self.changes.iter().flatten()
    }
}

/// What happened so far: `received` = `updates` + `unlearned` + `interruptions` + `refused`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct LearnCounters {
    /// Steps given to `learn`.
    pub received: u64,
    /// Steps that the candidates learned from.
    pub updates: u64,
    /// Stored in memory but too long to learn from.
    pub unlearned: u64,
    /// Starts, jumps and lost steps: the memory was cleared.
    pub interruptions: u64,
    /// Refused because they were not finite.
    pub refused: u64,
    /// Of all models together.
    pub courses: CourseCounters,
}

/// Steps of motion between two hand-overs of error bands without new weights.
const BAND_STEPS: u32 = 10;

/// All models that learn online, the set of live weights, and the bands of every predictor.
#[derive(Debug, Clone)]
pub struct Learner {
    settings: LearnerSettings,
    live: OnlineWeights,
    models: Models,
    courses: [Box<dyn AnyCourse>; MODELS],
    calibration: Calibration,
    newest_index: Option<u64>,
    /// Steps of motion since the last hand-over.
    since: u32,
    counters: LearnCounters,
}

impl Learner {
    /// Starts with the initial weights of the models as candidates and live.
    ///
    /// # Errors
    ///
    /// The first setting outside its bounds.
    pub fn new(settings: LearnerSettings, models: &Models) -> Result<Self, LearnError> {
        Self::from_weights(settings, models, models.initial_weights())
    }

    /// As `new`, from stored weights.
    ///
    /// # Errors
    ///
    /// The first setting outside its bounds, or weights that are invalid or made for another loop.
    pub fn from_weights(
        settings: LearnerSettings,
        models: &Models,
        live: OnlineWeights,
    ) -> Result<Self, LearnError> {
        let LearnerSettings { leads, rule, max_learned } = settings;
        for (name, got, min, max) in [
            ("memory_steps", rule.memory_steps, 10.0, 1e6),
            ("min_evidence", f64::from(rule.min_evidence), 10.0, 1e6),
            ("promote_ratio", rule.promote_ratio, 0.1, 1.0),
            ("rollback_ratio", rule.rollback_ratio, 1.0, 10.0),
            ("follow_steps", f64::from(rule.follow_steps), 1.0, 1e6),
            ("max_learned", max_learned, 10.0, 1e6),
        ] {
            if !(min..=max).contains(&got) {
                return Err(LearnError::Rule { name, got, min, max });
            }
        }
        live.validate()?;
        live.fits(models.settings().step_ns)?;
        Ok(Self {
            settings,
            models: models.clone(),
            courses: courses(models, &live, rule, leads)?,
            calibration: Calibration::new(models, &live)?,
            live,
            newest_index: None,
            since: 0,
            counters: LearnCounters::default(),
        })
    }

    /// Learns from one grid step; live weights change when the evidence asks for it.
    pub fn learn(&mut self, step: &LearnStep) -> Lesson {
        self.counters.received += 1;
        let follows = self.newest_index.is_some_and(|newest| newest.checked_add(1) == Some(step.index));
        self.newest_index = Some(step.index);
        let finite = step.pen.x.iter().all(|x| x.is_finite());
        if !finite || step.motion != Motion::Continues || !follows {
            *(if finite { &mut self.counters.interruptions } else { &mut self.counters.refused }) += 1;
            for course in &mut self.courses {
                course.interrupt();
            }
            self.calibration.interrupt();
            return Lesson::default();
        }
        let [dx, dy] = step.pen.x;
        let learnable = dx.hypot(dy) <= self.settings.max_learned;
        *(if learnable { &mut self.counters.updates } else { &mut self.counters.unlearned }) += 1;
        // All changes of this step go out in one set.
        let (version, live) = (self.live.version + 1, &mut self.live);
        let changes = self.courses.each_mut().map(|course| course.learn(step, learnable, live, version));
        let mut lesson = Lesson { changes, hand_over: false };
        self.calibration.observe(step);
        self.since += 1;
        let changed = lesson.promotions().next().is_some();
        if changed || self.since >= BAND_STEPS {
            self.since = 0;
            self.live.version = version;
            self.live.bands = self.calibration.table();
            // The live weights were checked before they became live: they cannot be refused.
            let _ = self.calibration.set_weights(&self.live);
            lesson.hand_over = true;
        }
        lesson
    }

    /// Replaces the candidates by external weights; they must still earn their promotion.
    ///
    /// # Errors
    ///
    /// Invalid weights or weights that do not fit; all candidates stay.
    pub fn propose(&mut self, weights: &OnlineWeights) -> Result<(), WeightsError> {
        weights.validate()?;
        weights.fits(self.models.settings().step_ns)?;
        // All or nothing.
        for course in &self.courses {
            course.judge(weights)?;
        }
        for course in &mut self.courses {
            course.propose(weights)?;
        }
        Ok(())
    }

    /// The set of weights that the loop should be using.
    #[must_use]
    pub const fn weights(&self) -> &OnlineWeights {
        &self.live
    }

    /// The weights that learn, under the version and with the bands of the live ones.
    #[must_use]
    pub fn candidates(&self) -> OnlineWeights {
        let mut weights = self.live;
        for course in &self.courses {
            course.tell_candidate(&mut weights);
        }
        weights
    }

    /// Recent roll-out errors of a model's weights; zero for what does not learn online.
    #[must_use]
    pub fn errors(&self, model: PredictorKind) -> CourseErrors {
        self.course(model).map_or_else(CourseErrors::default, |course| course.errors())
    }

    /// Statistics of the predictors' error bands.
    #[must_use]
    pub const fn calibration(&self) -> &Calibration {
        &self.calibration
    }

    /// What happened so far.
    #[must_use]
    pub fn counters(&self) -> LearnCounters {
        let courses = PredictorKind::ALL.into_iter().map(|model| self.counters_of(model)).sum();
        LearnCounters { courses, ..self.counters }
    }

    /// What happened to one model's weights; zero for what does not learn online.
    #[must_use]
    pub fn counters_of(&self, model: PredictorKind) -> CourseCounters {
        self.course(model).map_or_else(CourseCounters::default, |course| course.counters())
    }

    fn course(&self, model: PredictorKind) -> Option<&dyn AnyCourse> {
        self.courses.iter().find(|course| course.kind() == model).map(AsRef::as_ref)
    }

    /// The models that it teaches.
    #[must_use]
    pub const fn models(&self) -> &Models {
        &self.models
    }

    /// The settings in force.
    #[must_use]
    pub const fn settings(&self) -> &LearnerSettings {
        &self.settings
    }
}
