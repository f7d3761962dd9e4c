//! Who holds the pen: told by name, and taken over only by asking.

use foretrace_tests::{World, assert_refused, told, until};

use crate::PROGRAM;

#[test]
fn a_pen_is_taken_over_by_asking_and_its_holder_ends_with_the_name_of_who_has_it() {
    let world = World::new(PROGRAM);
    let daemon = world.daemon(0);
    let mut first = world.start(0, &["play", "glyphs:ab", "--loop"]);
    until("the pen is held", || {
        first.expect_alive();
        (world.status(0)["pen"]["holder"]["name"] == "glyphs:ab").then_some(())
    });
    let pid = first.pid();
    let holder = world.status(0)["pen"]["holder"].clone();
    assert_eq!((holder["kind"].as_str(), holder["pid"].as_u64()), (Some("player"), Some(u64::from(pid))));
    let page = world.run(0, &["status"]);
    let told_by = format!("held by the player glyphs:ab (process {pid}) since ");
    assert!(String::from_utf8_lossy(&page.stdout).contains(&told_by), "{}", told(&page));
    // Without asking it is refused, and the first goes on.
    assert_refused(&world.run(0, &["play", "glyphs:z"]), 1, &["the pen is held by the player glyphs:ab"]);
    first.expect_alive();

    let mut second = world.start(0, &["play", "glyphs:z", "--loop", "--take-over"]);
    let ended = first.output();
    assert_refused(&ended, 1, &["the pen was handed to the player glyphs:z", "--take-over to get it back"]);
    until("the second feeds", || {
        second.expect_alive();
        let status = world.status(0);
        let fresh = status["pen"]["age_ms"].as_f64().is_some_and(|age| age < 500.0);
        (fresh && status["pen"]["holder"]["name"] == "glyphs:z").then_some(())
    });
    // However its holder ends, the place is free.
    second.kill();
    assert!(world.status(0)["pen"]["holder"].is_null());
    let third = world.run(0, &["play", "glyphs:i", "--seconds", "0.2"]);
    assert!(third.status.success(), "{}", told(&third));
    daemon.end();
}

#[test]
fn a_holder_that_is_frozen_keeps_its_place_and_is_named() {
    let world = World::new(PROGRAM);
    let daemon = world.daemon(0);
    let frozen = world.start(0, &["play", "glyphs:ab", "--loop"]);
    until("the pen is held", || world.status(0)["pen"]["holder"].is_object().then_some(()));
    frozen.signal("-STOP");
    let kept = world.run(0, &["play", "glyphs:z", "--take-over"]);
    let pid = format!("process {}", frozen.pid());
    assert_refused(&kept, 1, &[&pid, "does not give way: end that program"]);
    frozen.kill();
    daemon.end();
}
