//! The program on the controller, run by the interpreter cycle by cycle: what it does with good counters and
//! with bad ones.

use std::collections::BTreeMap;
use std::sync::LazyLock;

use foretrace_client::JOINTS;
use foretrace_config::Config;

use foretrace_ur::bridge::program::BridgeProgram;
use foretrace_ur::bridge::registers::{END, ProgramAnswer, ProgramState, RegisterInputs, RegisterMap};
use foretrace_ur_sim::script::{Called, Machine, MachineCall, Program as Script, Progress, ScriptRun, Value};

mod bounds;

const CYCLE_S: f64 = 0.008;
const TOKEN: i32 = 777;

/// Registers, and joints that are where `servoj` put them, or brake.
struct Arm {
    registers: RegisterMap,
    integers: BTreeMap<i32, i32>,
    doubles: BTreeMap<i32, f64>,
    outputs: BTreeMap<i32, i32>,
    q: [f64; JOINTS],
    qd: [f64; JOINTS],
    /// Cycles in which `servoj` was called, and the decelerations of `stopj`.
    servoed: u64,
    stops: Vec<f64>,
    watchdog: Option<(String, f64, String)>,
}

impl Arm {
    fn joints(value: &Value) -> [f64; JOINTS] {
        let Value::List(list) = value else { panic!("{value:?} is no list") };
        let numbers: Vec<f64> = list.items().iter().map(|item| item.as_number().unwrap()).collect();
        numbers.try_into().unwrap()
    }
}

impl Machine for Arm {
    fn knows(&self, name: &str) -> bool {
        let known = "get_actual_joint_positions read_input_integer_register read_input_float_register \
                     write_output_integer_register rtde_set_watchdog servoj stopj sync textmsg";
        known.split_whitespace().any(|known| known == name)
    }

    fn call(&mut self, call: &MachineCall<'_>) -> Called {
        let given = &call.arguments.positional;
        let number = |at: usize| given.get(at).and_then(Value::as_number).unwrap();
        let register = || given.first().and_then(Value::as_integer).unwrap();
        match call.name {
            "get_actual_joint_positions" => Called::Value(Value::floats(&self.q)),
            "read_input_integer_register" => {
                Called::Value(Value::Integer(self.integers.get(&register()).copied().unwrap_or(0)))
            }
            "read_input_float_register" => {
                Called::Value(Value::Float(self.doubles.get(&register()).copied().unwrap_or(0.0)))
            }
            "write_output_integer_register" => {
                self.outputs.insert(register(), given[1].as_integer().unwrap());
                Called::Value(Value::None)
            }
            "rtde_set_watchdog" => {
                let text = |at: usize| given[at].as_text().unwrap().to_owned();
                self.watchdog = Some((text(0), number(1), text(2)));
                Called::Value(Value::None)
            }
            "servoj" => {
                let [q, a, v, t, ahead, gain] =
                    call.arguments.bind(["q", "a", "v", "t", "lookahead_time", "gain"]).unwrap();
                assert!(a.is_none() && v.is_none());
                assert_eq!(t.and_then(Value::as_number), Some(CYCLE_S));
                assert!((0.03..=0.2).contains(&ahead.and_then(Value::as_number).unwrap()));
                assert!((100.0..=2000.0).contains(&gain.and_then(Value::as_number).unwrap()));
                let to = Self::joints(q.unwrap());
                for ((q, qd), to) in self.q.iter_mut().zip(&mut self.qd).zip(to) {
                    (*qd, *q) = ((to - *q) / CYCLE_S, to);
                }
                self.servoed += 1;
                Called::Cycle(Value::None)
            }
            "stopj" => {
                if call.first {
                    self.stops.push(number(0));
                }
                let by = number(0) * CYCLE_S;
                for (q, qd) in self.q.iter_mut().zip(&mut self.qd) {
                    *qd = qd.signum() * (qd.abs() - by).max(0.0);
                    *q += *qd * CYCLE_S;
                }
                if self.qd.iter().any(|qd| *qd != 0.0) { Called::Wait } else { Called::Value(Value::None) }
            }
            "sync" => Called::Cycle(Value::None),
            "textmsg" => Called::Value(Value::None),
            other => panic!("{other} is not called"),
        }
    }
}

struct Scene {
    arm: Arm,
    run: ScriptRun,
    counter: i32,
    permit: i32,
    q: [f64; JOINTS],
    qd: [f64; JOINTS],
    program: BridgeProgram,
}

fn program(preset: &str) -> BridgeProgram {
    static UR5: LazyLock<Config> = LazyLock::new(|| Config::preset("ur5").unwrap());
    let config = if preset == "ur5" { UR5.clone() } else { Config::preset(preset).unwrap() };
    BridgeProgram::new(
        &config.settings().robot.ur,
        &config.robot().limits,
        RegisterMap::at(24).unwrap(),
        CYCLE_S,
    )
}

impl Scene {
    fn new() -> Self {
        Self::from(&[])
    }

    /// With these numbers in the integer registers from the beginning.
    fn from(before: &[(i32, i32)]) -> Self {
        let program = program("ur5");
        let q = [0.5, -1.2, 1.4, -1.0, -1.5, 0.3];
        let arm = Arm {
            registers: program.registers,
            integers: before.iter().copied().collect(),
            doubles: BTreeMap::new(),
            outputs: BTreeMap::new(),
            q,
            qd: [0.0; JOINTS],
            servoed: 0,
            stops: Vec::new(),
            watchdog: None,
        };
        let script = Script::parse(&program.text(TOKEN)).unwrap();
        let run = ScriptRun::new(&script, &arm).unwrap();
        Self { arm, run, counter: 100, permit: 0, q, qd: [0.0; JOINTS], program }
    }

    /// The bridge sends a package, then the controller runs a cycle.
    fn fresh(&mut self) -> ProgramAnswer {
        self.counter += 1;
        self.send();
        self.stale()
    }

    fn send(&mut self) {
        let inputs = RegisterInputs { counter: self.counter, permit: self.permit, q: self.q, qd: self.qd };
        let r = self.arm.registers;
        let at = |number: u32| i32::try_from(number).unwrap();
        self.arm.integers.insert(at(r.counter()), inputs.counter);
        self.arm.integers.insert(at(r.permit()), inputs.permit);
        for (i, value) in (0..).zip(inputs.q.iter().chain(&inputs.qd)) {
            self.arm.doubles.insert(at(r.double(i)), *value);
        }
    }

    /// A cycle without a package.
    fn stale(&mut self) -> ProgramAnswer {
        assert_eq!(self.run.cycle(&mut self.arm), Progress::Running);
        self.answer()
    }

    fn fresh_for(&mut self, cycles: usize) {
        (0..cycles).for_each(|_| {
            self.fresh();
        });
    }

    fn stale_for(&mut self, cycles: usize) {
        (0..cycles).for_each(|_| {
            self.stale();
        });
    }

    fn answer(&self) -> ProgramAnswer {
        let r = self.arm.registers;
        ProgramAnswer::from_words(
            [0, 1, 2, 3, 4, 5, 6]
                .map(|i| self.arm.outputs.get(&i32::try_from(r.output(i)).unwrap()).copied().unwrap_or(0)),
        )
    }

    /// Follows from where the arm is, with joint 0 at `speed` \[rad/s\] in the end.
    fn following(speed: f64) -> Self {
        let mut scene = Self::new();
        scene.fresh();
        (scene.permit, scene.q) = (9, scene.arm.q);
        scene.fresh();
        while scene.qd[0] < speed {
            scene.qd[0] = (scene.qd[0] + 20.0 * CYCLE_S).min(speed);
            scene.go_on();
        }
        assert_eq!(scene.answer().program(), ProgramState::Following);
        scene
    }

    fn go_on(&mut self) -> ProgramAnswer {
        self.q.iter_mut().zip(&self.qd).for_each(|(q, qd)| *q += qd * CYCLE_S);
        self.fresh()
    }
}

#[test]
fn begins_by_waiting_with_its_token_and_a_watchdog_on_the_counter() {
    let mut scene = Scene::new();
    let answer = scene.fresh();
    assert_eq!((answer.session, answer.program()), (TOKEN, ProgramState::Waiting));
    let (name, hz, action) = scene.arm.watchdog.clone().unwrap();
    assert_eq!((name.as_str(), hz, action.as_str()), ("input_int_register_24", 10.0, "stop"));
    assert_eq!(scene.fresh().echo, scene.counter);
    assert_eq!(scene.arm.servoed, 0);
}

#[test]
fn a_permit_from_before_the_program_is_not_obeyed() {
    let mut scene = Scene::from(&[(25, 9)]);
    scene.permit = 9;
    scene.fresh_for(10);
    assert_eq!((scene.answer().program(), scene.arm.servoed), (ProgramState::Waiting, 0));
    scene.permit = 10;
    assert_eq!(scene.fresh().program(), ProgramState::Following);
}

#[test]
fn targets_are_followed_in_the_cycle_that_reads_them() {
    let mut scene = Scene::following(0.0);
    for step in 1..200 {
        let phase = f64::from(step) * CYCLE_S * 3.0;
        let q = 0.5 + 0.1 * (1.0 - phase.cos());
        (scene.qd[0], scene.q[0]) = (0.3 * phase.sin(), q);
        let answer = scene.fresh();
        assert_eq!(answer.echo, scene.counter);
        assert!((scene.arm.q[0] - q).abs() < 1e-12, "{} instead of {q}", scene.arm.q[0]);
    }
    assert_eq!((scene.answer().late, scene.answer().lost), (0, 0));
}

#[test]
fn missing_counters_are_bridged_in_a_straight_line_for_five_cycles() {
    let mut scene = Scene::following(1.0);
    let from = scene.arm.q[0];
    for cycle in 1..=5 {
        assert_eq!(scene.stale().program(), ProgramState::Following);
        assert!((scene.arm.q[0] - from - f64::from(cycle) * CYCLE_S).abs() < 1e-12);
    }
    // The sixth one is too many; a fresh one would have saved it.
    assert_eq!(scene.stale().program(), ProgramState::StoppedLate);
    assert_eq!(scene.arm.stops, [20.0]);
}

#[test]
fn a_counter_within_five_cycles_goes_on_as_if_nothing_had_been() {
    let mut scene = Scene::following(1.0);
    for _ in 0..4 {
        scene.stale();
        scene.q[0] += CYCLE_S;
    }
    assert_eq!(scene.go_on().program(), ProgramState::Following);
    assert!((scene.arm.q[0] - scene.q[0]).abs() < 1e-12);
    assert_eq!((scene.answer().late, scene.arm.stops.len()), (4, 0));
}

#[test]
fn after_a_stop_only_a_new_permit_moves_the_arm_and_from_where_it_is() {
    let mut scene = Scene::following(1.0);
    scene.stale_for(40);
    let (rested, servoed) = (scene.arm.q, scene.arm.servoed);
    assert_eq!(scene.arm.qd, [0.0; JOINTS]);
    // The old permit, however many counters come.
    scene.fresh_for(20);
    assert_eq!((scene.arm.q, scene.arm.servoed), (rested, servoed));
    // A new one with a target that is where the daemon believes the arm: refused.
    (scene.permit, scene.q[0]) = (10, rested[0] + 0.3);
    assert_eq!(scene.fresh().program(), ProgramState::StoppedJump);
    (scene.permit, scene.q, scene.qd) = (11, rested, [0.0; JOINTS]);
    assert_eq!(scene.fresh().program(), ProgramState::Following);
    assert_eq!(scene.arm.q, rested);
}

#[test]
fn a_target_too_far_or_no_number_stops_the_arm() {
    type Spoil = fn(&mut Scene);
    let rows: [(&str, Spoil); 5] = [
        ("a jump", |s| s.q[3] += 0.2),
        ("no number", |s| s.q[1] = f64::NAN),
        ("infinite", |s| s.q[1] = f64::INFINITY),
        ("a velocity that no joint has", |s| s.qd[2] = 9.0),
        ("a velocity that is no number", |s| s.qd[5] = f64::NAN),
    ];
    for (name, spoil) in rows {
        let mut scene = Scene::following(0.5);
        let before = scene.arm.q;
        spoil(&mut scene);
        assert_eq!(scene.fresh().program(), ProgramState::StoppedJump, "{name}");
        scene.fresh_for(30);
        let moved = scene.arm.q.iter().zip(before).map(|(q, before)| (q - before).abs());
        assert!(moved.fold(0.0, f64::max) < 0.01, "{name}: it brakes where it is");
        assert!(scene.arm.q.iter().all(|q| q.is_finite()), "{name}");
    }
}

#[test]
fn taking_the_permit_back_stops_the_arm_at_once() {
    let mut scene = Scene::following(1.0);
    scene.permit = 0;
    let servoed = scene.arm.servoed;
    assert_eq!(scene.fresh().program(), ProgramState::Waiting);
    scene.fresh_for(20);
    assert_eq!((scene.arm.servoed, scene.arm.stops.len()), (servoed, 1));
    // What came during the stop is not lost.
    assert_eq!(scene.answer().lost, 0);
}

#[test]
fn counters_that_come_two_at_a_time_are_counted_as_lost() {
    let mut scene = Scene::following(0.0);
    scene.counter += 3;
    assert_eq!(scene.fresh().lost, 3);
}

#[test]
fn the_end_stops_the_arm_first() {
    let mut scene = Scene::following(1.0);
    scene.permit = END;
    scene.counter += 1;
    scene.send();
    let over =
        (0..100).map(|_| scene.run.cycle(&mut scene.arm)).find(|progress| *progress != Progress::Running);
    assert_eq!((over, scene.arm.qd), (Some(Progress::Finished), [0.0; JOINTS]));
}

#[test]
fn every_preset_gives_a_program_that_the_interpreter_takes() {
    for preset in ["ur5", "ur5e", "ur5-first-run"] {
        let script = Script::parse(&program(preset).text(TOKEN)).unwrap();
        assert_eq!(script.name(), "foretrace");
    }
}
