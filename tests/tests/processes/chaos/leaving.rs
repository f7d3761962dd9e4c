//! Daemon, arm and pen leave in every order: the last one leaves nothing behind.

use foretrace_tests::{Process, World, until};

use super::scene::{PLAY, assert_nothing_left, say};
use crate::PROGRAM;

/// Waits until the loop follows; a machine so busy that a stop latched meanwhile arms once more.
fn follows(world: &World, arm: &mut Process) {
    until("the loop follows", || {
        let mode = world.status(0)["mode"].clone();
        if mode == "stopped" {
            world.arm(0, arm);
        }
        (mode == "following").then_some(())
    });
}

#[test]
fn nothing_stays_behind_whoever_leaves_last() {
    for order in [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]] {
        let world = World::new(PROGRAM);
        let daemon = world.daemon(0);
        let mut arm = world.start(0, &["arm", "sim"]);
        let player = world.start(0, &PLAY);
        world.arm(0, &mut arm);
        follows(&world, &mut arm);
        let mut peers = [Some(daemon), Some(arm), Some(player)];
        for place in order {
            peers[place].take().expect("each once").end();
        }
        assert_nothing_left(&world);
    }
    say("leaving", "daemon, arm and pen in all six orders: nothing left in shared memory");
}

#[test]
fn nothing_stays_behind_when_all_leave_at_once() {
    for _ in 0..3 {
        let world = World::new(PROGRAM);
        let daemon = world.daemon(0);
        let mut arm = world.start(0, &["arm", "sim"]);
        let player = world.start(0, &PLAY);
        world.arm(0, &mut arm);
        follows(&world, &mut arm);
        for process in [&daemon, &arm, &player] {
            process.signal("-INT");
        }
        for process in [daemon, arm, player] {
            let output = process.output();
            // A program that notices the daemon's end before its own signal reports it.
            assert!(matches!(output.status.code(), Some(0 | 3)), "{}", foretrace_tests::told(&output));
        }
        assert_nothing_left(&world);
    }
}
