//! A controller for tests: RTDE on a port of its own, and a program that does what ours does, in a few lines
//! of Rust.
//!
//! Contract: a stand-in whose faults are set by the test, not a model of an arm; `controller` has that.

use std::collections::HashMap;
use std::f64::consts::FRAC_PI_2;
use std::io::{Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use crate::primary::{self, KinematicsInfo, PrimaryPackage, SubPackage};

/// Cycle of the stand-in: an e-Series'.
pub(super) const CYCLE: Duration = Duration::from_millis(2);

/// What the stand-in shows, and what is wrong with it.
#[derive(Debug, Clone)]
pub(super) struct State {
    pub(super) values: HashMap<String, Vec<f64>>,
    pub(super) in_use: Vec<String>,
    pub(super) not_found: Vec<String>,
    pub(super) version: [u32; 4],
    /// Newest version of RTDE that it takes.
    pub(super) protocol: u16,
    /// Added to the kinematics' height of the base \[m\].
    pub(super) higher_m: f64,
    /// Cuts every connection, once.
    pub(super) cut: bool,
    /// No states for as long as this is set.
    pub(super) mute: bool,
    /// Programs received on the primary port.
    pub(super) programs: Vec<String>,
    pub(super) cycle: u64,
}

/// A running stand-in.
#[derive(Debug)]
pub(super) struct Fake {
    pub(super) rtde: SocketAddr,
    pub(super) primary: SocketAddr,
    state: Arc<Mutex<State>>,
    over: Arc<AtomicBool>,
    threads: Vec<JoinHandle<()>>,
}

impl Fake {
    pub(super) fn at(home: [f64; 6]) -> Self {
        let numbers = |count: usize, value: f64| vec![value; count];
        let mut values: HashMap<String, Vec<f64>> = HashMap::new();
        let mut put = |name: &str, value: Vec<f64>| {
            values.insert(name.to_owned(), value);
        };
        put("timestamp", numbers(1, 50.0));
        put("actual_q", home.to_vec());
        put("actual_qd", numbers(6, 0.0));
        put("actual_current", numbers(6, 0.1));
        put("robot_mode", numbers(1, 7.0));
        put("safety_mode", numbers(1, 1.0));
        put("runtime_state", numbers(1, 1.0));
        put("speed_scaling", numbers(1, 1.0));
        put("target_speed_fraction", numbers(1, 1.0));
        put("payload", numbers(1, 0.4));
        put("tcp_offset", vec![0.0, 0.0, 0.15, 0.0, 0.0, 0.0]);
        let state = Arc::new(Mutex::new(State {
            values,
            in_use: Vec::new(),
            not_found: Vec::new(),
            version: [5, 11, 0, 1],
            protocol: 2,
            higher_m: 0.0,
            cut: false,
            mute: false,
            programs: Vec::new(),
            cycle: 0,
        }));
        let over = Arc::new(AtomicBool::new(false));
        let [rtde, primary] = [(); 2].map(|()| TcpListener::bind("127.0.0.1:0").unwrap());
        let (rtde_at, primary_at) = (rtde.local_addr().unwrap(), primary.local_addr().unwrap());
        let threads = vec![serve(rtde, &state, &over, talk), serve(primary, &state, &over, upload), {
            let (state, over) = (state.clone(), over.clone());
            thread::spawn(move || run(&state, &over))
        }];
        Self { rtde: rtde_at, primary: primary_at, state, over, threads }
    }

    /// Looks at the state, or changes it.
    pub(super) fn with<T>(&self, change: impl FnOnce(&mut State) -> T) -> T {
        change(&mut self.state.lock().unwrap())
    }

    pub(super) fn set(&self, name: &str, value: f64) {
        self.with(|state| state.values.insert(name.to_owned(), vec![value]));
    }
}

impl Drop for Fake {
    fn drop(&mut self) {
        self.over.store(true, Ordering::Relaxed);
        for thread in self.threads.drain(..) {
            let _ = thread.join();
        }
    }
}

type Talk = fn(TcpStream, &Mutex<State>, &AtomicBool);

fn serve(
    listener: TcpListener,
    state: &Arc<Mutex<State>>,
    over: &Arc<AtomicBool>,
    talk: Talk,
) -> JoinHandle<()> {
    let (state, over) = (state.clone(), over.clone());
    listener.set_nonblocking(true).unwrap();
    thread::spawn(move || {
        let mut talks = Vec::new();
        while !over.load(Ordering::Relaxed) {
            match listener.accept() {
                Ok((stream, _)) => {
                    let (state, over) = (state.clone(), over.clone());
                    stream.set_nonblocking(false).unwrap();
                    stream.set_nodelay(true).unwrap();
                    talks.push(thread::spawn(move || talk(stream, &state, &over)));
                }
                Err(_) => thread::sleep(CYCLE),
            }
        }
        for talk in talks {
            let _ = talk.join();
        }
    })
}

/// The program: echoes counters, obeys permits, moves the joints to where it is told.
fn run(state: &Mutex<State>, over: &AtomicBool) {
    let begin = Instant::now();
    let mut last_counter = 0.0;
    while !over.load(Ordering::Relaxed) {
        {
            let mut state = state.lock().unwrap();
            state.cycle += 1;
            let timestamp = 50.0 + state.cycle as f64 * CYCLE.as_secs_f64();
            state.values.insert("timestamp".to_owned(), vec![timestamp]);
            let read = |state: &State, name: &str| state.values.get(name).map_or(0.0, |value| value[0]);
            if read(&state, "runtime_state") == 2.0 {
                let counter = read(&state, "input_int_register_24");
                let permit = read(&state, "input_int_register_25");
                state.values.insert("output_int_register_24".to_owned(), vec![counter]);
                if permit > 0.0 && counter != last_counter {
                    let q: Vec<f64> =
                        (24..30).map(|i| read(&state, &format!("input_double_register_{i}"))).collect();
                    state.values.insert("actual_q".to_owned(), q);
                    state.values.insert("output_int_register_25".to_owned(), vec![2.0]);
                    state.values.insert("output_int_register_28".to_owned(), vec![permit]);
                } else if permit == 0.0 {
                    state.values.insert("output_int_register_25".to_owned(), vec![1.0]);
                } else if permit < 0.0 {
                    state.values.insert("runtime_state".to_owned(), vec![1.0]);
                }
                last_counter = counter;
            }
        }
        let cycle = state.lock().unwrap().cycle;
        let due = begin + CYCLE * u32::try_from(cycle).unwrap();
        thread::sleep(due.saturating_duration_since(Instant::now()));
    }
}

/// Nominal UR5e (maker's table).
const UR5E: KinematicsInfo = KinematicsInfo {
    checksum: [1; 6],
    theta: [0.0; 6],
    a: [0.0, -0.425, -0.3922, 0.0, 0.0, 0.0],
    d: [0.1625, 0.0, 0.0, 0.1333, 0.0997, 0.0996],
    alpha: [FRAC_PI_2, 0.0, 0.0, FRAC_PI_2, -FRAC_PI_2, 0.0],
    calibration_status: 1,
};

/// Tells the kinematics once. A program that is sent runs at once, if it carries a token.
fn upload(mut stream: TcpStream, state: &Mutex<State>, over: &AtomicBool) {
    stream.set_read_timeout(Some(Duration::from_millis(20))).unwrap();
    let mut kinematics = UR5E;
    kinematics.d[0] += state.lock().unwrap().higher_m;
    let reported = primary::RobotState { parts: vec![SubPackage::Kinematics(kinematics)] };
    stream.write_all(&PrimaryPackage::State(reported).encode()).unwrap();
    let (mut text, mut some) = (String::new(), [0; 4096]);
    while !over.load(Ordering::Relaxed) {
        match stream.read(&mut some) {
            Ok(0) => return,
            Ok(count) => text += &String::from_utf8_lossy(&some[..count]),
            Err(_) => {}
        }
        if text.ends_with("\nend\n") {
            let token = text.split("write_output_integer_register(26, ").nth(1).unwrap();
            let token: f64 = token.split(')').next().unwrap().parse().unwrap();
            let mut state = state.lock().unwrap();
            for (name, value) in [("runtime_state", 2.0), ("output_int_register_26", token)] {
                state.values.insert(name.to_owned(), vec![value]);
            }
            for name in ["25", "27", "28", "29", "30"] {
                let value = if name == "25" { 1.0 } else { 0.0 };
                state.values.insert(format!("output_int_register_{name}"), vec![value]);
            }
            state.programs.push(std::mem::take(&mut text));
        }
    }
}

/// One RTDE client.
fn talk(mut stream: TcpStream, state: &Mutex<State>, over: &AtomicBool) {
    stream.set_read_timeout(Some(Duration::from_micros(500))).unwrap();
    let (mut unread, mut some) = (Vec::<u8>::new(), [0; 4096]);
    let (mut outputs, mut inputs): (Vec<String>, Vec<String>) = (Vec::new(), Vec::new());
    let (mut started, mut sent) = (false, 0);
    while !over.load(Ordering::Relaxed) {
        match stream.read(&mut some) {
            Ok(0) => return,
            Ok(count) => unread.extend(&some[..count]),
            Err(_) => {}
        }
        while unread.len() >= 3 {
            let size = usize::from(u16::from_be_bytes([unread[0], unread[1]]));
            if unread.len() < size {
                break;
            }
            let package: Vec<u8> = unread.drain(..size).collect();
            let (kind, payload) = (package[2], &package[3..]);
            let mut state = state.lock().unwrap();
            let names = |bytes: &[u8]| {
                let text = String::from_utf8(bytes.to_vec()).unwrap();
                text.split(',').map(str::to_owned).collect::<Vec<_>>()
            };
            let answer = match kind {
                b'V' => vec![u8::from(payload[1] <= state.protocol as u8)],
                b'S' => {
                    started = true;
                    vec![1]
                }
                b'v' => state.version.iter().flat_map(|word| word.to_be_bytes()).collect(),
                b'O' => {
                    // Version 1 knows neither a frequency nor a recipe.
                    let newer = state.protocol == 2;
                    outputs = names(&payload[if newer { 8 } else { 0 }..]);
                    [if newer { vec![1] } else { Vec::new() }, types(&outputs, &state)].concat()
                }
                b'I' => {
                    inputs = names(payload);
                    [vec![1], types(&inputs, &state)].concat()
                }
                _ => {
                    let mut rest = &payload[1..];
                    for name in &inputs {
                        let (bytes, after) = rest.split_at(width(name));
                        let value = if bytes.len() == 4 {
                            f64::from(i32::from_be_bytes(bytes.try_into().unwrap()))
                        } else {
                            f64::from_be_bytes(bytes.try_into().unwrap())
                        };
                        state.values.insert(name.clone(), vec![value]);
                        rest = after;
                    }
                    continue;
                }
            };
            drop(state);
            if write(&mut stream, kind, &answer).is_err() {
                return;
            }
        }
        let mut now = state.lock().unwrap();
        if std::mem::take(&mut now.cut) {
            return;
        }
        if started && now.cycle > sent && !now.mute {
            sent = now.cycle;
            let mut payload = if now.protocol == 2 { vec![1] } else { Vec::new() };
            for name in &outputs {
                let value = now.values.get(name).cloned().unwrap_or_else(|| vec![0.0]);
                for number in value {
                    match type_of(name) {
                        "INT32" => payload.extend((number as i32).to_be_bytes()),
                        "UINT32" => payload.extend((number as u32).to_be_bytes()),
                        _ => payload.extend(number.to_be_bytes()),
                    }
                }
            }
            drop(now);
            if write(&mut stream, b'U', &payload).is_err() {
                return;
            }
        }
    }
}

fn write(stream: &mut TcpStream, kind: u8, payload: &[u8]) -> std::io::Result<()> {
    let mut package = u16::try_from(payload.len() + 3).unwrap().to_be_bytes().to_vec();
    package.push(kind);
    package.extend(payload);
    stream.write_all(&package)
}

fn type_of(name: &str) -> &'static str {
    match name {
        "robot_mode" | "safety_mode" => "INT32",
        "runtime_state" => "UINT32",
        name if name.starts_with("actual_") || name == "tcp_offset" => "VECTOR6D",
        name if name.contains("_int_register_") => "INT32",
        _ => "DOUBLE",
    }
}

fn width(name: &str) -> usize {
    if type_of(name) == "INT32" { 4 } else { 8 }
}

fn types(names: &[String], state: &State) -> Vec<u8> {
    let words: Vec<&str> = names
        .iter()
        .map(|name| match name {
            name if state.in_use.contains(name) => "IN_USE",
            name if state.not_found.contains(name) => "NOT_FOUND",
            name => type_of(name),
        })
        .collect();
    words.join(",").into_bytes()
}
