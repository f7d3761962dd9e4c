//! The corpus: texts of the built-in writer, hostile inputs, arming and stops, switches, jumps and losses,
//! every predictor, both presets.
//!
//! The learner runs in step with the law, so that a scene is a pure function of its name.

use foretrace_config::{Config, JOINTS};
use foretrace_control::follower::{
    Budget, EnableReading, Follower, FollowerSettings, JointReading, NoClock, Request, StepInput,
};
use foretrace_control::learn::Learner;
use foretrace_control::pen::PenReading;
use foretrace_control::predict::{OnlineWeights, PredictorKind};
use foretrace_control::stop::{StopCause, StopDetail, StopReason};
use foretrace_control::units::Stamp;
use foretrace_sim::arm::{ArmModel, ArmSettings};
use foretrace_sim::path::{Anchor, Layout, Lift, PathSample, Placement};
use foretrace_sim::writer::text_path;
use rand::{Rng, RngExt, SeedableRng};
use rand_pcg::Pcg64;

use crate::fields::append;
use crate::file::Scene;

const PRESETS: [&str; 2] = ["ur5", "ur5e"];
const TEXTS: [&str; 14] =
    ["oo", "ABC", "XYZ", "8801", "S5S5", "MW", "QR", "abc", "hello", "zigzag", "lll", "0123", "eel", "KVN"];
const HORIZON: usize = 20;
const TICKS: u64 = 1200;
const HOSTILE_LIVES: u64 = 16;
const START: Stamp = Stamp(10_000_000_000);

/// Events of a run, beside its pen.
#[derive(Clone, Copy, PartialEq)]
enum Events {
    None,
    /// Requests of every kind, one after the other.
    Operator,
    /// Corrupts every input, with this seed.
    Hostile(u64),
    /// The dead-man switch is let go, then joint states fail, then ticks get lost.
    Losses,
    /// The pen jumps, several times.
    Leaps,
    /// The pen oscillates with a period shorter than the plan's horizon.
    Tremor,
    /// The learner hands over non-finite weights.
    BadWeights,
    /// The machine stands still for longer than the latch time.
    TimeLost,
    /// The shell demands a stop because of late ticks.
    Overruns,
    /// The arm stands still from here on, whatever its commands are.
    ArmStuck,
    /// The solver has no time for a while.
    Starved,
}

struct Life {
    name: String,
    preset: &'static str,
    kind: PredictorKind,
    text: &'static str,
    events: Events,
    settings: &'static [(&'static str, &'static str)],
}

/// Every scene, run.
pub(crate) fn all() -> Result<Vec<Scene>, String> {
    lives().iter().map(run).collect()
}

fn lives() -> Vec<Life> {
    let mut lives = Vec::new();
    let mut add = |preset, kind: PredictorKind, text, events, settings, what: &str| {
        let name = format!("{what} {text} {preset} predictor {}", kind.index());
        lives.push(Life { name, preset, kind, text, events, settings });
    };
    let mixture = PredictorKind::default();
    for preset in PRESETS {
        for text in TEXTS {
            add(preset, mixture, text, Events::None, &[], "text");
        }
        for kind in PredictorKind::BUILT_IN {
            add(preset, kind, "S5S5", Events::None, &[], "predictor");
            add(preset, kind, "MW", Events::Operator, &[], "operator");
        }
        let dead_man: &[_] = &[("safety.enable_required", "true")];
        add(preset, mixture, "ABC", Events::Losses, dead_man, "losses");
        add(preset, mixture, "8801", Events::Losses, &[], "losses");
        add(preset, mixture, "abc", Events::None, &[("mpc.backend", "\"clarabel\"")], "clarabel");
        add(
            preset,
            mixture,
            "QR",
            Events::None,
            &[("mpc.horizon", "20"), ("timing.dead_time_ms", "30")],
            "dead time",
        );
        for (events, what) in [
            (Events::Leaps, "leaps"),
            (Events::Tremor, "tremor"),
            (Events::BadWeights, "bad weights"),
            (Events::TimeLost, "time lost"),
            (Events::Overruns, "overruns"),
            (Events::ArmStuck, "arm stuck"),
            (Events::Starved, "starved"),
        ] {
            add(preset, mixture, "MW", events, &[], what);
        }
        for kind in PredictorKind::BUILT_IN {
            add(preset, kind, "8801", Events::Tremor, &[], "tremor");
        }
        for seed in 0..HOSTILE_LIVES {
            let kind = PredictorKind::BUILT_IN[seed as usize % PredictorKind::BUILT_IN.len()];
            add(preset, kind, "8801", Events::Hostile(seed), &[], &format!("hostile {seed}"));
        }
    }
    lives
}

fn run(life: &Life) -> Result<Scene, String> {
    let mut source = foretrace_config::Draft::preset(life.preset);
    for (key, value) in life.settings {
        source = source.set(key, value);
    }
    let config = source.finish().map_err(|error| format!("{}: {error}", life.name))?;
    let mut values = Vec::new();
    World::new(life, &config)?.live(&mut values);
    Ok(Scene { name: life.name.clone(), values })
}

struct World<'a> {
    life: &'a Life,
    follower: Follower<HORIZON, JOINTS>,
    learner: Learner,
    arm: ArmModel,
    path: Vec<PathSample>,
    period_ns: u64,
    rng: Pcg64,
    /// Weights on their way to the law.
    promoted: Option<OnlineWeights>,
}

impl<'a> World<'a> {
    fn new(life: &'a Life, config: &Config) -> Result<Self, String> {
        let wrong = |error: &dyn std::fmt::Display| format!("{}: {error}", life.name);
        let mut settings: FollowerSettings<JOINTS> = config.follower_settings();
        settings.preview.kind = life.kind;
        settings.plane.pen_scale = 1.0;
        settings.plane.pen_origin = [0.0; 2];
        let period_ns = settings.period_ns;
        let [x, y, _] = config.settings().plane.workspace_m;
        let placement = Placement {
            centre_m: [0.5 * (x[0] + x[1]), 0.5 * (y[0] + y[1])],
            size_m: [x[1] - x[0], y[1] - y[0]],
            glyph_height_m: 0.03,
            layout: Layout::Line,
            anchor: Anchor::Baseline,
            lift: Lift::Travel,
        };
        let path = text_path(life.text, 7, 200.0, &placement).map_err(|error| wrong(&error))?;
        let models = settings.models.clone();
        let learner = Learner::new(config.learner_settings(), &models).map_err(|error| wrong(&error))?;
        let arm = ArmSettings::ur5(period_ns as f64 * 1e-9, 0.03);
        Ok(Self {
            life,
            follower: Follower::new(settings).map_err(|error| wrong(&error))?,
            learner,
            arm: ArmModel::at_rest(arm, config.robot().home),
            path: path.samples,
            period_ns,
            rng: Pcg64::seed_from_u64(match life.events {
                Events::Hostile(seed) => seed,
                _ => 0,
            }),
            promoted: None,
        })
    }

    fn live(mut self, values: &mut Vec<u64>) {
        let mut target = self.arm.joints().q;
        let mut now = START;
        let mut next_sample = 0;
        for tick in 0..TICKS {
            now = now + self.period_ns * self.lost(tick);
            let due = now.seconds_since(START) - 0.2;
            let first = self.path.first().map_or(0.0, |sample| sample.t_s);
            let mut pen = Vec::new();
            while let Some(sample) = self.path.get(next_sample).filter(|sample| sample.t_s - first <= due) {
                let stamp = START + ((sample.t_s - first + 0.2) * 1e9) as u64;
                pen.push(PenReading::new(stamp, [sample.x_m, sample.y_m], sample.contact));
                next_sample += 1;
            }
            let joints = self.arm.joints();
            let mut joints = JointReading { stamp: now, q: joints.q, qd: joints.qd, motion_allowed: true };
            match self.life.events {
                Events::Hostile(_) => self.poison(now, &mut pen, &mut joints),
                Events::Leaps | Events::Tremor => self.displace(tick, &mut pen),
                _ => {}
            }
            let (mut weights, budget) = (self.promoted.take(), self.budget(tick));
            if self.life.events == Events::BadWeights && tick % 300 == 299 {
                let mut bad = *self.learner.weights();
                bad.version += 1_000_000 + tick;
                bad.ar_rls.version = bad.version;
                bad.ar_rls.coefficients[0][0][0] = f64::NAN;
                weights = Some(bad);
            }
            let input = StepInput {
                pen: &pen,
                joints: self.joints_arrive(tick).then_some(&joints),
                enable: self.enable(tick, now),
                request: self.request(tick),
                halt: self.halt(tick),
                weights: weights.as_ref(),
                ..StepInput::nothing(now)
            };
            let output = self.follower.step(&input, budget, &mut NoClock);
            // What the learner promotes reaches the law with the next tick.
            for step in output.learn.iter().take(output.learn_count) {
                if self.learner.learn(step).hand_over {
                    self.promoted = Some(*self.learner.weights());
                }
            }
            let stuck = self.life.events == Events::ArmStuck && tick >= 400;
            if let Some(command) = output.command.filter(|_| !stuck) {
                target = command.q;
            }
            self.arm.cycle(target);
            append(&output, values);
            now = now + self.period_ns;
        }
    }

    fn lost(&self, tick: u64) -> u64 {
        match self.life.events {
            Events::Losses if tick == 700 => 4,
            Events::TimeLost if tick == 500 => 200,
            _ => 0,
        }
    }

    fn joints_arrive(&mut self, tick: u64) -> bool {
        match self.life.events {
            Events::Losses => !(500..520).contains(&tick) && !(800..900).contains(&tick),
            Events::Hostile(_) => self.rng.random_bool(0.97),
            _ => true,
        }
    }

    fn enable(&mut self, tick: u64, now: Stamp) -> Option<EnableReading> {
        match self.life.events {
            Events::Losses if tick == 300 => Some(EnableReading { stamp: now, stop: true }),
            Events::Losses => Some(EnableReading { stamp: now, stop: false }),
            Events::Hostile(_) => self
                .rng
                .random_bool(0.5)
                .then(|| EnableReading { stamp: now, stop: self.rng.random_bool(0.002) }),
            _ => None,
        }
    }

    fn budget(&mut self, tick: u64) -> Budget {
        match self.life.events {
            Events::Starved if (400..520).contains(&tick) => Budget { shed: true, ..Budget::default() },
            Events::Losses if tick % 97 < 3 => Budget { shed: true, ..Budget::default() },
            Events::Hostile(_) if self.rng.random_bool(0.02) => {
                Budget { max_iterations: self.rng.random_range(0..4), shed: false }
            }
            _ => Budget::default(),
        }
    }

    fn request(&mut self, tick: u64) -> Option<Request> {
        match self.life.events {
            _ if tick == 10 => Some(Request::Arm),
            Events::Losses => (tick % 150 == 149).then_some(Request::Arm),
            Events::Operator => match tick {
                200 => Some(Request::SetTrust(0.5)),
                300 => Some(Request::SwitchPredictor(PredictorKind::ALL[1])),
                350 => Some(Request::FreezeTrust),
                400 => Some(Request::SwitchPredictor(self.life.kind)),
                450 => Some(Request::TrustAuto),
                550 => Some(Request::SetTrust(f64::NAN)),
                600 => Some(Request::Stop),
                700 => Some(Request::MoveHome),
                1000 => Some(Request::Disarm),
                1050 => Some(Request::Arm),
                _ => None,
            },
            Events::Hostile(_) if self.rng.random_bool(0.01) => Some(self.any_request()),
            _ => None,
        }
    }

    fn halt(&self, tick: u64) -> Option<(StopReason, StopDetail)> {
        let detail = StopDetail {
            cause: StopCause::LateTicks,
            joint: None,
            amount: 0.3,
            limit: 0.2,
            ..StopDetail::default()
        };
        (self.life.events == Events::Overruns && tick == 500).then_some((StopReason::Overruns, detail))
    }

    /// Moves the pen by 30 mm for 0.2 s every half a second, or to and fro by 4 mm, 20 times a second, with
    /// noise of 0.2 mm.
    fn displace(&mut self, tick: u64, pen: &mut [PenReading]) {
        let leapt = f64::from(u8::from(tick % 250 >= 150));
        for reading in pen {
            let turn = (reading.stamp.seconds_since(START) * 20.0).fract();
            reading.position[0] += match self.life.events {
                Events::Leaps => 0.03 * leapt,
                _ => 4e-3 * (4.0 * (turn - 0.5).abs() - 1.0) + self.rng.random_range(-2e-4..2e-4),
            };
        }
    }

    fn any_request(&mut self) -> Request {
        match self.rng.random_range(0..10) {
            0 => Request::Stop,
            1 => Request::Disarm,
            2 => Request::SetTrust(self.rng.random()),
            3 => Request::TrustAuto,
            4 => Request::FreezeTrust,
            5 => Request::SwitchPredictor(
                PredictorKind::ALL[self.rng.random_range(0..PredictorKind::ALL.len())],
            ),
            6 => Request::MoveHome,
            _ => Request::Arm,
        }
    }

    fn poison(&mut self, now: Stamp, pen: &mut Vec<PenReading>, joints: &mut JointReading<JOINTS>) {
        let rng = &mut self.rng;
        let poison = [f64::NAN, f64::INFINITY, 1e300, -0.4, 0.0, 1e-310];
        let value = poison[rng.random_range(0..poison.len())];
        for reading in pen.iter_mut() {
            if rng.random_bool(0.05) {
                match rng.random_range(0..5) {
                    0 => reading.position[0] = value,
                    1 => reading.position = [rng.random_range(-0.5..0.5), rng.random_range(-0.5..0.5)],
                    2 => reading.stamp = Stamp(rng.next_u64()),
                    3 => reading.stamp = Stamp(now.0 - rng.random_range(0..1_000_000_000)),
                    _ => reading.contact = !reading.contact,
                }
            }
        }
        if rng.random_bool(0.01) {
            pen.extend((0..64).map(|_| PenReading::new(now, [value; 2], true)));
        }
        if rng.random_bool(0.003) {
            match rng.random_range(0..4) {
                0 => joints.q[rng.random_range(0..JOINTS)] = value,
                1 => joints.stamp = Stamp(rng.next_u64()),
                2 => joints.q[rng.random_range(0..JOINTS)] += 0.02,
                _ => joints.motion_allowed = false,
            }
        }
    }
}
