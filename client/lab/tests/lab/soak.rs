//! A long simulated run: the daemon's law and its learner, an arm with a servo, texts of many hands, and
//! faults between them. Every command is checked, the loop recovers from every fault, and the end is as good
//! as the middle.
//!
//! FORETRACE_SOAK_TICKS=N runs at least N ticks of 2 ms instead of 120 000 (four minutes). 10 000 000 are
//! five and a half hours of motion, and take ten minutes:
//! `FORETRACE_SOAK_TICKS=10000000 cargo test --release -p foretrace-lab --test lab soak -- --nocapture`.

use foretrace_config::Config;
use foretrace_control::arm::JointMotion;
use foretrace_control::follower::{
    Budget, Follower, Health, JointReading, Mode, NoClock, Request, Rung, StepInput, StepOutput,
};
use foretrace_control::guard::{CommandChecker, Commanded, consumer_state};
use foretrace_control::learn::Learner;
use foretrace_control::pen::{PenOrigin, PenReading};
use foretrace_control::predict::{OnlineWeights, PredictorKind};
use foretrace_control::stop::{StopCause, StopReason};
use foretrace_control::units::Stamp;
use foretrace_sim::arm::{ArmModel, ArmSettings, JOINTS};
use foretrace_sim::path::{Layout, PathSample, PenPath, Placement};
use foretrace_sim::writer::text_path;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

/// Of the preset.
const HORIZON: usize = 20;
const TICKS: u64 = 120_000;

/// Below this the envelope latches a stop: the workspace's 0.5 mm and the margin's 1 mm \[m\].
const HEIGHT_LIMIT_M: f64 = -0.0015;

/// A fault in the middle of a text.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Trouble {
    Leaps,
    NotANumber,
    SamplesLost,
    TicksLost,
    LongStall,
    ArmSilent,
    Stopped,
    Switched,
    Shed,
    FewIterations,
}

impl Trouble {
    const ALL: [Self; 10] = [
        Self::Leaps,
        Self::NotANumber,
        Self::SamplesLost,
        Self::TicksLost,
        Self::LongStall,
        Self::ArmSilent,
        Self::Stopped,
        Self::Switched,
        Self::Shed,
        Self::FewIterations,
    ];

    /// The stop that it has to end in; `None`: the arm goes on.
    const fn stop(self) -> Option<StopReason> {
        match self {
            Self::LongStall => Some(StopReason::TimeLost),
            Self::ArmSilent => Some(StopReason::JointStateLost),
            Self::Stopped => Some(StopReason::Requested),
            _ => None,
        }
    }
}

/// Squared distances of tool and pen where the pen writes, and how many.
#[derive(Debug, Clone, Copy, Default)]
struct Tracking {
    sum: f64,
    count: u64,
}

impl Tracking {
    fn rms_mm(self) -> f64 {
        (self.sum / self.count.max(1) as f64).sqrt() * 1e3
    }
}

struct Desk {
    follower: Follower<HORIZON, JOINTS>,
    learner: Learner,
    weights: Option<Box<OnlineWeights>>,
    judge: CommandChecker<JOINTS>,
    arm: ArmModel,
    target: [f64; JOINTS],
    /// The newest command, and until when it is valid.
    last: Option<(Commanded<JOINTS>, Stamp)>,
    now: Stamp,
    ticks: u64,
    period_ns: u64,
    random: Pcg64,
    /// Requests that were answered.
    answered: u64,
    /// Where the last command has the tip, over the paper, and the lowest that one had it \[m\].
    low_m: f64,
    lowest_m: f64,
    /// Stops because lost ticks had carried the tip into the paper.
    carried_out: u64,
}

impl Desk {
    fn new() -> Self {
        let config = Config::preset("ur5").unwrap();
        assert_eq!(config.settings().mpc.horizon, HORIZON as u32);
        let settings = config.follower_settings();
        let home = config.robot().home;
        Self {
            learner: Learner::new(config.learner_settings(), config.models()).unwrap(),
            weights: None,
            judge: CommandChecker::new(settings.limits),
            arm: ArmModel::at_rest(ArmSettings::ur5(0.002, 0.03), home),
            target: home,
            last: None,
            now: Stamp(10_000_000_000),
            ticks: 0,
            period_ns: settings.period_ns,
            follower: Follower::new(settings).unwrap(),
            random: Pcg64::seed_from_u64(2026),
            answered: 0,
            low_m: 0.0,
            lowest_m: f64::INFINITY,
            carried_out: 0,
        }
    }

    /// One tick; `trouble` makes the arm silent or the loop short of time.
    fn tick(
        &mut self,
        pen: &[PenReading],
        request: Option<Request>,
        trouble: Option<Trouble>,
    ) -> StepOutput<JOINTS> {
        let joints = self.arm.joints();
        let reading = JointReading { stamp: self.now, q: joints.q, qd: joints.qd, motion_allowed: true };
        let weights = self.weights.take();
        let input = StepInput {
            pen,
            joints: (trouble != Some(Trouble::ArmSilent)).then_some(&reading),
            request,
            weights: weights.as_deref(),
            ..StepInput::nothing(self.now)
        };
        let budget = match trouble {
            Some(Trouble::Shed) => Budget { shed: true, ..Budget::default() },
            Some(Trouble::FewIterations) => Budget { max_iterations: 1, ..Budget::default() },
            _ => Budget::default(),
        };
        let output = self.follower.step(&input, budget, &mut NoClock);
        assert!(!output.health.has(Health::WEIGHTS_REFUSED), "tick {}", self.ticks);
        if output.begins {
            self.judge.restart();
        }
        if let Some(command) = output.command {
            let legal = self.judge.observe(command.stamp, command.valid_until, &command.q, &command.qd);
            assert!(legal, "tick {}: {:?}", self.ticks, self.judge.statistics().violations);
            self.target = command.q;
            let motion = JointMotion { q: command.q, qd: command.qd, qdd: [0.0; JOINTS] };
            self.last = Commanded::new(command.stamp, motion).map(|held| (held, command.valid_until));
            let low_m = output.tool[2];
            // As long as ticks come and no stop is under way, the tip never goes deeper than it may, or was.
            let lost =
                output.health.has(Health::TIME_LOST) || matches!(output.mode, Mode::Stopped | Mode::Fault);
            assert!(
                lost || low_m >= HEIGHT_LIMIT_M.min(self.low_m) - 1e-6,
                "tick {}: {low_m} m over the paper, {} m before",
                self.ticks,
                self.low_m
            );
            self.low_m = low_m;
            self.lowest_m = self.lowest_m.min(low_m);
        }
        for step in output.learn.iter().take(output.learn_count) {
            if self.learner.learn(step).hand_over {
                self.weights = Some(Box::new(*self.learner.weights()));
            }
        }
        self.answered += u64::from(output.answer.is_some());
        self.arm.cycle(self.target);
        self.now = self.now + self.period_ns;
        self.ticks += 1;
        output
    }

    /// Arms, as soon as the arm stands; gives up after ten seconds.
    fn arm_again(&mut self, pen: PathSample) {
        for _ in 0..5000 {
            let reading = self.reading(pen);
            let output = self.tick(&[reading], Some(Request::Arm), None);
            if output.answer == Some(Ok(())) {
                return;
            }
        }
        panic!("tick {}: not to be armed any more", self.ticks);
    }

    fn reading(&self, sample: PathSample) -> PenReading {
        let position = [sample.x_m, sample.y_m];
        PenReading { stamp: self.now, position, contact: sample.contact, origin: PenOrigin::default() }
    }

    /// Writes `path` from rest to its end; in its middle third `trouble`.
    fn write(&mut self, path: &PenPath, trouble: Option<Trouble>) -> Tracking {
        let first = path.samples[0];
        // The arm comes to the pen, which waits, and the loop follows.
        let mut mode = Mode::Idle;
        for _ in 0..1000 {
            mode = self.tick(&[self.reading(PathSample { contact: false, ..first })], None, None).mode;
        }
        assert_eq!(mode, Mode::Following, "tick {}: {trouble:?}", self.ticks);
        let begin = self.now;
        let duration = path.samples[path.samples.len() - 1].t_s - first.t_s;
        let mut samples = path.samples.iter().copied().peekable();
        let (mut newest, mut tracking, mut stopped, mut detail) = (first, Tracking::default(), None, None);
        let mut requested = trouble.and_then(|trouble| match trouble {
            Trouble::Stopped => Some(Request::Stop),
            Trouble::Switched => Some(Request::SwitchPredictor(
                PredictorKind::LIVE[self.ticks as usize % PredictorKind::LIVE.len()],
            )),
            _ => None,
        });
        let mut stall = trouble == Some(Trouble::LongStall);
        while samples.peek().is_some() {
            let t = self.now.seconds_since(begin);
            let active = trouble.filter(|_| (duration / 3.0..duration / 3.0 + 0.6).contains(&t));
            let mut due = Vec::new();
            while let Some(sample) = samples.next_if(|sample| sample.t_s - first.t_s <= t) {
                newest = sample;
                let stamp = begin.plus_ns(((sample.t_s - first.t_s) * 1e9) as u64);
                due.push(PenReading { stamp, ..self.reading(sample) });
            }
            match active {
                Some(Trouble::Leaps) if self.random.random_bool(0.1) => {
                    due.iter_mut()
                        .for_each(|reading| reading.position[0] += self.random.random_range(-0.1..0.1));
                }
                Some(Trouble::NotANumber) => {
                    due.iter_mut().for_each(|reading| reading.position[1] = f64::NAN)
                }
                Some(Trouble::SamplesLost) => due.clear(),
                Some(Trouble::TicksLost) if self.random.random_bool(0.2) => self.lose(40_000_000),
                Some(Trouble::LongStall) if std::mem::take(&mut stall) => {
                    self.pass(400_000_000 / self.period_ns);
                }
                _ => {}
            }
            let request = active.and_then(|_| requested.take());
            let output = self.tick(&due, request, active);
            if let Some(trouble) = active {
                let rung = match trouble {
                    Trouble::Shed => output.rung != Rung::FreshPlan,
                    _ => true,
                };
                assert!(rung, "tick {}: {:?} while shed", self.ticks, output.rung);
            }
            if matches!(output.mode, Mode::Stopped | Mode::Fault) {
                (stopped, detail) = (Some(output.stop_reason), Some(output.stop_detail));
                break;
            }
            if newest.contact && trouble.is_none() {
                let settings = self.follower.settings();
                let tool = settings.chain.forward(&self.arm.joints().q).position;
                let tool = settings.plane.point_from_base(&tool);
                tracking.sum += (tool.x - newest.x_m).powi(2) + (tool.y - newest.y_m).powi(2);
                tracking.count += 1;
            }
        }
        // Consumers go on while a command is valid and then brake, each joint by itself: an arm without
        // commands while it lowers the pen ends in the paper, and that stop is correct.
        let carried_out = trouble == Some(Trouble::TicksLost)
            && stopped == Some(StopReason::Envelope)
            && detail.is_some_and(|detail| detail.cause == StopCause::Height && self.low_m < HEIGHT_LIMIT_M);
        self.carried_out += u64::from(carried_out);
        let expected = trouble.and_then(Trouble::stop);
        assert!(
            carried_out || stopped == expected,
            "tick {}: {trouble:?}: {stopped:?}, not {expected:?}: {detail:?}",
            self.ticks
        );
        if stopped.is_some() {
            self.arm_again(newest);
        }
        if trouble == Some(Trouble::Switched) {
            let mixture = Request::SwitchPredictor(PredictorKind::MIXTURE);
            self.tick(&[self.reading(newest)], Some(mixture), None);
        }
        tracking
    }

    /// Up to `most_ns` pass without a tick.
    fn lose(&mut self, most_ns: u64) {
        let lost = self.random.random_range(0..=most_ns / self.period_ns);
        self.pass(lost);
    }

    /// The arm goes on as its last command says, without a tick.
    fn pass(&mut self, ticks: u64) {
        for _ in 0..ticks {
            if let Some((command, valid_until)) = &self.last {
                let deceleration = self.follower.settings().limits.deceleration();
                let reach = self.now + self.period_ns;
                self.target = consumer_state(command, *valid_until, deceleration, reach).q;
            }
            self.arm.cycle(self.target);
            self.now = self.now + self.period_ns;
        }
    }

    fn text(&mut self) -> PenPath {
        const LETTERS: &[u8] = b"abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789";
        let text: String =
            (0..4).map(|_| char::from(LETTERS[self.random.random_range(0..LETTERS.len())])).collect();
        let placement = Placement { layout: Layout::Line, ..Placement::default() };
        text_path(&text, self.random.random_range(0..1000), 200.0, &placement).unwrap()
    }
}

/// RMS of the median text \[mm\].
fn median_mm(texts: &[Tracking]) -> f64 {
    let mut each: Vec<f64> = texts.iter().map(|text| text.rms_mm()).collect();
    each.sort_by(f64::total_cmp);
    each[each.len() / 2]
}

#[test]
fn writing_and_trouble_leave_nothing_behind() {
    let ticks = std::env::var("FORETRACE_SOAK_TICKS")
        .map_or(TICKS, |text| text.parse().expect("FORETRACE_SOAK_TICKS must be a whole number"));
    let mut desk = Desk::new();
    let first = desk.text().samples[0];
    desk.arm_again(first);
    let mut quiet = Vec::new();
    let mut troubles = 0;
    while desk.ticks < ticks || troubles < Trouble::ALL.len() {
        let path = desk.text();
        quiet.push(desk.write(&path, None));
        let path = desk.text();
        desk.write(&path, Some(Trouble::ALL[troubles % Trouble::ALL.len()]));
        troubles += 1;
    }
    // In the first quarter a new hand is learned.
    let quarters = quiet.chunks(quiet.len().div_ceil(4)).map(median_mm).collect::<Vec<_>>();
    let (middle, end) = (quarters[1], quarters[quarters.len() - 1]);
    let seen = desk.judge.statistics();
    println!(
        "soak: {} ticks ({:.1} h), {} commands, {} violations, {troubles} troubles, {} requests; RMS of the \
         median text in \
         each quarter {quarters:.2?} mm; at most {:.1} rad/s, {:.1} rad/s2",
        desk.ticks,
        desk.ticks as f64 * desk.period_ns as f64 / 3.6e12,
        seen.count,
        seen.limit_violations,
        desk.answered,
        seen.max_velocity_radps,
        seen.max_acceleration_radps2,
    );
    assert_eq!(seen.limit_violations, 0);
    println!(
        "soak: the tip went {:.2} mm into the paper at most; lost ticks carried it out {} times",
        -desk.lowest_m * 1e3,
        desk.carried_out
    );
    // Every tenth trouble is one of lost ticks, twenty losses of up to 40 ms each.
    assert!(desk.carried_out * 20 <= troubles as u64, "{} of {troubles}", desk.carried_out);
    assert!(end < 1.3 * middle, "tracking went from {middle} to {end} mm");
}
