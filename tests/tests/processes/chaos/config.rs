//! Settings that are garbage: at start, under a running daemon, and at a reload. And the limits that the
//! recorder judges by.

use std::path::Path;

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

/// Puts something at the place of the settings or of the robot that they name.
type Forge = fn(&Path, &Path);

/// Files that end whoever reads them without a bound: by the stack, by memory, by waiting.
const DEADLY: [(&str, Forge, &str); 9] = [
    ("robot nested 20 000 deep", |_, robot| nested(robot, 20_000), "elements inside each other"),
    ("robot nested 60 000 deep", |_, robot| nested(robot, 60_000), "elements inside each other"),
    (
        "robot of 10 000 000 elements",
        |_, robot| {
            std::fs::write(robot, format!("<robot>{}</robot>", "<a/>".repeat(10_000_000)))
                .expect("own folder");
        },
        "40000015 bytes",
    ),
    ("robot that is a pipe", |_, robot| pipe(robot), "not a regular file"),
    (
        "robot without an end",
        |_, robot| {
            std::os::unix::fs::symlink("/dev/zero", robot).expect("own folder");
        },
        "not a regular file",
    ),
    (
        "settings of 300 MB",
        |settings, _| {
            std::fs::File::create(settings).and_then(|file| file.set_len(300 << 20)).expect("own folder");
        },
        "314572800 bytes",
    ),
    ("settings that are a pipe", |settings, _| pipe(settings), "not a regular file"),
    (
        "settings nested 200 000 deep",
        |settings, _| {
            std::fs::write(settings, format!("a = {}", "[".repeat(200_000))).expect("own folder");
        },
        "settings.toml",
    ),
    (
        "settings of 100 000 dotted keys",
        |settings, _| {
            std::fs::write(settings, format!("{} = 1", vec!["a"; 100_000].join("."))).expect("own folder");
        },
        "settings.toml",
    ),
];

fn nested(robot: &Path, depth: usize) {
    let text =
        format!("<robot name=\"x\">{}{}</robot>", "<link name=\"x\">".repeat(depth), "</link>".repeat(depth));
    std::fs::write(robot, text).expect("own folder");
}

fn pipe(path: &Path) {
    let _ = std::fs::remove_file(path);
    assert!(std::process::Command::new("mkfifo").arg(path).status().expect("mkfifo").success());
}

/// Ticks, and periods that the loop lost, so far.
fn lost(scene: &Scene) -> (u64, u64) {
    let status = scene.world.status(0);
    let count = |name: &str| status["loop"][name].as_u64().expect("a count");
    (count("ticks"), count("overruns") + count("skipped_ticks"))
}

#[test]
fn files_that_end_their_reader_do_not_end_the_daemon_that_reads_them_again() {
    let world = World::new(PROGRAM);
    let good = "preset = \"ur5\"\n[robot]\nurdf = \"arm.urdf\"\ntool_m = [0.0, 0.0, 0.15]\n[predictor]\nkind = \"hold\"\n";
    let file = write(&world, good.as_bytes());
    let (settings, robot) = (Path::new(&file).to_path_buf(), world.file("arm.urdf"));
    let urdf = foretrace_config::presets::robot("ur5").expect("shipped");
    std::fs::write(&robot, urdf).expect("own folder");
    let mut scene = Scene::following_with(world, &["--config", &file]);
    // Ticks, and periods lost, while the daemon has a file checked, and while a user checks the same one.
    let [mut asked_for, mut beside] = [(0, 0); 2];
    for (what, forge, words) in DEADLY {
        let _ = std::fs::remove_file(&robot);
        std::fs::write(&robot, urdf).and_then(|()| std::fs::remove_file(&settings)).expect("own folder");
        std::fs::write(&settings, good).expect("own folder");
        let old = if words == "settings.toml" || what.starts_with("settings") { &settings } else { &robot };
        std::fs::remove_file(old).expect("own folder");
        forge(&settings, &robot);
        let since = monotonic_now_ns();
        let begin = lost(&scene);
        let refused = scene.world.run(0, &["request", "reload"]);
        let between = lost(&scene);
        assert_eq!(refused.status.code(), Some(4), "{what}: {}", told(&refused));
        // What an operator hears is short; the check says it whole.
        let check = scene.world.run_plain(&["config", "check", &file]);
        let end = lost(&scene);
        for (sum, from, to) in [(&mut asked_for, begin, between), (&mut beside, between, end)] {
            *sum = (sum.0 + to.0 - from.0, sum.1 + to.1 - from.1);
        }
        assert_refused(&check, 5, &[words]);
        scene.follows_again(since);
        scene.daemon.as_mut().expect("a daemon").expect_alive();
    }
    // A flood of requests, with and without an answer: one check at a time.
    let pid = scene.daemon.as_ref().expect("a daemon").pid().to_string();
    for _ in 0..300 {
        let _ = std::process::Command::new("kill").args(["-HUP", &pid]).status();
    }
    for path in [&settings, &robot] {
        let _ = std::fs::remove_file(path);
    }
    std::fs::write(&robot, urdf).expect("own folder");
    std::fs::write(&settings, good.replace("hold", "constant-velocity")).expect("own folder");
    let asked = scene.world.run(0, &["request", "reload"]);
    assert!(asked.status.success(), "{}", told(&asked));
    until("the settings are in force", || {
        (scene.world.status(0)["predictor"]["name"] == "constant-velocity").then_some(())
    });
    let share = |(ticks, losses): (u64, u64)| losses as f64 / ticks.max(1) as f64;
    let (reloading, by_user) = (share(asked_for), share(beside));
    let text = format!(
        "{} of {} periods lost while files were refused ({:.2} %), {:.2} % while a user checked them",
        asked_for.1,
        asked_for.0,
        100.0 * reloading,
        100.0 * by_user
    );
    say("files that end their reader", &text);
    // A child on a busy machine takes processor time as that program does; a stall takes tens of periods.
    assert!(reloading <= 2.0 * by_user + 0.02, "{text}");
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
