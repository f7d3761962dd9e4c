//! Invalid messages, too many of them, or too few readers. Refusals are counted, and the loop goes on.

use foretrace_client::monotonic_now_ns;
use foretrace_tests::{World, until};
use serde_json::Value;

use super::scene::{PLAY, Scene, last_line, say, say_times};
use crate::PROGRAM;

fn armed() -> Scene {
    Scene::armed_in(World::new(PROGRAM))
}

/// How much the daemon counted while the forger ran.
fn grown(told: &Value, pointer: &str) -> u64 {
    let at = |when: &str| told.pointer(&format!("/{when}{pointer}")).and_then(Value::as_u64);
    let (before, after) = (at("before"), at("after"));
    after.zip(before).map(|(after, before)| after - before).unwrap_or_else(|| panic!("{pointer} in {told}"))
}

/// How many the forger sent of one kind.
fn sent(told: &Value, what: &str) -> u64 {
    told["sent"][what].as_u64().unwrap_or_else(|| panic!("{what} in {told}"))
}

/// A valid pen afterwards moves the arm as before.
fn heals(scene: &mut Scene, fault: &str) {
    let since = monotonic_now_ns();
    scene.player = Some(scene.world.start(0, &PLAY));
    say_times(fault, vec![scene.follows_again(since)]);
}

#[test]
fn pen_values_not_finite_huge_or_unknown() {
    let mut scene = armed();
    let told = scene.forge("values", "3");
    let (good, bad) = (sent(&told, "good"), sent(&told, "bad"));
    assert!(good > 300 && bad > 300, "{told}");
    assert_eq!(grown(&told, "/pen/received"), good, "{told}");
    assert_eq!(grown(&told, "/pen/rejected"), bad, "{told}");
    assert_eq!(grown(&told, "/pen/dropped"), 0, "{told}");
    say("pen values", &format!("{bad} of {} samples refused and counted", good + bad));
    heals(&mut scene, "pen values");
    scene.end();
}

#[test]
fn pen_headers_replayed_backwards_future_foreign_and_with_gaps() {
    let mut scene = armed();
    let told = scene.forge("headers", "3");
    let by_header: u64 =
        ["foreign boot", "future", "backwards", "replayed"].iter().map(|what| sent(&told, what)).sum();
    let (back, ahead) = (sent(&told, "device back"), sent(&told, "device future"));
    // A device stamp from the future is found by the law, behind the header's check: received, then refused.
    assert_eq!(grown(&told, "/pen/rejected"), by_header + ahead, "{told}");
    assert_eq!(grown(&told, "/pen/received"), sent(&told, "good") + back + ahead, "{told}");
    assert_eq!(grown(&told, "/pen/dropped"), sent(&told, "left out"), "{told}");
    assert!(grown(&told, "/pen/out_of_order") >= back, "{told}");
    say(
        "pen headers",
        &format!("{by_header} refused, {back} + {ahead} device stamps set aside, all counted"),
    );
    heals(&mut scene, "pen headers");
    scene.end();
}

#[test]
fn pen_flood_of_20_000_samples_per_second() {
    let mut scene = armed();
    let told = scene.forge("flood", "3");
    let good = sent(&told, "good");
    // On a slow machine it may be fewer; still every sample is accounted for.
    assert!(good > 10_000, "{told}");
    let (received, dropped) = (grown(&told, "/pen/received"), grown(&told, "/pen/dropped"));
    assert_eq!(received + dropped + grown(&told, "/pen/rejected"), good, "{told}");
    say("pen flood", &format!("{good} samples in 3 s: {received} received, {dropped} dropped and counted"));
    heals(&mut scene, "pen flood");
    scene.end();
}

#[test]
fn pen_that_is_legal_and_mad() {
    let mut scene = armed();
    let told = scene.forge("mad", "4");
    // A position outside the device is refused; a jump inside is accepted only if it persists.
    assert_eq!(grown(&told, "/pen/rejected"), sent(&told, "far"), "{told}");
    assert!(grown(&told, "/pen/outliers") > 0, "{told}");
    say("mad pen", &format!("{} samples set aside as outliers", grown(&told, "/pen/outliers")));
    heals(&mut scene, "mad pen");
    scene.end();
}

#[test]
fn arm_whose_states_make_no_sense() {
    let mut scene = Scene::idle_in(World::new(PROGRAM));
    let since = monotonic_now_ns();
    scene.player = Some(scene.world.start(0, &PLAY));
    scene.arm_fails = true;
    let mut liar = scene.world.start(0, &["forge", "arm", "8"]);
    scene.world.arm(0, &mut liar);
    scene.follows_again(since);
    until("the loop stops by itself", || {
        let mode = scene.world.status(0)["mode"].clone();
        (mode == "fault" || mode == "stopped").then_some(())
    });
    assert_eq!(scene.world.status(0)["fault"], "joint state stale");
    let told = last_line(&liar.output());
    let bad: u64 = told["sent"].as_object().expect("counts").values().filter_map(Value::as_u64).sum::<u64>()
        - sent(&told, "good");
    // The queue of joint states is short on purpose: states that the loop did not read are missing, not
    // wrong.
    let (refused, received) = (grown(&told, "/arm/rejected"), grown(&told, "/arm/received"));
    assert!(refused > 0 && refused <= bad, "{told}");
    assert!(received <= sent(&told, "good"), "{told}");
    say("arm's lies", &format!("{refused} of {bad} states refused and counted, a stop latched"));
    let since = monotonic_now_ns();
    scene.start_arm();
    say_times("arm's lies", vec![scene.follows_again(since)]);
    scene.end();
}
