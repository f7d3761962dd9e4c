//! Arms that fail, over processes: the loop stops with the reason, refuses to arm the faulty arm, and goes on
//! with the next arm.

use std::time::{Duration, Instant};

use foretrace_client::monotonic_now_ns;
use foretrace_tests::until;
use serde_json::Value;

use super::scene::{PLAY, Scene, say};

/// Time of the fault after the arm's first cycle [s]: it is armed and follows by then, also on a busy
/// machine.
const AT_S: u32 = 6;

/// An arm with `fault`, followed by a loop until that stops by itself. Returns the scene and the status then.
fn stopped_by(fault: &str) -> (Scene, Value) {
    let mut scene = Scene::armed_with(&["--fault", fault]);
    let since = monotonic_now_ns();
    scene.player = Some(scene.world.start(0, &PLAY));
    scene.follows_again(since);
    let status = until("the loop stops by itself", || {
        let status = scene.world.status(0);
        scene.note(status.to_string());
        (status["mode"] == "stopped").then_some(status)
    });
    say(&format!("arm {fault}"), status["stop"]["detail"].as_str().unwrap_or_default());
    assert_eq!(status["fault"], "tracking error", "{status}");
    assert_ne!(status["stop"]["cause"], "none", "{status}");
    (scene, status)
}

/// The loop refuses the arm that failed; an operator disarms, and the next arm is followed.
fn goes_on_with_the_next_arm(mut scene: Scene) {
    if let Some(arm) = scene.arm.take() {
        arm.end();
    }
    let disarmed = scene.world.run(0, &["request", "disarm"]);
    assert!(disarmed.status.success(), "{}", foretrace_tests::told(&disarmed));
    let since = monotonic_now_ns();
    scene.start_arm();
    say("next arm", &format!("followed after {:.0} ms", scene.follows_again(since)));
    scene.end();
}

#[test]
fn arm_that_stands_still() {
    let (scene, status) = stopped_by(&format!("stuck@{AT_S}"));
    let cause = status["stop"]["cause"].as_str().unwrap_or_default().to_owned();
    assert!(["no motion", "joint deviation", "tool deviation"].contains(&cause.as_str()), "{status}");
    goes_on_with_the_next_arm(scene);
}

#[test]
fn arm_that_is_paused() {
    goes_on_with_the_next_arm(stopped_by(&format!("paused@{AT_S}")).0);
}

#[test]
fn joint_that_is_locked_and_joint_that_is_reported_frozen() {
    goes_on_with_the_next_arm(stopped_by(&format!("locked@{AT_S}:2")).0);
    goes_on_with_the_next_arm(stopped_by(&format!("frozen@{AT_S}:1")).0);
}

#[test]
fn joint_that_moves_the_other_way() {
    goes_on_with_the_next_arm(stopped_by(&format!("flipped@{AT_S}")).0);
}

#[test]
fn arm_reported_beside_where_it_is() {
    for fault in ["offset", "wrapped"] {
        let (scene, status) = stopped_by(&format!("{fault}@{AT_S}"));
        assert_eq!(status["stop"]["joint"], 0, "{status}");
        // It stands, but not where it is held.
        let asked = scene.world.run(0, &["request", "arm"]);
        assert_eq!(asked.status.code(), Some(4), "{}", foretrace_tests::told(&asked));
        goes_on_with_the_next_arm(scene);
    }
}

#[test]
fn arm_that_runs_away_or_swings() {
    goes_on_with_the_next_arm(stopped_by(&format!("runaway@{AT_S}")).0);
    goes_on_with_the_next_arm(stopped_by(&format!("oscillation@{AT_S}")).0);
}

#[test]
fn slow_arm_is_told_and_followed_on() {
    // At 125 Hz the simulated slider leaves so little of each way that the arm is a filter of 45 ms, slow in
    // nothing but its lag.
    let mut scene = Scene::armed_with(&["--speed-scaling", "0.15", "--rate", "500"]);
    let since = monotonic_now_ns();
    scene.player = Some(scene.world.start(0, &["play", "glyphs:ab", "--loop", "--speed", "1.5"]));
    scene.follows_again(since);
    let share = until("the slow arm is noticed", || {
        let status = scene.world.status(0);
        scene.note(status.to_string());
        let told = status["arm_speed_share"].as_f64().filter(|share| *share < 0.9);
        told.map(Some).or((status["mode"] == "stopped").then_some(None))
    });
    say("arm at 15 %", &format!("{share:?}"));
    scene.end();
}

#[test]
fn a_healthy_arm_is_followed_on() {
    let scene = Scene::following();
    let begin = Instant::now();
    while begin.elapsed() < Duration::from_secs(8) {
        let status = scene.world.status(0);
        assert_ne!(status["fault"], "tracking error", "{status}");
        std::thread::sleep(Duration::from_millis(200));
    }
    scene.end();
}
