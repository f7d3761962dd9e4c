//! The bridge and the simulated controller over real sockets, watched by an RTDE client of somebody else.
//!
//! Contract: a busy machine may hold anybody up, so nothing here says how soon; what is asserted is that the
//! arm stops, how hard, and what it takes to go on.

use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

use foretrace_client::wire::command_flags;
use foretrace_client::{JOINTS, JointCommand, Mode, monotonic_now_ns};
use foretrace_config::files::Files;
use foretrace_config::{Config, Draft, presets};

use foretrace_ur::bridge::address::Addresses;
use foretrace_ur::bridge::link::Link;
use foretrace_ur::bridge::pilot::Pilot;
use foretrace_ur::bridge::probe::inspect;
use foretrace_ur::bridge::program::BridgeProgram;
use foretrace_ur::bridge::reaction::Phase;
use foretrace_ur::bridge::reason::HaltReason;
use foretrace_ur::bridge::registers::RegisterMap;
use foretrace_ur::rtde::{RtdeClient, RtdeValue};
use foretrace_ur_sim::{Controller, ControllerOptions, Series, Service};

const LONG: Duration = Duration::from_secs(60);
/// Of the CB3, the only one that moves here.
const CYCLE_S: f64 = 0.008;

/// Somebody else, who sees joints and times.
struct Watcher {
    client: RtdeClient,
    seen: Vec<(f64, [f64; JOINTS])>,
}

impl Watcher {
    fn look(&mut self) {
        while let Ok(Some(package)) = self.client.receive(Duration::from_millis(1)) {
            let [RtdeValue::Double(t), RtdeValue::Vector6d(q)] = package.values[..] else { panic!() };
            self.seen.push((t, q));
            if self.seen.len().is_multiple_of(8) {
                return;
            }
        }
    }

    fn rests(&self) -> bool {
        let Some((_, now)) = self.seen.last() else { return false };
        let before = self.seen.iter().rev().nth(12);
        before.is_some_and(|(_, before)| now.iter().zip(before).all(|(a, b)| (a - b).abs() < 1e-7))
    }

    /// Largest acceleration between states that follow each other \[rad/s²\].
    fn most_acceleration(&self) -> f64 {
        let follows = |a: f64, b: f64| ((b - a) - CYCLE_S).abs() < 1e-6;
        let triples = self.seen.windows(3).filter(|w| follows(w[0].0, w[1].0) && follows(w[1].0, w[2].0));
        triples
            .flat_map(|w| {
                (0..JOINTS).map(|j| (w[2].1[j] - 2.0 * w[1].1[j] + w[0].1[j]).abs() / CYCLE_S.powi(2))
            })
            .fold(0.0, f64::max)
    }
}

struct Scene {
    controller: Controller,
    series: Series,
    link: Option<Link>,
    watcher: Watcher,
    config: Config,
    commanding: bool,
    begins: bool,
    since_ns: u64,
    middle: [f64; JOINTS],
}

impl Scene {
    fn new(series: Series) -> Self {
        let options = ControllerOptions { ephemeral_ports: true, ..ControllerOptions::new(series) };
        let controller = Controller::start(options).unwrap();
        let preset = if series == Series::E { "ur5e" } else { "ur5" };
        let text = format!("preset = \"{preset}\"\n[loop]\nvalid_periods = 50\n");
        let config = Config::parse(&text, "t.toml", ".").unwrap();
        let mut client = RtdeClient::connect(controller.address(Service::Rtde).unwrap(), LONG).unwrap();
        client.set_up_outputs(&["timestamp", "actual_q"], 125.0).unwrap();
        client.start().unwrap();
        let watcher = Watcher { client, seen: Vec::new() };
        let mut scene = Self {
            controller,
            series,
            link: None,
            watcher,
            config,
            commanding: false,
            begins: false,
            since_ns: 0,
            middle: options.q,
        };
        scene.start_bridge(11);
        scene
    }

    fn start_bridge(&mut self, seed: u64) {
        let at = |service: Service| self.controller.address(service).unwrap();
        let addresses = Addresses {
            rtde: at(Service::Rtde),
            primary: at(Service::Primary),
            dashboard: at(Service::Dashboard),
        };
        let (limits, cycle_s) = (self.config.robot().limits, self.series.cycle_s());
        let section = &self.config.settings().robot.ur;
        let program = BridgeProgram::new(section, &limits, RegisterMap::at(24).unwrap(), cycle_s);
        let mut pilot = Pilot::new(limits, cycle_s, 0.1, None, seed << 24);
        pilot.settings_agree(Some(true));
        self.link = Some(Link::new(addresses, program, pilot, true, Box::new(|_| Ok(None))).unwrap());
    }

    fn turn(&mut self) {
        let (commanding, begins, since_ns, middle) =
            (self.commanding, self.begins, self.since_ns, self.middle);
        let mut taken = false;
        if let Some(link) = &mut self.link {
            let measured = link.turn(&mut |pilot| {
                if commanding {
                    taken = true;
                    pilot.take(&swing(middle, since_ns, begins), monotonic_now_ns());
                }
            });
            self.begins &= !taken;
            if measured.is_some_and(|measured| measured.state.robot_mode != 8) {
                // As the daemon does where the arm may not move.
                self.commanding = false;
            }
        }
        self.watcher.look();
    }

    fn until(&mut self, wanted: impl Fn(&Self) -> bool) {
        let begin = Instant::now();
        while !wanted(self) {
            let link = self.link.as_ref().map(|link| (link.phase(), link.reason()));
            assert!(begin.elapsed() < LONG, "{link:?} {}", self.controller.status());
            self.turn();
        }
    }

    fn ready(&mut self) {
        self.until(|scene| scene.link.as_ref().is_some_and(|link| link.phase() == Phase::Ready));
    }

    /// Arms; the arm swings soon after.
    fn moving(&mut self) {
        self.ready();
        // A machine that holds us up may stop the arm: then somebody arms again.
        let begin = Instant::now();
        loop {
            assert!(begin.elapsed() < LONG);
            if !self.commanding {
                self.ready();
                self.middle = self.watcher.seen.last().map_or(self.middle, |(_, q)| *q);
                (self.commanding, self.begins, self.since_ns) =
                    (true, true, monotonic_now_ns() + 300_000_000);
            }
            self.turn();
            let follows =
                self.link.as_ref().is_some_and(|link| matches!(link.phase(), Phase::Following { .. }));
            if follows && monotonic_now_ns() > self.since_ns + 400_000_000 && !self.watcher.rests() {
                return;
            }
        }
    }

    fn stopped_inside_its_limits(&mut self, when: &str) {
        self.watcher.seen.clear();
        self.until(|scene| scene.watcher.rests());
        let most = self.watcher.most_acceleration();
        assert!(most < 42.0, "{when}: {most} rad/s²");
    }

    fn reason(&self) -> Option<HaltReason> {
        self.link.as_ref().and_then(Link::reason)
    }
}

fn swing(middle: [f64; JOINTS], since_ns: u64, begins: bool) -> JointCommand {
    let now_ns = monotonic_now_ns();
    let t = now_ns.saturating_sub(since_ns) as f64 * 1e-9;
    let w = 3.0;
    let (mut q, mut qd) = (middle, [0.0; JOINTS]);
    q[5] += 0.2 * (1.0 - (w * t).cos());
    qd[5] = 0.2 * w * (w * t).sin();
    let mut command = JointCommand {
        tick: 1,
        valid_until_ns: now_ns + 100_000_000,
        q,
        qd,
        mode: Mode::Following.into(),
        flags: command_flags::ENABLED | if begins { command_flags::BEGINS } else { 0 },
        ..JointCommand::default()
    };
    command.header.stamp_ns = now_ns;
    command
}

#[test]
fn a_bridge_that_dies_or_stands_still_leaves_an_arm_that_stops() {
    let mut scene = Scene::new(Series::Cb3);
    scene.moving();
    // Dies: its sockets close.
    scene.link = None;
    scene.stopped_inside_its_limits("death");
    scene.commanding = false;
    scene.start_bridge(12);
    scene.moving();
    // Stands still: its sockets stay open, and nobody sends counters.
    let asleep = scene.link.take();
    scene.stopped_inside_its_limits("stand-still");
    scene.link = asleep;
    scene.until(|scene| !scene.commanding);
    assert!(
        matches!(scene.reason(), Some(HaltReason::CountersLate | HaltReason::StoppedByWatchdog)),
        "{:?}",
        scene.reason()
    );
    scene.moving();
}

#[test]
fn a_network_that_is_cut_and_a_controller_that_reboots_are_come_back_from() {
    let mut scene = Scene::new(Series::Cb3);
    scene.moving();
    scene.controller.obey("cut 3");
    scene.until(|scene| scene.reason().is_some());
    scene.commanding = false;
    scene.ready();
    scene.moving();
    scene.controller.obey("reboot");
    scene.until(|scene| scene.reason().is_some());
    scene.commanding = false;
    scene.until(|scene| scene.reason() == Some(HaltReason::NotRunning));
}

#[test]
fn local_control_and_a_service_that_is_off_are_told_apart() {
    // Only the e-Series tells remote from local control.
    let mut scene = Scene::new(Series::E);
    scene.controller.obey("remote off");
    scene.until(|scene| scene.reason() == Some(HaltReason::LocalControl));
    scene.controller.obey("remote on");
    scene.ready();
    scene.controller.obey("service rtde off");
    scene.until(|scene| scene.reason() == Some(HaltReason::ServiceOff));
    scene.controller.obey("service rtde on");
    scene.ready();
}

/// The embedded UR5 behind ROS's `base_link`, which is turned by half a turn against the controller's frame.
fn behind_ros_base_link(more: &str) -> Config {
    let turned = "<link name=\"base_link\"/><joint name=\"turn\" type=\"fixed\"><parent link=\"base_link\"/><child \
                  link=\"base\"/><origin rpy=\"0 0 3.141592653589793\"/></joint></robot>";
    let urdf =
        presets::robot("ur5").unwrap().replace("\"base_link\"", "\"base\"").replace("</robot>", turned);
    let text = format!(
        "preset = \"ur5\"\n[robot]\nurdf = \"arm.urdf\"\ntool_m = [0.0, 0.0, 0.15]\nhome_rad = [0.0, -1.3, 1.8, -2.0708, \
         -1.5708, 0.0]\n{more}"
    );
    let files = Files::Only(Arc::new([(PathBuf::from("/arm/arm.urdf"), urdf.into_bytes())].into()));
    Draft::text(&text, "t.toml", "/arm").files(files).finish().unwrap()
}

#[test]
fn a_base_frame_that_is_turned_is_refused_with_what_to_write_and_then_taken() {
    let options = ControllerOptions { ephemeral_ports: true, ..ControllerOptions::new(Series::Cb3) };
    let controller = Controller::start(options).unwrap();
    controller.obey("tcp 0 0 0.15 0 0 0");
    let at = |service: Service| controller.address(service).unwrap();
    let addresses = Addresses {
        rtde: at(Service::Rtde),
        primary: at(Service::Primary),
        dashboard: at(Service::Dashboard),
    };
    let (reason, words) = inspect(&addresses, &behind_ros_base_link("")).unwrap_err();
    assert_eq!(reason, HaltReason::DoesNotFit);
    assert!(words.contains("turned by 180 degrees about z") && !words.contains("another model"), "{words}");
    assert!(words.contains("`base_turned = true` under [robot.ur]"), "{words}");
    assert!(words.contains("`base_link = \"base\"` under [robot]"), "{words}");
    // No more than a calibrated arm is asked for.
    let taken = inspect(&addresses, &behind_ros_base_link("[robot.ur]\nbase_turned = true\n"));
    assert_eq!(taken, Ok(None));
}
