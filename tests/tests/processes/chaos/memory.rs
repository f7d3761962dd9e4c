//! Shared memory that is too small, full at start, or fills up under a running loop: in a mount namespace of
//! its own, so that only these processes see it. Making one needs root; elsewhere each test says that it was
//! skipped.

use std::io::{BufRead, BufReader};
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use foretrace_client::monotonic_now_ns;
use foretrace_tests::{World, assert_refused, told};

use super::scene::{PLAY, Scene, assert_nothing_left, say, say_times};
use crate::PROGRAM;

/// A mount namespace with a /dev/shm of its own.
struct Namespace(Child);

impl Namespace {
    /// One with so many MiB, in which `world` goes on; `None` where that is not allowed.
    fn enter(world: &mut World, mib: u32) -> Option<Self> {
        let script = format!(
            "mount -t tmpfs -o size={mib}m,mode=1777 tmpfs /dev/shm && echo ready && exec sleep 1800"
        );
        let mut holder = Command::new("unshare")
            .args(["--mount", "sh", "-c", &script])
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .ok()?;
        let mut line = String::new();
        let read = BufReader::new(holder.stdout.take()?).read_line(&mut line);
        let namespace = Self(holder);
        if read.is_err() || line.trim() != "ready" {
            say("shared memory", "skipped: only root can give a process a /dev/shm of its own");
            return None;
        }
        let user = world.user();
        let identity = [format!("--reuid={user}"), format!("--regid={user}"), "--clear-groups".to_owned()];
        let mut words = namespace.words();
        words.push("setpriv".to_owned());
        words.extend(identity);
        world.go_through(words);
        Some(namespace)
    }

    fn words(&self) -> Vec<String> {
        vec!["nsenter".to_owned(), format!("--mount=/proc/{}/ns/mnt", self.0.id())]
    }

    /// Runs a script as root in it.
    fn run(&self, script: &str) {
        let words = self.words();
        let done = Command::new(&words[0]).args(&words[1..]).args(["sh", "-c", script]).output();
        let done = done.expect("nsenter");
        assert!(done.status.success(), "{script}: {}", told(&done));
    }

    /// Leaves no byte.
    fn fill(&self) {
        self.run("head -c 1G /dev/zero > /dev/shm/ballast 2>/dev/null; test $(stat -f -c %a /dev/shm) -eq 0");
    }
}

impl Drop for Namespace {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

#[test]
fn shared_memory_too_small() {
    let mut world = World::new(PROGRAM);
    let Some(_namespace) = Namespace::enter(&mut world, 4) else { return };
    let refused = world.run(0, &["daemon", "--no-rights"]);
    assert_refused(&refused, 1, &["/dev/shm has 4096 KiB free", "needs up to 8192 KiB", "--shm-size"]);
    assert_nothing_left(&world);
    say("tiny /dev/shm", "the daemon refuses to start and says how much it needs");
}

#[test]
fn shared_memory_full_at_start() {
    let mut world = World::new(PROGRAM);
    let Some(namespace) = Namespace::enter(&mut world, 64) else { return };
    namespace.fill();
    let refused = world.run(0, &["daemon", "--no-rights"]);
    assert_refused(&refused, 1, &["/dev/shm has 0 KiB free", "remove files there"]);
    namespace.run("rm /dev/shm/ballast");
    let since = monotonic_now_ns();
    let scene = Scene::following_in(world);
    let took = (monotonic_now_ns() - since) as f64 * 1e-6;
    say("full /dev/shm", &format!("refused; with room again it follows after {took:.0} ms"));
    scene.end();
}

#[test]
fn shared_memory_fills_up_under_a_running_loop() {
    let mut world = World::new(PROGRAM);
    let Some(namespace) = Namespace::enter(&mut world, 64) else { return };
    let mut scene = Scene::following_in(world);
    namespace.fill();
    // Connected processes go on: their pages are allocated.
    std::thread::sleep(Duration::from_secs(2));
    let since = monotonic_now_ns();
    scene.follows_again(since);
    for process in [&mut scene.daemon, &mut scene.arm, &mut scene.player] {
        process.as_mut().expect("everybody").expect_alive();
    }
    namespace.run("rm /dev/shm/ballast");
    let since = monotonic_now_ns();
    let status = scene.world.status(0);
    assert_eq!(status["mode"], "following", "{status}");
    say_times("/dev/shm fills up", vec![scene.follows_again(since)]);
    let report = scene.end();
    assert_eq!((&report["begins"], &report["streams"]), (&1.into(), &1.into()), "{report}");
}

#[test]
fn stop_while_shared_memory_is_full() {
    let mut world = World::new(PROGRAM);
    let Some(namespace) = Namespace::enter(&mut world, 64) else { return };
    let mut scene = Scene::following_in(world);
    struct Room<'a>(&'a Namespace);
    impl Drop for Room<'_> {
        fn drop(&mut self) {
            self.0.run("rm -f /dev/shm/ballast");
        }
    }
    super::stops::stops_under("/dev/shm is full", &mut scene, |_| {
        namespace.fill();
        Room(&namespace)
    });
    scene.end();
}

#[test]
fn newcomers_while_shared_memory_is_full() {
    let mut world = World::new(PROGRAM);
    let Some(namespace) = Namespace::enter(&mut world, 64) else { return };
    let mut scene = Scene::following_in(world);
    scene.player.take().expect("a player").end();
    namespace.fill();
    // A newcomer gets the reason for its refusal; connected processes are not affected.
    for words in [&["status"][..], &["request", "query"], &PLAY, &["observe", "1"]] {
        let refused = scene.world.run(0, words);
        assert_refused(&refused, 1, &["/dev/shm has 0 KiB free", "remove files there"]);
        scene.arm.as_mut().expect("an arm").expect_alive();
        scene.daemon.as_mut().expect("a daemon").expect_alive();
    }
    namespace.run("rm /dev/shm/ballast");
    let since = monotonic_now_ns();
    scene.player = Some(scene.world.start(0, &PLAY));
    say_times("newcomers to a full /dev/shm", vec![scene.follows_again(since)]);
    scene.end();
}
