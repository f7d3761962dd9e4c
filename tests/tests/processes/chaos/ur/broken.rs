//! Arms behind bridge and controller that do not do what they are told: the daemon finds out by itself.

use foretrace_tests::{told, until};
use serde_json::Value;

use super::scene::{Scene, Series};
use crate::chaos::scene::say;

/// Stops that a busy machine brings about; they come before the one that is waited for.
const MOST_OTHERS: usize = 5;

/// `order` to the controller's fault port while the arm follows: the daemon tells what `expected` accepts.
/// Returns its status then; `mend` makes the arm whole again after stops of other kinds.
fn caught(scene: &mut Scene, order: &str, mend: &[&str], expected: fn(&Value) -> bool) -> Value {
    for _ in 0..MOST_OTHERS {
        scene.moves();
        scene.order(order);
        let status = until("the loop tells it", || {
            let status = scene.world.status(0);
            let stopped = status["mode"] == "stopped" || status["mode"] == "fault";
            (stopped || expected(&status)).then_some(status)
        });
        let [fault, detail, share] =
            [&status["fault"], &status["stop"]["detail"], &status["arm_speed_share"]];
        say(&format!("ur {order}"), &format!("{fault} {detail}, speed share {share}"));
        if expected(&status) {
            return status;
        }
        go_on(scene, mend);
    }
    panic!("{order}: never told");
}

/// An operator mends the arm and disarms; the arm is followed again.
fn go_on(scene: &mut Scene, mend: &[&str]) {
    mend.iter().for_each(|line| scene.order(line));
    let disarmed = scene.world.run(0, &["request", "disarm"]);
    assert!(disarmed.status.success(), "{}", told(&disarmed));
    scene.follow();
}

#[test]
fn ur_arm_that_is_stuck_is_found_by_the_monitor() {
    let mut scene = Scene::following(Series::Cb3);
    let status =
        caught(&mut scene, "arm stuck", &["arm mended"], |status| status["fault"] == "tracking error");
    let cause = status["stop"]["cause"].as_str().unwrap_or_default().to_owned();
    assert!(["no motion", "joint deviation", "tool deviation"].contains(&cause.as_str()), "{status}");
    scene.watcher.rests();
    go_on(&mut scene, &["arm mended"]);
}

#[test]
fn ur_arm_that_is_slow_is_told_or_stopped() {
    let mut scene = Scene::following(Series::Cb3);
    caught(&mut scene, "arm slow:0.03", &["arm mended"], |status| {
        let slow = status["arm_speed_share"].as_f64().is_some_and(|share| share < 0.9);
        slow || status["fault"] == "tracking error"
    });
    go_on(&mut scene, &["arm mended"]);
}

#[test]
fn ur_arm_that_is_switched_off_stops_the_loop() {
    let mut scene = Scene::following(Series::Cb3);
    caught(&mut scene, "power-off", &["power-up"], |status| status["fault"] == "robot stopped");
    scene.watcher.rests();
    // Power alone moves nothing.
    scene.order("power-up");
    scene.watcher.stands_for_a_second().expect("switched on again, it stands until it is armed");
    go_on(&mut scene, &["power-up"]);
}
