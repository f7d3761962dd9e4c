//! SIGKILL at random moments. Recovery: from the start of the next process to the first command that follows
//! a newer pen sample.

use foretrace_client::monotonic_now_ns;
use foretrace_tests::{Process, until};

use super::scene::{Moments, PLAY, Scene, rounds, say, say_times};

/// Of all rounds, every test here takes a fifth.
const SHARE: u32 = 5;

/// Starts `words` until it stays: the place of a dead peer is free once a live one has cleaned up. `done`
/// says when it stayed.
fn started<T>(
    scene: &mut Scene,
    words: &[&str],
    mut done: impl FnMut(&mut Scene) -> Option<T>,
) -> (Process, T) {
    let mut process = scene.world.start(0, words);
    let done = until(&format!("`{}` stays", words.join(" ")), || {
        if let Some((status, text)) = process.ended() {
            let passing = ["slots are in use", "slot is in use", "no daemon running"]
                .iter()
                .any(|words| text.contains(words));
            assert!(passing && !text.contains("panicked"), "{status}: {text}");
            process = scene.world.start(0, words);
        }
        done(scene)
    });
    (process, done)
}

/// The first command after `since_ns` that follows a newer sample; asks to arm where that is needed.
fn follows(scene: &Scene, since_ns: u64) -> Option<f64> {
    scene.follows_now(since_ns).or_else(|| {
        let asked = scene.world.run(0, &["request", "arm"]);
        assert!(matches!(asked.status.code(), Some(0 | 1 | 3 | 4)), "{}", foretrace_tests::told(&asked));
        scene.note(foretrace_tests::told(&asked));
        None
    })
}

fn stops_by_itself(scene: &Scene) {
    until("the loop stops by itself", || {
        let mode = scene.world.status(0)["mode"].clone();
        (mode == "fault" || mode == "stopped").then_some(())
    });
}

#[test]
fn player_killed() {
    let mut scene = Scene::following();
    let (mut moments, mut times) = (Moments::new(), Vec::new());
    for _ in 0..rounds(SHARE) {
        moments.wait(300);
        scene.player.take().expect("a player").kill();
        moments.wait(400);
        let since = monotonic_now_ns();
        let (player, ms) = started(&mut scene, &PLAY, |scene| scene.follows_now(since));
        scene.player = Some(player);
        times.push(ms);
    }
    say_times("player killed", times);
    assert_eq!(scene.count("/pen/rejected"), 0);
    let report = scene.end();
    // Losing the pen never costs the arm.
    assert_eq!((&report["begins"], &report["streams"]), (&1.into(), &1.into()), "{report}");
}

#[test]
fn arm_killed() {
    let mut scene = Scene::following();
    let (mut moments, mut times) = (Moments::new(), Vec::new());
    for _ in 0..rounds(SHARE) {
        moments.wait(300);
        scene.arm.take().expect("an arm").kill();
        // Until then the loop still follows the pen, which looks like a recovery.
        stops_by_itself(&scene);
        let since = monotonic_now_ns();
        let report = scene.next_arm_report();
        let words = ["arm", "sim", "--json", &report];
        let (arm, ms) = started(&mut scene, &words, |scene| follows(scene, since));
        scene.arm = Some(arm);
        times.push(ms);
    }
    say_times("arm killed", times);
    scene.end();
}

#[test]
fn daemon_killed() {
    let mut scene = Scene::following();
    let (mut moments, mut times) = (Moments::new(), Vec::new());
    let rounds = rounds(SHARE);
    for _ in 0..rounds {
        moments.wait(300);
        scene.daemon.take().expect("a daemon").kill();
        moments.wait(300);
        let since = monotonic_now_ns();
        scene.daemon = Some(scene.world.daemon(0));
        let ms = until("the loop follows again", || {
            for process in [&mut scene.arm, &mut scene.player] {
                process.as_mut().expect("peers outlive the daemon").expect_alive();
            }
            follows(&scene, since)
        });
        times.push(ms);
    }
    say_times("daemon killed", times);
    let report = scene.end();
    assert_eq!(report["streams"], u64::from(rounds) + 1, "{report}");
}

#[test]
fn monitor_killed() {
    let mut scene = Scene::following();
    let mut moments = Moments::new();
    let (before, rounds) = (scene.count("/loop/ticks"), rounds(SHARE));
    let mut times = Vec::new();
    for round in 0..rounds {
        let words: &[&str] = if round % 2 == 0 { &["observe", "3600"] } else { &["status", "--watch"] };
        let monitor = scene.world.start(0, words);
        moments.wait(400);
        monitor.kill();
        let since = monotonic_now_ns();
        times.push(scene.follows_again(since));
    }
    assert!(scene.count("/loop/ticks") > before);
    say_times("monitor killed", times);
    scene.player.as_mut().expect("a player").expect_alive();
    let report = scene.end();
    assert_eq!((&report["begins"], &report["streams"]), (&1.into(), &1.into()), "{report}");
}

#[test]
fn killed_during_start_up() {
    let mut scene = Scene::following();
    let (mut moments, mut times) = (Moments::new(), Vec::new());
    let report = scene.next_arm_report();
    let arm_words = ["arm", "sim", "--json", &report];
    let mut killed = 0;
    for round in 0..rounds(SHARE) {
        // What is to be started half has to be gone first.
        match round % 4 {
            0 => drop(scene.player.take()),
            1 => {
                drop(scene.arm.take());
                stops_by_itself(&scene);
            }
            2 => drop(scene.daemon.take()),
            _ => {}
        }
        for _ in 0..3 {
            let words: &[&str] = match round % 4 {
                0 => &PLAY,
                1 => &arm_words,
                2 => &["daemon", "--no-rights"],
                _ => &["observe", "3600"],
            };
            let half = scene.world.start(0, words);
            moments.wait(60);
            half.kill();
            killed += 1;
        }
        let since = monotonic_now_ns();
        let ms = match round % 4 {
            0 => {
                let (player, ms) = started(&mut scene, &PLAY, |scene| follows(scene, since));
                scene.player = Some(player);
                ms
            }
            1 => {
                let (arm, ms) = started(&mut scene, &arm_words, |scene| follows(scene, since));
                scene.arm = Some(arm);
                ms
            }
            2 => {
                scene.daemon = Some(scene.world.daemon(0));
                until("the loop follows again", || follows(&scene, since))
            }
            // Starting many processes may starve the arm for 50 ms, which latches a stop, correctly.
            _ => until("the loop follows again", || follows(&scene, since)),
        };
        times.push(ms);
    }
    say("killed during start-up", &format!("{killed} half-started processes"));
    say_times("killed during start-up", times);
    scene.end();
}
