//! Programs that others wrote. They are not part of this repository: where the folder named by
//! `FORETRACE_UR_SCRIPTS` has them (`*.script`), they are run, else the test says that it was skipped.

use foretrace_ur::script::{Call, Called, Machine, Program, Progress, Run, ThreadId, Value};
use std::collections::HashMap;
use std::path::PathBuf;

/// A robot that does at once whatever it is told, with the registers of RTDE.
#[derive(Default)]
struct Robot {
    input_integers: HashMap<i32, i32>,
    input_floats: HashMap<i32, f64>,
    output_integers: HashMap<i32, i32>,
    /// The last motion: name, joints or pose, and how often it was asked for.
    motion: Option<(String, [f64; 6], u32)>,
    waited: HashMap<ThreadId, u32>,
}

impl Machine for Robot {
    fn knows(&self, _: &str) -> bool {
        true
    }

    fn call(&mut self, call: &Call<'_>) -> Called {
        let argument = |at: usize| call.arguments.positional.get(at);
        let register = argument(0).and_then(Value::as_integer).unwrap_or(-1);
        match call.name {
            "read_input_integer_register" => {
                Called::Value(Value::Integer(self.input_integers.get(&register).copied().unwrap_or(0)))
            }
            "read_input_float_register" => {
                Called::Value(Value::Float(self.input_floats.get(&register).copied().unwrap_or(0.0)))
            }
            "write_output_integer_register" => match argument(1).and_then(Value::as_integer) {
                Some(value) => {
                    self.output_integers.insert(register, value);
                    Called::Value(Value::None)
                }
                None => Called::Failed("an integer wanted".to_owned()),
            },
            "get_steptime" => Called::Value(Value::Float(0.002)),
            "is_steady" => Called::Value(Value::Bool(true)),
            "sync" => Called::Cycle(Value::None),
            "servoj" | "speedj" | "servoc" | "speedl" => {
                let Some(target) = argument(0).and_then(Value::as_numbers) else {
                    return Called::Failed("six numbers wanted".to_owned());
                };
                let times = self.motion.as_ref().map_or(0, |motion| motion.2);
                self.motion = Some((call.name.to_owned(), target, times + 1));
                Called::Cycle(Value::None)
            }
            "movej" | "movel" | "stopj" | "stopl" | "sleep" => {
                let left = self.waited.entry(call.thread).or_insert(0);
                *left = if call.first { 3 } else { left.saturating_sub(1) };
                if *left > 0 {
                    return Called::Wait;
                }
                if let Some(target) = argument(0).and_then(Value::as_numbers) {
                    self.motion = Some((call.name.to_owned(), target, 1));
                }
                Called::Value(Value::None)
            }
            _ => Called::Value(Value::None),
        }
    }
}

/// The programs of `ur_rtde`, which leaves the offsets of its registers to the client that sends them.
fn programs() -> Vec<(PathBuf, String)> {
    let Some(folder) = std::env::var_os("FORETRACE_UR_SCRIPTS") else { return Vec::new() };
    let files = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let scripts = files.filter(|path| path.extension().is_some_and(|ending| ending == "script"));
    let read = |path: PathBuf| {
        let text = std::fs::read_to_string(&path).unwrap();
        (path, text.replace("= # float register offset", "= 0").replace("= # int register offset", "= 0"))
    };
    scripts.map(read).filter(|(_, text)| text.contains("def rtde_control():")).collect()
}

struct Client {
    robot: Robot,
    run: Run,
}

impl Client {
    #[track_caller]
    fn cycles(&mut self, count: u32) {
        for _ in 0..count {
            let progress = self.run.cycle(&mut self.robot);
            assert_eq!(progress, Progress::Running);
        }
    }

    /// As the client: command and arguments, wait for done, command 0, wait for ready.
    #[track_caller]
    fn command(&mut self, command: i32, floats: &[f64]) {
        self.ask(command, floats);
        for _ in 0..100 {
            self.cycles(1);
            if self.robot.output_integers.get(&0) == Some(&2) {
                break;
            }
        }
        assert_eq!(self.robot.output_integers.get(&0), Some(&2), "command {command} is not done");
        self.robot.input_integers.insert(0, 0);
        self.cycles(2);
        assert_eq!(self.robot.output_integers.get(&0), Some(&1), "not ready after command {command}");
    }

    fn ask(&mut self, command: i32, floats: &[f64]) {
        self.robot.input_floats.extend((0..).zip(floats.iter().copied()));
        self.robot.input_integers.insert(0, command);
    }
}

#[test]
fn the_program_of_ur_rtde_moves_servos_speeds_and_stops() {
    let programs = programs();
    if programs.is_empty() {
        eprintln!("skipped: FORETRACE_UR_SCRIPTS names no folder with ur_rtde's program");
        return;
    }
    for (path, text) in programs {
        eprintln!("{}", path.display());
        let program = Program::parse(&text).unwrap();
        assert_eq!(program.name(), "rtde_control");
        let robot = Robot::default();
        let run = Run::new(&program, &robot).unwrap();
        let mut client = Client { robot, run };
        client.cycles(1);
        assert_eq!(client.robot.output_integers.get(&0), Some(&1), "ready after the first cycle");

        // moveJ
        client.command(1, &[0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 1.05, 1.4]);
        assert_eq!(client.robot.motion, Some(("movej".to_owned(), [0.1, 0.2, 0.3, 0.4, 0.5, 0.6], 1)));

        // servoJ: every cycle, with the newest target.
        client.robot.motion = None;
        for cycle in 0..20_u32 {
            let q = f64::from(cycle) * 0.001;
            client.ask(11, &[q, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.002, 0.1, 300.0]);
            client.cycles(1);
            assert_eq!(
                client.robot.motion,
                Some(("servoj".to_owned(), [q, 0.0, 0.0, 0.0, 0.0, 0.0], cycle + 1))
            );
        }
        client.robot.input_integers.insert(0, 0);
        client.cycles(2);
        assert_eq!(client.run.threads(), 2);
        // servoStop
        client.command(16, &[10.0]);
        assert_eq!(client.run.threads(), 1);

        // speedJ and speedStop
        client.robot.motion = None;
        client.ask(9, &[0.1, 0.0, 0.0, 0.0, 0.0, 0.0, 0.5, 0.0]);
        client.cycles(10);
        assert_eq!(client.robot.motion, Some(("speedj".to_owned(), [0.1, 0.0, 0.0, 0.0, 0.0, 0.0], 10)));
        client.robot.input_integers.insert(0, 0);
        client.cycles(2);
        client.command(15, &[10.0]);
        assert_eq!(client.run.threads(), 1);

        // isSteady
        client.command(47, &[]);
        assert_eq!(client.robot.output_integers.get(&1), Some(&1));

        // stop script
        client.ask(255, &[]);
        let end = (0..10)
            .map(|_| client.run.cycle(&mut client.robot))
            .find(|progress| *progress != Progress::Running);
        assert_eq!(end, Some(Progress::Finished));
    }
}
