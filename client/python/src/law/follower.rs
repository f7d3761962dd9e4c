//! The follower: the law of a tick, of any horizon, and the learner in step with it.

use std::sync::{Mutex, PoisonError};

use foretrace_config::Config;
use foretrace_control::contact::{EffortReading, EffortUnit};
use foretrace_control::follower::{
    Budget, EnableReading, Follower, FollowerError, JointReading, NoClock, Request, StepInput, StepOutput,
};
use foretrace_control::learn::Learner;
use foretrace_control::pen::{PenOrigin, PenReading};
use foretrace_control::predict::{ExternalPreview, MAX_PREVIEW, OnlineWeights, PredictorKind};
use foretrace_control::stop::{StopDetail, StopReason};
use foretrace_control::units::Stamp;
use foretraced::wire::JOINTS;
use pyo3::prelude::*;

use super::chain::ChainOf;
use super::guard::LimitsOf;
use super::numbers::per_joint;
use super::step::LawStep;
use crate::files::settings::NamedSettings;
use crate::files::work::apart;
use crate::problem::{invalid, problem};

/// Bytes of pen samples of one tick at most: a tick of a daemon gets far fewer.
const MOST_PEN_SAMPLES: usize = 4096;

trait AnyHorizon: Send {
    fn tick(&mut self, input: &StepInput<'_, JOINTS>, budget: Budget) -> Box<StepOutput<JOINTS>>;
}

impl<const N: usize> AnyHorizon for Follower<N, JOINTS> {
    fn tick(&mut self, input: &StepInput<'_, JOINTS>, budget: Budget) -> Box<StepOutput<JOINTS>> {
        Box::new(self.step(input, budget, &mut NoClock))
    }
}

fn law(config: &Config) -> Result<Box<dyn AnyHorizon>, FollowerError> {
    let settings = config.follower_settings();
    Ok(match config.settings().mpc.horizon {
        10 => Box::new(Follower::<10, JOINTS>::new(settings)?),
        20 => Box::new(Follower::<20, JOINTS>::new(settings)?),
        _ => Box::new(Follower::<30, JOINTS>::new(settings)?),
    })
}

/// The law and the learner in step with it.
struct LawLoop {
    law: Box<dyn AnyHorizon>,
    learner: Option<Box<Learner>>,
    /// Promoted in the last tick, for the next one.
    fresh: Option<Box<OnlineWeights>>,
}

/// The follower of one arm.
#[pyclass(frozen, module = "foretrace._native")]
struct LawFollower {
    inner: Mutex<LawLoop>,
    config: Config,
}

/// Stamp [ns], x and y [m], contact; perhaps its number in its sender's sequence.
#[derive(FromPyObject)]
enum PenIn {
    Numbered(u64, f64, f64, bool, u64),
    Plain(u64, f64, f64, bool),
}

impl PenIn {
    fn reading(self) -> PenReading {
        let (stamp, x, y, contact, sequence) = match self {
            Self::Numbered(stamp, x, y, contact, sequence) => (stamp, x, y, contact, sequence),
            Self::Plain(stamp, x, y, contact) => (stamp, x, y, contact, 0),
        };
        let origin = PenOrigin { sequence, ..PenOrigin::default() };
        PenReading { stamp: Stamp(stamp), position: [x, y], contact, origin }
    }
}

/// A word, or a word with a value.
#[derive(FromPyObject)]
enum RequestIn {
    Word(String),
    Number(String, f64),
    Named(String, String),
}

const REQUESTS: &str = "'arm', 'disarm', 'stop', 'move home', ('trust', 0 to 1, 'auto' or 'freeze'), \
                        ('predictor', NAME)";

impl RequestIn {
    fn request(self) -> PyResult<Request> {
        let unknown = |shown: String| Err(invalid(format_args!("request is {shown}; legal: {REQUESTS}")));
        Ok(match self {
            Self::Word(word) => match word.as_str() {
                "arm" => Request::Arm,
                "disarm" => Request::Disarm,
                "stop" => Request::Stop,
                "move home" => Request::MoveHome,
                _ => return unknown(format!("{word:?}")),
            },
            Self::Number(word, value) if word == "trust" => Request::SetTrust(value),
            Self::Number(word, value) => return unknown(format!("({word:?}, {value})")),
            Self::Named(word, value) => match (word.as_str(), value.as_str()) {
                ("trust", "auto") => Request::TrustAuto,
                ("trust", "freeze") => Request::FreezeTrust,
                ("predictor", name) => match PredictorKind::from_name(name) {
                    Some(kind) => Request::SwitchPredictor(kind),
                    None => {
                        let (hint, known) =
                            (PredictorKind::renamed(name), PredictorKind::LIVE_NAMES.join(", "));
                        let what = format_args!("no predictor is called {name}{hint}; there are {known}");
                        return Err(invalid(what));
                    }
                },
                _ => return unknown(format!("({word:?}, {value:?})")),
            },
        })
    }
}

#[derive(FromPyObject)]
struct JointsIn {
    #[pyo3(item)]
    stamp_ns: u64,
    #[pyo3(item)]
    q: Vec<f64>,
    #[pyo3(item)]
    qd: Vec<f64>,
    #[pyo3(item)]
    motion_allowed: bool,
    #[pyo3(item)]
    effort: Option<Vec<f64>>,
    #[pyo3(item)]
    effort_unit: String,
}

impl JointsIn {
    fn readings(self) -> PyResult<(JointReading<JOINTS>, Option<EffortReading<JOINTS>>)> {
        let stamp = Stamp(self.stamp_ns);
        let (q, qd) = (per_joint("joints.q", &self.q)?, per_joint("joints.qd", &self.qd)?);
        let reading = JointReading { stamp, q, qd, motion_allowed: self.motion_allowed };
        let Some(effort) = self.effort else { return Ok((reading, None)) };
        let unit = match self.effort_unit.as_str() {
            "Nm" => EffortUnit::NewtonMetres,
            "A" => EffortUnit::Amperes,
            "share" => EffortUnit::Share,
            other => {
                return Err(invalid(format_args!(
                    "joints.effort_unit is {other:?}; legal: \"Nm\", \"A\", \"share\""
                )));
            }
        };
        Ok((reading, Some(EffortReading { stamp, effort: per_joint("joints.effort", &effort)?, unit })))
    }
}

#[derive(FromPyObject)]
struct InputIn {
    #[pyo3(item)]
    pen: Vec<PenIn>,
    #[pyo3(item)]
    joints: Option<JointsIn>,
    #[pyo3(item)]
    request: Option<RequestIn>,
    #[pyo3(item)]
    enable: Option<(u64, bool)>,
    #[pyo3(item)]
    halt: bool,
    #[pyo3(item)]
    unsent: bool,
    #[pyo3(item)]
    max_iterations: u32,
    #[pyo3(item)]
    shed: bool,
    /// Of another predictor: index of the step after which it predicts, positions, radii of them or none.
    #[pyo3(item)]
    preview: Option<(u64, Vec<[f64; 2]>, Vec<f64>)>,
}

/// What another predictor says; its numbers are the law's to judge.
fn preview_of(
    (base_index, positions, radii): (u64, Vec<[f64; 2]>, Vec<f64>),
) -> PyResult<Box<ExternalPreview>> {
    for (name, count) in [("positions", positions.len()), ("radii", radii.len())] {
        if count > MAX_PREVIEW {
            let what = format_args!("a preview of {count} {name}; legal: at most {MAX_PREVIEW}");
            return Err(invalid(what));
        }
    }
    let (count, radii_count) = (positions.len(), radii.len());
    let mut preview = Box::new(ExternalPreview { base_index, count, radii_count, ..ExternalPreview::EMPTY });
    preview.positions.iter_mut().zip(positions).for_each(|(slot, position)| *slot = position);
    preview.radii.iter_mut().zip(radii).for_each(|(slot, radius)| *slot = radius);
    Ok(preview)
}

#[pymethods]
impl LawFollower {
    #[new]
    fn new(python: Python<'_>, settings: NamedSettings, learn: bool) -> PyResult<Self> {
        let (config, inner) = apart(python, move |_| {
            let config = settings.load()?;
            let law = law(&config).map_err(problem)?;
            let learner = (learn && config.settings().learner.enabled)
                .then(|| Learner::new(config.learner_settings(), config.models()).map(Box::new))
                .transpose();
            let learner = learner.map_err(problem)?;
            PyResult::Ok((config, LawLoop { law, learner, fresh: None }))
        })??;
        Ok(Self { inner: Mutex::new(inner), config })
    }

    fn step(&self, now_ns: u64, input: InputIn) -> PyResult<LawStep> {
        if input.pen.len() > MOST_PEN_SAMPLES {
            let count = input.pen.len();
            let what = format_args!("{count} pen samples in one tick; legal: at most {MOST_PEN_SAMPLES}");
            return Err(invalid(what));
        }
        let pen: Vec<PenReading> = input.pen.into_iter().map(PenIn::reading).collect();
        let joints = input.joints.map(JointsIn::readings).transpose()?;
        let request = input.request.map(RequestIn::request).transpose()?;
        let preview = input.preview.map(preview_of).transpose()?;
        let mut inner = self.inner.lock().unwrap_or_else(PoisonError::into_inner);
        let weights = inner.fresh.take();
        let given = StepInput {
            now: Stamp(now_ns),
            pen: &pen,
            joints: joints.as_ref().map(|(joints, _)| joints),
            effort: joints.as_ref().and_then(|(_, effort)| effort.as_ref()),
            enable: input.enable.map(|(stamp, stop)| EnableReading { stamp: Stamp(stamp), stop }),
            request,
            halt: input.halt.then(|| (StopReason::Requested, StopDetail::default())),
            weights: weights.as_deref(),
            preview: preview.as_deref(),
            unsent: input.unsent,
        };
        let budget = Budget { max_iterations: input.max_iterations, shed: input.shed };
        let output = inner.law.tick(&given, budget);
        let LawLoop { learner, fresh, .. } = &mut *inner;
        if let Some(learner) = learner {
            for step in output.learn.iter().take(output.learn_count) {
                if learner.learn(step).hand_over {
                    *fresh = Some(Box::new(*learner.weights()));
                }
            }
        }
        Ok(LawStep { output, step_ns: self.config.settings().step_ns() })
    }

    #[getter]
    fn period_ns(&self) -> u64 {
        self.config.settings().period_ns()
    }

    #[getter]
    fn grid_ns(&self) -> u64 {
        self.config.settings().step_ns()
    }

    #[getter]
    fn horizon(&self) -> u32 {
        self.config.settings().mpc.horizon
    }

    #[getter]
    fn home(&self) -> [f64; JOINTS] {
        self.config.robot().home
    }

    #[getter]
    fn learns(&self) -> bool {
        self.inner.lock().unwrap_or_else(PoisonError::into_inner).learner.is_some()
    }

    #[getter]
    fn settings_name(&self) -> &str {
        self.config.name()
    }

    #[getter]
    fn remarks(&self) -> Vec<String> {
        self.config.remarks()
    }

    #[getter]
    fn predictors(&self) -> Vec<&'static str> {
        PredictorKind::LIVE_NAMES.to_vec()
    }

    #[getter]
    fn limits(&self) -> LimitsOf {
        LimitsOf::of(&self.config.robot().limits)
    }

    #[getter]
    fn chain(&self) -> ChainOf {
        ChainOf::of(self.config.robot().chain.clone())
    }

    /// A point of the pen device [m] in the plane's frame [m].
    fn plane_from_pen(&self, x_m: f64, y_m: f64) -> [f64; 2] {
        self.config.follower_settings().plane.from_pen([x_m, y_m])
    }

    /// A point of the plane's frame in the base's [m], and back.
    fn base_from_plane(&self, point: [f64; 3]) -> [f64; 3] {
        self.config.follower_settings().plane.point_to_base(&point.into()).into()
    }

    fn plane_from_base(&self, point: [f64; 3]) -> [f64; 3] {
        self.config.follower_settings().plane.point_from_base(&point.into()).into()
    }
}

pub fn add(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<LawFollower>()
}
