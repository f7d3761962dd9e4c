//! The bridge over sockets, against the stand-in.

mod base_frame;
mod fake;

use std::io::{Read, Write};
use std::net::{SocketAddr, TcpListener};
use std::thread;
use std::time::{Duration, Instant};

use foretrace_client::wire::command_flags;
use foretrace_client::{JOINTS, JointCommand, Mode, RobotMode, monotonic_now_ns};
use foretrace_config::Config;

use super::address::Addresses;
use super::examine::{self, Grade, Port, RegisterFact};
use super::line;
use super::link::{Link, MeasuredJoints};
use super::pilot::Pilot;
use super::probe::{inspect, is_simulated, probe};
use super::program::BridgeProgram;
use super::reaction::Phase;
use super::reason::HaltReason;
use super::registers::RegisterMap;
use crate::rtde::RtdeClient;
use fake::Fake;

const LONG: Duration = Duration::from_secs(20);
const SOON: Duration = Duration::from_millis(500);

fn addresses(fake: &Fake) -> Addresses {
    let nobody = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
    Addresses { rtde: fake.rtde, primary: fake.primary, dashboard: nobody }
}

fn config() -> Config {
    // Valid for long: this machine may be busy, and what is tested is not its speed.
    Config::parse("preset = \"ur5e\"\n[loop]\nvalid_periods = 50\n", "t.toml", ".").unwrap()
}

fn fake() -> Fake {
    Fake::at(config().robot().home)
}

/// A bridge, and a daemon that commands one joint to swing slowly.
struct Scene {
    fake: Fake,
    link: Link,
    home: [f64; JOINTS],
    commanding: bool,
    begins: bool,
    newest: Option<MeasuredJoints>,
}

impl Scene {
    fn new() -> Self {
        let fake = fake();
        let config = config();
        let registers = RegisterMap::at(24).unwrap();
        let program =
            BridgeProgram::new(&config.settings().robot.ur, &config.robot().limits, registers, 0.002);
        let mut pilot = Pilot::new(config.robot().limits, 0.002, 5.0, None, 1 << 40);
        pilot.settings_agree(Some(true));
        let judging = config.clone();
        let inspect = Box::new(move |addresses: &Addresses| inspect(addresses, &judging));
        let link = Link::new(addresses(&fake), program, pilot, false, inspect).unwrap();
        let home = config.robot().home;
        Self { fake, link, home, commanding: false, begins: false, newest: None }
    }

    fn turn(&mut self) {
        let (commanding, begins, home) = (self.commanding, self.begins, self.home);
        let mut taken = false;
        let measured = self.link.turn(&mut |pilot| {
            if commanding {
                taken = true;
                pilot.take(&command(home, begins), monotonic_now_ns());
            }
        });
        if measured.is_some() {
            self.newest = measured;
            self.begins &= !taken;
        }
    }

    fn until(&mut self, wanted: impl Fn(&Self) -> bool) {
        let begin = Instant::now();
        while !wanted(self) {
            assert!(begin.elapsed() < LONG, "{:?} {:?}", self.link.phase(), self.link.reason());
            self.turn();
        }
    }

    fn ready(&mut self) {
        self.until(|scene| scene.link.phase() == Phase::Ready);
    }

    fn follow(&mut self) {
        self.ready();
        (self.commanding, self.begins) = (true, true);
        self.until(|scene| {
            scene.following() && scene.fake.with(|s| s.values["output_int_register_25"][0] == 2.0)
        });
    }

    fn following(&self) -> bool {
        matches!(self.link.phase(), Phase::Following { .. })
    }
}

fn command(q: [f64; JOINTS], begins: bool) -> JointCommand {
    let now = monotonic_now_ns();
    let mut command = JointCommand {
        tick: 7,
        valid_until_ns: now + 100_000_000,
        q,
        mode: Mode::Following.into(),
        flags: command_flags::ENABLED | if begins { command_flags::BEGINS } else { 0 },
        ..JointCommand::default()
    };
    command.header.stamp_ns = now + 2_000_000;
    command
}

#[test]
fn program_is_sent_and_the_arm_follows_once_armed() {
    let mut scene = Scene::new();
    scene.ready();
    assert_eq!(scene.fake.with(|state| state.programs.len()), 1);
    scene.follow();
    scene.home[5] += 0.004;
    scene.until(|scene| scene.fake.with(|state| (state.values["actual_q"][5] - 0.004).abs() < 1e-12));
    let state = scene.newest.unwrap().state;
    assert_eq!((state.command_tick, state.robot_mode), (7, u32::from(RobotMode::Running)));
    let report = scene.link.report();
    assert!(report.states > 2 && report.following_cycles > 0 && report.round_trip_ms > 0.0, "{report:?}");
    scene.link.end();
    assert_eq!(scene.link.report().reason, None);
    let begin = Instant::now();
    while scene.fake.with(|state| state.values["runtime_state"][0]) != 1.0 {
        assert!(begin.elapsed() < LONG, "the program was not told to end");
        thread::sleep(Duration::from_millis(1));
    }
}

#[test]
fn a_connection_that_is_cut_comes_back_and_waits_for_an_arming() {
    let mut scene = Scene::new();
    scene.follow();
    scene.fake.with(|state| state.cut = true);
    scene.until(|scene| scene.link.reason() == Some(HaltReason::ConnectionLost));
    assert!(!scene.following());
    scene.commanding = false;
    scene.ready();
    // Commands that do not begin are not obeyed.
    scene.commanding = true;
    (0..50).for_each(|_| scene.turn());
    assert_eq!(scene.link.phase(), Phase::Ready);
    scene.begins = true;
    scene.until(Scene::following);
    assert_eq!(scene.link.report().connections, 2);
}

#[test]
fn behind_a_new_connection_everything_is_judged_again_before_anything_may_move() {
    let mut scene = Scene::new();
    scene.follow();
    assert_eq!(scene.link.floor_m(), None, "calibrated");
    // Behind the cut stands another installation.
    scene.fake.with(|state| {
        state.values.insert("tcp_offset".to_owned(), vec![0.0, 0.0, 0.2, 0.0, 0.0, 0.0]);
        state.cut = true;
    });
    scene.until(|scene| scene.link.reason() == Some(HaltReason::DoesNotFit));
    let (_, detail) = scene.link.news().unwrap();
    assert!(detail.unwrap().contains("50.0 mm away"));
    assert_eq!(scene.link.phase(), Phase::Away);
    // The tool is put right, and the arm is another one of the same model.
    scene.fake.with(|state| {
        state.values.insert("tcp_offset".to_owned(), vec![0.0, 0.0, 0.15, 0.0, 0.0, 0.0]);
        state.higher_m = 4e-3;
    });
    scene.commanding = false;
    scene.ready();
    let content = config().settings().robot.ur.uncalibrated_height_m;
    assert!((scene.link.floor_m().unwrap() - (content + 4e-3)).abs() < 1e-5, "{:?}", scene.link.floor_m());
}

#[test]
fn a_controller_that_falls_silent_is_given_up() {
    let mut scene = Scene::new();
    scene.follow();
    scene.fake.with(|state| state.mute = true);
    scene.until(|scene| scene.link.phase() == Phase::Away);
    assert_eq!(scene.link.reason(), Some(HaltReason::ConnectionLost));
    let (reason, detail) = scene.link.news().unwrap();
    assert_eq!((reason, detail.as_deref()), (HaltReason::ConnectionLost, Some("no state for a second")));
    assert!(scene.link.news().is_none(), "told once");
}

#[test]
fn a_protective_stop_takes_the_permit_back() {
    let mut scene = Scene::new();
    scene.follow();
    scene.fake.set("safety_mode", 3.0);
    scene.until(|scene| scene.link.reason() == Some(HaltReason::ProtectiveStop));
    scene.until(|scene| scene.fake.with(|state| state.values["input_int_register_25"][0] == 0.0));
    assert_eq!(scene.link.report().stops.get("protective stop"), Some(&1));
}

#[test]
fn registers_of_somebody_else_are_reported_and_waited_for() {
    let mut scene = Scene::new();
    scene.fake.with(|state| state.in_use.push("input_double_register_30".to_owned()));
    scene.until(|scene| scene.link.reason() == Some(HaltReason::InUse));
    let (_, detail) = scene.link.news().unwrap();
    assert!(detail.unwrap().contains("input_double_register_30"));
    scene.fake.with(|state| state.in_use.clear());
    scene.ready();
}

/// A dashboard that answers every command with `version`, once.
fn dashboard(version: &'static str) -> SocketAddr {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap();
    std::thread::spawn(move || {
        let (mut stream, _) = listener.accept().unwrap();
        stream.write_all(b"Connected: Universal Robots Dashboard Server\n").unwrap();
        let mut asked = [0; 64];
        let _ = stream.read(&mut asked);
        let _ = stream.write_all(format!("{version}\n").as_bytes());
    });
    address
}

#[test]
fn only_a_controller_of_this_machine_that_says_so_is_simulated() {
    let fake = fake();
    let of = |dashboard| is_simulated(&Addresses { dashboard, ..addresses(&fake) });
    assert!(of(dashboard("URSoftware 5.11.1.108318 (simulated)")));
    assert!(!of(dashboard("URSoftware 5.11.1.108318 (Mar 02 2021)")));
    assert!(!of(dashboard("(simulated) 5.11")));
    assert!(!is_simulated(&addresses(&fake)), "no dashboard");
    let elsewhere = SocketAddr::from(([192, 0, 2, 1], 30004));
    let there = Addresses { rtde: elsewhere, dashboard: dashboard("5.11 (simulated)"), ..addresses(&fake) };
    assert!(!is_simulated(&there), "of another machine");
    let mut scene = Scene::new();
    scene.ready();
    assert!(!scene.link.is_simulated());
}

#[test]
fn a_closed_port_is_a_service_that_is_off() {
    let fake = fake();
    let mut closed = addresses(&fake);
    closed.rtde = closed.dashboard;
    let error = RtdeClient::connect(closed.rtde, SOON).unwrap_err();
    assert_eq!(line::reason(&error), HaltReason::ServiceOff);
    assert!(probe(&closed).unwrap_err().to_string().contains("RTDE service is off"));
}

#[test]
fn probing_asks_for_less_where_the_version_knows_less() {
    let fake = fake();
    let found = probe(&addresses(&fake)).unwrap();
    assert_eq!((found.version.major, found.installation.payload_kg), (5, Some(0.4)));
    assert_eq!(found.installation.tcp_m, Some([0.0, 0.0, 0.15]));
    assert_eq!(found.embedded(), Some("ur5e"));
    assert!(found.deviation(&config()).unwrap().most_mm < 0.01);
    fake.with(|state| state.not_found = vec!["payload".to_owned()]);
    let found = probe(&addresses(&fake)).unwrap();
    assert_eq!((found.installation.payload_kg, found.installation.tcp_m), (None, Some([0.0, 0.0, 0.15])));
    fake.with(|state| state.version = [10, 7, 0, 0]);
    assert!(probe(&addresses(&fake)).unwrap_err().to_string().contains("PolyScope X"));
}

#[test]
fn examination_measures_the_line_and_names_what_is_in_use() {
    let fake = fake();
    let config = config();
    let facts = examine::gather(&addresses(&fake), &config, SOON, &|| false);
    let timing = facts.timing.clone().unwrap();
    assert!(timing.states > 20 && timing.round_trips.iter().sum::<u64>() > 10, "{timing:?}");
    assert_eq!(facts.registers, Some(RegisterFact::Free));
    let judged = examine::judge(&facts, &config);
    let bad: Vec<_> = judged.iter().filter(|finding| finding.grade == Grade::Bad).map(|f| f.name).collect();
    for name in ["robot", "version", "safety", "program", "primary (30001)", "rtde (30004)", "registers"] {
        assert!(!bad.contains(&name), "{name}: {judged:?}");
    }
    assert!(facts.deviation.unwrap().most_mm < 0.01);
    assert_eq!(facts.arm.as_deref(), Some("a UR5e or UR7e"));

    assert_eq!(facts.rtde, Port::Open("protocol 2".to_owned()));

    fake.with(|state| {
        state.in_use.push("input_int_register_25".to_owned());
        state.protocol = 1;
    });
    let facts = examine::gather(&addresses(&fake), &config, Duration::from_millis(50), &|| false);
    assert_eq!(facts.rtde, Port::Open("protocol 1".to_owned()));
    assert_eq!(facts.registers, Some(RegisterFact::InUse(vec!["input_int_register_25".to_owned()])));
}
