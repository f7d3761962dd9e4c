//! Every time and bound of the reactions, just before it and just after.

use super::*;

impl Scene {
    /// One state `after_s` later, of which the program makes nothing.
    fn state(&mut self, after_s: f64) -> Act {
        self.now_s += after_s;
        let act = self.machine.step(self.now_s, &self.seen, self.wanted);
        self.wanted.begins = false;
        act
    }

    fn ready() -> Self {
        let mut scene = Self::new();
        scene.cycles(0.1);
        assert_eq!((scene.machine.phase(), scene.machine.may_move()), (Phase::Ready, true));
        scene
    }

    fn reason(&self) -> Option<HaltReason> {
        self.machine.reason()
    }
}

/// Less than any cycle \[s\].
const MOMENT_S: f64 = 1e-3;

#[test]
fn an_act_carries_its_permit() {
    let permits = [Act::Wait, Act::Upload, Act::EndEarlier, Act::Follow(7)].map(Act::permit);
    assert_eq!(permits, [NO_PERMIT, NO_PERMIT, crate::bridge::registers::END, 7]);
}

#[test]
fn a_program_has_a_quarter_second_to_obey_a_permit_in_both_words() {
    for (used, state) in [(0, 2), (-1, 1)] {
        let mut scene = Scene::ready();
        scene.arm();
        let Act::Follow(permit) = scene.state(MOMENT_S) else { panic!("no permit") };
        // The permit of before while it follows, or the new one while it waits.
        (scene.seen.answer.used, scene.seen.answer.state) = (if used < 0 { permit } else { used }, state);
        assert_eq!(scene.state(OBEYS_S - MOMENT_S), Act::Follow(permit));
        assert_eq!((scene.state(2.0 * MOMENT_S), scene.reason()), (Act::Wait, Some(HaltReason::NoAnswer)));
    }
}

#[test]
fn silence_counts_from_half_a_second_on_and_the_permit_outlives_commands_by_one() {
    let mut scene = Scene::following();
    scene.seen.silence_s = SILENT_S;
    assert!(matches!(scene.state(MOMENT_S), Act::Follow(_)));
    scene.seen.silence_s = 0.0;
    scene.wanted.commanding = false;
    assert!(matches!(scene.state(IDLE_S - MOMENT_S), Act::Follow(_)));
    assert_eq!((scene.state(2.0 * MOMENT_S), scene.machine.phase()), (Act::Wait, Phase::Ready));
    assert_eq!(scene.reason(), None);
    scene.seen.silence_s = SILENT_S;
    assert_eq!((scene.state(MOMENT_S), scene.machine.phase()), (Act::Wait, Phase::Ready));
    scene.seen.silence_s = SILENT_S + MOMENT_S;
    assert_eq!((scene.state(MOMENT_S), scene.reason()), (Act::Wait, Some(HaltReason::NoAnswer)));
}

#[test]
fn a_program_that_does_not_begin_is_sent_again_after_ten_seconds() {
    let mut scene = Scene::new();
    assert_eq!(scene.state(MOMENT_S), Act::Upload);
    assert_eq!((scene.state(BEGIN_S - MOMENT_S), scene.reason()), (Act::Wait, None));
    assert_eq!((scene.state(2.0 * MOMENT_S), scene.reason()), (Act::Wait, Some(HaltReason::DidNotStart)));
    assert_eq!(scene.state(AGAIN_S - MOMENT_S), Act::Wait);
    assert_eq!(scene.state(2.0 * MOMENT_S), Act::Upload);
}

#[test]
fn a_program_that_begins_has_a_second_to_come_to_full_speed() {
    let mut scene = Scene::new();
    assert_eq!(scene.state(MOMENT_S), Act::Upload);
    (scene.seen.runtime_state, scene.seen.speed) = (2, 0.5);
    scene.seen.answer = ProgramAnswer { session: scene.machine.token(), state: 1, ..Default::default() };
    scene.state(SPEEDS_UP_S - MOMENT_S);
    assert!(matches!(scene.machine.phase(), Phase::Starting { .. }) && !scene.machine.may_move());
    scene.state(2.0 * MOMENT_S);
    assert_eq!(scene.machine.phase(), Phase::Ready);
    scene.seen.speed = FULL_SPEED;
    assert_eq!((scene.state(MOMENT_S), scene.reason()), (Act::Wait, None));
    scene.seen.speed = FULL_SPEED - MOMENT_S;
    assert_eq!((scene.state(MOMENT_S), scene.reason()), (Act::Wait, Some(HaltReason::Slowed)));
}

#[test]
fn a_latch_is_shown_for_its_time_before_the_bridge_gets_ready() {
    let mut scene = Scene::ready();
    scene.seen.safety_mode = 3;
    scene.state(MOMENT_S);
    scene.seen.safety_mode = 1;
    scene.state(SHOWN_S - MOMENT_S);
    assert!(matches!(scene.machine.phase(), Phase::Blocked { .. }) && !scene.machine.may_move());
    scene.state(2.0 * MOMENT_S);
    assert_eq!(scene.machine.phase(), Phase::Ready);
}

#[test]
fn an_end_is_explained_by_an_error_of_the_same_half_second_only() {
    for (before_s, reason) in [
        (EXPLAINED_S - MOMENT_S, HaltReason::ProgramFailed),
        (EXPLAINED_S + 2.0 * MOMENT_S, HaltReason::StoppedByOperator),
    ] {
        let mut scene = Scene::following();
        scene.machine.program_failed();
        scene.state(MOMENT_S);
        let error_s = scene.now_s;
        scene.seen.runtime_state = 1;
        scene.wanted.commanding = false;
        scene.state(before_s);
        let end_s = scene.now_s;
        assert!((end_s - error_s - before_s).abs() < 1e-9);
        scene.state(EXPLAINED_S - MOMENT_S);
        assert_eq!(scene.reason(), None, "it may still be explained");
        scene.state(2.0 * MOMENT_S);
        assert_eq!(scene.reason(), Some(reason), "{before_s}");
    }
}

#[test]
fn a_program_that_plays_on_in_silence_for_two_seconds_is_another_one() {
    let mut scene = Scene::ready();
    scene.cycles(2.0 * REPLACED_S);
    scene.seen.silence_s = REPLACED_S;
    assert_eq!((scene.state(MOMENT_S), scene.reason()), (Act::Wait, Some(HaltReason::NoAnswer)));
    scene.seen.silence_s = REPLACED_S + MOMENT_S;
    assert_eq!((scene.state(MOMENT_S), scene.reason()), (Act::Wait, Some(HaltReason::Replaced)));
    assert!(scene.machine.is_final());
    // One that has played for less is not known to be.
    let mut scene = Scene::ready();
    scene.seen.silence_s = 9.0;
    scene.state(MOMENT_S);
    assert_eq!(scene.reason(), Some(HaltReason::NoAnswer));
}

#[test]
fn the_permit_ends_a_second_after_the_commands() {
    let mut scene = Scene::following();
    scene.wanted.commanding = false;
    assert!(scene.cycles(0.9).iter().all(|act| matches!(act, Act::Follow(_))));
    scene.cycles(0.3);
    assert_eq!(scene.machine.phase(), Phase::Ready);
    assert!(scene.machine.may_move());
}
