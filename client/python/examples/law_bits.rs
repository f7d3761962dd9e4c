//! The Rust side of `tests/test_law.py`: runs what it reads through the Rust calls, and prints every number
//! with all its bits.
//!
//! A line of input is an order, a line of output its answer, both of words; numbers of 64 bits are written as
//! hexadecimal bits. It is a judge: it shares no code with the Python package.

use std::error::Error;
use std::io::{BufRead as _, Write as _};
use std::str::{FromStr, SplitWhitespace};

use foretrace_config::{Config, Draft};
use foretrace_control::arm::{Chain, JointLimits, JointMotion};
use foretrace_control::contact::{EffortReading, EffortUnit};
use foretrace_control::follower::{
    Budget, EnableReading, Follower, JointReading, NoClock, Request, StepInput, StepOutput,
};
use foretrace_control::guard::{Commanded, Guard, StopProfile, consumer_state};
use foretrace_control::ik::{ToolTarget, solve_pose};
use foretrace_control::learn::Learner;
use foretrace_control::pen::{PenOrigin, PenReading};
use foretrace_control::predict::{ExternalPreview, OnlineWeights, PredictorKind};
use foretrace_control::stop::{StopDetail, StopReason};
use foretrace_control::units::Stamp;
use nalgebra::Vector3;

type Answer<T> = Result<T, Box<dyn Error>>;

struct Words<'a>(SplitWhitespace<'a>);

impl Words<'_> {
    fn text(&mut self) -> Answer<String> {
        Ok(self.0.next().ok_or("a word is missing")?.to_owned())
    }

    fn whole<T: FromStr<Err: Error + 'static>>(&mut self) -> Answer<T> {
        Ok(self.text()?.parse()?)
    }

    fn number(&mut self) -> Answer<f64> {
        Ok(f64::from_bits(u64::from_str_radix(&self.text()?, 16)?))
    }

    fn numbers<const J: usize>(&mut self) -> Answer<[f64; J]> {
        let mut numbers = [0.0; J];
        for number in &mut numbers {
            *number = self.number()?;
        }
        Ok(numbers)
    }

    fn flag(&mut self) -> Answer<bool> {
        Ok(self.whole::<u8>()? == 1)
    }
}

#[derive(Default)]
struct Said(String);

impl Said {
    fn bits(&mut self, numbers: impl IntoIterator<Item = f64>) -> &mut Self {
        for number in numbers {
            self.0.push_str(&format!("{:016x} ", number.to_bits()));
        }
        self
    }

    fn word(&mut self, word: impl std::fmt::Display) -> &mut Self {
        self.0.push_str(&format!("{word} "));
        self
    }

    fn maybe(&mut self, number: Option<f64>) -> &mut Self {
        match number {
            Some(number) => self.bits([number]),
            None => self.word("-"),
        }
    }
}

trait JudgedLaw {
    fn tick(&mut self, input: &StepInput<'_, 6>, budget: Budget) -> StepOutput<6>;
}

impl<const N: usize> JudgedLaw for Follower<N, 6> {
    fn tick(&mut self, input: &StepInput<'_, 6>, budget: Budget) -> StepOutput<6> {
        self.step(input, budget, &mut NoClock)
    }
}

struct JudgedLoop {
    law: Box<dyn JudgedLaw>,
    learner: Option<Learner>,
    fresh: Option<OnlineWeights>,
}

fn config(words: &mut Words<'_>) -> Answer<Config> {
    let mut draft = Draft::preset(&words.text()?);
    for _ in 0..words.whole::<usize>()? {
        let change = words.text()?;
        let (key, value) = change.split_once('=').ok_or("no change")?;
        draft = draft.set(key, value);
    }
    Ok(draft.finish()?)
}

fn follower(words: &mut Words<'_>) -> Answer<JudgedLoop> {
    let learn = words.flag()?;
    let config = config(words)?;
    let settings = config.follower_settings();
    let law: Box<dyn JudgedLaw> = match config.settings().mpc.horizon {
        10 => Box::new(Follower::<10, 6>::new(settings)?),
        20 => Box::new(Follower::<20, 6>::new(settings)?),
        _ => Box::new(Follower::<30, 6>::new(settings)?),
    };
    let learner = learn.then(|| Learner::new(config.learner_settings(), config.models())).transpose()?;
    Ok(JudgedLoop { law, learner, fresh: None })
}

fn request(words: &mut Words<'_>) -> Answer<Option<Request>> {
    Ok(match words.text()?.as_str() {
        "none" => None,
        "arm" => Some(Request::Arm),
        "stop" => Some(Request::Stop),
        "disarm" => Some(Request::Disarm),
        "home" => Some(Request::MoveHome),
        "trust" => Some(Request::SetTrust(words.number()?)),
        "auto" => Some(Request::TrustAuto),
        "predictor" => {
            Some(Request::SwitchPredictor(PredictorKind::from_name(&words.text()?).ok_or("no predictor")?))
        }
        other => return Err(other.into()),
    })
}

fn effort(words: &mut Words<'_>, stamp: Stamp) -> Answer<Option<EffortReading<6>>> {
    let unit = match words.text()?.as_str() {
        "none" => return Ok(None),
        "Nm" => EffortUnit::NewtonMetres,
        "A" => EffortUnit::Amperes,
        "share" => EffortUnit::Share,
        other => return Err(other.into()),
    };
    Ok(Some(EffortReading { stamp, effort: words.numbers()?, unit }))
}

fn preview(words: &mut Words<'_>) -> Answer<Option<ExternalPreview>> {
    if !words.flag()? {
        return Ok(None);
    }
    let base_index = words.whole()?;
    let (count, radii_count) = (words.whole()?, words.whole()?);
    let mut preview = ExternalPreview { base_index, count, radii_count, ..ExternalPreview::EMPTY };
    for position in preview.positions.iter_mut().take(count) {
        *position = words.numbers()?;
    }
    for radius in preview.radii.iter_mut().take(radii_count) {
        *radius = words.number()?;
    }
    Ok(Some(preview))
}

fn step(words: &mut Words<'_>, of: &mut JudgedLoop) -> Answer<Said> {
    let now = Stamp(words.whole()?);
    let mut pen = Vec::new();
    for _ in 0..words.whole::<usize>()? {
        let reading = PenReading::new(Stamp(words.whole()?), words.numbers()?, words.flag()?);
        let origin = PenOrigin { sequence: words.whole()?, ..PenOrigin::default() };
        pen.push(PenReading { origin, ..reading });
    }
    let (mut joints, mut efforts) = (None, None);
    if words.flag()? {
        let reading = JointReading {
            stamp: Stamp(words.whole()?),
            q: words.numbers()?,
            qd: words.numbers()?,
            motion_allowed: words.flag()?,
        };
        (joints, efforts) = (Some(reading), effort(words, reading.stamp)?);
    }
    let enable = match words.flag()? {
        true => Some(EnableReading { stamp: Stamp(words.whole()?), stop: words.flag()? }),
        false => None,
    };
    let request = request(words)?;
    let (halt, unsent) = (words.flag()?, words.flag()?);
    let budget = Budget { max_iterations: words.whole()?, shed: words.flag()? };
    let preview = preview(words)?;
    let weights = of.fresh.take();
    let given = StepInput {
        pen: &pen,
        joints: joints.as_ref(),
        effort: efforts.as_ref(),
        enable,
        request,
        halt: halt.then(|| (StopReason::Requested, StopDetail::default())),
        weights: weights.as_ref(),
        preview: preview.as_ref(),
        unsent,
        ..StepInput::nothing(now)
    };
    let output = of.law.tick(&given, budget);
    if let Some(learner) = &mut of.learner {
        for step in output.learn.iter().take(output.learn_count) {
            if learner.learn(step).hand_over {
                of.fresh = Some(*learner.weights());
            }
        }
    }
    Ok(decided(&output))
}

fn decided(output: &StepOutput<6>) -> Said {
    let mut said = Said::default();
    said.word(format!("{:?}/{:?}/{:?}", output.mode, output.rung, output.stop_reason).to_lowercase());
    match &output.command {
        None => said.word("-"),
        Some(command) => said
            .word(command.stamp.0)
            .word(command.valid_until.0)
            .word(u8::from(command.enabled))
            .bits(command.q)
            .bits(command.qd),
    };
    said.word(u8::from(output.begins));
    let answer = output.answer.map_or("-", |answer| if answer.is_ok() { "yes" } else { "no" });
    said.word(answer).word(output.predictor.name()).word(output.weights_version);
    said.bits([output.trust.alpha.alpha(), output.trust.target.alpha(), output.governor]);
    said.bits(output.pen_position).word(u8::from(output.pen_contact)).word(output.pen_counters.accepted);
    said.maybe(output.predictor_error).maybe(output.predictor_band).word(output.dead_time_ns);
    said.maybe(output.lag.map(|lag| lag.lag_s)).maybe(output.arm_speed_share);
    said.bits(output.reference).bits(output.tool);
    said.bits(output.setpoint.iter().flat_map(|axis| [axis.position, axis.velocity, axis.acceleration]));
    said.bits(output.path.points().iter().flatten().map(|number| f64::from(*number)));
    said.bits([output.ik.kkt_residual, output.ik.damping, output.ik.singularity]);
    said.bits(output.axes.map(|axis| axis.kkt_residual)).word(output.learn_count);
    said.word(output.pen_origin.sequence).word(output.preview_steps);
    for step in output.learn.iter().take(output.learn_count) {
        let [dx, dy] = step.pen.x;
        said.word(step.index).word(u8::from(step.pen.touch.contact)).bits(step.position);
        said.bits([dx * step.scale_m, dy * step.scale_m, step.scale_m, step.limit * step.scale_m]);
    }
    if let Some(external) = &output.external {
        said.bits([external.weight, external.evidence]);
        said.word(external.age.map_or(-1, i64::from));
        said.word(external.verdict.map_or(-1, |verdict| verdict.map_or_else(|why| why as i64 + 1, |()| 0)));
    }
    said
}

struct Guarded<const J: usize> {
    guard: Guard<J>,
    stop: StopProfile<J>,
    last: Commanded<J>,
}

impl<const J: usize> Guarded<J> {
    /// All orders up to a line of its own that says `end`.
    fn orders(words: &mut Words<'_>, lines: &mut dyn Iterator<Item = String>) -> Answer<()> {
        let mut limits = {
            let (low, high) = (words.numbers::<J>()?, words.numbers::<J>()?);
            JointLimits::new(std::array::from_fn(|j| [low[j], high[j]]), words.numbers()?, words.numbers()?)?
        };
        if words.flag()? {
            limits = limits.with_jerk(words.numbers()?)?;
        }
        limits = limits.with_stale_braking(words.number()?, words.numbers()?)?;
        let last = Commanded::at_rest(Stamp(0), [0.0; J]).ok_or("not finite")?;
        let mut of = Self { guard: Guard::new(limits), stop: StopProfile::new(limits), last };
        for line in lines {
            let mut words = Words(line.split_whitespace());
            let order = words.text()?;
            let at = match order.as_str() {
                "end" => return Ok(()),
                _ => Stamp(words.whole()?),
            };
            let (mut altered, mut reasons) = (0, 0);
            match order.as_str() {
                "begin" => {
                    let motion =
                        JointMotion { q: words.numbers()?, qd: words.numbers()?, qdd: words.numbers()? };
                    of.last = Commanded::new(at, motion).ok_or("not finite")?;
                }
                "silence" => {
                    let hold_ns = (limits.hold_s() * 1e9).round() as u64;
                    let until = of.last.stamp() + hold_ns;
                    let motion = consumer_state(&of.last, until, limits.deceleration(), at);
                    of.last = Commanded::new(at, motion).ok_or("not finite")?;
                }
                other => {
                    let q = if other == "stop" {
                        let (h, qd) = (at.seconds_since(of.last.stamp()), of.stop.next(&of.last, at));
                        std::array::from_fn(|j| of.last.q()[j] + qd[j] * h)
                    } else {
                        words.numbers()?
                    };
                    let verdict = of.guard.clamp(&of.last, &q, at);
                    (of.last, altered, reasons) = (verdict.command, verdict.altered, verdict.reasons.bits());
                }
            }
            let mut said = Said::default();
            said.word(of.last.stamp().0).word(altered).word(reasons);
            said.bits(*of.last.q()).bits(*of.last.qd()).bits(*of.last.qdd());
            writeln!(std::io::stdout().lock(), "{}", said.0)?;
        }
        Ok(())
    }
}

/// The UR5's, or that of a file with any number of joints.
fn chain<const J: usize>(words: &mut Words<'_>, chain: &Chain<J>) -> Answer<Said> {
    let q: [f64; J] = words.numbers()?;
    let is = chain.forward(&q);
    let mut said = Said::default();
    said.bits(is.position.iter().copied()).bits(is.pose());
    said.bits(is.rotation.transpose().iter().copied()).bits(is.jacobian.transpose().iter().copied());
    let moved = is.tool_motion(&words.numbers()?, &words.numbers()?);
    said.bits(moved.velocity.iter().copied()).bits(moved.acceleration.iter().copied());
    let near: [f64; J] = words.numbers()?;
    let column = |at: usize| -> Vector3<f64> { is.rotation.column(at).into_owned() };
    for spin in [Some(column(0)), None] {
        match solve_pose(chain, &near, &ToolTarget::at_rest(is.position, column(2), spin)) {
            Some(q) => said.bits(q),
            None => said.word("-"),
        };
    }
    Ok(said)
}

fn main() -> Answer<()> {
    let mut lines = std::io::stdin().lock().lines().map_while(Result::ok);
    let mut of: Option<JudgedLoop> = None;
    let ur5 = Config::preset("ur5")?.robot().chain.clone();
    while let Some(line) = lines.next() {
        let mut words = Words(line.split_whitespace());
        let order = words.text()?;
        let said = match order.as_str() {
            "follower" => {
                of = Some(follower(&mut words)?);
                continue;
            }
            "step" => step(&mut words, of.as_mut().ok_or("no follower")?)?,
            "guard" => {
                match words.whole::<usize>()? {
                    2 => Guarded::<2>::orders(&mut words, &mut lines)?,
                    6 => Guarded::<6>::orders(&mut words, &mut lines)?,
                    7 => Guarded::<7>::orders(&mut words, &mut lines)?,
                    _ => return Err("joints".into()),
                }
                continue;
            }
            "ur5" => chain(&mut words, &ur5)?,
            "urdf7" => {
                let text = std::fs::read_to_string(words.text()?)?;
                chain(&mut words, &Chain::<7>::from_urdf(&text, None, None)?)?
            }
            other => return Err(other.into()),
        };
        writeln!(std::io::stdout().lock(), "{}", said.0)?;
    }
    Ok(())
}
