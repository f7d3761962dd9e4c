//! Controller, bridge, daemon and player of one test, and its watcher.

use std::io::{BufRead, BufReader, Write};
use std::net::{Ipv4Addr, SocketAddrV4, TcpStream};
use std::path::PathBuf;
use std::sync::atomic::{AtomicU8, Ordering};
use std::time::{Duration, Instant};

use foretrace_tests::{PATIENT, Process, World, told, until};

use super::relay::relay;
use super::watcher::Watcher;
use crate::PROGRAM;
use crate::chaos::scene::PLAY;

/// Commands live as long as the way to a CB3 takes.
const VALID: [&str; 2] = ["--set", "loop.valid_periods=12"];
const PATIENCE: Duration = Duration::from_secs(5);
/// From here on an arm has something to brake \[rad/s\].
const FAST_RADPS: f64 = 0.1;
/// Between two clients that watch the same controller \[s\].
const READER_LATE_S: f64 = 0.1;
/// Sooner than the patience of tests is over, so that it can be told why not.
const FOLLOWS_WITHIN: Duration = Duration::from_secs(55);
const RTDE: u16 = 30004;
const FAULTS: u16 = 30090;

#[derive(Debug, Clone, Copy)]
pub(super) enum Series {
    Cb3,
    E,
}

impl Series {
    pub(super) const fn preset(self) -> &'static str {
        match self {
            Self::Cb3 => "ur5",
            Self::E => "ur5e",
        }
    }

    pub(super) const fn rate_hz(self) -> u32 {
        match self {
            Self::Cb3 => 125,
            Self::E => 500,
        }
    }

    const fn option(self) -> &'static str {
        match self {
            Self::Cb3 => "cb3",
            Self::E => "e",
        }
    }
}

pub(super) struct Scene {
    pub(super) world: World,
    series: Series,
    pub(super) address: Ipv4Addr,
    controller: Process,
    pub(super) daemon: Option<Process>,
    pub(super) bridge: Option<Process>,
    pub(super) player: Option<Process>,
    /// Somebody else.
    pub(super) watcher: Watcher,
    /// Reads what the program does, where the client of somebody else cannot.
    reader: Option<Watcher>,
}

impl Scene {
    pub(super) fn following(series: Series) -> Self {
        let world = World::new(PROGRAM);
        // Ports are fixed, as a real one's: tests side by side need addresses of their own.
        static COUNT: AtomicU8 = AtomicU8::new(0);
        let [_, _, b, c] = std::process::id().to_be_bytes();
        let count = COUNT.fetch_add(1, Ordering::Relaxed) % 40;
        let [address, eyes] = [210, 170].map(|a| Ipv4Addr::new(127, a + count, b, 1 + c % 250));
        let words =
            ["ur-sim", "--series", series.option(), "--bind", &address.to_string()].map(str::to_owned);
        let mut controller = world.start_plain(&words);
        until("the controller listens", || {
            controller.expect_alive();
            TcpStream::connect_timeout(&SocketAddrV4::new(address, FAULTS).into(), PATIENCE).ok()
        });
        let own = SocketAddrV4::new(eyes, RTDE);
        relay(own, SocketAddrV4::new(address, RTDE));
        let venv = std::env::var_os("FORETRACE_UR_VENV").map(PathBuf::from);
        let reader = venv.is_some().then(|| Watcher::open(own, series, None));
        let watcher = Watcher::open(own, series, venv);
        let (daemon, bridge, player) = (None, None, None);
        let mut scene = Self { world, series, address, controller, daemon, bridge, player, watcher, reader };
        scene.restart_missing();
        scene.follow();
        scene
    }

    fn start_bridge(&mut self) {
        let robot = self.address.to_string();
        let words = ["arm", "ur", "--wait", "30", "--robot", &robot, "--preset", self.series.preset()];
        self.bridge = Some(self.world.start(0, &[&words[..], &VALID, &PATIENT].concat()));
    }

    /// Starts whoever is missing; arms nothing.
    pub(super) fn restart_missing(&mut self) {
        if self.daemon.is_none() {
            let options = [&["--preset", self.series.preset()][..], &VALID, &PATIENT].concat();
            self.daemon = Some(self.world.daemon_with(0, &options));
        }
        if self.bridge.is_none() {
            self.start_bridge();
        }
        if self.player.is_none() {
            self.player = Some(self.world.start(0, &PLAY));
        }
    }

    /// Arms until the arm follows.
    pub(super) fn follow(&mut self) {
        let (begin, mut last) = (Instant::now(), String::new());
        until("the arm follows", || {
            assert!(begin.elapsed() < FOLLOWS_WITHIN, "the arm does not follow: {last}");
            self.controller.expect_alive();
            // The place of a dead peer is free once a live one has cleaned up.
            if self.player.as_mut().is_some_and(|player| player.ended().is_some()) {
                self.player = Some(self.world.start(0, &PLAY));
            }
            if let Some((status, text)) = self.bridge.as_mut().and_then(Process::ended) {
                let passing = ["slots are in use", "slot is in use", "no daemon running", "another program"];
                assert!(passing.iter().any(|words| text.contains(words)), "{status}: {text}");
                self.start_bridge();
            }
            let asked = self.world.run(0, &["request", "arm"]);
            assert!(matches!(asked.status.code(), Some(0 | 1 | 3 | 4)), "{}", told(&asked));
            let moves = self.watcher.moving(0.02).is_some();
            let status = self.world.status(0);
            last = format!(
                "moves: {moves}, {}, {}, {} {}",
                told(&asked),
                status["mode"],
                status["stop"],
                status["arm"]
            );
            (moves && status["mode"] == "following").then_some(())
        });
    }

    /// Waits until the arm is fast, led by targets; returns when that was on the controller's clock \[s\]. On
    /// a machine that keeps no 10 ms an e-Series stops by itself: then it is armed again.
    pub(super) fn moves(&mut self) -> f64 {
        loop {
            let began = Instant::now();
            while began.elapsed() < Duration::from_secs(2) {
                let follows = self.reader.as_ref().unwrap_or(&self.watcher).follows();
                if let Some(t) = self.watcher.moving(FAST_RADPS).filter(|_| follows) {
                    return t;
                }
                std::thread::sleep(Duration::from_millis(2));
            }
            self.follow();
        }
    }

    /// What was seen before `from_s` counts no more: both as [`Scene::moves`] found it.
    pub(super) fn forget(&self, from_s: f64) {
        self.watcher.forget(from_s);
        if let Some(reader) = &self.reader {
            // It may be behind the other one.
            reader.forget(from_s - READER_LATE_S);
        }
    }

    /// Judges what was seen since; `alone`: nobody but the program on the controller brought the arm to rest.
    pub(super) fn judge(&self, when: &str, alone: bool) {
        self.watcher.judge(when);
        self.reader.as_ref().unwrap_or(&self.watcher).judge_program(when, alone);
    }

    /// A line to the controller's fault port.
    pub(super) fn order(&self, line: &str) {
        let mut stream = TcpStream::connect((self.address, FAULTS)).expect("the fault port listens");
        writeln!(stream, "{line}").expect("it reads");
        let mut answer = String::new();
        BufReader::new(stream).read_line(&mut answer).expect("it answers");
        assert!(answer.starts_with("ok"), "{line}: {answer}");
    }
}

pub(super) fn signal(process: &Option<Process>, name: &str) {
    process.as_ref().expect("it runs").signal(name);
}
