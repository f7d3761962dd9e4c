//! Programs that others wrote. They are not part of this repository: where the folder named by
//! `FORETRACE_UR_SCRIPTS` has them (`others.py` fills it), they are run, else the test says that it was
//! skipped.

use foretrace_ur_sim::script::{
    Called, List, Machine, MachineCall, Program, Progress, ScriptRun, ThreadId, Uploads, Value,
};
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
    /// What the reverse socket of the client library brings, if anything.
    socket: Option<Vec<i32>>,
    content: Vec<String>,
}

impl Machine for Robot {
    fn knows(&self, _: &str) -> bool {
        true
    }

    fn call(&mut self, call: &MachineCall<'_>) -> Called {
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
            "get_joint_positions" | "get_target_joint_positions" | "get_target_joint_speeds" => {
                Called::Value(Value::floats(&[0.0; 6]))
            }
            "textmsg" => {
                self.content.extend(argument(0).map(ToString::to_string));
                Called::Value(Value::None)
            }
            "socket_open" => Called::Value(Value::Bool(true)),
            "socket_read_binary_integer" => {
                // The script command socket stays silent; the reverse socket brings one message a cycle.
                let reverse = argument(1).and_then(Value::as_text) == Some("reverse_socket");
                match if reverse { self.socket.take() } else { None } {
                    Some(numbers) => {
                        let list = numbers.into_iter().map(Value::Integer).collect();
                        Called::Value(Value::List(List::new(list).unwrap()))
                    }
                    None => Called::Wait,
                }
            }
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

/// The programs of that name (its beginning) in the folder, with their paths.
fn programs(name: &str) -> Vec<(PathBuf, String)> {
    let folder = std::env::var_os("FORETRACE_UR_SCRIPTS");
    let files = folder
        .iter()
        .flat_map(|folder| std::fs::read_dir(folder).unwrap())
        .map(|entry| entry.unwrap().path());
    let scripts = files.filter(|path| path.extension().is_some_and(|ending| ending == "script"));
    let texts = scripts.map(|path| (path.clone(), std::fs::read_to_string(path).unwrap()));
    let found: Vec<_> = texts.filter(|(_, text)| text.starts_with(&format!("def {name}"))).collect();
    if found.is_empty() {
        eprintln!("skipped: FORETRACE_UR_SCRIPTS names no folder with the program {name}");
    }
    found
}

struct Client {
    robot: Robot,
    run: ScriptRun,
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
    for (path, text) in programs("rtde_control") {
        eprintln!("{}", path.display());
        let program = Program::parse(&text).unwrap();
        assert_eq!(program.name(), "rtde_control");
        let robot = Robot::default();
        let run = ScriptRun::new(&program, &robot).unwrap();
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

#[test]
fn the_program_of_the_client_library_servos_and_extrapolates() {
    for (path, text) in programs("externalControl") {
        eprintln!("{}", path.display());
        let program = Program::parse(&text).unwrap();
        let robot = Robot::default();
        let run = ScriptRun::new(&program, &robot).unwrap();
        let mut client = Client { robot, run };
        client.cycles(1);
        // Eight numbers: time limit [ms], joints [1e-6 rad], mode 1 (servoj); before them their count.
        for cycle in 0..20 {
            client.robot.socket = Some(vec![8, 20, cycle * 100, 0, 0, 0, 0, 0, 1]);
            client.cycles(1);
        }
        let Some((name, q, times)) = client.robot.motion.clone() else { panic!("no motion") };
        assert_eq!((name.as_str(), q[0], times), ("servoj", 0.0019, 20));
        // No message: the servo thread goes on by itself.
        client.cycles(3);
        assert_eq!(client.robot.motion.as_ref().map(|motion| motion.2), Some(23));
        // Mode -2 ends the program.
        client.robot.socket = Some(vec![8, 20, 0, 0, 0, 0, 0, 0, -2]);
        let end = (0..20).map(|_| client.run.cycle(&mut client.robot)).find(|p| *p != Progress::Running);
        assert_eq!(end, Some(Progress::Finished), "{:?}", client.robot.content);
    }
}

#[test]
fn every_program_of_the_folder_is_read() {
    for (path, text) in programs("") {
        let program = Program::parse(&text).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
        assert!(!program.name().is_empty(), "{}", path.display());
        let robot = Robot::default();
        assert!(ScriptRun::new(&program, &robot).is_ok());
        assert_eq!(Uploads::default().take(text.as_bytes()), Ok(vec![text]), "{}", path.display());
    }
}
