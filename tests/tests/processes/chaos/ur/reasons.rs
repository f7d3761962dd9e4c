//! Why a Universal Robots arm does not follow, told by the bridge and shown wherever an operator looks.

use std::io::Write;
use std::net::TcpStream;
use std::time::Duration;

use foretrace_tests::{assert_refused, told, until};

use super::scene::{Scene, Series};

const SECONDARY: u16 = 30002;

/// The note of the arm's process in the status, once it contains `words`.
fn noted(scene: &Scene, words: &str) -> serde_json::Value {
    until("the bridge's reason arrives", || {
        let status = scene.world.status(0);
        let here = status["arm"]["note"]["text"].as_str().is_some_and(|text| text.contains(words));
        here.then_some(status)
    })
}

#[test]
fn ur_speed_slider_below_full_is_named_wherever_an_operator_looks() {
    let mut scene = Scene::following(Series::E);
    scene.moves();
    scene.order("slider 0.5");
    let status = noted(&scene, "50 %");
    assert!(status["arm"]["note"]["to_do"].as_str().unwrap().contains("speed slider to 100 %"), "{status}");
    until("the loop stops", || (scene.world.status(0)["mode"] == "fault").then_some(()));
    let page = told(&scene.world.run(0, &["status"]));
    assert!(page.contains("robot stopped: speed scaling is at 50 %"), "{page}");
    assert_refused(
        &scene.world.run(0, &["request", "arm"]),
        4,
        &["speed scaling is at 50 %", "slider to 100 %"],
    );
    scene.order("slider 1");
    until("it is over", || scene.world.status(0)["arm"]["note"].is_null().then_some(()));
    scene.follow();
}

#[test]
fn ur_program_of_others_is_told_apart_and_ends_the_bridge() {
    let mut scene = Scene::following(Series::E);
    scene.moves();
    let mut theirs = TcpStream::connect((scene.address, SECONDARY)).expect("the interface listens");
    theirs.write_all(b"def theirs():\n  while True:\n    sync()\n  end\nend\n").expect("it reads");
    noted(&scene, "another program took the place");
    let (status, text) = until("the bridge ends", || scene.bridge.as_mut().expect("a bridge").ended());
    assert_eq!(status.code(), Some(1), "{text}");
    assert!(
        text.contains("another program took the place") && text.contains("start `foretrace arm ur`"),
        "{text}"
    );
    // What was said last still stands there.
    std::thread::sleep(Duration::from_millis(300));
    noted(&scene, "another program took the place");
}

#[test]
fn ur_protective_stop_and_a_stop_on_the_pendant_are_not_mixed_up() {
    let mut scene = Scene::following(Series::E);
    scene.moves();
    scene.order("protective-stop");
    noted(&scene, "protective stop");
    assert_refused(&scene.world.run(0, &["request", "arm"]), 4, &["protective stop", "on the pendant"]);
    // Sooner a controller lets nobody.
    std::thread::sleep(Duration::from_millis(5500));
    scene.order("unlock");
    until("it is over", || scene.world.status(0)["arm"]["note"].is_null().then_some(()));
    scene.follow();
    scene.moves();
    scene.order("stop-program");
    noted(&scene, "stopped on the pendant");
    let (status, text) = until("the bridge ends", || scene.bridge.as_mut().expect("a bridge").ended());
    assert_eq!(status.code(), Some(1), "{text}");
}
