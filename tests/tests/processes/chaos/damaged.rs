//! Segments that are replaced under a running daemon, which has its own open: what a program that attaches
//! then meets. Each must end by itself within its time; only hangs and panics are asserted, never speed.

use std::os::unix::fs::{PermissionsExt, chown};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use foretrace_tests::{World, assert_refused, told};

use super::scene::say;
use super::stale::segments;
use crate::PROGRAM;

/// Longest time of a command on a busy machine; `status` bounds itself to 8 s.
const LONGEST: Duration = Duration::from_secs(30);

/// A segment with another content, until this is dropped.
struct Replaced {
    path: PathBuf,
    aside: PathBuf,
}

impl Replaced {
    fn new(world: &World, path: &Path, content: &[u8]) -> Self {
        let name = path.file_name().expect("a file").to_string_lossy().into_owned();
        // A name that is none of the instance's.
        let replaced = Self { path: path.to_path_buf(), aside: format!("/dev/shm/aside-{name}").into() };
        std::fs::rename(path, &replaced.aside).expect("root or owner");
        std::fs::write(path, content).expect("/dev/shm is open to all");
        std::fs::set_permissions(path, PermissionsExt::from_mode(0o600)).expect("own file");
        chown(path, Some(world.user()), Some(world.user())).expect("root, or the owner");
        replaced
    }
}

impl Drop for Replaced {
    fn drop(&mut self) {
        let _ = std::fs::rename(&self.aside, &self.path);
    }
}

/// Daemon, arm and pen that live, and peers of each kind that were killed.
fn inhabited(world: &World) -> [foretrace_tests::Process; 3] {
    let daemon = world.daemon(0);
    let arm = world.armed_arm(0, &[]);
    let pen = world.start(0, &["play", "glyphs:ab", "--loop"]);
    world.wait_for_mode(0, "following");
    for role in ["hold-node", "hold-place"] {
        let peer = world.start(0, &[role]);
        std::thread::sleep(Duration::from_millis(300));
        peer.kill();
    }
    [daemon, arm, pen]
}

#[test]
fn status_and_requests_end_whatever_a_segment_holds() {
    let world = World::new(PROGRAM);
    let [daemon, arm, pen] = inhabited(&world);
    let (mut cases, mut died, mut longest) = (0, 0, Duration::ZERO);
    for path in segments(&world) {
        let Ok(whole) = std::fs::read(&path) else { continue };
        let half = whole.get(..whole.len() / 2).unwrap_or_default().to_vec();
        let noise: Vec<u8> = (0..whole.len()).map(|at| ((at * 167) >> 3) as u8 | 1).collect();
        for (what, content) in [("empty", &[][..]), ("cut", &half), ("noise", &noise)] {
            let replaced = Replaced::new(&world, &path, content);
            for command in [&["status"][..], &["request", "query", "--timeout", "5"]] {
                let begin = Instant::now();
                let output = world.run(0, command);
                longest = longest.max(begin.elapsed());
                assert!(begin.elapsed() < LONGEST, "{what} {}: {command:?}", path.display());
                let words = told(&output);
                assert!(!words.contains("panicked"), "{what} {}: {words}", path.display());
                if what == "empty" {
                    let file = path.display().to_string();
                    assert_refused(&output, 1, &["attaching would hang", "rm ", &file]);
                }
                cases += 1;
                died += usize::from(output.status.code().is_none());
            }
            drop(replaced);
        }
    }
    assert!(cases > 60, "{cases}");
    // Nobody else noticed.
    let status = world.status(0);
    assert_eq!(status["mode"], "following", "{status}");
    pen.end();
    arm.end();
    daemon.end();
    say(
        "damaged",
        &format!(
            "{cases} calls, {died} died of a fault in memory, the longest took {:.1} s",
            longest.as_secs_f64()
        ),
    );
}

#[test]
fn every_command_that_attaches_names_an_empty_segment_and_ends() {
    let world = World::new(PROGRAM);
    let [daemon, arm, pen] = inhabited(&world);
    let own = world.user().to_string();
    let path =
        segments(&world).into_iter().find(|path| path.extension().is_some_and(|kind| kind == "dynamic"));
    let path = path.expect("a service");
    let replaced = Replaced::new(&world, &path, &[]);
    let file = path.display().to_string();
    for command in [
        &["status", "--watch"][..],
        &["request", "arm"],
        &["play", "glyphs:Hi"],
        &["record", "all.mcap"],
        &["record", "--pen", "pen.csv"],
        &["flight", "flights"],
        &["relay"],
        &["metrics", "--listen", "127.0.0.1:0"],
        &["foxglove", "--listen", "127.0.0.1:0"],
        &["arm", "sim"],
        &["gateway", "--socket", "pen.socket", "--allow-uid", &own],
        &["console", "--port", "0"],
        &["move", "home", "--yes"],
        &["calibrate", "lag"],
    ] {
        let begin = Instant::now();
        let output = world.run(0, command);
        assert!(begin.elapsed() < LONGEST, "{command:?}");
        assert_refused(&output, 1, &["attaching would hang", &file]);
    }
    let begin = Instant::now();
    let examined = world.run(0, &["doctor", "--no-rights", "--seconds", "0.5"]);
    assert!(begin.elapsed() < 2 * LONGEST, "{}", told(&examined));
    // A stop needs none of it.
    let stopped = world.run(0, &["request", "stop", "--timeout", "5"]);
    assert!(stopped.status.success(), "{}", told(&stopped));
    drop(replaced);
    world.wait_for_mode(0, "stopped");
    pen.end();
    arm.end();
    daemon.end();
}
