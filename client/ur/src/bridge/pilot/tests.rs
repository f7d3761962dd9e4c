//! The bridge against a controller in ten lines that reads registers a cycle late and never fails.

use super::*;
use foretrace_client::Mode;
use foretrace_config::Config;
use proptest::prelude::*;
use std::sync::LazyLock;

const CYCLE_NS: u64 = 8_000_000;
const START_NS: u64 = 90_000_000_000;
/// Longer than the way to the controller and two periods of the daemon.
const VALID_NS: u64 = 20_000_000;

struct Scene {
    pilot: Pilot,
    package: Package,
    cycle: u64,
    /// Inputs under way to the controller.
    under_way: Option<RegisterInputs>,
    home: [f64; JOINTS],
}

fn scene(floor: Option<f64>) -> Scene {
    static CONFIG: LazyLock<Config> = LazyLock::new(|| Config::preset("ur5").unwrap());
    let config = &CONFIG;
    let (robot, plane) = (config.robot(), &config.settings().plane);
    let floor = floor.map(|height_m| Floor {
        chain: robot.chain.clone(),
        origin: plane.origin_m.into(),
        normal: plane.rotation() * Vector3::z(),
        height_m,
    });
    let mut pilot = Pilot::new(robot.limits, 0.008, 0.1, floor, 12345);
    pilot.connected();
    pilot.settings_agree(Some(true));
    let package = Package {
        timestamp: 50.0,
        q: robot.home,
        qd: [0.0; JOINTS],
        current: [0.1; JOINTS],
        robot_mode: 7,
        safety_mode: 1,
        runtime_state: 1,
        speed_scaling: 1.0,
        target_speed_fraction: 1.0,
        answer: ProgramAnswer::default(),
    };
    Scene { pilot, package, cycle: 0, under_way: None, home: robot.home }
}

impl Scene {
    fn now_ns(&self) -> u64 {
        START_NS + self.cycle * CYCLE_NS
    }

    fn cycle(&mut self) -> CycleResult {
        self.cycle += 1;
        self.package.timestamp = 50.0 + self.cycle as f64 * 0.008;
        if let Some(inputs) = self.under_way.take() {
            let answer = &mut self.package.answer;
            answer.echo = inputs.counter;
            if inputs.permit > 0 {
                (answer.state, answer.used) = (2, inputs.permit);
                self.package.q = inputs.q;
            } else if answer.state == 2 {
                answer.state = 1;
            }
        }
        let outcome = self.pilot.cycle(&self.package, self.now_ns() + 200_000).unwrap();
        if let Some(session) = outcome.upload {
            self.package.runtime_state = 2;
            self.package.answer = ProgramAnswer { session, state: 1, ..ProgramAnswer::default() };
        }
        self.under_way = Some(outcome.inputs);
        outcome
    }

    fn cycles(&mut self, count: usize) {
        (0..count).for_each(|_| {
            self.cycle();
        });
    }

    /// The daemon's command of this instant: joint 0 moves at `speed` \[rad/s\] since `since_ns`.
    fn command(&mut self, speed: f64, since_ns: u64, begins: bool) {
        let stamp_ns = self.now_ns() + 2_000_000;
        let mut q = self.home;
        q[0] += speed * stamp_ns.saturating_sub(since_ns) as f64 * 1e-9;
        let mut qd = [0.0; JOINTS];
        qd[0] = speed;
        let mut command = JointCommand {
            tick: self.cycle,
            valid_until_ns: stamp_ns + VALID_NS,
            q,
            qd,
            mode: Mode::Following.into(),
            flags: command_flags::ENABLED | if begins { command_flags::BEGINS } else { 0 },
            ..JointCommand::default()
        };
        command.header.stamp_ns = stamp_ns;
        self.pilot.take(&command, self.now_ns());
    }

    fn follow(&mut self) {
        self.cycles(100);
        let since = self.now_ns();
        self.command(0.0, since, true);
        for _ in 0..50 {
            self.cycle();
            self.command(0.0, since, false);
        }
    }
}

#[test]
fn program_is_sent_once_and_the_arm_is_idle_until_it_runs() {
    let mut scene = scene(None);
    let uploads = (0..200).filter(|_| scene.cycle().upload.is_some()).count();
    assert_eq!(uploads, 1);
    assert_eq!(scene.cycle().state.robot_mode, u32::from(RobotMode::Running));
    let mut stopped = scene.package;
    stopped.runtime_state = 1;
    scene.package = stopped;
    assert_eq!(scene.cycle().state.robot_mode, u32::from(RobotMode::Idle));
}

#[test]
fn a_moving_command_is_sent_as_it_will_be_when_the_controller_uses_it() {
    let mut scene = scene(None);
    scene.follow();
    let since = scene.now_ns();
    for _ in 0..30 {
        scene.command(0.5, since, false);
        let outcome = scene.cycle();
        // Used a cycle after the state that it answers.
        let used_ns = scene.now_ns() + CYCLE_NS;
        let wanted = scene.home[0] + 0.5 * (used_ns - since) as f64 * 1e-9;
        let sent = outcome.inputs.q[0];
        // The line's own 0.2 ms are part of the mapped instant.
        assert!((sent - wanted).abs() < 0.5 * 0.35e-3, "{sent} {wanted}");
        assert!(outcome.inputs.permit > 0);
    }
    assert_eq!(scene.pilot.trips.usual(), 1);
    assert_eq!(scene.pilot.counts.skipped, 0);
}

#[test]
fn a_daemon_that_falls_silent_leaves_a_braking_arm_not_a_jumping_one() {
    let mut scene = scene(None);
    scene.follow();
    let since = scene.now_ns();
    let mut last = 0.0;
    for _ in 0..30 {
        scene.command(1.0, since, false);
        last = scene.cycle().inputs.q[0];
    }
    let mut speeds = Vec::new();
    for _ in 0..60 {
        let q = scene.cycle().inputs.q[0];
        speeds.push((q - last) / 0.008);
        last = q;
    }
    // 20 rad/s² is 0.16 rad/s per cycle.
    assert!(speeds.windows(2).all(|pair| (pair[1] - pair[0]).abs() < 0.17), "{speeds:?}");
    assert!(speeds.last().unwrap().abs() < 1e-9);
}

#[test]
fn a_command_far_away_takes_the_permit_back() {
    let mut scene = scene(None);
    scene.follow();
    let home = scene.home;
    scene.home[2] += 0.4;
    let since = scene.now_ns();
    scene.command(0.0, since, false);
    let outcome = scene.cycle();
    assert_eq!((outcome.inputs.permit, outcome.inputs.q), (0, home));
    assert_eq!(scene.pilot.machine.reason(), Some(HaltReason::TargetJump));
    assert_eq!(outcome.state.robot_mode, u32::from(RobotMode::Idle));
}

#[test]
fn a_command_that_is_no_number_takes_the_permit_back() {
    let mut scene = scene(None);
    scene.follow();
    scene.home[4] = f64::NAN;
    let since = scene.now_ns();
    scene.command(0.0, since, false);
    let outcome = scene.cycle();
    assert_eq!(outcome.inputs.permit, 0);
    assert!(outcome.inputs.q.iter().all(|q| q.is_finite()));
    assert_eq!(scene.pilot.machine.reason(), Some(HaltReason::TargetJump));
}

#[test]
fn arming_far_from_where_the_arm_stands_is_refused() {
    let mut scene = scene(None);
    scene.cycles(100);
    scene.home[1] += 0.3;
    let since = scene.now_ns();
    scene.command(0.0, since, true);
    assert_eq!(scene.cycle().inputs.permit, 0);
    assert_eq!(scene.pilot.machine.reason(), Some(HaltReason::TargetJump));
}

#[test]
fn without_calibration_the_pen_is_not_lowered_beyond_the_stated_height() {
    // The preset's home lifts the pen by 10 mm.
    let mut scene = scene(Some(0.009));
    scene.follow();
    assert!(matches!(scene.pilot.machine.phase(), super::super::reaction::Phase::Following { .. }));
    let since = scene.now_ns();
    // The shoulder sinks.
    let mut refused = false;
    for _ in 0..60 {
        let stamp_ns = scene.now_ns() + 2_000_000;
        let mut command = JointCommand {
            valid_until_ns: stamp_ns + VALID_NS,
            q: scene.home,
            mode: Mode::Following.into(),
            flags: command_flags::ENABLED,
            ..JointCommand::default()
        };
        command.header.stamp_ns = stamp_ns;
        command.q[1] += 0.05 * (stamp_ns - since) as f64 * 1e-9;
        command.qd[1] = 0.05;
        scene.pilot.take(&command, stamp_ns);
        refused |= scene.cycle().inputs.permit == 0;
    }
    assert!(refused);
    assert_eq!(scene.pilot.machine.reason(), Some(HaltReason::Uncalibrated));
}

#[test]
fn the_floor_allows_for_the_tip_being_lower_than_the_model_believes() {
    let config = Config::preset("ur5").unwrap();
    let off = |most_mm| Some(Deviation { most_mm, uneven_mm: 0.0, height_mm: 0.0, turned_mm: 900.0 });
    let height = |deviation| Floor::of(&config, deviation).map(|floor| floor.height_m);
    let content = config.settings().robot.ur.uncalibrated_height_m;
    assert_eq!(height(off(0.4)), None);
    assert!((height(off(12.0)).unwrap() - (content + 0.012)).abs() < 1e-12);
    assert_eq!(height(None), Some(content));
    assert!(height(off(f64::NAN)).is_some_and(|height| !(0.0 >= height)));
}

#[test]
fn a_restarted_controller_is_reported() {
    let mut scene = scene(None);
    scene.cycles(100);
    let arrival = scene.now_ns() + 20 * CYCLE_NS;
    let outcome = scene.pilot.cycle(&Package { timestamp: 0.008, ..scene.package }, arrival).unwrap();
    assert!(outcome.restarted);
}

#[test]
fn a_controller_without_an_arm_is_reported_as_one_that_may_not_move() {
    let mut scene = scene(None);
    scene.cycles(100);
    scene.package.robot_mode = -1;
    assert_eq!(scene.cycle().state.robot_mode, u32::from(RobotMode::Disconnected));
}

#[test]
fn states_that_were_skipped_are_counted_by_their_timestamps() {
    let mut scene = scene(None);
    scene.cycle();
    scene.cycle += 4;
    scene.cycle();
    assert_eq!(scene.pilot.counts.skipped, 4);
}

proptest! {
    #[test]
    fn whatever_the_controller_sends_the_joint_state_is_one_that_daemons_take(
        words in proptest::collection::vec(any::<(i32, i32, u32, u64, i32, i32)>(), 1..50)
    ) {
        use foretrace_shm_checks::is_sound;
        let mut scene = scene(None);
        scene.cycles(100);
        let session = scene.pilot.machine.token();
        for (cycle, (robot_mode, safety_mode, runtime_state, speed, state, used)) in (101u64..).zip(words) {
            let package = Package {
                timestamp: 50.0 + cycle as f64 * 0.008,
                robot_mode,
                safety_mode,
                runtime_state,
                speed_scaling: f64::from_bits(speed),
                answer: ProgramAnswer::from_words([used, state, session, state, used, robot_mode, used]),
                ..scene.package
            };
            if let Some(outcome) = scene.pilot.cycle(&package, START_NS + cycle * CYCLE_NS) {
                prop_assert!(is_sound(&outcome.state));
                prop_assert!(outcome.inputs.permit <= 0);
            }
        }
    }
}

/// The daemon's own test of a joint state, by what the client library shows of it.
mod foretrace_shm_checks {
    use super::*;

    pub(super) fn is_sound(state: &JointState) -> bool {
        RobotMode::try_from(state.robot_mode).is_ok()
            && SafetyMode::try_from(state.safety_mode).is_ok()
            && state.q.iter().chain(&state.qd).chain(&state.effort).all(|value| value.is_finite())
    }
}
