//! A Universal Robots arm whose bridge, daemon or player dies or stands still, or whose network is cut, at
//! random moments: watched by an RTDE client that belongs to none of them.
//!
//! Contract: what is asserted is that the arm comes to rest, how it does (no joint faster or harder than it
//! may be), and that it goes on only when somebody arms again. How long it took is told.

use std::io::{BufRead, BufReader, Write};
use std::net::{IpAddr, Ipv4Addr, SocketAddr, TcpStream};
use std::sync::atomic::{AtomicBool, AtomicU8, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::Duration;

use foretrace_tests::{Process, World, told, until};
use foretrace_ur::rtde::{Client, Value};

use super::scene::{Moments, PLAY, rounds, say_times};
use crate::PROGRAM;

const JOINTS: usize = 6;
const CYCLE_S: f64 = 0.008;
/// Of the simulated arm [rad/s], [rad/s²].
const FASTEST_RADPS: f64 = 3.342;
const HARDEST_RADPS2: f64 = 40.0;
/// Nearer than this to where it ends an arm rests [rad], if it stays for so long [s].
const REST_RAD: f64 = 1e-6;
const RESTS_S: f64 = 0.6;
/// Commands live as long as the way to a CB3 takes.
const VALID: [&str; 2] = ["--set", "loop.valid_periods=12"];
const PATIENCE: Duration = Duration::from_secs(5);
const RTDE: u16 = 30004;
const FAULTS: u16 = 30020;

/// Timestamp of the controller [s], joint positions [rad].
type State = (f64, [f64; JOINTS]);

/// Somebody else's eyes on the arm.
struct Watcher {
    seen: Arc<Mutex<Vec<State>>>,
    ends: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Watcher {
    fn open(address: SocketAddr) -> Self {
        let mut client = Client::connect(address, PATIENCE).expect("RTDE answers");
        client.set_up_outputs(&["timestamp", "actual_q"], 125.0).expect("known fields");
        client.start().expect("it starts");
        let (seen, ends) = (Arc::default(), Arc::new(AtomicBool::new(false)));
        let (shared, stop): (Arc<Mutex<Vec<State>>>, _) = (Arc::clone(&seen), Arc::clone(&ends));
        let thread = std::thread::spawn(move || {
            while !stop.load(Ordering::Relaxed) {
                let Ok(package) = client.receive(Duration::from_millis(100)) else {
                    // A cut ends this connection as well.
                    match Client::connect(address, PATIENCE) {
                        Ok(again) => client = again,
                        Err(_) => continue,
                    }
                    let outputs = client.set_up_outputs(&["timestamp", "actual_q"], 125.0);
                    let _ = outputs.and_then(|()| client.start());
                    continue;
                };
                if let Some([Value::Double(t), Value::Vector6d(q)]) = package.as_ref().map(|p| &p.values[..])
                {
                    shared.lock().expect("no thread panics").push((*t, *q));
                }
            }
        });
        Self { seen, ends, thread: Some(thread) }
    }

    /// The joints' largest speed over the last two states that follow each other [rad/s], and when.
    fn now(&self) -> Option<(f64, f64)> {
        let seen = self.seen.lock().expect("no thread panics");
        let [.., (t0, q0), (t1, q1)] = seen[..] else { return None };
        let fastest = q0.iter().zip(&q1).map(|(a, b)| (b - a).abs()).fold(0.0, f64::max);
        (t1 > t0).then_some((fastest / (t1 - t0), t1))
    }

    /// Waits until the arm moves; returns when that was on the controller's clock [s].
    fn moves(&self) -> f64 {
        until("the arm moves", || self.now().filter(|(speed, _)| *speed > 0.02).map(|(_, t)| t))
    }

    /// Waits until the arm has rested for longer than a pen pauses; returns since when, on the controller's
    /// clock [s].
    fn rests(&self) -> f64 {
        until("the arm rests", || {
            let seen = self.seen.lock().expect("no thread panics");
            let (last, q) = *seen.last()?;
            let still = |(_, there): &&State| there.iter().zip(&q).all(|(a, b)| (a - b).abs() < REST_RAD);
            let (since, _) = *seen.iter().rev().take_while(still).last()?;
            (last - since > RESTS_S).then_some(since)
        })
    }

    /// No state of the last round was out of what the arm may do.
    fn judge(&self, when: &str) {
        let mut seen = self.seen.lock().expect("no thread panics");
        let follows = |a: &State, b: &State| ((b.0 - a.0) - CYCLE_S).abs() < 1e-6;
        for pair in seen.windows(2).filter(|pair| pair[1].0 > pair[0].0) {
            for (before, after) in pair[0].1.iter().zip(&pair[1].1) {
                let speed = (after - before).abs() / (pair[1].0 - pair[0].0);
                assert!(speed < FASTEST_RADPS * 1.001, "{when}: {speed} rad/s at {}", pair[1].0);
            }
        }
        for three in seen.windows(3).filter(|w| follows(&w[0], &w[1]) && follows(&w[1], &w[2])) {
            for joint in 0..JOINTS {
                let [a, b, c] = [0, 1, 2].map(|k| three[k].1[joint]);
                let hard = (c - 2.0 * b + a).abs() / (CYCLE_S * CYCLE_S);
                assert!(hard < HARDEST_RADPS2 * 1.01, "{when}: {hard} rad/s² at {}", three[2].0);
            }
        }
        seen.clear();
    }
}

impl Drop for Watcher {
    fn drop(&mut self) {
        self.ends.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

struct Scene {
    world: World,
    address: Ipv4Addr,
    controller: Process,
    daemon: Option<Process>,
    bridge: Option<Process>,
    player: Option<Process>,
    watcher: Watcher,
}

impl Scene {
    fn following() -> Self {
        let world = World::new(PROGRAM);
        // Ports are fixed, as a real one's: tests side by side need addresses of their own.
        static COUNT: AtomicU8 = AtomicU8::new(0);
        let [_, _, b, c] = std::process::id().to_be_bytes();
        let address = Ipv4Addr::new(127, 210 + COUNT.fetch_add(1, Ordering::Relaxed) % 40, b, 1 + c % 250);
        let words = ["ur-sim", "--bind", &address.to_string()].map(str::to_owned);
        let mut controller = world.start_plain(&words);
        let at = |port| SocketAddr::new(IpAddr::V4(address), port);
        until("the controller listens", || {
            controller.expect_alive();
            TcpStream::connect_timeout(&at(FAULTS), PATIENCE).ok()
        });
        let watcher = Watcher::open(at(RTDE));
        let mut scene =
            Self { world, address, controller, daemon: None, bridge: None, player: None, watcher };
        scene.complete();
        scene
    }

    /// Starts whoever is missing, and arms until the arm follows.
    fn complete(&mut self) {
        if self.daemon.is_none() {
            self.daemon = Some(self.world.daemon_with(0, &VALID));
        }
        if self.bridge.is_none() {
            let robot = self.address.to_string();
            let words = [&["arm", "ur", "--wait", "30", "--robot", &robot], &VALID[..]].concat();
            self.bridge = Some(self.world.start(0, &words));
        }
        if self.player.is_none() {
            self.player = Some(self.world.start(0, &PLAY));
        }
        until("the arm follows", || {
            self.controller.expect_alive();
            // The place of a dead peer is free once a live one has cleaned up.
            if self.player.as_mut().is_some_and(|player| player.ended().is_some()) {
                self.player = Some(self.world.start(0, &PLAY));
            }
            if let Some((status, text)) = self.bridge.as_mut().and_then(Process::ended) {
                let passing = ["places for", "no daemon running", "another program"];
                assert!(passing.iter().any(|words| text.contains(words)), "{status}: {text}");
                let robot = self.address.to_string();
                let words = [&["arm", "ur", "--wait", "30", "--robot", &robot], &VALID[..]].concat();
                self.bridge = Some(self.world.start(0, &words));
            }
            let asked = self.world.run(0, &["request", "arm"]);
            assert!(matches!(asked.status.code(), Some(0 | 1 | 3 | 4)), "{}", told(&asked));
            let moves = self.watcher.now().is_some_and(|(speed, _)| speed > 0.02);
            (moves && self.world.status(0)["mode"] == "following").then_some(())
        });
    }

    fn order(&self, line: &str) {
        let mut stream = TcpStream::connect((self.address, FAULTS)).expect("the fault port listens");
        writeln!(stream, "{line}").expect("it reads");
        let mut answer = String::new();
        BufReader::new(stream).read_line(&mut answer).expect("it answers");
        assert!(answer.starts_with("ok"), "{line}: {answer}");
    }
}

fn signal(process: &Option<Process>, name: &str) {
    process.as_ref().expect("it runs").signal(name);
}

/// `fault` at a random moment, again and again; the arm has to come to rest after each.
fn rounds_of(name: &str, mut fault: impl FnMut(&mut Scene), mut mend: impl FnMut(&mut Scene)) {
    let mut scene = Scene::following();
    let (mut moments, mut times) = (Moments::new(), Vec::new());
    for round in 0..rounds(SHARE) {
        moments.wait(1500);
        let from = scene.watcher.moves();
        fault(&mut scene);
        times.push(1e3 * (scene.watcher.rests() - from).max(0.0));
        scene.watcher.judge(&format!("{name}, round {round}"));
        mend(&mut scene);
        scene.complete();
    }
    say_times(name, times);
}

/// Of all rounds, every test here takes an eighth.
const SHARE: u32 = 8;

#[test]
fn ur_bridge_killed() {
    rounds_of(
        "ur bridge killed",
        |scene| {
            scene.bridge.take().expect("a bridge").kill();
        },
        |_| {},
    );
}

#[test]
fn ur_bridge_stands_still() {
    let stop = |scene: &mut Scene| signal(&scene.bridge, "-STOP");
    rounds_of("ur bridge stands still", stop, |scene| signal(&scene.bridge, "-CONT"));
}

#[test]
fn ur_daemon_killed() {
    rounds_of(
        "ur daemon killed",
        |scene| {
            scene.daemon.take().expect("a daemon").kill();
        },
        |_| {},
    );
}

#[test]
fn ur_daemon_stands_still() {
    let stop = |scene: &mut Scene| signal(&scene.daemon, "-STOP");
    rounds_of("ur daemon stands still", stop, |scene| signal(&scene.daemon, "-CONT"));
}

#[test]
fn ur_player_killed() {
    rounds_of(
        "ur player killed",
        |scene| {
            scene.player.take().expect("a player").kill();
        },
        |_| {},
    );
}

#[test]
fn ur_network_cut() {
    rounds_of("ur network cut", |scene| scene.order("cut 1"), |_| {});
}
