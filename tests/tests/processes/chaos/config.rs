//! Settings that are garbage: at start, under a running daemon, and at a reload. And the limits that the
//! recorder judges by.

use foretrace_client::monotonic_now_ns;
use foretrace_tests::{World, assert_refused, judge, told, until};

use super::scene::{Scene, assert_nothing_left, say, say_times};
use crate::PROGRAM;

/// Files that are not settings.
fn garbage() -> Vec<(&'static str, Vec<u8>)> {
    let noise: Vec<u8> = (0..4096_u32).map(|k| (k.wrapping_mul(2_654_435_761) >> 13) as u8).collect();
    vec![
        ("empty key", b"= 3\n".to_vec()),
        ("not text", noise),
        ("zeros", vec![0; 512]),
        ("cut off", b"preset = \"ur5\"\n[loop]\nrate_hz = ".to_vec()),
        ("unknown preset", b"preset = \"ur6\"\n".to_vec()),
        ("not a number", b"preset = \"ur5\"\n[timing]\ndead_time_ms = nan\n".to_vec()),
        ("infinite", b"preset = \"ur5\"\n[mpc]\neffort = inf\n".to_vec()),
        ("huge", b"preset = \"ur5\"\n[loop]\nrate_hz = 99999999999999999999\n".to_vec()),
        ("nested", [b"preset = \"ur5\"\na = ".to_vec(), vec![b'['; 20_000]].concat()),
    ]
}

fn write(world: &World, bytes: &[u8]) -> String {
    let path = world.write("settings.toml", "");
    std::fs::write(&path, bytes).expect("own folder");
    path
}

#[test]
fn garbage_settings_at_start() {
    let world = World::new(PROGRAM);
    for (what, bytes) in garbage() {
        let file = write(&world, &bytes);
        let refused = world.run(0, &["daemon", "--no-rights", "--config", &file]);
        assert_refused(&refused, 5, &["settings.toml"]);
        let stderr = String::from_utf8_lossy(&refused.stderr);
        assert!(stderr.len() < 2000, "{what}: {} bytes of message", stderr.len());
        assert!(
            !world.instance(0).root().exists(),
            "{what}: something was made before the settings were read"
        );
    }
    say("garbage settings", &format!("{} files refused with file and reason", garbage().len()));
    // An empty file or none at all is the preset.
    world.daemon(0).end();
    assert_nothing_left(&world);
}

#[test]
fn settings_that_turn_into_garbage_under_a_running_daemon() {
    let world = World::new(PROGRAM);
    let file = write(&world, b"preset = \"ur5\"\n[predictor]\nkind = \"hold\"\n");
    let mut scene = Scene::following_with(world, &["--config", &file]);
    for (what, bytes) in garbage() {
        write(&scene.world, &bytes);
        // The daemon does not read it until a reload.
        let since = monotonic_now_ns();
        scene.follows_again(since);
        let refused = scene.world.run(0, &["request", "reload"]);
        assert_eq!(refused.status.code(), Some(4), "{what}: {}", told(&refused));
        assert_eq!(scene.world.status(0)["predictor"]["name"], "hold", "{what}");
        scene.daemon.as_mut().expect("a daemon").expect_alive();
    }
    // Corrected, it is read.
    write(&scene.world, b"preset = \"ur5\"\n[predictor]\nkind = \"constant-velocity\"\n");
    let asked = scene.world.run(0, &["request", "reload"]);
    assert!(asked.status.success(), "{}", told(&asked));
    until("the settings are in force", || {
        (scene.world.status(0)["predictor"]["name"] == "constant-velocity").then_some(())
    });
    let since = monotonic_now_ns();
    say_times("settings turn into garbage", vec![scene.follows_again(since)]);
    let report = scene.end();
    assert_eq!((&report["begins"], &report["streams"]), (&1.into(), &1.into()), "{report}");
}

#[test]
fn the_recorder_judges_by_the_limits_of_the_settings() {
    let world = World::new(PROGRAM);
    let shown = world.run_plain(&["config", "show"]);
    assert!(shown.status.success(), "{}", told(&shown));
    let text = String::from_utf8_lossy(&shown.stdout).replace(' ', "");
    for (key, limit) in [("velocity_radps", judge::VELOCITY), ("acceleration_radps2", judge::ACCELERATION)] {
        let value = format!("{limit:?}");
        let line = format!("\n{key}=[{}]", [value.as_str(); 6].join(","));
        assert!(text.contains(&line), "{line} is not in {text}");
    }
}
