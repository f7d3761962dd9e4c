//! Daemon, arm and pen leave in every order: whoever is the last, nothing stays behind.

use foretrace_tests::World;

use super::PROGRAM;
use super::scene::{PLAY, assert_nothing_left, say};

#[test]
fn nothing_stays_behind_whoever_leaves_last() {
    for order in [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]] {
        let world = World::new(PROGRAM);
        let daemon = world.daemon(0);
        let mut arm = world.start(0, &["arm", "sim"]);
        let player = world.start(0, &PLAY);
        world.arm(0, &mut arm);
        world.wait_for_mode(0, "following");
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
        for process in [&daemon, &arm, &player] {
            process.signal("-INT");
        }
        for process in [daemon, arm, player] {
            let output = process.output();
            assert!(output.status.success(), "{}", foretrace_tests::told(&output));
        }
        assert_nothing_left(&world);
    }
}
