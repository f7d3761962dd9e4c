//! Orphaned segments: of a killed run, truncated, garbage, of another version.

use std::os::unix::fs::{PermissionsExt, chown};
use std::path::PathBuf;
use std::rc::Rc;

use foretrace_client::monotonic_now_ns;
use foretrace_tests::{World, until};

use super::scene::{Scene, assert_nothing_left, say, say_times};
use crate::PROGRAM;

/// The instance's segments.
pub(crate) fn segments(world: &World) -> Vec<PathBuf> {
    let prefix = world.instance(0).prefix().to_owned();
    let entries = std::fs::read_dir("/dev/shm").expect("shared memory").flatten();
    entries
        .filter(|entry| entry.file_name().to_string_lossy().starts_with(&prefix))
        .map(|entry| entry.path())
        .collect()
}

/// Everything of a following scene is killed at once.
fn killed_run() -> Rc<World> {
    let scene = Scene::following();
    let world = scene.world.clone();
    scene.slaughter();
    world
}

#[test]
fn segments_of_a_killed_run() {
    let world = killed_run();
    let left = segments(&world).len();
    assert!(left > 10, "{left} segments");
    let since = monotonic_now_ns();
    let scene = Scene::following_in(world);
    let took = (monotonic_now_ns() - since) as f64 * 1e-6;
    say(
        "killed run",
        &format!("{left} segments left behind; a new loop follows {took:.0} ms after its start"),
    );
    scene.end();
}

#[test]
fn segments_cut_short_and_of_garbage() {
    let world = killed_run();
    let left = segments(&world);
    for (index, path) in left.iter().enumerate() {
        match index % 3 {
            0 => std::fs::write(path, "").expect("root or owner"),
            1 => std::fs::write(path, vec![0xa5; 5000]).expect("root or owner"),
            _ => {}
        }
    }
    // The middleware's own book-keeping, too.
    let mut below = vec![world.instance(0).root().join("iox2")];
    let mut spoiled = 0;
    while let Some(path) = below.pop() {
        let Ok(entries) = std::fs::read_dir(&path) else { continue };
        for entry in entries.flatten() {
            let Ok(kind) = entry.file_type() else { continue };
            if kind.is_dir() {
                below.push(entry.path());
            } else if kind.is_file() {
                let _ = std::fs::set_permissions(entry.path(), PermissionsExt::from_mode(0o600));
                spoiled += usize::from(std::fs::write(entry.path(), "garbage").is_ok());
            }
        }
    }
    assert!(spoiled > 5, "{spoiled} files spoiled");
    let since = monotonic_now_ns();
    let scene = Scene::following_in(world);
    let took = (monotonic_now_ns() - since) as f64 * 1e-6;
    say(
        "garbage",
        &format!("{} segments and {spoiled} files spoiled; follows after {took:.0} ms", left.len()),
    );
    scene.end();
}

#[test]
fn segments_of_another_version() {
    let world = World::new(PROGRAM);
    let own = world.instance(0).prefix().to_owned();
    // Same number, same folder, another version of the middleware: its names differ, so they are neither
    // touched nor a problem.
    let (head, tail) = own.split_once('v').expect("ft<number>v<version>_<hash>_");
    let other = format!("{head}v001{}", &tail[tail.find('_').expect("a hash")..]);
    let foreign = PathBuf::from(format!("/dev/shm/{other}1.dynamic"));
    // And one with our own name that no service of ours ever had.
    let ours = PathBuf::from(format!("/dev/shm/{own}0123456789.data"));
    for path in [&foreign, &ours] {
        std::fs::write(path, [7; 3000]).expect("/dev/shm is open to all");
        std::fs::set_permissions(path, PermissionsExt::from_mode(0o600)).expect("own file");
        chown(path, Some(world.user()), Some(world.user())).expect("root, or the owner");
    }
    let scene = Scene::following_in(world);
    assert!(foreign.exists(), "what belongs to another version is not ours to remove");
    assert!(!ours.exists(), "a leftover with our name is removed at start");
    let since = monotonic_now_ns();
    say_times("another version's segments", vec![scene.follows_again(since)]);
    scene.end();
    std::fs::remove_file(&foreign).expect("it is still there");
}

#[test]
fn doctor_cleans_up_after_a_killed_run() {
    let world = killed_run();
    let before = segments(&world).len();
    let since = monotonic_now_ns();
    // Its verdict on the machine does not matter here.
    let cleaned = until("doctor --clean ends", || {
        Some(world.run(0, &["doctor", "--no-rights", "--seconds", "0.5", "--clean"]))
    });
    let took = (monotonic_now_ns() - since) as f64 * 1e-6;
    let left = segments(&world).len();
    assert_eq!(left, 0, "{before} segments before; {}", foretrace_tests::told(&cleaned));
    say("doctor --clean", &format!("{before} segments removed in {took:.0} ms"));
    assert_nothing_left(&world);
}
