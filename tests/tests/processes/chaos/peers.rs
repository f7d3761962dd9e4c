//! Peers that exceed the places, never read, or are of another version.

use std::io::{BufRead, BufReader};

use foretrace_client::monotonic_now_ns;
use foretrace_tests::{Process, World, assert_refused};

use super::scene::{PLAY, Scene, assert_nothing_left, say, say_times};
use crate::PROGRAM;

/// Waits for the first line of a role.
fn listening(process: &mut Process) {
    let mut line = String::new();
    BufReader::new(process.take_stdout().expect("a pipe")).read_line(&mut line).expect("a pipe");
    assert!(line.contains("listens"), "{line}");
}

#[test]
fn subscriber_that_never_reads() {
    let mut scene = Scene::following();
    let mut deaf = scene.world.start(0, &["forge", "deaf", "600"]);
    listening(&mut deaf);
    // Its buffers hold half a second of commands and records; four of them make it overflow for sure.
    std::thread::sleep(std::time::Duration::from_secs(2));
    let since = monotonic_now_ns();
    say_times("deaf subscriber", vec![scene.follows_again(since)]);
    let status = scene.world.status(0);
    for (part, key) in [("arm", "commands_failed"), ("pen", "dropped"), ("arm", "dropped")] {
        assert_eq!(status[part][key], 0, "{status}");
    }
    deaf.expect_alive();
    deaf.kill();
    let since = monotonic_now_ns();
    scene.follows_again(since);
    scene.player.as_mut().expect("a player").expect_alive();
    let report = scene.end();
    assert_eq!(report["begins"], 1, "{report}");
}

#[test]
fn two_pens_at_once() {
    let mut scene = Scene::following();
    let samples = scene.count("/pen/samples");
    for words in [&PLAY[..], &["play", "glyphs:z"], &["forge", "flood", "1"]] {
        let second = scene.world.run(0, words);
        assert_eq!(second.status.code(), Some(1), "{}", foretrace_tests::told(&second));
    }
    assert_refused(&scene.world.run(0, &PLAY), 1, &["the pen is held by the player", "--take-over"]);
    let since = monotonic_now_ns();
    scene.follows_again(since);
    let status = scene.world.status(0);
    assert!(scene.count("/pen/samples") > samples);
    for key in ["rejected", "out_of_order", "dropped"] {
        assert_eq!(status["pen"][key], 0, "{status}");
    }
    // The place is free as soon as its owner is gone, however it ended.
    scene.player.take().expect("a player").kill();
    let since = monotonic_now_ns();
    let second = scene.world.start(0, &PLAY);
    scene.player = Some(second);
    say_times("two pens", vec![scene.follows_again(since)]);
    scene.end();
}

#[test]
fn peer_of_another_layout() {
    let world = World::new(PROGRAM);
    let mut squatter = world.start(0, &["forge", "layout", "600"]);
    listening(&mut squatter);
    let refused = world.run(0, &["daemon", "--no-rights"]);
    assert_refused(&refused, 1, &["foretrace/pen", "layout", "use programs of one version of foretrace"]);
    squatter.kill();
    // Its leftovers do no harm.
    let since = monotonic_now_ns();
    let daemon = world.daemon(0);
    say(
        "another layout",
        &format!("daemon up {:.0} ms after it was gone", (monotonic_now_ns() - since) as f64 * 1e-6),
    );
    daemon.end();
    assert_nothing_left(&world);
}

#[test]
fn more_operators_than_the_middleware_remembers() {
    let scene = Scene::following();
    for _ in 0..200 {
        let asked = scene.world.run(0, &["request", "query"]);
        assert!(asked.status.success(), "{}", foretrace_tests::told(&asked));
    }
    let since = monotonic_now_ns();
    say_times("200 operators, one after the other", vec![scene.follows_again(since)]);
    let report = scene.end();
    assert_eq!((&report["begins"], &report["streams"]), (&1.into(), &1.into()), "{report}");
}

/// The daemon's messages go into a pipe of 64 KiB that this test holds and does not empty.
#[test]
fn nobody_reads_the_messages() {
    let world = World::new(PROGRAM);
    let file = world.file("settings.toml");
    std::fs::write(&file, "preset = \"ur5\"\n").expect("own folder");
    let scene = Scene::following_with(world, &["--config", &file.display().to_string()]);
    // Each refusal quotes all of this.
    let wrong: String = (0..8).map(|key| format!("{}{key} = 1\n", "long-winded-".repeat(30))).collect();
    std::fs::write(&file, wrong).expect("own folder");
    for _ in 0..60 {
        assert_refused(&scene.world.run(0, &["request", "reload"]), 4, &["long-winded"]);
    }
    let since = monotonic_now_ns();
    say_times("messages that nobody reads", vec![scene.follows_again(since)]);
    assert_eq!(scene.world.status(0)["mode"], "following");
    let (report, said) = scene.end_and_listen();
    assert_eq!(report["begins"], 1, "{report}");
    assert!(said > 128 << 10, "the pipe was never full: {said} bytes");
}
