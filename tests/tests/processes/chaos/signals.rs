//! SIGSTOP and SIGCONT. Recovery: from SIGCONT to the first command that follows a newer pen sample.

use std::time::Duration;

use foretrace_client::monotonic_now_ns;
use foretrace_tests::until;

use super::scene::{Moments, Scene, say_times};

const ROUNDS: u32 = 3;

/// The loop has latched a stop.
fn stopped(scene: &Scene) -> Option<()> {
    let mode = scene.world.status(0)["mode"].clone();
    (mode == "fault" || mode == "stopped").then_some(())
}

#[test]
fn player_stopped_and_continued() {
    let scene = Scene::following();
    let (mut moments, mut times) = (Moments::new(), Vec::new());
    for _ in 0..ROUNDS {
        moments.wait(300);
        let player = scene.player.as_ref().expect("a player");
        player.signal("-STOP");
        scene.world.wait_for_mode(0, "holding");
        let since = monotonic_now_ns();
        player.signal("-CONT");
        times.push(scene.follows_again(since));
    }
    say_times("player stopped", times);
    let report = scene.end();
    assert_eq!(report["begins"], 1, "{report}");
}

#[test]
fn arm_stopped_and_continued() {
    let mut scene = Scene::following();
    let (mut moments, mut times) = (Moments::new(), Vec::new());
    for _ in 0..ROUNDS {
        moments.wait(300);
        scene.arm.as_ref().expect("an arm").signal("-STOP");
        scene.arm_held_up += 1;
        until("the loop stops by itself", || stopped(&scene));
        assert!(scene.count("/arm/stale_ticks") > 0);
        let since = monotonic_now_ns();
        scene.arm.as_ref().expect("an arm").signal("-CONT");
        scene.rearm();
        times.push(scene.follows_again(since));
    }
    say_times("arm stopped", times);
    scene.end();
}

#[test]
fn daemon_stopped_and_continued() {
    let mut scene = Scene::following();
    let (mut moments, mut times) = (Moments::new(), Vec::new());
    for _ in 0..ROUNDS {
        moments.wait(300);
        let daemon = scene.daemon.as_ref().expect("a daemon");
        daemon.signal("-STOP");
        // Longer than `safety.latch_after_ms`: the loop must not simply go on.
        std::thread::sleep(Duration::from_millis(700));
        let since = monotonic_now_ns();
        daemon.signal("-CONT");
        until("the loop stays stopped", || stopped(&scene));
        assert_eq!(scene.world.status(0)["fault"], "time lost");
        scene.rearm();
        times.push(scene.follows_again(since));
    }
    assert!(scene.count("/loop/skipped_ticks") > 300);
    say_times("daemon stopped", times);
    let report = scene.end();
    assert_eq!(report["begins"], u64::from(ROUNDS) + 1, "{report}");
}
