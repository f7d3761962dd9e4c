//! A row per thing that may go wrong: what the bridge does, what it says, and what it takes to go on.

mod moments;

use super::*;
use proptest::prelude::*;

const CYCLE_S: f64 = 0.008;

/// A controller that does what a healthy one does, unless told otherwise.
struct Scene {
    machine: BridgeMachine,
    now_s: f64,
    seen: Observation,
    wanted: Wanted,
    uploads: usize,
}

impl Scene {
    fn new() -> Self {
        let seen = Observation {
            robot_mode: 7,
            safety_mode: 1,
            runtime_state: 1,
            speed: 1.0,
            answer: ProgramAnswer::default(),
            echoed: true,
            silence_s: 0.0,
            starved: false,
        };
        let mut machine = BridgeMachine::new(Tokens::from_seed(4711), Numbers::from_seed(100));
        machine.connected(false);
        machine.settings_agree(Some(true));
        Self { machine, now_s: 50.0, seen, wanted: Wanted::default(), uploads: 0 }
    }

    /// One cycle: what the machine does, and what the program makes of it.
    fn cycle(&mut self) -> Act {
        self.now_s += CYCLE_S;
        let act = self.machine.step(self.now_s, &self.seen, self.wanted);
        self.wanted.begins = false;
        let answer = &mut self.seen.answer;
        match act {
            Act::Upload => {
                self.uploads += 1;
                self.seen.runtime_state = 2;
                *answer =
                    ProgramAnswer { session: self.machine.token(), state: 1, ..ProgramAnswer::default() };
            }
            Act::Follow(permit) if answer.used != permit => {
                (answer.used, answer.state, answer.why) = (permit, 2, 0)
            }
            Act::Wait if answer.state == 2 => answer.state = 1,
            Act::EndEarlier => self.seen.runtime_state = 1,
            _ => {}
        }
        act
    }

    fn cycles(&mut self, seconds: f64) -> Vec<Act> {
        (0..(seconds / CYCLE_S).ceil() as usize).map(|_| self.cycle()).collect()
    }

    fn arm(&mut self) {
        self.wanted = Wanted { commanding: true, begins: true, refused: None };
    }

    fn following() -> Self {
        let mut scene = Self::new();
        scene.cycles(0.1);
        assert_eq!(scene.machine.phase(), Phase::Ready);
        scene.arm();
        let acts = scene.cycles(0.5);
        assert!(acts.iter().all(|act| matches!(act, Act::Follow(_))), "{acts:?}");
        scene
    }
}

/// Spoils a healthy scene.
type Spoil = fn(&mut Scene);

const ROWS: [(&str, Spoil, HaltReason); 20] = [
    ("protective stop", |s| s.seen.safety_mode = 3, HaltReason::ProtectiveStop),
    ("recovery", |s| s.seen.safety_mode = 4, HaltReason::Recovery),
    ("safeguard stop", |s| s.seen.safety_mode = 5, HaltReason::SafeguardStop),
    ("system emergency stop", |s| s.seen.safety_mode = 6, HaltReason::EmergencyStop),
    ("robot emergency stop", |s| s.seen.safety_mode = 7, HaltReason::EmergencyStop),
    ("violation", |s| s.seen.safety_mode = 8, HaltReason::SafetyFault),
    ("fault", |s| s.seen.safety_mode = 9, HaltReason::SafetyFault),
    ("a safety mode nobody knows", |s| s.seen.safety_mode = 77, HaltReason::SafetyFault),
    ("brakes closed", |s| s.seen.robot_mode = 5, HaltReason::NotRunning),
    ("switched off", |s| s.seen.robot_mode = 3, HaltReason::NotRunning),
    ("booting", |s| s.seen.robot_mode = 2, HaltReason::Booting),
    ("freedrive", |s| s.seen.robot_mode = 6, HaltReason::Backdrive),
    ("pausing", |s| s.seen.runtime_state = 3, HaltReason::Paused),
    ("paused", |s| s.seen.runtime_state = 4, HaltReason::Paused),
    ("slider at 98 %", |s| s.seen.speed = 0.98, HaltReason::Slowed),
    ("speed is no number", |s| s.seen.speed = f64::NAN, HaltReason::Slowed),
    ("counters late", |s| (s.seen.answer.state, s.seen.answer.why) = (3, 1), HaltReason::CountersLate),
    (
        "jump seen by the program",
        |s| (s.seen.answer.state, s.seen.answer.why) = (3, 2),
        HaltReason::TargetJump,
    ),
    ("jump seen by the bridge", |s| s.wanted.refused = Some(HaltReason::TargetJump), HaltReason::TargetJump),
    ("no echo for half a second", |s| s.seen.silence_s = 0.6, HaltReason::NoAnswer),
];

#[test]
fn each_hindrance_takes_the_permit_back_at_once_and_is_reported_to_the_daemon() {
    for (name, spoil, reason) in ROWS {
        let mut scene = Scene::following();
        spoil(&mut scene);
        assert_eq!(scene.cycle(), Act::Wait, "{name}");
        assert_eq!(scene.machine.reason(), Some(reason), "{name}");
        assert!(!scene.machine.may_move(), "{name}");
    }
}

#[test]
fn after_each_of_them_nothing_moves_until_the_daemon_stopped_and_somebody_armed() {
    for (name, spoil, reason) in ROWS {
        let mut scene = Scene::following();
        let healthy = scene.seen;
        spoil(&mut scene);
        scene.cycles(0.1);
        scene.seen = Observation { answer: ProgramAnswer { state: 1, ..healthy.answer }, ..healthy };
        scene.wanted.refused = None;
        // The daemon goes on commanding: no permit, however long.
        assert!(scene.cycles(2.0).iter().all(|act| *act == Act::Wait), "{name}");
        assert!(!scene.machine.may_move(), "{name}: the daemon has not stopped yet");
        // It stopped: ready, and still no motion.
        scene.wanted.commanding = false;
        assert!(scene.cycles(1.0).iter().all(|act| *act == Act::Wait), "{name}");
        assert_eq!(scene.machine.phase(), Phase::Ready, "{name}");
        assert_eq!(scene.machine.reason(), Some(reason), "{name} is still told");
        // Commands that do not begin at rest are not obeyed.
        scene.wanted.commanding = true;
        assert!(scene.cycles(0.5).iter().all(|act| *act == Act::Wait), "{name}");
        scene.arm();
        assert!(matches!(scene.cycle(), Act::Follow(_)), "{name}");
        assert_eq!(scene.machine.reason(), None, "{name}");
        assert_eq!(scene.uploads, 1, "{name}: the program never went away");
    }
}

#[test]
fn a_program_that_a_safety_stop_ended_is_started_again_and_waits() {
    for safety_mode in [3, 5, 6, 7] {
        let mut scene = Scene::following();
        // The program may be seen to end before the stop is.
        scene.seen.runtime_state = 1;
        scene.cycles(0.1);
        scene.seen.safety_mode = safety_mode;
        scene.cycles(0.5);
        scene.wanted.commanding = false;
        scene.cycles(0.5);
        assert_eq!(scene.uploads, 1, "not while the stop stands");
        scene.seen.safety_mode = 1;
        scene.cycles(1.0);
        assert_eq!((scene.uploads, scene.machine.phase()), (2, Phase::Ready));
    }
}

#[test]
fn a_program_that_the_operator_stopped_is_not_started_again() {
    let mut scene = Scene::following();
    scene.seen.runtime_state = 1;
    assert!(scene.cycles(1.0).iter().all(|act| *act == Act::Wait));
    assert_eq!(scene.machine.reason(), Some(HaltReason::StoppedByOperator));
    scene.wanted.commanding = false;
    scene.cycles(60.0);
    scene.arm();
    scene.cycles(1.0);
    assert_eq!((scene.uploads, scene.machine.may_move()), (1, false));
    // A cable that is pulled in between changes nothing about it.
    scene.machine.disconnected(HaltReason::ConnectionLost);
    scene.machine.connected(false);
    scene.wanted = Wanted::default();
    scene.cycles(10.0);
    assert_eq!((scene.uploads, scene.machine.reason()), (1, Some(HaltReason::StoppedByOperator)));
}

#[test]
fn a_program_of_others_that_takes_the_place_of_ours_is_told_apart_from_a_stop_on_the_pendant() {
    for (ours_is_seen_to_end, registers_are_left) in
        [(true, true), (true, false), (false, true), (false, false)]
    {
        let mut scene = Scene::following();
        if ours_is_seen_to_end {
            scene.seen.runtime_state = 1;
            scene.cycles(0.05);
        }
        scene.seen.runtime_state = 2;
        if !registers_are_left {
            scene.seen.answer.session = 0;
        }
        scene.wanted.commanding = false;
        for silence_s in [0.6, 1.2, 2.4, 3.6] {
            (scene.seen.echoed, scene.seen.silence_s) = (false, silence_s);
            scene.cycles(0.6);
        }
        scene.seen.runtime_state = 1;
        scene.cycles(60.0);
        let reported = (scene.machine.reason(), scene.uploads);
        assert_eq!(reported, (Some(HaltReason::Replaced), 1), "{ours_is_seen_to_end} {registers_are_left}");
    }
}

/// Brings a scene with a running program into a phase in which the arm does not follow.
type Halt = fn(&mut Scene);

#[test]
fn a_stop_on_the_pendant_counts_in_every_phase() {
    let halts: [(&str, Halt, Halt); 5] = [
        ("slowed", |s| s.seen.speed = 0.5, |s| s.seen.speed = 1.0),
        ("paused", |s| s.seen.runtime_state = 4, |_| {}),
        ("refused", |s| s.wanted.refused = Some(HaltReason::TargetJump), |s| s.wanted.refused = None),
        ("still commanding", |s| s.seen.silence_s = 0.6, |s| s.seen.silence_s = 0.0),
        ("waits for a permit", |s| s.wanted = Wanted::default(), |_| {}),
    ];
    for (name, halt, go_on) in halts {
        let mut scene = Scene::following();
        halt(&mut scene);
        scene.cycles(0.1);
        scene.seen.runtime_state = 1;
        scene.cycles(0.2);
        go_on(&mut scene);
        scene.wanted.commanding = false;
        scene.cycles(60.0);
        assert_eq!(scene.machine.reason(), Some(HaltReason::StoppedByOperator), "{name}");
        assert_eq!((scene.uploads, scene.machine.may_move()), (1, false), "{name}");
    }
    // While it begins: its speed is still coming up.
    let mut scene = Scene::new();
    scene.seen.speed = 0.2;
    scene.cycles(0.1);
    assert!(matches!(scene.machine.phase(), Phase::Starting { .. }));
    scene.seen.runtime_state = 1;
    scene.cycles(60.0);
    assert_eq!((scene.machine.reason(), scene.uploads), (Some(HaltReason::StoppedByOperator), 1));
}

#[test]
fn a_stop_on_the_pendant_outlives_a_cable_that_is_pulled_right_after() {
    let mut scene = Scene::following();
    scene.seen.runtime_state = 1;
    scene.cycles(0.1);
    scene.machine.disconnected(HaltReason::ConnectionLost);
    scene.machine.connected(false);
    scene.wanted = Wanted::default();
    scene.cycles(60.0);
    assert_eq!((scene.machine.reason(), scene.uploads), (Some(HaltReason::StoppedByOperator), 1));
}

#[test]
fn an_error_told_long_before_the_end_is_not_why_the_program_ended() {
    let mut scene = Scene::following();
    scene.machine.program_failed();
    scene.cycles(1.0);
    scene.seen.runtime_state = 1;
    scene.cycles(1.0);
    assert_eq!(scene.machine.reason(), Some(HaltReason::StoppedByOperator));
    // Neither is one from before the arm was told to follow.
    let mut scene = Scene::following();
    scene.wanted = Wanted::default();
    scene.cycles(2.0);
    scene.machine.program_failed();
    scene.cycles(0.1);
    scene.arm();
    scene.cycles(0.1);
    scene.seen.runtime_state = 1;
    scene.cycles(1.0);
    assert_eq!(scene.machine.reason(), Some(HaltReason::StoppedByOperator));
}

#[test]
fn a_program_that_failed_is_not_started_again() {
    let mut scene = Scene::following();
    scene.machine.program_failed();
    (scene.seen.runtime_state, scene.wanted.commanding) = (1, false);
    scene.cycles(5.0);
    assert_eq!((scene.machine.reason(), scene.uploads), (Some(HaltReason::ProgramFailed), 1));
}

#[test]
fn a_program_that_the_watchdog_ended_is_started_again() {
    let mut scene = Scene::following();
    (scene.seen.runtime_state, scene.seen.starved) = (1, true);
    scene.cycles(1.0);
    assert_eq!(scene.machine.reason(), Some(HaltReason::StoppedByWatchdog));
    scene.seen.starved = false;
    scene.wanted.commanding = false;
    scene.cycles(1.0);
    assert_eq!((scene.uploads, scene.machine.phase()), (2, Phase::Ready));
}

#[test]
fn a_lost_connection_blocks_until_it_is_back_and_somebody_arms() {
    for reason in
        [HaltReason::ConnectionLost, HaltReason::Unreachable, HaltReason::ServiceOff, HaltReason::InUse]
    {
        let mut scene = Scene::following();
        scene.machine.disconnected(reason);
        assert!(!scene.machine.may_move());
        assert_eq!(scene.cycle(), Act::Wait);
        scene.machine.connected(false);
        scene.wanted.commanding = false;
        scene.cycles(0.5);
        assert_eq!((scene.machine.phase(), scene.machine.reason()), (Phase::Ready, Some(reason)));
    }
}

#[test]
fn a_restarted_controller_waits_for_its_brakes_and_gets_the_program_again() {
    let mut scene = Scene::following();
    scene.machine.disconnected(HaltReason::ConnectionLost);
    scene.machine.connected(true);
    scene.wanted.commanding = false;
    scene.seen =
        Observation { robot_mode: 3, runtime_state: 1, answer: ProgramAnswer::default(), ..scene.seen };
    scene.now_s = 3.0;
    scene.cycles(1.0);
    assert_eq!((scene.machine.reason(), scene.uploads), (Some(HaltReason::NotRunning), 1));
    scene.seen.robot_mode = 7;
    scene.cycles(1.0);
    assert_eq!((scene.machine.phase(), scene.uploads), (Phase::Ready, 2));
}

#[test]
fn a_program_of_somebody_else_is_left_alone() {
    let mut scene = Scene::new();
    (scene.seen.runtime_state, scene.seen.answer.session) = (2, 1);
    (scene.seen.echoed, scene.seen.silence_s) = (false, 20.0);
    assert!(scene.cycles(20.0).iter().all(|act| *act == Act::Wait));
    assert_eq!((scene.machine.reason(), scene.uploads), (Some(HaltReason::ForeignProgram), 0));
    scene.seen.runtime_state = 1;
    scene.cycle();
    (scene.seen.echoed, scene.seen.silence_s) = (true, 0.0);
    scene.cycles(1.0);
    assert_eq!(scene.machine.phase(), Phase::Ready);
}

#[test]
fn a_program_over_registers_that_ours_left_behind_is_not_taken_for_ours() {
    // Our program was stopped and another one started between two states: the registers say that it is ours.
    let mut scene = Scene::following();
    scene.wanted = Wanted::default();
    scene.cycles(2.0);
    assert_eq!(scene.machine.phase(), Phase::Ready);
    scene.seen.silence_s = 0.6;
    assert_eq!(scene.cycle(), Act::Wait);
    assert_eq!((scene.machine.reason(), scene.machine.may_move()), (Some(HaltReason::NoAnswer), false));
    // The same after a connection: nothing was echoed on it.
    let mut scene = Scene::following();
    scene.machine.disconnected(HaltReason::ConnectionLost);
    scene.machine.connected(false);
    scene.wanted = Wanted::default();
    (scene.seen.echoed, scene.seen.silence_s) = (false, 0.1);
    scene.cycles(0.4);
    assert!(!scene.machine.may_move(), "nothing shows yet whose program runs");
    scene.seen.silence_s = 0.6;
    scene.cycles(0.1);
    assert_eq!((scene.machine.reason(), scene.machine.may_move()), (Some(HaltReason::NoAnswer), false));
    scene.arm();
    assert!(scene.cycles(1.0).iter().all(|act| *act == Act::Wait), "it is neither led nor ended");
    // An echo that moves with our counters is the proof.
    scene.wanted = Wanted::default();
    (scene.seen.echoed, scene.seen.silence_s) = (true, 0.0);
    scene.cycles(1.0);
    assert_eq!(scene.machine.phase(), Phase::Ready);
}

#[test]
fn every_upload_carries_a_token_of_its_own() {
    let mut scene = Scene::following();
    let first = scene.machine.token();
    scene.seen.safety_mode = 3;
    scene.seen.runtime_state = 1;
    scene.cycles(0.1);
    (scene.seen.safety_mode, scene.wanted) = (1, Wanted::default());
    scene.cycles(1.0);
    assert_eq!(scene.uploads, 2);
    assert!(first != scene.machine.token() && scene.machine.token() > 0);
}

#[test]
fn the_program_of_a_bridge_that_died_is_reported_to_end() {
    let mut scene = Scene::new();
    scene.seen.runtime_state = 2;
    scene.seen.answer.session = 4712;
    assert!(scene.cycles(0.1).contains(&Act::EndEarlier));
    scene.cycles(1.0);
    assert_eq!((scene.machine.phase(), scene.uploads), (Phase::Ready, 1));
}

#[test]
fn under_a_daemon_with_other_settings_nothing_moves() {
    // From the beginning: no program is sent, whoever arms.
    let mut scene = Scene::new();
    scene.machine.settings_agree(Some(false));
    scene.arm();
    assert!(scene.cycles(5.0).iter().all(|act| *act == Act::Wait));
    assert_eq!((scene.machine.reason(), scene.machine.may_move()), (Some(HaltReason::OtherSettings), false));
    // A new daemon of which nothing is known yet takes the permit back before its commands are obeyed.
    let mut scene = Scene::following();
    scene.machine.settings_agree(None);
    scene.arm();
    assert!(scene.cycles(1.0).iter().all(|act| *act == Act::Wait));
    assert!(!scene.machine.may_move());
    // Once it is known to agree the bridge gets ready, and waits for an arming.
    scene.machine.settings_agree(Some(true));
    scene.wanted = Wanted::default();
    scene.cycles(1.0);
    assert_eq!((scene.machine.phase(), scene.uploads), (Phase::Ready, 1));
}

#[test]
fn in_local_control_nothing_is_sent_and_what_runs_goes_on() {
    let mut scene = Scene::new();
    scene.machine.remote_control(Some(false));
    scene.cycles(5.0);
    assert_eq!((scene.machine.reason(), scene.uploads), (Some(HaltReason::LocalControl), 0));
    scene.machine.remote_control(Some(true));
    scene.cycles(1.0);
    assert_eq!((scene.machine.phase(), scene.uploads), (Phase::Ready, 1));
    scene.machine.remote_control(Some(false));
    scene.cycles(1.0);
    assert_eq!(scene.machine.phase(), Phase::Ready);
}

#[test]
fn a_program_that_does_not_start_is_sent_again_after_a_while() {
    let mut scene = Scene::new();
    let deaf = scene.seen;
    let mut uploads = 0;
    for _ in 0..(40.0 / CYCLE_S) as usize {
        uploads += usize::from(scene.cycle() == Act::Upload);
        scene.seen = deaf;
    }
    assert_eq!(scene.machine.reason(), Some(HaltReason::DidNotStart));
    assert!((2..=4).contains(&uploads), "{uploads}");
}

#[test]
fn a_speed_that_comes_up_with_the_program_is_no_slow_arm() {
    let mut scene = Scene::new();
    scene.seen.speed = 0.0;
    for step in 0..100 {
        scene.cycle();
        scene.seen.speed = f64::from(step) / 80.0;
        assert_eq!(scene.machine.reason(), None);
    }
    assert_eq!(scene.machine.phase(), Phase::Ready);
    // One that stays low is.
    let mut scene = Scene::new();
    scene.seen.speed = 0.5;
    scene.cycles(3.0);
    assert_eq!((scene.machine.reason(), scene.machine.may_move()), (Some(HaltReason::Slowed), false));
}

#[test]
fn a_pen_too_low_needs_a_new_bridge() {
    let mut scene = Scene::following();
    scene.wanted.refused = Some(HaltReason::Uncalibrated);
    assert_eq!(scene.cycle(), Act::Wait);
    scene.wanted = Wanted::default();
    scene.cycles(5.0);
    scene.arm();
    assert!(scene.cycles(1.0).iter().all(|act| *act == Act::Wait));
    assert_eq!(scene.machine.reason(), Some(HaltReason::Uncalibrated));
}

proptest! {
    #[test]
    fn whatever_is_seen_a_permit_is_given_only_after_a_beginning(
        rows in proptest::collection::vec((0usize..=ROWS.len(), any::<bool>(), 1usize..60), 1..40)
    ) {
        let mut scene = Scene::new();
        let healthy = scene.seen;
        let mut following = false;
        for (row, begins, cycles) in rows {
            let (runtime_state, answer) = (scene.seen.runtime_state, scene.seen.answer);
            scene.seen = Observation { runtime_state, answer, ..healthy };
            if let Some((_, spoil, _)) = ROWS.get(row) {
                spoil(&mut scene);
            }
            scene.wanted = Wanted { commanding: begins || row % 2 == 0, begins, refused: None };
            for _ in 0..cycles {
                let begun = scene.wanted.begins;
                let follows = matches!(scene.cycle(), Act::Follow(_));
                prop_assert!(!follows || following || begun);
                following = follows;
            }
        }
    }
}
