//! A Universal Robots arm whose bridge, daemon or player dies or stands still, or whose network is cut, at
//! random moments: watched by an RTDE client that belongs to none of them.
//!
//! Contract: what is asserted is that the arm comes to rest, how it does (no joint faster or harder than it
//! may be, the program on the controller with its own deceleration), and that it stands until somebody arms
//! again. How long it took is told. Half of the rounds have a CB3, half an e-Series. The client is ours, or
//! that of `ur_rtde` where FORETRACE_UR_VENV names a Python environment that has it.

mod broken;
mod reasons;
mod relay;
mod scene;
mod watcher;

use super::scene::{Moments, rounds, say_times};
use scene::{Scene, Series, signal};

/// What may happen once the fault is mended and nobody has armed.
#[derive(Clone, Copy, PartialEq)]
enum After {
    /// Nothing.
    Stands,
    /// The loop is armed still, and goes on when the pen does.
    GoesOn,
}

/// Who brings the arm to rest.
#[derive(Clone, Copy, PartialEq)]
enum Braked {
    /// The program on the controller, by itself.
    ByProgram,
    /// Targets that lead it there.
    ByTargets,
}

/// Of all rounds, every test here takes an eighth.
const SHARE: u32 = 8;

/// `fault` at a random moment, again and again; the arm has to come to rest after each.
fn rounds_of(
    name: &str,
    (braked, after): (Braked, After),
    mut fault: impl FnMut(&mut Scene),
    mut mend: impl FnMut(&mut Scene),
) {
    for series in [Series::Cb3, Series::E] {
        let mut scene = Scene::following(series);
        let (mut moments, mut times) = (Moments::new(), Vec::new());
        for round in 0..(rounds(SHARE) / 2).max(1) {
            let when = format!("{name}, {series:?}, round {round}");
            moments.wait(1500);
            let from = scene.moves();
            scene.forget(from);
            fault(&mut scene);
            times.push(1e3 * (scene.watcher.rests() - from).max(0.0));
            scene.judge(&when, braked == Braked::ByProgram);
            mend(&mut scene);
            scene.restart_missing();
            if after == After::Stands
                && let Err(moved) = scene.watcher.stands_for_a_second()
            {
                let status = scene.world.status(0);
                panic!(
                    "{when}: it moved before it was armed: {moved}, {} {}",
                    status["mode"], status["stop"]
                );
            }
            scene.follow();
        }
        say_times(&format!("{name}, {series:?}, seen by {}", scene.watcher.whose()), times);
    }
}

#[test]
fn ur_bridge_killed() {
    rounds_of(
        "ur bridge killed",
        (Braked::ByProgram, After::Stands),
        |scene| {
            scene.bridge.take().expect("a bridge").kill();
        },
        |_| {},
    );
}

#[test]
fn ur_bridge_stands_still() {
    rounds_of(
        "ur bridge stands still",
        (Braked::ByProgram, After::Stands),
        |scene| signal(&scene.bridge, "-STOP"),
        |scene| signal(&scene.bridge, "-CONT"),
    );
}

#[test]
fn ur_daemon_killed() {
    rounds_of(
        "ur daemon killed",
        (Braked::ByTargets, After::Stands),
        |scene| {
            scene.daemon.take().expect("a daemon").kill();
        },
        |_| {},
    );
}

#[test]
fn ur_daemon_stands_still() {
    rounds_of(
        "ur daemon stands still",
        (Braked::ByTargets, After::Stands),
        |scene| signal(&scene.daemon, "-STOP"),
        |scene| signal(&scene.daemon, "-CONT"),
    );
}

#[test]
fn ur_player_killed() {
    rounds_of(
        "ur player killed",
        (Braked::ByTargets, After::GoesOn),
        |scene| {
            scene.player.take().expect("a player").kill();
        },
        |_| {},
    );
}

#[test]
fn ur_player_stands_still() {
    rounds_of(
        "ur player stands still",
        (Braked::ByTargets, After::GoesOn),
        |scene| signal(&scene.player, "-STOP"),
        |scene| signal(&scene.player, "-CONT"),
    );
}

#[test]
fn ur_network_cut() {
    rounds_of(
        "ur network cut",
        (Braked::ByProgram, After::Stands),
        |scene| scene.order("cut 60 127.0.0.1"),
        |scene| scene.order("cut 0"),
    );
}
