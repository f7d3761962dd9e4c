//! The bridge and the simulated controller in lockstep, without sockets and without a clock: what the arm
//! does when things go wrong, seen by somebody who only watches its joints.

use std::collections::VecDeque;
use std::sync::LazyLock;

use foretrace_client::wire::command_flags;
use foretrace_client::{JOINTS, JointCommand, Mode, RobotMode, SafetyMode};
use foretrace_config::Config;

use foretrace_ur::bridge::pilot::{CycleResult, Package, Pilot};
use foretrace_ur::bridge::program::BridgeProgram;
use foretrace_ur::bridge::reaction::Phase;
use foretrace_ur::bridge::reason::HaltReason;
use foretrace_ur::bridge::registers::{ProgramAnswer, RegisterInputs, RegisterMap};
use foretrace_ur::rtde::RtdeValue;
use foretrace_ur_sim::options::{ControllerOptions, Series, usual_version};
use foretrace_ur_sim::outputs::OutputSource;
use foretrace_ur_sim::world::World;

const START_NS: u64 = 500_000_000_000;
const OWNER: u64 = 1;

/// Both ends, the line between them, and a daemon that swings joint 5.
pub(super) struct Scene {
    series: Series,
    config: &'static Config,
    pub(super) world: World,
    pub(super) pilot: Option<Pilot>,
    program: BridgeProgram,
    /// Inputs on their way, with the cycle before which they arrive.
    under_way: VecDeque<(u64, RegisterInputs)>,
    cycle: u64,
    /// Neither states nor inputs come through.
    pub(super) cut: bool,
    pub(super) commanding: bool,
    begins: bool,
    /// Where joint 5 is told to be in the middle, and since when it swings \[s\].
    pub(super) middle: [f64; JOINTS],
    since_s: f64,
    pub(super) swing_rad: f64,
    pub(super) swing_hz: f64,
    /// With an acceleration of this size that changes its sign at once, instead of a sine \[rad/s²\].
    pub(super) sharp_radps2: Option<f64>,
    newest: Option<CycleResult>,
    pub(super) watched: Watched,
}

/// What somebody sees who watches the joints.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Watched {
    pub(super) q: Option<[f64; JOINTS]>,
    qd: [f64; JOINTS],
    most_speed: f64,
    most_acceleration: f64,
}

impl Watched {
    fn see(&mut self, q: [f64; JOINTS], dt: f64) {
        let Some(before) = self.q.replace(q) else { return };
        for ((q, before), qd) in q.iter().zip(before).zip(&mut self.qd) {
            let speed = (q - before) / dt;
            self.most_acceleration = self.most_acceleration.max((speed - *qd).abs() / dt);
            self.most_speed = self.most_speed.max(speed.abs());
            *qd = speed;
        }
    }

    pub(super) fn rests(&self) -> bool {
        self.qd.iter().all(|qd| qd.abs() < 1e-3)
    }
}

pub(super) fn config(series: Series) -> &'static Config {
    // Commands are used a cycle after they are sent: valid for three cycles of the slower controller.
    const MADE: fn(&str) -> Config = |preset| {
        let text = format!("preset = \"{preset}\"\n[loop]\nvalid_periods = 12\n");
        Config::parse(&text, "t.toml", ".").unwrap()
    };
    static CB3: LazyLock<Config> = LazyLock::new(|| MADE("ur5"));
    static E: LazyLock<Config> = LazyLock::new(|| MADE("ur5e"));
    match series {
        Series::Cb3 => &CB3,
        Series::E => &E,
    }
}

impl Scene {
    pub(super) fn new(series: Series) -> Self {
        Self::with(series, config(series))
    }

    /// With other settings than the presets'.
    pub(super) fn with(series: Series, config: &'static Config) -> Self {
        let registers = RegisterMap::at(24).unwrap();
        let program = BridgeProgram::new(
            &config.settings().robot.ur,
            &config.robot().limits,
            registers,
            series.cycle_s(),
        );
        let mut world = World::new(ControllerOptions::new(series));
        // Booted a while ago.
        (0..100).for_each(|_| world.cycle());
        let mut scene = Self {
            series,
            config,
            world,
            pilot: None,
            program,
            under_way: VecDeque::new(),
            cycle: 0,
            cut: false,
            commanding: false,
            begins: false,
            middle: ControllerOptions::new(series).q,
            since_s: 0.0,
            swing_rad: 0.2,
            swing_hz: 0.5,
            sharp_radps2: None,
            newest: None,
            watched: Watched::default(),
        };
        scene.start_bridge(4711 << 24);
        scene
    }

    pub(super) fn start_bridge(&mut self, seed: u64) {
        let limits = self.config.robot().limits;
        let watchdog_s = 1.0 / self.program.watchdog_hz;
        let mut pilot = Pilot::new(limits, self.series.cycle_s(), watchdog_s, None, seed);
        pilot.connected();
        pilot.settings_agree(Some(true));
        self.pilot = Some(pilot);
    }

    pub(super) fn now_s(&self) -> f64 {
        self.cycle as f64 * self.series.cycle_s()
    }

    fn now_ns(&self) -> u64 {
        START_NS + (self.now_s() * 1e9) as u64
    }

    /// Joint 5 at `t_s`: at rest until it swings, and smooth in the beginning.
    pub(super) fn wanted(&self, t_s: f64) -> (f64, f64) {
        let t = t_s - self.since_s;
        if t <= 0.0 {
            return (0.0, 0.0);
        }
        if let Some(a) = self.sharp_radps2 {
            let (quarter, t) = (0.25 / self.swing_hz, t % (1.0 / self.swing_hz));
            let from = |t: f64, speed: f64, a: f64| (speed * t + 0.5 * a * t * t, speed + a * t);
            let (fastest, turned) = (a * quarter, 0.5 * a * quarter * quarter);
            return if t < quarter {
                from(t, 0.0, a)
            } else if t < 3.0 * quarter {
                let (way, speed) = from(t - quarter, fastest, -a);
                (turned + way, speed)
            } else {
                let (way, speed) = from(t - 3.0 * quarter, -fastest, a);
                (turned + way, speed)
            };
        }
        let (w, a) = (2.0 * std::f64::consts::PI * self.swing_hz, self.swing_rad);
        (a * (1.0 - (w * t).cos()), a * w * (w * t).sin())
    }

    fn daemon(&mut self) {
        // It stops by itself where the arm may not move, as the real one does.
        if let Some(outcome) = &self.newest {
            let state = &outcome.state;
            let allowed = state.robot_mode == u32::from(RobotMode::Running)
                && [SafetyMode::Normal, SafetyMode::Reduced]
                    .iter()
                    .any(|m| u32::from(*m) == state.safety_mode);
            self.commanding &= allowed;
        }
        if !self.commanding {
            return;
        }
        let stamp_ns = self.now_ns() + 2_000_000;
        let (off, speed) = self.wanted((stamp_ns - START_NS) as f64 * 1e-9);
        let (mut q, mut qd) = (self.middle, [0.0; JOINTS]);
        q[5] += off;
        qd[5] = speed;
        let begins = if std::mem::take(&mut self.begins) { command_flags::BEGINS } else { 0 };
        let mut command = JointCommand {
            valid_until_ns: stamp_ns
                + u64::from(self.config.settings().control_loop.valid_periods) * 2_000_000,
            q,
            qd,
            mode: Mode::Following.into(),
            flags: command_flags::ENABLED | begins,
            ..JointCommand::default()
        };
        command.header.stamp_ns = stamp_ns;
        let now_ns = self.now_ns();
        if let Some(pilot) = &mut self.pilot {
            pilot.take(&command, now_ns);
        }
    }

    fn package(&self) -> Package {
        let version = usual_version(self.series);
        let read = |name: &str| {
            OutputSource::of(name, (version.major, version.minor, version.bugfix))
                .unwrap()
                .0
                .read(&self.world)
        };
        let int = |name: &str| read(name).int32().unwrap();
        let six = |name: &str| read(name).vector6d().unwrap();
        let one = |name: &str| read(name).double().unwrap();
        let words = self.program.registers.answer_names();
        let words: Vec<i32> = words.iter().map(|name| int(name)).collect();
        Package {
            timestamp: one("timestamp"),
            q: six("actual_q"),
            qd: six("actual_qd"),
            current: six("actual_current"),
            robot_mode: int("robot_mode"),
            safety_mode: int("safety_mode"),
            runtime_state: read("runtime_state").uint32().unwrap(),
            speed_scaling: one("speed_scaling"),
            target_speed_fraction: one("target_speed_fraction"),
            answer: ProgramAnswer::from_words(words.try_into().unwrap()),
        }
    }

    fn arrive(&mut self, inputs: &RegisterInputs) {
        let names = self.program.registers.input_names();
        let doubles = inputs.q.iter().chain(&inputs.qd).map(|value| RtdeValue::Double(*value));
        let values =
            [RtdeValue::Int32(inputs.counter), RtdeValue::Int32(inputs.permit)].into_iter().chain(doubles);
        let cycle = self.world.robot.cycle;
        for (name, value) in names.iter().zip(values) {
            let (slot, _) = self.world.inputs.free(name, OWNER).unwrap();
            self.world.inputs.set(slot, value, cycle);
        }
    }

    pub(super) fn cycle(&mut self) {
        self.cycle += 1;
        while self.under_way.front().is_some_and(|(due, _)| *due <= self.cycle) {
            let (_, inputs) = self.under_way.pop_front().unwrap();
            self.arrive(&inputs);
        }
        self.world.cycle();
        self.watched.see(self.world.robot.actual().q, self.series.cycle_s());
        self.daemon();
        if self.cut {
            return;
        }
        let (package, now_ns) = (self.package(), self.now_ns());
        let Some(pilot) = &mut self.pilot else { return };
        let Some(outcome) = pilot.cycle(&package, now_ns) else { return };
        self.under_way.push_back((self.cycle + 1, outcome.inputs));
        if let Some(token) = outcome.upload {
            self.world.take_script(&self.program.text(token));
        }
        self.newest = Some(outcome);
    }

    pub(super) fn run(&mut self, seconds: f64) {
        let cycles = (seconds / self.series.cycle_s()).ceil() as usize;
        (0..cycles).for_each(|_| self.cycle());
    }

    pub(super) fn phase(&self) -> Phase {
        self.pilot.as_ref().unwrap().machine.phase()
    }

    pub(super) fn reason(&self) -> Option<HaltReason> {
        self.pilot.as_ref().unwrap().machine.reason()
    }

    /// Arms the daemon where the arm stands; it swings half a second later.
    pub(super) fn arm(&mut self) {
        self.middle = self.world.robot.actual().q;
        self.since_s = self.now_s() + 0.5;
        (self.commanding, self.begins) = (true, true);
    }

    pub(super) fn following(series: Series) -> Self {
        Self::new(series).follow()
    }

    pub(super) fn follow(self) -> Self {
        let mut scene = self;
        scene.run(1.0);
        assert_eq!(scene.phase(), Phase::Ready, "{:?}", scene.reason());
        scene.arm();
        scene.run(1.2);
        assert!(matches!(scene.phase(), Phase::Following { .. }), "{:?} {:?}", scene.phase(), scene.reason());
        scene
    }

    /// Nobody pushes the arm beyond what the settings allow, with what a servo overshoots.
    pub(super) fn within_limits(&self, when: &str) {
        let Watched { most_speed, most_acceleration, .. } = self.watched;
        let limits = self.config.robot().limits;
        let [speed, acceleration] = [limits.velocity()[0], limits.acceleration()[0]];
        assert!(most_speed <= speed, "{when}: {most_speed} rad/s");
        assert!(most_acceleration <= 1.05 * acceleration, "{when}: {most_acceleration} rad/s²");
    }
}
